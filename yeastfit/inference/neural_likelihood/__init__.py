"""Posteriors from a likelihood that networks learn."""
