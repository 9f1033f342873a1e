"""Numbers from users and files: how their text is read, and which are admissible."""

import math
import re
from dataclasses import KW_ONLY, dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.text import quoted

DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
WHOLE = re.compile(r"[+-]?\d{1,30}", re.ASCII)  # more digits are no size of anything


def number_of(value: Any) -> float:
    """Read a number: of a numeric type, or as text in digits with a decimal point, a sign and an exponent.

    Arguments:
        value: Anything.

    Returns:
        The number; nan for anything else, such as `1_0`, `0x10`, digits of other scripts, `inf`, `true` or nothing.
        A number beyond double precision is not finite, one too small for it, such as `1e-400`, is nan.
    """
    if isinstance(value, str):
        found = DECIMAL.fullmatch(value.strip())
        vanished = found and float(found[0]) == 0 and re.search("[1-9]", found[1])
        return float(found[0]) if found and not vanished else math.nan
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def whole_number_of(value: Any) -> int | None:
    """Read a whole number: of a numeric type, or as text in digits with a sign; None for anything else."""
    if isinstance(value, str):
        return int(value) if WHOLE.fullmatch(value := value.strip()) else None
    number = number_of(value)
    return int(value) if math.isfinite(number) and number == int(number) else None


def array_of(value: Any, what: str) -> np.ndarray:
    """Numbers as an array of double precision.

    Arguments:
        value: A number or an array, or sequences of them.
        what: What the message begins with.

    Raises:
        InputError: They are none, or rows differ in length.
    """
    try:
        if value is not None:
            return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        pass
    raise InputError(f"{what} is {quoted(value)}, it must be numbers, as many in each row")


def pair_of(value: Any, what: str) -> tuple[float, float]:
    """Two numbers. Raises `InputError`, which begins with `what`, for anything else."""
    numbers = array_of(value, what)
    if numbers.shape != (2,):
        raise InputError(f"{what} is {quoted(value)}, it must be two numbers")
    return float(numbers[0]), float(numbers[1])


@dataclass(frozen=True)
class Range:
    """Admissible numbers: finite, from `low` to `high`, both included.

    Attributes:
        low: The least; -inf for none.
        high: The largest; inf for none.
        unit: For messages.
        above: Whether `low` itself is not admissible.
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    _: KW_ONLY
    above: bool = False

    def __contains__(self, value: float) -> bool:
        return math.isfinite(value) and self.low <= value <= self.high and not (self.above and value == self.low)

    def __str__(self) -> str:
        """As in "a number from 0.001 to 1000 µm"."""
        unit = f" {self.unit}" if self.unit else ""
        low, high = _written(self.low), f"{_written(self.high)}{unit}"
        if self.high < math.inf and self.low > -math.inf:
            return f"a number above {low}, up to {high}" if self.above else f"a number from {low} to {high}"
        if self.low > -math.inf:
            return f"a number above {low}{unit}" if self.above else f"a number of at least {low}{unit}"
        return f"a number of at most {high}" if self.high < math.inf else f"a finite number{unit and ' of'}{unit}"

    @property
    def whole(self) -> str:
        """As in "a whole number of at least 1"."""
        return str(self).replace("a finite number", "a number").replace("a number", "a whole number")

    def read(self, value: Any, what: str) -> float:
        """Read a number, strictly.

        Arguments:
            value: A number or its text, see `number_of`.
            what: What the message begins with: where the value stands and what it is.

        Returns:
            The number.

        Raises:
            InputError: It is none, or not admissible.
        """
        number = number_of(value)
        if number not in self:
            raise InputError(f"{what} is {quoted(value)}, it must be {self}")
        return number

    def check(self, value: Any, what: str) -> float:
        """Like `read`, but text is no number.

        Arguments:
            value: A number.
            what: What the message begins with: where the value stands and what it is.

        Returns:
            The number.

        Raises:
            InputError: It is none, or not admissible.
        """
        if isinstance(value, str):
            raise InputError(f"{what} is {quoted(value)}, it must be {self}, without quotation marks")
        return self.read(value, what)

    def check_whole(self, value: Any, what: str) -> int:
        """Like `read_whole`, but text is no number, and neither is one of another type than whole numbers have.

        Arguments:
            value: A whole number.
            what: What the message begins with.

        Returns:
            The number.

        Raises:
            InputError: It is none, or not admissible.
        """
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise InputError(f"{what} is {quoted(value)}, it must be {self.whole}")
        return self.read_whole(value, what)

    def read_whole(self, value: Any, what: str) -> int:
        """Read a whole number, strictly and to its last digit.

        Arguments:
            value: A number or its text, in digits only.
            what: What the message begins with: where the value stands and what it is.

        Returns:
            The number.

        Raises:
            InputError: It is none, or not admissible.
        """
        number = whole_number_of(value)
        if number is None or not self.low <= number <= self.high or (self.above and number == self.low):
            raise InputError(f"{what} is {quoted(value)}, it must be {self.whole}")
        return number


def _written(end: float) -> str:
    """An end of a range; whole numbers to their last digit."""
    return str(end) if isinstance(end, int) else f"{end:g}"


POSITIVE = Range(0.0, above=True)
AT_LEAST_ONE = Range(1)
PIXEL_SIZES = Range(1e-3, 1e3, "µm")
"""Of micrographs: from 1 nm to 1 mm."""
HOURS = Range(1e-3, 1e5, "hours")
"""Since a colony was one cell: from 4 seconds to eleven years."""
CONTRASTS = Range(0.0, 1e38, "grey levels", above=True)
"""Of a colony with its background: images are of single precision."""
CELL_LENGTHS = Range(1e-2, 1e3, "µm")
"""Of one cell: bacteria and eggs lie within."""
GROWTH_RATES = Range(1e-4, 1e2, "per hour")
"""Of cells: the slowest divides once a year, the fastest within a minute."""
SEEDS = Range(0, 2**64 - 1)
"""Of random numbers."""
