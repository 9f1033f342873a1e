"""Masks of a colony's first n cells as a camera would see them: ellipses on pixels of any size, for `measure`.

A pixel is colony where its centre lies in one of the first n cells, taken as what they are, exact ellipses

    (u/a)² + (v/b)² ≤ 1

along and across the cell's direction (their 12-gons, by which cells are kept apart and Li et al. draw them, are 4.5 %
smaller). Rows run downwards along −y, columns along x, and the origin is the corner of four pixels. As cells are only
added, it is enough to know the number of the first cell on each pixel: masks and areas of all n come from one look.

Gaps narrower than two cells are closed, as an outline drawn in a photograph closes them: the mask is dilated and eroded
by a disc. Left open, a colony of 45 000 cells has 17 000 holes, where a photographed one has 225 (`benchmarks.gaps`).

Outlines may lie outside of the cells by a margin: the mask is dilated by a disc that is larger by it. Hairs of real
colonies are bundles of cells in an image that is not sharp everywhere, and wider than a flat chain of cells.

Of all masks at once that is the least within one disc and then the largest within the other, as thresholds and flat
filters commute.
"""

from dataclasses import dataclass
from math import ceil, floor, isfinite, isqrt

import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.compiled import array_kernel, inlined_kernel, kernel
from yeastfit.errors import InputError
from yeastfit.offlattice import parameters
from yeastfit.offlattice.colony import NO_CELL, OfflatticeColony
from yeastfit.offlattice.placing import PIXELS_PER_UM, SEMI_AXES

PIXEL = 1.55008
"""Of the real photographs, µm."""

GAP, MARGIN = parameters.GAP.default, parameters.MARGIN.default

MOST_PIXELS = 100_000_000


class TooWide(InputError):
    """A colony reaches so far that an image of pixels of the size asked for would be enormous."""


@dataclass(frozen=True)
class Ellipses:
    """Where the cells lie.

    Attributes:
        first: Number, from 1, of the cell with which the pixel becomes colony; one more than all cells where none does.
        pixel_size: µm.
    """

    first: Int[np.ndarray, "row column"]
    pixel_size: float

    @classmethod
    def of(
        cls, colony: OfflatticeColony, pixel_size: float = PIXEL, gap: float = GAP, margin: float = MARGIN
    ) -> "Ellipses":
        """Draw all cells of a colony on an image that just holds them with an empty margin.

        Arguments:
            colony: Of at least one cell.
            pixel_size: µm.
            gap: Gaps narrower than this are closed, µm; 0 for none.
            margin: Distance by which the mask's edge lies outside of the cells, µm.

        Returns:
            What `mask` needs for any number of cells.

        Raises:
            InputError: The colony has no cells; the pixel size is not above 0; the gap or the margin is negative.
            TooWide: The image would have more than `MOST_PIXELS`.
        """
        if not isfinite(pixel_size) or pixel_size <= 0:
            raise InputError(f"pixel_size is {pixel_size} µm, need a size above 0")
        for name, width in (("gap", gap), ("margin", margin)):
            if not isfinite(width) or width < 0:
                raise InputError(f"{name} is {width} µm, it must be at least 0")
        if not colony.x.size:
            raise InputError(f"colony: it has no cells to draw ({colony.message})")
        unit = pixel_size * PIXELS_PER_UM  # of an image's pixel, in the model's lengths
        half = ceil((max(np.abs(colony.x).max(), np.abs(colony.y).max()) + SEMI_AXES.max()) / unit) + 1
        radius, beyond = gap / (2 * pixel_size), margin / pixel_size
        half += ceil(radius + beyond)
        if (2 * half) ** 2 > MOST_PIXELS:
            raise TooWide(
                f"pixel_size is {pixel_size} µm: an image of {2 * half} pixels a side, at most "
                f"{isqrt(MOST_PIXELS)} are drawn, choose a larger one"
            )
        first = np.full((2 * half, 2 * half), NO_CELL, dtype=np.int32)
        shapes = SEMI_AXES[colony.pseudohyphal.astype(int)] / unit
        centres = np.stack([half - 0.5 - colony.y / unit, half - 0.5 + colony.x / unit], axis=1)
        _draw(centres, colony.theta, shapes, first)
        return cls(-_least_within_disc(-_least_within_disc(first, radius + beyond), radius), pixel_size)

    def mask(self, cells: int) -> Bool[np.ndarray, "row column"]:
        """The mask of so many first cells; of all, where fewer were born."""
        return self.first <= cells


def _least_within_disc(image: Int[np.ndarray, "row column"], radius: float) -> Int[np.ndarray, "row column"]:
    up = np.arange(floor(radius) + 1)
    return _least_within(image, np.floor(np.sqrt(radius**2 - up**2)).astype(np.int64)) if radius >= 1 else image


@array_kernel
def _least_within(
    image: Int[np.ndarray, "row column"], reaches: Int[np.ndarray, " up"]
) -> Int[np.ndarray, "row column"]:
    """The least around each pixel, in a shape that reaches so far left and right of it in its row and each further one.

    The further a row is, the less far the shape reaches in it.
    """
    rows = image.shape[0]
    found = image.copy()
    for i in range(rows):
        here, line, reach = image[i], image[i].copy(), 0  # the least within this reach
        for up in range(len(reaches) - 1, -1, -1):
            while reach < reaches[up]:
                reach += 1
                _lower(line[: line.size - reach], here[reach:])
                _lower(line[reach:], here)
            if i >= up:
                _lower(found[i - up], line)
            if i + up < rows:
                _lower(found[i + up], line)
    return found


@inlined_kernel
def _lower(line: Int[np.ndarray, " column"], to: Int[np.ndarray, " column2"]) -> None:
    """Where the other is less, take it."""
    for j in range(line.size):
        line[j] = min(line[j], to[j])


@kernel
def _draw(
    centres: Float[np.ndarray, "cell 2"],
    theta: Float[np.ndarray, " cell"],
    semi_axes: Float[np.ndarray, "cell 2"],
    first: Int[np.ndarray, "row column"],
) -> None:
    """Fill `first`: in the row at height h above the centre, p s² + 2 q h s + r h² ≤ 1 with s to the right of it."""
    for cell in range(len(centres)):
        cos, sin = np.cos(theta[cell]), np.sin(theta[cell])
        a, b = semi_axes[cell]
        height = np.hypot(a * sin, b * cos)
        row, column = centres[cell]
        p = (cos / a) ** 2 + (sin / b) ** 2
        q = cos * sin * (1 / a**2 - 1 / b**2)
        r = (sin / a) ** 2 + (cos / b) ** 2
        for i in range(int(np.ceil(row - height)), int(np.floor(row + height)) + 1):
            up = row - i
            root = (q * up) ** 2 - p * (r * up * up - 1)
            if root < 0:
                continue
            middle, half = column - q * up / p, np.sqrt(root) / p
            for j in range(int(np.ceil(middle - half)), int(np.floor(middle + half)) + 1):
                if first[i, j] > cell + 1:
                    first[i, j] = cell + 1
