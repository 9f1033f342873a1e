"""Statistics over time: a curve for each replicate colony, and the mean and spread of each condition's colonies."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import Dataset


def replicate_curves(
    dataset: Dataset, rows: Sequence[Mapping[str, float]], names: Sequence[str]
) -> tuple[dict[str, Float[np.ndarray, "replicate time"]], Float[np.ndarray, " time"]]:
    """Sort statistics of images into a curve for each replicate.

    Arguments:
        dataset: Of one condition.
        rows: Statistics of each image, in the manifest's order.
        names: Of the statistics.

    Returns:
        Curves by statistic, nan where there is no image, and the rising hours.

    Raises:
        InputError: There are several conditions, whose colonies are no replicates of each other.
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
    """Average the replicates of each condition at each time. With n finite values x_i,

        count = n,  mean = Σ x_i / n,  standard_deviation = √(Σ (x_i − mean)² / (n − 1)),
        standard_error = standard_deviation / √n.

    Arguments:
        rows: One for each image, with `condition`, `hours` and the statistics.
        names: Of the statistics.

    Returns:
        One row for each condition, in order of appearance, time, rising, and statistic. The mean is nan for n = 0, the
        last two for n < 2.
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
