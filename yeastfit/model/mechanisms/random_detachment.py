"""Cells that let go of their mothers (source 5.2: "multiple separate budding networks form").

    a cell detaches in a step with probability 1 − e^(−k Δt),    k = `detachment_rate`

The end at which it hung on its mother becomes a node of its own, δ from the mother's in a random direction, joined to
the other end alone, so that a new network begins as one cell, as the first did. Cells are conserved, nodes grow by one
a detachment; after a time t with n cells there are 1 + Poisson(k n t) networks. Nutrient is shared, and nodes of
different networks push each other as those of one do.
"""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from yeastfit.model.colony import Colony
from yeastfit.model.laws.budding import uniform_angles
from yeastfit.model.mechanisms.lineage_draws import keys_of
from yeastfit.model.rules import Context, DetachmentRule
from yeastfit.parameter_set import Parameter

DETACHMENT_RATE = Parameter(
    "detachment_rate", "k", "rate at which a cell lets go of its mother, over μ*", (1e-3, 1.0), 0.0
)


class RandomDetachment(DetachmentRule):
    """Every cell with the same hazard; `detachment_rate` 0 is the source.

    Detachments jump in time as the rate changes, so a colony's derivative lacks their share: use the regression of
    `sensitivity` for it.
    """

    name: ClassVar[str] = "random"
    parameters: ClassVar[tuple[Parameter, ...]] = (DETACHMENT_RATE,)

    def detached(self, context: Context, newborn: Mapping[str, float | Array]) -> Colony:
        """The colony with the cells of this step's draws on their own."""
        colony, dtype = context.colony, context.colony.positions.dtype
        hanging = colony.alive & (colony.parents >= 0)
        draws = jax.vmap(lambda key: jax.random.uniform(key, dtype=dtype))(
            keys_of(colony.lineages, "detachment", colony.step)
        )
        chance = jnp.exp(-context.parameters["detachment_rate"] * context.numerics.dt)
        loose = jax.lax.stop_gradient(hanging & (draws >= chance))
        delta = context.numerics.bud_distance
        return jax.lax.cond(jnp.any(loose), lambda: split(colony, loose, delta, newborn), lambda: colony)


def split(colony: Colony, loose: Bool[Array, " node"], delta: float, newborn: Mapping[str, float | Array]) -> Colony:
    """The colony in which the cells of some nodes no longer hang on their mothers.

    A new node takes the next slot, and the cell with it: its parent is the end that was the cell's child. What does not
    fit into `capacity` stays where it is, and `problems.capacity_reached` says so.
    """
    capacity = colony.parents.shape[0]
    order = jnp.cumsum(loose) - 1
    room = capacity - colony.count
    free = loose & (order < room)
    slot = jnp.where(free, colony.count + order, capacity)  # scatter drops slot `capacity`
    mother = jnp.maximum(colony.parents, 0)
    lineages = jax.vmap(jax.random.key_data)(keys_of(colony.lineages, "new end", colony.step))
    angles = uniform_angles(lineages).astype(colony.positions.dtype)
    ends = colony.positions[mother] + delta * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    lighter = jnp.minimum(colony.weights, colony.weights[mother])
    full = colony.problems.capacity_reached | jnp.any(loose & ~free)
    return dataclasses.replace(
        colony,
        positions=colony.positions.at[slot].set(ends, mode="drop"),
        parents=jnp.where(free, -1, colony.parents)
        .at[slot]
        .set(jnp.arange(capacity, dtype=colony.parents.dtype), mode="drop"),
        weights=colony.weights.at[slot].set(lighter, mode="drop"),
        lineages=colony.lineages.at[slot].set(lineages, mode="drop"),
        count=colony.count + jnp.sum(free).astype(colony.count.dtype),
        problems=eqx.tree_at(lambda problems: problems.capacity_reached, colony.problems, full),
        node_state={
            name: values.at[slot].set(newborn[name], mode="drop") for name, values in colony.node_state.items()
        },
    )
