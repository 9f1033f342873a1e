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
from jaxtyping import Bool

from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.offlattice.statistics.golay_skeleton import count_ends, skeleton
from yeastfit.offlattice.statistics.li2024_statistics import I_B, Li2024, branch_index, centroid, cut_core, measured
from yeastfit.offlattice.statistics.smoothed_outline import REACH, WEIGHTS, smoothed


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
