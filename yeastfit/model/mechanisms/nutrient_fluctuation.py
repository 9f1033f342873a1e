"""Random fluctuations of the nutrient (source 5.1.1, 5.1.2): multiplicative, positive, and 1 in the mean.

    c ← c exp(σ ξ √Δt / h − σ² Δt / (2 h²)),    σ = `nutrient_noise`,

ξ independent standard normal numbers at the grid points; the boundary stays 1. The variance of c averaged over a disc
does not depend on h.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.mechanisms.lineage_draws import keys_of
from yeastfit.model.rules import Context, FluctuationRule
from yeastfit.parameter_set import Parameter

NUTRIENT_NOISE = Parameter(
    "nutrient_noise", "σ", "strength of the nutrient's fluctuations, over L0 √μ*", (1e-3, 0.3), 0.0, largest=3.0
)


class NutrientFluctuation(FluctuationRule):
    """White noise on log c. Differentiable in σ, the draws of each step being the same.

    They belong to the lineage of the oldest node. The whole grid is computed in each step: nowhere is c undisturbed.
    """

    name: ClassVar[str] = "lognormal"
    parameters: ClassVar[tuple[Parameter, ...]] = (NUTRIENT_NOISE,)

    def shaken(self, context: Context) -> Float[Array, "x y"]:
        """The nutrient after the fluctuations of one step."""
        colony, numerics = context.colony, context.numerics
        key = keys_of(colony.lineages[:1], "fluctuation", colony.step)[0]
        drawn = jax.random.normal(key, colony.nutrient.shape, colony.nutrient.dtype)
        at = jnp.arange(numerics.points)
        inside = (at > 0) & (at < numerics.points - 1)
        # all of the grid is multiplied: XLA for CPUs computes numbers that are written into a part of it one by one
        size = context.parameters["nutrient_noise"] * numerics.dt**0.5 / numerics.spacing
        sizes = jnp.where(inside[:, None] & inside, size, 0.0)
        return colony.nutrient * jnp.exp(sizes * drawn - 0.5 * sizes**2)
