"""A statistic is added by its entry alone: everything that names statistics then knows it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types
from jaxtyping import Array
from own_statistics import SIDE, STEPS, side_of_pixels
from PIL import Image

from yeastfit import (
    STATISTICS,
    Imaging,
    InputError,
    Numerics,
    Parameters,
    Statistic,
    Targets,
    member_keys,
    plot,
    register_statistic,
    sensitivity,
    simulate,
)
from yeastfit.commands import app
from yeastfit.commands.measure_batch import measure_batch
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.resolution import COARSE
from yeastfit.inference.targets_from_table import targets_of
from yeastfit.measure import HardStatistics, Indicator, measure_mask
from yeastfit.measure.measurements_table import read_measurements
from yeastfit.measure.reading.batch_inputs import find_images
from yeastfit.measure.statistics.registry import (
    OTHER_COLUMNS,
    RECORDED,
    Estimator,
    known_statistics,
    measurement_errors,
    recorded,
    registered,
    title_of,
)
from yeastfit.measure.statistics.smooth_statistics import measure_mask_smoothly, smooth_shape
from yeastfit.report.files.measurement_files import OWN_COLUMNS

ESTIMATORS: tuple[tuple[Estimator, float], ...] = (("smooth", 0.01), ("mask", 1e-12))
SMALL = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=8)


@pytest.fixture
def own() -> Iterator[None]:
    """Two statistics of a user's."""
    register_statistic(SIDE)
    register_statistic(STEPS)
    yield
    for name in ("side", "steps"):
        del STATISTICS[name]


def write_squares(folder: Path, count: int, side: int = 30) -> Path:
    """Masks of a square."""
    folder.mkdir()
    for k in range(count):
        Image.fromarray(np.pad(np.full((side, side), 255, np.uint8), 20)).save(folder / f"{k}.png")
    return folder


# --- the package's own -----------------------------------------------------------------------------------------------


def test_entries_are_what_the_tables_before_them_said() -> None:
    """Which were written down one by one in several places. A further statistic changes nothing of it."""
    assert recorded("smooth") == RECORDED[:7]
    assert recorded("mask") == RECORDED
    assert known_statistics("smooth")[:6] == ("compactness", "radius", "mean_radius", "cell_count", "area", "perimeter")
    incomparable = {name for name, entry in STATISTICS.items() if not entry.comparable}
    assert incomparable >= {"centroid_x", "centroid_y", "growth_rate", "overlap_area"}
    assert set(known_statistics("mask")) == set(STATISTICS) - incomparable
    assert measurement_errors().items() >= {"compactness": 0.02, "outer_compactness": 0.02}.items()
    assert {name for name, entry in STATISTICS.items() if entry.may_vanish} >= {
        *("hole_count", "filament_area", "filament_area_index", "filament_radius_index", "branch_count"),
        *("branch_length", "radial_index", "angular_index", "wave_number", "fractal_dimension"),
    }
    assert title_of("radius") == "radius, mean distance from centroid (L0)"
    assert title_of("filament_area") == "filament area (L0²)"
    assert title_of("size_of_something") == "size of something"
    assert registered() == ()


def test_names_are_not_those_of_other_columns() -> None:
    assert set(OWN_COLUMNS) < set(OTHER_COLUMNS)
    assert not set(STATISTICS) & set(OTHER_COLUMNS)


@pytest.mark.parametrize(
    ("means", "extent"),
    [
        ({"max_radius": 5.0, "radius": 3.0}, 6.0),
        ({"mean_radius": 2.0, "area": np.pi, "radius": 3.0}, 10.0),
        ({"mean_radius": 2.0, "area": 100.0}, 7.0),
        ({"area": 4 * np.pi, "compactness": 2.0}, 7.0),
    ],
)
def test_how_far_colonies_reach(means: dict[str, float], extent: float) -> None:
    """Once the largest radius, three times a mean one, or three times that of the disc of the same area; and 1 L0."""
    curves = {name: np.array([value]) for name, value in means.items()}
    assert Imaging(estimator="mask").reaching(curves).extent == pytest.approx(extent, rel=1e-15)


# --- one's own -------------------------------------------------------------------------------------------------------


