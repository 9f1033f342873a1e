"""The nutrient and its gradient at the nodes, compiled by numba: the numbers of `interpolation`."""

import numpy as np
from jaxtyping import Float

from yeastfit.compiled import kernel


@kernel
def read_nutrient(
    nutrient: Float[np.ndarray, "x y"],
    positions: Float[np.ndarray, "node 2"],
    count: int,
    half: float,
    spacing: float,
    found: Float[np.ndarray, " node"],
) -> None:
    """c at the first `count` nodes, into `found`, 0 for the others; `half` of the dish's side."""
    kind = nutrient.dtype.type
    first, last, one = kind(0), kind(nutrient.shape[0] - 2), kind(1)
    for k in range(count):
        x, y = (positions[k, 0] + half) / spacing, (positions[k, 1] + half) / spacing
        i, j = _line(x, first, last), _line(y, first, last)
        low, high = nutrient[i], nutrient[i + 1]
        found[k] = _between(low[j], low[j + 1], high[j], high[j + 1], x - kind(i), y - kind(j), one)
    found[count:] = 0


@kernel
def read_gradient(
    nutrient: Float[np.ndarray, "x y"],
    positions: Float[np.ndarray, "node 2"],
    count: int,
    half: float,
    spacing: float,
    found: Float[np.ndarray, "node 2"],
) -> None:
    """∇c at the first `count` nodes, into `found`, 0 for the others."""
    kind, scale = nutrient.dtype.type, spacing + spacing
    first, last, one = kind(1), kind(nutrient.shape[0] - 3), kind(1)
    for k in range(count):
        x, y = (positions[k, 0] + half) / spacing, (positions[k, 1] + half) / spacing
        i, j = _line(x, first, last), _line(y, first, last)
        s, t, m, n = x - kind(i), y - kind(j), j + 1, j + 2
        before, low, high, after = nutrient[i - 1], nutrient[i], nutrient[i + 1], nutrient[i + 2]
        across = _between(high[j] - before[j], high[m] - before[m], after[j] - low[j], after[m] - low[m], s, t, one)
        along = _between(low[m] - low[j - 1], low[n] - low[j], high[m] - high[j - 1], high[n] - high[j], s, t, one)
        found[k, 0], found[k, 1] = across / scale, along / scale
    found[count:] = 0


@kernel
def _line(scaled: float, first: float, last: float) -> int:
    """The grid line below a place that is given in spacings, one of `first` to `last`; nowhere has the first."""
    return int(min(max(np.floor(scaled), first), last)) if scaled == scaled else int(first)


@kernel
def _between(a: float, b: float, c: float, d: float, s: float, t: float, one: float) -> float:
    """The bilinear mean of what is at (0, 0), (0, 1), (1, 0) and (1, 1)."""
    return (one - s) * (one - t) * a + (one - s) * t * b + s * (one - t) * c + s * t * d
