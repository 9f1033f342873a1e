"""Loops over the pixels of a colony, compiled by numba: what `filaments` does in several steps of NumPy without it."""

import numpy as np
from jaxtyping import Bool, Int

from yeastfit.compiled import array_kernel, inlined_kernel, kernel


@array_kernel
def in_rings(
    colony: Bool[np.ndarray, "row column"], row: float, column: float, ring: float, tie: float
) -> tuple[Int[np.ndarray, " ring"], float]:
    """Number of pixels in each ring around a centre, which has a number of its own, and the largest distance.

    Arguments:
        colony: Which pixels there are.
        row: Of the centre.
        column: Of the centre.
        ring: Width of a ring, a power of two, so that its inverse is exact.
        tie: How far beyond its end a pixel still belongs to it, in rings.
    """
    farthest = np.sqrt(float(colony.shape[0] ** 2 + colony.shape[1] ** 2))
    held, largest = np.zeros(int(farthest / ring) + 3, dtype=np.int64), 0.0
    rings_per_pixel = 1 / ring  # a division each would take longer than all else
    for i in range(colony.shape[0]):
        for j in range(colony.shape[1]):
            if colony[i, j]:
                square = (i - row) ** 2 + (j - column) ** 2
                held[int(np.sqrt(square) * rings_per_pixel + (1 - tie))] += 1
                largest = max(largest, square)
    return held, np.sqrt(largest)


@array_kernel
def with_ring(
    colony: Bool[np.ndarray, "row column"], row: float, column: float, inner: float, outer: float
) -> Bool[np.ndarray, "row column"]:
    """See `filaments._with_ring`."""
    found = np.empty(colony.shape, dtype=np.bool_)
    for i in range(colony.shape[0]):
        for j in range(colony.shape[1]):
            square = (i - row) ** 2 + (j - column) ** 2
            found[i, j] = (square >= inner) & (colony[i, j] | (square < outer))
    return found


@kernel
def followed(
    thin: Bool[np.ndarray, "row column"], rows: Int[np.ndarray, " pixel"], columns: Int[np.ndarray, " pixel"]
) -> tuple[int, int, int]:
    """See `filaments._followed`."""
    ends = along = across = 0
    for row, column in zip(rows, columns):  # noqa: B905, numba has no strict
        north, south = _on(thin, row - 1, column), _on(thin, row + 1, column)
        west, east = _on(thin, row, column - 1), _on(thin, row, column + 1)
        straight, diagonal = north + south + west + east, 0
        for i in (-1, 1):
            for j in (-1, 1):
                there = _on(thin, row + i, column + j)
                diagonal += there
                beside = (north if i < 0 else south) or (west if j < 0 else east)
                across += there and not beside
        along += straight
        ends += straight + diagonal <= 1
    return ends, along, across


@inlined_kernel
def _on(image: Bool[np.ndarray, "row column"], row: int, column: int) -> bool:
    """Whether a pixel is on; outside the image none is."""
    return 0 <= row < image.shape[0] and 0 <= column < image.shape[1] and image[row, column]
