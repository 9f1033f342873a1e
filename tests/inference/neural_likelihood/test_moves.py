"""Steps of an ensemble: proposals against scipy's and emcee's, and what a program is compiled for."""

import emcee
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.stats import gaussian_kde, kstest

from yeastfit.inference.neural_likelihood.moves import Chance, by_evolution, from_kernels, stepped

FREE = pytest.mark.parametrize("free", [1, 2, 5])


def walkers(free: int, count: int, seed: int) -> np.ndarray:
    """Correlated ones, of scales that differ, far from 0."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(free, free))) + 2 * np.eye(free)
    return rng.normal(size=(count, free)) @ root.T * np.logspace(-3, 3, free) + 100.0


def chosen(count: int, others: int, rng: np.random.Generator) -> np.ndarray:
    """Pairs of other walkers."""
    return np.array([rng.choice(others, size=2, replace=False) for _ in range(count)])


@FREE
def test_factors_are_ratios_of_scipys_densities(free: int) -> None:
    """Of walkers far from all others, too, whose densities underflow."""
    s, c, rng = walkers(free, 64, 0), walkers(free, 63, 1), np.random.default_rng(3)
    s[0] += 50 * s.std(axis=0)
    with jax.enable_x64(True):
        q, factor = from_kernels(*map(jnp.asarray, (s, c, chosen(64, 63, rng), rng.standard_normal(s.shape))))
    density = gaussian_kde(c.T)
    np.testing.assert_allclose(factor, density.logpdf(s.T) - density.logpdf(np.asarray(q).T), rtol=1e-7, atol=1e-7)


@FREE
@pytest.mark.parametrize("kernels", [True, False])
def test_proposals_are_drawn_as_emcee_draws_them(free: int, kernels: bool) -> None:
    """Projections of 4000 proposals by each on random directions have one distribution."""
    s, c = walkers(free, 4000, 0), walkers(free, 64, 1)
    rng, random = np.random.default_rng(4), np.random.RandomState(5)
    given = [jnp.asarray(one) for one in (chosen(4000, 64, rng), rng.standard_normal(s.shape))]
    with jax.enable_x64(True):
        if kernels:
            ours, _ = from_kernels(jnp.asarray(s), jnp.asarray(c), *given)
            theirs, _ = emcee.moves.KDEMove().get_proposal(s, [c], random)
        else:
            gamma = 2.38 / np.sqrt(2 * free) + 1e-5 * given[1][:, 0]
            ours, log_f = by_evolution(jnp.asarray(s), jnp.asarray(c), given[0], gamma)
            move = emcee.moves.DEMove()
            move.setup(c)
            theirs, _ = move.get_proposal(s, [c], random)
            assert not np.any(log_f)
    for direction in np.random.default_rng(6).normal(size=(5, free)) / c.std(axis=0):
        assert kstest(np.asarray(ours) @ direction, theirs @ direction).pvalue > 1e-3


@pytest.mark.parametrize("count", [8, 9, 128])
def test_halves_pairs_and_kinds_of_a_step(count: int) -> None:
    """Nobody is in both halves, j ≠ k; half of the steps are by kernels where there are walkers enough."""
    chance = Chance.of_steps(400, count, 2, np.random.default_rng(0))
    np.testing.assert_array_equal(np.sort(chance.order, axis=1), np.tile(np.arange(count), (400, 1)))
    assert (chance.pair[..., 0] != chance.pair[..., 1]).all()
    assert set(np.unique(chance.pair)) == set(range(count - count // 2))
    assert chance.kernels.mean() == pytest.approx(0.5 if count >= 20 else 0.0, abs=0.1)
    assert (chance.gamma == 1.0).mean() == pytest.approx(0.2, abs=0.08)


class Scaled(eqx.Module):
    """A normal density of any width, that counts how often it is compiled."""

    sd: Float[np.ndarray | Array, ""]
    compiled: "Count" = eqx.field(static=True)

    def __call__(self, x: Float[Array, "row free"]) -> Float[Array, " row"]:
        self.compiled.times += 1
        return -0.5 * jnp.sum((x / self.sd) ** 2, axis=1)


class Count:
    """How often something was done."""

    times = 0


def test_nothing_is_compiled_for_other_values() -> None:
    compiled, rng = Count(), np.random.default_rng(0)
    x = rng.normal(size=(40, 2))
    for sd in (1.0, 2.0, 3.0):
        density = Scaled(np.array(sd), compiled)
        places, _, moved = stepped(density, x, -0.5 * ((x / sd) ** 2).sum(axis=1), Chance.of_steps(50, 40, 2, rng))
        x = places[-1]
        assert moved.any()
    assert compiled.times == 1


def test_walkers_in_a_plane_are_moved_by_evolution_alone() -> None:
    """Their kernels have no density: such proposals are refused."""
    x = np.column_stack([np.linspace(-1, 1, 64), np.ones(64)])
    chance = Chance.of_steps(60, 64, 2, np.random.default_rng(0))
    places, density, moved = stepped(lambda x: -0.5 * jnp.sum(x**2, axis=1), x, -0.5 * (x**2).sum(axis=1), chance)
    assert moved[~chance.kernels].any()
    assert not moved[chance.kernels].any()
    assert np.isfinite(places).all()
    assert np.isfinite(density).all()
