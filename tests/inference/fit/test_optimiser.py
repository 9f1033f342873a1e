"""Steps of the optimisers, on residuals in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

from yeastfit.inference.fit.optimiser import Optimiser

METHODS = ("levenberg-marquardt", "dogleg", "bfgs")
A = np.random.default_rng(0).normal(size=(6, 3))
B = np.random.default_rng(1).normal(size=6)

Problem = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def linear(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return A @ z - B, A


def rosenbrock(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y = z
    return np.array([10 * (y - x**2), 1 - x]), np.array([[-20 * x, 10.0], [-1.0, 0.0]])


def walk(optimiser: Optimiser, problem: Problem, steps: int) -> list[tuple[np.ndarray, float, bool]]:
    """Points that were asked for, with r · r there and whether the step was taken."""
    seen = []
    for _ in range(steps):
        place = optimiser.trial
        residuals, jacobian = problem(place)
        seen.append((place, float(residuals @ residuals), optimiser.tell(residuals, jacobian)))
    return seen


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cautious", [False, True])
def test_the_first_point_is_the_start_and_the_best_is_kept(method: str, cautious: bool) -> None:
    optimiser = Optimiser(method, np.array([-1.2, 1.0]), 2, cautious)
    seen = walk(optimiser, rosenbrock, 25)
    np.testing.assert_allclose(seen[0][0], [-1.2, 1.0], rtol=1e-6)
    assert seen[0][2]
    best = min(cost for _, cost, _ in seen)
    assert optimiser.cost == pytest.approx(best)
    assert optimiser.cost == pytest.approx(float(np.sum(rosenbrock(np.asarray(optimiser.z, float))[0] ** 2)), rel=1e-3)
    assert optimiser.cost < 0.2 * seen[0][1]
    assert not optimiser.failure


@pytest.mark.parametrize("method", METHODS[:2])
def test_the_bottom_of_a_valley_is_found(method: str) -> None:
    optimiser = Optimiser(method, np.array([-1.2, 1.0]), 2)
    walk(optimiser, rosenbrock, 60)
    np.testing.assert_allclose(np.asarray(optimiser.z), [1.0, 1.0], atol=1e-2)


@pytest.mark.parametrize("method", METHODS)
def test_steps_that_make_it_worse_are_rejected_and_counted(method: str) -> None:
    def uphill(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residuals, jacobian = linear(z)
        return residuals + 100.0 * np.abs(z).sum(), jacobian  # whatever J says, 0 is the best place

    optimiser = Optimiser(method, np.zeros(3), 6)
    seen = walk(optimiser, uphill, 4)
    assert [taken for _, _, taken in seen] == [True, False, False, False]
    assert optimiser.rejected == 3
    np.testing.assert_array_equal(optimiser.z, 0.0)
    np.testing.assert_array_equal(optimiser.residuals, -B)


@pytest.mark.parametrize("method", METHODS)
def test_the_predicted_reduction_is_the_fall_of_a_linear_problem(method: str) -> None:
    start = np.array([1.0, -2.0, 0.5])
    optimiser = Optimiser(method, start, 6)
    optimiser.tell(*linear(optimiser.trial))
    least = np.sum((A @ np.linalg.lstsq(A, B, rcond=None)[0] - B) ** 2)
    assert optimiser.predicted_reduction == pytest.approx(optimiser.cost - least, rel=1e-5)
    walk(optimiser, linear, 30)
    assert optimiser.predicted_reduction < 0.05 * (optimiser.cost + 1.0)


def test_a_blind_column_promises_nothing() -> None:
    optimiser = Optimiser("levenberg-marquardt", np.zeros(3), 6)
    optimiser.tell(np.ones(6), np.zeros((6, 3)))
    assert optimiser.predicted_reduction == 0.0


def test_a_cautious_optimiser_begins_with_shorter_steps() -> None:
    lengths = []
    for cautious in (False, True):
        optimiser = Optimiser("levenberg-marquardt", np.zeros(3), 6, cautious)
        residuals, jacobian = linear(optimiser.trial)
        optimiser.tell(1e3 * residuals, 1e3 * jacobian)
        lengths.append(float(np.linalg.norm(optimiser.trial)))
    assert lengths[1] < lengths[0]
