"""Noise of nodes and of the nutrient against closed forms."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of
from jaxtyping import Array
from scipy import integrate, stats

from yeastfit.model.colony import Colony
from yeastfit.model.laws.forces import springs
from yeastfit.model.laws.motion import DrivenMotion
from yeastfit.model.mechanisms.langevin_motion import LangevinMotion
from yeastfit.model.mechanisms.nutrient_fluctuation import NutrientFluctuation
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD
from yeastfit.model.rules import Context
from yeastfit.model.simulate import step

PAIRS = 1500
MODEL = Model(motion=LangevinMotion(), fluctuations=NutrientFluctuation())


@eqx.filter_jit
def shaken_cells(colony: Colony, numerics: Numerics, parameters: Parameters, elasticity: Array, steps: Array) -> Array:
    """Positions some steps later."""

    def one(_: Array, colony: Colony) -> Colony:
        colony = dataclasses.replace(colony, step=colony.step + 1)
        context = context_of(colony, numerics, parameters=parameters)
        return dataclasses.replace(colony, positions=LangevinMotion().moved(context, elasticity * springs(colony)))

    return jax.lax.fori_loop(0, steps, one, colony).positions


def noisy(dt: float, steps: int, noise: float, elasticity: float) -> np.ndarray:
    """Places of many single cells, on which springs and noise act."""
    numerics = Numerics(domain=4.0, spacing=1.0, dt=dt, capacity=2 * PAIRS)
    x = np.zeros((2 * PAIRS, 2))
    x[::2, 0] = 1.0
    parents = np.where(np.arange(2 * PAIRS) % 2, np.arange(2 * PAIRS) - 1, -1)
    parameters = MODEL.complete(Parameters(node_noise=noise))
    colony = colony_of(x, parents, numerics=numerics)
    return np.array(shaken_cells(colony, numerics, parameters, jnp.asarray(elasticity), jnp.asarray(steps)))


@pytest.mark.thorough
@pytest.mark.parametrize("substeps", [1, 4])
def test_substeps_draw_noise_of_their_own(substeps: int) -> None:
    """Mean square displacement 4 D_n Δt in one time step, however many parts it has."""
    numerics = Numerics(domain=60.0, spacing=1.0, dt=0.02, capacity=2 * PAIRS, substeps=substeps)
    places = np.stack(np.meshgrid(np.arange(60), np.arange(50)), axis=-1).reshape(-1, 2) * 0.9 - 25.0
    colony = colony_of(places, np.full(2 * PAIRS, -1), numerics=numerics)
    model = Model(motion=LangevinMotion())
    weak = {"elasticity": 1e-6, "repulsivity": 1e-6, "mobility": 1e-6}
    parameters = model.complete(Parameters(**weak, node_noise=0.03))
    moved = eqx.filter_jit(step)(colony, parameters, HARD, numerics, model)[0].positions - colony.positions
    squared, expected = np.asarray((moved**2).sum(axis=1)), 4 * 0.03 * 0.02
    assert abs(squared.mean() - expected) < 4 * expected / np.sqrt(squared.size)


def test_a_free_node_diffuses() -> None:
    """Mean square displacement 4 D_n t, with error 4 D_n t / √nodes."""
    x = noisy(0.02, 50, 0.03, 0.0)
    x[::2, 0] -= 1.0
    squared = (x**2).sum(axis=1)
    expected = 4 * 0.03 * 1.0
    assert abs(squared.mean() - expected) < 4 * expected / np.sqrt(squared.size)
    assert stats.kstest(squared / expected, "expon").pvalue > 1e-3


def test_the_length_of_a_cell_has_its_stationary_density() -> None:
    """ρ exp(−λ2 (ρ − 1)² / (2 D_n)), after 15 relaxation times of 1/(2 λ2)."""
    x = noisy(0.004, 375, 0.2, 5.0)
    lengths = np.hypot(*(x[::2] - x[1::2]).T)

    def density(r: float) -> float:
        return float(r * np.exp(-5.0 * (r - 1) ** 2 / (2 * 0.2)))

    total = integrate.quad(density, 0, 4)[0]
    r = np.linspace(0, 4, 2000)
    below = integrate.cumulative_trapezoid([density(each) for each in r], r, initial=0.0) / total
    assert stats.kstest(lengths, lambda values: np.interp(values, r, below)).pvalue > 1e-3
    gauss = stats.norm(1.0, np.sqrt(0.2 / 5.0)).cdf  # the density without its factor ρ is another one
    assert stats.kstest(lengths, gauss).pvalue < 1e-3


def test_without_noise_nodes_are_driven_alone() -> None:
    numerics = Numerics(domain=4.0, spacing=1.0, dt=0.02, capacity=8)
    context = context_of(colony_of(np.eye(2), numerics=numerics), numerics, parameters=MODEL.complete(Parameters()))
    v = jnp.asarray(np.random.default_rng(0).normal(size=(8, 2)))
    ours, driven = (eqx.filter_jit(rule.moved)(context, v) for rule in (LangevinMotion(), DrivenMotion()))
    np.testing.assert_array_equal(ours, driven)
    slope = jax.jit(jax.jacfwd(lambda d: _moved(context, v, d)))(jnp.asarray(0.0))
    assert np.isfinite(slope).all()


def _moved(context: Context, v: Array, noise: Array) -> Array:
    parameters = context.parameters.replace(node_noise=noise)
    return LangevinMotion().moved(dataclasses.replace(context, parameters=parameters), v)


def test_a_node_s_derivative_in_the_noise_is_its_draw_s(double: None) -> None:
    numerics = Numerics(domain=4.0, spacing=1.0, dt=0.02, capacity=4)
    context = context_of(colony_of(np.eye(2), numerics=numerics), numerics, parameters=MODEL.complete(Parameters()))
    move = jax.jit(lambda d: _moved(context, jnp.zeros((4, 2)), d))
    exact = jax.jit(jax.jacfwd(move))(jnp.asarray(0.3))
    moved = np.asarray(move(jnp.asarray(0.3))) - np.asarray(context.colony.positions)
    np.testing.assert_allclose(exact, moved / 0.6, rtol=1e-9)


@pytest.mark.parametrize("spacing", [0.2, 0.1])
def test_the_nutrient_fluctuates_about_1_alike_on_all_grids(spacing: float) -> None:
    """Of the mean over a disc of radius 1: its own mean is 1, its variance σ² Δt / π."""
    numerics = Numerics(domain=4.0, spacing=spacing, dt=0.02, capacity=2)
    parameters = MODEL.complete(Parameters(nutrient_noise=0.1))
    axis = np.asarray(jax.jit(numerics.axis)())
    disc = np.hypot(axis[:, None], axis) < 1.0

    @jax.jit
    @jax.vmap
    def shaken(step: Array) -> Array:
        colony = dataclasses.replace(colony_of(np.eye(2), numerics=numerics), step=step)
        return NutrientFluctuation().shaken(context_of(colony, numerics, parameters=parameters))

    fields = np.asarray(shaken(np.arange(600, dtype=np.int32)))
    means = fields[:, disc].mean(axis=1)
    assert abs(means.mean() - 1) < 4 * means.std() / np.sqrt(600)
    expected = 0.1**2 * 0.02 / (disc.sum() * spacing**2)
    assert means.var() == pytest.approx(expected, rel=4 * np.sqrt(2 / 600))
    assert (fields > 0).all()
    for edge in (fields[:, 0], fields[:, -1], fields[:, :, 0], fields[:, :, -1]):
        assert (edge == 1).all()


@pytest.mark.parametrize("dt", [0.05, 0.1])
def test_motion_is_of_weak_order_1(dt: float) -> None:
    """Of little noise the variance of a cell's length is D_n/λ2 / (1 − λ2 Δt): an error λ2 Δt + O(Δt²) relative."""
    x = noisy(dt, 40, 1e-3, 5.0)
    lengths = np.hypot(*(x[::2] - x[1::2]).T)
    expected = 1e-3 / 5.0 / (1 - 5.0 * dt)
    assert lengths.var() == pytest.approx(expected, rel=4 * np.sqrt(2 / PAIRS))


