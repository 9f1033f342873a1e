"""The state of a colony: a tree of nodes in a nutrient field (docs/model.md, section 2)."""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, UInt32

from yeastfit.model.numerics import Numerics


class Colony(eqx.Module):
    """One colony, or an ensemble along a first axis, of fixed capacity.

    Cell k is the edge from node k to its parent; node 0 has none, so there is one cell fewer than nodes.

    Attributes:
        positions: Of nodes, in L0.
        parents: Slot of each node's parent; −1 for node 0, and for a node that has lost its parent.
        weights: In [0, 1], fixed at birth unless nodes die; 1 in the hard model.
        lineages: Data of random keys. A founder's is split from the member's key, a child's is its parent's folded with
            the number of the event, so that a draw belongs to a lineage and not to a slot.
        count: Slots in use; those from `count` on are empty (weight 0, position 0, parent −1).
        nutrient: c on the grid, boundary included.
        step: Time steps done.
        problems: What went wrong so far.
        node_state: What rules keep for each node, by name; see `Rule.node_state`.
        medium: What the medium holds besides the nutrient, by name; see `MediumRule`.
    """

    positions: Float[Array, "*member node 2"]
    parents: Int[Array, "*member node"]
    weights: Float[Array, "*member node"]
    lineages: UInt32[Array, "*member node 2"]
    count: Int[Array, "*member"]
    nutrient: Float[Array, "*member x y"]
    step: Int[Array, "*member"]
    problems: "Problems"
    node_state: dict[str, Float[Array, "*member node"]] = eqx.field(default_factory=dict)
    medium: dict[str, Array] = eqx.field(default_factory=dict)

    @property
    def alive(self) -> Bool[Array, "*member node"]:
        """Which slots hold a node."""
        return jnp.arange(self.parents.shape[-1]) < self.count[..., None]


class Problems(eqx.Module):
    """What went wrong so far; each is True from when it happened. A result reports them in the words of `PROBLEMS`."""

    capacity_reached: Bool[Array, "*member"]
    left_domain: Bool[Array, "*member"]
    unstable: Bool[Array, "*member"]
    not_finite: Bool[Array, "*member"]
    died_out: Bool[Array, "*member"]
    store_empty: Bool[Array, "*member"]

    @staticmethod
    def none() -> "Problems":
        """Nothing yet."""
        return Problems(*(jnp.zeros((), bool),) * 6)


def start(
    key: Array,
    numerics: Numerics,
    node_state: Mapping[str, float] | None = None,
    medium: Mapping[str, Array] | None = None,
) -> Colony:
    """Place two nodes at ±½(cos Θ, sin Θ), Θ uniform on [0, 2π), in nutrient c = 1 (source 2.9, 2.11).

    Arguments:
        key: Of the colony; all its random numbers derive from it.
        numerics: Grid and capacity.
        node_state: Initial values of the state of nodes, by name.
        medium: What the medium holds besides the nutrient, by name.

    Returns:
        A colony of one cell.
    """
    capacity, points = int(numerics.room), numerics.points
    angle_key, *roots = jax.random.split(key, 3)
    angle = jax.random.uniform(angle_key, maxval=2 * jnp.pi)
    half = 0.5 * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    empty = jnp.zeros((capacity, 2), angle.dtype)
    return Colony(
        positions=empty.at[0].set(half).at[1].set(-half),
        parents=jnp.full(capacity, -1).at[1].set(0),
        weights=jnp.zeros(capacity, angle.dtype).at[:2].set(1.0),
        lineages=jnp.zeros((capacity, 2), jnp.uint32).at[:2].set(jnp.stack([jax.random.key_data(r) for r in roots])),
        count=jnp.asarray(2),
        nutrient=jnp.ones((points, points), angle.dtype),
        step=jnp.asarray(0),
        problems=Problems.none(),
        node_state={name: jnp.full(capacity, value, angle.dtype) for name, value in (node_state or {}).items()},
        medium=dict(medium or {}),
    )


def widened(colony: Colony, room: int, newborn: Mapping[str, float]) -> Colony:
    """One colony with room for more nodes; the same where it has the room already.

    Arguments:
        colony: As it is.
        room: Slots, those in use included.
        newborn: Initial values of the state of nodes, by name.
    """
    more = room - colony.parents.shape[0]
    if more <= 0:
        return colony

    def longer(values: Array, empty: float) -> Array:
        return lengthened(values, more, empty)

    return dataclasses.replace(
        colony,
        positions=longer(colony.positions, 0.0),
        parents=longer(colony.parents, -1),
        weights=longer(colony.weights, 0.0),
        lineages=longer(colony.lineages, 0),
        node_state={name: longer(values, newborn.get(name, 0.0)) for name, values in colony.node_state.items()},
    )


def lengthened(values: Array, more: int, empty: ArrayLike) -> Array:
    """So many entries more, all of them `empty`; by NumPy, which compiles nothing for each size."""
    found = np.empty((len(values) + more, *values.shape[1:]), values.dtype)
    found[: len(values)], found[len(values) :] = values, empty
    return jnp.asarray(found)


PROBLEMS = {
    "capacity_reached": "births were cut because every node slot was taken: raise capacity or end earlier",
    "left_domain": "a node came within one cell of the domain's edge: raise domain or end earlier",
    "unstable": "Δt · elasticity · (degree + 1) reached 2, where forward Euler oscillates: lower dt, or take substeps",
    "not_finite": "positions or nutrient are not finite: raise domain if a node came to its edge, else lower dt",
    "died_out": "no node was left alive: lower death_rate or starvation, or end earlier",
    "store_empty": "a store ran empty, of walkers or of nodes in one place: give more of them, or end earlier",
}
"""What each field of `Problems` means, and what to do about it."""
