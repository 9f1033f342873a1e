"""What covers the points of a grid, compiled by numba: the sum of `level_set`, for the nutrient and for statistics.

That is Σ_k w_k exp(−f_k / s), or hard max_k max(−f_k, 0). A cell covers so few points that what is done for each row
of them would take longer than the points: boxes, terms and their exponentials are worked out `COLLECTED` at a time.

Shapes of cells are half lengths, half widths and exponents of superellipses; of ellipses there are no exponents.
"""

from math import inf

import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.compiled import Index, array_kernel, kernel
from yeastfit.model.cells import LARGEST
from yeastfit.model.compiled.exponentials import falling_exponential
from yeastfit.model.compiled.superellipses import axes_over_sizes, squared_norms, terms_within

COLLECTED = 512
LARGEST_SHIFT = 30  # tiles of 2³⁰ points along a side: the whole grid is one

Shapes = tuple[Float[np.ndarray, " cell"], Float[np.ndarray, " cell"], Float[np.ndarray, " shaped"]]


@array_kernel
def boxes_of(
    points: int,
    centres: Float[np.ndarray, "cell 2"],
    directions: Float[np.ndarray, "cell 2"],
    shapes: Shapes,
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    reach: float,
    furthest: float,
) -> Int[np.ndarray, "cell 4"]:
    """First and last grid point of each cell along x and along y; none where last is below first.

    These are the points of its patches in `level_set`, which cover r² up to `reach`, as far as f is below `furthest`.
    """
    kind, cells = centres.dtype.type, len(weights)
    frame = kind(grid[0]), kind(1 / grid[1]), kind(grid[2]), kind(points)
    counted, seen = kind(np.sqrt(reach)), kind(np.sqrt(1.0 + furthest))
    boxes, ends = np.empty((cells, 4), np.int32), np.empty((4, COLLECTED), np.int32)
    centre, direction, extent = (
        np.empty((2, COLLECTED), centres.dtype),
        np.empty((2, COLLECTED), centres.dtype),
        np.empty((3, COLLECTED), centres.dtype),
    )
    for begin in range(0, cells, COLLECTED):
        some = slice(begin, min(begin + COLLECTED, cells))
        of, towards, into = centres[some], directions[some], boxes[some]
        for m in range(len(of)):
            centre[0, m], centre[1, m] = of[m, 0], of[m, 1]
            direction[0, m], direction[1, m] = towards[m, 0], towards[m, 1]
        lengths, widths, exponents = shapes[0][some], shapes[1][some], shapes[2][some]
        for axis in range(2):
            _extents(extent, direction[axis], direction[1 - axis], lengths, widths, exponents)
            _ends(ends[2 * axis :], centre[axis], extent[0], weights[some], frame, counted, seen)
        for m in range(len(of)):
            into[m, 0], into[m, 1], into[m, 2], into[m, 3] = ends[0, m], ends[1, m], ends[2, m], ends[3, m]
    return boxes


@kernel
def _extents(
    extent: Float[np.ndarray, "3 cell"],
    along: Float[np.ndarray, " cell"],
    across: Float[np.ndarray, " cell"],
    half_lengths: Float[np.ndarray, " cell"],
    half_widths: Float[np.ndarray, " cell"],
    exponents: Float[np.ndarray, " shaped"],
) -> None:
    """How far r² = 1 reaches from the centre along one axis, into the first of `extent`.

    `along` and `across` are the direction's parts along the axis and the other one.
    """
    count, one = len(half_lengths), extent.dtype.type(1)
    for m in range(count):
        long, wide = half_lengths[m] * along[m], half_widths[m] * across[m]
        extent[0, m], extent[1, m] = long * long, wide * wide
    if len(exponents) > 0:
        for m in range(count):
            extent[2, m] = exponents[m] / (exponents[m] - one)  # the dual exponent
        squared_norms(extent[0], extent[1], extent[2], count)
    else:
        for m in range(count):
            extent[0, m] += extent[1, m]
    for m in range(count):
        extent[0, m] = np.sqrt(extent[0, m])


