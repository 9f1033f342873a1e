"""The nutrient one step later, compiled by numba, where there is anything to do: the numbers of `medium`.

The grid is cut into tiles of `TILE`² points. A tile is at work if it, or one of the eight around it, holds nutrient
that is neither at rest nor 0, or nutrient and a cell; a difference below the precision of 1 is none. In all others a
step would change nothing: outside nothing eats, and inside nothing is left. So the work follows the rim of a colony and
not its area.

Uptake is λ6 s log max(Σ_k w_k exp(−f_k / s), 1), or hard λ6 max(−f_k, 0), f and the sum as in `cells`; the step is that
of `nutrient`, by as many sweeps.
"""

from math import log

import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.compiled import array_kernel, kernel
from yeastfit.model.compiled.covering import Shapes, boxes_of, cover, tiles_of

SHIFT = 3
TILE = 1 << SHIFT  # grid points along a side: wider than a step carries what can be seen


@array_kernel
def eat(
    nutrient: Float[np.ndarray, "x y"],
    centres: Float[np.ndarray, "cell 2"],
    directions: Float[np.ndarray, "cell 2"],
    shapes: Shapes,
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    union: tuple[float, float],
    metabolic: float,
    diffusion: tuple[float, float, int],
    rest: float,
) -> None:
    """Advance c by one time step, in place.

    Arguments:
        nutrient: c.
        centres: Of cells, as in `Cells`.
        directions: Likewise.
        shapes: Half lengths, half widths, and exponents or none.
        weights: Cells of weight 0 are none.
        grid: Coordinate of the first point along either axis, spacing, and points along a side of the patches on which
            a cell is evaluated.
        union: s, 0 for the hard union, and r² up to which a cell counts.
        metabolic: Δt λ6.
        diffusion: α, ρ and the number of sweeps.
        rest: c where nothing has eaten.
    """
    furthest = union[0] * (5.0 - log(np.finfo(nutrient.dtype).eps))  # terms below a hundredth of the precision of 1
    boxes = boxes_of(nutrient.shape[0], centres, directions, shapes, weights, grid, union[1], furthest)
    work = _at_work(nutrient, boxes, rest)
    rows = _runs(work, nutrient.shape[0])
    if len(rows) == 0:
        return
    low, shape = _surrounded(rows)
    eaten = np.zeros(shape, nutrient.dtype)
    cover(eaten, low, (work, SHIFT), boxes, centres, directions, shapes, weights, grid, union[0], furthest)
    _solve(nutrient, low, eaten, rows, union[0], metabolic, diffusion)


@array_kernel
def _at_work(
    nutrient: Float[np.ndarray, "x y"], boxes: Int[np.ndarray, "cell 4"], rest: float
) -> Bool[np.ndarray, "i j"]:
    """Which tiles are at work."""
    points, kind = nutrient.shape[0], nutrient.dtype.type
    count, precision, full = (points + TILE - 1) // TILE, kind(np.finfo(nutrient.dtype).eps), kind(rest)
    some, changed = np.zeros((count, count), np.bool_), np.zeros((count, count), np.bool_)
    here, other = np.empty(count * TILE, np.bool_), np.empty(count * TILE, np.bool_)
    for tile in range(count):
        for j in range(len(here)):
            here[j], other[j] = False, False
        for i in range(tile * TILE, min((tile + 1) * TILE, points)):
            row = nutrient[i]
            for j in range(points):
                there = abs(row[j]) > precision
                here[j] |= there
                other[j] |= there & (abs(full - row[j]) > precision)
        for j in range(count):
            for m in range(j * TILE, (j + 1) * TILE):
                some[tile, j] |= here[m]
                changed[tile, j] |= other[m]
    covered, work = np.zeros((count, count), np.bool_), np.zeros((count, count), np.bool_)
    _mark(covered, boxes)
    for i in range(count):
        for j in range(count):
            if changed[i, j] | (covered[i, j] & some[i, j]):
                for m in range(max(i - 1, 0), min(i + 2, count)):
                    for n in range(max(j - 1, 0), min(j + 2, count)):
                        work[m, n] = True
    return work


@kernel
def _mark(covered: Bool[np.ndarray, "i j"], boxes: Int[np.ndarray, "cell 4"]) -> None:
    """Set the tiles that boxes lie in: of nearly all, those of their corners."""
    for k in range(len(boxes)):
        first_x, last_x, first_y, last_y = tiles_of(boxes[k], SHIFT)
        if 0 <= last_x - first_x < 2 and 0 <= last_y - first_y < 2:
            covered[first_x, first_y], covered[first_x, last_y] = True, True
            covered[last_x, first_y], covered[last_x, last_y] = True, True
        else:
            covered[first_x : last_x + 1, first_y : last_y + 1] = True


