"""The nutrient and its gradient at the nodes, compiled by numba: the numbers of `interpolation`."""

from math import floor

import numpy as np
from jaxtyping import Float

from yeastfit.compiled import array_kernel


@array_kernel
def read_nutrient(
    nutrient: Float[np.ndarray, "x y"],
    positions: Float[np.ndarray, "node 2"],
    half: float,
    spacing: float,
    found: Float[np.ndarray, " node"],
) -> None:
    """c at the nodes, into `found`; `half` of the dish's side."""
    for k in range(len(found)):
        i, s = _corner(positions[k, 0], half, spacing, 0, nutrient.shape[0])
        j, t = _corner(positions[k, 1], half, spacing, 0, nutrient.shape[0])
        low, high = nutrient[i], nutrient[i + 1]
        found[k] = _between(low[j], low[j + 1], high[j], high[j + 1], s, t)


@array_kernel
def read_gradient(
    nutrient: Float[np.ndarray, "x y"],
    positions: Float[np.ndarray, "node 2"],
    half: float,
    spacing: float,
    found: Float[np.ndarray, "node 2"],
) -> None:
    """∇c at the nodes, into `found`."""
    scale = spacing + spacing
    for k in range(len(found)):
        i, s = _corner(positions[k, 0], half, spacing, 1, nutrient.shape[0])
        j, t = _corner(positions[k, 1], half, spacing, 1, nutrient.shape[0])
        before, low, high, after = nutrient[i - 1], nutrient[i], nutrient[i + 1], nutrient[i + 2]
        m, n = j + 1, j + 2
        across = _between(high[j] - before[j], high[m] - before[m], after[j] - low[j], after[m] - low[m], s, t)
        along = _between(low[m] - low[j - 1], low[n] - low[j], high[m] - high[j - 1], high[n] - high[j], s, t)
        found[k, 0], found[k, 1] = across / scale, along / scale


@array_kernel
def _corner(position: float, half: float, spacing: float, margin: int, points: int) -> tuple[int, float]:
    """The grid line below a node, `margin` points off the boundary, and how far beyond it the node is, in spacings."""
    scaled = (position + half) / spacing
    line = margin
    if scaled == scaled:
        line = int(min(max(floor(min(max(scaled, -1.0), points)), margin), points - 2 - margin))
    return line, scaled - line


@array_kernel
def _between(a: float, b: float, c: float, d: float, s: float, t: float) -> float:
    """The bilinear mean of what is at (0, 0), (0, 1), (1, 0) and (1, 1)."""
    return (1 - s) * (1 - t) * a + (1 - s) * t * b + s * (1 - t) * c + s * t * d
