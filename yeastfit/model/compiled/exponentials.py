"""Exponentials and logarithms of many numbers, compiled by numba, which a processor works out many at a time.

In single precision they are series, exact to the last bits; in double precision those of the standard library.
"""

from math import exp, log

import numpy as np
from jaxtyping import Float

from yeastfit.compiled import kernel

PER_LOG2 = 1.4426950408889634  # 1 / log 2
LOG2 = 0.693359375, -2.1219444005469058e-4  # their sum; multiples of the first are exact
EXPONENT, FRACTION = 127, 23  # of a number in single precision: what is added to the one, and bits of the other
ROOT_HALF = 0x3F3504F3  # the bits of √½


@kernel
def falling_exponential(x: Float[np.ndarray, " term"], count: int) -> None:
    """exp(−x) of the first so many, in place.

    In single precision for |x| < 87: 2ⁿ eʳ, n whole and |r| ≤ ½ log 2, of which seven terms of the series are exact to
    the last bits.
    """
    kind = x.dtype.type
    if np.finfo(x.dtype).eps < np.finfo(np.float32).eps:
        for m in range(count):
            x[m] = exp(-x[m])
        return
    for m in range(count):
        n = np.floor(kind(0.5) - x[m] * kind(PER_LOG2))
        r = -x[m] - n * kind(LOG2[0]) - n * kind(LOG2[1])
        series = kind(1 / 120) + r * (kind(1 / 720) + r * kind(1 / 5040))
        series = kind(1 / 2) + r * (kind(1 / 6) + r * (kind(1 / 24) + r * series))
        power = np.int32((np.int32(n) + np.int32(EXPONENT)) << np.int32(FRACTION)).view(np.float32)
        x[m] = power * (kind(1) + r * (kind(1) + r * series))


@kernel
def logarithm(x: Float[np.ndarray, " term"], count: int) -> None:
    """log x of the first so many, which are above 0 and, in single precision, not below 2⁻¹²⁶; in place.

    In single precision n log 2 + 2 (z + z³/3 + z⁵/5 + z⁷/7 + z⁹/9), z = (y − 1) / (y + 1) of x = 2ⁿ y with y between
    √½ and √2: |z| < 0.172, so that what is left out is below the last bit.
    """
    kind = x.dtype.type
    if np.finfo(x.dtype).eps < np.finfo(np.float32).eps:
        for m in range(count):
            x[m] = log(x[m])
        return
    for m in range(count):
        bits = np.float32(x[m]).view(np.int32)
        n = np.int32(bits - np.int32(ROOT_HALF)) >> np.int32(FRACTION)
        y = np.int32(bits - (n << np.int32(FRACTION))).view(np.float32)
        z = (y - kind(1)) / (y + kind(1))
        square, whole = z * z, kind(n)
        series = kind(2 / 3) + square * (kind(2 / 5) + square * (kind(2 / 7) + square * kind(2 / 9)))
        x[m] = whole * kind(LOG2[0]) + (z + z + (z * square * series + whole * kind(LOG2[1])))
