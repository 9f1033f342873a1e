"""The springs of the tree, compiled by numba: the sum of `forces.springs`."""

from math import sqrt

import numpy as np
from jaxtyping import Float, Int

from yeastfit.compiled import array_kernel


@array_kernel
def pull_together(
    positions: Float[np.ndarray, "node 2"],
    parents: Int[np.ndarray, " node"],
    weights: Float[np.ndarray, " node"],
    count: int,
    forces: Float[np.ndarray, "node 2"],
) -> None:
    """Σ_j A_ij w_j (1 − r_ij) e_ij of the first `count` nodes, into `forces`; 0 for the others."""
    forces[:] = 0
    one = positions.dtype.type(1)
    for child in range(count):
        parent = parents[child]
        if parent < 0:
            continue
        dx, dy = positions[child, 0] - positions[parent, 0], positions[child, 1] - positions[parent, 1]
        squared = dx * dx + dy * dy
        if squared > 0:
            distance = sqrt(squared)
            push = (one - distance) / distance
            forces[child, 0] += weights[parent] * push * dx
            forces[child, 1] += weights[parent] * push * dy
            forces[parent, 0] -= weights[child] * push * dx
            forces[parent, 1] -= weights[child] * push * dy
