"""The table that `yeastfit measure` leaves, measurements.csv, with the masks beside it: read, checked, chosen from."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import MAX_PIXELS, read_image
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.pixels import Mask
from yeastfit.measure.statistics.registry import STATISTICS, names_in_tables, names_with
from yeastfit.numbers import HOURS, PIXEL_SIZES, Range
from yeastfit.results.contents import check_finished
from yeastfit.text import quoted, shown
from yeastfit.text_files import check_look_alikes, instead_of_commas, read_csv

TABLE = "measurements.csv"
OF_ANYTHING = ("file", "replicate", "hours")  # columns that every table has
NEEDED = ("file", "condition", "replicate", "hours", "um_per_pixel", "mask", "max_radius")  # where it is of colonies
KNOWN = {"hours": HOURS, "um_per_pixel": PIXEL_SIZES}
SAME_SIZE = 0.02  # relative difference of pixel sizes within which masks are taken for equally fine
OF_MASK = 1e-3  # relative difference within which a number in a table is that of its mask
ROUNDING = 1e-6  # relative difference of numbers that should be equal


def table_in(source: Path) -> Path:
    """The table itself, or the one in a folder; whether there is one or not."""
    return source / TABLE if source.is_dir() else source


def files_of(table: Path, rows: Sequence[Mapping[str, Any]]) -> list[Path]:
    """A table and those of its masks that are there."""
    masks = [table.parent / str(row["mask"]) for row in rows if "mask" in row]
    return [table, *(mask for mask in masks if mask.is_file())]


def read_measurements(path: str | Path, needed: Sequence[str] = NEEDED) -> list[dict[str, Any]]:
    """Read the rows of a measurements.csv.

    Arguments:
        path: The table.
        needed: Columns that it must have.

    Returns:
        Rows by column: numbers as numbers, nan where a cell is empty, and text. The condition is "" where no column
        has it.

    Raises:
        InputError: It lacks a column, or a cell is no number, is none that its column can have, or
            does not fit others of its row. The message names the line, the column, the value and what is admissible.
    """
    path = Path(path)
    check_finished(path.parent)
    if not path.is_file():
        raise InputError(f"{path}: no table there, need the {TABLE} of `yeastfit measure`")
    wanted = f"need the {TABLE} of `yeastfit measure`"

    def check(names: list[str]) -> None:
        missing = [name for name in needed if name not in names]
        if names and missing:
            raise InputError(f"{path}: no column {', '.join(missing)}, {wanted}{instead_of_commas(names)}")

    names, cells = read_csv(path, check, ended=True)
    if not cells:
        raise InputError(f"{path}: no rows, {wanted}")
    numbers = KNOWN | {name: STATISTICS[name].admissible for name in names_in_tables()}
    rows = []
    for where, row in cells:
        values: dict[str, Any] = {"condition": ""}
        values |= {
            name: _number(row, name, numbers[name], where) if name in numbers else _text(row, name, where)
            for name in names
        }
        rows.append(values)
        _check_row(rows[-1], where)
    named = [(row, where) for row, (where, _) in zip(rows, cells, strict=True) if row.get("replicate")]
    timed = [(row, where) for row, where in named if math.isfinite(row.get("hours", math.nan))]
    _refuse_twice([row for row, _ in timed], [where for _, where in timed])
    for name in ("condition", "replicate"):
        check_look_alikes((str(row.get(name, "")) for row in rows), f"{path}: {name}s")
    return rows


def _number(row: Mapping[str, str], name: str, admissible: Range, where: str) -> float:
    """The number in a cell, nan where it is empty."""
    text = row.get(name, "nan")
    if text == "nan":
        return math.nan
    value = admissible.read(text, f"{where}: {name}")
    if name in STATISTICS and STATISTICS[name].is_count and not value.is_integer():
        raise InputError(f"{where}: {name} is {text!r}, it must be a whole number")
    return value


def _text(row: Mapping[str, str], name: str, where: str) -> str:
    text = row.get(name, "")
    if shown(text) != text:
        raise InputError(f"{where}: {name} is {quoted(text)}, it must be one line without invisible characters")
    return text


def _check_row(row: Mapping[str, Any], where: str) -> None:
    """Raise `InputError` where sizes do not fit each other, pixels of side h.

    r ≤ r_max ≤ 10⁸ h,   A ≤ π (r_max + h / √2)²,   r ≥ ⅔ √(A / π) - h / 2 (that of a disc is the least)
    """
    longest, pixel = row.get("max_radius", math.nan), row.get("um_per_pixel", math.nan)
    if longest > MAX_PIXELS * pixel:
        raise InputError(
            f"{where}: max_radius is {longest:g} µm, it must be at most {MAX_PIXELS:g} pixels of {pixel:g} µm"
        )
    if row.get("radius", 0.0) > longest * (1 + ROUNDING):
        raise InputError(f"{where}: radius is {row['radius']:g} µm, it must be at most max_radius, {longest:g} µm")
    largest = math.pi * (longest + pixel / math.sqrt(2)) ** 2
    if row.get("area", 0.0) > largest * (1 + ROUNDING):
        raise InputError(
            f"{where}: area is {row['area']:g} µm², it must be at most {largest:g} µm², as max_radius is {longest:g} µm"
        )
    least = 2 / 3 * math.sqrt(row.get("area", 0.0) / math.pi) - pixel / 2
    if row.get("radius", math.inf) < least:
        raise InputError(
            f"{where}: radius is {row['radius']:g} µm, it must be at least {least:g} µm, as area is {row['area']:g} µm²"
        )


def conditions_of(rows: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """In order of appearance."""
    return tuple(dict.fromkeys(str(row["condition"] or "") for row in rows))


def rows_of(rows: Sequence[Mapping[str, Any]], condition: str | None) -> list[Mapping[str, Any]]:
    """Of one condition, which may be left out where there is one. Raises `InputError`."""
    there = conditions_of(rows)
    known = ", ".join(map(repr, there))
    if condition is None and len(there) > 1:
        raise InputError(f"condition: there are {known}, targets are of one: choose")
    if condition is not None and condition not in there:
        raise InputError(f"condition: got {condition!r}, there are {known}")
    return [row for row in rows if condition is None or str(row["condition"] or "") == condition]


def missing_masks(rows: Sequence[Mapping[str, Any]], folder: Path) -> list[str]:
    """Say which conditions have lost masks, and what follows from it.

    Arguments:
        rows: Of measurements.csv.
        folder: Where it lies.

    Returns:
        One sentence for each condition of which a mask is missing.
    """
    sentences = []
    for condition in conditions_of(rows):
        own = [row for row in rows_of(rows, condition) if "mask" in row]
        gone = [
            str(row["mask"] or f"that of {row['file']}") for row in own if not (folder / str(row["mask"])).is_file()
        ]
        if gone:
            of = f" of condition {condition!r}" if condition else ""
            some = ", ".join(gone[:3]) + (", …" if gone[3:] else "")
            sentences.append(
                f"{len(gone)} of {len(own)} masks{of} are missing ({some}): its curves are the table's own numbers, "
                "and simulated colonies are measured as masks are"
            )
    return sentences


def read_mask(path: Path, row: Mapping[str, Any], statistics: Sequence[str] = ()) -> Mask:
    """A mask, which must be the one that the row was measured on.

    Arguments:
        path: Of the mask.
        row: Of the table.
        statistics: Whose numbers in the row must be the mask's, besides the area.

    Raises:
        InputError: A number of the row is not the mask's.
    """
    mask = read_image(path) > 0
    known = ["area", *(name for name in statistics if name in names_with("mask"))]
    if empty := [name for name in known if name in row and not math.isfinite(float(row[name]))]:
        raise InputError(
            f"{row['file']}: {empty[0]} is empty in the table, its mask {path} has it: leave the row out for the image "
            "not to count, or measure it again"
        )
    for name, value in measure_mask(mask, row["um_per_pixel"], dict.fromkeys(known)).items():
        stated, unit = float(row.get(name, math.nan)), f" {STATISTICS[name].unit('µm')}".rstrip()
        if math.isfinite(stated) and abs(value - stated) > OF_MASK * max(abs(value), abs(stated)):
            raise InputError(
                f"{row['file']}: {name} is {stated:g}{unit} in the table, its mask {path} has {value:g}{unit}: measure "
                "the image again, or remove the masks for the table's numbers to be taken"
            )
    return mask


def checked_rows(rows: Sequence[Mapping[str, Any]], condition: str | None) -> list[Mapping[str, Any]]:
    """Of one condition, each with hours, a replicate of its own and, of colonies, sizes. Raises `InputError`."""
    chosen = rows_of(rows, condition)
    for row in chosen:
        hours = row["hours"]
        if not (isinstance(hours, int | float) and math.isfinite(hours) and hours > 0):
            raise InputError(f"{row['file']}: its hours are unknown, a fit needs them: measure a data set")
        for name in ("um_per_pixel", "max_radius"):
            if name in row:
                admissible = KNOWN.get(name) or STATISTICS[name].admissible
                if isinstance(row[name], float) and math.isnan(row[name]):
                    raise InputError(f"{row['file']}: {name} is empty in the table, it must be {admissible}")
                admissible.read(row[name], f"{row['file']}: {name}")
    unnamed = [row for row in chosen if not str(row["replicate"] or "")]
    if unnamed and len(unnamed) < len(chosen):
        raise InputError(f"{unnamed[0]['file']}: its replicate is empty, others have one: say which colony it is of")
    _refuse_twice(chosen, [str(row["file"]) for row in chosen])
    return chosen


def check_same_size(rows: Sequence[Mapping[str, Any]], advice: str = "") -> None:
    """Raise `InputError` where pixel sizes differ, naming the images; `advice` says what does not depend on them."""
    least, most = (choose(rows, key=lambda row: float(row["um_per_pixel"])) for choose in (min, max))
    low, high = float(least["um_per_pixel"]), float(most["um_per_pixel"])
    if high - low > SAME_SIZE * high:
        raise InputError(
            f"um_per_pixel runs from {low:g} to {high:g}: statistics of masks depend on it"
            f"{advice or ', so that images need pixels of one size'} (smallest in {least['file']}, largest in "
            f"{most['file']})"
        )


def _refuse_twice(rows: Sequence[Mapping[str, Any]], places: Sequence[str]) -> None:
    """Raises `InputError` where two rows, which are at these places, are of one colony at one time."""
    first: dict[tuple[str, str, float], str] = {}
    for row, place in zip(rows, places, strict=True):
        key = (str(row["condition"] or ""), str(row["replicate"] or ""), float(row["hours"]))
        if key in first:
            raise InputError(
                f"{place}: replicate {key[1]!r} at {key[2]:g} hours appears twice, {first[key]} is of it, too: "
                "every colony needs a replicate of its own"
            )
        first[key] = place.rpartition(", ")[2] if place != row["file"] else place
