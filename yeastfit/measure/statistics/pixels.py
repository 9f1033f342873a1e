"""The pixels of one mask and what several statistics need of them, each computed once and only when asked for.

Everything is in pixels, in the frame of the mask cropped to the colony, so that no statistic depends on where in the
image the colony lies.
"""

import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import scipy
from jaxtyping import Bool, Float, Int

from yeastfit.errors import InputError

Mask = Bool[np.ndarray, "row column"]
PerPixel = Float[np.ndarray, " pixel"]
Derived = TypeVar("Derived")

TIE = 1e-9
"""Distances are compared to within this many pixels: a colony turned by 90° has the same up to rounding."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of a colony.

    Attributes:
        colony: [row, column], which pixels are colony, cropped to a margin of one empty pixel all round.
        corner: Row and column, in the whole image, of its first pixel.
    """

    colony: Mask
    corner: tuple[int, int]
    _derived: dict[Callable[..., Any], Any] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, mask: npt.NDArray[np.generic]) -> "Pixels":
        """Crop a mask.

        Raises:
            InputError: It is not 2-D, holds NaN or has no colony pixel.
        """
        colony = _checked(mask)
        rows, columns = (np.flatnonzero(colony.any(axis=axis)) for axis in (1, 0))
        cropped = colony[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return cls(np.pad(cropped, 1), (int(rows[0]) - 1, int(columns[0]) - 1))

    def derived(self, make: "Callable[[Pixels], Derived]") -> Derived:
        """`make(self)`, computed once however many statistics ask for it; it may keep the pixels it is given.

        They are a weak reference to these, which would be kept by what they keep: megabytes until Python looks for
        cycles, and it may not for thousands of masks.
        """
        if make not in self._derived:
            self._derived[make] = make(weakref.proxy(self))
        return self._derived[make]

    @cached_property
    def area(self) -> int:
        """Number of pixels."""
        return int(np.count_nonzero(self.colony))

    @cached_property
    def filled(self) -> Mask:
        """[row, column], the colony with its holes closed, which are 4-connected."""
        return scipy.ndimage.binary_fill_holes(self.colony)

    @cached_property
    def indices(self) -> tuple[Int[np.ndarray, " pixel"], Int[np.ndarray, " pixel"]]:
        """Rows [pixel] and columns [pixel] of all colony pixels, a pair."""
        rows = np.repeat(np.arange(len(self.colony)), np.count_nonzero(self.colony, axis=1))
        return rows, np.flatnonzero(self.colony) - rows * self.colony.shape[1]  # three times as fast as np.nonzero

    @cached_property
    def centre(self) -> tuple[float, float]:
        """Row and column of the centroid."""
        in_rows, in_columns = (self.colony.view(np.uint8).sum(axis=axis, dtype=np.uint32) for axis in (1, 0))
        row, column = (int(count @ np.arange(len(count))) / self.area for count in (in_rows, in_columns))
        return row, column

    @cached_property
    def square(self) -> Float[np.ndarray, "row column"]:
        """[row, column], square of the distance of every pixel, of the colony or not, from the centroid."""
        (height, width), (row, column) = self.colony.shape, self.centre
        return ((np.arange(height) - row) ** 2)[:, None] + (np.arange(width) - column) ** 2

    @cached_property
    def distance(self) -> PerPixel:
        """[pixel], distance of every colony pixel from the centroid."""
        return np.sqrt(self.square[self.colony])

    @cached_property
    def angle(self) -> PerPixel:
        """[pixel], direction of every colony pixel as seen from the centroid, in radians, upwards positive."""
        (rows, columns), (row, column) = self.indices, self.centre
        return np.arctan2(row - rows, columns - column)

    @cached_property
    def max_radius(self) -> float:
        """Distance of the farthest pixel from the centroid."""
        return float(self.distance.max())

    def to_outside(self, of: Int[np.ndarray, "pixel 2"]) -> PerPixel:
        """[pixel], distance of some pixels of the colony, given by row and column, from the nearest one outside."""
        return np.asarray(self._outside.query(of)[0])

    @cached_property
    def _outside(self) -> scipy.spatial.cKDTree:
        """Pixels outside of the colony, in its holes or beyond it, that have a pixel of it beside them."""
        outside = ~self.colony  # shifted rather than dilated by scipy, in a twentieth of its time
        beside = np.zeros_like(outside)
        for here, there in ((slice(1, None), slice(-1)), (slice(-1), slice(1, None))):
            beside[here] |= self.colony[there]
            beside[:, here] |= self.colony[:, there]
        return scipy.spatial.cKDTree(np.argwhere(outside & beside))

    @cached_property
    def perimeter(self) -> float:
        """Length of all boundaries; see `shape` for the estimator."""
        return _crofton(self.colony)

    @cached_property
    def outer_perimeter(self) -> float:
        """Length of the boundary with holes closed."""
        return _crofton(self.filled)


def _crofton(colony: Mask) -> float:
    """π/8 (N₀ + N₉₀ + (N₄₅ + N₁₃₅) / √2), N the crossings of the boundary along lines through pixels; see `shape`."""
    along = _changes(colony[1:], colony[:-1]) + _changes(colony[:, 1:], colony[:, :-1])
    across = _changes(colony[1:, 1:], colony[:-1, :-1]) + _changes(colony[1:, :-1], colony[:-1, 1:])
    return float(np.pi / 8 * (along + across / np.sqrt(2)))


def _changes(here: Mask, there: Mask) -> int:
    return int(np.count_nonzero(here != there))


def _checked(mask: npt.NDArray[np.generic]) -> Mask:
    mask = np.asarray(mask)
    if mask.ndim != 2:
        raise InputError(f"mask: got an array of shape {mask.shape}, need two dimensions [rows, columns]")
    if mask.dtype.kind not in "biuf" or (mask.dtype.kind == "f" and np.isnan(mask).any()):
        raise InputError(f"mask: got dtype {mask.dtype} or NaN, need a boolean array, True where the colony is")
    colony: Mask = mask if mask.dtype == bool else mask != 0
    if not colony.any():
        raise InputError(f"mask: none of its {colony.size} pixels is colony, need at least one")
    return colony
