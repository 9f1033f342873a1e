"""How long computations say where they are."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole that is behind."""


def silent(what: str, share: float) -> None:
    """A `Progress` that says nothing."""
