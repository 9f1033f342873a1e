"""Springs of the tree as an operation that numba has compiled, for colonies of many nodes on a CPU.

The same sum as that of `forces.springs`. It has no derivative.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.operations import Call, operation
from yeastfit.model.laws.forces import TreeSprings


class CompiledTreeSprings(TreeSprings):
    """The same rule, summed by a function that numba has compiled."""

    def pull(self, colony: Colony) -> Float[Array, "node 2"]:
        """Along the edges of the tree. Not differentiable."""
        return compiled_springs(colony)


def compiled_springs(colony: Colony) -> Float[Array, "node 2"]:
    """`springs` of one colony."""
    positions, parents = colony.positions, colony.parents.astype(jnp.int32)
    sizes = jnp.stack([jnp.asarray(parents.shape[0]), colony.count]).astype(jnp.int32)
    name = operation("springs", np.dtype(positions.dtype), _call_of)
    shape = jax.ShapeDtypeStruct(positions.shape, positions.dtype)
    return jax.ffi.ffi_call(name, shape)(positions, parents, colony.weights, sizes)


def _call_of(dtype: Any) -> Call:
    from yeastfit.model.compiled.foreign_call import NULL, argument, is_question, result
    from yeastfit.model.compiled.pulls import pull_together

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        room, count = argument(frame, 3, 2, np.int32)
        positions, parents = argument(frame, 0, (room, 2), dtype), argument(frame, 1, room, np.int32)
        pull_together(positions, parents, argument(frame, 2, room, dtype), count, result(frame, 0, (room, 2), dtype))
        return NULL

    return call
