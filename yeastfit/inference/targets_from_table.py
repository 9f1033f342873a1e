"""Targets from the table that `yeastfit measure` leaves, measurements.csv, and the masks beside it.

Where the masks are there and the statistics asked for are those of `SmoothStatistics`, masks and simulated colonies go
through the same smooth estimator. Otherwise the table's own numbers are taken, and simulated colonies are measured as
masks are, on pixels of the same size.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.imaging import SMOOTHING, SPACING, Imaging
from yeastfit.inference.targets import Targets
from yeastfit.measure.measurements_table import check_same_size, checked_rows, read_mask
from yeastfit.measure.statistics.registry import STATISTICS, Estimator, most_telling_first, names_in_tables, names_with
from yeastfit.measure.statistics.smooth_statistics import measure_mask_smoothly
from yeastfit.model.parameters import Scales
from yeastfit.numbers import Range

LARGEST_REACH = 10_000  # steps of the grid on which colonies are measured, from its middle to its edge
LEAST_REACH = 0.25  # L0: the largest colony of a condition is a cell at least
SMOOTH_DO_NOT = f", {', '.join(most_telling_first(names_with('smooth')))} with their masks do not"


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

    Arguments:
        rows: Of measurements.csv.
        folder: Where it lies, and masks with it.
        condition: Which; may be left out where there is one.
        statistics: Which curves.
        estimator: By default "smooth" where it has all the statistics and the masks are there, else "mask".
        scales: Of the species.

    Raises:
        InputError: The condition is not there, a row has no hours, a statistic is unknown or nowhere measured, a number
            of the table is not that of its mask, or masks for the estimator "mask" have different pixel sizes.
    """
    chosen, scales = checked_rows(rows, condition), scales or Scales()
    masks = [folder / str(row["mask"]) for row in chosen]
    smooth = all(name in names_with("smooth") for name in statistics) and all(mask.is_file() for mask in masks)
    estimator = estimator or ("smooth" if smooth else "mask")
    pixels = np.array([row["um_per_pixel"] for row in chosen], dtype=float) / scales.length
    if estimator == "smooth":
        values = [
            measure_mask_smoothly(read_mask(mask, row, statistics), float(pixel), spacing=SPACING, smoothing=SMOOTHING)
            for mask, row, pixel in zip(masks, chosen, pixels, strict=True)
        ]
        spacing, smoothing = SPACING, SMOOTHING
    else:
        check_same_size(chosen, SMOOTH_DO_NOT)
        values = [_in_lengths(row, statistics, scales) for row in chosen]
        spacing, smoothing = float(pixels.mean()), 0.0
    largest = max(chosen, key=lambda row: float(row["max_radius"]))
    reach = Range(LEAST_REACH * scales.length, LARGEST_REACH * spacing * scales.length, "µm")
    if (extent := float(largest["max_radius"])) not in reach:
        raise InputError(
            f"{largest['file']}: max_radius is {extent:g} µm, the largest of its condition, it must be {reach}, where "
            f"a cell is {scales.length:g} µm long: is um_per_pixel {largest['um_per_pixel']:g}?"
        )
    extent /= scales.length
    colonies, curves, hours = _by_replicate(chosen, values, statistics)
    imaging = Imaging(extent, estimator, spacing, smoothing, scales)
    return Targets.from_replicates(curves, scales.time(hours), imaging=imaging, colonies=colonies)


def targets_in_hours(
    rows: Sequence[Mapping[str, Any]], *, condition: str | None = None, statistics: Sequence[str]
) -> Targets:
    """Curves of one condition as the table has them, over hours and in µm. Raises `InputError` as `targets_of`."""
    chosen = checked_rows(rows, condition)
    values = [_in_lengths(row, statistics, Scales(length=1.0)) for row in chosen]
    colonies, curves, hours = _by_replicate(chosen, values, statistics)
    return replace(Targets.from_replicates(curves, hours, colonies=colonies), time_label="hours", length_unit="µm")


def _by_replicate(
    rows: Sequence[Mapping[str, Any]], values: Sequence[Mapping[str, float]], statistics: Sequence[str]
) -> tuple[list[str], dict[str, np.ndarray], np.ndarray]:
    """Names of the replicates, curves [replicate, time], nan where there is no image, and hours.

    Raises:
        InputError: A statistic has no number in any row.
    """
    hours = sorted({float(row["hours"]) for row in rows})
    replicates = list(dict.fromkeys(str(row["replicate"]) for row in rows))
    curves = {name: np.full((len(replicates), len(hours)), np.nan) for name in statistics}
    for row, value in zip(rows, values, strict=True):
        for name in statistics:
            curves[name][replicates.index(str(row["replicate"])), hours.index(float(row["hours"]))] = value[name]
    check_some(curves, len(rows))
    return replicates, curves, np.array(hours)


def check_some(curves: Mapping[str, np.ndarray], rows: int) -> None:
    """Raise `InputError` for a statistic that has no number in any of so many rows."""
    for name, curve in curves.items():
        if not np.isfinite(curve).any():
            raise InputError(f"statistics: {name!r} has no number in any of the {rows} rows: leave it out")


def _in_lengths(row: Mapping[str, Any], statistics: Sequence[str], scales: Scales) -> dict[str, float]:
    """A row's statistics in L0 and L0²."""
    for name in statistics:
        if name not in names_in_tables() or name not in row:
            known = ", ".join(name for name in names_in_tables() if name in row) or "no registered statistic"
            raise InputError(f"statistics: {name!r} is not in the table, which has {known}")
    return {name: float(row[name]) / scales.length ** STATISTICS[name].unit_power for name in statistics}
