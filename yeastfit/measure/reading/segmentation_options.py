"""Options that take precedence over what segmentation would find by itself, and how their values are read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import MIN_SIDE
from yeastfit.numbers import CONTRASTS, number_of
from yeastfit.text import quoted


@dataclass(frozen=True)
class SegmentationOptions:
    """What a user says about the outline of a colony; None leaves it to `segment`.

    Attributes:
        seed_point: x and y in pixels of a point of the colony.
        threshold: The contrast with the background, in grey levels, from which a pixel is colony.
        roi: x0, y0, x1, y1 in pixels: the part of the image to look at.
        colonies: "one" object of an image is measured, or "all" that are no dust.
    """

    seed_point: Sequence[float] | None = None
    threshold: float | None = None
    roi: Sequence[float] | None = None
    colonies: str | None = None

    def as_arguments(self) -> dict[str, Any]:
        """The options that are given, by the names of `segment`'s arguments."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def check(self, shape: tuple[int, int], name: str) -> None:
        """Raise `InputError` where an option does not fit an image of `shape` [rows, columns]."""
        size = f"image of {shape[1]} x {shape[0]}"
        if self.threshold is not None and not (_is_number(self.threshold) and self.threshold in CONTRASTS):
            raise InputError(f"{name}: threshold is {quoted(self.threshold)}, need {CONTRASTS}")
        if self.colonies not in (None, *COLONIES):
            raise InputError(f"{name}: colonies is {quoted(self.colonies)}, it must be {' or '.join(COLONIES)}")
        self.check_colonies(f"{name}: ")
        x0, y0, x1, y1 = 0.0, 0.0, float(shape[1]), float(shape[0])
        if self.roi is not None:
            if len(self.roi) != 4 or not all(_is_number(each) and int(each) == each for each in self.roi):
                raise InputError(f"{name}: roi is {quoted(self.roi)}, need four whole numbers of pixels x0, y0, x1, y1")
            x0, y0, x1, y1 = self.roi
            if not (0 <= x0 < x1 <= shape[1] and 0 <= y0 < y1 <= shape[0]):
                raise InputError(
                    f"{name}: roi is {quoted(self.roi)}, need x0 < x1 and y0 < y1 within the {size} pixels"
                )
            if min(x1 - x0, y1 - y0) < MIN_SIDE:
                raise InputError(f"{name}: roi is {quoted(self.roi)}, need at least {MIN_SIDE} pixels a side")
        if self.seed_point is not None:
            if len(self.seed_point) != 2 or not all(_is_number(each) for each in self.seed_point):
                raise InputError(f"{name}: seed_point is {quoted(self.seed_point)}, need two numbers of pixels x, y")
            x, y = self.seed_point
            if not (x0 <= x < x1 and y0 <= y < y1):
                where = f"roi {quoted(self.roi)}" if self.roi is not None else f"{size} pixels"
                raise InputError(f"{name}: seed_point is {quoted(self.seed_point)}, need a point within the {where}")

    def check_colonies(self, where: str) -> None:
        """Raise `InputError` where all objects are asked for and one of them."""
        if self.colonies == "all" and self.seed_point is not None:
            at = ",".join(f"{one:g}" if _is_number(one) else quoted(one) for one in self.seed_point)
            raise InputError(f"{where}colonies and seed_point are 'all' and {at}, which means one: leave out either")

    def window(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns of the roi, or of the whole image without one."""
        x0, y0, x1, y1 = (0, 0, shape[1], shape[0]) if self.roi is None else map(int, self.roi)
        return slice(y0, y1), slice(x0, x1)

    def seed_within(self) -> tuple[float, float] | None:
        """The seed point, counted from the corner of the roi."""
        if self.seed_point is None:
            return None
        x0, y0 = (0, 0) if self.roi is None else self.roi[:2]
        return self.seed_point[0] - x0, self.seed_point[1] - y0


COLONIES = ("one", "all")
AUTOMATIC = SegmentationOptions()
"""Everything is left to `segment`."""


def read_options(values: Mapping[str, Any], where: str = "") -> SegmentationOptions:
    """Read options from texts or numbers.

    Arguments:
        values: By the names of the options; others are ignored.
        where: What messages begin with, before the name of the option.

    Returns:
        The options.

    Raises:
        InputError: The threshold is not above 0, the seed point not two numbers, the roi not four whole ones, or
            `colonies` not one of `COLONIES`, or all where there is a seed point.
    """
    point, roi = (
        _numbers(values[name], f"{where}{name}", size) if values.get(name) is not None else None
        for name, size in (("seed_point", 2), ("roi", 4))
    )
    if roi is not None and any(one != round(one) for one in roi):
        raise InputError(f"{where}roi is {quoted(values['roi'])}, need four whole numbers of pixels x0, y0, x1, y1")
    if roi is not None and not (0 <= roi[0] < roi[2] and 0 <= roi[1] < roi[3]):
        raise InputError(f"{where}roi is {quoted(values['roi'])}, need x0 < x1 and y0 < y1, none below 0")
    threshold, colonies = values.get("threshold"), values.get("colonies")
    if colonies is not None and colonies not in COLONIES:
        raise InputError(f"{where}colonies is {quoted(colonies)}, it must be {' or '.join(COLONIES)}")
    found = SegmentationOptions(
        None if point is None else (point[0], point[1]),
        None if threshold is None else CONTRASTS.read(threshold, f"{where}threshold"),
        None if roi is None else (round(roi[0]), round(roi[1]), round(roi[2]), round(roi[3])),
        colonies,
    )
    found.check_colonies(where)
    return found


def _numbers(value: Any, name: str, size: int) -> tuple[float, ...]:
    """`size` finite numbers from a list, or from a text in which commas, semicolons or spaces stand between them."""
    parts = value.replace(",", " ").replace(";", " ").split() if isinstance(value, str) else value
    numbers = tuple(map(number_of, parts)) if isinstance(parts, list | tuple) else ()
    if len(numbers) != size or not all(map(math.isfinite, numbers)):
        names = "x y" if size == 2 else "x0 y0 x1 y1"
        raise InputError(f"{name} is {quoted(value)}, it must be {size} numbers, {names} in pixels")
    return numbers


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
