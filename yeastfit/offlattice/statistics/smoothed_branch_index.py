"""The branch index of Li et al. 2024 of smoothed outlines, so that photographs and simulations can be compared.

Ends of a skeleton count every bump of an outline. Of masks as Li et al. draw them, in bins of four pixels, I_B rises by
27 to 32 % once they were photographed and outlined again, with noise of a pixel at the edge: 1.4 to 2.0 standard
deviations of a colony (`benchmarks.recovery_offlattice`). Here both are smoothed first:

    smoothed I_B = (ends − 25) / 575,   ends of the skeleton of the pixels at r' ≥ r_CSR in one quadrant
                                        where G * mask > 1/2

with G a Gaussian of 2 pixels, 3.1 µm; centroid, quadrant and r_CSR are those of the mask itself (`li2024_statistics`).
Then photographed masks are off by 0.07 standard deviations at most, and colonies differ as much beside the mean.
"""

from math import floor, nan

import numpy as np
from jaxtyping import Bool, Float, UInt8

from yeastfit.compiled import array_kernel
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.offlattice.statistics.golay_skeleton import count_ends, skeleton
from yeastfit.offlattice.statistics.li2024_statistics import I_B, Li2024, branch_index, centroid, cut_core, measured

WIDTH = 2.0  # pixels, the standard deviation of the Gaussian
REACH = 8  # pixels to which it is taken into account
GAUSSIAN = np.exp(-0.5 * (np.arange(REACH + 1) / WIDTH) ** 2)  # from its middle on
WEIGHTS = GAUSSIAN / (2 * GAUSSIAN.sum() - GAUSSIAN[0])  # of a pixel and of those at a distance of 1, 2, …


def smoothed_branch_index(colony: Bool[np.ndarray, "row column"], found: Li2024) -> float:
    """I_B of the smoothed mask; nan where the colony ends within its first ring.

    Arguments:
        colony: True where the colony is.
        found: What Li et al. measure on it.
    """
    if not np.isfinite(found.csr_radius):
        return nan
    row, column = (floor(place + 0.5) for place in centroid(colony))
    rows, columns = np.flatnonzero(colony.any(axis=1)), np.flatnonzero(colony.any(axis=0))
    top, left = max(rows[0] - REACH, 0), max(columns[0] - REACH, 0)
    quadrant = colony[top : row + 1 + REACH, left : column + 1 + REACH].view(np.uint8)
    smooth = smoothed(quadrant, WEIGHTS, row + 1 - top, column + 1 - left)
    cut_core(smooth, row - top, column - left, round(found.csr_radius))
    return branch_index(count_ends(skeleton(smooth)))


@array_kernel
def smoothed(
    image: UInt8[np.ndarray, "row column"], weights: Float[np.ndarray, " distance"], height: int, width: int
) -> Bool[np.ndarray, "row1 column1"]:
    """Where the mean of an image of 0 and 1, by weights along rows and columns, is above 1/2; outside all is 0.

    Arguments:
        image: Of which so many first rows and columns are smoothed; the others are their neighbours.
        weights: Of a pixel and of those at a distance of 1, 2, … at both sides.
        height: That many rows.
        width: That many columns.
    """
    rows, columns = image.shape
    reach = len(weights) - 1
    smooth = np.empty((height, width), dtype=np.bool_)
    row, mean = np.zeros(columns + 2 * reach), np.empty(width)
    inside = row[reach : reach + columns]
    for i in range(height):
        here = image[i]
        for j in range(columns):
            inside[j] = weights[0] * here[j]
        for k in range(1, reach + 1):
            above, below = image[max(i - k, 0)], image[min(i + k, rows - 1)]
            of_above, of_below = weights[k] * (i >= k), weights[k] * (i + k < rows)
            for j in range(columns):
                inside[j] += of_above * above[j] + of_below * below[j]
        for j in range(width):
            mean[j] = weights[0] * inside[j]
        for k in range(1, reach + 1):
            left, right, of_both = row[reach - k :], row[reach + k :], weights[k]
            for j in range(width):
                mean[j] += of_both * (left[j] + right[j])
        found = smooth[i]
        for j in range(width):
            found[j] = mean[j] > 0.5
    return smooth


def _value(pixels: Pixels) -> float:
    return smoothed_branch_index(pixels.colony, pixels.derived(measured))


SMOOTHED = Statistic(
    "smoothed_branch_index",
    0,
    "I_B of Li et al. 2024 of the outline smoothed over 2 pixels, which noise at the edge hardly changes",
    "smoothed I_B",
    mask=_value,
    may_vanish=True,
    possible=I_B,
)