def test_masks_and_simulations_have_it(own: None) -> None:
    assert registered() == (SIDE, STEPS)
    square = measure_mask(np.ones((20, 20)), 0.5)
    assert square.side == 10.0
    assert list(square)[-1] == "side"
    run = simulate(Parameters(), member_keys(0, 2), times=[1.5, 2.5], numerics=SMALL)
    np.testing.assert_allclose(run.statistics["side"], np.sqrt(run.statistics["area"]), rtol=1e-6)
    np.testing.assert_array_equal(run.statistics["steps"], [[75, 125], [75, 125]])
    row = run.rows()[-1]
    assert row["side_um"] == pytest.approx(7.5 * row["side"])
    assert "steps_um" not in row
    titles = [axes.get_title() for axes in plot.curves(run).axes]
    assert {"side (L0)", "steps done"} < set(titles)
    hard = HardStatistics(4.0, 0.5).finish({"mask": np.ones((2, 1, 6, 6), bool), "steps": np.ones((2, 1))})
    np.testing.assert_array_equal(hard["side"], [[3.0], [3.0]])
    np.testing.assert_array_equal(hard["steps"], 1.0)


@pytest.mark.parametrize("estimator", ["smooth", "mask"])
def test_fits_may_name_it(own: None, estimator: Estimator) -> None:
    means = {"side": [2.0], "compactness": [1.5], "area": [4.0]}
    targets = Targets.from_means(means, [2.0], imaging=Imaging(estimator=estimator))
    assert targets.imaging is not None
    assert targets.imaging.extent == 9.0
    assert targets.measurement_errors() == {"side": 0.005, "compactness": 0.02, "area": 0.01}
    simulator = ColonySimulator.of(targets, resolution=COARSE)
    assert [str(one) for one in simulator.observables] == ["side at 2", "compactness at 2", "area at 2"]
    assert simulator.curves.observe.statistics == ("side", "compactness", "area")
    with pytest.raises(InputError, match=r"statistic 'steps' is unknown, expected some of compactness.*, side"):
        Targets.from_means({"steps": [2.0]}, [2.0], imaging=Imaging(3.0, estimator))


def test_sensitivities_may_name_it(own: None) -> None:
    with pytest.raises(InputError, match=r"statistics: got 'sides', need some of .*perimeter.* side"):
        sensitivity(times=[1.5], statistics=("side", "sides"), numerics=SMALL)


def test_measure_has_a_column_that_fits_can_read(own: None, undrawn: None, tmp_path: Path) -> None:
    """Of a square of 30 pixels of 1.5 µm: 45 µm, 6 L0; by both estimators."""
    folder, out = write_squares(tmp_path / "squares", 1), tmp_path / "out"
    (folder / "manifest.csv").write_text("file,replicate,hours,um_per_pixel\n0.png,1,5,1.5\n")
    assert app.run(["measure", str(folder), "--out", str(out), "--jobs", "1"]) == 0
    columns = json.loads((out / "columns.json").read_text())
    assert columns["side"] == {"unit": "µm", "meaning": "side of the square of the same area"}
    assert "side of the square of the same area" in (out / "index.html").read_text()
    assert [line.split(",")[2] for line in (out / "curves.csv").read_text().splitlines()][-1] == "side"
    rows = read_measurements(out / "measurements.csv")
    assert rows[0]["side"] == 45.0
    (smooth,), (exact,) = (
        targets_of(rows, out, statistics=("side",), estimator=how).values for how in ("smooth", "mask")
    )
    assert exact == pytest.approx(6.0, rel=1e-12)
    assert smooth == pytest.approx(6.0, rel=0.01)


def test_a_statistic_of_a_users_that_fails_is_named(tmp_path: Path) -> None:
    images, _, _ = find_images([write_squares(tmp_path / "masks", 1)], 1.0)
    register_statistic(Statistic("shapeless", 0, "fails", mask=lambda pixels: pixels.indices.shape[0]))  # type: ignore[attr-defined]
    try:
        (outcome,) = measure_batch(images, tmp_path / "out", jobs=1)
    finally:
        del STATISTICS["shapeless"]
    assert outcome.error is not None
    assert "statistic shapeless: its mask cannot be computed: AttributeError: 'tuple'" in outcome.error
    assert "(test_registry.py:" in outcome.error


