"""Collocated nodes: a store of V = 2^k nodes in one place, released group by group (source A.1).

Nodes n = 0 … V − 1 begin as two groups of V/2, each in one place. A division halves the group [a, a + s): the nodes
from a + s/2 on move away by δ and each of them is joined to the one s/2 before it by a spring. Nodes in one place are
held together and exert no force on each other. The source's matrices are

    C_nm = 1 where n and m are in one group,    A_nm = 1 where n XOR m is a power of two and C_nm = 0,    B = 1 − A:

two nodes that differ in one bit were partners in the division that parted them. A group moves as the mean of its nodes,

    dx_a/dt = λ2 (1/s) Σ_{n in group} Σ_m A_nm (1 − r_nm) e_nm + …

Groups are kept as labels, the first node of each and its size; the forces take V k operations and no matrix. A group of
one node has nothing left to release: it does not bud, and the run says so. Cells are drawn between a group and the one
that it was halved from, and nodes in one place count once in contact.
"""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Shaped

from yeastfit.errors import InputError
from yeastfit.model.colony import Colony
from yeastfit.model.laws.growth import number_of_births
from yeastfit.model.rules import BirthRule, Births, Context, Rule, SpringRule
from yeastfit.text import quoted

MOST = 1 << 22  # nodes: every step takes operations for each of them


class CollocatedBirths(BirthRule):
    """As many nodes as by the rule global, the best fed first, each of which halves its group.

    Continuous in λ but for the order of parents, and for groups that can no longer be halved.

    Attributes:
        nodes: V, how many nodes a colony can grow to, a power of two, at least 2.

    Raises:
        InputError: `nodes` is no power of two, or too large.
    """

    name: ClassVar[str] = "collocated"
    from_start: ClassVar[bool] = True
    nodes: int = eqx.field(static=True, default=512)

    def __check_init__(self) -> None:
        if not 2 <= self.nodes <= MOST or self.nodes & (self.nodes - 1):
            raise InputError(
                f"births: nodes is {quoted(self.nodes)}, it must be a power of two up to {MOST}, such as 512"
            )

    def objection(self, rules: Mapping[str, Rule]) -> str | None:
        """Groups are halved and never lost, and springs are those of A."""
        for question, only in (("springs", "collocated"), ("death", "none"), ("detachment", "none")):
            if rules[question].name != only:
                return f"goes with {question} {only!r} only, not with {question} {rules[question].name!r}"
        return None

    def node_state(self) -> dict[str, float]:
        """The size of a node's group and its first node; −1 until the first step knows the two founders apart."""
        return {"group_size": self.nodes / 2, "group_first": -1.0}

    def due(self, context: Context) -> Bool[Array, ""]:
        """Every Δn steps."""
        return context.colony.step % context.numerics.steps_per_event == 0

    def births(self, context: Context) -> Births:
        """The best fed groups; those of one node are refused."""
        colony = context.colony
        size, first = colony.node_state["group_size"], first_nodes(colony, self.nodes)
        fed = jax.lax.stop_gradient(context.local_nutrient)
        rank = jnp.argsort(jnp.where(colony.alive, -fed, jnp.inf))
        ranked = context.living[rank]
        wanted = number_of_births(context.growth_rate, jnp.sum(context.living), context.relaxation)
        weights = jnp.clip(wanted - (jnp.cumsum(ranked) - ranked), 0.0, ranked)
        able = size[rank] >= 2
        weights, refused = jnp.where(able, weights, 0.0), jnp.any(~able & (weights > 0))
        room = colony.parents.shape[0] - colony.count
        placed = (weights > 0) & (jnp.cumsum(weights > 0) <= room)  # a group without a slot stays whole
        parted = jnp.zeros_like(size, bool).at[rank].set(placed)
        half = jnp.where(parted, 0.5 * size, size)
        return Births(
            parents=rank,
            weights=weights,
            event=colony.step // context.numerics.steps_per_event,
            node_state={"group_size": half, "group_first": first},
            newborn={"group_size": half[rank], "group_first": (first + half)[rank]},
            refused=refused,
        )


class CollocatedSprings(SpringRule):
    """Springs between partners of divisions, the matrix A. Differentiable.

    Attributes:
        nodes: V, the same number as that of the births.
    """

    name: ClassVar[str] = "collocated"
    nodes: int = eqx.field(static=True, default=512)

    def objection(self, rules: Mapping[str, Rule]) -> str | None:
        """There must be groups, of as many nodes."""
        births = rules["births"]
        if not isinstance(births, CollocatedBirths):
            return f"goes with births 'collocated' only, not with births {births.name!r}"
        differs = f"has nodes {self.nodes} and births {births.name!r} has {births.nodes}: give both the same"
        return None if births.nodes == self.nodes else differs

    def pull(self, colony: Colony) -> Float[Array, "node 2"]:
        """The mean over a group's nodes of the forces of all springs."""
        size, nodes = colony.node_state["group_size"], self.nodes
        slot = slots_of_nodes(colony, nodes)
        x, y, weights = (of_all[slot] for of_all in (*jnp.unstack(colony.positions, axis=-1), colony.weights))
        slot, x, y, weights = jax.lax.optimization_barrier((slot, x, y, weights))  # else XLA gathers anew for each bit
        pull_x, pull_y = jnp.zeros_like(x), jnp.zeros_like(y)
        for bit in range(nodes.bit_length() - 1):
            (one, other), (x_0, x_1), (y_0, y_1), (w_0, w_1) = (partners(all_, bit) for all_ in (slot, x, y, weights))
            dx, dy = x_0 - x_1, y_0 - y_1
            squared = dx**2 + dy**2
            joined = (one != other) & (squared > 0)
            length = jnp.sqrt(jnp.where(joined, squared, 1.0))
            push = jnp.where(joined, (1.0 - length) / length, 0.0)
            pull_x += jnp.stack([w_1 * push * dx, -w_0 * push * dx], axis=1).ravel()
            pull_y += jnp.stack([w_1 * push * dy, -w_0 * push * dy], axis=1).ravel()
        return jnp.stack([jnp.zeros_like(size).at[slot].add(pull) / size for pull in (pull_x, pull_y)], axis=-1)

    def stiffness(self, colony: Colony) -> Float[Array, ""]:
        """Twice the most springs of any node, which bounds the largest eigenvalue (Gershgorin)."""
        springs = jnp.log2(float(self.nodes)) - jnp.log2(colony.node_state["group_size"])
        return 2.0 * jnp.max(jnp.where(colony.alive, springs, 0.0))


def first_nodes(colony: Colony, nodes: int) -> Float[Array, " node"]:
    """The first node of each slot's group; before the first division 0 and V/2."""
    first = colony.node_state["group_first"]
    founders = jnp.where(jnp.arange(first.shape[0]) == 1, nodes / 2, 0.0)
    return jnp.where(first < 0, founders, first)


def slots_of_nodes(colony: Colony, nodes: int) -> Int[Array, " vertex"]:
    """The slot that holds each of the V nodes."""
    first = jnp.where(colony.alive, first_nodes(colony, nodes), float(nodes))
    begins = jnp.zeros(nodes, int).at[first.astype(int)].add(1, mode="drop")
    return jnp.argsort(first)[jnp.cumsum(begins) - 1]


def partners(of_nodes: Shaped[Array, " vertex"], bit: int) -> tuple[Shaped[Array, "a b"], Shaped[Array, "a b"]]:
    """What the nodes have whose numbers lack a bit, and their partners, whose numbers have it and are else the same."""
    lacking, having = jnp.unstack(of_nodes.reshape(-1, 2, 1 << bit), axis=1)
    return lacking, having
