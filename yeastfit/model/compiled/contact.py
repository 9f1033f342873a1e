"""Contact of nodes as an operation that numba has compiled, for colonies of many nodes on a CPU.

The same sum as that of `contact`, in another order, so that its last bits differ. It has no derivative.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.operations import operation
from yeastfit.model.laws.contact import SMALLEST, NodeContact
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context

WIDER = 1.001  # of the bins than the contact: rounding moves no node that touches another two bins away


class CompiledNodeContact(NodeContact):
    """The same rule, summed by a function that numba has compiled."""

    def velocity(self, context: Context, motion: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """The sum over all pairs. Not differentiable."""
        parameters = context.parameters
        push = compiled_contact(context.colony, parameters.repulsion_radius, context.relaxation)
        return parameters.repulsivity * push


def compiled_contact(colony: Colony, radius: Float[Array, ""], relaxation: Relaxation) -> Float[Array, "node 2"]:
    """`contact` of one colony."""
    dtype = colony.positions.dtype
    reach = relaxation.contact_reach(radius)
    ramp = jnp.zeros_like(reach) if relaxation.contact is None else relaxation.contact
    lengths = reach, ramp, WIDER * jnp.maximum(reach, SMALLEST)
    widths = jnp.stack([jnp.asarray(length, dtype) for length in lengths])
    sizes = jnp.stack([jnp.asarray(colony.parents.shape[0]), colony.count]).astype(jnp.int32)
    shape = jax.ShapeDtypeStruct(colony.positions.shape, dtype)
    name = operation("contact", np.dtype(dtype))
    return jax.ffi.ffi_call(name, shape)(colony.positions, colony.weights, sizes, widths)
