"""How far and how finely a colony's filaments reach out of its core.

CSR radius and the indices of Li, Green, Tronnolone, Tam, Black, Gardner, Sundstrom, Jiranek & Binder 2024, "An
off-lattice discrete model to characterise filamentous yeast colony morphology", PLoS Comput. Biol. 20, and of its
program, github.com/kaili2019/Li2024-off-lattice. With r the distance of a pixel from the centroid, r_max the largest,
A the number of pixels, ρ = A / (π r_max²), rings of δ = 4 pixels and n_i the number of pixels with δ (i − 1) < r ≤ δ i:

    f_i   = n_i / (π ρ δ² (2i − 1)),    i = 1 … round(r_max / δ)
    r_CSR = δ · argmin_i |1 − f_i|                     where a ring is as dense as a disc filled at random ("complete
                                                       spatial randomness"): the edge of the core
    I_F   = (share of pixels at r ≥ r_CSR) / 0.65
    I_R   = (r_max / r_CSR − 1.1) / 1.7

δ is in pixels, as published at 1.55 µm a pixel, whatever the pixel size. r_CSR is a multiple of δ, so it and everything
about pixels beyond it carry an error of up to 4 pixels, and are coarse for a colony of a few dozen. A disc has f = 1 in
every ring, and noise of the pixels then decides: these statistics are for colonies with filaments. (The centre pixel,
which lies in no ring of theirs, is counted in the first.)

Area outside the mean perimeter radius: pixels farther from the centroid than the mean distance of the outline of the
colony with its holes filled. It is a statistic of Li et al. 2025, "Agent-based modelling and time series inference of
filamentous yeast colonies", bioRxiv, doi:10.1101/2025.09.15.676253, computed here as its name says.

Skeleton. The core is replaced by a closed ring of width max(r_CSR / 8, 8 pixels) inside r_CSR, and the colony beyond
r_CSR with that ring is thinned by `SKELETON`. Branches are the ends of the skeleton at r ≥ r_CSR. A ring has no ends,
so that cutting off the core makes none; a lobe much broader than the ring only bulges it and is no branch. The length
of the skeleton there is 0.948 n + 1.343 m for n steps along rows or columns and m along diagonals (Dorst & Smeulders
1987, "Length estimators for digitized contours", Comput. Vis. Graph. Image Process. 40:311,
doi:10.1016/S0734-189X(87)80145-7: unbiased over directions, −5 to +3 % in one). Both are means over the four quadrants
around the centroid, hence a quarter of the colony's. Thinning treats the sides of a shape in turn. So that turning by
90° or mirroring a colony changes nothing, every quadrant is thinned as the upper left one would be, both of the image
and of its mirror image.
Width. A pixel of the skeleton at r ≥ r_CSR whose nearest pixel outside the colony, in a hole or beyond, lies at the
distance d is the middle of a piece of filament 2 d − 1 pixels wide, along rows and columns exactly if that is odd, and
else a pixel more. The width of the filaments is the median over all these pixels, of skeletons thinned in all eight
ways: half of the filaments' length is thinner. 0 where there is no skeleton.
Li et al. 2024 count the ends of MATLAB's `bwmorph` skeleton in one quadrant, those at the cuts included: counts by two
algorithms cannot be compared. Ends are not pruned: a disc may keep up to two spurs a quadrant, and an edge rough by
more than a pixel (a mask enlarged by repeating its pixels) grows more, so compare masks made in one way.
"""

from dataclasses import dataclass
from functools import cached_property
from math import floor, nan
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Int

from yeastfit.measure.statistics.pixels import TIE, Mask, PerPixel, Pixels
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.measure.statistics.thinning import skeleton, with_numba
from yeastfit.numbers import Range

RING = 4
"""δ, pixels."""

SKELETON = "Zhang & Suen 1984 (scikit-image skeletonize)"
"""The thinning algorithm, doi:10.1145/357994.358023."""

_ALONG, _ACROSS = 0.948, 1.343
_CORE = 1 / 8  # width of the ring in place of the core over r_CSR
_LOWER, _RIGHT = {2, 3, 6, 7}, {1, 2, 4, 7}  # turns that put a lower quadrant, or one to the right, to the upper left
_THICKNESS = 8  # and the least such width, pixels: a thinner ring has ends wherever the edge is rough


