"""Chains on densities that are known."""

import numpy as np
import pytest

from yeastfit.infer.posterior_chain import walk


@pytest.mark.parametrize("free", [1, 2, 5])
def test_a_normal_density_is_drawn_from(free: int) -> None:
    """Means, standard deviations and 90 % intervals, within four of their standard errors."""
    rng = np.random.default_rng(free)
    root = np.tril(rng.normal(size=(free, free))) + 2 * np.eye(free)

    def log_density(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.sum(np.linalg.solve(root, x.T) ** 2, axis=0)

    drawn, size = [], 0.0
    for seed in range(4):
        places = 3 * rng.standard_normal((2000, free)) @ root.T
        found = walk(log_density, places, walkers=256, most_steps=4000, seed=seed, room=2000)
        drawn.append(np.linalg.solve(root, found.flat.T).T)
        size += 256 * 0.5 * found.steps / found.times.max()
    z = np.concatenate(drawn)
    np.testing.assert_allclose(z.mean(axis=0), 0.0, atol=4 / np.sqrt(size))
    np.testing.assert_allclose(z.std(axis=0), 1.0, atol=4 / np.sqrt(2 * size))
    np.testing.assert_allclose(np.mean(np.abs(z) < 1.645, axis=0), 0.9, atol=4 * np.sqrt(0.09 / size))


def test_two_modes_have_their_weights() -> None:
    """Three times as much on the right; ten standard deviations apart, with places in both."""

    def log_density(x: np.ndarray) -> np.ndarray:
        left, right = (-0.5 * np.sum((x - middle) ** 2, axis=1) for middle in (-5.0, 5.0))
        return np.logaddexp(left, np.log(3.0) + right)

    places = np.random.default_rng(0).uniform(-8, 8, size=(2000, 2))
    found = walk(log_density, places, walkers=128, most_steps=5000, seed=1, room=2000)
    right = found.flat[:, 0] > 0
    assert right.mean() == pytest.approx(0.75, abs=0.05)
    np.testing.assert_allclose(found.flat[right].std(axis=0), 1.0, atol=0.05)
