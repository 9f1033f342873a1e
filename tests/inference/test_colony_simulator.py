"""Colonies as a simulator: their dish, their room, how they are measured, and what they run into."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import pytest
from helpers import on_one_device

from yeastfit import PARAMETERS, ColonySimulator, Imaging, InputError, Resolution, Targets
from yeastfit.inference.colony_simulator import MARGIN
from yeastfit.inference.simulator import fixed_of, member_seeds, named_values, names_of
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import PROBLEMS
from yeastfit.model.mechanisms.clock_births import ClockBirths
from yeastfit.model.mechanisms.walker_medium import WalkerBirths, WalkerMedium
from yeastfit.model.model import Model

HERE = np.array([[PARAMETERS["mobility"].default]])
COARSE = Resolution(dt=0.02, spacing=0.25)
FREE = ("mobility",)


def targets(names: tuple[str, ...], times: list[float], missing: bool = False, **how: Any) -> Targets:
    """Of means 1; the second is missing where that is asked for."""
    means = {name: np.ones(len(times)) for name in names}
    if missing:
        means[names[0]][1] = np.nan
    return Targets.from_means(means, times, imaging=Imaging(2.0, **how))


def test_a_dish_is_wide_enough_and_has_room_for_every_cell() -> None:
    made = ColonySimulator.of(targets(("radius",), [1.5, 3.2]), FREE, resolution=COARSE)
    assert made.curves.numerics.domain >= 2 * (1.3 * 2.0 + MARGIN)
    assert made.curves.numerics.capacity == 2**4
    assert isinstance(made.curves.observe, SmoothStatistics)
    roomy = ColonySimulator.of(targets(("radius",), [1.5, 3.2]), FREE, resolution=Resolution(0.02, 0.25, 64))
    assert roomy.curves.numerics.capacity == 64
    far = ColonySimulator.of(targets(("radius",), [20.0]), FREE, resolution=COARSE)
    assert far.curves.numerics.capacity is None


def test_a_capacity_is_a_limit_and_no_length_of_arrays() -> None:
    """Colonies that cannot come to it have room for what they can; those that could grow in arrays as they need."""
    limit = Resolution(0.02, 0.25, 20_000)
    short = ColonySimulator.of(targets(("radius",), [1.5, 3.2]), FREE, resolution=limit).curves
    assert short.numerics.capacity == 2**4
    assert not short.unlimited
    far = ColonySimulator.of(targets(("radius",), [20.0]), FREE, resolution=limit).curves
    assert far.numerics.capacity == 20_000
    assert far.unlimited
    cut = ColonySimulator.of(targets(("radius",), [20.0]), FREE, resolution=Resolution(0.02, 0.25, 100)).curves
    assert cut.numerics.capacity == 100
    assert not cut.unlimited


def test_a_colony_beyond_the_capacity_is_cut_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """As those of any time are, which grow from room for six nodes."""
    for room in ("simulation.simulate", "inference.colony_simulator", "inference.colony_curves"):
        monkeypatch.setattr(f"yeastfit.{room}.SHORT", 1)
    monkeypatch.setattr("yeastfit.simulation.simulate.FIRST_ROOM", 6)
    made = ColonySimulator.of(targets(("cell_count",), [1.5, 4.2]), FREE, resolution=Resolution(0.02, 0.25, 9))
    with on_one_device():
        rows = made(np.repeat(HERE, 2, axis=0), member_seeds(0, 2))
    np.testing.assert_array_equal(rows[:, 1], 8.0)  # an edge fewer than nodes
    assert dict(made.problems) == {PROBLEMS["capacity_reached"]: 2}


@pytest.mark.parametrize(
    ("names", "estimator", "devices"),
    [
        pytest.param(("radius",), "smooth", nullcontext, marks=pytest.mark.thorough),
        pytest.param(("radius",), "mask", on_one_device, marks=pytest.mark.thorough),
        pytest.param(("area", "compactness"), "smooth", on_one_device, marks=pytest.mark.thorough),
        (("area", "compactness"), "mask", on_one_device),
    ],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_colonies_that_could_outgrow_one_program_are_the_same_and_not_cut(
    names: tuple[str, ...],
    estimator: str,
    devices: Callable[[], AbstractContextManager[None]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By rows of different parameters; with room for eight nodes at first, as those of any time grow."""
    data = targets(names, [1.5, 3.2], estimator=estimator)
    values, seeds = np.array([[1.0], [3.0]]), member_seeds(0, 2)
    small = ColonySimulator.of(data, FREE, resolution=COARSE)(values, seeds)
    monkeypatch.setattr("yeastfit.simulation.simulate.SHORT", 1)
    monkeypatch.setattr("yeastfit.inference.colony_simulator.SHORT", 1)
    monkeypatch.setattr("yeastfit.inference.colony_curves.SHORT", 1)
    monkeypatch.setattr("yeastfit.simulation.simulate.FIRST_ROOM", 8)
    grown = ColonySimulator.of(data, FREE, resolution=COARSE)
    assert grown.curves.numerics.capacity is None
    with devices():
        rows = grown(values, seeds)
    np.testing.assert_allclose(rows, small, rtol=2e-3)
    assert not grown.problems


