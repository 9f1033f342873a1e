"""Contact of nodes as an operation that numba has compiled, for colonies of many nodes on a CPU.

The same sum as that of `contact`, in another order, so that its last bits differ. It has no derivative.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.operations import Call, operation
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
    name = operation("contact", np.dtype(dtype), _call_of)
    return jax.ffi.ffi_call(name, shape)(colony.positions, colony.weights, sizes, widths)


def _call_of(dtype: Any) -> Call:
    from yeastfit.model.compiled.foreign_call import NULL, argument, is_question, result
    from yeastfit.model.compiled.pushes import push_apart

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        room, count = argument(frame, 2, 2, np.int32)
        reach, ramp, side = argument(frame, 3, 3, dtype)
        positions, weights = argument(frame, 0, (room, 2), dtype), argument(frame, 1, room, dtype)
        push_apart(positions, weights, count, reach, ramp, side, result(frame, 0, (room, 2), dtype))
        return NULL

    return call
