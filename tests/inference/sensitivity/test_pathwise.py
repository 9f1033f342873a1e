"""Means over members that a few of them cannot carry away."""

import jax.numpy as jnp
import numpy as np

from yeastfit.inference.sensitivity.pathwise import robust_mean


def test_robust_mean_is_the_plain_mean_without_outliers() -> None:
    tangents = np.random.default_rng(0).normal(2.0, 1.0, (64, 1, 3))
    plain = robust_mean(jnp.asarray(tangents))
    np.testing.assert_allclose(plain.mean, tangents.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(plain.error, tangents.std(axis=0, ddof=1) / 8, rtol=1e-5)
    np.testing.assert_allclose(plain.spread, 1.0, rtol=1e-5)
    assert (plain.cut == 0).all()


def test_robust_mean_cuts_outliers_and_only_those() -> None:
    tangents = np.random.default_rng(0).normal(2.0, 1.0, (64, 1, 3))
    tangents[3], tangents[4] = 1e9, np.nan
    robust = robust_mean(jnp.asarray(tangents))
    assert np.abs(robust.mean - 2).max() < 0.6
    np.testing.assert_allclose(robust.cut, 2 / 64)
    assert (np.asarray(robust.spread) > 100).all() or np.isnan(robust.spread).all()


def test_robust_mean_keeps_what_only_some_members_have() -> None:
    """Births that every fifth colony has: the median is 0, and the mean is not."""
    tangents = np.where(np.arange(40) % 5 == 0, -3.0, 0.0)[:, None]
    np.testing.assert_allclose(robust_mean(jnp.asarray(tangents)).mean, -0.6, rtol=1e-5)
