"""Imported first by Dask's workers on this machine: they end with their parent, those that are stopped, too."""

from yeastfit.worker_processes import be_killed_with_parent

be_killed_with_parent()
