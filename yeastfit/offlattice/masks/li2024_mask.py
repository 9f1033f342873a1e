"""Masks of a colony's first n cells as Li et al. 2024 draw them, for every n from one look at the cells.

1. The twelve vertices of every cell are put into square bins of 4 pixels, with edges at multiples of 4 pixels from the
   origin: rows are x from −700 to 700, columns y from −900 to 900. Vertices outside are dropped. A frame that holds all
   (`BinnedOutlines.whole`) shows the same, with another margin, of a colony that theirs holds.
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
quarters are its mirror images. Bit 4i + j of a bin's code is its pixel in row i and column j.
"""

from dataclasses import dataclass
from functools import cache, reduce
from math import ceil

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt16, UInt32

from yeastfit.compiled import array_kernel, kernel
from yeastfit.errors import InputError
from yeastfit.offlattice.colony import NO_CELL, OfflatticeColony
from yeastfit.offlattice.placing import DIRECTIONS, PIXELS_PER_UM, SEMI_AXES

BIN = 4
FRAME = (350, 450)
"""Bins along x and along y, centred on the origin."""

MARGIN = 3  # empty bins at each side of a frame that holds the whole colony: a bin's pixels depend on two
SMALLEST_HOLE = 10
UNIT = 1024
ALL = 0xFFFF
WEIGHTS = np.array([[-49, 987, 93, -7], [-75, 745, 399, -45]])
"""Of the bins at −1, 0, 1 and 2, for pixels at 1/8 and 3/8, times `UNIT`."""
ROWS_OF_BINS = (np.arange(16)[:, None] >> np.arange(4) & 1).astype(bool).view(np.uint32).ravel()
"""The four pixels of a row of a bin, by their bits, as one word."""


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
        first = np.full(frame, NO_CELL, dtype=np.int32)
        dropped = _bin(colony.x, colony.y, colony.direction, colony.pseudohyphal, OUTLINES, first)
        return cls(first, colony.x.size, dropped)

    @classmethod
    def whole(cls, colony: OfflatticeColony) -> "BinnedOutlines":
        """Put all cells of a colony into bins, in a frame that holds them all.

        Arguments:
            colony: See `of`.

        Returns:
            As `of` does; nothing is dropped.
        """
        reach = [float(np.abs(centres).max(initial=0.0)) + SEMI_AXES.max() for centres in (colony.x, colony.y)]
        rows, columns = (2 * (ceil(one / BIN) + MARGIN) for one in reach)
        return cls.of(colony, (rows, columns))

    @property
    def pixel_size(self) -> float:
        """µm."""
        return 1 / PIXELS_PER_UM

    def mask(self, cells: int) -> Bool[np.ndarray, "x y"]:
        """The mask of so many first cells, 4 pixels a bin; of all, where fewer were born."""
        image, bins = enlarged(self.first <= cells)
        fill_holes(image, SMALLEST_HOLE, bins)
        return image


def enlarged(
    occupied: Bool[np.ndarray, "row column"],
) -> tuple[Bool[np.ndarray, "x y"], Int[np.ndarray, "bin 2"]]:
    """Four times as large, by cubic convolution in 8 bits; and all bins, with others, in which a small hole begins."""
    words = np.empty((BIN * occupied.shape[0], occupied.shape[1]), dtype=np.uint32)
    bins = np.empty((occupied.size, 2), dtype=np.int32)
    above = np.full(occupied.shape[1], ALL)
    count = _enlarge(_patterns(np.pad(occupied, 2, mode="symmetric")), _quarters(), ROWS_OF_BINS, above, words, bins)
    return words.view(bool), bins[:count]


@array_kernel
def fill_holes(image: Bool[np.ndarray, "x y"], least: int, bins: Int[np.ndarray, "bin 2"]) -> None:
    """Turn on, in place, the components of the background, 8-connected, that have fewer than so many pixels.

    bins: Row and column of those that hold the first pixel, row by row, of every such component.
    """
    found = np.empty((least, 2), dtype=np.int64)
    for k in range(len(bins)):
        for row in range(BIN * bins[k, 0], BIN * bins[k, 0] + BIN):
            for column in range(BIN * bins[k, 1], BIN * bins[k, 1] + BIN):
                if not image[row, column] and not _off_before(image, row, column):
                    _fill_hole(image, found, row, column)