@pytest.mark.thorough
def test_there_is_room_for_births_at_any_step() -> None:
    """Colonies that bud by clocks double every ln 2; those that eat walkers may at every step."""
    clocks, walkers = Model(births=ClockBirths()), Model(births=WalkerBirths(), medium=WalkerMedium())
    made = ColonySimulator.of(targets(("radius",), [1.5, 3.2]), FREE, {"metabolic_rate": 0.01}, COARSE, clocks)
    assert made.curves.numerics.capacity == 2**6
    assert np.isfinite(made(np.tile(HERE, (8, 1)), member_seeds(0, 8))).all()
    assert not any("births were cut" in problem for problem in made.problems)
    made = ColonySimulator.of(targets(("radius",), [1.5]), FREE, resolution=COARSE, model=walkers)
    assert made.curves.numerics.capacity is None


def test_times_closer_than_a_step_are_refused() -> None:
    for times in ([1.0, 1.01], [0.01, 1.0]):
        with pytest.raises(InputError, match=r"hours at dt = 0\.02: give a smaller dt"):
            ColonySimulator.of(targets(("radius",), times), FREE, resolution=COARSE)


def test_targets_without_imaging_are_refused() -> None:
    heights = Targets.from_means({"height": [1.0, 2.0]}, [0.0, 1.0])
    with pytest.raises(InputError, match="targets have no imaging"):
        ColonySimulator.of(heights, FREE)


def test_resolutions_are_checked() -> None:
    for name in ("dt", "spacing"):
        with pytest.raises(InputError, match=f"{name} is 0, it must be a number (from|above)"):
            Resolution(**{name: 0})
    for wrong in (0, 1):
        with pytest.raises(InputError, match=f"capacity is {wrong}, it must be a whole number of nodes, at least 2"):
            Resolution(capacity=wrong)


def test_free_and_held_parameters_are_told_in_the_order_of_the_model() -> None:
    made = ColonySimulator.of(targets(("radius",), [1.5]), ("aspect_ratio", "mobility"), {"elasticity": 3.0}, COARSE)
    assert made.parameters.names == ("mobility", "aspect_ratio")
    assert names_of(made) == PARAMETERS.names
    assert fixed_of(made)["elasticity"] == 3.0
    assert "mobility" not in fixed_of(made)
    values = named_values(made, [2.0, 0.6])
    assert tuple(values) == PARAMETERS.names
    assert (values["mobility"], values["aspect_ratio"], values["elasticity"]) == (2.0, 0.6, 3.0)


def test_a_held_parameter_may_be_zero() -> None:
    made = ColonySimulator.of(targets(("radius",), [1.5]), FREE, {"diffusivity": 0.0}, COARSE)
    logs = made.logarithms(np.ones((1, 1)))[0]
    assert logs[PARAMETERS.names.index("diffusivity")] == -np.inf
    assert logs[PARAMETERS.names.index("mobility")] == 0.0


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("estimator", "names"),
    [("smooth", ("radius", "cell_count")), ("mask", ("outer_compactness", "area", "cell_count"))],
)
def test_measured_points_of_colonies_are_columns(estimator: str, names: tuple[str, ...]) -> None:
    made = ColonySimulator.of(targets(names, [1.1, 2.1], missing=True, estimator=estimator), FREE, resolution=COARSE)
    seeds = member_seeds(0, 3)
    rows = made(np.repeat(HERE, 3, axis=0), seeds)
    assert rows.shape == (3, 2 * len(names) - 1) == (3, len(made.observables))
    assert np.isfinite(rows).all()
    assert not made.problems
    assert isinstance(made.curves.observe, HardStatistics if estimator == "mask" else SmoothStatistics)
    np.testing.assert_array_equal(rows[:, -1], 7.0)  # cells at 2.1: 1, 3, 7, as every node buds once in a unit of time
    np.testing.assert_array_equal(made(HERE, seeds[1:2])[0], rows[1])


@pytest.mark.thorough
def test_what_colonies_run_into_is_counted_once_each() -> None:
    """A copy that fills up a batch is no further colony."""
    made = ColonySimulator.of(targets(("radius",), [3.2]), FREE, resolution=Resolution(0.02, 0.25, 4))
    made(np.repeat(HERE, 3, axis=0), member_seeds(0, 2)[[0, 1, 1]])
    assert made.problems[PROBLEMS["capacity_reached"]] == 2
