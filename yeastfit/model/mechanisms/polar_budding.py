"""Budding at the free pole of the parent's own cell (source 5.1.1, where the uniform angle is called unsatisfying).

    φ ~ q von Mises(arg(x_p − x_o), κ) + (1 − q) uniform

x_p is the parent's place and x_o that of its own parent, the older node of its cell. q is `polarity` and κ
`budding_bias`. A node without an older one, such as the first, buds uniformly.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt32

from yeastfit.model.laws.budding import uniform_angles
from yeastfit.model.mechanisms.gradient_budding import BUDDING_BIAS, direction_of, towards
from yeastfit.model.rules import BuddingRule, Context
from yeastfit.parameter_set import Parameter

POLARITY = Parameter("polarity", "q", "share of buds at the free pole of the parent", (0.05, 1.0), 0.0, largest=1.0)


class PolarBudding(BuddingRule):
    """A share q of buds about the axis of the parent's cell, away from its older node; q = 0 is the source.

    Differentiable in q, κ and positions: a draw is the source's uniform angle, moved by inversion of the mixture.
    """

    name: ClassVar[str] = "polar"
    parameters: ClassVar[tuple[Parameter, ...]] = (POLARITY, BUDDING_BIAS)

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        """Angles of the source's rule, drawn to the parents' axes."""
        colony, parameters = context.colony, context.parameters
        older = colony.parents[parents]
        along = colony.positions[parents] - colony.positions[jnp.maximum(older, 0)]
        axis, has_one = direction_of(jnp.where((older >= 0)[:, None], along, 0.0))
        drawn = uniform_angles(lineages).astype(axis.dtype)
        moved = towards(drawn, axis, parameters["budding_bias"], parameters["polarity"])
        return jnp.where(has_one, moved, drawn)
