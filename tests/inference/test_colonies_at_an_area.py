"""Colonies of the algebraic model that are compared at one area, whatever their age (`--match area`)."""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import on_one_device

from yeastfit import HARD, ColonySimulator, Imaging, InputError, Resolution, Targets, simulate
from yeastfit.inference.colony_simulator import NOT_COME, TOO_FAST, colony_simulator_of
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.simulator import member_seeds
from yeastfit.measure.measurements_table import read_measurements
from yeastfit.measure.outlining.outline_errors import COLONY_ERRORS, OUTLINE_ERRORS
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import HardStatistics, mask_of
from yeastfit.model.parameters import Parameters
from yeastfit.seeds import keys_of

COARSE, AREA, PIXEL = Resolution(dt=0.02, spacing=0.25), 20.0, 0.1
VALUES = np.array([[1.0], [4.0]])
REAL = Path(__file__).parents[2] / "data" / "real" / "awri796-50um" / "measurements.csv"


def simulator(time: float = 20.0, area: float | None = AREA, **how: Any) -> ColonySimulator:
    """Of area and compactness on pixels of 0.1 L0, by default with free mobility."""
    imaging = Imaging(6.0, "mask", PIXEL)
    targets = Targets.from_means({"area": np.ones(1), "compactness": np.ones(1)}, [time], imaging=imaging)
    free, resolution = how.pop("free", ("mobility",)), how.pop("resolution", COARSE)
    return ColonySimulator.of(targets, free, resolution=resolution, area=area, **how)


@pytest.mark.thorough
def test_they_are_measured_when_they_come_to_it() -> None:
    """The numbers of `simulate` until that area, measured on the mask of its last step."""
    made = simulator()
    with on_one_device():
        rows = made(VALUES, member_seeds(3, 2))
    numerics = made.curves.numerics
    pixels = HardStatistics(numerics.domain, numerics.spacing, ("area",))
    logs = jnp.asarray(made.logarithms(VALUES), jnp.float32)  # as it takes them, to the last bit
    for row, log, seed in zip(rows, logs, member_seeds(3, 2), strict=True):
        parameters, key = Parameters.from_array(made.names, jnp.exp(log)), keys_of(np.array([seed]))[0]
        how: dict[str, Any] = {"numerics": numerics, "relaxation": HARD, "observe": pixels}
        grown = simulate(parameters, key, times=[20.0], until={"area": AREA}, **how)
        points = round(made.curves.observe.extent / PIXEL) + 1
        mask = mask_of(grown.colony, parameters, HARD, PIXEL * (points - 1), points)
        found = measure_mask(mask, PIXEL, ("area", "compactness"))
        np.testing.assert_allclose(row, [found["area"], found["compactness"]], rtol=1e-6)
        assert 0.9 * AREA < row[0] < 1.2 * AREA
    assert not made.problems


def test_those_whose_nutrient_cannot_be_solved_have_no_values() -> None:
    """Single colonies scatter beyond a prior, whose largest diffusivity is checked; others of a call are as before."""
    made = simulator(free=("diffusivity",))
    most = 8.0 * made.curves.numerics.spacing**2 / made.curves.numerics.dt
    values, seeds = np.array([[0.1], [most * 1.01], [most * (1 - 1e-6)], [1e6]]), member_seeds(0, 4)
    with on_one_device():
        rows, alone = made(values, seeds), simulator(free=("diffusivity",))(values[:1], seeds[:1])
    np.testing.assert_array_equal(np.isnan(rows).any(axis=1), [False, True, False, True])
    assert dict(made.problems) == {TOO_FAST.format(most=most): 2}
    np.testing.assert_array_equal(rows[0], alone[0])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("time", "resolution"), [(1.0, COARSE), (20.0, Resolution(0.02, 0.25, 8))], ids=["time", "room"]
)
def test_those_that_do_not_come_to_it_have_no_values(time: float, resolution: Resolution) -> None:
    made = simulator(time, resolution=resolution)
    with on_one_device():
        rows = made(VALUES, member_seeds(0, 2))
    assert np.isnan(rows).all()
    assert made.problems[NOT_COME.format(area=AREA)] == 2


def test_what_has_all_its_nodes_grows_no_further() -> None:
    """It can come to nothing: its births would be cut."""
    made = simulator(resolution=Resolution(0.02, 0.25, 8))
    with on_one_device():
        parameters = Parameters.from_array(made.names, jnp.exp(jnp.asarray(made.logarithms(VALUES), jnp.float32)))
        colonies, whole = made.curves.grown_to_area(parameters, keys_of(member_seeds(0, 2)))
    assert not whole.any()
    assert (np.asarray(colonies.count) == 8).all()
    assert (np.asarray(colonies.step) * made.curves.numerics.dt < 6.0).all()


