"""Statistics over time: a curve for each replicate colony, and the mean and spread of each condition's colonies.

Colonies that get smaller are told of: mostly hours, replicates or outlines are mixed up.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import Dataset

SHRUNK = 0.1  # share of its area by which a colony may get smaller from one image to the next; outlines differ by less
NAMED = 3  # colonies that are named, others are counted


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
    replicates = dataset.replicates
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


def shrunk_colonies(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Say which colonies get smaller by more than a tenth.

    Arguments:
        rows: One for each image, with `file`, `condition`, `replicate`, `hours` and `area`; those without hours or area
            are passed over.

    Returns:
        One sentence for each of the first colonies, and how many more there are.
    """
    colonies: dict[tuple[str, str], list[tuple[float, float, str]]] = {}
    for row in rows:
        hours, area = (math.nan if row.get(name) in (None, "") else float(row[name]) for name in ("hours", "area"))
        if math.isfinite(hours) and math.isfinite(area):
            key = str(row.get("condition") or ""), str(row.get("replicate") or "")
            colonies.setdefault(key, []).append((hours, area, str(row["file"])))
    found = []
    for images in colonies.values():
        falls = [(one, other) for one, other in pairwise(sorted(images)) if other[1] < (1 - SHRUNK) * one[1]]
        if falls:
            (early, before, first), (late, after, last) = falls[0]
            found.append(
                f"the colony of {last} has {after:.4g} µm² at {late:g} h, less than {before:.4g} µm² at {early:g} h in "
                f"{first}: are hours, replicate and outlines right?"
            )
    return found[:NAMED] + ([f"{len(found) - NAMED} more colonies get smaller"] if len(found) > NAMED else [])
