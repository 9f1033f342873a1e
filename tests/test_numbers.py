"""Numbers are read strictly and checked against what is admissible."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yeastfit.errors import InputError
from yeastfit.numbers import HOURS, PIXEL_SIZES, POSITIVE, Range, number_of


@pytest.mark.parametrize(
    ("value", "number"),
    [
        ("10", 10),
        (" 1.5 ", 1.5),
        ("+2.", 2),
        ("-.5e-3", -0.0005),
        ("1E5", 1e5),
        (7, 7),
        (2.5, 2.5),
        ("1e999", math.inf),
        ("0.0e-400", 0),
    ],
)
def test_numbers_are_read(value: object, number: float) -> None:
    assert number_of(value) == number


WORDS = [
    "",
    " ",
    "1_0",
    "0x10",
    "1,5",
    "1.5 h",
    "١٢",
    "１",
    "inf",
    "nan",
    "-Infinity",
    "1e",
    "e5",
    ".",
    "--1",
    "1 0",
    "1\0",
    "1e-400",
    "-0.3e-5000",
]


@pytest.mark.parametrize("value", [*WORDS, "1" * 5000 + "x", True, None, [1], {"a": 1}, b"1", 1j, np.bool_(True)])
def test_anything_else_is_none(value: object) -> None:
    assert math.isnan(number_of(value))


@settings(deadline=None, derandomize=True)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_what_python_writes_is_read_back(value: float) -> None:
    assert number_of(repr(value)) == value


@pytest.mark.parametrize(
    ("admissible", "words"),
    [
        (Range(), "a finite number"),
        (Range(unit="h"), "a finite number of h"),
        (POSITIVE, "a number above 0"),
        (Range(1), "a number of at least 1"),
        (Range(high=2, unit="µm"), "a number of at most 2 µm"),
        (PIXEL_SIZES, "a number from 0.001 to 1000 µm"),
        (HOURS, "a number from 0.001 to 100000 hours"),
    ],
)
def test_ranges_say_what_is_admissible(admissible: Range, words: str) -> None:
    assert str(admissible) == words


def test_ends_belong_to_a_range_unless_it_is_above_them() -> None:
    assert [value in Range(0, 1) for value in (-1e-9, 0, 1, 1 + 1e-9, math.nan, math.inf)] == [
        False,
        True,
        True,
    ] + 3 * [False]
    assert 0.0 not in POSITIVE
    assert 5e-324 in POSITIVE


@pytest.mark.parametrize("value", ["1e-200", "0", "nan", "1_0", 10**400, -1, None, "9" * 5000])
def test_what_is_not_admissible_is_refused_with_the_value(value: object) -> None:
    with pytest.raises(InputError) as caught:
        PIXEL_SIZES.read(value, "manifest.csv, line 2: um_per_pixel")
    message = str(caught.value)
    assert message.startswith("manifest.csv, line 2: um_per_pixel is ")
    assert message.endswith("it must be a number from 0.001 to 1000 µm")
    assert len(message) < 200
