"""The contest of optimisers, on a problem whose minimum is known."""

import math

import numpy as np
import pytest

from benchmarks import contest, optimisers
from yeastfit import PARAMETERS, FitSettings, Observable, Targets
from yeastfit.inference.fit.response_surface import response_surface
from yeastfit.inference.parameter_space import ParameterSpace


class Straight:
    """A simulator whose means are affine in log λ of mobility and aspect ratio, and do not scatter."""

    parameters = PARAMETERS.subset(("mobility", "aspect_ratio"))
    observables = tuple(Observable(name, time) for name in ("radius", "area") for time in (1.0, 2.0))

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        assert len(values) == len(seeds)
        return 100.0 + (np.log(values) - MIDDLE) @ SLOPES.T


SLOPES = np.array([[20.0, 5.0], [-5.0, 30.0], [10.0, 10.0], [0.0, -20.0]])
MIDDLE = np.log([1.3, 0.65])


@pytest.fixture
def straight() -> contest.Contest:
    targets = Targets.from_means({"radius": [100.0, 100.0], "area": [100.0, 100.0]}, [1.0, 2.0])
    simulator = Straight()
    space = ParameterSpace.of(simulator.parameters)

    def simulate(points: np.ndarray) -> np.ndarray:
        return simulator(np.exp(points), np.zeros(len(points)))

    surface = response_surface(simulate, MIDDLE, np.full(2, 0.2), 64, 0)
    found = surface.minimise(np.eye(4), targets.values[None])
    best, least = found.theta[0], float(found.chi_square[0])
    return contest.Contest(targets, simulator, space, FitSettings(), np.eye(4), surface, best, least)


def test_what_judges_knows_the_minimum_and_the_rise_around_it(straight: contest.Contest) -> None:
    np.testing.assert_allclose(straight.best, MIDDLE, atol=1e-3)
    away = np.array([0.05, -0.02])
    assert straight.rise(straight.best + away) == pytest.approx(np.sum((SLOPES @ away) ** 2), rel=0.02)
    assert straight.rise(straight.best + 0.3) == math.inf
    assert straight.directly(straight.best, 8) == pytest.approx(straight.least, abs=1e-2)


def test_differences_are_the_derivatives_in_z_and_are_counted(straight: contest.Contest) -> None:
    objective = contest.Objective(straight, members=8, seed=1, budget=1000)
    z = straight.space.z_of(np.log([3.0, 0.4]))
    objective.residuals(z)
    slope = straight.space.slope(straight.space.theta_of(z))
    np.testing.assert_allclose(objective.differences(z), SLOPES * slope, rtol=0.1, atol=0.1)
    assert objective.spent == 8 * (1 + 2)


@pytest.mark.parametrize("name", contest.ALTERNATIVES)
def test_an_alternative_arrives_is_counted_and_is_stopped_by_its_budget(name: str, straight: contest.Contest) -> None:
    size, start = optimisers.Size(members=8), np.log([3.0, 0.4])
    done, again = (optimisers.alternative(straight, size, name, 1, start, 4000.0) for _ in range(2))
    assert done["arrived"]
    assert done["colonies"] == again["colonies"]
    assert done["colonies"] % 8 == 0
    assert straight.rise(np.array(done["theta"])) < contest.MARGIN
    short = optimisers.alternative(straight, size, name, 1, start, done["colonies"] - 8.0)
    assert not short["arrived"]
    assert short["colonies"] < done["colonies"]
    assert "not within" in short["ended"]


def test_a_run_that_did_not_arrive_took_longer_than_all_others() -> None:
    runs = [{"colonies": count, "arrived": count < 900} for count in (300, 500, 400, 900, 900)]
    assert optimisers.median(runs) == 500
    assert optimisers.median([*runs, *runs[-1:]]) == math.inf


def test_starts_side_by_side_are_paid_for_until_the_first_arrives() -> None:
    """Of three seeds: 2 × 300, 2 × 500, and one that no start brings there."""
    spent = {1: ((300, True), (900, False)), 2: ((700, True), (500, True)), 3: ((900, False), (900, False))}
    runs = [
        {"seed": seed, "colonies": colonies, "seconds": colonies / 20, "arrived": arrived}
        for seed, starts in spent.items()
        for colonies, arrived in starts
    ]
    assert optimisers.side_by_side(runs) == 1000
    assert optimisers.side_by_side(runs, "seconds") == 50
    assert optimisers.side_by_side(runs[:2]) == 600
    assert optimisers.side_by_side(runs[4:]) == math.inf
