"""How long computations say where they are: they call a function that the caller hands in, and never print."""

from collections.abc import Callable

from yeastfit.errors import InputError
from yeastfit.text import quoted

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole that is done, from 0 to 1."""


def silent(what: str, share: float) -> None:
    """Say nothing: the default `Progress`."""


def progress_or_silent(progress: Progress | None) -> Progress:
    """What to call, `silent` for None. Raises `InputError` where it cannot be called."""
    if progress is not None and not callable(progress):
        raise InputError(
            f"progress is {quoted(progress)}, it must be a function of what is being done and the share that is done"
        )
    return progress or silent