def test_a_statistic_is_one_number(monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in (np.ones(2), "x", None):
        with wrong_types():
            monkeypatch.setitem(STATISTICS, "odd", Statistic("odd", 0, "no number", mask=lambda pixels, w=wrong: w))  # type: ignore[misc]
            with pytest.raises(InputError, match=r"statistic odd: its mask gives .*, need one number"):
                measure_mask(np.ones((3, 3), bool), 1.0, ["odd"])


@pytest.mark.usefixtures("unchecked")
def test_a_smooth_statistic_is_one_number(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong: Any
    for wrong, said in ((lambda one: one.distance, "an array of shape"), (lambda one: None, "None")):
        monkeypatch.setitem(STATISTICS, "odd", Statistic("odd", 0, "no number", smooth=wrong))
        with pytest.raises(InputError, match=f"statistic odd: its smooth gives {said}.*, need one number"):
            smooth_shape(jnp.ones((8, 8)), 0.5, 0.1, ("odd",))


def test_what_other_processes_cannot_import_is_measured_in_this_one(
    monkeypatch: pytest.MonkeyPatch, undrawn: None, tmp_path: Path
) -> None:
    monkeypatch.setitem(STATISTICS, "local", Statistic("local", 0, "a number", mask=lambda pixels: 1.5))
    images, _, _ = find_images([write_squares(tmp_path / "squares", 8)], 0.5)
    outcomes = measure_batch(images, tmp_path / "out", jobs=2)
    assert [outcome.row["local"] if outcome.row else None for outcome in outcomes] == [1.5] * 8


# --- refused ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"name": "area"}, r"statistic 'area': there is one of this name \(area\), choose another"),
        ({"name": "hours"}, "statistic 'hours': tables have a column of this name"),
        ({"name": "outer area"}, "name is 'outer area', it must be letters"),
        ({"unit_power": 3}, "statistic 'mine': unit_power is 3, it must be 0, 1 or 2"),
        ({"nodes": side_of_pixels}, "nodes is for what no image shows, leave out mask"),
        ({"mask": 3}, "statistic 'mine': mask is 3, it must be a function"),
        ({"measurement_error": -0.1}, "measurement_error is -0.1, it must be finite and at least 0"),
        ({"reach": 0.0}, "reach is 0.0, it is for lengths and areas, above 0"),
        ({"unit_power": 0, "reach": 1.0}, "reach is 1.0, it is for lengths and areas"),
    ],
    ids=lambda one: ",".join(one) if isinstance(one, dict) else "message",
)
def test_bad_entries_are_refused_in_words(changed: dict[str, Any], message: str) -> None:
    values: dict[str, Any] = {"name": "mine", "unit_power": 1, "meaning": "of mine", "mask": side_of_pixels}
    with wrong_types(), pytest.raises(InputError, match=message):
        register_statistic(Statistic(**{**values, **changed}))
    assert registered() == ()


def defined(factor: float, module: str = "a notebook") -> Statistic:
    """A statistic as a cell of a notebook defines it; its function is a new one each time."""

    def times_area(indicator: Indicator) -> Array:
        return factor * indicator.area

    times_area.__module__ = module
    return Statistic("mine", 2, "of mine", smooth=times_area)


def test_a_statistic_that_is_defined_anew_replaces_the_earlier_one() -> None:
    """Also in programs that are compiled already; one that is defined elsewhere does not."""
    found, mask = [], np.pad(np.ones((8, 8), dtype=bool), 4)
    try:
        for factor in (1.0, 3.0):
            register_statistic(defined(factor))
            found.append(measure_mask_smoothly(mask, 1.0, ("mine",), spacing=1.0, smoothing=0.0)["mine"])
        with pytest.raises(InputError, match=r"statistic 'mine': there is one of this name \(of mine\), choose"):
            register_statistic(defined(1.0, "elsewhere"))
    finally:
        del STATISTICS["mine"]
    np.testing.assert_allclose(found, [64.0, 192.0])
