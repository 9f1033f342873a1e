"""Masks of a colony's first n cells as Li et al. 2024 draw them, for every n from one look at the cells.

1. The twelve vertices of every cell are put into square bins of 4 pixels, with edges at multiples of 4 pixels from the
   origin: rows are x from −700 to 700, columns y from −900 to 900. Vertices outside are dropped.
2. A bin is occupied if a vertex of the first n cells lies in it. As cells are only added, it is enough to know the
   number of the first cell with a vertex in each bin.
3. The image of occupied bins is enlarged four times as MATLAB's `imresize` enlarges a logical image: from 0 and 255 in
   8 bits, by cubic convolution (Keys 1981, "Cubic convolution interpolation for digital image processing", IEEE Trans.
   Acoust. Speech Signal Process. 29:1153, doi:10.1109/TASSP.1981.1163711, a = −1/2) down the columns and then along the
   rows, each rounded and clipped to 0 … 255, mirrored at the border; on where above 128. The four pixels of a bin lie
   at −3/8, −1/8, 1/8 and 3/8 of a bin from its middle, with weights of the four nearest bins

       w(t) = (3|t|³ − 5|t|² + 2) / 2                    |t| ≤ 1
              (−|t|³ + 5|t|² − 8|t| + 4) / 2             1 ≤ |t| ≤ 2,

   which are whole multiples of 1/1024: all is computed in whole numbers.
4. Holes of fewer than 10 pixels, 8-connected, are filled.

A quarter of a bin's 16 pixels depends on 4 × 4 bins, so a table of 2¹⁶ patterns gives its four pixels; the other
quarters are its mirror images.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from yeastfit.compiled import array_kernel, kernel
from yeastfit.errors import InputError
from yeastfit.offlattice.colony import OfflatticeColony
from yeastfit.offlattice.placing import DIRECTIONS, PIXELS_PER_UM, SEMI_AXES

BIN = 4
FRAME = (350, 450)
"""Bins along x and along y, centred on the origin."""

SMALLEST_HOLE = 10
UNIT = 1024
WEIGHTS = np.array([[-49, 987, 93, -7], [-75, 745, 399, -45]])
"""Of the bins at −1, 0, 1 and 2, for pixels at 1/8 and 3/8, times `UNIT`."""


@dataclass(frozen=True)
class BinnedOutlines:
    """Where the cells' outlines lie, in bins of 4 pixels.

    Attributes:
        first: Number, from 1, of the first cell with a vertex in the bin; one more than all cells where there is none.
        cells: How many there are.
        dropped: Vertices outside the frame.
    """

    first: Int[np.ndarray, "row column"]
    cells: int
    dropped: int

    @classmethod
    def of(cls, colony: OfflatticeColony, frame: tuple[int, int] = FRAME) -> "BinnedOutlines":
        """Put all cells of a colony into bins.

        Arguments:
            colony: Its first cells are drawn by `mask`.
            frame: Bins along x and along y.

        Returns:
            What `mask` needs for any number of cells.

        Raises:
            InputError: A side of the frame is not an even number of bins, at least 2.
        """
        if any(side < 2 or side % 2 for side in frame):
            raise InputError(f"frame is {frame}, it must be two even numbers of bins")
        first = np.full(frame, colony.x.size + 1, dtype=np.int32)
        dropped = _bin(colony.x, colony.y, colony.direction, colony.pseudohyphal, OUTLINES, first)
        return cls(first, colony.x.size, dropped)

    @property
    def pixel_size(self) -> float:
        """µm."""
        return 1 / PIXELS_PER_UM

    def mask(self, cells: int) -> Bool[np.ndarray, "x y"]:
        """The mask of so many first cells, 4 pixels a bin."""
        image = enlarged(self.first <= cells)
        fill_holes(image, SMALLEST_HOLE)
        return image


def enlarged(occupied: Bool[np.ndarray, "row column"]) -> Bool[np.ndarray, "x y"]:
    """Four times as large, by cubic convolution in 8 bits."""
    image = np.zeros((BIN * occupied.shape[0], BIN * occupied.shape[1]), dtype=bool)
    _enlarge(np.pad(occupied, 2, mode="symmetric"), _quarters(), image)
    return image


@array_kernel
def fill_holes(image: Bool[np.ndarray, "x y"], least: int) -> None:
    """Turn on, in place, the components of the background, 8-connected, that have fewer than so many pixels."""
    rows, columns = image.shape
    found = np.empty((least, 2), dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            if image[row, column] or _off_before(image, row, column):
                continue
            found[0] = row, column  # the first pixel, row by row, of its component, if that is small
            size, looked_at = 1, 0
            while looked_at < size < least:
                size = _add_neighbours(image, found, size, found[looked_at, 0], found[looked_at, 1])
                looked_at += 1
            if size < least:
                for k in range(size):
                    image[found[k, 0], found[k, 1]] = True


@kernel
def _off_before(image: Bool[np.ndarray, "x y"], row: int, column: int) -> bool:
    """Whether one of the four neighbours that a scan row by row has passed already is off."""
    if column > 0 and not image[row, column - 1]:
        return True
    if row > 0:
        for k in range(max(column - 1, 0), min(column + 2, image.shape[1])):
            if not image[row - 1, k]:
                return True
    return False


@kernel
def _add_neighbours(
    image: Bool[np.ndarray, "x y"], found: Int[np.ndarray, "pixel 2"], size: int, row: int, column: int
) -> int:
    """Append the neighbours that are off and not in `found` yet; the new size, at most the length of `found`."""
    for i in range(max(row - 1, 0), min(row + 2, image.shape[0])):
        for j in range(max(column - 1, 0), min(column + 2, image.shape[1])):
            known = image[i, j]
            for k in range(size):
                known = known or (found[k, 0] == i and found[k, 1] == j)
            if not known:
                found[size] = i, j
                size += 1
                if size == found.shape[0]:
                    return size
    return size


def outlines() -> Float[np.ndarray, "form direction vertex 2"]:
    """Vertices of the 12-gons around their centres."""
    theta, phi = np.pi / 16 * np.arange(DIRECTIONS)[:, None], np.pi / 6 * np.arange(12)
    shapes = []
    for a, b in SEMI_AXES:
        along, across = a * np.cos(phi), b * np.sin(phi)
        cos, sin = np.cos(theta), np.sin(theta)
        shapes.append(np.stack([along * cos - across * sin, along * sin + across * cos], axis=-1))
    return np.stack(shapes)


OUTLINES = outlines()


@kernel
def _bin(
    x: Float[np.ndarray, " cell"],
    y: Float[np.ndarray, " cell"],
    direction: Int[np.ndarray, " cell"],
    form: Bool[np.ndarray, " cell"],
    outlines: Float[np.ndarray, "form direction vertex 2"],
    first: Int[np.ndarray, "row column"],
) -> int:
    """Fill `first`; how many vertices lie outside."""
    rows, columns = first.shape
    dropped = 0
    for cell in range(x.size):
        outline = outlines[int(form[cell]), direction[cell] & 31]
        for k in range(12):
            row = int(np.floor((x[cell] + outline[k, 0]) / BIN)) + rows // 2
            column = int(np.floor((y[cell] + outline[k, 1]) / BIN)) + columns // 2
            if not (0 <= row < rows and 0 <= column < columns):
                dropped += 1
            elif first[row, column] > cell + 1:
                first[row, column] = cell + 1
    return dropped


@cache
def _quarters() -> UInt8[np.ndarray, " pattern"]:
    """Pixels (1/8, 1/8), (1/8, 3/8), (3/8, 1/8), (3/8, 3/8) as bits 0 to 3, by pattern.

    Bit 4i + j of a pattern is the bin i − 1 rows and j − 1 columns away.
    """
    bits = (np.arange(1 << 16)[:, None] >> np.arange(16)) & 1
    along_rows = np.einsum("si,pij->psj", WEIGHTS, 255 * bits.reshape(-1, 4, 4))
    along_rows = np.clip((along_rows + UNIT // 2) // UNIT, 0, 255)
    both = np.einsum("tj,psj->pst", WEIGHTS, along_rows)
    on = np.clip((both + UNIT // 2) // UNIT, 0, 255) > 128
    return (on.reshape(-1, 4) << np.arange(4)).sum(axis=1).astype(np.uint8)


@kernel
def _enlarge(
    padded: Bool[np.ndarray, "row4 column4"], quarters: UInt8[np.ndarray, " pattern"], image: Bool[np.ndarray, "x y"]
) -> None:
    """Set the pixels that are on; `padded` has two more bins on every side."""
    for row in range(image.shape[0] // BIN):
        for column in range(image.shape[1] // BIN):
            held = 0
            for i in range(5):
                for j in range(5):
                    held += padded[row + i, column + j]
            if held == 0:
                continue
            for s in (-1, 1):
                for t in (-1, 1):
                    pattern = 0
                    for i in range(4):
                        for j in range(4):
                            on = padded[row + 2 + s * (i - 1), column + 2 + t * (j - 1)]
                            pattern |= int(on) << (4 * i + j)
                    pixels = quarters[pattern]
                    for k in range(4):
                        if pixels >> k & 1:
                            i, j = s * (1 + 2 * (k >> 1)), t * (1 + 2 * (k & 1))
                            image[BIN * row + (i + 3) // 2, BIN * column + (j + 3) // 2] = True
