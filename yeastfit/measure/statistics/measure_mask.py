"""Measure a black-and-white image: every statistic of the registry with a form for masks, in µm."""

import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np
import numpy.typing as npt

from yeastfit.errors import InputError
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.registry import STATISTICS, check_names, names_with
from yeastfit.text import short


@dataclass(frozen=True, eq=False)
class Shape(Mapping[str, float]):
    """Statistics of one colony mask: a mapping from names to values, which are attributes too.

    Lengths are in µm and areas in µm², or in pixels where the pixel size is 1. Counts are `int`. Where a statistic says
    nothing it is nan: all of filaments, and the angular two, of a colony whose pixels lie within 4 px of its centroid;
    the angular two where no pixel lies beyond the CSR radius; radial_index of one pixel; fractal_dimension of a colony
    less than 32 px long.

    Attributes:
        statistics: Values by name, in the registry's order.
    """

    statistics: dict[str, float]

    def __getitem__(self, name: str) -> float:
        return self.statistics[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.statistics)

    def __len__(self) -> int:
        return len(self.statistics)

    def __getattr__(self, name: str) -> float:
        if name == "statistics" or name not in self.statistics:  # the first where a copy is being made
            raise AttributeError(f"{name!r} was not measured")
        return self.statistics[name]

    @property
    def centroid(self) -> tuple[float, float]:
        """(x, y) from the centre of the top-left pixel, y downwards."""
        return self["centroid_x"], self["centroid_y"]


def measure_mask(
    mask: npt.NDArray[np.generic], pixel_size: float = 1.0, statistics: Iterable[str] | None = None
) -> Shape:
    """Measure a colony in a black-and-white image.

    Objects are 8-connected and holes 4-connected, so that a diagonal chain of cells is one object that closes its
    holes. A colony cut by the border of the image counts the cut as boundary. Rings, boxes and sectors have a fixed
    number of pixels or degrees: `pixel_size` scales lengths and areas and changes nothing else. Not differentiable.

    Arguments:
        mask: [rows, columns], True (or not 0) where the colony is.
        pixel_size: In µm per pixel.
        statistics: Names of those to compute, in this order; all by default.

    Returns:
        The statistics by name.

    Raises:
        InputError: The mask is not 2-D, holds NaN or has no colony pixel; the pixel size is not a positive number; or
            a name is not a statistic of masks.
    """
    if isinstance(pixel_size, bool) or not isfinite(pixel_size) or pixel_size <= 0:
        raise InputError(f"pixel_size: got {pixel_size!r}, need a positive number of µm per pixel")
    names = names_with("mask") if statistics is None else check_names(statistics, "mask")
    pixels = Pixels.of(mask)
    return Shape({name: _value(name, pixels, pixel_size) for name in names})


def _value(name: str, pixels: Pixels, pixel_size: float) -> float:
    entry = STATISTICS[name]
    assert entry.mask is not None
    try:
        found = entry.mask(pixels)
    except Exception as error:  # of a statistic that a user has registered
        if entry.mask.__module__.startswith("yeastfit."):
            raise
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        raise InputError(f"statistic {name}: its mask cannot be computed: {what}") from error
    if np.ndim(found) or not np.issubdtype(np.asarray(found).dtype, np.number):
        raise InputError(f"statistic {name}: its mask gives {short(found)}, need one number")
    value = found * pixel_size**entry.unit_power
    return int(value) if entry.is_count else value
