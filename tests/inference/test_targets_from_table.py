"""Targets from the table of `yeastfit measure`, with its masks and without."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yeastfit import Imaging, InputError, Targets, measure_dataset, read_dataset
from yeastfit.commands.measured_source import measure_source
from yeastfit.inference.imaging import SMOOTHING, SPACING
from yeastfit.inference.targets_from_table import targets_in_hours, targets_of
from yeastfit.measure.measurements_table import OF_ANYTHING, TABLE, conditions_of, read_measurements
from yeastfit.measure.statistics import registry
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.progress import silent

DEMO = Path(__file__).parents[2] / "data" / "synthetic" / "demo"
FILES = [(f"colony{colony:02}_{hours:04.1f}h.tif", colony, hours) for colony in (1, 2) for hours in (6, 8)]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two colonies at two times, photographed."""
    folder = tmp_path_factory.mktemp("data")
    lines = ["file,replicate,hours,um_per_pixel"]
    for name, colony, hours in FILES:
        shutil.copy(DEMO / "images" / name, folder / name)
        lines.append(f"{name},{colony},{hours},0.75")
    (folder / "manifest.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def measured(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `yeastfit measure` leaves."""
    folder = tmp_path_factory.mktemp("measured")
    found = measure_source(data, folder, 1, silent)
    assert len(found.rows) == 4
    assert found.inputs[0].name == "manifest.csv"
    return folder


def imaging_of(targets: Targets) -> Imaging:
    assert targets.imaging is not None
    return targets.imaging


def same(one: Targets, other: Targets) -> None:
    for name in ("times", "mean", "scatter", "replicates", "curves"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)
    first, second = imaging_of(one), imaging_of(other)
    assert one.names == other.names
    assert replace(first, extent=None) == replace(second, extent=None)
    assert first.extent == pytest.approx(second.extent, rel=1e-6)


def test_the_table_gives_the_targets_of_the_data_set(data: Path, measured: Path) -> None:
    dataset = read_dataset(data)
    direct = Targets.from_dataset(dataset, measure_dataset(dataset))
    for others, said in ((measure_dataset(dataset)[::-1], "image 1 is .*, that of"), ([], "image 1 is missing, that")):
        with pytest.raises(InputError, match=f"measured: {said} .*: give what measure_dataset returns"):
            Targets.from_dataset(dataset, others)
    rows = read_measurements(measured / TABLE)
    assert conditions_of(rows) == ("",)
    found = targets_of(rows, measured)
    seen = imaging_of(found)
    assert (seen.estimator, seen.spacing, seen.smoothing) == ("smooth", SPACING, SMOOTHING)
    assert found.mean.shape == (2, 2)
    assert (found.replicates == 2).all()
    same(found, direct)


def test_a_table_without_its_masks_goes_to_the_mask_estimator(measured: Path, tmp_path: Path) -> None:
    shutil.copy(measured / TABLE, tmp_path / TABLE)
    rows = read_measurements(tmp_path / TABLE)
    found = targets_of(rows, tmp_path, statistics=("compactness", "area"))
    seen = imaging_of(found)
    assert (seen.estimator, seen.smoothing) == ("mask", 0.0)
    assert seen.spacing == pytest.approx(0.75 / seen.scales.length)
    means = [
        [np.mean([row[name] for row in rows if row["hours"] == hours]) for hours in (6, 8)] for name in found.names
    ]
    np.testing.assert_allclose(found.mean, np.array(means) / [[1.0], [seen.scales.length**2]], rtol=1e-9)
    beside = targets_of(read_measurements(measured / TABLE), measured, statistics=("outer_compactness",))
    assert imaging_of(beside).estimator == "mask"  # the masks are there, but the smooth estimator does not know this


def test_a_folder_or_its_table_is_read_as_it_is(measured: Path, tmp_path: Path) -> None:
    for source in (measured, measured / TABLE):
        found = measure_source(source, tmp_path, 1, silent)
        assert found.folder == measured
        assert found.inputs[0] == measured / TABLE
        assert sorted(found.inputs[1:]) == sorted((measured / "masks").iterdir())
        assert len(found.rows) == 4
    assert not list(tmp_path.iterdir())


def test_conditions_are_told_apart(measured: Path) -> None:
    rows = read_measurements(measured / TABLE)
    split = [{**row, "condition": "rich" if row["replicate"] == rows[0]["replicate"] else "poor"} for row in rows]
    assert set(conditions_of(split)) == {"rich", "poor"}
    assert (targets_of(split, measured, condition="poor").replicates == 1).all()
    for chosen, message in ((None, "targets are of one: choose"), ("none", "condition: got 'none', there are")):
        with pytest.raises(InputError, match=message):
            targets_of(split, measured, condition=chosen)


def written(rows: list[dict[str, Any]], path: Path) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def raw(measured: Path) -> list[dict[str, Any]]:
    with (measured / TABLE).open(newline="") as file:
        return list(csv.DictReader(file))


def test_missing_masks_are_named_for_they_change_the_estimator(measured: Path, tmp_path: Path) -> None:
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    assert measure_source(tmp_path, tmp_path, 1, silent).warnings == []
    gone = sorted((tmp_path / "masks").iterdir())[1]
    gone.unlink()
    rows = [{**row, "condition": "rich" if row["replicate"] == "1" else "poor"} for row in raw(tmp_path)]
    found = measure_source(written(rows, tmp_path / TABLE), tmp_path, 1, silent)
    (warning,) = found.warnings
    assert warning.startswith(f"1 of 2 masks of condition 'rich' are missing (masks/{gone.name}): its curves are")
    targets = [targets_of(found.rows, found.folder, condition=name) for name in ("rich", "poor")]
    assert [imaging_of(each).estimator for each in targets] == ["mask", "smooth"]
    unnamed = written([{**row, "mask": ""} for row in rows[:1]], tmp_path / TABLE)
    assert f"(that of {rows[0]['file']})" in measure_source(unnamed, tmp_path, 1, silent).warnings[0]


def test_tables_that_are_none_are_refused_in_words(measured: Path, tmp_path: Path) -> None:
    rows = raw(measured)
    with pytest.raises(InputError, match=r"nowhere\.csv: no table"):
        read_measurements(tmp_path / "nowhere.csv")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(InputError, match=r"empty\.csv: no rows"):
        read_measurements(tmp_path / "empty.csv")
    short = [{name: value for name, value in row.items() if name not in ("hours", "mask")} for row in rows]
    with pytest.raises(InputError, match="no column hours, mask, need the measurements"):
        read_measurements(written(short, tmp_path / "short.csv"))
    short = [{name: value for name, value in row.items() if name != "max_radius"} for row in rows]
    with pytest.raises(InputError, match="no column max_radius, need the measurements"):
        read_measurements(written(short, tmp_path / "short.csv"))
    odd = [*rows[:2], {**rows[2], "area": "large"}]
    with pytest.raises(InputError, match="line 4: area is 'large', it must be a number"):
        read_measurements(written(odd, tmp_path / "odd.csv"))


def test_rows_that_no_fit_can_use_are_refused_in_words(measured: Path, tmp_path: Path) -> None:
    rows = read_measurements(written([{**row, "hours": ""} for row in raw(measured)], tmp_path / TABLE))
    with pytest.raises(InputError, match=r"colony01_06\.0h\.tif: its hours are unknown"):
        targets_of(rows, measured)
    rows = read_measurements(written([{**row, "um_per_pixel": ""} for row in raw(measured)], tmp_path / TABLE))
    with pytest.raises(
        InputError,
        match=r"colony01_06\.0h\.tif: um_per_pixel is empty in the table, it must be a number from 0\.001 to 1000 µm",
    ):
        targets_of(rows, measured)
    rows = read_measurements(measured / TABLE)
    for twice in ([{**row, "replicate": ""} for row in rows], [*rows, {**rows[0], "file": "again.tif"}]):
        with pytest.raises(InputError, match=r"at 6 hours appears twice, colony01_06\.0h\.tif is of it, too"):
            targets_of(twice, measured)
    with pytest.raises(InputError, match=r"colony01_06\.0h\.tif: its replicate is empty, others have one"):
        targets_of([{**rows[0], "replicate": ""}, *rows[1:]], measured)
    with pytest.raises(InputError, match="'colour' is not in the table, which has"):
        targets_of(rows, measured, statistics=("colour",))
    sizes = [{**row, "um_per_pixel": row["um_per_pixel"] * (1 + 0.1 * k)} for k, row in enumerate(rows)]
    with pytest.raises(InputError, match=r"um_per_pixel runs from 0\.75 to 0\.975: statistics of masks depend on it"):
        targets_of(sizes, tmp_path)


def test_numbers_that_are_not_those_of_the_masks_are_refused(measured: Path, tmp_path: Path) -> None:
    """A table that was edited, beside its masks; without them its numbers are taken."""
    rows = read_measurements(measured / TABLE)
    edited = [{**row, "compactness": 1.5 * row["compactness"]} for row in rows]
    with pytest.raises(InputError, match=r"colony01_06\.0h\.tif: compactness is .* in the table, its mask .* has "):
        targets_of(edited, measured)
    np.testing.assert_allclose(
        targets_of(edited, tmp_path).mean[0], 1.5 * targets_of(rows, tmp_path).mean[0], rtol=1e-12
    )
    assert targets_of(edited, measured, statistics=("radius",)).names == ("radius",)


def test_a_statistic_without_any_number_is_named(measured: Path, tmp_path: Path) -> None:
    rows = [{**row, "compactness": np.nan} for row in read_measurements(measured / TABLE)]
    with pytest.raises(InputError, match="'compactness' has no number in any of the 4 rows: leave it out"):
        targets_of(rows, tmp_path)


def test_a_quantity_of_no_shape_is_read_from_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Registered without a form; one that is not in the table is named beside those that are."""
    monkeypatch.setitem(registry.STATISTICS, "od", Statistic("od", unit_power=0, meaning="optical density"))
    (tmp_path / TABLE).write_text("file,replicate,hours,od\na,1,2,0.1\nb,1,4,0.3\n")
    rows = read_measurements(tmp_path / TABLE, OF_ANYTHING)
    targets = targets_in_hours(rows, statistics=("od",))
    assert targets.names == ("od",)
    np.testing.assert_allclose(targets.mean, [[0.1, 0.3]])
    assert "od" not in registry.names_with("mask", "smooth", "nodes")
    with pytest.raises(InputError, match="'area' is not in the table, which has od"):
        targets_in_hours(rows, statistics=("area",))