@dataclass(frozen=True, eq=False)
class Filaments:
    """What lies beyond the CSR radius of a colony, in pixels; nan where r_max is less than one ring."""

    pixels: Pixels

    @cached_property
    def csr_radius(self) -> float:
        """r_CSR."""
        return csr_radius(self.pixels)

    @cached_property
    def beyond(self) -> Bool[np.ndarray, " pixel"]:
        """Which pixels lie at r ≥ r_CSR."""
        return self.pixels.distance >= self.csr_radius - TIE

    @cached_property
    def angle(self) -> PerPixel:
        """Direction of the pixels beyond."""
        (rows, columns), (row, column) = self.pixels.indices, self.pixels.centre
        return np.arctan2(row - rows[self.beyond], columns[self.beyond] - column)

    @property
    def finest_wave(self) -> float:
        """The largest wave number that pixels resolve: its wave is two rings long at r_CSR."""
        return np.pi * self.csr_radius / RING

    @property
    def area_index(self) -> float:
        """I_F."""
        return nan if np.isnan(self.csr_radius) else float(self.beyond.mean()) / 0.65

    @property
    def radius_index(self) -> float:
        """I_R."""
        return (self.pixels.max_radius / self.csr_radius - 1.1) / 1.7

    @cached_property
    def perimeter_radius(self) -> float:
        """Mean distance of the outer outline's pixels (which have one of four neighbours outside) from the centroid."""
        filled = self.pixels.filled
        rows, columns = np.nonzero(filled & ~scipy.ndimage.binary_erosion(filled))
        return float(np.hypot(rows - self.pixels.centre[0], columns - self.pixels.centre[1]).mean())

    @property
    def outer_area(self) -> int:
        """Number of pixels beyond the perimeter radius."""
        return int((self.pixels.distance > self.perimeter_radius + TIE).sum())

    @cached_property
    def _skeleton(self) -> "_Skeleton":
        return _branches(self.pixels, self.csr_radius)

    @property
    def branches(self) -> tuple[float, float]:
        """Number of branches and length of the skeleton, per quadrant."""
        return (nan, nan) if np.isnan(self.csr_radius) else self._skeleton[:2]

    @cached_property
    def width(self) -> float:
        """Of the filaments, in the median; 0 where there are none."""
        if np.isnan(self.csr_radius):
            return nan
        middle = self._skeleton.middle
        return 2.0 * float(np.median(self.pixels.to_outside(middle))) - 1.0 if len(middle) else 0.0


class _Skeleton(NamedTuple):
    """Ends and length per quadrant, and the pixels, each as often as one of eight ways of thinning finds it."""

    ends: float
    length: float
    middle: Int[np.ndarray, "pixel 2"]


def filaments(pixels: Pixels) -> Filaments:
    """The `Filaments` of a colony, computed once."""
    return pixels.derived(Filaments)


def csr_radius(pixels: Pixels) -> float:
    """r_CSR; nan where the farthest pixel is nearer than δ."""
    if with_numba(pixels.colony.size):
        from yeastfit.measure.statistics.compiled_filaments import in_rings

        held, largest = in_rings(pixels.colony, *pixels.centre, RING, TIE)
    else:
        held = np.bincount((pixels.distance / RING + (1 - TIE)).astype(int), minlength=2)
        largest = pixels.max_radius
    if largest < RING:
        return nan
    held[1] += held[0]  # of the centre
    rings = np.arange(1, floor(largest / RING + 0.5) + 1)
    counts = held[1 : len(rings) + 1]
    excess = np.abs(1 - counts * (largest / RING) ** 2 / (pixels.area * (2 * rings - 1)))
    return float(RING * rings[np.argmax(excess <= excess.min() + TIE)])


def _branches(pixels: Pixels, inner: float) -> _Skeleton:
    width = max(_CORE * inner, _THICKNESS)
    squares = max(inner - width - TIE, 0.0) ** 2, (inner - TIE) ** 2
    found, middles = zip(*(_in_quadrant(pixels, squares, round(width), turn) for turn in range(8)), strict=True)
    ends, along, across = (sum(counts) / len(found) for counts in zip(*found, strict=True))
    return _Skeleton(ends, 0.5 * (_ALONG * along + _ACROSS * across), np.concatenate(middles))


