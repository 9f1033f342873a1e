"""Micrographs to numbers: one image, or all frames of a data set."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.measure.outlining.segmentation import Segmentation, segment
from yeastfit.measure.reading.dataset import NOTHING, Dataset, given
from yeastfit.measure.reading.images import Micrograph, read_micrograph
from yeastfit.measure.reading.segmentation_options import Overrule
from yeastfit.measure.statistics.measure_mask import Shape, measure_mask
from yeastfit.progress import Progress, silent


@dataclass(frozen=True)
class Measured:
    """One micrograph, its mask and the mask's statistics in µm."""

    micrograph: Micrograph
    segmentation: Segmentation
    shape: Shape

    def row(self) -> dict[str, Any]:
        """Tidy row of a table: the file, its pixel size, every statistic of the `Shape`, and the doubts by name."""
        image = self.micrograph
        return {
            "file": image.path.name,
            "um_per_pixel": image.pixel_size,
            "pixel_size_from": image.pixel_size_source,
            **self.shape,
            "warnings": "; ".join(self.segmentation.warnings),
        }


def measure_file(path: str | Path, pixel_size: float | None = None, overrule: Overrule = NOTHING) -> Measured:
    """Read, segment and measure one micrograph. Raises `InputError`; see `read_micrograph` and `segment`."""
    micrograph = read_micrograph(path, pixel_size)
    segmentation = segment(micrograph.pixels, name=str(path), **given(overrule))
    return Measured(micrograph, segmentation, measure_mask(segmentation.mask, micrograph.pixel_size))


def measure_dataset(dataset: Dataset, progress: Progress = silent) -> list[Measured]:
    """Every frame, in the manifest's order."""
    results = []
    for frame in dataset.frames:
        results.append(measure_file(frame.path, frame.pixel_size, frame.overrule))
        count = len(dataset.frames)
        progress(f"measured {len(results)} of {count}", len(results) / count)
    return results


def replicate_curves(
    dataset: Dataset, rows: list[dict[str, float]], names: tuple[str, ...]
) -> tuple[dict[str, Float[np.ndarray, "replicate time"]], Float[np.ndarray, " time"]]:
    """Rows of statistics, one per frame, as a curve per replicate over the rising hours; NaN where one is missing.

    Raises `InputError` for several conditions, whose colonies are no replicates of each other.
    """
    if len(dataset.conditions) > 1:
        conditions = ", ".join(map(repr, dataset.conditions))
        raise InputError(f"{dataset.manifest}: conditions {conditions}, curves are of one: take dataset.of(condition)")
    hours = sorted({frame.hours for frame in dataset.frames})
    replicates = sorted({frame.replicate for frame in dataset.frames})
    curves = {name: np.full((len(replicates), len(hours)), np.nan) for name in names}
    for frame, row in zip(dataset.frames, rows, strict=True):
        for name in names:
            curves[name][replicates.index(frame.replicate), hours.index(frame.hours)] = row[name]
    return curves, np.array(hours)


def condition_curves(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[dict[str, Any]]:
    """Mean and spread over the replicates of each condition at each time: a row per condition, time and statistic.

    rows: with `condition`, `hours` and the statistics in `names`. With n values x_i that are finite,

        count = n,  mean = Σ x_i / n,  standard_deviation = √(Σ (x_i - mean)² / (n - 1)),
        standard_error = standard_deviation / √n

    the last two NaN for n < 2, the mean for n = 0. Conditions in order of appearance, hours rising.
    """
    groups: dict[tuple[str, float], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["condition"], row["hours"]), []).append(row)
    order = list(dict.fromkeys(condition for condition, _ in groups))
    curves = []
    for condition, hours in sorted(groups, key=lambda group: (order.index(group[0]), group[1])):
        for name in names:
            values = np.array([row[name] for row in groups[condition, hours]], dtype=float)
            values = values[np.isfinite(values)]
            deviation = float(values.std(ddof=1)) if len(values) > 1 else math.nan
            curves.append(
                {
                    "condition": condition,
                    "hours": hours,
                    "statistic": name,
                    "count": len(values),
                    "mean": float(values.mean()) if len(values) else math.nan,
                    "standard_deviation": deviation,
                    "standard_error": deviation / math.sqrt(max(len(values), 1)),
                }
            )
    return curves
