"""A data set: a folder of micrographs with a manifest that says what each one shows (docs/dataset.md).

`manifest.csv` has a row for each micrograph, `manifest.toml` a table `[[image]]`. Columns and keys are the same:

    file            path of the image, relative to the manifest
    replicate       name or number of the colony
    hours           time since the colony was one cell, in hours
    um_per_pixel    size of a pixel in µm; may be empty where the file itself says it
    condition       what the colony was grown in or of; optional
    seed_point      x and y of a pixel of the colony; optional, as are the next three: see `segment`
    threshold       contrast with the background, in grey levels, from which a pixel is colony
    roi             x0, y0, x1, y1: the part of the image to look at, in pixels
    colonies        "one" object of the image, or "all" that are no dust
    mask            an outline made elsewhere, relative to the manifest: a mask or label image, ImageJ's .roi or .zip,
                    cellpose's _seg.npy; optional
    note            a remark for people, not read; optional

Condition and replicate together identify a colony. At the top of `manifest.toml`, everything but the first three, the
mask and the note may be given once, for all images that do not say otherwise.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.segmentation_options import AUTOMATIC, SegmentationOptions, read_options
from yeastfit.numbers import HOURS, PIXEL_SIZES
from yeastfit.results.contents import check_finished
from yeastfit.text import quoted, short, shown
from yeastfit.text_files import check_look_alikes, instead_of_commas, read_csv, read_toml

MANIFESTS = ("manifest.csv", "manifest.toml")
NEEDED = ("file", "replicate", "hours")
SHARED = ("um_per_pixel", "condition", "seed_point", "threshold", "roi", "colonies")
KNOWN = (*NEEDED, *SHARED, "mask", "note")
LONGEST_NAME = 200  # characters of a condition or a replicate
COLUMNS = (*NEEDED, "um_per_pixel")  # which manifest.csv must have


@dataclass(frozen=True)
class Frame:
    """One row of a manifest: one colony at one time.

    Attributes:
        path: The image.
        replicate: Name of the colony, within its condition.
        hours: Since the colony was one cell.
        pixel_size: In µm; None where only the file may state it.
        condition: What the colony was grown in or of.
        options: How to outline it.
        outline: A file with its outline, made elsewhere; None where it is to be found.
    """

    path: Path
    replicate: str
    hours: float
    pixel_size: float | None
    condition: str = ""
    options: SegmentationOptions = AUTOMATIC
    outline: Path | None = None


@dataclass(frozen=True)
class Dataset:
    """A data set.

    Attributes:
        folder: Where the manifest lies.
        frames: In the manifest's order.
    """

    folder: Path
    frames: tuple[Frame, ...]

    @property
    def manifest(self) -> Path:
        """The file that lists the images."""
        return find_manifest(self.folder) or self.folder / MANIFESTS[0]

    @property
    def replicates(self) -> tuple[str, ...]:
        """Names of the colonies, sorted."""
        return tuple(sorted({frame.replicate for frame in self.frames}))

    @property
    def conditions(self) -> tuple[str, ...]:
        """The conditions, in the manifest's order."""
        return tuple(dict.fromkeys(frame.condition for frame in self.frames))

    def of(self, condition: str) -> "Dataset":
        """The data set of one condition alone; raises `InputError` where there is no image of it."""
        if condition not in self.conditions:
            raise InputError(
                f"condition: got {condition!r}, {self.manifest} has {', '.join(map(repr, self.conditions))}"
            )
        return replace(self, frames=tuple(frame for frame in self.frames if frame.condition == condition))


def find_manifest(folder: Path) -> Path | None:
    """The manifest in a folder, or None; raises `InputError` where there are two, or it is no file."""
    found = [folder / name for name in MANIFESTS if os.path.lexists(folder / name)]
    for path in found:
        if not _is_file(path):
            raise InputError(f"{path}: a folder, a pipe or a link to nowhere, need a file or none")
    if len(found) > 1:
        raise InputError(f"{folder}: holds {' and '.join(MANIFESTS)}, a data set has one of them")
    return found[0] if found else None


def dataset_folder(path: Path) -> Path | None:
    """The folder of the data set that a path means, itself or its manifest; None where it means no data set."""
    folder = path.parent if path.name in MANIFESTS else path
    return folder if folder.is_dir() and find_manifest(folder) else None


