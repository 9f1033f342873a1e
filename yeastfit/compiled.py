"""Functions compiled by numba, an optional dependency: where it is missing, calling one says how to install it.

Importing this module imports numba, which takes half a second.
"""

from collections.abc import Callable
from functools import cache, wraps
from hashlib import sha256
from inspect import unwrap
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from yeastfit.errors import InputError

MISSING = "numba, which is not installed: pip install 'yeastfit[offlattice]'"
try:
    from numba import config, njit
except ImportError:
    njit = None  # type: ignore[assignment]
else:
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        njit = None  # type: ignore[assignment]
        MISSING = "numba's compiler, which NUMBA_DISABLE_JIT switches off: unset that variable"

Index = np.uint64  # of an array, in a loop that counts: numba does not ask whether one of this kind is negative
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function that makes no arrays, at its first call; the result is kept on disk, and threads share it.

    References to arrays are not counted, which would take half the time of a growing colony. Numba refuses to compile a
    function that makes an array all the same.

    Raises:
        InputError: When the function is called without numba installed.
    """
    return _compiled(function, _nrt=False)


def inlined_kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function as `kernel` does, and write it into each kernel that calls it, in place of the call."""
    return _compiled(function, _nrt=False, forceinline=True)


def array_kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function as `kernel` does; it may make arrays.

    Raises:
        InputError: When the function is called without numba installed.
    """
    return _compiled(function)


def _compiled(function: Callable[Arguments, Result], **options: Any) -> Callable[Arguments, Result]:
    """Compile lazily, under a name with a digest of the sources of the function's folder.

    Numba compiles again when the file of a kernel changes, but not when a kernel that it calls does, in another file.
    What is divided by 0 becomes infinite, as in NumPy: loops that look for it are not worked off many at a time.
    """
    plain = unwrap(function)  # of the tests' type checks, which numba cannot compile
    if njit is None:
        return _missing(plain)
    return njit(**options, cache=True, nogil=True, error_model="numpy")(named_by_sources(plain))


def named_by_sources(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function under a name by which numba finds what it has kept of it only while its folder is as it was."""
    function.__qualname__ += f"_{_sources(Path(function.__code__.co_filename).parent)}"
    return function


def _missing(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    @wraps(function)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        raise InputError(f"this needs {MISSING}")

    return call


@cache
def _sources(folder: Path) -> str:
    """Eight hexadecimal digits that change with any file of a folder, and with how kernels are compiled."""
    files = [*sorted(folder.glob("*.py")), Path(__file__)]
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]