def _in_quadrant(
    pixels: Pixels, squares: tuple[float, float], seam: int, turn: int
) -> tuple[tuple[int, int, int], Int[np.ndarray, "pixel 2"]]:
    """Ends and steps of the skeleton in the quadrant that a turn puts to the upper left (`thinning.turned`); pixels.

    The image reaches `seam` pixels into the next quadrants, where the cut between them would show in a skeleton. A
    pixel on an axis belongs to one quadrant of the four.

    squares: Of the two radii of the ring in place of the core.
    """
    (row, column), (height, width), upright = pixels.centre, pixels.colony.shape, turn % 2 == 0
    rows, columns = _half(row, height, turn in _LOWER, upright), _half(column, width, turn in _RIGHT, not upright)
    top, left = max(rows.start - seam, 0), max(columns.start - seam, 0)
    part = pixels.colony[top : rows.stop + seam, left : columns.stop + seam]
    thin = skeleton(_with_ring(part, row - top, column - left, *squares), turn)
    own = thin[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    i, j = np.divmod(np.flatnonzero(own), own.shape[1])
    i, j = i + rows.start, j + columns.start
    outer = (i - row) ** 2 + (j - column) ** 2 >= squares[1]
    i, j = i[outer], j[outer]
    return _followed(thin, i - top, j - left), np.stack([i, j], axis=1)


def _half(centre: float, size: int, after: bool, strict: bool) -> slice:
    """The pixels of a line before or after its centre, strictly or with it."""
    first, beyond = int(np.ceil(centre - TIE)), floor(centre + TIE) + 1
    return slice(beyond if strict else first, size) if after else slice(0, first if strict else beyond)


def _with_ring(colony: Mask, row: float, column: float, inner: float, outer: float) -> Mask:
    """A part of a colony with a full ring in place of the core; its centre, and squares of the two radii."""
    if with_numba(colony.size):
        from yeastfit.measure.statistics.compiled_filaments import with_ring

        return with_ring(colony, row, column, inner, outer)
    square = ((np.arange(colony.shape[0]) - row) ** 2)[:, None] + (np.arange(colony.shape[1]) - column) ** 2
    return (colony | (square < outer)) & (square >= inner)


def _followed(thin: Mask, rows: Int[np.ndarray, " pixel"], columns: Int[np.ndarray, " pixel"]) -> tuple[int, int, int]:
    """Ends of a skeleton, and its steps along and across, at some of its pixels.

    A pixel with one neighbour or none is an end. Each pixel has its own steps to its neighbours; a step across counts
    only where no two steps along lead to the same place.
    """
    if with_numba(thin.size):
        from yeastfit.measure.statistics.compiled_filaments import followed

        return followed(thin, rows, columns)
    held = np.pad(thin, 1)
    near = {(i, j): held[rows + 1 + i, columns + 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j}
    across = sum(there & ~near[i, 0] & ~near[0, j] for (i, j), there in near.items() if i and j)
    along = sum(there.astype(int) for (i, j), there in near.items() if not (i and j))
    neighbours = sum(there.astype(int) for there in near.values())
    return int((neighbours <= 1).sum()), int(along.sum()), int(np.sum(across))


ENTRIES = (
    Statistic(
        "csr_radius", 1, "radius of the core (complete spatial randomness)", mask=lambda p: filaments(p).csr_radius
    ),
    Statistic(
        "filament_area_index",
        0,
        "I_F: share of area beyond csr_radius, over 0.65",
        mask=lambda p: filaments(p).area_index,
        may_vanish=True,
        possible=Range(0.0, 1 / 0.65),
    ),
    Statistic(
        "filament_radius_index",
        0,
        "I_R: (max_radius / csr_radius − 1.1) / 1.7",
        mask=lambda p: filaments(p).radius_index,
        may_vanish=True,
        possible=Range(-1.1 / 1.7),
    ),
    Statistic(
        "perimeter_radius",
        1,
        "mean distance of the outline from the centroid",
        mask=lambda p: filaments(p).perimeter_radius,
    ),
    Statistic(
        "filament_area",
        2,
        "area beyond perimeter_radius",
        mask=lambda p: float(filaments(p).outer_area),
        may_vanish=True,
    ),
    Statistic(
        "branch_count",
        0,
        f"ends of the skeleton beyond csr_radius, mean of four quadrants; {SKELETON}",
        mask=lambda p: filaments(p).branches[0],
        may_vanish=True,
        possible=Range(0.0),
    ),
    Statistic(
        "branch_length",
        1,
        f"length of the skeleton beyond csr_radius, mean of four quadrants; {SKELETON}",
        mask=lambda p: filaments(p).branches[1],
        may_vanish=True,
    ),
    Statistic(
        "filament_width",
        1,
        f"width of filaments beyond csr_radius, median along the skeleton; {SKELETON}",
        mask=lambda p: filaments(p).width,
        may_vanish=True,
    ),
)
