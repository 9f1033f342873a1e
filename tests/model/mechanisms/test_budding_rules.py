"""Directions of buds: the limits, the law of the angles, derivatives, and the plain reading."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, grid
from jaxtyping import Array
from scipy import special, stats

from reference.mechanisms import mixed_angle
from yeastfit.errors import InputError
from yeastfit.model.laws.budding import UniformBudding
from yeastfit.model.mechanisms.gradient_budding import BiasedBudding, GradientBudding
from yeastfit.model.mechanisms.polar_budding import PolarBudding
from yeastfit.model.mechanisms.von_mises import angle_of
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.rules import BuddingRule, Context

NUMERICS = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=24)


@pytest.fixture(autouse=True)
def precise(double: None) -> None:
    """Double precision."""


def scene(rule: BuddingRule, seed: int = 0, **values: float) -> Context:
    """Twenty nodes of a chain in a nutrient that rises in all directions but one."""
    x, y = grid(NUMERICS)
    positions = np.random.default_rng(1).uniform(-2, 2, (20, 2))
    colony = colony_of(positions, nutrient=0.5 + 0.05 * x + 0.03 * y**2, numerics=NUMERICS, seed=seed)
    return context_of(colony, NUMERICS, parameters=Model(budding=rule).complete(Parameters(**values)))


@eqx.filter_jit
def _angles(rule: BuddingRule, context: Context) -> Array:
    return rule.angles(context, jnp.arange(20), context.colony.lineages[:20])


def angles(rule: BuddingRule, seed: int = 0, **values: float) -> np.ndarray:
    return np.asarray(_angles(rule, scene(rule, seed, **values)))


def slopes() -> np.ndarray:
    return np.asarray(eqx.filter_jit(Context.local_gradient)(scene(GradientBudding())))[:20]


angle_from = jax.jit(angle_of)


@pytest.mark.parametrize("concentration", [0.0, 5.0, 1000.0])
def test_no_angle_lies_beyond_a_turn(concentration: float) -> None:
    """In single precision, at the ends of what is uniform."""
    found = angle_from(jnp.array([0.0, 1e-8, 0.5, 1.0]), jnp.float32(concentration))
    assert jnp.abs(found).max() <= np.float32(np.pi)


def circle(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two sets of angles."""
    return float(np.abs(np.angle(np.exp(1j * (a - b)))).max())


def test_along_the_gradient_there_is_no_randomness() -> None:
    one, other = angles(GradientBudding(), seed=0), angles(GradientBudding(), seed=1)
    np.testing.assert_array_equal(one, other)
    assert circle(one, np.arctan2(*slopes()[:, ::-1].T)) < 1e-12


@pytest.mark.parametrize("rule", [GradientBudding(), BiasedBudding()])
def test_where_the_nutrient_is_flat_the_angle_is_the_source_s(rule: BuddingRule) -> None:
    context = scene(rule) if not rule.parameters else scene(rule, budding_bias=5.0)
    flat = jnp.asarray(np.ones_like(context.colony.nutrient))
    context = dataclasses.replace(context, colony=dataclasses.replace(context.colony, nutrient=flat))
    np.testing.assert_array_equal(_angles(rule, context), _angles(UniformBudding(), context))


def test_the_bias_goes_from_the_source_to_the_gradient() -> None:
    source = angles(UniformBudding())
    assert circle(angles(BiasedBudding(), budding_bias=0.0), source) < 1e-12
    assert circle(angles(BiasedBudding(), budding_bias=1000.0), angles(GradientBudding())) < 0.15
    assert circle(angles(PolarBudding(), polarity=0.0, budding_bias=9.0), source) < 1e-12


def test_a_polar_bud_points_away_from_the_older_node() -> None:
    context = scene(PolarBudding())
    x = np.asarray(context.colony.positions)[:20]
    axis = np.arctan2(*np.diff(x, axis=0)[:, ::-1].T)  # of a chain: the older node is the one before
    found = angles(PolarBudding(), polarity=1.0, budding_bias=1000.0)
    assert circle(found[1:], axis) < 0.15
    assert found[0] == angles(UniformBudding())[0]


