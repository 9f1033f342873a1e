"""What covers the points of a grid, compiled by numba: the sum of `level_set`, for the nutrient and for statistics.

That is Σ_k w_k exp(−f_k / s), or hard max_k max(−f_k, 0). A cell covers so few points that what is done for each row
of them would take longer than the points: terms are collected, and worked out `COLLECTED` at a time.
"""

from math import exp, inf

import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.compiled import array_kernel, kernel
from yeastfit.model.cells import LARGEST

COLLECTED = 512
PER_LOG2 = 1.4426950408889634  # 1 / log 2
LOG2 = 0.693359375, -2.1219444005469058e-4  # their sum; multiples of the first are exact
EXPONENT, FRACTION = 127, 23  # of a number in single precision: what is added to the one, and bits of the other


@array_kernel
def boxes_of(
    points: int,
    centres: Float[np.ndarray, "cell 2"],
    directions: Float[np.ndarray, "cell 2"],
    halves: tuple[Float[np.ndarray, " cell"], Float[np.ndarray, " cell"]],
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    reach: float,
    furthest: float,
) -> Int[np.ndarray, "cell 4"]:
    """First and last grid point of each cell along x and along y; none where last is below first.

    These are the points of its patches in `level_set`, which cover r² up to `reach`, as far as f is below `furthest`.
    """
    kind = centres.dtype.type
    origin, per_spacing, patch = kind(grid[0]), kind(1 / grid[1]), kind(grid[2])
    counted, seen = kind(np.sqrt(reach)), kind(np.sqrt(1.0 + furthest))
    zero, one, side = kind(0), kind(1), kind(points)
    boxes = np.empty((len(weights), 4), np.int32)
    for k in range(len(weights)):
        boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3] = 0, -1, 0, -1
        if not weights[k] > 0:
            continue
        somewhere = True
        for axis in range(2):
            along, over = halves[0][k] * directions[k, axis], halves[1][k] * directions[k, 1 - axis]
            extent = np.sqrt(along * along + over * over) * per_spacing
            middle = (centres[k, axis] - origin) * per_spacing
            somewhere &= (abs(middle) < inf) & (extent < inf)
            first = np.ceil(_clipped(middle - counted * extent, zero, side))
            last = np.floor(_clipped(middle + counted * extent, -one, side - one))
            last = min(first + patch * np.ceil((last - first + one) / patch), side) - one
            first = max(first, np.ceil(_clipped(middle - seen * extent, zero, side)))
            last = min(last, np.floor(_clipped(middle + seen * extent, -one, side - one)))
            boxes[k, 2 * axis], boxes[k, 2 * axis + 1] = first, last
        if not somewhere:
            boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3] = 0, -1, 0, -1
    return boxes


@kernel
def _clipped(value: float, low: float, high: float) -> float:
    """Between two bounds of the same precision."""
    return min(max(value, low), high)


