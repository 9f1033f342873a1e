"""Targets from the table that `yeastfit measure` leaves, measurements.csv, and the masks beside it.

Where the masks are there and the statistics asked for are those of `SmoothStatistics`, masks and simulated colonies go
through the same smooth estimator. Otherwise the table's own numbers are taken, and simulated colonies are measured as
masks are, on pixels of the same size.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.imaging import SMOOTHING, SPACING, Imaging
from yeastfit.inference.targets import Targets
from yeastfit.measure.reading.images import read_image
from yeastfit.measure.statistics.registry import STATISTICS, Estimator, most_telling_first, names_with
from yeastfit.measure.statistics.smooth_statistics import measure_mask_smoothly
from yeastfit.model.parameters import Scales

TABLE = "measurements.csv"
NEEDED = ("file", "condition", "replicate", "hours", "um_per_pixel", "mask", "max_radius")
SAME_SIZE = 0.02  # relative difference of pixel sizes within which masks are taken for equally fine


def table_in(source: Path) -> Path:
    """The table itself, or the one in a folder; whether there is one or not."""
    return source / TABLE if source.is_dir() else source


def files_of(table: Path, rows: Sequence[Mapping[str, Any]]) -> list[Path]:
    """A table and those of its masks that are there."""
    masks = [table.parent / str(row["mask"]) for row in rows]
    return [table, *(mask for mask in masks if mask.is_file())]


def read_measurements(path: str | Path) -> list[dict[str, Any]]:
    """Rows of a measurements.csv, numbers as numbers, nan where a cell is empty.

    Raises `InputError` for a table without the columns of `yeastfit measure`, and for a cell that is no number.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: no table ({error}), need the {TABLE} of `yeastfit measure`") from None
    missing = [name for name in NEEDED if not rows or name not in rows[0]]
    if missing:
        what = f"no column {', '.join(missing)}" if rows else "no rows"
        raise InputError(f"{path}: {what}, need the {TABLE} of `yeastfit measure`")
    numbers = [name for name in rows[0] if name in names_with("mask") or name in ("hours", "um_per_pixel")]
    for line, row in enumerate(rows, start=2):
        for name in numbers:
            try:
                row[name] = float(row[name]) if row[name] else math.nan
            except (TypeError, ValueError):
                raise InputError(f"{path}, line {line}: {name} is {row[name]!r}, it must be a number") from None
    return rows


def targets_of(
    rows: Sequence[Mapping[str, Any]],
    folder: Path,
    *,
    condition: str | None = None,
    statistics: Sequence[str] = ("compactness", "radius"),
    estimator: Estimator | None = None,
    scales: Scales | None = None,
) -> Targets:
    """Curves of one condition's colonies, lengths in L0.

    rows: of measurements.csv, `folder` where it lies. condition: which; may be left out where there is one. estimator:
    by default "smooth" where it knows all the statistics and the masks are there, else "mask". Raises `InputError` for
    a condition that is not there, rows without hours, and masks of different pixel sizes for the estimator "mask".
    """
    chosen, scales = rows_of(rows, condition), scales or Scales()
    for row in chosen:
        hours = row["hours"]
        if not (isinstance(hours, int | float) and math.isfinite(hours) and hours > 0):
            raise InputError(f"{row['file']}: its hours are unknown, a fit needs them: measure a data set")
        for name in ("um_per_pixel", "max_radius"):
            if not (math.isfinite(row[name]) and row[name] > 0):
                raise InputError(f"{row['file']}: {name} is {row[name]:g}, it must be a number above 0")
    _refuse_twice(chosen)
    masks = [folder / str(row["mask"]) for row in chosen]
    smooth = all(name in names_with("smooth") for name in statistics) and all(mask.is_file() for mask in masks)
    estimator = estimator or ("smooth" if smooth else "mask")
    pixels = np.array([row["um_per_pixel"] for row in chosen], dtype=float) / scales.length
    if estimator == "smooth":
        values = [
            measure_mask_smoothly(read_image(mask) > 0, float(pixel), spacing=SPACING, smoothing=SMOOTHING)
            for mask, pixel in zip(masks, pixels, strict=True)
        ]
        spacing, smoothing = SPACING, SMOOTHING
    else:
        if np.ptp(pixels) > SAME_SIZE * pixels.max():
            low, high = pixels.min() * scales.length, pixels.max() * scales.length
            raise InputError(
                f"um_per_pixel runs from {low:g} to {high:g}: statistics of masks depend on it, "
                f"{', '.join(most_telling_first(names_with('smooth')))} with their masks do not"
            )
        values = [_in_lengths(row, statistics, scales) for row in chosen]
        spacing, smoothing = float(pixels.mean()), 0.0
    extent = max(float(row["max_radius"]) for row in chosen) / scales.length
    hours = sorted({float(row["hours"]) for row in chosen})
    replicates = list(dict.fromkeys(row["replicate"] for row in chosen))
    curves = {name: np.full((len(replicates), len(hours)), np.nan) for name in statistics}
    for row, value in zip(chosen, values, strict=True):
        for name in statistics:
            curves[name][replicates.index(row["replicate"]), hours.index(float(row["hours"]))] = value[name]
    times = scales.time(np.array(hours))
    return Targets.from_replicates(curves, times, imaging=Imaging(extent, estimator, spacing, smoothing, scales))


def conditions_of(rows: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """In order of appearance."""
    return tuple(dict.fromkeys(str(row["condition"] or "") for row in rows))


def rows_of(rows: Sequence[Mapping[str, Any]], condition: str | None) -> list[Mapping[str, Any]]:
    """Of one condition, which may be left out where there is one. Raises `InputError`."""
    there = conditions_of(rows)
    known = ", ".join(map(repr, there))
    if condition is None and len(there) > 1:
        raise InputError(f"condition: there are {known}, targets are of one: choose")
    if condition is not None and condition not in there:
        raise InputError(f"condition: got {condition!r}, there are {known}")
    return [row for row in rows if condition is None or str(row["condition"] or "") == condition]


def _refuse_twice(rows: Sequence[Mapping[str, Any]]) -> None:
    """Raises `InputError` where two rows are of one colony at one time."""
    first: dict[tuple[str, float], str] = {}
    for row in rows:
        key = (str(row["replicate"] or ""), float(row["hours"]))
        if key in first:
            raise InputError(
                f"{row['file']}: replicate {key[0]!r} at {key[1]:g} hours stands twice, {first[key]} is of it, too: "
                "every colony needs a replicate of its own"
            )
        first[key] = str(row["file"])


def _in_lengths(row: Mapping[str, Any], statistics: Sequence[str], scales: Scales) -> dict[str, float]:
    """A row's statistics in L0 and L0²."""
    for name in statistics:
        if name not in names_with("mask") or name not in row:
            known = ", ".join(name for name in names_with("mask") if name in row)
            raise InputError(f"statistics: {name!r} is not in the table, which has {known}")
    return {name: float(row[name]) / scales.length ** STATISTICS[name].unit_power for name in statistics}
