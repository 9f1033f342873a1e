"""What is refused of statistics and images before any image is measured."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from yeastfit.errors import InputError
from yeastfit.inference.targets_from_table import SMOOTH_DO_NOT
from yeastfit.measure.measurements_table import check_same_size
from yeastfit.measure.statistics.registry import STATISTICS, names_with
from yeastfit.numbers import Range

CELL_PIXELS = 1000  # along a cell, of which an image of the largest size shows ten


def check_comparable(name: str) -> None:
    """Raise `InputError` for a statistic that says nothing of parameters, such as where a colony lies in its image."""
    if name in STATISTICS and not STATISTICS[name].comparable:
        raise InputError(
            f"--statistics: {name!r} ({STATISTICS[name].meaning}) is nothing in which data and simulated colonies can "
            "be compared: leave it out"
        )


def check_pixel(size: float, length: float, what: str, by: str = "") -> None:
    """Check that pixels have a size that shows cells.

    Arguments:
        size: Of a pixel in µm.
        length: Of a cell in µm.
        what: What the message begins with.
        by: Option that says the length, if one does.

    Raises:
        InputError: A pixel is larger than a cell, or so small that no image shows a few of them.
    """
    sizes = Range(length / CELL_PIXELS, length, "µm")
    if size not in sizes:
        said = f" by {by}" if by else ""
        raise InputError(f"{what} is {size:g}, it must be {sizes}, as a cell is {length:g} µm long{said}")


def check_images(images: Sequence[Mapping[str, Any]], length: float, *, by: str = "", alike: bool) -> None:
    """Check the pixels of the images of one condition, as far as they are known.

    Arguments:
        images: Rows of file and, where it is known, um_per_pixel.
        length: Of a cell in µm.
        by: Option that says the length, if one does.
        alike: Whether pixels must be of one size.

    Raises:
        InputError: A pixel does not show cells, or they are of two sizes.
    """
    sized = [row for row in images if math.isfinite(row.get("um_per_pixel", math.nan))]
    for row in sized:
        check_pixel(float(row["um_per_pixel"]), length, f"{row['file']}: um_per_pixel", by)
    if alike and sized:
        check_same_size(sized, SMOOTH_DO_NOT if by else "")


def of_pixels(statistics: Sequence[str]) -> bool:
    """Whether statistics depend on the size of pixels, as those without a smooth form do."""
    return not set(statistics) <= set(names_with("smooth"))
