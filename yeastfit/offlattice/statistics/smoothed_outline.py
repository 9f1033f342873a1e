"""Statistics of texture of smoothed outlines, so that photographs and simulations can be compared.

A perimeter, and a skeleton's ends and length, count every bump of an outline, and outlines of photographs have many of
a pixel, by hand or by program, which those of simulated cells do not have. Smoothed over one pixel, the masks of Li et
al. 2024 of AWRI 796 at 500 µM have 113 ends of 195, 1.4 standard deviations between colonies fewer; skeletons are
shorter by 0.5, compactness is smaller by 0.4, and filaments are wider by 0.5 of them. Colonies drawn as ellipses change
by 0.01 at most. So both are smoothed:

    smoothed S = S of the pixels where G * mask > 1/2,    S = compactness, branch_count, branch_length, filament_width

G a Gaussian of 2 pixels, 3.1 µm. Filaments thinner than 1.35 of its width, 2.7 pixels, are lost from both. What is cut
off by that remains, as parts of their own.
"""

from functools import partial
from math import nan

import numpy as np
from jaxtyping import Bool, Float, UInt8

from yeastfit.compiled import array_kernel
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.statistic import Statistic

WIDTH = 2.0  # pixels, the standard deviation of the Gaussian
REACH = 8  # pixels to which it is taken into account
GAUSSIAN = np.exp(-0.5 * (np.arange(REACH + 1) / WIDTH) ** 2)  # from its middle on
WEIGHTS = GAUSSIAN / (2 * GAUSSIAN.sum() - GAUSSIAN[0])  # of a pixel and of those at a distance of 1, 2, …


def smoothed_outline(pixels: Pixels) -> Pixels | None:
    """The pixels where G * mask > 1/2.

    Arguments:
        pixels: Of a colony. No pixel outside of the rectangle that holds it has a mean above 1/2.

    Returns:
        None of a colony so small that nothing is left.
    """
    smooth = smoothed(pixels.colony.view(np.uint8), WEIGHTS, *pixels.colony.shape)
    return Pixels.of(smooth) if smooth.any() else None


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


def _of_smoothed(name: str, pixels: Pixels) -> float:
    smooth, entry = pixels.derived(smoothed_outline), STATISTICS[name]
    assert entry.mask is not None
    return nan if smooth is None else entry.mask(smooth)


def _smoothed(name: str) -> Statistic:
    one = STATISTICS[name]
    return Statistic(
        f"smoothed_{name}",
        one.unit_power,
        f"{name} of the outline smoothed over 2 pixels, which noise at the edge hardly changes",
        f"{one.label}, smoothed",
        mask=partial(_of_smoothed, name),
        may_vanish=one.may_vanish,
        possible=one.possible,
    )


TEXTURE = tuple(map(_smoothed, ("compactness", "branch_count", "branch_length", "filament_width")))
