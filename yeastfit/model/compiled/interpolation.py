"""The nutrient and its gradient at the nodes as operations that numba has compiled, for large colonies on a CPU.

The same numbers as those of `interpolation`, to the last bits. They have no derivative.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.operations import Call, operation
from yeastfit.model.numerics import Numerics


def compiled_nutrient_at(colony: Colony, numerics: Numerics) -> Float[Array, " node"]:
    """`nutrient_at` of one colony."""
    return _read("nutrient", colony, numerics, colony.parents.shape, _nutrient_of)


def compiled_gradient_at(colony: Colony, numerics: Numerics) -> Float[Array, "node 2"]:
    """`gradient_at` of one colony."""
    return _read("gradient", colony, numerics, colony.positions.shape, _gradient_of)


def _read(
    kind: str, colony: Colony, numerics: Numerics, shape: tuple[int, ...], call_of: Callable[[Any], Call]
) -> Array:
    dtype = colony.positions.dtype
    sizes = jnp.asarray([numerics.points, colony.parents.shape[0]], jnp.int32)
    lengths = jnp.asarray([0.5 * numerics.domain, numerics.spacing], dtype)
    name = operation(kind, np.dtype(dtype), call_of)
    return jax.ffi.ffi_call(name, jax.ShapeDtypeStruct(shape, dtype))(colony.nutrient, colony.positions, sizes, lengths)


def _nutrient_of(dtype: Any) -> Call:
    from yeastfit.model.compiled.foreign_call import NULL, argument, is_question, result
    from yeastfit.model.compiled.reading import read_nutrient

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        points, room = argument(frame, 2, 2, np.int32)
        half, spacing = argument(frame, 3, 2, dtype)
        nutrient, positions = argument(frame, 0, (points, points), dtype), argument(frame, 1, (room, 2), dtype)
        read_nutrient(nutrient, positions, half, spacing, result(frame, 0, room, dtype))
        return NULL

    return call


def _gradient_of(dtype: Any) -> Call:
    from yeastfit.model.compiled.foreign_call import NULL, argument, is_question, result
    from yeastfit.model.compiled.reading import read_gradient

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        points, room = argument(frame, 2, 2, np.int32)
        half, spacing = argument(frame, 3, 2, dtype)
        nutrient, positions = argument(frame, 0, (points, points), dtype), argument(frame, 1, (room, 2), dtype)
        read_gradient(nutrient, positions, half, spacing, result(frame, 0, (room, 2), dtype))
        return NULL

    return call