@kernel
def _fill_hole(image: Bool[np.ndarray, "x y"], found: Int[np.ndarray, "pixel 2"], row: int, column: int) -> None:
    """Turn on the component of this pixel if it has fewer pixels than `found`."""
    found[0] = row, column
    size, looked_at, least = 1, 0, found.shape[0]
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
def _quarters() -> UInt8[np.ndarray, "quarter pattern"]:
    """The four pixels of each quarter of a bin, upper and lower left, upper and lower right, as bits, by pattern.

    Bit 4i + j of a pattern is row i and column j of the 4 × 4 bins around the quarter, and of the result row i and
    column j of its 2 × 2 pixels.
    """
    bits = (np.arange(1 << 16)[:, None] >> np.arange(16)) & 1
    along_rows = np.einsum("si,pij->psj", WEIGHTS, 255 * bits.reshape(-1, 4, 4))
    along_rows = np.clip((along_rows + UNIT // 2) // UNIT, 0, 255)
    both = np.einsum("tj,psj->pst", WEIGHTS, along_rows)
    on = np.clip((both + UNIT // 2) // UNIT, 0, 255) > 128
    lower_right = (on.reshape(-1, 4) << np.arange(4)).sum(axis=1).astype(np.uint8)
    turned = np.arange(1 << 16).reshape((2,) * 16), np.arange(16).reshape((2,) * 4)  # one axis a bit, highest first
    spread = (np.arange(16) & 3 | (np.arange(16) & 12) << 2).astype(np.uint8)  # from bit 2i + j to bit 4i + j
    quarters = []
    for down, right in ((0, 0), (1, 0), (0, 1), (1, 1)):
        pattern, pixels = (_mirrored(one, bool(down), bool(right)) for one in turned)
        quarters.append(spread[pixels[lower_right[pattern]]])
    return np.stack(quarters)


def _mirrored(codes: Int[np.ndarray, "*bit"], down: bool, right: bool) -> Int[np.ndarray, " code"]:
    """Codes whose bits are those of a square of side 2 or 4, mirrored where it does not lie down or right."""
    side = int(np.sqrt(codes.ndim))
    axes = np.arange(codes.ndim).reshape(side, side)
    axes = axes if down else axes[::-1]
    axes = axes if right else axes[:, ::-1]
    return codes.transpose(axes.ravel()).ravel()


def _patterns(padded: Bool[np.ndarray, "row column"]) -> UInt16[np.ndarray, "row3 column3"]:
    """Of every 4 × 4 bins."""
    held = padded.astype(np.uint16)
    nibbles = reduce(np.bitwise_or, [held[:, j : held.shape[1] - 3 + j] << j for j in range(4)])
    return reduce(np.bitwise_or, [nibbles[i : held.shape[0] - 3 + i] << (4 * i) for i in range(4)])


@kernel
def _enlarge(
    patterns: UInt16[np.ndarray, "row1 column1"],
    quarters: UInt8[np.ndarray, "quarter pattern"],
    rows_of_bins: UInt32[np.ndarray, " bits"],
    above: Int[np.ndarray, " column"],
    words: UInt32[np.ndarray, "x column"],
    bins: Int[np.ndarray, "bin 2"],
) -> int:
    """Set all pixels, four in a word.

    A hole begins where a pixel is off and those above it and to its left are on, or outside. Bins with such pixels are
    listed in `bins`; how many they are.

    above: Code of the bin above, column by column; first of all, of one that is on.
    """
    count = 0
    for row in range(words.shape[0] // BIN):
        upper, lower, pixels = patterns[row], patterns[row + 1], words[BIN * row : BIN * row + BIN]
        left = np.int64(ALL)
        for column in range(words.shape[1]):
            code = (
                np.int64(quarters[0, upper[column]])
                | np.int64(quarters[1, lower[column]]) << 8
                | np.int64(quarters[2, upper[column + 1]]) << 2
                | np.int64(quarters[3, lower[column + 1]]) << 10
            )
            for k in range(BIN):
                pixels[k, column] = rows_of_bins[code >> 4 * k & 15]
            on_above = code << 4 & 0xFFF0 | above[column] >> 12
            on_left = code << 1 & 0xEEEE | left >> 3 & 0x1111
            if ~code & on_above & on_left & ALL:
                bins[count] = row, column
                count += 1
            above[column] = left = code
    return count
