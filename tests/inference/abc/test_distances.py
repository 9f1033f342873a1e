"""Distances and kernels on numbers done by hand."""

import numpy as np
import pytest
from helpers import wrong_types

from yeastfit import InputError
from yeastfit.inference.abc.distances import LiDistance, Mahalanobis, WeightedCurves, log_kernel
from yeastfit.inference.posterior.diagnostics import plain
from yeastfit.storage import as_json, from_json

OBSERVED = np.array([0.2, 0.5, 1.0])
SIMULATED = np.array([[0.2, 0.5, 1.0], [0.44, 0.5, 1.0], [0.2, 0.8, 2.0], [np.nan, 0.5, 1.0], [np.inf, 0.5, 1.0]])


def test_li_distance_by_hand() -> None:
    """0.24 / 1.2 = 0.2; √(0.2² + 0.5²) with 0.3 / 1.5 and 1 / 2."""
    expected = [0.0, 0.2 / 3, np.sqrt(0.04 + 0.25) / 3, np.inf, np.inf]
    np.testing.assert_allclose(LiDistance(OBSERVED)(SIMULATED), expected, atol=1e-15)


def test_li_distance_on_condition_of_the_area() -> None:
    distance = LiDistance(OBSERVED, area=1)
    simulated = np.array([[0.44, 0.5, 1.0], [0.44, 0.524, 1.0], [0.2, 0.476, 2.0], [0.2, 0.526, 1.0], [0.2, 0.47, 1.0]])
    expected = [0.1, 0.1, 0.25, np.inf, np.inf]
    np.testing.assert_allclose(distance(simulated), expected, atol=1e-15)
    assert np.isinf(distance(SIMULATED)[3:]).all()
    assert distance.area == 1
    for wrong in (3, -1):
        with pytest.raises(InputError, match="number of an observed area among 3"):
            LiDistance(OBSERVED, area=wrong)


def test_weighted_curves_by_hand() -> None:
    distance = WeightedCurves(OBSERVED, np.array([0.24, 0.1, 1.0]))
    np.testing.assert_allclose(distance(SIMULATED), [0, np.sqrt(1 / 3), np.sqrt(10 / 3), np.inf, np.inf], atol=1e-15)


def test_mahalanobis_is_that_of_the_inverse_covariance_and_blind_to_units() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    covariance, simulated = root @ root.T, rng.normal(size=(20, 3))
    apart = simulated - OBSERVED
    direct = np.sqrt(np.einsum("ni,ij,nj->n", apart, np.linalg.inv(covariance), apart))
    np.testing.assert_allclose(Mahalanobis(OBSERVED, covariance)(simulated), direct)
    units = np.array([1e-6, 1.0, 1e6])
    other = Mahalanobis(OBSERVED * units, covariance * np.outer(units, units))
    np.testing.assert_allclose(other(simulated * units), direct)
    assert np.isinf(other(SIMULATED)[3:]).all()


def test_mahalanobis_of_simulations_leaves_out_those_that_came_to_nothing() -> None:
    simulated = np.random.default_rng(1).normal(size=(50, 3))
    torn = np.vstack([simulated, SIMULATED[3:]])
    np.testing.assert_allclose(Mahalanobis.of(OBSERVED, torn).covariance, np.cov(simulated.T))
    one = Mahalanobis.of(OBSERVED[:1], simulated[:, :1])
    np.testing.assert_allclose(one(simulated[:, :1]), np.abs(simulated[:, 0] - 0.2) / simulated[:, 0].std(ddof=1))


def test_distances_are_told_apart_by_plain_data() -> None:
    one = np.ones(3)
    distances = (LiDistance(one), WeightedCurves(one, 2 * one), Mahalanobis(one, np.eye(3)))
    found = from_json(as_json([plain(each) for each in distances]))
    assert found[1] == {"kind": "WeightedCurves", "observed": [1.0, 1.0, 1.0], "scale": [2.0, 2.0, 2.0]}
    assert [each["kind"] for each in found] == ["LiDistance", "WeightedCurves", "Mahalanobis"]


def test_kernels() -> None:
    distance = np.array([0.0, 0.5, 1.0, 1.5, np.inf])
    inf = np.inf
    np.testing.assert_array_equal(log_kernel("indicator", distance, 1.0), [0, 0, 0, -inf, -inf])
    np.testing.assert_allclose(log_kernel("gaussian", distance, 0.5), [0, -0.5, -2, -4.5, -inf])
    for kernel in ("indicator", "gaussian"):
        np.testing.assert_array_equal(log_kernel(kernel, distance, inf), [0, 0, 0, 0, -inf])


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(InputError, match=r"observed is .*nan.*, it must be finite"):
        LiDistance(np.array([0.1, np.nan]))
    with pytest.raises(InputError, match="observed holds -2, this distance is one of statistics above"):
        LiDistance(np.array([0.1, -2.0]))
    with pytest.raises(InputError, match=r"scale is .* it needs 3 values above 0"):
        WeightedCurves(OBSERVED, np.array([1.0, 0.0, 1.0]))
    with wrong_types(), pytest.raises(InputError, match="simulated has 2 statistics, observed has 3"):
        LiDistance(OBSERVED)(np.zeros((4, 2)))
    with pytest.raises(
        InputError,
        match=r"covariance: .* of 3 statistics is .*, it must be above 1e-10: estimate it",
    ):
        Mahalanobis(OBSERVED, np.ones((3, 3)))
    with pytest.raises(InputError, match="statistic 1 does not vary"):
        Mahalanobis(OBSERVED, np.diag([1.0, 0.0, 1.0]))
    with wrong_types(), pytest.raises(InputError, match=r"covariance has shape \(2, 2\), it must be symmetric, 3 by 3"):
        Mahalanobis(OBSERVED, np.eye(2))
    with pytest.raises(InputError, match=r"simulated holds 3 data sets .* needs at least 4"):
        Mahalanobis.of(OBSERVED, SIMULATED)
