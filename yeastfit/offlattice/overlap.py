"""Whether a place is free: no cell that is there already may hold the daughter's centre.

A cell is the 12-gon with vertices at the parametric angles mπ/6 of its ellipse, its edge included. In the cell's frame,
with u = |along| / a and v = |across| / b, it is regular, and a point lies in it where all of

    u cos 15° + v sin 15°,    (u + v) cos 45°,    u sin 15° + v cos 15°

are at most cos 15°. Nothing else is tested: bodies may overlap, and an old centre may lie in the new cell (Li et al.
2024, see `growth`).

A cell that holds a point has its centre within the largest semi-axis, 4.33 pixels, of it. Cells are kept in square bins
of 4.4 pixels, so that those of nine bins are looked at. Each bin holds a copy of its first cell, so that neighbours lie
side by side in memory, and names another, which names the next. The square of bins repeats over the plane like tiles:
colonies of any reach fit, and cells that share a bin from tile to tile are told apart by their distance.
"""

import numpy as np
from jaxtyping import Float, Shaped

from yeastfit.compiled import Index, inlined_kernel, kernel
from yeastfit.offlattice.fetching import fetch
from yeastfit.offlattice.placing import DIRECTIONS, SEMI_AXES

CELL = np.dtype(
    [
        ("x", "f8"),  # centre, pixels
        ("y", "f8"),
        ("next", "i4"),  # another cell of the same bin, 0 at the end: the colony's first cell is the first of its bin
        ("direction", "i4"),  # of the major axis, in multiples of π/16, not wrapped
        ("mother", "i4"),
        ("form", "u1"),  # SATED or PSEUDOHYPHAL
        ("count", "u1"),  # from 1; a cell may bud while this is below 4
        ("bears", "u1"),  # whether it has a pseudohyphal daughter
        ("taken", "u1"),  # the bits of its daughters' places (`placing`) that are known to lie in a cell
    ],
    align=True,
)
"""All about one cell, side by side: a colony is larger than the processor's cache, which holds this in half a line."""

SATED, PSEUDOHYPHAL = 0, 1
BIN = 4.4
BINS_PER_PIXEL = 1 / BIN

Three = tuple[int, int, int]

REACH2 = SEMI_AXES.max() ** 2
COS15, SIN15, COS45 = np.cos(np.pi / 12), np.sin(np.pi / 12), np.cos(np.pi / 4)


def empty_cells(cells: int) -> Shaped[np.ndarray, " cell"]:
    """Room for so many cells, filled with zeros, none of which lies across two lines of the processor's cache."""
    size = cells * CELL.itemsize
    room = np.zeros(size + CELL.itemsize, dtype=np.uint8)
    start = -room.ctypes.data % CELL.itemsize
    return room[start : start + size].view(CELL)


def empty_bins(cells: int) -> Shaped[np.ndarray, "row column"]:
    """Bins for so many cells, each a cell with a count of 0: the side of the square is a power of two."""
    side = 4
    while side * side < cells:
        side *= 2
    return empty_cells(side * side).reshape(side, side)


def frames() -> Float[np.ndarray, "form direction 4"]:
    """cos θ / a, sin θ / a, −sin θ / b, cos θ / b: from (x, y) to (along / a, across / b)."""
    theta = np.pi / 16 * np.arange(DIRECTIONS)
    cos, sin = np.cos(theta), np.sin(theta)
    return np.array([np.stack([cos / a, sin / a, -sin / b, cos / b], axis=1) for a, b in SEMI_AXES])


FRAMES = frames()


@inlined_kernel
def bins_around(x: float, y: float, bins: Shaped[np.ndarray, "row column"]) -> tuple[Three, Three]:
    """Rows and columns of the nine bins around the point (x, y), its own first; they are fetched, all at once."""
    wrap = bins.shape[0] - 1
    row, column = int(np.floor(x * BINS_PER_PIXEL)), int(np.floor(y * BINS_PER_PIXEL))
    rows = row & wrap, (row - 1) & wrap, (row + 1) & wrap
    columns = column & wrap, (column - 1) & wrap, (column + 1) & wrap
    for r in rows:
        for c in columns:
            fetch(bins[Index(r)], c)
    return rows, columns


@inlined_kernel
def free(
    x: float,
    y: float,
    cells: Shaped[np.ndarray, " cell"],
    bins: Shaped[np.ndarray, "row column"],
    around: tuple[Three, Three],
) -> bool:
    """Whether no cell holds the point (x, y), by `bins_around` it."""
    rows, columns = around
    for r in rows:  # most often a cell of its own bin does
        for c in columns:
            cell = bins[Index(r), Index(c)]
            if cell.count == 0:
                continue
            if _inside(x - cell.x, y - cell.y, FRAMES[cell.form, cell.direction & 31]):
                return False
            following = cell.next
            while following != 0:
                cell = cells[Index(following)]
                if _inside(x - cell.x, y - cell.y, FRAMES[cell.form, cell.direction & 31]):
                    return False
                following = cell.next
    return True


@kernel
def insert(index: int, cells: Shaped[np.ndarray, " cell"], bins: Shaped[np.ndarray, "row column"]) -> None:
    """Put a cell into its bin."""
    wrap = bins.shape[0] - 1
    cell = cells[index]
    row, column = int(np.floor(cell.x * BINS_PER_PIXEL)) & wrap, int(np.floor(cell.y * BINS_PER_PIXEL)) & wrap
    first = bins[row, column]
    if first.count == 0:
        bins[row, column] = cell
    else:
        cell.next, first.next = first.next, index


@kernel
def _inside(dx: float, dy: float, frame: Float[np.ndarray, " 4"]) -> bool:
    # & and not `and`: which of the four fails is a toss-up, and a branch that the processor guesses wrong takes longer
    u, v = abs(frame[0] * dx + frame[1] * dy), abs(frame[2] * dx + frame[3] * dy)
    near = dx * dx + dy * dy <= REACH2
    return near & (u * COS15 + v * SIN15 <= COS15) & ((u + v) * COS45 <= COS15) & (u * SIN15 + v * COS15 <= COS15)
