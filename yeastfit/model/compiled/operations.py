"""Operations of XLA's programs that numba has compiled: whether there can be any, and their names.

Each has a name for each precision, under which it is registered when it is first asked for.
"""

import threading
from functools import cache
from importlib.util import find_spec

import jax
import numpy as np
from jaxtyping import Array

from yeastfit.model.cells import Cells

_REGISTERING = threading.Lock()  # colonies on several devices are traced by a thread each, and XLA takes a name once


def are_possible() -> bool:
    """Whether numba is installed and colonies grow on a CPU."""
    return jax.default_backend() == "cpu" and find_spec("numba") is not None


def operation(kind: str, dtype: np.dtype) -> str:
    """The name of an operation, which is registered at the first call, of whatever thread.

    Arguments:
        kind: What it does: a function of `calls`.
        dtype: Of its numbers.
    """
    with _REGISTERING:
        return _registered(kind, dtype)


def shapes_of(cells: Cells) -> tuple[tuple[Array, Array, Array], tuple[int, int]]:
    """Half lengths, half widths and exponents of cells, and how many of the first and of the last there are.

    Of ellipses no exponent counts; the one that is handed over is there because XLA hands over no empty array.
    """
    exponents = cells.half_lengths[:1] if cells.exponents is None else cells.exponents
    counts = cells.weights.shape[0], 0 if cells.exponents is None else cells.exponents.shape[0]
    return (cells.half_lengths, cells.half_widths, exponents), counts


@cache
def _registered(kind: str, dtype: np.dtype) -> str:
    from yeastfit.model.compiled import calls  # imports numba
    from yeastfit.model.compiled.foreign_call import register

    name = f"yeastfit_{kind}_{dtype.name}"
    register(name, getattr(calls, kind)(dtype.type))
    return name
