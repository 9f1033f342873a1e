"""One time step, and its repetition (MODEL.md section 3)."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from yeastfit.model import cells as cells_
from yeastfit.model.colony import Colony, Problems, start
from yeastfit.model.forces import nutrient_at, velocity
from yeastfit.model.mitosis import bud, growth_rate
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import nutrient_step
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation


class Snapshot(eqx.Module):
    """What statistics of step n are taken from: the step's cells and μ, and the colony after its motion."""

    cells: cells_.Cells
    growth_rate: Float[Array, ""]
    colony: Colony
    parameters: Parameters
    relaxation: Relaxation


Observe = Callable[[Snapshot], PyTree]


def step(colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics) -> tuple[Colony, Snapshot]:
    """Cells, their union, biomass, nutrient, growth rate, mitosis, motion - in this order."""
    cells = cells_.cells_of(colony, parameters.aspect_ratio)
    g = cells_.level_set(cells, relaxation, -0.5 * numerics.domain, numerics.spacing, numerics.points)
    eaten = cells_.biomass(g, parameters.metabolic_rate)
    nutrient = nutrient_step(colony.nutrient, eaten, parameters.diffusivity, numerics)
    n = colony.step + 1
    colony = eqx.tree_at(lambda c: (c.nutrient, c.step), colony, (nutrient, n))
    fed = nutrient_at(colony, numerics)
    mu = growth_rate(fed, colony.weights)
    colony = jax.lax.cond(
        n % numerics.steps_per_event == 0, lambda c: bud(c, mu, fed, relaxation, numerics), lambda c: c, colony
    )
    positions = colony.positions + numerics.dt * velocity(colony, parameters, relaxation, numerics)
    colony = eqx.tree_at(lambda c: c.positions, colony, positions)
    return colony, Snapshot(cells, mu, colony, parameters, relaxation)


def trajectory(
    parameters: Parameters,
    key: Array,
    sample_steps: Int[Array, " sample"],
    relaxation: Relaxation,
    numerics: Numerics,
    observe: Observe,
) -> tuple[Colony, PyTree]:
    """One colony from its start: the last state, and `observe` of the steps asked for, stacked along the first axis.

    `sample_steps` rises strictly from at least 1; its values, like those of λ and of the widths, never recompile.
    """

    def to_sample(carry: tuple[Colony, Array], last: Array) -> tuple[tuple[Colony, Array], PyTree]:
        colony, done = carry
        # the step that is observed runs outside the loop, so that only it makes a snapshot
        colony = jax.lax.fori_loop(done, last - 1, lambda _, c: step(c, parameters, relaxation, numerics)[0], colony)
        colony, snapshot = step(colony, parameters, relaxation, numerics)
        colony = eqx.tree_at(lambda c: c.problems, colony, problems_of(colony, parameters, numerics))
        return (colony, last), observe(snapshot)

    (colony, _), observed = jax.lax.scan(
        to_sample, (start(key, numerics), jnp.zeros_like(sample_steps[0])), sample_steps
    )
    return colony, observed


def problems_of(colony: Colony, parameters: Parameters, numerics: Numerics) -> Problems:
    """The colony's problems, with those that can be seen at a sample time: all of them, once there, stay."""
    before = colony.problems
    limit = 0.5 * numerics.domain - 1.0
    parent = jnp.where((colony.parents >= 0) & colony.alive, colony.parents, colony.parents.shape[0])
    degree = jnp.zeros(colony.parents.shape[0]).at[parent].add(1.0, mode="drop") + (colony.parents >= 0)
    finite = jnp.isfinite(colony.positions).all() & jnp.isfinite(colony.nutrient).all()
    return Problems(
        capacity_reached=before.capacity_reached,
        left_domain=before.left_domain | jnp.any(jnp.abs(colony.positions) > limit),
        unstable=before.unstable | (numerics.dt * parameters.elasticity * (jnp.max(degree) + 1.0) >= 2.0),
        not_finite=before.not_finite | ~finite,
    )
