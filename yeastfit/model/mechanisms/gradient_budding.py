"""Budding along the nutrient's gradient, φ = arg ∇c(x_p), or about it (source 5.1.1).

    gradient    φ = arg ∇c(x_p)
    biased      φ ~ von Mises about arg ∇c(x_p), density ∝ e^(κ cos(φ − arg ∇c)), κ = `budding_bias`

x_p is the parent's place; φ is uniform where ∇c vanishes. A draw is the uniform angle φ0 of the source's rule, moved
towards the gradient by inversion of the distribution: κ = 0 is the source's colony, κ → ∞ that of `gradient`, and φ is
continuous in between and differentiable in κ and in ∇c.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from yeastfit.model.laws.budding import uniform_angles
from yeastfit.model.mechanisms.von_mises import SHARPEST, angle_of
from yeastfit.model.rules import BuddingRule, Context
from yeastfit.parameter_set import Parameter

BUDDING_BIAS = Parameter(
    "budding_bias",
    "κ",
    "concentration of the angles of buds about their preferred direction",
    (0.1, 50.0),
    0.0,
    largest=SHARPEST,
)


class GradientBudding(BuddingRule):
    """Up the gradient of the nutrient, φ = arg ∇c(x_p), and any direction alike where it vanishes.

    Nothing is random but the first cell's angle. Differentiable in ∇c.
    """

    name: ClassVar[str] = "gradient"

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        """The direction in which the nutrient rises."""
        upwards, steep = direction_of(context.local_gradient()[parents])
        return jnp.where(steep, upwards, uniform_angles(lineages).astype(upwards.dtype))


class BiasedBudding(BuddingRule):
    """Mostly up the gradient of the nutrient, φ von Mises about arg ∇c(x_p) of concentration κ.

    Differentiable in κ and ∇c.
    """

    name: ClassVar[str] = "biased"
    parameters: ClassVar[tuple[Parameter, ...]] = (BUDDING_BIAS,)

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        """Angles of the source's rule, drawn to the direction in which the nutrient rises."""
        upwards, steep = direction_of(context.local_gradient()[parents])
        drawn = uniform_angles(lineages).astype(upwards.dtype)
        return jnp.where(steep, towards(drawn, upwards, context.parameters["budding_bias"]), drawn)


def direction_of(vectors: Float[Array, "node 2"]) -> tuple[Float[Array, " node"], Bool[Array, " node"]]:
    """Angle of each vector, and whether it has one; finite derivatives everywhere."""
    steep = jnp.sum(vectors**2, axis=-1) > 0
    x, y = jnp.where(steep[:, None], vectors, jnp.array([1.0, 0.0], vectors.dtype)).T
    return jnp.arctan2(y, x), steep


def towards(
    drawn: Float[Array, " node"],
    axis: Float[Array, " node"],
    concentration: Float[Array, ""],
    share: Float[Array, ""] | float = 1.0,
) -> Float[Array, " node"]:
    """Uniform angles turned into von Mises ones about an axis, of a share q of all; the others stay uniform."""
    uniform = jnp.mod((drawn - axis) / (2 * jnp.pi) + 0.5, 1.0)
    return axis + angle_of(uniform, concentration, share)