def test_the_nutrient_s_derivative_in_its_noise_is_its_draws(double: None) -> None:
    """c = exp(σ z − σ² s²/2) of z with variance s² = Δt/h²: ∂c/∂σ = c (z − σ s²), and at σ = 0 it is z."""
    numerics = Numerics(domain=4.0, spacing=0.5, dt=0.02, capacity=2)
    context = context_of(colony_of(np.eye(2), numerics=numerics), numerics, parameters=MODEL.complete(Parameters()))

    def shaken(strength: Array) -> Array:
        parameters = context.parameters.replace(nutrient_noise=strength)
        return NutrientFluctuation().shaken(dataclasses.replace(context, parameters=parameters))

    share, at = 0.02 / 0.5**2, jnp.asarray(0.2)
    slope_at = jax.jit(jax.jacfwd(shaken))
    c, slope, first = map(np.asarray, (jax.jit(shaken)(at), slope_at(at), slope_at(jnp.asarray(0.0))))
    z = (np.log(c[1:-1, 1:-1]) + 0.5 * 0.2**2 * share) / 0.2
    np.testing.assert_allclose(slope[1:-1, 1:-1], c[1:-1, 1:-1] * (z - 0.2 * share), rtol=1e-9)
    np.testing.assert_allclose(first[1:-1, 1:-1], z, rtol=1e-9)