@pytest.mark.parametrize(("concentration", "share"), [(0.0, 1.0), (0.7, 1.0), (20.0, 1.0), (800.0, 1.0), (30.0, 0.4)])
def test_angles_are_those_of_the_plain_reading(concentration: float, share: float) -> None:
    drawn, axes = angles(UniformBudding()), np.arctan2(*slopes()[:, ::-1].T)
    if share == 1.0:
        found = angles(BiasedBudding(), budding_bias=concentration)
    else:
        found = angles(PolarBudding(), budding_bias=concentration, polarity=share)[1:]
        x = np.asarray(scene(PolarBudding()).colony.positions)[:20]
        drawn, axes = drawn[1:], np.arctan2(*np.diff(x, axis=0)[:, ::-1].T)
    expected = [mixed_angle(d, a, concentration, share) for d, a in zip(drawn, axes, strict=True)]
    assert circle(found, np.array(expected)) < 1e-8


@pytest.mark.parametrize("concentration", [0.0, 0.5, 4.0, 300.0])
def test_the_mean_resultant_length_is_I1_over_I0(concentration: float) -> None:
    uniform = jax.random.uniform(jax.random.key(2), (20_000,))
    found = np.asarray(angle_from(uniform, jnp.asarray(concentration)))
    expected = special.ive(1, concentration) / special.ive(0, concentration)
    error = np.cos(found).std() / math.sqrt(found.size)
    assert abs(np.cos(found).mean() - expected) < 4 * error
    assert abs(np.sin(found).mean()) < 4 * np.sin(found).std() / math.sqrt(found.size)
    if concentration:
        assert stats.kstest(found, stats.vonmises(concentration).cdf).pvalue > 1e-3


def test_single_precision_has_no_holes() -> None:
    with jax.enable_x64(False):
        uniform = np.concatenate([[0.0, 1e-7, 0.5, 1 - 6e-8], np.linspace(0, 1, 999)]).astype(np.float32)

        @jax.jit
        def both(concentration: Array) -> tuple[Array, Array]:
            return jax.jvp(lambda k: angle_of(jnp.asarray(uniform), k), (concentration,), (jnp.float32(1.0),))

        for concentration in (0.0, 3.0, 1000.0):
            found, slope = both(jnp.float32(concentration))
            assert (np.abs(found) <= np.pi + 1e-5).all()
            assert np.isfinite(slope).all()
            assert (np.diff(np.asarray(found[4:])) >= -1e-5).all()


@jax.jit
def angles_there(concentration: Array, share: Array, shift: Array) -> Array:
    return angle_of(jnp.linspace(0.01, 0.99, 41) + shift, concentration, share)


slopes_there = jax.jit(jax.jacfwd(angles_there, argnums=(0, 1, 2)))


@pytest.mark.parametrize("value", [0.3, 6.0, 200.0])
def test_derivatives_are_those_of_differences(value: float) -> None:
    at = (value, 0.6, 0.0)
    for which, exact in enumerate(slopes_there(*at)):
        h = 1e-5 * max(1.0, at[which])
        up, down = (np.asarray(angles_there(*(a + s * h * (i == which) for i, a in enumerate(at)))) for s in (1, -1))
        np.testing.assert_allclose(exact, (up - down) / (2 * h), rtol=2e-5, atol=1e-6)


def test_what_is_no_bias_is_refused() -> None:
    with pytest.raises(InputError, match=r"budding_bias \(κ\) is 2000, it must be in \[0, 1000\]"):
        Model(budding=BiasedBudding()).complete(Parameters(budding_bias=2000.0))
    with pytest.raises(InputError, match=r"polarity \(q\) is 1.5"):
        Model(budding=PolarBudding()).complete(Parameters(polarity=1.5))
    with pytest.raises(InputError, match="budding_bias is a parameter of budding 'biased' or budding 'polar': choose"):
        Model(budding=GradientBudding()).complete(Parameters(budding_bias=1.0))
