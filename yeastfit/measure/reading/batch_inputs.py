"""Which files to measure, and under which names: a data set, single files, or all images of a folder."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import NOTHING, Dataset, dataset_folder, given, read_dataset
from yeastfit.measure.reading.segmentation_options import Overrule

SUFFIXES = (".tif", ".tiff", ".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class Task:
    """One file to measure.

    label: how tables call it. name: of its mask and overlay, without suffix. pixel_size in µm, None where the file says
    it. condition, replicate and hours are empty for a file outside a data set. side: of its thumbnail, px.
    """

    path: Path
    label: str
    name: str
    pixel_size: float | None = None
    overrule: Overrule = NOTHING
    condition: str = ""
    replicate: str = ""
    hours: float | None = None
    side: int = 480


def find_tasks(
    paths: Sequence[Path], pixel_size: float | None = None, overrule: Overrule = NOTHING
) -> tuple[list[Task], Dataset | None, list[Path]]:
    """What `paths` mean: tasks, the data set they come from, and files of folders that were passed over.

    paths: one data set (its folder or manifest), or images and folders of images. What the manifest says of an image
    stands; `pixel_size` and `overrule` are for the others. Raises `InputError` for paths that do not exist, a data set
    beside other things, files given twice, and folders without an image.
    """
    for path in paths:
        if not os.path.lexists(path):
            raise InputError(f"{path}: there is no such file or folder, need micrographs or a data set")
    found = [folder for path in paths if (folder := dataset_folder(path))]
    if found and len(paths) > 1:
        raise InputError(f"{found[0]}: is a data set, measure it by itself and not beside {len(paths) - 1} others")
    if found:
        dataset = read_dataset(found[0])
        return dataset_tasks(dataset, pixel_size, overrule), dataset, []
    files: list[Path] = []
    skipped: list[Path] = []
    for path in paths:
        chosen, other = _images(path) if path.is_dir() else ([path], [])
        files += chosen
        skipped += other
    if not files:
        raise InputError(f"{paths[0]}: no manifest and no image there, need {', '.join(SUFFIXES)} files")
    labels = _labels(files)
    return (
        _numbered([Task(f, label, "", pixel_size, overrule) for f, label in zip(files, labels, strict=True)]),
        None,
        skipped,
    )


def dataset_tasks(dataset: Dataset, pixel_size: float | None = None, overrule: Overrule = NOTHING) -> list[Task]:
    """All images of a data set."""
    tasks = [
        Task(
            frame.path,
            Path(os.path.relpath(frame.path, dataset.folder)).as_posix(),
            "",
            frame.pixel_size or pixel_size,
            replace(overrule, **given(frame.overrule)),
            frame.condition,
            frame.replicate,
            frame.hours,
        )
        for frame in dataset.frames
    ]
    return _numbered(tasks)


def _images(folder: Path) -> tuple[list[Path], list[Path]]:
    """Images of a folder by their suffix, numbers in names in counting order, and everything else but hidden files."""
    inside = sorted((path for path in folder.iterdir() if path.name[0] != "."), key=_counting)
    images = [path for path in inside if path.suffix.lower() in SUFFIXES]
    return images, [path for path in inside if path not in images]


def _counting(path: Path) -> list[str | int]:
    return [int(part) if k % 2 else part for k, part in enumerate(re.split(r"([0-9]+)", path.name))]


def _labels(files: Sequence[Path]) -> list[str]:
    """Names of the files, with folders where two share a name."""
    names = [path.name for path in files]
    return names if len(set(names)) == len(names) else [path.as_posix() for path in files]


def _numbered(tasks: list[Task]) -> list[Task]:
    """Tasks with a name of their own and thumbnails small enough for a page of all of them."""
    places = [os.path.realpath(task.path) for task in tasks]
    twice = next((task for k, task in enumerate(tasks) if places.index(places[k]) != k), None)
    if twice:
        raise InputError(f"{twice.path}: is given twice, each image is measured once")
    folder = os.path.commonpath([os.path.dirname(place) for place in places])
    inside = [Path(place).relative_to(folder) for place in places]
    choices: list[list[str]] = [
        [task.path.stem for task in tasks],
        [task.path.name for task in tasks],
        ["_".join(path.parts) for path in inside],
        [f"{k:04}_{task.path.stem}" for k, task in enumerate(tasks, 1)],
    ]
    names = next(names for names in choices if len({name.casefold() for name in names}) == len(names))
    side = max(120, min(1000, round(4800 / len(tasks) ** 0.5)))
    return [replace(task, name=name, side=side) for task, name in zip(tasks, names, strict=True)]
