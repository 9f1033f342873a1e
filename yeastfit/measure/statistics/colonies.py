"""Several colonies in one image: how many objects there are, and the largest of them.

Cells let go of their mothers (`random` detachment), die and leave gaps, or lie beside each other by chance, so that one
image shows several objects. Statistics of all of them together are those of `shape`; here stand

    object_count     the number of 8-connected objects
    largest share    |O| / |M|,    O the object of the most pixels, M all of them

and area, compactness P² / (4πA) and radius of O alone, as `shape` defines them. With one object the share is 1 and the
others are those of `shape`.
"""

from math import pi

import numpy as np
import scipy

from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.numbers import Range

TOUCHING = np.ones((3, 3), dtype=bool)
OF_OBJECT = Range(0.5, 1e9)
"""Compactness of an object of any size: of a single pixel 0.57."""


def largest_object(pixels: Pixels) -> Pixels:
    """O; of several of the same size the one whose pixels scatter most, however the image is turned."""
    labels, count = scipy.ndimage.label(pixels.colony, TOUCHING)
    if count == 1:
        return pixels
    sizes = np.bincount(labels.ravel())[1:]
    largest = 1 + np.flatnonzero(sizes == sizes.max())
    if len(largest) > 1:
        rows, columns = np.broadcast_arrays(*np.ogrid[: labels.shape[0], : labels.shape[1]])
        scatter = scipy.ndimage.variance(rows, labels, largest) + scipy.ndimage.variance(columns, labels, largest)
        largest = largest[np.argmax(scatter)]
    return Pixels.of(labels == largest)


def _largest_compactness(pixels: Pixels) -> float:
    largest = pixels.derived(largest_object)
    return largest.perimeter**2 / (4 * pi * largest.area)


ENTRIES = (
    Statistic(
        "largest_share",
        0,
        "share of area in the largest object",
        mask=lambda p: p.derived(largest_object).area / p.area,
        possible=Range(0.0, 1.0, above=True),
    ),
    Statistic("largest_area", 2, "area of the largest object", mask=lambda p: float(p.derived(largest_object).area)),
    Statistic(
        "largest_compactness",
        0,
        "compactness of the largest object",
        mask=_largest_compactness,
        measurement_error=0.02,
        possible=OF_OBJECT,
    ),
    Statistic(
        "largest_radius",
        1,
        "mean distance of the largest object from its centroid",
        mask=lambda p: float(p.derived(largest_object).distance.mean()),
        possible=Range(0.0),
    ),
)
