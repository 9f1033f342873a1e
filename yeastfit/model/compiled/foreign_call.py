"""Functions compiled by numba as operations of XLA's programs on a CPU, without Python and its lock.

XLA calls a foreign function with one pointer, to a frame that says where arguments and results lie
(`xla/ffi/api/c_api.h`, which jaxlib brings along; its layout is kept). In words of 8 bytes:

    frame                 1 → extension    2 → interface    9 → pointers to arguments    14 → pointers to results
    argument or result    3 → numbers
    interface             4 its version
    extension             3 → where to write, in word 3, the version that the function was made for

With an extension a function is only asked for that, once, when it is registered. Importing this module imports numba.
"""

from collections.abc import Callable
from inspect import unwrap
from typing import Any

import jax
import numpy as np
from numba import carray, types
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from yeastfit.compiled import array_kernel, keep_compiled, named_by_sources

FRAME = types.CPointer(types.int64)
Call = Callable[[Any], int]  # of a frame
NULL = 0  # what a foreign function returns that has not failed


def register(name: str, function: Call) -> None:
    """Register a function of a frame, which it hands on to `argument` and `result`, for `jax.ffi.ffi_call`."""
    plain = named_by_sources(unwrap(function))
    compiled = CFunc(plain, ((FRAME,), types.int64), locals={}, options={})
    keep_compiled(compiled, plain)
    compiled.compile()
    _KEPT.append(compiled)  # as long as programs call it
    jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(compiled.address), platform="cpu")


_KEPT: list[Any] = []


def _typed_pointer(typing_context: Any, address: Any, dtype: Any) -> Any:
    """A pointer to numbers at an address."""
    pointer = types.CPointer(dtype.dtype)

    def generated(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(pointer))

    return pointer(types.int64, dtype), generated


_pointer: Any = intrinsic(unwrap(_typed_pointer))  # numba gives the typing context itself


@array_kernel
def is_question(frame: Any) -> bool:
    """Whether a frame only asks for the version, which is then answered: that of who asks."""
    words = carray(frame, 15)
    if words[1] == NULL:
        return False
    version = carray(_pointer(words[2], np.int64), 5)[4]
    asked = carray(_pointer(words[1], np.int64), 4)[3]
    carray(_pointer(asked, np.int64), 4)[3] = version
    return True


@array_kernel
def argument(frame: Any, index: int, shape: Any, dtype: Any) -> np.ndarray:
    """An argument as an array."""
    return _array(carray(frame, 15)[9], index, shape, dtype)


@array_kernel
def result(frame: Any, index: int, shape: Any, dtype: Any) -> np.ndarray:
    """A result as an array, to be filled."""
    return _array(carray(frame, 15)[14], index, shape, dtype)


@array_kernel
def _array(buffers: int, index: int, shape: Any, dtype: Any) -> np.ndarray:
    buffer = carray(_pointer(buffers, np.int64), index + 1)[index]
    return carray(_pointer(carray(_pointer(buffer, np.int64), 4)[3], dtype), shape)
