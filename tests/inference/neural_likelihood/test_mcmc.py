"""Chains on densities that are known."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from emcee import EnsembleSampler
from emcee.backends import HDFBackend
from jax import Array
from scipy.stats import norm

from yeastfit.inference.neural_likelihood import mcmc
from yeastfit.inference.neural_likelihood.mcmc import Walk
from yeastfit.inference.posterior.chain_diagnostics import LONG, autocorrelation_time, split_r_hat
from yeastfit.inference.posterior.emcee_file import write_chains


@pytest.mark.thorough
@pytest.mark.parametrize(("free", "walkers"), [(1, 128), (2, 128), (5, 128), (5, 40)])
def test_a_normal_density_is_drawn_from(free: int, walkers: int) -> None:
    """Means, standard deviations and 90 % intervals, within four of their standard errors; with few walkers, too."""
    rng = np.random.default_rng(free)
    root = np.tril(rng.normal(size=(free, free))) + 2 * np.eye(free)

    def log_density(x: Array) -> Array:
        return -0.5 * jnp.sum(jnp.linalg.solve(root, x.T) ** 2, axis=0)

    drawn, size = [], 0.0
    for seed in range(4):
        places = 3 * rng.standard_normal((2000, free)) @ root.T
        found = Walk.start(log_density, places, walkers=walkers, most_steps=4000, seed=seed).until()
        drawn.append(np.linalg.solve(root, found.flat.T).T)
        size += walkers * 0.5 * found.steps / found.times.max()
    z = np.concatenate(drawn)
    np.testing.assert_allclose(z.mean(axis=0), 0.0, atol=4 / np.sqrt(size))
    np.testing.assert_allclose(z.std(axis=0), 1.0, atol=4 / np.sqrt(2 * size))
    np.testing.assert_allclose(np.mean(np.abs(z) < 1.645, axis=0), 0.9, atol=4 * np.sqrt(0.09 / size))


def test_two_modes_have_their_weights() -> None:
    """Three times as much on the right; ten standard deviations apart, with places in both."""

    def log_density(x: Array) -> Array:
        left, right = (-0.5 * jnp.sum((x - middle) ** 2, axis=1) for middle in (-5.0, 5.0))
        return jnp.logaddexp(left, np.log(3.0) + right)

    places = np.random.default_rng(0).uniform(-8, 8, size=(2000, 2))
    found = Walk.start(log_density, places, walkers=128, most_steps=5000, seed=1).until()
    right = found.flat[:, 0] > 0
    assert right.mean() == pytest.approx(0.75, abs=0.05)
    np.testing.assert_allclose(found.flat[right].std(axis=0), 1.0, atol=0.05)


def test_a_trail_is_walked_along_and_back() -> None:
    """A tenth of the draws, by a density of the others; the exact share of what is beyond 1."""

    def log_density(x: Array) -> Array:
        along, across = (x[:, 0] - x[:, 1]) / np.sqrt(2), (x[:, 0] + x[:, 1]) / np.sqrt(2)
        core = np.log(0.9 / 0.3) - 0.5 * (along / 0.3) ** 2
        trail = np.log(0.1) - 0.5 * (along - 2.5) ** 2
        return jnp.logaddexp(core, trail) - 0.5 * (across / 0.1) ** 2

    places = np.random.default_rng(0).normal(0, 1.5, size=(2000, 2))
    found = Walk.start(log_density, places, walkers=128, most_steps=5000, seed=0).until()
    assert found.times.max() < 15  # 35 by differential evolution alone
    share = ((found.flat[:, 0] - found.flat[:, 1]) / np.sqrt(2) > 1).mean()
    exact = 0.9 * norm.sf(1 / 0.3) + 0.1 * norm.sf(-1.5)
    independent = 128 * 0.5 * found.steps / found.times.max()
    assert share == pytest.approx(exact, abs=4 * np.sqrt(exact * (1 - exact) / independent))


@pytest.mark.parametrize("most_steps", [20_000, 600])
def test_chains_go_on_where_diagnostics_find_them_short(most_steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both estimates of an autocorrelation time differ by chance; here the first one is content far too early."""
    monkeypatch.setattr(mcmc, "ENOUGH", 0.2 * LONG)
    places = np.random.default_rng(0).normal(size=(300, 3))

    def started() -> Walk:
        def log_density(x: Array) -> Array:
            return -0.5 * jnp.sum(x**2, axis=1)

        return Walk.start(log_density, places, walkers=16, most_steps=most_steps, seed=2)

    short, found = started().until(mcmc.ENOUGH), started().until_long()
    assert short.x.shape[1] < LONG * autocorrelation_time(short.x).max()
    if most_steps > 600:
        assert found.x.shape[1] >= LONG * autocorrelation_time(found.x).max()
        assert short.steps < found.steps < most_steps
    else:
        assert found.steps == most_steps


