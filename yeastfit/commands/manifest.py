"""`yeastfit manifest`: make a data set of a folder of images from the names of its files."""

import csv
import os
import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from yeastfit.commands.console.signals import remaining
from yeastfit.commands.console.terminal import out, warn
from yeastfit.commands.options import folder_option
from yeastfit.errors import InputError, PixelSizeError
from yeastfit.measure.reading.batch_inputs import images_in, in_tables
from yeastfit.measure.reading.dataset import MANIFESTS, find_manifest, read_dataset
from yeastfit.measure.reading.file_names import NamedImage, NamePattern, named_images, pixel_sizes_of
from yeastfit.measure.reading.images import read_micrograph
from yeastfit.numbers import HOURS, PIXEL_SIZES
from yeastfit.storage import written_whole
from yeastfit.text import quoted, shown

COLUMNS = ("file", "replicate", "hours", "um_per_pixel", "condition")


def manifest(
    folder: Annotated[Path, typer.Argument(help="Folder of images.", show_default=False)],
    pattern: Annotated[
        str,
        typer.Option(
            help="How the images are named, without .tif and the like: {condition} is any text, {replicate} letters "
            "and digits, {hours} a number, {objective} a word, {} any text that means nothing. Example: "
            '"{condition} s{replicate} {hours}h {objective}" for "AWRI 796 500um s10 121h 4X binary.tif".',
            show_default=False,
        ),
    ],
    pixel_size: Annotated[
        list[str] | None,
        typer.Option(
            help="Size of a pixel in µm: of all images, 1.55, or of an objective, 4X=1.55; repeat it for further "
            "objectives. Without it, the files have to state it.",
            show_default=False,
        ),
    ] = None,
    hours: Annotated[
        float | None,
        typer.Option(help="Hours since the colonies were one cell, where names do not say it.", show_default=False),
    ] = None,
    to: Annotated[
        Path | None,
        folder_option("Folder for manifest.csv; by default that of the images.", show_default=False),
    ] = None,
) -> None:
    """Write manifest.csv for a folder of images, from the names of its files.

    Shows what was understood. A name that does not match, or that can be read in two ways, ends the command, and
    nothing is written; nor is a manifest that is there replaced.
    """
    place = to or folder
    if found := find_manifest(place):
        raise InputError(
            f"{found}: is there already and is not replaced: move it away, or give another folder by --out"
        )
    files, skipped = images_in(folder)
    for path in files:
        if not path.exists():
            raise InputError(f"{path}: is a link to nowhere: remove it, or move it away")
        if path.is_dir():
            raise InputError(f"{path}: is a folder with the name of an image: rename it, or move it away")
        if path.name.encode(errors="replace").decode() != path.name:
            raise InputError(f"{path}: its name is not UTF-8, so no manifest can name it: rename it, or move it away")
        if path.name != path.name.strip():
            raise InputError(
                f"{quoted(path.name)}: begins or ends with a blank, which no manifest keeps: rename it, or move it away"
            )
    if hours is not None:
        HOURS.read(hours, "--hours")
    images = named_images(files, NamePattern.of(pattern), hours)
    with remaining(f"no {MANIFESTS[0]} is written"):
        sizes = pixel_sizes_of(images, _sizes(pixel_size or []))
        out.print(_understood(images, sizes))
        _write(place / MANIFESTS[0], images, sizes)
    if rest := sorted({image.rest.strip(" _-") for image in images if image.rest}):
        out.print(f"Not read, at the end of names: {', '.join(map(shown, rest[:5]))}{' …' if len(rest) > 5 else ''}")
    if skipped:
        warn([f"passed over, no images by their names: {', '.join(path.name for path in skipped)}"])
    count = "1 image" if len(images) == 1 else f"{len(images)} images"
    following = f"yeastfit measure {shlex.quote(str(place))} --out out/measured"
    out.print(f"{count} in {place / MANIFESTS[0]}. Next: {following}", soft_wrap=True)  # a command is copied whole


def _sizes(given: list[str]) -> dict[str, float]:
    """Sizes of pixels by objective, "" for all."""
    sizes: dict[str, float] = {}
    for text in given:
        objective, sign, number = text.rpartition("=")
        if sign and (not objective or "=" in objective):
            raise InputError(f"--pixel-size is {quoted(text)}, it must be a number, or like 4X=1.55 for one objective")
        if objective in sizes:
            raise InputError(f"--pixel-size: {quoted(text)} is the second for {quoted(objective) or 'all images'}")
        sizes[objective] = PIXEL_SIZES.read(number, f"--pixel-size {quoted(text)}:")
    if "" in sizes and len(sizes) > 1:
        raise InputError("--pixel-size: give one size for all images, or one for each objective")
    return sizes


def _write(path: Path, images: list[NamedImage], sizes: list[float | None]) -> None:
    """Write the manifest, and take it away again unless it can be read."""
    made = [one for one in (path.parent, *path.parent.parents) if not one.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    place = os.path.realpath(path.parent)
    try:
        with written_whole(path) as whole, whole.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            for image, size in zip(images, sizes, strict=True):
                folder = os.path.relpath(os.path.realpath(image.path.parent), place)
                name = Path(folder, image.path.name).as_posix()
                written = "" if size is None else f"{size:.15g}"
                table.writerow([in_tables(name), image.replicate, f"{image.hours:.15g}", written, image.condition])
        read_dataset(path.parent)
    except BaseException:  # a full disk and Ctrl-C among others
        path.unlink(missing_ok=True)
        for one in made:
            one.rmdir()
        raise


def _understood(images: list[NamedImage], sizes: list[float | None]) -> Table:
    """A row for each condition and size of pixels."""
    table = Table("condition", "objective", "µm per pixel", "replicates", "hours", "images")
    groups: dict[tuple[str, str, float | None], list[NamedImage]] = {}
    for image, size in zip(images, sizes, strict=True):
        groups.setdefault((image.condition, image.objective, size), []).append(image)
    for (condition, objective, size), members in groups.items():
        replicates = list(dict.fromkeys(image.replicate for image in members))
        times = sorted({image.hours for image in members})
        table.add_row(
            condition or "—",
            objective or "—",
            _stated(members[0].path) if size is None else f"{size:g}",
            _listed(replicates),
            _listed([f"{time:g}" for time in times]),
            str(len(members)),
        )
    return table


def _stated(path: Path) -> str:
    """What the first of some files states; a warning where that is nothing."""
    try:
        return f"{read_micrograph(path).pixel_size:g} in the first file"
    except PixelSizeError:
        warn([f"{path.name} states no size of its pixels: give --pixel-size, here or to `yeastfit measure`"])
        return "none in the files"
    except InputError as error:  # `measure` says so, too, for every file
        warn([str(error)])
        return "?"


def _listed(texts: list[str]) -> str:
    return ", ".join(texts) if len(texts) <= 12 else f"{', '.join(texts[:10])}, … {texts[-1]} ({len(texts)})"
