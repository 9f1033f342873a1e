"""Skeletons by thinning, as scikit-image's `skeletonize` finds them, fast for large images where numba is installed.

Zhang & Suen 1984, "A fast parallel algorithm for thinning digital patterns", Commun. ACM 27:236,
doi:10.1145/357994.358023. Of the neighbours of a pixel B are on, and A times around the ring one that is off is
followed by one that is on. Two passes take turns until neither removes a pixel. Each removes, all at once, those with
2 ≤ B ≤ 6 and A = 1, and

    first pass     one of N, E, S off  and  one of E, S, W off
    second pass    one of N, E, W off  and  one of N, S, W off

but for 25 of the 256 neighbourhoods, `OTHERWISE`, which scikit-image treats in another way: corners of lines go, and
the end of a line two pixels wide goes in one pass only or not at all. Here only pixels next to one that was removed are
looked at again, so that the cost follows the area once and not in every pass; the skeleton is the same.
"""

import sys
from functools import cache
from importlib.util import find_spec

import numpy as np
from jaxtyping import Bool

LARGE = 100_000
"""Pixels of an image from which on importing numba pays, where it has not been imported yet."""

OTHERWISE = {
    **dict.fromkeys((24, 192), ()),
    **dict.fromkeys((3, 6, 7, 67, 97, 99, 129, 133, 193, 208), (0,)),
    **dict.fromkeys((12, 13, 28, 48, 52, 54, 88, 96, 112), (1,)),
    **dict.fromkeys((5, 20, 65, 80), (0, 1)),
}
"""Passes, counted from 0, that remove a pixel with such a code of its neighbours."""


def skeleton(image: Bool[np.ndarray, "row column"], turn: int = 0) -> Bool[np.ndarray, "row column"]:
    """Thin an image; pixels outside it are off.

    Arguments:
        image: What is thinned.
        turn: As which the passes see it: `turned` so. The sides of a shape are worn off in another order then.
    """
    if not with_numba(image.size):
        from skimage.morphology import skeletonize

        return turned_back(skeletonize(turned(image, turn)), turn)
    from yeastfit.measure.statistics.compiled_thinning import thin

    padded = np.pad(image, 1)
    thin(padded, removes(turn))
    return padded[1:-1, 1:-1]


def turned(image: Bool[np.ndarray, "row column"], turn: int) -> Bool[np.ndarray, "row1 column1"]:
    """An image turned left by 90°, 0 to 3 times; from 4 on as many times less 4, mirrored left to right before."""
    return np.rot90(image if turn < 4 else image[:, ::-1], turn)


def turned_back(image: Bool[np.ndarray, "row column"], turn: int) -> Bool[np.ndarray, "row1 column1"]:
    """Undo `turned`."""
    upright = np.rot90(image, -turn)
    return upright if turn < 4 else upright[:, ::-1]


def with_numba(size: int) -> bool:
    """Whether functions compiled by numba are used for an image of so many pixels."""
    return _numba_is_installed() and (size >= LARGE or "yeastfit.compiled" in sys.modules)


@cache
def _numba_is_installed() -> bool:
    return find_spec("numba") is not None


@cache
def removes(turn: int = 0) -> Bool[np.ndarray, "number code"]:
    """Whether each pass removes a pixel whose neighbours have this code, clockwise from the north, lowest bit first.

    turn: Where it sees the image `turned` so. A turn puts the east in the north's place, mirroring the west.
    """
    on = ((np.arange(256)[:, None] >> np.arange(8)) & 1).astype(bool)
    count, runs = on.sum(axis=1), (~on & np.roll(on, -1, axis=1)).sum(axis=1)
    north, east, south, west = on[:, ::2].T
    first = ~(north & east & south) & ~(east & south & west)
    second = ~(north & east & west) & ~(north & south & west)
    table = (count >= 2) & (count <= 6) & (runs == 1) & np.stack([first, second])
    for code, passes in OTHERWISE.items():
        table[:, code] = [number in passes for number in (0, 1)]
    seen = np.roll(on if turn < 4 else on[:, -np.arange(8)], -2 * turn, axis=1)
    return np.take(table, seen @ (1 << np.arange(8)), axis=1)
