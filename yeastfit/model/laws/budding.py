"""Where a child appears: at its parent + δ(cos φ, sin φ) (docs/model.md, section 3.6)."""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt32

from yeastfit.model.colony import Colony
from yeastfit.model.rules import Births, BuddingRule, Context


class UniformBudding(BuddingRule):
    """Any direction alike, φ uniform on [0, 2π), as in the original model."""

    name: ClassVar[str] = "uniform"

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        """φ of each lineage."""
        return uniform_angles(lineages)


class TurnedBudding(BuddingRule):
    """The angles of another rule, turned: for derivatives of a colony in its budding angles.

    Attributes:
        turns: Radians, for the child that the node of each slot has at each event.
        base: The rule that gives the angles.
    """

    name: ClassVar[str] = "turned"
    turns: Float[Array, "event node"] = eqx.field(converter=jnp.asarray)
    base: BuddingRule = UniformBudding()

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        """φ of the rule, plus the parent's turn at this event."""
        event = context.colony.step // context.numerics.steps_per_event
        turns = self.turns.at[event - 1].get(mode="fill", fill_value=0.0)
        return self.base.angles(context, parents, lineages) + turns[parents]


def uniform_angles(lineages: UInt32[Array, "node 2"]) -> Float[Array, " node"]:
    """φ of each lineage, uniform on [0, 2π)."""
    return jax.vmap(lambda data: jax.random.uniform(jax.random.wrap_key_data(data), maxval=2 * jnp.pi))(lineages)


def bud(context: Context, births: Births, budding: BuddingRule, newborn: Mapping[str, float]) -> Colony:
    """The colony with its newborn, which take the next slots in the order of their parents.

    What does not fit into `capacity` is not born, and `problems.capacity_reached` says so.

    Arguments:
        context: The colony before.
        births: Who is born.
        budding: In which direction.
        newborn: Initial values of the state of nodes, by name.
    """
    colony = context.colony
    capacity = colony.parents.shape[0]
    wanted_count = jnp.sum(births.weights > 0)
    order = jnp.cumsum(births.weights > 0) - 1
    room = capacity - colony.count

    lineages = child_lineages(colony.lineages[births.parents], births.event)
    angles = budding.answered(budding.angles(context, births.parents, lineages), births.parents.shape)
    angles = angles.astype(births.weights.dtype)
    offsets = context.numerics.bud_distance * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)

    # the unborn take slot `capacity`, which scatter drops
    slot = jnp.where((births.weights > 0) & (order < room), colony.count + order, capacity)

    def placed(slots: Array, values: Array | float) -> Array:
        return slots.at[slot].set(values, mode="drop")

    state = {**colony.node_state, **births.node_state}
    begin: dict[str, Array | float] = {**newborn, **births.newborn}
    full = colony.problems.capacity_reached | (wanted_count > room)
    problems = eqx.tree_at(lambda p: p.capacity_reached, colony.problems, full)
    if births.refused is not None:
        problems = eqx.tree_at(lambda p: p.store_empty, problems, problems.store_empty | births.refused)
    return dataclasses.replace(
        colony,
        positions=placed(colony.positions, colony.positions[births.parents] + offsets),
        parents=placed(colony.parents, births.parents.astype(colony.parents.dtype)),
        weights=placed(colony.weights, births.weights),
        lineages=placed(colony.lineages, lineages),
        count=colony.count + jnp.minimum(wanted_count, room).astype(colony.count.dtype),
        problems=problems,
        node_state={name: placed(values, begin[name]) for name, values in state.items()},
    )


def child_lineages(parents: UInt32[Array, "node 2"], event: Int[Array, ""]) -> UInt32[Array, "node 2"]:
    """Lineages of the children that these have at an event: the parent's key, folded with the event's number."""

    def child(parent: Array) -> Array:
        return jax.random.key_data(jax.random.fold_in(jax.random.wrap_key_data(parent), event))

    return jax.vmap(child)(parents)