@array_kernel
def _runs(work: Bool[np.ndarray, "i j"], points: int) -> Int[np.ndarray, "run 4"]:
    """Tiles at work as rectangles, each a row of tiles side by side: first and last + 1 in x and y, no boundary."""
    runs = np.empty((work.size, 4), np.int64)
    found = 0
    for i in range(work.shape[0]):
        j = 0
        while j < work.shape[1]:
            first = j
            while j < work.shape[1] and work[i, j]:
                j += 1
            if j > first:
                runs[found, 0], runs[found, 1] = max(i * TILE, 1), min((i + 1) * TILE, points - 1)
                runs[found, 2], runs[found, 3] = max(first * TILE, 1), min(j * TILE, points - 1)
                found += runs[found, 0] < runs[found, 1] and runs[found, 2] < runs[found, 3]
            j += 1
    return runs[:found]


@kernel
def _surrounded(runs: Int[np.ndarray, "run 4"]) -> tuple[tuple[int, int], tuple[int, int]]:
    """First point and shape of what holds all rectangles and a point around them, from where they are counted then."""
    first_x, last_x, first_y, last_y = runs[0]
    for run in runs:
        first_x, last_x = min(first_x, run[0]), max(last_x, run[1])
        first_y, last_y = min(first_y, run[2]), max(last_y, run[3])
    for run in runs:
        for side in range(2):
            run[side] -= first_x - 1
            run[2 + side] -= first_y - 1
    return (first_x - 1, first_y - 1), (last_x - first_x + 2, last_y - first_y + 2)


@array_kernel
def _solve(
    nutrient: Float[np.ndarray, "x y"],
    low: tuple[int, int],
    eaten: Float[np.ndarray, "i j"],
    rows: Int[np.ndarray, "run 4"],
    union: float,
    metabolic: float,
    diffusion: tuple[float, float, int],
) -> None:
    """The step of `nutrient_step` by Chebyshev's iteration, in place, given what covers the points."""
    scaled, share = np.zeros(eaten.shape, nutrient.dtype), eaten  # (1/diagonal) rhs, and ½α / diagonal
    increment, before = np.zeros(eaten.shape, nutrient.dtype), np.zeros(eaten.shape, nutrient.dtype)
    for first, last, left, right in rows:
        for i in range(first, last):
            row = nutrient[i + low[0]]
            beside = nutrient[i + low[0] - 1], nutrient[i + low[0] + 1]
            _right_side(scaled[i], share[i], row, beside, union, metabolic, diffusion[0], left, right, low[1])
            for j in range(left, right):
                increment[i, j] = scaled[i, j]
    weight = 2.0
    for _ in range(1, diffusion[2]):
        weight = 1.0 / (1.0 - 0.25 * diffusion[1] * diffusion[1] * weight)
        for first, last, left, right in rows:
            for i in range(first, last):
                _sweep(before, increment, scaled, share, nutrient.dtype.type(weight), i, left, right)
        increment, before = before, increment
    for first, last, left, right in rows:
        for i in range(first, last):
            row = nutrient[i + low[0]]
            for j in range(left, right):
                row[j + low[1]] += increment[i, j]


@array_kernel
def _right_side(
    scaled: Float[np.ndarray, " j"],
    share: Float[np.ndarray, " j"],
    row: Float[np.ndarray, " y"],
    beside: tuple[Float[np.ndarray, " y"], Float[np.ndarray, " y"]],
    union: float,
    metabolic: float,
    alpha: float,
    left: int,
    right: int,
    low: int,
) -> None:
    """(1/diagonal) rhs and ½α / diagonal of one row, in whose `share` stands what covers it."""
    kind = row.dtype.type
    half, resting, rate, deep = kind(0.5 * alpha), kind(1.0 + 2.0 * alpha), kind(metabolic), kind(metabolic * union)
    diffusing, nothing, one, four = kind(alpha), kind(0), kind(1), kind(4)
    for j in range(left, right):
        covered, c = share[j], row[j + low]
        b = rate * covered
        if union > 0:
            b = deep * log(covered) if covered > one else nothing
        around = beside[0][j + low] + beside[1][j + low] + row[j + low - 1] + row[j + low + 1]
        inverse = one / (resting + kind(0.5) * b)
        scaled[j] = inverse * (diffusing * (around - four * c) - b * c)
        share[j] = inverse * half


@array_kernel
def _sweep(
    before: Float[np.ndarray, "i j"],
    x: Float[np.ndarray, "i j"],
    scaled: Float[np.ndarray, "i j"],
    share: Float[np.ndarray, "i j"],
    weight: float,
    i: int,
    left: int,
    right: int,
) -> None:
    """One row of the next iterate, which takes the place of the one before the last."""
    old, up, down = before[i, left:right], x[i - 1, left:right], x[i + 1, left:right]
    across, fixed, part = x[i, left - 1 : right + 1], scaled[i, left:right], share[i, left:right]
    for j in range(right - left):
        around = up[j] + down[j] + across[j] + across[j + 2]
        old[j] += weight * (fixed[j] + part[j] * around - old[j])
