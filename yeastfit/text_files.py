"""Read text files of users: UTF-8, CSV tables and TOML. What is wrong is one line that names the file and the place."""

import codecs
import csv
import re
import tomllib
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

from yeastfit.errors import InputError

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
INVISIBLE = re.compile(
    "[\u00ad\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b-\u200f\u2060-\u2064\u3164\ufe00-\ufe0f\ufeff\uffa0"
    "\U000e0100-\U000e01ef]"
)
"""Characters that no font shows."""
LATIN = str.maketrans(
    "\u0410\u0412\u0415\u041a\u041c\u041d\u041e\u0420\u0421\u0422\u0423\u0425\u0405\u0406\u0408"
    "\u0430\u0435\u043e\u0440\u0441\u0443\u0445\u0455\u0456\u0458"
    "\u0391\u0392\u0395\u0396\u0397\u0399\u039a\u039c\u039d\u039f\u03a1\u03a4\u03a5\u03a7\u03bf",
    "ABEKMHOPCTYXSIJaeopcyxsijABEZHIKMNOPTYXo",
)
"""Cyrillic and Greek letters whose shape is that of a Latin one."""


def read_text(path: str | Path) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Arguments:
        path: The file.

    Returns:
        Its text, with line ends as they are.

    Raises:
        InputError: It cannot be opened, is not UTF-8, or holds a NUL character.
    """
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for
        raise InputError(f"{path}: is no regular file, need a text file in UTF-8")
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if data.startswith(UTF_16):
        raise InputError(f"{path}: is a text file in UTF-16, need UTF-8: save it again as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: not a text file in UTF-8 ({error.reason})") from None
    if (place := text.find("\0")) >= 0:
        line = text.count("\n", 0, place) + 1
        raise InputError(f"{path}, line {line}: holds a NUL character, need a text file in UTF-8")
    return text


def read_csv(
    path: str | Path, check: Callable[[list[str]], None] = lambda names: None, *, ended: bool = False
) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """Read a CSV table with commas and a header.

    Arguments:
        path: The file.
        check: Called with the names of the columns, before any other line is looked at.
        ended: Whether the last line has an end, as in all tables that yeastfit writes. One without may have been cut
            off within a number, and is warned of.

    Returns:
        The names of the columns; and for each row, but empty ones, where it stands ("table.csv, line 2") and its cells
        by column, without those that are empty. Space around names and cells is left out.

    Raises:
        InputError: It is no text file, no CSV, a column appears twice, or a row has more or fewer cells than there are
            columns.
    """
    text = read_text(path)
    reader = csv.reader(StringIO(text, newline=""), strict=True)
    rows = []
    try:
        names = [name.strip() for name in next(reader, [])]
        check(names)
        twice = next((name for name in names if name and names.count(name) > 1), None)
        if twice:
            raise InputError(f"{path}, line 1: a column appears twice, {twice!r}")
        for cells in reader:
            where = f"{path}, line {reader.line_num}"
            if len(cells) != len(names) and any(cell.strip() for cell in cells):
                cut = ": the file may be cut off here; empty cells need their commas" if len(cells) < len(names) else ""
                raise InputError(f"{where}: {len(cells)} cells, the first line names {len(names)} columns{cut}")
            row = {name: cell.strip() for name, cell in zip(names, cells, strict=False) if cell.strip()}
            rows += [(where, row)] if row else []
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: not CSV ({error})") from None
    if ended and rows and not text.rstrip(" \t").endswith(("\n", "\r")):
        where = rows[-1][0]
        warnings.warn(f"{where}: the file ends within this line: was its end cut off?", UserWarning, stacklevel=2)
    return names, rows


def instead_of_commas(names: Sequence[str]) -> str:
    """What else the columns of a table are separated by, as its first line looks, in words for an error; or nothing."""
    other = next((word for mark, word in ((";", "semicolons"), ("\t", "tabs")) if mark in "".join(names)), None)
    return f", separated by commas and not by {other}" if other else ""


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file.

    Arguments:
        path: The file.

    Returns:
        Its content.

    Raises:
        InputError: It is no text file, or no TOML; numbers of thousands of digits and tables nested hundreds of times
            are neither.
    """
    try:
        return tomllib.loads(read_text(path))
    except InputError:
        raise
    except ValueError as error:  # of TOML, and of Python, which reads no integer of more than 4300 digits
        raise InputError(f"{path}: not TOML ({str(error).partition(';')[0]})") from None
    except RecursionError:
        raise InputError(f"{path}: not TOML that can be read (tables within tables, too many)") from None


def check_look_alikes(names: Iterable[str], what: str) -> None:
    """Check that no two names look the same, as "50 µM" with a micro sign and with a Greek letter do.

    Arguments:
        names: Of conditions, for instance; those look the same that are the same in Unicode's compatible form, with
            plain spaces, without invisible characters, and with Latin letters for the like of other scripts.
        what: They are, and where.

    Raises:
        InputError: Two of them do.
    """
    seen: dict[str, str] = {}
    for name in names:
        plain = unicodedata.normalize("NFKC", INVISIBLE.sub("", name)).translate(LATIN)
        first = seen.setdefault(" ".join(plain.split()), name)
        if first != name:
            alike = f"{first!a} and {name!a}"
            raise InputError(f"{what} {alike} look alike and are of different characters: write both the same")
