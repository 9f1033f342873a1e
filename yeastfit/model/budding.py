"""Who buds, when and where (source 2.12, 2.13; MODEL.md sections 3.5, 3.6 and 5)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from yeastfit.model.colony import Colony
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import Relaxation


class Budding(eqx.Module):
    """In which direction a parent buds: φ of the child's lineage, uniform on [0, 2π), plus the parent's `turns`.

    turns: radians, for the child that the node of each slot has at each event; none by default.
    """

    turns: Float[Array, "event node"] | None = None

    def angles(self, lineages: Array, parents: Int[Array, " node"], event: Int[Array, ""]) -> Float[Array, " node"]:
        """φ of the children of these parents."""
        angles = budding_angles(lineages)
        if self.turns is None:
            return angles
        return angles + self.turns.at[event - 1].get(mode="fill", fill_value=0.0)[parents]


RANDOM = Budding()


def growth_rate(fed: Float[Array, " node"], weights: Float[Array, " node"]) -> Float[Array, ""]:
    """μ = Σ w_i c(x_i) / Σ w_i (source 2.13)."""
    return jnp.sum(weights * fed) / jnp.sum(weights)


def births(mu: Float[Array, ""], total: Float[Array, ""], relaxation: Relaxation) -> Float[Array, ""]:
    """How many buds one event makes of W nodes: ⌈(e^μ − 1) W⌉, at most W; fractional, (e^μ − 1) W + ½, at most W."""
    grown = jnp.expm1(mu) * total
    return jnp.minimum(jnp.ceil(grown) if relaxation.births == "whole" else grown + 0.5, total)


def bud(
    colony: Colony,
    mu: Float[Array, ""],
    fed: Float[Array, " node"],
    relaxation: Relaxation,
    numerics: Numerics,
    budding: Budding = RANDOM,
) -> Colony:
    """One mitosis event: the best fed nodes get a child each, at δ(cos φ, sin φ) from them.

    A parent of weight w_i behind better fed parents of total weight S_i has a child of weight clip(B − S_i, 0, w_i);
    with whole births all of these are 0 or 1. φ is the rule's (`Budding`). Continuous in λ but for the order of
    parents. What does not fit into `capacity` is not born, and `problems.capacity_reached` says so.
    """
    capacity = colony.parents.shape[0]
    rank = jnp.argsort(jnp.where(colony.alive, -jax.lax.stop_gradient(fed), jnp.inf))
    ranked = colony.weights[rank]
    wanted = births(mu, jnp.sum(colony.weights), relaxation)
    child_weights = jnp.clip(wanted - (jnp.cumsum(ranked) - ranked), 0.0, ranked)
    wanted_count = jnp.sum(child_weights > 0)
    order = jnp.cumsum(child_weights > 0) - 1
    room = capacity - colony.count

    event = colony.step // numerics.steps_per_event
    lineages = jax.vmap(lambda data: _child_lineage(data, event))(colony.lineages[rank])
    angles = budding.angles(lineages, rank, event).astype(fed.dtype)
    offsets = numerics.bud_distance * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)

    # children take the next slots in the order of their parents; the unborn slot `capacity`, which scatter drops
    slot = jnp.where((child_weights > 0) & (order < room), colony.count + order, capacity)
    problems = colony.problems
    full = problems.capacity_reached | (wanted_count > room)
    return Colony(
        positions=colony.positions.at[slot].set(colony.positions[rank] + offsets, mode="drop"),
        parents=colony.parents.at[slot].set(rank.astype(colony.parents.dtype), mode="drop"),
        weights=colony.weights.at[slot].set(child_weights, mode="drop"),
        lineages=colony.lineages.at[slot].set(lineages, mode="drop"),
        count=colony.count + jnp.minimum(wanted_count, room).astype(colony.count.dtype),
        nutrient=colony.nutrient,
        step=colony.step,
        problems=type(problems)(full, problems.left_domain, problems.unstable, problems.not_finite),
    )


def budding_angles(lineages: Array) -> Float[Array, " node"]:
    """φ of each lineage, uniform on [0, 2π)."""
    return jax.vmap(lambda data: jax.random.uniform(jax.random.wrap_key_data(data), maxval=2 * jnp.pi))(lineages)


def _child_lineage(parent: Array, event: Array) -> Array:
    return jax.random.key_data(jax.random.fold_in(jax.random.wrap_key_data(parent), event))
