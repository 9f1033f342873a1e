"""One time step, and its repetition (MODEL.md section 3)."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from yeastfit.model import cells as cells_
from yeastfit.model.colony import Colony, Problems, start
from yeastfit.model.forces import nutrient_at, stiffness, velocity
from yeastfit.model.mitosis import bud, growth_rate
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import nutrient_step
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.window import extent_of_cells, extent_of_change, on_window


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
    nutrient = eaten(colony.nutrient, cells, parameters, relaxation, numerics)
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


def eaten(
    nutrient: Float[Array, "x y"],
    cells: cells_.Cells,
    parameters: Parameters,
    relaxation: Relaxation,
    numerics: Numerics,
) -> Float[Array, "x y"]:
    """The nutrient one step later: union of the cells, biomass and diffusion, where there is anything to do."""
    reach = relaxation.union_reach

    def on(points: int, nutrient: Float[Array, "x y"], cells: cells_.Cells) -> Float[Array, "x y"]:
        first = (numerics.points - points) // 2
        window = slice(first, first + points)
        origin = -0.5 * numerics.domain + first * numerics.spacing
        g = cells_.level_set(cells, relaxation.union, reach, origin, numerics.spacing, points)
        b = cells_.biomass(g, parameters.metabolic_rate)
        return nutrient.at[window, window].set(
            nutrient_step(nutrient[window, window], b, parameters.diffusivity, numerics)
        )

    extent = jnp.maximum(extent_of_cells(cells, reach), extent_of_change(nutrient, numerics.spacing))
    return on_window(on, extent, numerics.spacing, numerics.points, nutrient, cells)


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

    def to_sample(carry: tuple[Snapshot, Array], last: Array) -> tuple[tuple[Snapshot, Array], PyTree]:
        snapshot, done = carry
        snapshot = jax.lax.fori_loop(done, last, lambda _, before: step(before.colony, *rules)[1], snapshot)
        colony = snapshot.colony
        colony = eqx.tree_at(lambda c: c.problems, colony, problems_of(colony, parameters, numerics))
        snapshot = eqx.tree_at(lambda s: s.colony, snapshot, colony)
        return (snapshot, last), observe(snapshot)

    rules = parameters, relaxation, numerics
    colony = start(key, numerics)
    first = Snapshot(cells_.cells_of(colony, parameters.aspect_ratio), jnp.zeros(()), colony, parameters, relaxation)
    (snapshot, _), observed = jax.lax.scan(to_sample, (first, jnp.zeros_like(sample_steps[0])), sample_steps)
    return snapshot.colony, observed


def problems_of(colony: Colony, parameters: Parameters, numerics: Numerics) -> Problems:
    """The colony's problems, with those that can be seen at a sample time: all of them, once there, stay.

    A node's degree never falls, so the last sample misses no instability.
    """
    before = colony.problems
    limit = 0.5 * numerics.domain - 1.0
    finite = jnp.isfinite(colony.positions).all() & jnp.isfinite(colony.nutrient).all()
    return Problems(
        capacity_reached=before.capacity_reached,
        left_domain=before.left_domain | jnp.any(jnp.abs(colony.positions) > limit),
        unstable=before.unstable | (numerics.dt * parameters.elasticity * stiffness(colony) >= 2.0),
        not_finite=before.not_finite | ~finite,
    )
