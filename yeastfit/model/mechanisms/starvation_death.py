"""Death by starvation (source 5.1.3).

    hazard h_i = `death_rate` · max(1 − c(x_i) / `starvation`, 0),    a step is survived with probability e^(−h_i Δt)

The dead either stay where they are, without uptake and buds and still in the way, or vanish with their springs and
cells; then the nodes behind them take their slots, and what they were joined to is on its own.

In the relaxed model a share φ of a node is alive, which decays by the same factor, and with it what it buds, pulls and
pushes. In the union of cells a weight w stands for f − s log w, which takes little from a cell until w is next to
nothing. So a cell enters with e^(−(1 − φ) / s), as f + 1 − φ: it covers φ of its area, {r² ≤ φ}. It eats with √φ in
place of φ, of which max(−f, 0) sums to φ of what it was. What has vanished but for `GONE` frees its slot.
"""

import dataclasses
from typing import ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from yeastfit.errors import InputError
from yeastfit.model.cells import Cells, weights_of_cells
from yeastfit.model.colony import Colony
from yeastfit.model.mechanisms.lineage_draws import keys_of
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context, DeathRule
from yeastfit.parameter_set import Parameter
from yeastfit.text import quoted

DEATH_RATE = Parameter("death_rate", "h", "rate at which a node without any nutrient dies, over μ*", (0.01, 10.0), 0.0)
GONE = 1e-6
STARVATION = Parameter(
    "starvation", "c_d", "nutrient below which nodes die, of that far away", (0.01, 1.0), 0.1, positive=True
)


class StarvationDeath(DeathRule):
    """Nodes with little nutrient die; `death_rate` 0 is the source.

    Differentiable in both parameters in the relaxed model, where weights decay; the hard one draws who dies.

    Attributes:
        dead: Whether dead cells "stay" in the way of others or "vanish".

    Raises:
        InputError: `dead` is neither of the two.
    """

    name: ClassVar[str] = "starvation"
    parameters: ClassVar[tuple[Parameter, ...]] = (DEATH_RATE, STARVATION)
    dead: Literal["stay", "vanish"] = eqx.field(static=True, default="stay")

    def __check_init__(self) -> None:
        if self.dead not in ("stay", "vanish"):
            raise InputError(f"death: dead is {quoted(self.dead)}, it must be 'stay' or 'vanish'")

    def node_state(self) -> dict[str, float]:
        """φ, under a name that tells whether the dead are still there."""
        return {self._share: 1.0}

    @property
    def _share(self) -> str:
        return "vitality" if self.dead == "stay" else "remaining"

    def living(self, colony: Colony) -> Float[Array, " node"]:
        """Weights without what has died."""
        return colony.weights * colony.node_state["vitality"] if self.dead == "stay" else colony.weights

    def eating(self, colony: Colony, relaxation: Relaxation) -> Float[Array, " node"]:
        """Weights by which a node eats φ of what it would."""
        share = colony.node_state[self._share]
        whole = colony.weights if self.dead == "stay" else colony.weights / jnp.maximum(share, GONE)
        return jnp.where(share > 0, whole, 0.0) * _faded(jnp.sqrt(jnp.maximum(share, GONE)), relaxation)

    def shown(self, cells: Cells, colony: Colony, relaxation: Relaxation) -> Cells:
        """Cells of which φ is left, where the dead vanish."""
        if self.dead == "stay":
            return cells
        share = colony.node_state["remaining"]
        weights = colony.weights / jnp.maximum(share, GONE) * _faded(share, relaxation)
        return dataclasses.replace(cells, weights=weights_of_cells(weights, colony.parents))

    def deaths(self, context: Context) -> Colony:
        """The colony without those that die in this step, or with them as obstacles."""
        colony, surviving = context.colony, self._surviving(context)
        share = colony.node_state[self._share] * surviving
        colony = dataclasses.replace(colony, node_state={**colony.node_state, self._share: share})
        if self.dead == "stay":
            return colony
        colony = dataclasses.replace(colony, weights=colony.weights * surviving)
        gone = colony.alive & (share < GONE)
        return jax.lax.cond(jnp.any(gone), lambda: without(colony, gone), lambda: colony)

    def _surviving(self, context: Context) -> Float[Array, " node"]:
        """Share of each node that outlives this step: 0 or 1 where births are whole."""
        parameters, colony = context.parameters, context.colony
        lack = jnp.maximum(1.0 - context.local_nutrient / parameters["starvation"], 0.0)
        chance = jnp.exp(-parameters["death_rate"] * lack * context.numerics.dt)
        if context.relaxation.births == "fractional":
            return chance
        keys = keys_of(colony.lineages, "death", colony.step)
        drawn = jax.vmap(lambda key: jax.random.uniform(key, dtype=chance.dtype))(keys)
        return (drawn < chance).astype(chance.dtype)


def _faded(share: Float[Array, " node"], relaxation: Relaxation) -> Float[Array, " node"]:
    """e^(−(1 − share) / s): the factor of a weight by which a cell enters the union as f + 1 − share."""
    return share if relaxation.union is None else jnp.exp((share - 1.0) / relaxation.union)


def without(colony: Colony, gone: Bool[Array, " node"]) -> Colony:
    """The colony without some nodes: the others move up in order, those that lose their parent are on their own."""
    kept = colony.alive & ~gone
    order = jnp.argsort(~kept, stable=True)
    place = jnp.zeros_like(colony.parents).at[order].set(jnp.arange(order.shape[0], dtype=colony.parents.dtype))
    parents = jnp.where((colony.parents >= 0) & kept[colony.parents], place[colony.parents], -1)
    count = jnp.sum(kept).astype(colony.count.dtype)
    used = jnp.arange(order.shape[0]) < count
    return dataclasses.replace(
        colony,
        positions=jnp.where(used[:, None], colony.positions[order], 0.0),
        parents=jnp.where(used, parents[order], -1),
        weights=jnp.where(used, colony.weights[order], 0.0),
        lineages=jnp.where(used[:, None], colony.lineages[order], 0).astype(colony.lineages.dtype),
        count=count,
        node_state={name: values[order] for name, values in colony.node_state.items()},
    )
