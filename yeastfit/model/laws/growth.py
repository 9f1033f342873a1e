"""Who buds, and when (source 2.12, 2.13; docs/model.md, sections 3.6 and 5).

Every Δn = ⌈1/Δt⌉ steps W nodes have

    B = min(⌈(e^μ − 1) W⌉, W)    or, fractional,    B = min((e^μ − 1) W + ½, W)

buds, μ the colony's mean nutrient, the best fed nodes first. A parent of weight w_i behind better fed parents of total
weight S_i has a child of weight clip(B − S_i, 0, w_i); with whole births all of these are 0 or 1.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from yeastfit.model.numerics import largest_in_ensemble
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import BirthRule, Births, Context


class GlobalBirths(BirthRule):
    """All nodes at once, as many as the colony's mean nutrient allows, as in the original model.

    Continuous in λ but for the order of parents.
    """

    name: ClassVar[str] = "global"

    def due(self, context: Context) -> Bool[Array, ""]:
        """Every Δn steps, which all members of an ensemble have done at once."""
        return largest_in_ensemble(context.colony.step) % context.numerics.steps_per_event == 0

    def births(self, context: Context) -> Births:
        """The best fed nodes."""
        colony = context.colony
        fed = jax.lax.stop_gradient(context.local_nutrient)
        rank = self.ranking(jnp.where(colony.alive, -fed, jnp.inf))
        ranked = context.living[rank]
        wanted = number_of_births(context.growth_rate, jnp.sum(context.living), context.relaxation)
        weights = jnp.clip(wanted - (jnp.cumsum(ranked) - ranked), 0.0, ranked)
        return Births(rank, weights, colony.step // context.numerics.steps_per_event)

    def ranking(self, hunger: Float[Array, " node"]) -> Int[Array, " node"]:
        """Slots by how little their nodes have: the least first, equal ones in their order."""
        return jnp.argsort(hunger)


def number_of_births(mu: Float[Array, ""], total: Float[Array, ""], relaxation: Relaxation) -> Float[Array, ""]:
    """B of one event of W nodes."""
    grown = jnp.expm1(mu) * total
    return jnp.minimum(jnp.ceil(grown) if relaxation.births == "whole" else grown + 0.5, total)
