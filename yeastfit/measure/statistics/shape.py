"""Size and form of a colony: statistics of the black-and-white image, and their smooth forms where there are some.

With M the set of colony pixels, h the pixel size in µm and x_c their centroid:

    A       = h² |M|                                        area, µm²
    P       = Crofton perimeter of M, holes included        µm
    C       = P² / (4 π A)                                  compactness, 1 for a disc
    x_c     = (h / |M|) Σ_M (column, row)                   centroid (x, y), µm
    radius  = (1 / |M|) Σ_M |h x − x_c|                     mean distance of colony pixels from the centroid, µm
    r_max   = max_M |h x − x_c|                             µm
    r_in    = h (max_M d − 1/2)                             radius of the largest circle inside M, µm
    S       = |M| / |H|                                     solidity, 1 for a convex M
    E       = |M beyond x_H + 0.9 (H − x_H)| / |M|          share in the outer tenth of the hull, 0.19 for a convex M

with d the distance of a pixel of M from the nearest one outside, in a hole or beyond, in pixels; H the convex hull of
M's squares and x_H its centroid. The circle runs between pixels around one, so r_in is known to a pixel. It tells a
core that is round and without holes from one of the same area that is neither. The outer tenth lies beyond the hull
shrunk by a tenth about x_H. E counts the pixels whose centres lie there. It is 1 − 0.9² for every convex M, and less
for a colony whose hull is held up by thin filaments, as these fill little of its edge.

P_outer and C_outer are the same two of M with its holes filled (area included). C is defined in table 3.1 of "A Novel
Algebraic Agent Based Model for Pseudohyphal Baker's Yeast Colony Morphology". `indicator` has the smooth A, P and
radius. `filaments` defines what lies beyond the core, `spatial_indices` where pixels lie around the centroid, `fractal`
the dimension of the outline, `nodes` what only a simulation knows.

Estimator of P: Crofton's in four directions (Legland, Kiêu & Devaux 2007, "Computation of Minkowski measures on 2D and
3D binary images", Image Anal. Stereol. 26:83, doi:10.5566/ias.v26.p83-92), as of `skimage.measure.perimeter_crofton`,
here by whole arrays and 30 times as fast. It counts, along rows, columns and both diagonals, how often a line crosses
the boundary; Cauchy and Crofton make that a length.
Against the exact length of discs and of ellipses of axis ratio 0.7 and 0.4 (60 random positions and angles each), mean
bias in per cent at a semi-major axis of 5, 15 and 60 pixels:

    estimator                                   disc                 0.7                  0.4
    perimeter_crofton, 4 directions      -0.2 -0.1  0.0       -0.2 -0.2  0.0       -0.5 -0.2  0.0
    perimeter (Benkrid & Crookes 2000)   -3.8 +2.4 +4.7       -5.2 +1.8 +4.6       -7.6 +1.2 +4.5

The chain estimator is thus wrong by 2 to 8 %, with a sign that depends on size; Crofton's by 0.5 % at most. A straight
edge is its worst case: 5.2 % too short along an axis or a diagonal, up to 2.6 % too long between the two.
"""

from math import pi
from typing import TYPE_CHECKING

import numpy as np
import scipy

from yeastfit.measure.statistics.pixels import TIE, Mask, Pixels
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.numbers import Range

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

COMPACTNESS = Range(0.9, 1e9)
"""Discs have 1, and down to 0.92 where they are smaller than 50 pixels; only a few pixels can have less than 0.9.
10⁸ pixels that lie apart from each other have 1.3e8."""

_LATTICE = 16  # pixels from one to the next; only time depends on it


def convex_hull(pixels: Pixels) -> "ConvexHull":
    """H, of the corners of the pixels' squares; coordinates are (row, column) of corners."""
    from scipy.spatial import ConvexHull

    rows = np.flatnonzero(pixels.colony.any(axis=1))
    colony = pixels.colony[rows]
    left, right = colony.argmax(axis=1), colony.shape[1] - colony[:, ::-1].argmax(axis=1)
    corners = [np.stack([rows + below, side], axis=1) for below in (0, 1) for side in (left, right)]
    return ConvexHull(np.concatenate(corners))


def solidity(pixels: Pixels) -> float:
    """S: the colony's area over that of its convex hull."""
    return float(pixels.area / pixels.derived(convex_hull).volume)


