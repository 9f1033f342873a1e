"""Proposals from a kernel density, against scipy's."""

import emcee
import numpy as np
import pytest
from scipy.stats import gaussian_kde, kstest

from yeastfit.inference.neural_likelihood.kernel_move import KernelMove

FREE = pytest.mark.parametrize("free", [1, 2, 5])


def walkers(free: int, count: int, seed: int) -> np.ndarray:
    """Correlated ones, of scales that differ, far from 0."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(free, free))) + 2 * np.eye(free)
    return rng.normal(size=(count, free)) @ root.T * np.logspace(-3, 3, free) + 100.0


@FREE
def test_factors_are_ratios_of_scipys_densities(free: int) -> None:
    """Of walkers far from all others, too, whose densities underflow."""
    s, one, two = walkers(free, 64, 0), walkers(free, 40, 1), walkers(free, 24, 2)
    s[0] += 50 * s.std(axis=0)
    q, factor = KernelMove().get_proposal(s, [one, two], np.random.RandomState(3))
    density = gaussian_kde(np.concatenate([one, two]).T)
    np.testing.assert_allclose(factor, density.logpdf(s.T) - density.logpdf(q.T), rtol=1e-7, atol=1e-7)


@FREE
def test_proposals_are_drawn_as_scipy_draws_them(free: int) -> None:
    """Projections of 4000 proposals by each on random directions have one distribution."""
    s, c = walkers(free, 4000, 0), walkers(free, 64, 1)
    ours, _ = KernelMove().get_proposal(s, [c], np.random.RandomState(4))
    theirs, _ = emcee.moves.KDEMove().get_proposal(s, [c], np.random.RandomState(5))
    for direction in np.random.default_rng(6).normal(size=(5, free)) / c.std(axis=0):
        assert kstest(ours @ direction, theirs @ direction).pvalue > 1e-3
