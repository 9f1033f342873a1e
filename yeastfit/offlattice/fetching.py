"""Fetching cells from memory ahead of their use: a million of them are more than the processor's caches hold.

Of a large colony, most of an attempt's time would be spent waiting for one cell after the other. Fetched together,
all arrive in the time of one. It changes no result, and an index at which there is no cell does no harm.
"""

from inspect import unwrap
from typing import Any

try:
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types
    from numba.core import cgutils
    from numba.extending import intrinsic
except ImportError:  # kernels say so (`compiled`)
    intrinsic = None  # type: ignore[assignment]


def _fetch(typing_context: Any, array: Any, index: Any) -> Any:
    """Let the processor bring one element of an array into all its caches, without waiting for it."""

    def generated(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        held = context.make_array(array)(context, builder, arguments[0])
        places = [context.cast(builder, arguments[1], index, types.intp)]
        shape, strides = (cgutils.unpack_tuple(builder, of) for of in (held.shape, held.strides))
        element = cgutils.get_item_pointer2(context, builder, held.data, shape, strides, array.layout, places)
        pointer, flag = cgutils.voidptr_t, ir.IntType(32)
        takes = ir.FunctionType(ir.VoidType(), [pointer, flag, flag, flag])
        prefetch = builder.module.declare_intrinsic("llvm.prefetch", [pointer], takes)
        builder.call(prefetch, [builder.bitcast(element, pointer), flag(0), flag(3), flag(1)])  # to read, often, data
        return context.get_dummy_value()

    return types.void(array, index), generated


fetch: Any = None if intrinsic is None else intrinsic(unwrap(_fetch))  # numba gives the typing context itself
