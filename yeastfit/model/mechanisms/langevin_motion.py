"""Langevin noise of nodes (source 5.1.1).

    dx_i = v_i dt + √(2 D_n) dW_i,    D_n = `node_noise`,

one Euler–Maruyama step, of weak order 1 in Δt. A free node's mean square displacement is 4 D_n t; the length ρ of a
single cell has the stationary density ∝ ρ exp(−λ2 (ρ − 1)² / (2 D_n)).
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.mechanisms.lineage_draws import keys_of
from yeastfit.model.rules import Context, MotionRule
from yeastfit.parameter_set import Parameter

NODE_NOISE = Parameter("node_noise", "D_n", "diffusivity of nodes, over μ* L0²", (1e-4, 0.1), 0.0)


class LangevinMotion(MotionRule):
    """Nodes diffuse besides. Differentiable in D_n, the draws of each lineage and step being the same."""

    name: ClassVar[str] = "langevin"
    parameters: ClassVar[tuple[Parameter, ...]] = (NODE_NOISE,)

    def moved(self, context: Context, velocity: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """x_i + Δt v_i + √(2 D_n Δt) ξ, ξ standard normal."""
        colony, dt = context.colony, context.numerics.dt
        keys = keys_of(colony.lineages, "motion", colony.step)
        draws = jax.vmap(lambda key: jax.random.normal(key, (2,), colony.positions.dtype))(keys)
        strength = context.parameters["node_noise"]
        some = strength > 0  # the root has no derivative at 0
        size = jnp.where(some, jnp.sqrt(2.0 * dt * jnp.where(some, strength, 1.0)), 0.0)
        return colony.positions + dt * velocity + jnp.where(colony.alive[:, None], size * draws, 0.0)
