"""Coordinates that networks see: standardised, logits of shares, and their slopes against differences."""

import numpy as np
from scipy.special import expit

from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.posterior.prior import Prior

PRIOR = Prior.of(
    {
        "rate": {"distribution": "log-uniform", "low": 0.1, "high": 10.0},
        "share": {"distribution": "beta", "a": 2.0, "b": 5.0},
        "angle": {"distribution": "beta", "a": 2.0, "b": 2.0, "low": 10.0, "high": 30.0},
        "level": {"distribution": "uniform", "low": -1.0, "high": 2.0},
    }
)


def test_shares_are_seen_by_their_logit() -> None:
    plain = np.random.default_rng(0).normal(size=(400, 4))
    plain[:, 3] = np.tanh(plain[:, 3])
    low, width = 10.0, 20.0
    columns = np.exp(plain[:, 0] / 2), expit(plain[:, 1]), low + width * expit(plain[:, 2]), plain[:, 3]
    values = np.stack(columns, axis=1)
    coordinates = Coordinates.of(PRIOR, values)
    expected = (plain - plain.mean(axis=0)) / plain.std(axis=0)
    np.testing.assert_allclose(coordinates.of_values(values), expected, rtol=1e-9, atol=1e-9)
    edges = np.array([[1.0, 0.0, 30.0, 0.0], [1.0, 1.0, 10.0, 0.0]])
    assert np.isfinite(coordinates.of_values(edges)).all()


def test_slopes_are_those_of_the_coordinates() -> None:
    values = PRIOR.sample(50, np.random.default_rng(1))
    coordinates, step = Coordinates.of(PRIOR, values), 1e-6
    for k in range(4):
        moved = values.copy()
        moved[:, k] += step
        found = (coordinates.of_values(moved) - coordinates.of_values(values))[:, k] / step
        np.testing.assert_allclose(found, coordinates.slopes(values)[:, k], rtol=1e-3)


def test_more_coordinates_are_trained_for_longer() -> None:
    assert [TrainingSettings().resolved(free).steps for free in (1, 3, 4, 5)] == [1000, 1000, 2000, 3000]
    assert TrainingSettings(steps=200).resolved(5).steps == 200
