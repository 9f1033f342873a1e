"""The nutrient and its gradient at the nodes as operations that numba has compiled, for large colonies on a CPU.

The same numbers as those of `interpolation`, to the last bits, and 0 in slots without a node. They have no derivative.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.operations import operation
from yeastfit.model.numerics import Numerics


def compiled_nutrient_at(colony: Colony, numerics: Numerics) -> Float[Array, " node"]:
    """`nutrient_at` of one colony."""
    return _read("nutrient", colony, numerics, colony.parents.shape)


def compiled_gradient_at(colony: Colony, numerics: Numerics) -> Float[Array, "node 2"]:
    """`gradient_at` of one colony."""
    return _read("gradient", colony, numerics, colony.positions.shape)


def _read(kind: str, colony: Colony, numerics: Numerics, shape: tuple[int, ...]) -> Array:
    dtype = colony.positions.dtype
    sizes = jnp.stack([jnp.asarray(n, jnp.int32) for n in (numerics.points, colony.parents.shape[0], colony.count)])
    lengths = jnp.asarray([0.5 * numerics.domain, numerics.spacing], dtype)
    name = operation(kind, np.dtype(dtype))
    return jax.ffi.ffi_call(name, jax.ShapeDtypeStruct(shape, dtype))(colony.nutrient, colony.positions, sizes, lengths)
