"""Hard statistics of a black-and-white colony (MODEL section 4; source table 3.1).

With M the set of colony pixels, h the pixel size in µm and x_c their centroid:

    A       = h² |M|                                        area, µm²
    P       = Crofton perimeter of M, holes included        µm
    C       = P² / (4 π A)                                  compactness, 1 for a disc
    x_c     = (h / |M|) Σ_M (column, row)                   centroid (x, y), µm
    radius  = (1 / |M|) Σ_M |h x - x_c|                     mean distance of colony pixels from the centroid, µm
    r_max   = max_M |h x - x_c|                             µm
    S       = |M| / (area of the convex hull of M's squares)    solidity, 1 for a convex M

and P_outer, C_outer the same two of M with its holes filled (area included). What is beyond the core is defined in
`filaments`, where pixels lie around the centroid in `spatial`, the dimension of the outline in `fractal`.

Estimator of P: `skimage.measure.perimeter_crofton` with four directions (Legland, Kiêu & Devaux 2007, "Computation of
Minkowski measures on 2D and 3D binary images", Image Anal. Stereol. 26:83, doi:10.5566/ias.v26.p83-92). It counts,
along rows, columns and both diagonals, how often a line crosses the boundary; Cauchy and Crofton make that a length.
Against the exact length of discs and of ellipses of axis ratio 0.7 and 0.4 (60 random positions and angles each), mean
bias in per cent at a semi-major axis of 5, 15 and 60 pixels:

    estimator                                   disc                 0.7                  0.4
    perimeter_crofton, 4 directions      -0.2 -0.1  0.0       -0.2 -0.2  0.0       -0.5 -0.2  0.0
    perimeter (Benkrid & Crookes 2000)   -3.8 +2.4 +4.7       -5.2 +1.8 +4.6       -7.6 +1.2 +4.5

so the chain estimator is wrong by 2 to 8 %, with a sign that depends on size, and Crofton's by 0.5 % at most. A
straight edge is its worst case: 5.2 % too short along an axis or a diagonal, up to 2.6 % too long between the two.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from math import isfinite, pi

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from yeastfit.errors import InputError
from yeastfit.measure.statistics.filaments import SKELETON, Filaments
from yeastfit.measure.statistics.fractal import fractal_dimension
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.spatial_indices import (
    angular_index,
    angular_spectrum,
    dominant_wave_number,
    radial_index,
)


@dataclass(frozen=True)
class Shape:
    """Size and form of one colony mask; lengths in µm, areas in µm² (in pixels where the pixel size is 1).

    Not a number where a statistic says nothing: all of filaments, and the angular two, of a colony whose pixels lie
    within 4 px of its centroid; the angular two where no pixel lies beyond the CSR radius; radial_index of one pixel;
    fractal_dimension of a colony less than 32 px long.
    """

    area: float
    perimeter: float
    outer_perimeter: float
    compactness: float
    outer_compactness: float
    radius: float
    max_radius: float
    centroid: tuple[float, float]
    object_count: int
    hole_count: int
    solidity: float
    fractal_dimension: float
    csr_radius: float
    filament_area_index: float
    filament_radius_index: float
    perimeter_radius: float
    filament_area: float
    branch_count: float
    branch_length: float
    radial_index: float
    angular_index: float
    wave_number: float

    def row(self) -> dict[str, float | int]:
        """Statistics by name, in the order of `UNITS`; the centroid as centroid_x and centroid_y."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        values["centroid_x"], values["centroid_y"] = values.pop("centroid")
        return {name: values[name] for name in UNITS}


@dataclass(frozen=True)
class Statistic:
    """How one number is had from a mask, in pixels; `power` of the pixel size makes it one in µm."""

    value: Callable[[Pixels, Filaments], float]
    power: int
    meaning: str


