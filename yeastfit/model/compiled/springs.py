"""Springs of the tree as an operation that numba has compiled, for colonies of many nodes on a CPU.

The same sum as that of `forces.springs`. It has no derivative.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.operations import operation
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
    name = operation("springs", np.dtype(positions.dtype))
    shape = jax.ShapeDtypeStruct(positions.shape, positions.dtype)
    return jax.ffi.ffi_call(name, shape)(positions, parents, colony.weights, sizes)
