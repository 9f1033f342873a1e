"""The last image of each colony of a data set, for colonies that are compared whatever their age."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.models.forward_model import Row
from yeastfit.measure.measurements_table import read_mask
from yeastfit.numbers import Range


def last_images(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """The last image of each colony, and what is to be said about the times."""
    last: dict[str, Row] = {}
    for row in sorted(rows, key=lambda row: float(row["hours"])):
        last[str(row["replicate"])] = row
    chosen, notes = [row for row in rows if last[str(row["replicate"])] is row], []
    hours = sorted({float(row["hours"]) for row in chosen})
    if len(chosen) < len(rows):
        earlier = len(rows) - len(chosen)
        images, are = ("images", "are") if earlier > 1 else ("image", "is")
        notes.append(
            f"{earlier} {images} before the last one of their colony {are} left out: colonies are compared whatever "
            "their age"
        )
    if len(hours) > 1:
        early = [f"{row['file']} ({float(row['hours']):g} h)" for row in chosen if float(row["hours"]) < hours[-1]]
        some = ", ".join(early[:3]) + (", …" if early[3:] else "")
        notes.append(
            f"{len(early)} of {len(chosen)} colonies were photographed before {hours[-1]:g} h: {some}; they count like "
            "the others, whatever their age"
        )
    return chosen, notes


def measured(row: Row, folder: Path, statistics: Sequence[str]) -> dict[str, float]:
    """Statistics of one image in µm: the table's, and what its mask tells besides."""
    from yeastfit.offlattice.simulator import known_statistics, statistics_of

    admissible = {name: entry.admissible for name, entry in known_statistics().items()}
    found = {name: _number(row, name, admissible[name]) for name in statistics if name in row}
    missing = [name for name in statistics if name not in found]
    if missing:
        name = str(row["mask"] or "")
        path = folder / name
        if not name or not path.is_file():
            lacks = f"there is no mask {path}" if name else f"replicate {row['replicate']!r} names no mask"
            raise InputError(f"statistics: {missing[0]!r} is not in the table, and {lacks} to measure")
        found |= statistics_of(read_mask(path, row), float(row["um_per_pixel"]), missing)
    return found


def mean_area(rows: Sequence[Row], areas: Sequence[float]) -> float:
    """Of images with these areas. Raises `InputError` where one is not known."""
    for row, area in zip(rows, areas, strict=True):
        if not area > 0:
            raise InputError(
                f"{row['file']}: area is {area:g}, and colonies are compared at their mean area: measure it again, or "
                "leave its row out"
            )
    return float(np.mean(areas))


def _number(row: Row, name: str, admissible: Range) -> float:
    """A statistic in the table, nan where its cell is empty; one that `measure` does not know is text there."""
    value = row[name]
    if value == "":
        return math.nan
    return admissible.read(value, f"{row['file']}: {name}") if isinstance(value, str) else float(value)
