"""What a user may say about an image that segmentation would otherwise find out by itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import MIN_SIDE


@dataclass(frozen=True)
class Overrule:
    """seed_point (x, y) and roi (x0, y0, x1, y1) in pixels, threshold in grey levels; None leaves it to `segment`."""

    seed_point: Sequence[float] | None = None
    threshold: float | None = None
    roi: Sequence[float] | None = None

    def check(self, shape: tuple[int, int], name: str) -> None:
        """Raise `InputError` where it does not fit an image of `shape` [rows, columns]."""
        size = f"image of {shape[1]} x {shape[0]}"
        if self.threshold is not None and not (_is_number(self.threshold) and self.threshold > 0):
            raise InputError(f"{name}: threshold is {self.threshold!r}, need a contrast above 0 in grey levels")
        x0, y0, x1, y1 = 0.0, 0.0, float(shape[1]), float(shape[0])
        if self.roi is not None:
            if len(self.roi) != 4 or not all(_is_number(each) and int(each) == each for each in self.roi):
                raise InputError(f"{name}: roi is {self.roi!r}, need four whole numbers of pixels x0, y0, x1, y1")
            x0, y0, x1, y1 = self.roi
            if not (0 <= x0 < x1 <= shape[1] and 0 <= y0 < y1 <= shape[0]):
                raise InputError(f"{name}: roi is {self.roi!r}, need x0 < x1 and y0 < y1 within the {size} pixels")
            if min(x1 - x0, y1 - y0) < MIN_SIDE:
                raise InputError(f"{name}: roi is {self.roi!r}, need at least {MIN_SIDE} pixels a side")
        if self.seed_point is not None:
            if len(self.seed_point) != 2 or not all(_is_number(each) for each in self.seed_point):
                raise InputError(f"{name}: seed_point is {self.seed_point!r}, need two numbers of pixels x, y")
            x, y = self.seed_point
            if not (x0 <= x < x1 and y0 <= y < y1):
                where = f"roi {self.roi!r}" if self.roi is not None else f"{size} pixels"
                raise InputError(f"{name}: seed_point is {self.seed_point!r}, need a point within the {where}")

    def window(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns of the roi, of everything without one."""
        x0, y0, x1, y1 = (0, 0, shape[1], shape[0]) if self.roi is None else map(int, self.roi)
        return slice(y0, y1), slice(x0, x1)

    def seed_within(self) -> tuple[float, float] | None:
        """The seed point counted from the corner of the roi."""
        if self.seed_point is None:
            return None
        x0, y0 = (0, 0) if self.roi is None else self.roi[:2]
        return self.seed_point[0] - x0, self.seed_point[1] - y0


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