def outer_hull_share(pixels: Pixels) -> float:
    """E: the share of the colony's area that lies in the outer tenth of its convex hull."""
    hull = pixels.derived(convex_hull)
    corners = hull.points[hull.vertices]
    following = np.roll(corners, -1, axis=0)
    triangles = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    centre = triangles @ (corners + following) / (3 * triangles.sum())
    rows, columns = pixels.indices
    down, right = rows + 0.5 - centre[0], columns + 0.5 - centre[1]
    outer = np.zeros(pixels.area, dtype=bool)
    for edge_down, edge_right, offset in hull.equations:  # edge · x + offset ≤ 0 inside
        depth = -offset - edge_down * centre[0] - edge_right * centre[1]
        outer |= edge_down * down + edge_right * right > 0.9 * depth + TIE
    return float(outer.mean())


def inscribed_radius(pixels: Pixels) -> float:
    """r_in, in pixels; found in a fifth of the time of a distance transform.

    Of two pixels d differs by no more than they are apart. So the largest d is near a pixel of a coarse lattice where d
    is hardly less than the lattice's largest. In a colony thinner than the lattice all pixels are looked at.
    """
    coarse = _LATTICE * np.argwhere(pixels.colony[::_LATTICE, ::_LATTICE])
    distance = pixels.to_outside(coarse) if len(coarse) else np.zeros(1)
    apart, largest = _LATTICE / 2**0.5, distance.max()
    if largest < 2 * apart:
        return float(pixels.to_outside(np.argwhere(pixels.colony)).max()) - 0.5
    around = np.indices((_LATTICE + 1, _LATTICE + 1)).reshape(2, -1).T - _LATTICE // 2
    near = (coarse[distance >= largest - apart, None] + around).reshape(-1, 2)
    return float(pixels.to_outside(near).max()) - 0.5


def _objects(mask: Mask, *, diagonals: bool) -> int:
    return int(scipy.ndimage.label(mask, scipy.ndimage.generate_binary_structure(2, 2 if diagonals else 1))[1])


ENTRIES = (
    Statistic("area", 2, "area", mask=lambda p: float(p.area), smooth=lambda i: i.area, reach=3.0),
    Statistic(
        "perimeter",
        1,
        "length of all boundaries, holes included",
        mask=lambda p: p.perimeter,
        smooth=lambda i: i.perimeter,
    ),
    Statistic("outer_perimeter", 1, "length of the boundary with holes filled", mask=lambda p: p.outer_perimeter),
    Statistic(
        "compactness",
        0,
        "perimeter² / (4π area)",
        "compactness P²/(4πA)",
        mask=lambda p: p.perimeter**2 / (4 * pi * p.area),
        smooth=lambda i: i.perimeter**2 / (4 * pi * i.area),
        measurement_error=0.02,
        possible=COMPACTNESS,
    ),
    Statistic(
        "outer_compactness",
        0,
        "compactness with holes filled",
        mask=lambda p: p.outer_perimeter**2 / (4 * pi * float(p.filled.sum())),
        measurement_error=0.02,
        possible=COMPACTNESS,
    ),
    Statistic(
        "radius",
        1,
        "mean distance of the colony from its centroid",
        "radius, mean distance from centroid",
        mask=lambda p: float(p.distance.mean()),
        smooth=lambda i: i.radius,
        reach=3.0,
    ),
    Statistic(
        "max_radius", 1, "largest distance of the colony from its centroid", mask=lambda p: p.max_radius, reach=1.0
    ),
    Statistic("inscribed_radius", 1, "radius of the largest circle inside the colony", mask=inscribed_radius),
    Statistic(
        "centroid_x",
        1,
        "centroid, from the left",
        mask=lambda p: p.centre[1] + p.corner[1],
        comparable=False,
        possible=Range(0.0, unit="µm"),
    ),
    Statistic(
        "centroid_y",
        1,
        "centroid, from the top",
        mask=lambda p: p.centre[0] + p.corner[0],
        comparable=False,
        possible=Range(0.0, unit="µm"),
    ),
    Statistic(
        "object_count",
        0,
        "objects, 8-connected",
        mask=lambda p: _objects(p.colony, diagonals=True),
        is_count=True,
    ),
    Statistic(
        "hole_count",
        0,
        "holes, 4-connected",
        mask=lambda p: _objects(p.filled & ~p.colony, diagonals=False),
        is_count=True,
        may_vanish=True,
    ),
    Statistic("solidity", 0, "area over that of the convex hull", mask=solidity, possible=Range(0.0, 1.0, above=True)),
    Statistic(
        "outer_hull_share",
        0,
        "share of area in the outer tenth of the convex hull, 0.19 where convex",
        mask=outer_hull_share,
        may_vanish=True,
        possible=Range(0.0, 1.0),
    ),
)
