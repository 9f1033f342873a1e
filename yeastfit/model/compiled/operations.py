"""Operations of XLA's programs that numba has compiled: whether there can be any, and their names.

Each has a name for each precision, under which it is registered when it is first asked for.
"""

import threading
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import jax
import numpy as np

Call = Callable[[Any], int]

_REGISTERING = threading.Lock()  # colonies on several devices are traced by a thread each, and XLA takes a name once


def are_possible() -> bool:
    """Whether numba is installed and colonies grow on a CPU."""
    return jax.default_backend() == "cpu" and find_spec("numba") is not None


def operation(kind: str, dtype: np.dtype, call_of: Callable[[Any], Call]) -> str:
    """The name of an operation, which is registered at the first call, of whatever thread.

    Arguments:
        kind: What it does.
        dtype: Of its numbers.
        call_of: Makes the function of a frame (`foreign_call`), given the type of a number.
    """
    with _REGISTERING:
        return _registered(f"yeastfit_{kind}_{dtype.name}", dtype, call_of)


@cache
def _registered(name: str, dtype: np.dtype, call_of: Callable[[Any], Call]) -> str:
    from yeastfit.model.compiled.foreign_call import register

    register(name, call_of(dtype.type))
    return name
