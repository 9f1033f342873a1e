"""Squared radii of superellipses, compiled by numba: `squared_norm` of `cells`, many at a time."""

import numpy as np
from jaxtyping import Float

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