def test_they_are_long_by_what_is_diagnosed() -> None:
    """λ may need longer chains than log λ: here means of ten draws in turn stand for it."""
    places = np.random.default_rng(0).normal(size=(300, 2))

    def started() -> Walk:
        return Walk.start(lambda x: -0.5 * jnp.sum(x**2, axis=1), places, walkers=16, most_steps=20_000, seed=5)

    def slower(x: np.ndarray) -> np.ndarray:
        return np.apply_along_axis(np.convolve, 0, x, np.full(10, 0.1), "same")

    plain, found = started().until_long(), started().until_long(slower)
    times = autocorrelation_time(slower(found.flat).reshape(found.x.shape))
    assert found.x.shape[1] >= LONG * times.max()
    assert found.steps > plain.steps


def test_chains_go_on_where_they_do_not_agree() -> None:
    """Walkers stay long on their side of a valley: R̂ is 1.017 where they are `LONG`, and they go on."""
    places = np.random.default_rng(0).normal(size=(300, 1)) * 3

    def log_density(x: Array) -> Array:
        return jnp.logaddexp(-0.5 * (x[:, 0] - 3) ** 2, -0.5 * (x[:, 0] + 3) ** 2)

    def started() -> Walk:
        return Walk.start(log_density, places, walkers=8, most_steps=100_000, seed=2)

    short, found = started().until(mcmc.ENOUGH), started().until_long()
    lengths = found.x.shape[1] / autocorrelation_time(found.x)
    assert split_r_hat(short.x).max() > mcmc.ALIKE
    assert found.steps > short.steps
    assert split_r_hat(found.x).max() <= mcmc.ALIKE or lengths.min() >= mcmc.LONGEST


def test_chains_that_nothing_moves_come_back_as_they_are() -> None:
    """Every proposal is refused: no autocorrelation time, and no error either."""
    places = np.random.default_rng(0).normal(size=(300, 2))

    def log_density(x: Array) -> Array:
        return jnp.where((x[:, None] == places).all(axis=2).any(axis=1), 0.0, -jnp.inf)

    found = Walk.start(log_density, places, walkers=16, most_steps=1000, seed=0).until()
    assert np.isinf(found.times).all()
    assert found.x.shape[1] >= 50


def normal(x: Array) -> Array:
    return -0.5 * jnp.sum(x**2, axis=1)


def test_a_chain_that_goes_on_is_the_longer_chain() -> None:
    """Also where it was stopped within a block of steps."""
    places = np.random.default_rng(0).normal(size=(200, 2))
    whole, parts = (Walk.start(normal, places, walkers=41, most_steps=2000, seed=3) for _ in range(2))
    whole.until(np.inf, 1750)
    assert parts.until(np.inf, 530).steps == 530
    parts.until(np.inf, 1750)
    np.testing.assert_array_equal(parts.chain, whole.chain)
    assert parts.chain.shape == (1750, 41, 2)


def test_emcee_has_every_step_and_goes_on(tmp_path: Path) -> None:
    """Places, densities, accepted proposals; and a state from which emcee's sampler can make further steps."""
    walk = Walk.start(normal, np.random.default_rng(0).normal(size=(200, 2)), walkers=40, most_steps=600, seed=3)
    found = walk.until()
    write_chains(tmp_path / "chains.h5", walk.backend)
    backend = HDFBackend(str(tmp_path / "chains.h5"))
    assert backend.iteration == found.steps == 600
    np.testing.assert_array_equal(backend.get_chain(), walk.chain)
    np.testing.assert_allclose(backend.get_log_prob(), -0.5 * (walk.chain**2).sum(axis=2), rtol=1e-14)
    moved = (np.diff(walk.chain, axis=0) != 0).any(axis=2).sum(axis=0)
    np.testing.assert_allclose(backend.accepted, moved, atol=1)  # but the first step, whose start is not kept
    np.testing.assert_array_equal(found.acceptance, backend.accepted / 600)
    sampler = EnsembleSampler(40, 2, lambda x: -0.5 * np.sum(x**2), backend=backend)
    sampler.run_mcmc(None, 3)
    assert backend.iteration == 603
