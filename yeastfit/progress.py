"""How long computations say where they are: they call a function that the caller hands in, and never print."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole that is done, from 0 to 1."""


def silent(what: str, share: float) -> None:
    """Say nothing: the default `Progress`."""