def test_other_processes_make_the_same() -> None:
    made = simulator()
    arguments = made.specification.arguments
    other = colony_simulator_of(**{**arguments, "measured": arguments["measured"].tolist()})
    with on_one_device():
        np.testing.assert_array_equal(other(VALUES[:1], member_seeds(0, 1)), made(VALUES[:1], member_seeds(0, 1)))


def test_outlines_are_those_of_that_area() -> None:
    made = simulator()
    with on_one_device():
        masks = made.outlines(VALUES, 20.0, 1)
    assert [mask.sum() * 0.05**2 for mask in masks] == pytest.approx([AREA, AREA], rel=0.2)


def test_it_is_asked_of_masks_at_one_time() -> None:
    imaging = Imaging(6.0, "smooth")
    targets = Targets.from_means({"radius": np.ones(1)}, [20.0], imaging=imaging)
    with pytest.raises(InputError, match=r"area is 20, .* they have 1 and 'smooth'"):
        ColonySimulator.of(targets, ("mobility",), resolution=COARSE, area=AREA)


def test_the_model_takes_the_mean_area_of_the_last_images() -> None:
    rows = read_measurements(REAL)
    early = [{**row, "hours": 100.0, "area": 1e4} for row in rows]
    names = ("filament_area_index", "compactness")
    seen = Algebraic(match="area").seen([*rows, *early], REAL.parent, None, names)
    assert isinstance(seen.model, Algebraic)
    area = float(np.mean([row["area"] for row in rows]))
    assert seen.model.area == area
    assert seen.targets.times == pytest.approx([233.0 * 0.46])
    assert seen.targets.replicates.tolist() == [[8], [8]]
    assert "8 images before the last one of their colony are left out" in " ".join(seen.notes)
    colonies = seen.model.simulator(seen.targets, ("mobility",), {})
    assert isinstance(colonies, ColonySimulator)
    assert colonies.curves.area == pytest.approx(area / 7.5**2)
    errors = seen.model.measurement_errors(seen.targets.names, None)
    assert errors == {name: OUTLINE_ERRORS[name] for name in names}
    assert seen.model.measurement_errors(seen.targets.names, 0.01) == dict.fromkeys(names, 0.01)
    assert seen.model.colony_errors(names, None) == {name: COLONY_ERRORS[name] for name in names}
    for none in (seen.model.colony_errors(names, 0.01), Algebraic().colony_errors(names, None)):
        assert none == dict.fromkeys(names, 0.0)
    smaller = Algebraic(match="area", area=1e5).seen(rows, REAL.parent, None, names)
    assert isinstance(smaller.model, Algebraic)
    assert smaller.model.area == 1e5
    assert seen.targets.imaging is not None
    assert smaller.targets.imaging is not None
    assert seen.targets.imaging.extent is not None
    assert smaller.targets.imaging.extent == pytest.approx(seen.targets.imaging.extent * (1e5 / area) ** 0.5)
    assert "of about 51000 cells" in " ".join(seen.notes)
    assert "cells of 7.5 µm" not in " ".join(smaller.notes)


@pytest.mark.parametrize(
    ("area", "message"),
    [(None, "'area' is not in the table"), (np.nan, "s01.tif: area is nan, and colonies are compared at their mean")],
)
def test_an_area_that_is_not_known_is_named(area: float | None, message: str) -> None:
    rows = [{name: value for name, value in row.items() if name != "area"} for row in read_measurements(REAL)]
    if area is not None:
        rows = [{**row, "area": area} for row in rows]
    for model in (Algebraic(match="area"), Offlattice()):
        with pytest.raises(InputError, match=message):
            model.seen(rows, REAL.parent, None, ("compactness",))


def test_what_does_not_suit_is_refused() -> None:
    with pytest.raises(InputError, match="area is 100000 and match time: it is for match area, leave it out"):
        Algebraic(area=1e5)
    with pytest.raises(InputError, match=r"area is 3\.0, it must be a number of at least"):
        Algebraic(match="area", area=3.0)
    with pytest.raises(InputError, match="'area' is what simulated colonies are matched to"):
        Algebraic(match="area").check_images([], ("area", "compactness"))
