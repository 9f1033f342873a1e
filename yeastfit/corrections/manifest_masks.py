"""Name an outline in the manifest of a data set; everything else in it stays as it is."""

import codecs
import csv
import os
from io import StringIO
from pathlib import Path
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import read_dataset
from yeastfit.storage import written_whole
from yeastfit.text_files import read_text


def name_mask(manifest: Path, photograph: Path, mask: str) -> None:
    """Write the name of an outline into a manifest, for one photograph.

    Comments, order, line ends and all other values are kept. The manifest is replaced as a whole, and only by one that
    can be read.

    Arguments:
        manifest: A manifest.csv or manifest.toml.
        photograph: One of its images.
        mask: Path of the outline, relative to the manifest.

    Raises:
        InputError: The photograph is not in the manifest, or that cannot be read or written.
    """
    text, before = read_text(manifest), manifest.read_bytes()
    edited = (_csv if manifest.suffix == ".csv" else _toml)(text, manifest, photograph, mask)
    mark = codecs.BOM_UTF8 if before.startswith(codecs.BOM_UTF8) else b""
    _replace(manifest, mark + edited.encode("utf-8"))
    try:
        read_dataset(manifest.parent)
    except InputError:
        _replace(manifest, before)
        raise


def _csv(text: str, manifest: Path, photograph: Path, mask: str) -> str:
    """The text with the column `mask`, which is added at the end of all rows where there is none."""
    rows = list(csv.reader(StringIO(text, newline=""), strict=True))
    names = [name.strip() for name in rows[0]]
    if "mask" not in names:
        rows[0].append("mask")
        names.append("mask")
    file, column = names.index("file"), names.index("mask")
    found = [row for row in rows[1:] if len(row) > file and _same(manifest.parent / row[file].strip(), photograph)]
    for row in rows[1:]:
        row += [""] * (len(names) - len(row)) if any(row) else []
    for row in found or _missing(manifest, photograph):
        row[column] = mask
    written = StringIO(newline="")
    csv.writer(written, lineterminator="\r\n" if "\r\n" in text else "\n").writerows(rows)
    return written.getvalue()


def _toml(text: str, manifest: Path, photograph: Path, mask: str) -> str:
    """The text with the key `mask` in the table of the image."""
    try:
        import tomlkit
    except ImportError as error:
        raise InputError(
            f"{manifest}: tomlkit is not installed ({error}), which keeps its comments: pip install 'yeastfit[napari]'"
        ) from error

    content = tomlkit.parse(text)
    images: list[Any] = content.get("image", [])
    found = [image for image in images if _same(manifest.parent / str(image.get("file", "")), photograph)]
    for image in found or _missing(manifest, photograph):
        image["mask"] = mask
    return tomlkit.dumps(content)


def _missing(manifest: Path, photograph: Path) -> list[Any]:
    raise InputError(f"{manifest}: has no row of {photograph}, which was measured: measure the data set again")


def _same(one: Path, other: Path) -> bool:
    return os.path.realpath(one) == os.path.realpath(other)


def _replace(file: Path, data: bytes) -> None:
    with written_whole(file) as temporary:
        temporary.write_bytes(data)
