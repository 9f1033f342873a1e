"""Asynchronous births: every node buds when its own cell cycle is complete (source 5.1.2).

    dψ/dt = c(x_i),    a bud at ψ ≥ Ψ, then ψ ← ψ − Ψ,    Ψ = ln 2 · e^(σ z),    σ² = ln(1 + v²)

Ψ is drawn anew for every cycle, z standard normal: its median is ln 2, its coefficient of variation v is
`cycle_variation`. A newborn starts where its mother starts again, at what is left of the time step, which so delays
nobody. A node with less nutrient than `least_nutrient` waits. In c = 1 a colony grows as e^(rt) with 2 E[e^(−rΨ)] = 1
(Euler and Lotka), so it doubles every ln 2 without variation.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from yeastfit.model.mechanisms.lineage_draws import keys_of
from yeastfit.model.mechanisms.patch_births import LEAST_NUTRIENT
from yeastfit.model.rules import BirthRule, Births, Context
from yeastfit.parameter_set import Parameter

CYCLE_VARIATION = Parameter(
    "cycle_variation", "v", "coefficient of variation of the length of cell cycles", (0.02, 1.0), 0.0, largest=2.0
)


class ClockBirths(BirthRule):
    """Each node at the end of its own cycle, whose speed is the local nutrient.

    Births jump in time as parameters change, so a colony's derivative lacks their share: use the regression of
    `sensitivity` for it.
    """

    name: ClassVar[str] = "clocks"
    parameters: ClassVar[tuple[Parameter, ...]] = (CYCLE_VARIATION, LEAST_NUTRIENT)
    doublings: ClassVar[float] = 1.6  # r / ln 2 is at most 1.44; a few early births may be ahead of it

    def node_state(self) -> dict[str, float]:
        """The phase ψ, and the number of cycles completed."""
        return {"phase": 0.0, "cycles": 0.0}

    def advance(self, context: Context) -> dict[str, Float[Array, " node"]]:
        """Phases move on by c Δt."""
        state = context.colony.node_state
        fed = jnp.where(context.colony.alive, context.local_nutrient, 0.0)
        return {"phase": state["phase"] + context.numerics.dt * fed, "cycles": state["cycles"]}

    def due(self, context: Context) -> Bool[Array, ""]:
        """Whether any node is ripe."""
        return jnp.any(self._ripe(context))

    def births(self, context: Context) -> Births:
        """All ripe nodes, in order of age; what is left of their phases goes to mother and child."""
        colony, ripe = context.colony, self._ripe(context)
        phase, cycles = colony.node_state["phase"], colony.node_state["cycles"]
        within = context.numerics.dt * context.local_nutrient  # of a node that waited no more than a step is left
        rest = jnp.where(ripe, jnp.minimum(phase - self._length(context), within), phase)
        return Births(
            parents=jnp.arange(ripe.shape[0]),
            weights=jnp.where(ripe, context.living, 0.0),
            event=colony.step,
            node_state={"phase": rest, "cycles": cycles + ripe},
            newborn={"phase": rest},
        )

    def _ripe(self, context: Context) -> Bool[Array, " node"]:
        able = (context.living > 0) & (context.local_nutrient >= context.parameters["least_nutrient"])
        return able & (context.colony.node_state["phase"] >= self._length(context))

    def _length(self, context: Context) -> Float[Array, " node"]:
        """Ψ of the present cycle of each node."""
        state = context.colony.node_state
        cycle = jax.lax.stop_gradient(state["cycles"]).astype(int)
        keys = keys_of(context.colony.lineages, "cell cycle", cycle)
        z = jax.vmap(lambda key: jax.random.normal(key, dtype=state["phase"].dtype))(keys)
        return jnp.log(2.0) * jnp.exp(spread_of(context.parameters["cycle_variation"]) * z)


def spread_of(variation: Float[Array, ""]) -> Float[Array, ""]:
    """σ of a log-normal distribution with coefficient of variation v; its derivative at v = 0 is 1."""
    some = variation > 0
    return jnp.where(some, jnp.sqrt(jnp.log1p(jnp.where(some, variation, 1.0) ** 2)), variation)