@kernel
def _ends(
    ends: Int[np.ndarray, "end cell"],
    centre: Float[np.ndarray, " cell"],
    extents: Float[np.ndarray, " cell"],
    weights: Float[np.ndarray, " cell"],
    frame: tuple[float, float, float, float],
    counted: float,
    seen: float,
) -> None:
    """First and last grid point along one axis, into the first two of `ends`; 0 and −1 of a cell that is nowhere."""
    origin, per_spacing, patch, side = frame
    one, nowhere = centre.dtype.type(1), centre.dtype.type(inf)
    zero = one - one
    for m in range(len(weights)):
        extent = extents[m] * per_spacing
        middle = (centre[m] - origin) * per_spacing
        first = np.ceil(_clipped(middle - counted * extent, zero, side))
        last = np.floor(_clipped(middle + counted * extent, -one, side - one))
        last = min(first + patch * np.ceil((last - first + one) / patch), side) - one
        first = max(first, np.ceil(_clipped(middle - seen * extent, zero, side)))
        last = min(last, np.floor(_clipped(middle + seen * extent, -one, side - one)))
        somewhere = (weights[m] > zero) & (abs(middle) < nowhere) & (extent < nowhere)
        ends[0, m], ends[1, m] = np.int32(first if somewhere else zero), np.int32(last if somewhere else -one)


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
    shapes: Shapes,
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    union: float,
    furthest: float,
) -> None:
    """Add to `covered`, whose first point is `low`, at the points of tiles at work; elsewhere something or nothing.

    Arguments:
        covered: 0.
        low: A point of the grid.
        tiles: Which are at work, and the logarithm to base 2 of the points along the side of one.
        boxes: `boxes_of` the cells.
        centres: As in `Cells`.
        directions: Likewise.
        shapes: Half lengths, half widths, and exponents or none.
        weights: Likewise.
        grid: Coordinate of its first point along either axis, spacing, and points along a side of a patch.
        union: s, 0 for the hard union.
        furthest: f from which a cell is not looked at; 0 for the hard union.
    """
    kind, (work, shift) = covered.dtype.type, tiles
    hard, blocky, one, across_row = union == 0, len(shapes[2]) > 0, kind(1), covered.shape[1]
    beyond, scale = kind(furthest), one if hard else kind(1 / union)
    x, y = np.empty(covered.shape[0], covered.dtype), np.empty(across_row, covered.dtype)
    for m in range(len(x)):
        x[m] = grid[0] + grid[1] * (low[0] + m)
    for m in range(len(y)):
        y[m] = grid[0] + grid[1] * (low[1] + m)
    place, whose = np.empty(COLLECTED, np.int32), np.empty(COLLECTED, np.int32)
    value, other, forms = (
        np.empty(COLLECTED, covered.dtype),
        np.empty((2, COLLECTED), covered.dtype),
        np.empty((4, COLLECTED), covered.dtype),
    )
    flat, row, found = covered.reshape(-1), Index(across_row), 0
    for begin in range(0, len(weights), COLLECTED):
        some = slice(begin, min(begin + COLLECTED, len(weights)))
        if blocky:
            axes_over_sizes(forms, directions[some], shapes[0][some], shapes[1][some])
        else:
            _quadratic_forms(forms, directions[some], shapes[0][some], shapes[1][some])
        for k in range(some.start, some.stop):
            if not _any_of(work, tiles_of(boxes[k], shift)):
                continue
            first_x, last_x, first_y, last_y = boxes[k]
            first_x, last_x = max(first_x - low[0], 0), min(last_x - low[0] + 1, covered.shape[0])
            first_y, last_y = max(first_y - low[1], 0), min(last_y - low[1] + 1, across_row)
            a, b, c, d = forms[0, k - begin], forms[1, k - begin], forms[2, k - begin], forms[3, k - begin]
            middle_x, middle_y = centres[k, 0], centres[k, 1]
            i, j, left, right = Index(first_x), Index(first_y), Index(first_y), Index(last_y)
            for _ in range(max(last_x - first_x, 0) * (last_y - first_y)):  # one loop: ends of short ones cost most
                dx, dy = x[i] - middle_x, y[j] - middle_y
                at = Index(found)
                if blocky:
                    u, v = a * dx + b * dy, c * dx + d * dy
                    value[at], other[0, at] = u * u, v * v
                    f = max(u * u, v * v) - one  # no larger than that of the superellipse
                else:
                    f = (a * dx * dx - one) + dy * (b * dx + c * dy)
                    value[at] = f * scale
                place[at], whose[at] = np.int32(i * row + j), np.int32(k)
                found += f < beyond  # otherwise the next one takes its place
                if found == COLLECTED:
                    if blocky:
                        found = terms_within(place, value, other, whose, shapes[2], found, beyond, scale)
                    _add(flat, place, value, whose, weights, found, hard)
                    found = 0
                j += Index(1)
                if j == right:
                    i, j = i + Index(1), left
    if blocky:
        found = terms_within(place, value, other, whose, shapes[2], found, beyond, scale)
    _add(flat, place, value, whose, weights, found, hard)


@kernel
def _quadratic_forms(
    forms: Float[np.ndarray, "part cell"],
    directions: Float[np.ndarray, "cell 2"],
    half_lengths: Float[np.ndarray, " cell"],
    half_widths: Float[np.ndarray, " cell"],
) -> None:
    """Coefficients of dx², dx dy and dy² in f + 1, into the first of `forms`."""
    one = forms.dtype.type(1)
    for m in range(len(half_lengths)):
        cos, sin = directions[m, 0], directions[m, 1]
        along, across = one / (half_lengths[m] * half_lengths[m]), one / (half_widths[m] * half_widths[m])
        part = cos * sin * (along - across)
        forms[0, m], forms[1, m] = cos * cos * along + sin * sin * across, part + part
        forms[2, m] = sin * sin * along + cos * cos * across


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
def tiles_of(box: Int[np.ndarray, "4"], shift: int) -> tuple[int, int, int, int]:
    """First and last tile of a box along x and along y, tiles of 2 to the power of `shift` points along a side."""
    return box[0] >> shift, box[1] >> shift, box[2] >> shift, box[3] >> shift


@kernel
def _any_of(work: Bool[np.ndarray, "i j"], tiles: tuple[int, int, int, int]) -> bool:
    """Whether one of these tiles is at work."""
    for i in range(tiles[0], tiles[1] + 1):
        for j in range(tiles[2], tiles[3] + 1):
            if work[i, j]:
                return True
    return False


@array_kernel
def cover_all(
    covered: Float[np.ndarray, "x y"],
    centres: Float[np.ndarray, "cell 2"],
    directions: Float[np.ndarray, "cell 2"],
    shapes: Shapes,
    weights: Float[np.ndarray, " cell"],
    grid: tuple[float, float, int],
    union: float,
    reach: float,
) -> None:
    """The sum at all points of a grid, of cells as far as r² is at most `reach`."""
    covered[:] = 0
    furthest = min(reach - 1.0, LARGEST * union) if union > 0 else 0.0
    boxes = boxes_of(covered.shape[0], centres, directions, shapes, weights, grid, reach, furthest)
    one_tile = np.ones((1, 1), np.bool_), LARGEST_SHIFT
    cover(covered, (0, 0), one_tile, boxes, centres, directions, shapes, weights, grid, union, furthest)
