"""The pushes of nodes that are closer than they should be, compiled by numba: the sum of `contact`.

Nodes are counted into square bins as wide as the contact reaches. Each meets those behind it in its own bin and those
of four of the eight bins around it, so that each pair is looked at once. Close pairs are collected, and worked out
`COLLECTED` at a time.
"""

import numpy as np
from jaxtyping import Float, Int

from yeastfit.compiled import Index, array_kernel, kernel

MOST_BINS = 2048  # along a side; nodes beyond share the outermost ones
COLLECTED = 512  # pairs
FAR = 1e6  # L0: a node farther away than this, or nowhere, does not widen the bins


@array_kernel
def push_apart(
    positions: Float[np.ndarray, "node 2"],
    weights: Float[np.ndarray, " node"],
    count: int,
    reach: float,
    ramp: float,
    side: float,
    forces: Float[np.ndarray, "node 2"],
) -> None:
    """Σ_{j≠i} w_j law(r_ij) e_ij of the first `count` nodes, into `forces`; 0 for the others.

    law(r) is the ramp clip((reach − r) / ramp, 0, 1), or with ramp 0 the step: 1 below `reach`. `side` of the bins is
    at least `reach`.
    """
    forces[:] = 0
    dtype = positions.dtype
    bins, rows, total = _bins(positions, count, side)
    start = np.zeros(total + 1, np.int32)
    for i in range(count):
        start[bins[i] + 1] += 1
    for k in range(total):
        start[k + 1] += start[k]
    free = start[:-1].copy()
    node, place, w = np.empty(count, np.int32), np.empty((count, 2), dtype), np.empty(count, dtype)
    for i in range(count):
        k = free[bins[i]]
        free[bins[i]] += 1
        node[k], place[k, 0], place[k, 1], w[k] = i, positions[i, 0], positions[i, 1], weights[i]
    force, pairs = np.zeros((count, 2), dtype), np.empty((COLLECTED, 2), np.uint32)
    apart = np.empty(COLLECTED, dtype), np.empty(COLLECTED, dtype)
    most, nothing, found = reach * reach, dtype.type(0), 0
    for b in range(rows, total - rows):
        for k in range(Index(start[b]), Index(start[b + 1])):
            first, last = k + Index(1), Index(start[b + 2])  # the rest of its own bin, and the next one of its column
            for _ in range(2):
                for j in range(first, last):
                    dx, dy = place[k, 0] - place[j, 0], place[k, 1] - place[j, 1]
                    squared = dx * dx + dy * dy
                    pairs[Index(found), 0], pairs[Index(found), 1] = k, j
                    found += (nothing < squared) & (squared < most)  # otherwise the next one takes its place
                    if found == COLLECTED:
                        _push(pairs, found, apart, place, w, reach, ramp, force)
                        found = 0
                first, last = Index(start[b + rows - 1]), Index(start[b + rows + 2])  # three bins of the next column
    _push(pairs, found, apart, place, w, reach, ramp, force)
    for k in range(count):
        forces[node[k], 0], forces[node[k], 1] = force[k, 0], force[k, 1]


@kernel
def _push(
    pairs: Int[np.ndarray, "pair 2"],
    found: int,
    apart: tuple[Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]],
    place: Float[np.ndarray, "node 2"],
    w: Float[np.ndarray, " node"],
    reach: float,
    ramp: float,
    force: Float[np.ndarray, "node 2"],
) -> None:
    """Add the pushes of the first `found` pairs; `apart` is room to work in."""
    (x, y), full = apart, place.dtype.type(1)
    for m in range(found):
        k, j = pairs[m]
        x[m], y[m] = place[k, 0] - place[j, 0], place[k, 1] - place[j, 1]
    for m in range(found):
        distance = np.sqrt(x[m] * x[m] + y[m] * y[m])
        push = (full if ramp == 0 else min((reach - distance) / ramp, full)) / distance
        x[m] *= push
        y[m] *= push
    for m in range(found):
        k, j = pairs[m]
        force[k, 0] += w[j] * x[m]
        force[k, 1] += w[j] * y[m]
        force[j, 0] -= w[k] * x[m]
        force[j, 1] -= w[k] * y[m]


@array_kernel
def _bins(positions: Float[np.ndarray, "node 2"], count: int, side: float) -> tuple[Int[np.ndarray, " node"], int, int]:
    """The bin of each node, column by column with an empty one at each end, bins of a column, and bins in all."""
    kind = positions.dtype.type
    low, most, per_side = np.zeros(2, positions.dtype), np.zeros(2, positions.dtype), kind(1 / side)
    for axis in range(2):
        least, largest = kind(np.inf), kind(-np.inf)
        for i in range(count):
            place = positions[i, axis]
            if abs(place) < FAR:
                least, largest = min(least, place), max(largest, place)
        if least <= largest:
            low[axis], most[axis] = least, min(np.floor((largest - least) * per_side), kind(MOST_BINS - 1))
    rows = int(most[1]) + 3
    bins = np.empty(count, np.int32)
    for i in range(count):
        column = _place((positions[i, 0] - low[0]) * per_side, kind(0), most[0])
        row = _place((positions[i, 1] - low[1]) * per_side, kind(0), most[1])
        bins[i] = (column + 1) * rows + row + 1
    return bins, rows, (int(most[0]) + 3) * rows


@kernel
def _place(place: float, first: float, most: float) -> np.int32:
    """The bin along one side; nowhere is in the first."""
    return np.int32(min(max(place, first), most)) if place == place else np.int32(0)
