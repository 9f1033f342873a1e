"""Distances and widths of samples, beside closed forms of normal laws, with trails and without."""

import numpy as np
from scipy.stats import norm

from yeastfit.inference.posterior.robust_summary import apart, covariance_of_most, far_off


def test_how_far_laws_are_apart() -> None:
    """Shifts of normal laws, their narrowing, in any coordinates; a trail that grows by 3 %."""
    normal = np.random.default_rng(0).standard_normal((100_000, 1))
    np.testing.assert_allclose(apart(normal, normal + 0.3), 0.3, atol=0.02)
    np.testing.assert_allclose(apart(np.exp(normal), np.exp(normal + 0.3)), apart(normal, normal + 0.3), atol=1e-4)
    np.testing.assert_allclose(apart(1.25 * normal, normal), 0.25 * normal.std(), atol=0.02)
    np.testing.assert_array_equal(apart(normal, normal), apart(normal[::-1], normal))
    assert apart(normal, normal + 20.0).min() > 4.0
    body = np.sort(normal, axis=0)
    with_less, with_more = (
        np.concatenate([body, np.linspace([5.0], [30.0], round(share / (1 - share) * len(body)))])
        for share in (0.14, 0.17)
    )
    assert np.quantile(with_more, 0.84) > np.quantile(with_less, 0.84) + 2.0
    in_trail = 0.86 + 0.14 * (0.01 / 0.17)  # of those with less, below the others' quantile of 84 %
    np.testing.assert_allclose(apart(with_less, with_more), norm.ppf(in_trail) - norm.ppf(0.84), atol=1e-3)


def test_the_covariance_of_most() -> None:
    """A normal law's covariance; one draw in 20 on a trail of 30 widths changes it little, their covariance tenfold."""
    rng = np.random.default_rng(1)
    root = np.array([[1.0, 0.0, 0.0], [-0.8, 0.6, 0.0], [0.1, 0.2, 0.5]])
    body = rng.standard_normal((100_000, 3)) @ root.T
    np.testing.assert_allclose(covariance_of_most(body), root @ root.T, atol=0.02)
    np.testing.assert_allclose(covariance_of_most(body[:, :1]), 1.0, atol=0.02)
    trail = body[:5000] + rng.uniform(3.0, 30.0, (5000, 1)) * [1.0, -0.8, 0.1]
    both = np.concatenate([body, trail])
    assert np.cov(both.T)[0, 0] > 10.0
    found = covariance_of_most(both)
    np.testing.assert_allclose(np.diag(found), np.diag(root @ root.T), rtol=0.25)
    assert np.linalg.eigvalsh(found).min() > 0.5 * np.linalg.eigvalsh(root @ root.T).min()


def test_draws_far_off() -> None:
    """None of a normal law, however wide; those of a trail, in one parameter or in both."""
    body = np.random.default_rng(2).standard_normal((50_000, 2)) * [0.1, 30.0]
    assert not far_off(body, body).any()
    trail = np.array([[0.6, 0.0], [0.0, -200.0], [1.0, 500.0]])
    both = np.concatenate([body, np.repeat(trail, 1000, axis=0)])
    np.testing.assert_array_equal(far_off(both, both), np.arange(len(both)) >= len(body))
    np.testing.assert_array_equal(far_off(trail, body), [True, True, True])