@array_kernel
def cover(
    covered: Float[np.ndarray, "i j"],
    low: tuple[int, int],
    tiles: tuple[Bool[np.ndarray, "tile tile"], int],
    boxes: Int[np.ndarray, "cell 4"],
    centres: Float[np.ndarray, "cell 2"],
    directions: Float[np.ndarray, "cell 2"],
    halves: tuple[Float[np.ndarray, " cell"], Float[np.ndarray, " cell"]],
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    union: float,
    furthest: float,
) -> None:
    """Add to `covered`, whose first point is `low`, at the points of tiles at work; elsewhere something or nothing.

    Arguments:
        covered: 0.
        low: A point of the grid.
        tiles: Which are at work, and points along the side of one.
        boxes: `boxes_of` the cells.
        centres: As in `Cells`.
        directions: Likewise.
        halves: Half lengths and half widths.
        weights: Likewise.
        grid: Coordinate of its first point along either axis, spacing, and points along a side of a patch.
        union: s, 0 for the hard union.
        furthest: f from which a cell is not looked at; 0 for the hard union.
    """
    kind, (work, tile) = covered.dtype.type, tiles
    hard, one, across_row = union == 0, kind(1), covered.shape[1]
    beyond, scale = kind(furthest), one if hard else kind(1 / union)
    x, y = np.empty(covered.shape[0], covered.dtype), np.empty(covered.shape[1], covered.dtype)
    for i in range(len(x)):
        x[i] = grid[0] + grid[1] * (low[0] + i)
    for j in range(len(y)):
        y[j] = grid[0] + grid[1] * (low[1] + j)
    place, whose = np.empty(COLLECTED, np.int32), np.empty(COLLECTED, np.int32)
    value = np.empty(COLLECTED, covered.dtype)
    found = 0
    for k in range(len(weights)):
        first_x, last_x, first_y, last_y = boxes[k]
        if not _any_of(work, first_x // tile, last_x // tile, first_y // tile, last_y // tile):
            continue
        first_x, last_x = max(first_x - low[0], 0), min(last_x - low[0] + 1, covered.shape[0])
        first_y, last_y = max(first_y - low[1], 0), min(last_y - low[1] + 1, covered.shape[1])
        cos, sin = directions[k, 0], directions[k, 1]
        along, across = one / (halves[0][k] * halves[0][k]), one / (halves[1][k] * halves[1][k])
        xx, yy = cos * cos * along + sin * sin * across, sin * sin * along + cos * cos * across
        xy = cos * sin * (along - across)
        for i in range(first_x, last_x):
            dx = x[i] - centres[k, 0]
            here, slope = xx * dx * dx - one, (xy + xy) * dx
            for j in range(first_y, last_y):
                dy = y[j] - centres[k, 1]
                f = here + dy * (slope + yy * dy)
                value[found], place[found], whose[found] = f * scale, i * across_row + j, k
                found += f < beyond  # otherwise the next one takes its place
                if found == COLLECTED:
                    _add(covered.reshape(-1), place, value, whose, weights, found, hard)
                    found = 0
    _add(covered.reshape(-1), place, value, whose, weights, found, hard)


@kernel
def _add(
    covered: Float[np.ndarray, " point"],
    place: Int[np.ndarray, " term"],
    value: Float[np.ndarray, " term"],
    whose: Int[np.ndarray, " term"],
    weights: Float[np.ndarray, " cell"],
    found: int,
    hard: bool,
) -> None:
    """The terms that have been collected, of which `value` is f / s, hard f."""
    if hard:
        for m in range(found):
            covered[place[m]] = max(covered[place[m]], -value[m])
        return
    falling_exponential(value, found)
    for m in range(found):
        covered[place[m]] += weights[whose[m]] * value[m]


@kernel
def falling_exponential(x: Float[np.ndarray, " term"], count: int) -> None:
    """exp(−x) of the first so many, in place.

    In single precision for |x| < 87, many at a time: 2ⁿ eʳ, n whole and |r| ≤ ½ log 2, of which seven terms of the
    series are exact to the last bits.
    """
    kind = x.dtype.type
    if np.finfo(x.dtype).eps < np.finfo(np.float32).eps:
        for m in range(count):
            x[m] = exp(-x[m])
        return
    for m in range(count):
        n = np.floor(kind(0.5) - x[m] * kind(PER_LOG2))
        r = -x[m] - n * kind(LOG2[0]) - n * kind(LOG2[1])
        series = kind(1 / 120) + r * (kind(1 / 720) + r * kind(1 / 5040))
        series = kind(1 / 2) + r * (kind(1 / 6) + r * (kind(1 / 24) + r * series))
        power = np.int32((np.int32(n) + np.int32(EXPONENT)) << np.int32(FRACTION)).view(np.float32)
        x[m] = power * (kind(1) + r * (kind(1) + r * series))


@kernel
def _any_of(work: Bool[np.ndarray, "i j"], first_x: int, last_x: int, first_y: int, last_y: int) -> bool:
    """Whether one of these tiles is at work."""
    for i in range(first_x, last_x + 1):
        for j in range(first_y, last_y + 1):
            if work[i, j]:
                return True
    return False


@array_kernel
def cover_all(
    covered: Float[np.ndarray, "x y"],
    centres: Float[np.ndarray, "cell 2"],
    directions: Float[np.ndarray, "cell 2"],
    halves: tuple[Float[np.ndarray, " cell"], Float[np.ndarray, " cell"]],
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    union: float,
    reach: float,
) -> None:
    """The sum at all points of a grid, of cells as far as r² is at most `reach`."""
    covered[:] = 0
    furthest = min(reach - 1.0, LARGEST * union) if union > 0 else 0.0
    boxes = boxes_of(covered.shape[0], centres, directions, halves, weights, grid, reach, furthest)
    one_tile = np.ones((1, 1), np.bool_), covered.shape[0]
    cover(covered, (0, 0), one_tile, boxes, centres, directions, halves, weights, grid, union, furthest)
