"""Regression adjustment: its map to the line, and what it leaves alone."""

import numpy as np
import pytest

from yeastfit.infer.adjustment import adjusted, from_line, to_line
from yeastfit.infer.priors import Prior

INF = np.inf


@pytest.mark.parametrize(
    "ends", [(0.2, 5.0), (0.0, 1.0), (-2.0, 3.0), (0.0, INF), (0.5, INF), (-INF, 4.0), (-INF, INF)]
)
def test_the_line_and_back(ends: tuple[float, float]) -> None:
    values = np.linspace(max(ends[0], -5.0), min(ends[1], 9.0), 50)[1:-1]
    u = to_line(values, *ends)
    np.testing.assert_allclose(from_line(u, *ends), values, rtol=1e-12)
    assert (np.diff(u) > 0).all()
    far = from_line(np.array([-50.0, 50.0]), *ends)
    assert ((far >= ends[0]) & (far <= ends[1])).all()


def test_ends_of_the_support_are_finite_on_the_line() -> None:
    assert np.isfinite(to_line(np.array([0.0, 1.0]), 0.0, 1.0)).all()
    assert np.isfinite(to_line(np.array([0.2, 5.0]), 0.2, 5.0)).all()


def test_a_straight_line_is_taken_out_whatever_the_units() -> None:
    prior = Prior.of({"a": {"law": "log-normal", "median": 1.0, "sd": 1.0}})
    rng = np.random.default_rng(0)
    statistics, weights = rng.normal(size=(200, 2)) * [1e-6, 1e3], np.full(200, 1 / 200)
    values = 3.0 * np.exp(statistics @ [4e5, -2e-4])[:, None]
    found, near, said = adjusted(values, weights, statistics, rng.random(200), np.zeros(2), prior)
    np.testing.assert_allclose(found, 3.0, rtol=1e-9)
    assert near.sum() == pytest.approx(1.0)
    assert said == []


def test_a_statistic_that_never_varies_does_no_harm() -> None:
    prior = Prior.of({"a": {"law": "normal", "mean": 0.0, "sd": 1.0}})
    rng = np.random.default_rng(1)
    statistics = np.column_stack([rng.normal(size=100), np.full(100, 0.1)])
    values, weights = 2.0 * statistics[:, :1], np.full(100, 0.01)
    found, _, _ = adjusted(values, weights, statistics, rng.random(100), np.zeros(2), prior)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_draws_that_all_lie_at_no_distance_weigh_the_same() -> None:
    """A distance that leaves out a statistic, such as Li's with area, may be 0 throughout while that one varies."""
    prior = Prior.of({"a": {"law": "normal", "mean": 0.0, "sd": 1.0}})
    statistics = np.random.default_rng(1).normal(size=(100, 1))
    found, weights, said = adjusted(2 * statistics, np.full(100, 0.01), statistics, np.zeros(100), np.zeros(1), prior)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    np.testing.assert_allclose(weights, 0.01)
    assert said == []


def test_too_few_draws_are_left_as_they_were() -> None:
    prior = Prior.of({"a": {"law": "normal", "mean": 0.0, "sd": 1.0}})
    values, weights = np.arange(6.0)[:, None], np.full(6, 1 / 6)
    statistics = np.random.default_rng(2).normal(size=(6, 3))
    found, same, said = adjusted(values, weights, statistics, np.arange(6.0) / 6, np.zeros(3), prior)
    np.testing.assert_array_equal(found, values)
    np.testing.assert_array_equal(same, weights)
    assert said[0].startswith("not adjusted: 5 independent draws, a regression needs 16")
    nothing = adjusted(values, weights, statistics, np.full(6, 2.0), np.zeros(3), prior)
    assert nothing[2] == ["not adjusted: 0 independent draws, a regression needs 16"]
