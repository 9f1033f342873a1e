"""Text of users and files is shown whole, in one line, and acts on nothing."""

import unicodedata
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yeastfit import InputError
from yeastfit.text import (
    HIDDEN,
    JOINERS,
    LONGEST,
    LONGEST_LIST,
    LONGEST_NAME,
    as_html,
    file_name,
    listed,
    quoted,
    shown,
)
from yeastfit.text_files import check_look_alikes, read_csv

# any text, surrogates of file names that are not UTF-8 included
TEXTS = st.text(st.characters(exclude_categories=()), max_size=40)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a_24h.tif", "a_24h.tif"),
        ("50 µM, YPD\u202fagar", "50 µM, YPD\u202fagar"),
        ("培养基 $x_1$ [red] \\alpha", "培养基 $x_1$ [red] \\alpha"),
        ("👩\u200d🔬", "👩\u200d🔬"),
        ("a\nb\tc\r", r"a\nb\tc\r"),
        ("\x1b[31mred\x07", r"\x1b[31mred\x07"),
        ("gpj.\u202ejpg", r"gpj.\u202ejpg"),
        ("zero\u200bwidth\ufeff", r"zero\u200bwidth\ufeff"),
        ("line\u2028end\x85", r"line\u2028end\x85"),
        (b"caf\xe9.tif".decode(errors="surrogateescape"), r"caf\xe9.tif"),
        ("\ud800", r"\ud800"),
        ("\U000e0041", r"\U000e0041"),
        (3.5, "3.5"),
    ],
)
def test_text_is_shown(text: object, expected: str) -> None:
    assert shown(text) == expected


@settings(deadline=None, derandomize=True)
@given(TEXTS)
def test_shown_text_is_one_line_of_valid_utf8_that_hides_nothing(text: str) -> None:
    result = shown(text)
    result.encode()
    assert len(result.splitlines()) <= 1
    assert not any(unicodedata.category(each) in HIDDEN and each not in JOINERS for each in result)
    assert shown(result) == result
    assert all(each in result for each in text if each.isprintable())


@settings(deadline=None, derandomize=True)
@given(TEXTS)
def test_html_holds_no_markup(text: str) -> None:
    assert not set("<>\"'") & set(as_html(text))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("a_24h (2)", "a_24h (2)"),
        ("a\nb/c", "a_b_c"),
        ("..", "_"),
        ("", "_"),
        ("-rf", "rf"),
        (".-.hidden", "hidden"),
        ("ends. ", "ends"),
        ("e\u0301", "é"),
        ("é" * 200, "é" * 60),
        (b"\xff".decode(errors="surrogateescape"), "_"),
    ],
)
def test_names_of_files(text: str, name: str) -> None:
    assert file_name(text) == name


@settings(deadline=None, derandomize=True)
@given(TEXTS)
def test_names_of_files_suit_every_system(text: str) -> None:
    name = file_name(text)
    assert 0 < len(name.encode()) <= LONGEST_NAME
    assert shown(name) == name == file_name(name)
    assert not set('/\\<>:"|?*') & set(name)
    assert name[0] not in ".- "
    assert name[-1] not in ". "


def test_values_of_messages_are_short() -> None:
    assert quoted("a\nb") == r"'a\nb'"
    assert quoted(b"\xff") == r"b'\xff'"
    assert quoted(2.5) == "2.5"
    words = {"a": [True, None, 2.0], "b": {"c": date(2024, 1, 2)}, "d": np.array([2.0, 2.5]), "e": np.float64(3)}
    assert quoted(words) == "{a = [true, null, 2.0], b = {c = 2024-01-02}, d = [2, 2.5], e = 3}"
    for huge in ("x" * 10**6, list(range(10**4)), 10**5000):
        assert len(quoted(huge)) <= LONGEST
    assert quoted("x" * 1000).startswith("'xxx")
    nested: list = []
    for _ in range(10**5):
        nested = [nested]
    assert quoted(nested) == "a list nested thousands of times"


def test_lists_of_messages_are_short() -> None:
    assert listed([]) == ""
    assert listed(["radius", "area"]) == "radius, area"
    assert (
        listed([f"name_{k:03d}" for k in range(60)]) == ", ".join(f"name_{k:03d}" for k in range(40)) + " and 20 more"
    )
    for count in range(100):
        names = [f"name_{k}" for k in range(count)]
        found, _, more = listed(names).partition(" and ")
        assert len(found) <= LONGEST_LIST
        assert (found.count("name") + int((more or "0").removesuffix(" more"))) == count


def test_names_that_look_alike_are_refused() -> None:
    check_look_alikes(["50 µM", "50 µM", "HIS3", "his3", "01", "1", ""], "conditions")
    alike = (("50 µM", "50 \u03bcM"), ("a b", "a\u00a0b"), ("é", "e\u0301"), ("A", "\u0410"), ("o", "\u03bf"))
    for first, second in (*alike, *(("a", f"a{hidden}") for hidden in "\ufe0f\u034f\u3164")):
        with pytest.raises(InputError, match=r"^t\.csv: conditions '.*' and '.*' look alike"):
            check_look_alikes([first, "other", second], "t.csv: conditions")


@pytest.mark.parametrize("end", ["", "  "])
def test_a_table_that_ends_within_its_last_line_is_told_of(tmp_path: Path, end: str) -> None:
    """Of a table that was cut off within a number nothing else tells."""
    path = tmp_path / "table.csv"
    path.write_text("file,hours\na.png,12.5\nb.png,1" + end, encoding="utf-8")
    with pytest.warns(UserWarning, match=r"table\.csv, line 3: the file ends within this line: was its end cut off\?"):
        assert read_csv(path, ended=True)[1][1][1] == {"file": "b.png", "hours": "1"}
    assert read_csv(path)[1][1][1] == {"file": "b.png", "hours": "1"}  # a manifest from anywhere


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\n\n", "\n  "])
def test_a_table_whose_last_line_has_an_end_is_read_without_a_word(tmp_path: Path, end: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text("file,hours\na.png,12.5" + end, encoding="utf-8", newline="")
    assert read_csv(path, ended=True)[1][0][1] == {"file": "a.png", "hours": "12.5"}
