"""Mean curves and their derivatives from pairs of colonies: the design, the estimates and their errors."""

from dataclasses import dataclass, replace

import jax
import numpy as np
import pytest
from jaxtyping import Array

from yeastfit import SimulationError
from yeastfit.inference.paired_regression import (
    LocalModel,
    Scatter,
    hadamard_design,
    hadamard_order,
    paired_points,
    pooled_covariance,
    reaches,
    regress,
    regress_averaged,
    sample_scatter,
)
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.simulation.simulate import member_keys


@pytest.mark.parametrize("free", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("seed", range(3))
def test_columns_of_the_design_are_orthogonal(free: int, seed: int) -> None:
    units = hadamard_design(32, free, np.random.default_rng(seed))
    assert units.shape == (32, free)
    assert (np.abs(units) == 1).all()
    np.testing.assert_array_equal(units.T @ units, 32 * np.eye(free))


@dataclass(frozen=True)
class Toy:
    """Curves of known slope, with curvature, interactions, noise of their own, and noise that a key brings."""

    slopes: np.ndarray
    own: float
    shared: float = 0.0

    def members(self, z: np.ndarray, keys: Array) -> np.ndarray:
        away, count = np.asarray(z, float), len(self.slopes)
        bent = 3.0 * away.sum(axis=1) ** 2 + 2.0 * away[:, 0] * away[:, 1]
        of_key = np.random.default_rng(int(jax.random.key_data(keys)[0, 1])).normal(size=(len(away), count))
        seed = int(abs(1e6 * away[0]).sum()) + int(jax.random.key_data(keys)[0, 1]) + int(away[0, 0] > 0)
        own = np.random.default_rng(seed).normal(size=(len(away), count))
        return away @ self.slopes.T + bent[:, None] + self.shared * of_key + self.own * own


def pairs_of(toy: Toy, pairs: int, seed: int = 0) -> LocalModel:
    keys, units = member_keys(seed, pairs), hadamard_design(pairs, 7, np.random.default_rng(seed))
    halves = np.split(paired_points(np.zeros(7), units, 0.2), 2)
    return regress(np.concatenate([toy.members(half, keys) for half in halves]), units, 0.2)


def test_curvature_and_what_a_key_brings_cancel_within_a_pair() -> None:
    slopes = np.random.default_rng(0).normal(size=(3, 7))
    found = pairs_of(Toy(slopes, own=0.0, shared=5.0), 8)
    np.testing.assert_allclose(found.jacobian, slopes, atol=1e-6)


def test_errors_of_the_regression_are_those_of_many_repetitions() -> None:
    """σ / (spread √runs) each; 60 repetitions with 64 pairs tell their scatter to 3 %."""
    slopes = np.random.default_rng(0).normal(size=(3, 7))
    found = [pairs_of(Toy(slopes, own=1.0), 64, seed) for seed in range(60)]
    z = np.array([(f.jacobian - slopes) / f.error for f in found])
    assert z.std() == pytest.approx(1.0, abs=0.07)
    assert abs(z.mean()) < 0.1
    assert np.mean([f.error for f in found]) == pytest.approx(1.0 / (0.2 * np.sqrt(128)), rel=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize(("own", "shared"), [(1.0, 0.0), (0.3, 1.0), (0.0, 1.0)])
def test_scatter_is_that_of_one_colony_whatever_a_pair_has_in_common(own: float, shared: float) -> None:
    """Of one colony the variance is own² + shared²; 200 repetitions tell their mean to 1 or 2 %."""

    @dataclass(frozen=True)
    class Straight(Toy):
        def members(self, z: np.ndarray, keys: Array) -> np.ndarray:
            away = np.asarray(z, float)
            return super().members(z, keys) - (3.0 * away.sum(axis=1) ** 2 + 2.0 * away[:, 0] * away[:, 1])[:, None]

    toy = Straight(np.random.default_rng(0).normal(size=(2, 7)), own, shared)
    found = [pairs_of(toy, 32, seed) for seed in range(200)]
    parts = [(local.between_pairs, local.within_pairs) for local in found]
    assert {(common.freedom, apart.freedom) for common, apart in parts} == {(31, 32 - 7)}
    variance = own**2 + shared**2
    whole = np.mean([local.scatter.covariance for local in found], axis=0)
    np.testing.assert_allclose(whole, variance * np.eye(2), atol=0.06 * variance)
    np.testing.assert_allclose(
        np.mean([apart.covariance for _, apart in parts], axis=0), 0.5 * own**2 * np.eye(2), atol=0.03 * own**2 + 1e-9
    )


def test_parts_of_the_scatter_are_pooled_by_their_degrees_of_freedom() -> None:
    curves = np.array([[1.0, 2.0], [3.0, 2.0], [np.nan, 0.0], [2.0, 5.0]])
    alone = sample_scatter(curves)
    assert alone.freedom == 2
    np.testing.assert_allclose(alone.covariance, np.cov(curves[[0, 1, 3]].T))
    found = pooled_covariance(alone, Scatter(3 * np.eye(2), 6))
    np.testing.assert_allclose(found, (2 * alone.covariance + 6 * 3 * np.eye(2)) / 8)


@pytest.mark.parametrize(("within", "freedom"), [(0.0, 30), (1e-9, 30), (1.0, 60), (0.5, 30 * 1.5**2 / 1.25)])
def test_degrees_of_freedom_of_a_sum_are_those_of_the_parts_that_scatter(within: float, freedom: float) -> None:
    """ν₁ where the other part is 0, ν₁ + ν₂ where both are alike; the units of the statistics do not matter."""
    units = np.diag([1.0, 1e-3, 0.0])
    one, other = (Scatter(size * units @ np.ones((3, 3)) @ units, 30) for size in (1.0, within))
    assert Scatter.of_sum(one, other).freedom == pytest.approx(freedom)
    assert Scatter.of_sum(Scatter(np.zeros((2, 2)), 3), Scatter(np.zeros((2, 2)), 4)).freedom == 7


@pytest.mark.thorough
@pytest.mark.parametrize("shared", [0.0, 0.5, 2.0, 50.0])
def test_degrees_of_freedom_of_the_scatter_are_those_that_it_shows(shared: float) -> None:
    """For normal numbers the mean inverse is ν / (ν − p − 1) times the true one; 2000 repetitions tell it to 1 %."""
    pairs, count = 24, 4
    rng = np.random.default_rng(0)
    units = hadamard_design(pairs, 3, rng)

    def inflation() -> tuple[float, float]:
        common, own = shared * rng.normal(size=(pairs, count)), rng.normal(size=(2, pairs, count))
        found = regress(np.concatenate([common + one for one in own]), units, 0.2).scatter
        mean_inverse = (1.0 + shared**2) * np.trace(np.linalg.inv(found.covariance)) / count
        return mean_inverse, found.freedom / (found.freedom - count - 1)

    measured, stated = np.mean([inflation() for _ in range(2000)], axis=0)
    assert measured == pytest.approx(stated, rel=0.03)


def test_errors_of_the_regression_are_correlated_as_stated() -> None:
    """Three curves that repeat each other's noise, over 200 repetitions."""
    mix = np.array([[1.0, 0.8, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.0]])

    def grow(seed: int) -> LocalModel:
        rng = np.random.default_rng(seed)
        return regress(rng.normal(size=(64, 3)) @ mix, hadamard_design(32, 7, rng), 0.2)

    found = [grow(seed) for seed in range(200)]
    errors = np.concatenate([local.jacobian.T for local in found])
    stated = np.mean([local.within_pairs.correlation for local in found], axis=0)
    np.testing.assert_allclose(stated[:2, :2], np.corrcoef(errors[:, :2].T), atol=0.03)
    np.testing.assert_array_equal(stated[2], [0.0, 0.0, 1.0])


def test_curvature_shifts_the_mean_and_nothing_else() -> None:
    """m by ½ s² tr H, exactly where curves are quadratic and the design is orthogonal in pairs of columns."""
    rng, free, spread = np.random.default_rng(0), 3, 0.3
    slopes, hessian = rng.normal(size=(2, free)), rng.normal(size=(2, free, free))
    hessian = hessian + hessian.transpose(0, 2, 1)
    units = np.array(np.meshgrid(*[[-1.0, 1.0]] * free)).reshape(free, -1).T
    away = paired_points(np.zeros(free), units, spread)
    local = regress(4.0 + away @ slopes.T + 0.5 * np.einsum("pi,cij,pj->pc", away, hessian, away), units, spread)
    np.testing.assert_allclose(local.jacobian, slopes, atol=1e-12)
    np.testing.assert_allclose(local.mean, 4.0 + 0.5 * spread**2 * np.trace(hessian, axis1=1, axis2=2), atol=1e-12)


def test_linear_curves_are_found_exactly() -> None:
    slopes = np.random.default_rng(0).normal(size=(4, 7))
    units = hadamard_design(16, 7, np.random.default_rng(1))
    local = regress(2.0 + paired_points(np.zeros(7), units, 0.1) @ slopes.T, units, 0.1)
    np.testing.assert_allclose(local.jacobian, slopes, atol=1e-12)
    np.testing.assert_allclose(local.mean, 2.0, atol=1e-12)
    assert np.abs(local.scatter.covariance).max() < 1e-24
    assert local.error.max() < 1e-12


def test_pairs_go_no_farther_than_the_largest_value() -> None:
    """Down to an eighth of the spread; derivatives are exact all the same, where curves are linear."""
    share, values = Parameter("far", "f", "a share", (0.1, 1.0), 0.5, largest=1.0), np.array([0.5, 0.95, 0.99, 0.95])
    others = replace(share, name="close"), replace(share, name="closer"), replace(share, name="passed", exceeded=True)
    parameters = ParameterSet((share, *others))
    reach = reaches(parameters, values, 0.1)
    np.testing.assert_allclose(reach, [0.1, np.log(1 / 0.95), 0.1, 0.1], rtol=1e-8)
    slopes = np.random.default_rng(0).normal(size=(5, 4))
    units = hadamard_design(16, 4, np.random.default_rng(1))
    points = paired_points(np.log(values), units, reach)
    assert (np.exp(points[:, 1]) <= 1.0).all()
    local = regress(points @ slopes.T, units, reach)
    np.testing.assert_allclose(local.jacobian, slopes, atol=1e-10)


def test_models_of_points_with_other_reaches_are_averaged() -> None:
    slopes = np.random.default_rng(0).normal(size=(5, 2))
    units = hadamard_design(16, 2, np.random.default_rng(1))
    reach = [np.array([0.1, 0.1]), np.array([0.1, 0.04])]
    rows = [paired_points(np.zeros(2), units, one) @ slopes.T for one in reach]
    np.testing.assert_allclose(regress_averaged(rows, units, reach).jacobian, slopes, atol=1e-12)


def test_errors_of_the_mean_are_those_of_many_repetitions() -> None:
    """200 repetitions with noise that a pair shares in part."""
    units = hadamard_design(32, 2, np.random.default_rng(0))

    def grow(seed: int) -> LocalModel:
        shared, *own = np.random.default_rng(seed).normal(size=(3, 32, 2))
        return regress(np.concatenate([shared + one for one in own]), units, 0.1)

    found = [grow(seed) for seed in range(200)]
    stated = np.mean([local.mean_covariance for local in found], axis=0)
    np.testing.assert_allclose(stated, np.eye(2) * 1.5 / 32, atol=0.1 * 1.5 / 32)
    assert np.mean([local.mean**2 for local in found]) == pytest.approx(1.5 / 32, rel=0.25)


def test_pairs_that_came_to_nothing_are_left_out_until_most_do() -> None:
    slopes = np.random.default_rng(0).normal(size=(3, 2))
    units = hadamard_design(16, 2, np.random.default_rng(1))
    curves = paired_points(np.zeros(2), units, 0.1) @ slopes.T
    curves[:7, 1] = np.nan
    local = regress(curves, units, 0.1)
    assert local.pairs == 9
    np.testing.assert_allclose(local.jacobian, slopes, atol=1e-12)
    curves[20:25, 0] = np.inf
    with pytest.raises(SimulationError, match="9 of 16 pairs of simulations failed"):
        regress(curves, units, 0.1)


def test_pairs_that_do_not_tell_all_entries_apart_are_refused() -> None:
    units = hadamard_design(16, 3, np.random.default_rng(1))
    units[:, 2] = units[:, 0]
    with pytest.raises(SimulationError, match="16 pairs of simulations are too few for 3 parameters"):
        regress(np.zeros((32, 1)), units, 0.1)


@pytest.mark.parametrize(("free", "rows"), [(1, 2), (2, 4), (3, 4), (4, 8), (7, 8), (8, 16)])
def test_a_hadamard_matrix_has_a_column_for_each_entry(free: int, rows: int) -> None:
    assert hadamard_order(free) == rows > free
