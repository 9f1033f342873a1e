"""Find the images to measure, of a data set, of folders or given one by one, and give each a name of its own."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import Dataset, dataset_folder, read_dataset
from yeastfit.measure.reading.segmentation_options import AUTOMATIC, SegmentationOptions
from yeastfit.numbers import PIXEL_SIZES
from yeastfit.results.contents import Contents
from yeastfit.text import file_name, natural_order, shown

SUFFIXES = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".czi", ".nd2", ".lif")
FORMULA = ("=", "+", "-", "@")  # what a spreadsheet takes for a formula begins so


@dataclass(frozen=True)
class InputImage:
    """One image to measure.

    Attributes:
        path: The file.
        label: What tables call it: its path, shown as `yeastfit.text.shown` does, with "./" before what a spreadsheet
            would take for a formula.
        name: Of its mask and overlay, without suffix; a name for a file on any system.
        pixel_size: In µm; None where the file states it.
        options: How to outline it.
        condition: Empty outside a data set.
        replicate: Likewise.
        hours: None outside a data set.
        outline: A file with its outline, made elsewhere.
        frame: Of a time lapse or a z-stack, from 1 on; None where there is one.
        side: Longer side of its thumbnail in pixels.
    """

    path: Path
    label: str
    name: str
    pixel_size: float | None = None
    options: SegmentationOptions = AUTOMATIC
    condition: str = ""
    replicate: str = ""
    hours: float | None = None
    outline: Path | None = None
    frame: int | None = None
    side: int = 480

    @property
    def files(self) -> list[Path]:
        """The image, and the file with its outline where there is one."""
        return [self.path, *([self.outline] if self.outline else [])]


def find_images(
    paths: Sequence[Path], pixel_size: float | None = None, options: SegmentationOptions = AUTOMATIC
) -> tuple[list[InputImage], Dataset | None, list[Path]]:
    """Find the images that paths mean.

    Arguments:
        paths: One data set (its folder or manifest), or images and folders of images.
        pixel_size: In µm, for images of which no manifest says it.
        options: How to outline images of which no manifest says it.

    Returns:
        The images, the data set they come from, and files of folders that are no images by their names, or
        links to others.

    Raises:
        InputError: A path does not exist or is the folder of a command's results, a data set is given beside other
            things, a file is given twice, there is no image, or the pixel size is not from 1 nm to 1 mm.
    """
    if pixel_size is not None:
        PIXEL_SIZES.read(pixel_size, "pixel_size")
    for path in paths:
        if not os.path.lexists(path):
            raise InputError(f"{path}: there is no such file or folder, need micrographs or a data set")
    found = [folder for path in paths if (folder := dataset_folder(path))]
    if found and len(paths) > 1:
        raise InputError(f"{found[0]}: is a data set, measure it by itself and not beside others")
    if found:
        dataset = read_dataset(found[0])
        return dataset_images(dataset, pixel_size, options), dataset, []
    files: list[Path] = []
    skipped: list[Path] = []
    for path in paths:
        chosen, other = _photographs(path) if path.is_dir() else ([path], [])
        files += chosen
        skipped += other
    if not files:
        raise InputError(f"{paths[0]}: no manifest and no image there, need {', '.join(SUFFIXES)} files")
    labels = _labels(files)
    return (
        _with_names([InputImage(f, label, "", pixel_size, options) for f, label in zip(files, labels, strict=True)]),
        None,
        skipped,
    )


def dataset_images(
    dataset: Dataset, pixel_size: float | None = None, options: SegmentationOptions = AUTOMATIC
) -> list[InputImage]:
    """All images of a data set; `pixel_size` and `options` are for those of which the manifest does not say it.

    Raises:
        InputError: Of an image all objects would be measured and one of them.
    """
    images = [
        InputImage(
            frame.path,
            _label(Path(os.path.relpath(frame.path, dataset.folder)).as_posix()),
            "",
            frame.pixel_size or pixel_size,
            replace(options, **frame.options.as_arguments()),
            frame.condition,
            frame.replicate,
            frame.hours,
            frame.outline,
        )
        for frame in dataset.frames
    ]
    for image in images:
        image.options.check_colonies(f"{image.path}: ")
    return _with_names(images)


def images_in(folder: Path) -> tuple[list[Path], list[Path]]:
    """Images of a folder, by their suffix, and its other files. Numbers in names count; hidden files do not.

    Raises:
        InputError: There is no such folder, or no image in it.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder, need one with images")
    images, other = _images(folder)
    if not images:
        raise InputError(f"{folder}: no image there, need {', '.join(SUFFIXES)} files")
    return images, other


def _photographs(folder: Path) -> tuple[list[Path], list[Path]]:
    """`_images` of a folder that is no command's results, whose plots are no micrographs.

    Raises:
        InputError: It is.
    """
    command = Contents.of(folder).command
    if command:
        raise InputError(f"{folder}: holds results of yeastfit {command}, need micrographs or a data set")
    return _images(folder)


def _images(folder: Path) -> tuple[list[Path], list[Path]]:
    """Images, and what else there is: links to images of the same folder, too."""
    inside = sorted(
        (path for path in folder.iterdir() if path.name[0] != "."), key=lambda path: natural_order(path.name)
    )
    images = [path for path in inside if path.suffix.lower() in SUFFIXES]
    files = {os.path.realpath(path) for path in images if not path.is_symlink()}
    images = [path for path in images if not (path.is_symlink() and os.path.realpath(path) in files)]
    return images, [path for path in inside if path not in images]


def in_tables(path: str) -> str:
    """A path for a table, with "./" before what a spreadsheet would take for a formula."""
    return f"./{path}" if path.startswith(FORMULA) else path


def _file_at(place: str) -> tuple[int, int] | str:
    """What two names of one file share."""
    try:
        found = os.stat(place)
    except OSError:
        return place
    return (found.st_dev, found.st_ino) if found.st_ino else place


def _label(path: str) -> str:
    return shown(in_tables(path))


def _labels(files: Sequence[Path]) -> list[str]:
    """Names of the files, with folders where two share a name."""
    names = [_label(path.name) for path in files]
    return names if len(set(names)) == len(names) else [_label(path.as_posix()) for path in files]


def _with_names(images: list[InputImage]) -> list[InputImage]:
    """Give images different names, and thumbnails small enough for a page of all of them."""
    places = [os.path.realpath(image.path) for image in images]
    first: dict[tuple[int, int] | str, InputImage] = {}
    for image, place in zip(images, places, strict=True):
        if (other := first.setdefault(_file_at(place), image)) is not image:
            also = "" if other.path == image.path else f", it is {other.path.name}, too"
            raise InputError(f"{image.path}: is given twice{also}, each image is measured once")
    folder = os.path.commonpath([os.path.dirname(place) for place in places])
    inside = [Path(place).relative_to(folder) for place in places]
    choices: list[list[str]] = [
        [file_name(image.path.stem) for image in images],
        [file_name(image.path.name) for image in images],
        [file_name("_".join(path.parts)) for path in inside],
        [f"{k:04}_{file_name(image.path.stem)}" for k, image in enumerate(images, 1)],
    ]
    names = next(names for names in choices if len({name.casefold() for name in names}) == len(names))
    side = max(120, min(1000, round(4800 / len(images) ** 0.5)))
    return [replace(image, name=name, side=side) for image, name in zip(images, names, strict=True)]
