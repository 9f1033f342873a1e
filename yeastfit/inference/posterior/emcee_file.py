"""Chains in an HDF5 file that emcee's `HDFBackend` reads."""

from pathlib import Path

from emcee.backends import Backend, HDFBackend

from yeastfit.storage import hdf5_written_whole


def write_chains(path: str | Path, backend: Backend) -> None:
    """Write all steps of a backend, burn-in included.

    Arguments:
        path: Written whole or not at all.
        backend: emcee's, in memory.
    """
    blobs = backend.get_blobs()
    with hdf5_written_whole(path) as image:
        kept = HDFBackend(image)
        kept.reset(*backend.shape)
        kept.grow(backend.iteration, None if blobs is None else blobs[0])
        with kept.open("a") as file:
            group = file[kept.name]
            group["chain"][...], group["log_prob"][...] = backend.get_chain(), backend.get_log_prob()
            if blobs is not None:
                group["blobs"][...] = blobs
            group["accepted"][...] = backend.accepted
            group.attrs["iteration"] = backend.iteration
            for k, part in enumerate(backend.random_state):
                group.attrs[f"random_state_{k}"] = part
