"""What each pixel of an image holds of simulated cells: the part that is covered, and how many layers. NumPy only."""

from math import hypot, isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from yeastfit.errors import InputError

Array = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MAX_SAMPLES = 32_768  # along a side of the fine grid, which holds one byte a sample: 1 GiB


def coverage(
    centres: Array,
    directions: Array,
    half_lengths: Array,
    half_widths: Array,
    extent: float,
    pixel_size: float,
    supersample: int = 5,
    exponents: Array | None = None,
) -> tuple[Floats, Floats]:
    """Share of each pixel in the union of ellipses r² = (u/p)² + (v/q)² ≤ 1, and its mean of Σ √max(1 − r², 0).

    The image is centred on the origin, rows downwards (along −y), columns along x. A pixel is exactly `pixel_size`
    wide, so an `extent` that is no multiple of it changes by up to half a pixel. What lies outside is cut off.

    Arguments:
        centres: (x, y) [n, 2]. All lengths are in one unit, µm.
        directions: Unit vectors along p [n, 2].
        half_lengths: p [n]. A cell without length or width covers nothing.
        half_widths: q [n].
        extent: Side of the image.
        pixel_size: Of its pixels.
        supersample: Means are over its square of points in a pixel. With an odd number no pixel is exactly half
            covered, a tie that `true_mask` counts as colony: at 4² points a mask of single cells is 2 % too large.
        exponents: n [n] of superellipses r² = (|u/p|ⁿ + |v/q|ⁿ)^(2/n), at least 2; by default 2, ellipses.

    Returns:
        The fraction, in [0, 1], and the thickness in cell layers, both [rows, columns], round(extent / pixel_size) a
        side.

    Raises:
        InputError: Shapes differ, a value is not finite, a length is negative, directions are no unit vectors, or the
            image would be empty or enormous.
    """
    cells = _checked_cells(centres, directions, half_lengths, half_widths, exponents)
    side = _checked_side(extent, pixel_size, supersample)
    # x of the columns, and -y of the rows
    axis = (np.arange(side * supersample) + 0.5) * (pixel_size / supersample) - 0.5 * side * pixel_size
    covered = np.zeros((axis.size, axis.size), dtype=bool)
    thickness = np.zeros((side, side))
    for x, y, cos, sin, p, q, n in cells:
        rows = _span(-y, _reach(p * sin, q * cos, n), side, pixel_size)
        columns = _span(x, _reach(p * cos, q * sin, n), side, pixel_size)
        fine_rows, fine_columns = (slice(s.start * supersample, s.stop * supersample) for s in (rows, columns))
        up, right = -axis[fine_rows, None] - y, axis[None, fine_columns] - x
        u, v = (cos * right + sin * up) / p, (cos * up - sin * right) / q
        r2 = u**2 + v**2 if n == 2 else (np.abs(u) ** n + np.abs(v) ** n) ** (2 / n)
        covered[fine_rows, fine_columns] |= r2 <= 1
        thickness[rows, columns] += _pixel_means(np.sqrt(np.maximum(1 - r2, 0)), supersample)
    return _pixel_means(covered, supersample), thickness


def true_mask(fraction: Array) -> Mask:
    """Pixels that are colony, fraction ≥ ½: what a segmentation of the photograph should find."""
    return np.asarray(finite("fraction", fraction, (None, None)) >= 0.5)


def _reach(along: float, across: float, exponent: float) -> float:
    """How far a cell reaches in a direction: the norm with the exponent dual to that of its outline."""
    if exponent == 2:
        return hypot(along, across)
    dual = exponent / (exponent - 1)
    return float((abs(along) ** dual + abs(across) ** dual) ** (1 / dual))


def _span(centre: float, reach: float, side: int, pixel_size: float) -> slice:
    """Pixels of one axis within `reach` of `centre`; empty outside the image."""
    middle = 0.5 * side
    first, last = np.floor((centre - reach) / pixel_size + middle), np.ceil((centre + reach) / pixel_size + middle)
    return slice(int(np.clip(first, 0, side)), int(np.clip(last, 0, side)))


def _pixel_means(samples: Array, supersample: int) -> Floats:
    rows, columns = (size // supersample for size in samples.shape)
    means = samples.reshape(rows, supersample, columns, supersample).mean((1, 3), dtype=np.float64)
    return np.asarray(means, dtype=np.float64)


def _checked_cells(
    centres: Array, directions: Array, half_lengths: Array, half_widths: Array, exponents: Array | None
) -> Floats:
    """x, y, direction, p, q and n [n, 7] of the cells that cover something."""
    centres = finite("centres", centres, (None, 2))
    count = len(centres)
    directions = finite("directions", directions, (count, 2))
    lengths = [finite("half_lengths", half_lengths, (count,)), finite("half_widths", half_widths, (count,))]
    for name, values in zip(("half_lengths", "half_widths"), lengths, strict=True):
        if (values < 0).any():
            raise InputError(f"{name}: got {values.min():g}, need lengths of at least 0")
    exists = np.minimum(*lengths) > 0
    norms = np.hypot(*directions[exists].T)
    if (off := np.abs(norms - 1) > 1e-4).any():
        raise InputError(f"directions: got a vector of length {norms[off][0]:g}, need unit vectors")
    powers = np.full(count, 2.0) if exponents is None else finite("exponents", exponents, (count,))
    return np.column_stack([centres, directions, *lengths, powers])[exists]


def _checked_side(extent: float, pixel_size: float, supersample: int) -> int:
    """Pixels along a side."""
    for name, value in (("extent", extent), ("pixel_size", pixel_size)):
        require_positive(name, value)
    if not isinstance(supersample, int) or isinstance(supersample, bool) or supersample < 1:
        raise InputError(f"supersample: got {supersample!r}, need a whole number of at least 1")
    side, largest = extent / pixel_size, MAX_SAMPLES // supersample
    if not 0.5 < side <= largest:
        raise InputError(
            f"extent: got {extent:g}, {side:.3g} pixels of {pixel_size:g} a side, need 1 to {largest} at supersample "
            f"{supersample}"
        )
    return round(side)


def finite(name: str, values: Array, shape: tuple[int | None, ...]) -> Floats:
    """An array of double precision; None in `shape` stands for any size."""
    array = np.asarray(values)
    wanted = f"[{', '.join('any' if size is None else str(size) for size in shape)}]"
    if array.dtype.kind not in "buif" or len(shape) != array.ndim:
        raise InputError(f"{name}: got shape {list(array.shape)} of {array.dtype}, need numbers {wanted}")
    if any(size not in (None, held) for size, held in zip(shape, array.shape, strict=True)):
        raise InputError(f"{name}: got shape {list(array.shape)}, need {wanted}")
    array = array.astype(np.float64)
    if shape == (None, None) and not array.size:
        raise InputError(f"{name}: got shape {list(array.shape)}, need at least one pixel")
    if bad := int((~np.isfinite(array)).sum()):
        raise InputError(f"{name}: {bad} of {array.size} values are NaN or infinite, need finite ones")
    return array


def require_positive(name: str, value: float) -> None:
    """Raises `InputError` for what is no length."""
    if isinstance(value, bool) or not isfinite(value) or value <= 0:
        raise InputError(f"{name}: got {value!r}, need a finite length above 0")
