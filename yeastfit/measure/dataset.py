"""A data set: a folder of micrographs with a manifest that says what each one shows.

`manifest.csv` has one row per micrograph and the columns

    file            path of the image, relative to the manifest
    replicate       name or number of the colony
    hours           time since the colony was one cell, in hours
    um_per_pixel    size of a pixel in µm; may be empty where the file itself says it
"""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from yeastfit.errors import InputError

COLUMNS = ("file", "replicate", "hours", "um_per_pixel")


@dataclass(frozen=True)
class Frame:
    """One row of a manifest: one colony at one time. `pixel_size` in µm, None where only the file may know it."""

    path: Path
    replicate: str
    hours: float
    pixel_size: float | None


@dataclass(frozen=True)
class Dataset:
    """All frames of a folder, in the manifest's order."""

    folder: Path
    frames: tuple[Frame, ...]

    @property
    def manifest(self) -> Path:
        """Where the rows stand."""
        return self.folder / "manifest.csv"


def read_dataset(folder: str | Path) -> Dataset:
    """The data set in a folder. Raises `InputError` that names the row of the manifest and what is wrong with it."""
    folder = Path(folder)
    manifest = folder / "manifest.csv"
    if not manifest.is_file():
        raise InputError(f"{folder}: no manifest.csv there, a data set has one with columns {', '.join(COLUMNS)}")
    try:
        with manifest.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise InputError(f"{manifest}: no column {missing[0]!r}, expected {', '.join(COLUMNS)}")
            frames = tuple(_frame(row, folder, f"{manifest}, line {reader.line_num}") for row in reader)
    except UnicodeDecodeError as error:
        raise InputError(f"{manifest}: not a text file in UTF-8 ({error.reason})") from None
    if not frames:
        raise InputError(f"{manifest}: no rows, a data set needs at least one micrograph")
    seen: dict[tuple[str, float], Path] = {}
    for frame in frames:
        other = seen.setdefault((frame.replicate, frame.hours), frame.path)
        if other is not frame.path:
            raise InputError(
                f"{manifest}: replicate {frame.replicate} at {frame.hours:g} hours stands twice, "
                f"{other.name} and {frame.path.name}"
            )
    return Dataset(folder, frames)


def _frame(row: dict[str, str | None], folder: Path, where: str) -> Frame:
    """One checked row."""
    file, replicate = ((row[name] or "").strip() for name in ("file", "replicate"))
    if not file or not replicate:
        raise InputError(f"{where}: {'file' if not file else 'replicate'} is empty")
    path = folder / file
    if not path.is_file():
        raise InputError(f"{where}: there is no file {file}")
    hours = _number(row["hours"], "hours", where)
    size = (row["um_per_pixel"] or "").strip()
    pixel_size = _number(size, "um_per_pixel", where) if size else None
    return Frame(path, replicate, hours, pixel_size)


def _number(text: str | None, name: str, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{where}: {name} is {text!r}, it must be a number above 0")
    return value
