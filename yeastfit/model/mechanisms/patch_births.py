"""Births by local growth: the source's rule in each square patch of a coarse grid (source 5.1.2).

Every Δn steps the nodes in patch P, of mean nutrient μ_P and number W_P, have a quota Q_P of buds,

    Q_P = min(e^(μ_P) − 1, 1) W_P,    in all B = ⌈Σ_P Q_P⌉    or, fractional,    B = min(Σ_P Q_P + ½, W)

apportioned by largest remainders, the best fed nodes of a patch first. Fractional, a patch has Q_P and of the rest its
share by W_P − Q_P. Patches have side `patch`; one of them is centred on the origin, so that a large one is the source's
rule. Nodes with less nutrient than `least_nutrient` take no part.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import BirthRule, Births, Context
from yeastfit.parameter_set import Parameter

PATCH = Parameter(
    "patch", "ℓ", "side of the patches in which births are counted", (1.0, 40.0), 4.0, "L0", positive=True
)
LEAST_NUTRIENT = Parameter(
    "least_nutrient", "c_b", "nutrient below which no node buds, of that far away", (0.01, 1.0), 0.0, largest=1.0
)


class PatchBirths(BirthRule):
    """All nodes at once, as many in each patch as its own mean nutrient allows.

    Differentiable in what μ depends on; not in `patch` and `least_nutrient`, which choose among nodes.
    """

    name: ClassVar[str] = "patches"
    parameters: ClassVar[tuple[Parameter, ...]] = (PATCH, LEAST_NUTRIENT)

    def due(self, context: Context) -> Bool[Array, ""]:
        """Every Δn steps."""
        return context.colony.step % context.numerics.steps_per_event == 0

    def births(self, context: Context) -> Births:
        """The best fed nodes of each patch, those of all patches in order of nutrient."""
        colony, parameters = context.colony, context.parameters
        fed = jax.lax.stop_gradient(context.local_nutrient)
        fit = colony.alive & (fed >= parameters["least_nutrient"])
        order, patch, start = _by_patch(colony.positions, parameters["patch"], fit, fed)

        def per_patch(values: Float[Array, " node"]) -> Float[Array, " node"]:
            return jax.ops.segment_sum(values, patch, num_segments=patch.shape[0])

        ranked = jnp.where(fit, context.living, 0.0)[order]
        total = per_patch(ranked)
        mu = per_patch(ranked * context.local_nutrient[order]) / jnp.where(total > 0, total, 1.0)
        wanted = apportioned(jnp.minimum(jnp.expm1(mu) * total, total), total, context.relaxation)
        before = jnp.cumsum(ranked) - ranked
        children = jnp.clip(wanted[patch] - (before - before[start]), 0.0, ranked)
        best_first = jnp.argsort(jnp.where(colony.alive, -fed, jnp.inf))
        weights = jnp.zeros_like(children).at[order].set(children)[best_first]
        return Births(best_first, weights, colony.step // context.numerics.steps_per_event)


def apportioned(
    quotas: Float[Array, " patch"], totals: Float[Array, " patch"], relaxation: Relaxation
) -> Float[Array, " patch"]:
    """Buds of each patch, of its quota and the nodes it has: by largest remainders, or what is left over by room."""
    if relaxation.births == "whole":
        whole = jnp.floor(quotas)
        left = jnp.ceil(jnp.sum(quotas)) - jnp.sum(whole)
        by_remainder = jnp.argsort(whole - quotas)  # the largest first; equal ones in order of patches
        return whole.at[by_remainder].add(jnp.where(jnp.arange(quotas.shape[0]) < left, 1.0, 0.0))
    room = totals - quotas
    all_room = jnp.sum(room)
    return quotas + jnp.minimum(0.5, all_room) * room / jnp.where(all_room > 0, all_room, 1.0)


def _by_patch(
    positions: Float[Array, "node 2"], side: Float[Array, ""], fit: Bool[Array, " node"], fed: Float[Array, " node"]
) -> tuple[Int[Array, " node"], Int[Array, " node"], Int[Array, " node"]]:
    """Nodes patch by patch, the best fed first; of each in this order its patch and where its patch begins."""
    square = jnp.floor(jax.lax.stop_gradient(positions / side) + 0.5)
    # nodes that take no part come last, in a patch of their own
    x, y = jnp.where(fit, square.T, jnp.inf)
    order = jnp.lexsort((-fed, y, x))
    x, y = x[order], y[order]
    begins = jnp.concatenate([jnp.array([True]), (x[1:] != x[:-1]) | (y[1:] != y[:-1])])
    places = jnp.arange(begins.shape[0])
    return order, jnp.cumsum(begins) - 1, jax.lax.cummax(jnp.where(begins, places, 0))
