"""Squared radii of superellipses, compiled by numba: `squared_norm` of `cells`, many at a time, for `covering`."""

import numpy as np
from jaxtyping import Float, Int

from yeastfit.compiled import kernel
from yeastfit.model.compiled.exponentials import falling_exponential, logarithm

NOTHING = 80.0  # e to the power of minus this is far below the precision of 1


@kernel
def squared_norms(
    first: Float[np.ndarray, " term"],
    second: Float[np.ndarray, " term"],
    exponents: Float[np.ndarray, " term"],
    count: int,
) -> None:
    """(|u|ⁿ + |v|ⁿ)^(2/n) of the first so many u² and v², in the place of u².

    It is m (1 + (l / m)^(n/2))^(2/n), m and l the larger and the smaller one of u² and v²; v² is overwritten.
    """
    kind = first.dtype.type
    little, half, two, one = kind(np.finfo(first.dtype).eps) ** 2, kind(0.5), kind(2), kind(1)
    for m in range(count):
        larger, smaller = max(first[m], second[m]), min(first[m], second[m])
        first[m], second[m] = larger, (smaller + little) / (larger + little)  # no quotient is 0 / 0
    logarithm(second, count)
    for m in range(count):
        second[m] = min(-half * exponents[m] * second[m], kind(NOTHING))
    falling_exponential(second, count)
    for m in range(count):
        second[m] += one
    logarithm(second, count)
    for m in range(count):
        second[m] *= -two / exponents[m]
    falling_exponential(second, count)
    for m in range(count):
        first[m] *= second[m]


@kernel
def axes_over_sizes(
    forms: Float[np.ndarray, "part cell"],
    directions: Float[np.ndarray, "cell 2"],
    half_lengths: Float[np.ndarray, " cell"],
    half_widths: Float[np.ndarray, " cell"],
) -> None:
    """Coefficients of dx and dy in u / p, then in v / q."""
    for m in range(len(half_lengths)):
        cos, sin = directions[m, 0], directions[m, 1]
        forms[0, m], forms[1, m] = cos / half_lengths[m], sin / half_lengths[m]
        forms[2, m], forms[3, m] = -sin / half_widths[m], cos / half_widths[m]


@kernel
def terms_within(
    place: Int[np.ndarray, " term"],
    value: Float[np.ndarray, " term"],
    other: Float[np.ndarray, "2 term"],
    whose: Int[np.ndarray, " term"],
    exponents: Float[np.ndarray, " cell"],
    found: int,
    beyond: float,
    scale: float,
) -> int:
    """How many terms of superellipses have an f below `beyond`: these, f / s, take the first places.

    Before, `value` is (u/p)² and the first of `other` (v/q)².
    """
    one, kept = value.dtype.type(1), 0
    for m in range(found):
        other[1, m] = exponents[whose[m]]
    squared_norms(value, other[0], other[1], found)
    for m in range(found):
        f = value[m] - one
        value[kept], place[kept], whose[kept] = f * scale, place[m], whose[m]
        kept += f < beyond
    return kept
