"""Walkers: conservation, who takes them up, the density, and the limit of many."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import grid, scattered_tree
from jaxtyping import Array
from scipy import stats

from yeastfit.errors import InputError
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import Colony
from yeastfit.model.mechanisms.starvation_death import StarvationDeath
from yeastfit.model.mechanisms.walker_medium import WalkerBirths, WalkerMedium, banded_products, density, nearest_node
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD
from yeastfit.model.simulate import step
from yeastfit.simulation.simulate import member_keys, simulate

NUMERICS = Numerics(domain=6.0, spacing=0.5, dt=0.02, capacity=24)
WALKERS = Model(medium=WalkerMedium(walkers=600, width=0.6), births=WalkerBirths(per_bud=3))


@eqx.filter_jit
def begin(model: Model, key: Array) -> Colony:
    """A new colony, by one program."""
    return model.start(key, NUMERICS)


@eqx.filter_jit
def walked(colony: Colony) -> tuple[Colony, tuple[Array, Array, Array]]:
    """Sixty steps; at each the free walkers, those in stores, and the nodes."""
    parameters = WALKERS.complete(Parameters(diffusivity=0.3, uptake_radius=0.4))

    def one(colony: Colony, _: None) -> tuple[Colony, tuple[Array, Array, Array]]:
        colony = step(colony, parameters, HARD, NUMERICS, WALKERS)[0]
        return colony, (colony.medium["free"].sum(), colony.node_state["taken"].sum(), colony.count)

    return jax.lax.scan(one, colony, None, length=60)


def test_walkers_are_conserved_at_every_step_and_walk() -> None:
    began = begin(WALKERS, jax.random.key(3))
    colony, (free, taken, nodes) = walked(began)
    np.testing.assert_array_equal(np.asarray(free) + np.asarray(taken) + 3 * (np.asarray(nodes) - 2), 600)
    assert int(nodes[-1]) > 8
    assert (np.asarray(taken) >= 0).all()
    assert not bool(colony.problems.store_empty)
    # far from the walls the mean square displacement is 4 λ1 t
    before, after = (np.asarray(one.medium["walkers"]) for one in (began, colony))
    middle = np.abs(before).max(axis=1) < 0.6
    squared = np.sum((after - before) ** 2, axis=1)[middle]
    expected = 4 * 0.3 * 60 * NUMERICS.dt
    assert abs(squared.mean() - expected) < 4 * expected / np.sqrt(middle.sum())
    # the density of the nutrient is that of the free walkers
    weight = np.full(13, 0.5)
    weight[[0, -1]] /= 2
    assert float(weight @ np.asarray(colony.nutrient) @ weight) / 36 == pytest.approx(float(free[-1]) / 600, rel=1e-4)
    few = dataclasses.replace(began, medium={**began.medium, "free": jnp.zeros(600, bool)})
    assert bool(walked(few)[0].problems.store_empty)


@pytest.mark.parametrize("points", [40, 64, 65, 200])
def test_products_with_a_banded_kernel_are_those_with_the_whole_of_it(double: None, points: int) -> None:
    places = np.arange(points)
    kernel = np.exp(-0.5 * ((places[:, None] - places) / 3.0) ** 2)
    grid = np.random.default_rng(0).uniform(size=(points, points))
    found = jax.jit(banded_products, static_argnums=2)(kernel, grid, 26)
    np.testing.assert_allclose(found, kernel @ grid @ kernel.T, rtol=1e-13)


def test_walkers_are_taken_up_by_the_nearest_node_and_seen_as_a_density() -> None:
    colony = scattered_tree(9, 1.0, NUMERICS)
    places = np.random.default_rng(2).uniform(-3, 3, (200, 2)).astype(np.float32)
    eats = np.arange(24) < 9
    eats[4] = False  # who is dead takes up nothing
    slot, near = jax.jit(nearest_node)(colony, jnp.asarray(eats), jnp.asarray(places), jnp.asarray(0.5))
    apart = np.linalg.norm(places[:, None] - np.asarray(colony.positions)[:9], axis=-1)
    apart[:, 4] = np.inf
    np.testing.assert_array_equal(near, apart.min(axis=1) < 0.5)
    np.testing.assert_array_equal(np.asarray(slot)[near], apart.argmin(axis=1)[near])
    # one walker in the middle: a Gaussian
    c = eqx.filter_jit(density)(jnp.zeros((1, 2)), jnp.ones(1, bool), 0.6, NUMERICS)
    x, y = grid(NUMERICS)
    np.testing.assert_allclose(c, 36 * np.exp(-(x**2 + y**2) / 0.72) / (2 * np.pi * 0.36), atol=0.01)


def test_the_dead_take_up_no_walkers_and_do_not_bud() -> None:
    model = Model(medium=WALKERS.medium, births=WALKERS.births, death=StarvationDeath("stay"))
    colony = begin(model, jax.random.key(3))
    taken = jnp.where(jnp.arange(24) < 2, 30.0, 0.0)
    dead = dataclasses.replace(colony, node_state={"taken": taken, "vitality": jnp.zeros(24)})
    parameters = model.complete(Parameters(diffusivity=0.3, uptake_radius=0.4))
    after = eqx.filter_jit(step)(dead, parameters, HARD, NUMERICS, model)[0]
    assert int(after.count) == 2
    assert int(after.medium["free"].sum()) == 600
    np.testing.assert_array_equal(after.node_state["taken"], taken)


def test_walkers_do_not_take_over_another_colony() -> None:
    with pytest.raises(InputError, match="cannot go on from a colony of another medium, without walkers"):
        WALKERS.resumed(scattered_tree(9, 1.0, NUMERICS))


@pytest.mark.slow
def test_cells_tend_to_a_limit_as_walkers_become_many() -> None:
    """N(n) = N∞ + a / √n for n walkers that are the same nutrient, n / 80 of which are a child; 64 colonies each.

    Walkers arrive by chance, so that some children come early, and theirs in turn: fewer walkers make more cells.
    """
    numerics = Numerics(domain=10.0, spacing=0.5, dt=0.02, capacity=64)
    numbers, found, errors = np.array([400, 800, 1600, 3200, 6400, 12800]), [], []
    for n in numbers.tolist():
        model = Model(medium=WalkerMedium(walkers=n), births=WalkerBirths(per_bud=n // 80))
        run = simulate(
            Parameters(diffusivity=0.5, uptake_radius=0.4),
            member_keys(n, 64),
            times=[3.0],
            model=model,
            numerics=numerics,
            relaxation=HARD,
            observe=SmoothStatistics(10.0, 0.5, statistics=("cell_count",)),
        )
        cells = np.asarray(run.statistics["cell_count"])[:, 0]
        found.append(cells.mean())
        errors.append(cells.std(ddof=1) / 8)
    terms = np.stack([np.ones(6), numbers**-0.5], axis=1) / np.array(errors)[:, None]
    limit, slope = np.linalg.lstsq(terms, np.array(found) / errors, rcond=None)[0]
    covariance = np.linalg.inv(terms.T @ terms)
    chi_square = np.sum((terms @ [limit, slope] - np.array(found) / errors) ** 2)
    assert chi_square < stats.chi2.ppf(0.999, 4)
    assert slope > 4 * np.sqrt(covariance[1, 1])
    error = np.sqrt(covariance[0, 0])
    assert error < 0.25
    assert limit == pytest.approx(13.37, abs=4 * np.sqrt(2) * error)  # that of other seeds, as well known
