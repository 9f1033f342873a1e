"""Functions compiled by numba, an optional dependency: where it is missing, calling one says how to install it.

Numba keeps what it has compiled in files, of which none is needed: where they cannot be written, or are damaged, the
functions are compiled again. Importing this module imports numba, which takes half a second.
"""

import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache, wraps
from hashlib import sha256
from inspect import unwrap
from pathlib import Path
from threading import Event
from typing import Any, ParamSpec, TypeVar

import numpy as np

from yeastfit.errors import InputError

MISSING = "numba, which is not installed: pip install 'yeastfit[offlattice]'"
try:
    from numba import config, njit
    from numba.core.caching import FunctionCache, NullCache
except ImportError:
    njit, FunctionCache, NullCache = None, object, object  # type: ignore[assignment, misc]
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
    dispatcher = njit(**options, nogil=True, error_model="numpy")(named_by_sources(plain))
    keep_compiled(dispatcher, plain)
    return dispatcher


def keep_compiled(compiled: Any, function: Callable[..., Any]) -> None:
    """Keep on disk what numba compiles of a function, as far as possible.

    Arguments:
        compiled: Numba's object, which has not compiled anything yet; this is what its `enable_caching` does.
        function: That it compiles.
    """
    try:
        compiled._cache = _Files(function)
    except RuntimeError:  # numba has found no folder that can be written
        compiled._cache = _NoFiles()


class _Files(FunctionCache):
    """Numba's files of a function."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was kept, or nothing where that cannot be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # what is damaged makes pickle and numba fail in any way
            with suppress(Exception):
                self.flush()  # else nothing new could be kept
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it, or say why not."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _tell_nothing_kept(f"cannot be kept in {self.cache_path} ({error.strerror or error})")


class _NoFiles(NullCache):
    """Where there is no place for files."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Say so."""
        _tell_nothing_kept("cannot be kept: neither the folder of the package nor numba's own can be written")


_TOLD = Event()


def _tell_nothing_kept(why: str) -> None:
    """Warn, once in a process: functions are kept in several folders."""
    if _TOLD.is_set():
        return
    _TOLD.set()
    advice = "every run compiles it again, which may take a minute; NUMBA_CACHE_DIR names another folder"
    warnings.warn(f"what numba compiles {why}; {advice}", RuntimeWarning, stacklevel=2)


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