STATISTICS = {
    "area": Statistic(lambda p, f: float(p.area), 2, "area"),
    "perimeter": Statistic(lambda p, f: p.perimeter, 1, "length of all boundaries, holes included"),
    "outer_perimeter": Statistic(lambda p, f: p.outer_perimeter, 1, "length of the boundary with holes filled"),
    "compactness": Statistic(lambda p, f: p.perimeter**2 / (4 * pi * p.area), 0, "perimeter² / (4π area)"),
    "outer_compactness": Statistic(
        lambda p, f: p.outer_perimeter**2 / (4 * pi * float(p.filled.sum())), 0, "compactness with holes filled"
    ),
    "radius": Statistic(lambda p, f: float(p.distance.mean()), 1, "mean distance of the colony from its centroid"),
    "max_radius": Statistic(lambda p, f: p.max_radius, 1, "largest distance of the colony from its centroid"),
    "centroid_x": Statistic(lambda p, f: p.centre[1] + p.corner[1], 1, "centroid, from the left"),
    "centroid_y": Statistic(lambda p, f: p.centre[0] + p.corner[0], 1, "centroid, from the top"),
    "object_count": Statistic(lambda p, f: _count(p.colony, diagonals=True), 0, "objects, 8-connected"),
    "hole_count": Statistic(lambda p, f: _count(p.filled & ~p.colony, diagonals=False), 0, "holes, 4-connected"),
    "solidity": Statistic(lambda p, f: _solidity(p), 0, "area over that of the convex hull"),
    "fractal_dimension": Statistic(lambda p, f: fractal_dimension(p), 0, "box-counting dimension of the outline"),
    "csr_radius": Statistic(lambda p, f: f.csr_radius, 1, "radius of the core (complete spatial randomness)"),
    "filament_area_index": Statistic(lambda p, f: f.area_index, 0, "I_F: share of area beyond csr_radius, over 0.65"),
    "filament_radius_index": Statistic(lambda p, f: f.radius_index, 0, "I_R: (max_radius / csr_radius − 1.1) / 1.7"),
    "perimeter_radius": Statistic(lambda p, f: f.perimeter_radius, 1, "mean distance of the outline from the centroid"),
    "filament_area": Statistic(lambda p, f: float(f.outer_area), 2, "area beyond perimeter_radius"),
    "branch_count": Statistic(
        lambda p, f: f.branches[0], 0, f"ends of the skeleton beyond csr_radius, mean of four quadrants; {SKELETON}"
    ),
    "branch_length": Statistic(
        lambda p, f: f.branches[1], 1, f"length of the skeleton beyond csr_radius, mean of four quadrants; {SKELETON}"
    ),
    "radial_index": Statistic(lambda p, f: radial_index(p.distance), 0, "I_r: 1 − (radius of the core) / max_radius"),
    "angular_index": Statistic(
        lambda p, f: angular_index(f.angle), 0, "I_θ: spread of the area beyond csr_radius over directions, 0 to 1"
    ),
    "wave_number": Statistic(
        lambda p, f: dominant_wave_number(angular_spectrum(f.angle), f.finest_wave),
        0,
        "dominant wave number of the angular pair correlation beyond csr_radius, periods a turn",
    ),
}
"""All statistics of a mask that are one number."""

UNITS = {name: ("", "µm", "µm²")[each.power] for name, each in STATISTICS.items()}
"""Unit of every statistic of a `Shape`, empty where it has none."""

MEANINGS = {name: each.meaning for name, each in STATISTICS.items()}
"""What every statistic is, in a line for a reader of a table."""

_COUNTS = ("object_count", "hole_count")


def measure_mask(mask: npt.NDArray[np.generic], pixel_size: float = 1.0) -> Shape:
    """The `Shape` of a mask [rows, columns] whose colony pixels are True (or non-zero).

    `pixel_size` in µm per pixel. The centroid is (x, y) from the centre of the top-left pixel, y downwards. Objects are
    8-connected and holes 4-connected, so that a diagonal chain of cells is one object that closes its holes. A colony
    cut by the border of the image counts the cut as boundary. Rings, boxes and sectors have a fixed number of pixels or
    degrees: `pixel_size` scales lengths and areas and changes nothing else. Not differentiable.

    Raises `InputError` for a mask that is not 2-D, holds NaN or has no colony pixel, and for a pixel size that is not a
    positive number.
    """
    found = mask_statistics(mask, pixel_size)
    x, y = found.pop("centroid_x"), found.pop("centroid_y")
    return Shape(**found, centroid=(x, y))  # type: ignore[arg-type]


def mask_statistics(
    mask: npt.NDArray[np.generic], pixel_size: float = 1.0, names: Iterable[str] | None = None
) -> dict[str, float | int]:
    """Those statistics of `measure_mask` that are asked for, in that order; computes no others. None for all.

    Raises `InputError` as `measure_mask` does, and for a name which is not in `UNITS`.
    """
    if isinstance(pixel_size, bool) or not isfinite(pixel_size) or pixel_size <= 0:
        raise InputError(f"pixel_size: got {pixel_size!r}, need a positive number of µm per pixel")
    names = check_names(UNITS if names is None else names)
    pixels = Pixels.of(mask)
    filaments = Filaments(pixels)
    found = {name: STATISTICS[name].value(pixels, filaments) * pixel_size ** STATISTICS[name].power for name in names}
    return {name: int(value) if name in _COUNTS else value for name, value in found.items()}


def check_names(names: Iterable[str]) -> tuple[str, ...]:
    """The names, each of which must be a statistic; raises `InputError`."""
    names = tuple(names)
    for name in names:
        if name not in UNITS:
            raise InputError(f"statistics: got {name!r}, need some of {', '.join(UNITS)}")
    return names


def _count(mask: npt.NDArray[np.bool_], *, diagonals: bool) -> int:
    return int(ndimage.label(mask, ndimage.generate_binary_structure(2, 2 if diagonals else 1))[1])


def _solidity(pixels: Pixels) -> float:
    from scipy.spatial import ConvexHull

    rows = np.flatnonzero(pixels.colony.any(axis=1))
    colony = pixels.colony[rows]
    left, right = colony.argmax(axis=1), colony.shape[1] - colony[:, ::-1].argmax(axis=1)
    corners = [np.stack([rows + below, side], axis=1) for below in (0, 1) for side in (left, right)]
    return float(pixels.area / ConvexHull(np.concatenate(corners)).volume)
