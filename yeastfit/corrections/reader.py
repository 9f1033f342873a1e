"""Layers of napari from a folder of results, as tuples: nothing here needs napari.

A photograph is a layer of the image, and a layer of labels for its outline: 1 on the colony, 0 elsewhere. Both are
scaled to µm and carry, under `METADATA`, the folder, the number of the photograph, and what is doubtful about it.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.corrections.measured_folder import MeasuredFolder
from yeastfit.errors import InputError
from yeastfit.results.contents import Contents

METADATA = "yeastfit"
COLOURS = {1: "orange", None: "transparent"}  # of labels

LayerTuple = tuple[Any, dict[str, Any], str]


def reader_of(path: str | Sequence[str]) -> Callable[[str | Sequence[str]], list[LayerTuple]] | None:
    """What napari asks for a path that somebody opens.

    Arguments:
        path: A folder, or a measurements.csv in it.

    Returns:
        A function that reads it; None where it holds no results of `yeastfit measure`.
    """
    if not isinstance(path, str):
        return None
    place = Path(path)
    folder = place if place.is_dir() else place.parent
    return read_layers if Contents.of(folder).command == "measure" else None


def read_layers(path: str | Sequence[str]) -> list[LayerTuple]:
    """Layers of the first doubtful photograph of a folder, or of the first one."""
    folder = MeasuredFolder.of(str(path))
    return layers_of(folder, folder.next_doubtful() or 0)


def layers_of(folder: MeasuredFolder, number: int) -> list[LayerTuple]:
    """Make the layers of one photograph.

    Arguments:
        folder: With its results.
        number: Of the photograph.

    Returns:
        Of the image and of its outline: data, arguments and kind of each.

    Raises:
        InputError: The photograph or its outline cannot be read.
    """
    one = folder.photographs[number]
    about = {"folder": str(folder.path), "number": number, "doubts": one.remarks}
    place: dict[str, Any] = {"metadata": {METADATA: about}}
    if one.pixel_size is not None:
        place |= {"scale": (one.pixel_size, one.pixel_size), "units": ("µm", "µm")}
    outline = one.outline().astype(np.uint8)
    return [
        (one.pixels, {"name": one.image.label, **place}, "image"),
        (outline, {"name": f"outline of {one.image.label}", "opacity": 0.4, "colormap": COLOURS, **place}, "labels"),
    ]


def place_in(metadata: dict[str, Any]) -> tuple[MeasuredFolder, int] | None:
    """The folder and the number that a layer's metadata name; None for layers of anything else."""
    about = metadata.get(METADATA)
    if not isinstance(about, dict):
        return None
    try:
        return MeasuredFolder.of(about["folder"]), int(about["number"])
    except InputError:
        return None