def read_dataset(folder: str | Path) -> Dataset:
    """Read the manifest of a data set.

    Arguments:
        folder: Where the manifest lies.

    Returns:
        The data set; images themselves are not read.

    Raises:
        InputError: A column or key is unknown, missing or empty, a file does not exist, a number is none, or a colony
            appears twice at one time. The message names the line or the image, the value and what would be right.
    """
    folder = Path(folder)
    check_finished(folder)
    manifest = find_manifest(folder)
    if manifest is None:
        raise InputError(f"{folder}: no manifest.csv or manifest.toml there, a data set has one: {', '.join(COLUMNS)}")
    rows = _csv_rows(manifest) if manifest.suffix == ".csv" else list(_toml_rows(manifest))
    if not rows:
        raise InputError(f"{manifest}: no rows, a data set needs at least one micrograph")
    frames = tuple(_frame(row, folder, where) for where, row in rows)
    seen: dict[tuple[str, str, float], int] = {}
    for k, frame in enumerate(frames):
        first = seen.setdefault((frame.condition, frame.replicate, frame.hours), k)
        if first != k:
            condition = f" of condition {frame.condition!r}" if frame.condition else ""
            raise InputError(
                f"{rows[k][0]}: replicate {frame.replicate}{condition} at {frame.hours:g} hours appears twice, as "
                f"{frame.path.name} here and as {frames[first].path.name} in {rows[first][0].rpartition(', ')[2]}: a "
                "colony has one image at one time"
            )
    check_look_alikes((frame.condition for frame in frames), f"{manifest}: conditions")
    check_look_alikes((frame.replicate for frame in frames), f"{manifest}: replicates")
    return Dataset(folder, frames)


def _csv_rows(manifest: Path) -> list[tuple[str, dict[str, str]]]:
    """The place of each row in the file, and its cells by column, without empty ones."""
    return read_csv(manifest, lambda names: _check_columns(names, manifest))[1]


def _check_columns(names: list[str], manifest: Path) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        expected = f"{', '.join(COLUMNS)}{instead_of_commas(names)}"
        raise InputError(f"{manifest}: no column {missing[0]!r}, expected {expected}")
    _check_names(names, KNOWN, f"{manifest}, line 1: column")


def _check_names(names: list[str], known: tuple[str, ...], where: str) -> None:
    for name in names:
        if name not in known:
            close = get_close_matches(name.lower().replace(" ", "_"), known, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(known)}"
            raise InputError(f"{where} {quoted(name)} is unknown, {hint}")


def _toml_rows(manifest: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """The place of each image in the file, and its values by key, with those that all images share."""
    content = read_toml(manifest)
    images = content.pop("image", [])
    _check_names(list(content), SHARED, f"{manifest}, at the top: key")
    _optional(content, f"{manifest}, at the top")
    if not isinstance(images, list):
        raise InputError(f"{manifest}: image is {quoted(images)}, write a table [[image]] for each micrograph")
    for number, image in enumerate(images, 1):
        where = f"{manifest}, image {number}"
        if not isinstance(image, dict):
            raise InputError(f"{where}: is {quoted(image)}, write a table [[image]] for each micrograph")
        where += f" ({short(image['file'])})" if isinstance(image.get("file"), str) else ""
        _check_names(list(image), KNOWN, f"{where}: key")
        row = {**content, **image}
        for name, range_ in (("hours", HOURS), ("um_per_pixel", PIXEL_SIZES)):
            if name in row:
                range_.check(row[name], f"{where}: {name}")
        yield where, row


def _frame(row: Mapping[str, Any], folder: Path, where: str) -> Frame:
    """A checked row."""
    file, replicate = (text_in(row, name, where) for name in ("file", "replicate"))
    if not file or not replicate:
        raise InputError(f"{where}: {'file' if not file else 'replicate'} is empty")
    path, mask = folder / file, text_in(row, "mask", where)
    for name in filter(None, (file, mask)):
        if not _is_file(folder / name):
            raise InputError(f"{where}: there is no file {short(name)}")
    hours = HOURS.read(row.get("hours", ""), f"{where}: hours")
    pixel_size, condition, options = _optional(row, where)
    return Frame(path, replicate, hours, pixel_size, condition, options, folder / mask if mask else None)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name longer than the file system takes
        return False


def _optional(row: Mapping[str, Any], where: str) -> tuple[float | None, str, SegmentationOptions]:
    """Checked values of `SHARED`."""
    size = PIXEL_SIZES.read(row["um_per_pixel"], f"{where}: um_per_pixel") if "um_per_pixel" in row else None
    return size, text_in(row, "condition", where), read_options(row, f"{where}: ")


def text_in(row: Mapping[str, Any], name: str, where: str) -> str:
    """What a row says as text, empty where it says nothing.

    Raises:
        InputError: It is no text of a manifest; the message begins with `where`.
    """
    value = row.get(name, "")
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(f"{where}: {name} is {quoted(value)}, it must be a text or a number")
    text = str(value).strip()
    if name not in ("file", "mask") and (shown(text) != text or len(text) > LONGEST_NAME):
        raise InputError(
            f"{where}: {name} is {quoted(text)}, it must be one line of at most {LONGEST_NAME} visible characters"
        )
    return text
