"""Box-counting dimension of a colony's outline.

The outline is the set of colony pixels with one of their eight neighbours outside the colony, holes included. N(s) is
the number of boxes of s × s pixels that hold some of it, averaged over all s² positions of the grid of boxes; since a
box holds some exactly where the outline dilated by the box is met,

    N(s) = |outline ⊕ box(s)| / s²,    D = −slope of log N over log s,

by least squares over s = 2, 4, 8, … up to a quarter of the longer side of the colony's bounding box. The average over
positions makes N independent of where the colony lies, and of turning it by 90° or mirroring it. A smooth outline has
D = 1. The mask itself, which has a solid core, would give a D near 2 whatever its filaments do.

Obert, Pfeifer & Sernetz 1990, "Microbial growth patterns described by fractal geometry", J. Bacteriol. 172:1180,
doi:10.1128/jb.172.3.1180-1185.1990, count boxes of the mass and of the surface of microbial growth; this is the
surface. The average over positions, the eight neighbours (a digital line then has D = 1 in every direction) and the
range of s are choices of this module. D depends on that range: compare it at one pixel size.
"""

import numpy as np
import scipy
from jaxtyping import Float, Int

from yeastfit.measure.statistics.pixels import Mask, Pixels
from yeastfit.measure.statistics.statistic import Statistic

MIN_SIZES = 3
"""Fewer sizes of box do not determine a slope."""


def fractal_dimension(pixels: Pixels) -> float:
    """D; nan for a colony whose bounding box is less than 32 pixels long."""
    sizes, counts = box_counts(pixels)
    if len(sizes) < MIN_SIZES:
        return float("nan")
    return float(-np.polyfit(np.log(sizes), np.log(counts), 1)[0])


def box_counts(pixels: Pixels) -> tuple[Int[np.ndarray, " size"], Float[np.ndarray, " size"]]:
    """The sizes of boxes, in pixels, and N of each; both empty for a colony less than 8 pixels long."""
    longest = max(pixels.colony.shape) - 2
    sizes = 2 ** np.arange(1, max(1, longest.bit_length() - 2))
    dilated = np.pad(outline(pixels.colony), ((0, longest // 4), (0, longest // 4)))
    counts = []
    for size in sizes:
        dilated = _twice_as_wide(dilated, int(size) // 2)
        counts.append(dilated.sum() / size**2)
    return sizes, np.array(counts, dtype=float)


def outline(colony: Mask) -> Mask:
    """Colony pixels with one of eight neighbours outside."""
    return colony & ~scipy.ndimage.binary_erosion(colony, np.ones((3, 3)))


def _twice_as_wide(dilated: Mask, size: int) -> Mask:
    """Dilate from a box of `size` to one of 2 `size`, towards the end of both axes."""
    for _ in range(2):
        wider = dilated.copy()
        wider[size:] |= dilated[:-size]
        dilated = wider.T
    return dilated


ENTRIES = (
    Statistic("fractal_dimension", 0, "box-counting dimension of the outline", mask=fractal_dimension, may_vanish=True),
)
