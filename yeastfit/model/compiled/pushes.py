"""The pushes of nodes that are closer than they should be, compiled by numba: the sum of `contact`.

Nodes are counted into square bins as wide as the contact reaches. Each meets those behind it in its own bin and those
of four of the eight bins around it, so that each pair is looked at once, and only close ones are worked out.
"""

import numpy as np
from jaxtyping import Float, Int

from yeastfit.compiled import array_kernel

MOST_BINS = 2048  # along a side; nodes beyond share the outermost ones
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
    node, bin_of = np.empty(count, np.int32), np.empty(count, np.int32)
    x, y, w = np.empty(count, dtype), np.empty(count, dtype), np.empty(count, dtype)
    for i in range(count):
        k = free[bins[i]]
        free[bins[i]] += 1
        node[k], bin_of[k] = i, bins[i]
        x[k], y[k], w[k] = positions[i, 0], positions[i, 1], weights[i]
    force_x, force_y = np.zeros(count, dtype), np.zeros(count, dtype)
    full, nothing = dtype.type(1), dtype.type(0)
    most = reach * reach
    for k in range(count):
        first, last = k + 1, start[bin_of[k] + 2]  # the rest of its own bin, and the next one of its column
        push_x, push_y = nothing, nothing
        for _ in range(2):
            for j in range(first, last):
                dx, dy = x[k] - x[j], y[k] - y[j]
                squared = dx * dx + dy * dy
                if nothing < squared < most:
                    distance = np.sqrt(squared)
                    law = full if ramp == nothing else min((reach - distance) / ramp, full)
                    along_x, along_y = law * dx / distance, law * dy / distance
                    push_x += w[j] * along_x
                    push_y += w[j] * along_y
                    force_x[j] -= w[k] * along_x
                    force_y[j] -= w[k] * along_y
            first, last = start[bin_of[k] + rows - 1], start[bin_of[k] + rows + 2]  # three bins of the next column
        forces[node[k], 0] = force_x[k] + push_x
        forces[node[k], 1] = force_y[k] + push_y


@array_kernel
def _bins(positions: Float[np.ndarray, "node 2"], count: int, side: float) -> tuple[Int[np.ndarray, " node"], int, int]:
    """The bin of each node, column by column with an empty one at each end, bins of a column, and bins in all."""
    low, most = np.zeros(2, positions.dtype), np.zeros(2, np.int64)
    for axis in range(2):
        least, largest = np.inf, -np.inf
        for i in range(count):
            if abs(positions[i, axis]) < FAR:
                least, largest = min(least, positions[i, axis]), max(largest, positions[i, axis])
        if least <= largest:
            low[axis], most[axis] = least, min((largest - least) / side, MOST_BINS - 1)
    rows = most[1] + 3
    bins = np.empty(count, np.int32)
    for i in range(count):
        column = _place((positions[i, 0] - low[0]) / side, most[0])
        row = _place((positions[i, 1] - low[1]) / side, most[1])
        bins[i] = (column + 1) * rows + row + 1
    return bins, rows, (most[0] + 3) * rows


@array_kernel
def _place(place: float, most: int) -> int:
    """The bin along one side; nowhere is in the first."""
    return int(min(max(place, 0.0), most)) if place == place else 0
