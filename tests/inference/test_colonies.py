"""Simulated colonies of a fit: their size, their room, and the estimator that measures them."""

from typing import Any

import numpy as np
import pytest

from yeastfit import InputError, Parameters, Targets, member_keys
from yeastfit.inference.colonies import MARGIN, Colonies
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.parameters import NAMES

LOGS = np.log([[float(getattr(Parameters(), name)) for name in NAMES]])
HOW: dict[str, Any] = {"dt": 0.02, "spacing": 0.25}


def targets(estimator: str, names: tuple[str, ...], times: list[float]) -> Targets:
    means = {name: np.ones(len(times)) for name in names}
    return Targets.from_means(means, times, extent=2.0, estimator=estimator)  # type: ignore[arg-type]


def test_a_dish_is_wide_enough_and_has_room_for_every_cell() -> None:
    made = Colonies.of(targets("smooth", ("radius",), [1.5, 3.2]), **HOW)
    assert made.curves.numerics.domain >= 2 * (1.3 * 2.0 + MARGIN)
    assert made.curves.numerics.capacity == 2**4
    assert isinstance(made.curves.observe, SmoothStatistics)
    assert Colonies.of(targets("smooth", ("radius",), [1.5, 3.2]), **HOW, capacity=64).curves.numerics.capacity == 64
    far = Colonies.of(targets("smooth", ("radius",), [20.0]), **HOW)
    assert far.curves.numerics.capacity == 4096


def test_times_closer_than_a_step_are_refused() -> None:
    for times in ([1.0, 1.01], [0.01, 1.0]):
        with pytest.raises(InputError, match=r"must be at least dt = 0\.02 apart: lower dt"):
            Colonies.of(targets("smooth", ("radius",), times), **HOW)


@pytest.mark.parametrize(
    ("estimator", "names"),
    [("smooth", ("radius", "cell_count")), ("mask", ("outer_compactness", "area", "cell_count"))],
)
def test_measured_points_of_colonies_are_grown_and_counted(estimator: str, names: tuple[str, ...]) -> None:
    made = Colonies.of(targets(estimator, names, [1.1, 2.1]), **HOW)
    made.measured[1] = False
    keys = member_keys(0, 3)
    curves = made.grow(np.repeat(LOGS, 3, axis=0), keys)
    assert curves.shape == (3, 2 * len(names) - 1)
    assert np.isfinite(curves).all()
    assert made.grown == 3
    assert not made.problems
    assert isinstance(made.curves.observe, HardStatistics if estimator == "mask" else SmoothStatistics)
    np.testing.assert_array_equal(
        curves[:, -1], 7.0
    )  # cells at 2.1: 1, 3, 7, as every node buds once in a unit of time
    np.testing.assert_array_equal(made.grow(LOGS, keys[1:2])[0], curves[1])
    made.grow(np.repeat(LOGS, 3, axis=0), keys[np.array([0, 1, 1])])
    assert made.grown == 3 + 1 + 2, "a copy that fills up a batch is no further colony"


def test_what_colonies_run_into_is_counted() -> None:
    made = Colonies.of(targets("smooth", ("radius",), [3.2]), **HOW, capacity=4)
    made.grow(np.repeat(LOGS, 2, axis=0), member_keys(0, 2))
    assert made.problems["capacity_reached"] == 2
