"""Response surfaces, on curves whose answer is known."""

import numpy as np
import pytest

from yeastfit import InputError, SimulationError
from yeastfit.inference.fit.response_surface import response_surface

CENTRE, REACH = np.array([0.1, -0.4]), np.array([0.5, 0.3])
SLOPES = np.array([[1.0, 0.2], [0.5, -1.0], [0.3, 0.8], [-0.2, 0.4]])
NOISE = np.array([0.2, 0.1, 0.1, 0.3])


def quadratic(theta: np.ndarray) -> np.ndarray:
    away = theta - CENTRE
    return 5 + away @ SLOPES.T + 0.3 * np.sum(away**2, axis=1, keepdims=True) + 0.2 * away[:, :1] * away[:, 1:]


def linear(theta: np.ndarray) -> np.ndarray:
    return 5 + (theta - CENTRE) @ SLOPES.T


def test_a_quadratic_surface_is_recovered_exactly() -> None:
    surface = response_surface(quadratic, CENTRE + 0.05, REACH, 64, seed=0)
    for point in CENTRE + np.array([[0.2, -0.05], [-0.4, 0.2], [0.0, 0.0]]):
        np.testing.assert_allclose(surface.mean(point), quadratic(point[None])[0], atol=1e-9)
    assert np.abs(surface.scatter.covariance).max() < 1e-20
    assert surface.scatter.freedom == 64 - 6


def test_errors_of_the_mean_and_scatter_are_those_of_repetitions() -> None:
    """100 surfaces with known noise tell a variance to 14 %, and their 400 pulls their width to 4 %."""
    point, pulls, scatter = CENTRE + np.array([0.3, -0.2]), [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)

        def grow(x: np.ndarray, rng: np.random.Generator = rng) -> np.ndarray:
            return quadratic(x) + NOISE * rng.normal(size=(len(x), 4))

        surface = response_surface(grow, CENTRE, REACH, 64, seed)
        away = surface.mean(point) - quadratic(point[None])[0]
        pulls.append(away / np.sqrt(np.diag(surface.mean_covariance(point))))
        scatter.append(surface.scatter.covariance)
    assert np.std(pulls) == pytest.approx(1.0, abs=0.12)
    np.testing.assert_allclose(np.mean(scatter, axis=0), np.diag(NOISE**2), atol=0.06 * 0.09)


def test_minima_of_many_data_sets_are_found_at_once() -> None:
    surface = response_surface(quadratic, CENTRE, REACH, 64, seed=0)
    truths = CENTRE + REACH * np.random.default_rng(0).uniform(-0.8, 0.8, (20, 2))
    found = surface.minimise(np.diag(NOISE), quadratic(truths))
    np.testing.assert_allclose(found.theta, truths, atol=2e-3)
    assert found.chi_square.max() < 1e-2
    assert found.converged.all()


def test_the_minimum_stays_in_the_box() -> None:
    surface = response_surface(linear, CENTRE, REACH, 64, seed=0)
    found = surface.minimise(np.eye(4), linear(CENTRE + np.array([[3.0, 0.0]])))
    assert (np.abs(found.theta - CENTRE) <= REACH * (1 + 1e-6)).all()
    assert found.theta[0, 0] == pytest.approx(CENTRE[0] + REACH[0], abs=5e-3)


def test_with_priors_and_without_the_minimum_is_the_closed_form() -> None:
    surface = response_surface(linear, CENTRE, REACH, 64, seed=0)
    values = linear(CENTRE + np.array([[0.1, 0.05]])) + np.array([0.05, -0.02, 0.03, 0.1])
    weight, aim, pull = np.diag(NOISE**-2), CENTRE + np.array([0.0, -0.1]), np.array([0.0, 20.0])
    for precision in (np.zeros(2), pull):
        curvature = SLOPES.T @ weight @ SLOPES + np.diag(precision**2)
        expected = np.linalg.solve(curvature, SLOPES.T @ weight @ (values[0] - 5) + precision**2 * (aim - CENTRE))
        found = surface.minimise(np.diag(NOISE), values, centre=aim, pull=precision)
        np.testing.assert_allclose(found.theta[0] - CENTRE, expected, atol=1e-3)


def test_a_held_entry_stays_and_the_other_follows() -> None:
    surface = response_surface(linear, CENTRE, REACH, 64, seed=0)
    values = np.tile(linear(CENTRE[None]), (3, 1))
    held = CENTRE[0] + np.array([-0.3, 0.0, 0.2])
    found = surface.minimise(np.eye(4), values, held=(0, held))
    np.testing.assert_allclose(found.theta[:, 0], held, atol=1e-6)
    ratio = -(SLOPES[:, 0] @ SLOPES[:, 1]) / (SLOPES[:, 1] @ SLOPES[:, 1])
    np.testing.assert_allclose(found.theta[:, 1], CENTRE[1] + ratio * (held - CENTRE[0]), atol=1e-3)
    rest = SLOPES[:, 0] + ratio * SLOPES[:, 1]
    np.testing.assert_allclose(found.chi_square, (held - CENTRE[0]) ** 2 * (rest @ rest), atol=1e-3)


def test_minima_that_the_optimiser_did_not_reach_are_told() -> None:
    surface = response_surface(quadratic, CENTRE, REACH, 64, seed=0)
    values = quadratic(CENTRE + REACH * np.array([[0.0, 0.0], [0.7, -0.7]]))
    found = surface.minimise(np.diag(NOISE), values, max_steps=2)
    assert found.converged.tolist() == [True, False]
    assert found.chi_square[1] > 0.01


def test_too_few_simulations_and_simulations_that_came_to_nothing_are_refused() -> None:
    with pytest.raises(InputError, match="runs is 8: a quadratic surface in 2 parameters needs at least 12"):
        response_surface(linear, CENTRE, REACH, 8, seed=0)
    with pytest.raises(SimulationError, match="64 of 64 simulations around the estimate failed"):
        response_surface(lambda x: np.full((len(x), 4), np.nan), CENTRE, REACH, 64, seed=0)


def test_a_few_simulations_that_came_to_nothing_are_left_out() -> None:

    def torn(theta: np.ndarray) -> np.ndarray:
        return np.where(theta[:, :1] > CENTRE[0] + 0.4, np.nan, quadratic(theta))

    surface = response_surface(torn, CENTRE, REACH, 64, seed=0)
    np.testing.assert_allclose(surface.mean(CENTRE), quadratic(CENTRE[None])[0], atol=1e-9)
