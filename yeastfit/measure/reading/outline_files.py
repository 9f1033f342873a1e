"""Outlines made elsewhere: label images, ImageJ's regions of interest, and cellpose's _seg.npy.

Of several objects, that at the seed point counts, else the largest. A _seg.npy is a pickle, which can run any program
when it is opened; it is read by an unpickler that knows arrays, numbers and texts only, and refuses everything else.
"""

import io
import pickle
import pickletools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Shaped

from yeastfit.errors import InputError
from yeastfit.measure.reading.binary_images import recognise_binary, recognise_labels
from yeastfit.measure.reading.images import MAX_PIXELS, SeveralImages, read_labels

MAX_BYTES = 8 * MAX_PIXELS
FEWEST = 5  # px of a mask: the perimeter of fewer is that of no outline
AREAS = {"polygon", "freehand", "traced", "rect", "oval"}  # ImageJ's selections that enclose something
EDGES = 1000  # of a region that are filled together, which bounds memory
HARMLESS = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core") for name in ("_reconstruct", "scalar")),
    ("_codecs", "encode"),
}

Labels = npt.NDArray[Any]


def read_outline(
    path: Path, shape: tuple[int, int], seed_point: Sequence[float] | None = None
) -> Bool[np.ndarray, "row column"]:
    """Read the outline of one colony.

    Arguments:
        path: A mask or a label image (TIFF, PNG), an ImageJ .roi or .zip of them, or a .npy of cellpose.
        shape: Rows and columns of its photograph.
        seed_point: x and y in pixels of the colony, where there are several objects.

    Returns:
        True on the colony.

    Raises:
        InputError: The file cannot be read, is of another size, or holds no object, or none at the seed point.
    """
    mask = _region(path, shape, seed_point) if _holds_regions(path) else _object(_labels(path, shape), seed_point, path)
    check_outline(mask, str(path))
    return mask


def _holds_regions(path: Path) -> bool:
    return path.suffix.lower() in (".roi", ".zip")


def _labels(path: Path, shape: tuple[int, int]) -> Labels:
    """Values of a mask or of labels, of the size of their photograph; `InputError` where they are of another."""
    try:
        labels = _array(path) if path.suffix.lower() == ".npy" else read_labels(path)
    except SeveralImages:
        raise InputError(f"{path}: holds several pages or planes, need an outline of one image") from None
    if labels.shape != shape:
        raise InputError(
            f"{path}: an outline of {labels.shape[1]} x {labels.shape[0]} pixels, need {shape[1]} x {shape[0]} as its "
            "photograph has"
        )
    if labels.min() < 0:
        raise InputError(f"{path}: a label is {labels.min()}, labels must be whole numbers from 0 on")
    return labels


def check_outline(mask: Bool[np.ndarray, "row column"], name: str) -> None:
    """Raise `InputError` where an outline that was made elsewhere is too small to be measured."""
    if (size := int(mask.sum())) < FEWEST:
        raise InputError(f"{name}: the colony of the mask has {size} pixels, need at least {FEWEST} to measure a shape")


def write_mask(path: Path, mask: np.ndarray, pixel_size: float | None = None) -> None:
    """A mask as a one-bit PNG, colony white, with its resolution where µm per pixel are given."""
    from PIL import Image

    density: dict[str, Any] = {} if pixel_size is None else {"dpi": (25_400 / pixel_size, 25_400 / pixel_size)}
    Image.fromarray(mask).save(path, optimize=True, **density)


def _object(image: Labels, seed_point: Sequence[float] | None, path: Path) -> Bool[np.ndarray, "row column"]:
    """Of a mask, which lossy compression may have touched, or of a label image; `InputError` for others.

    An array of a .npy holds labels, even where there is one only: 0 is none. Of truth values that is not known.
    """
    if path.suffix.lower() == ".npy":
        return object_in(image, seed_point, path, None if image.dtype == bool or image.min() > 0 else 0)
    binary = recognise_binary(image)
    if binary is not None:
        return object_in(binary.mask.astype(np.uint8) if binary.doubts else image, seed_point, path)
    if len(np.unique(image)) > 1 and recognise_labels(image - image.min()) is None:
        raise InputError(
            f"{path}: neither black and white nor a label image, as a photograph or an outline with soft edges: need "
            "one value for each object"
        )
    return object_in(image, seed_point, path)


def background_of(labels: Labels) -> Any:
    """The value of most of the corners; of several labels 0 where there is one, as it is no label."""
    if labels.min() == 0 and len(np.unique(labels)) > 2:
        return labels.dtype.type(0)
    corners = [labels[row, column] for row in (0, -1) for column in (0, -1)]
    values, counts = np.unique(corners, return_counts=True)
    return values[counts == counts.max()].min()


def object_in(
    labels: Labels, seed_point: Sequence[float] | None, path: Path, background: int | None = None
) -> Bool[np.ndarray, "row column"]:
    """The object of a label image at the seed point, else the largest; each value but the background's is one.

    Arguments:
        labels: A value for each object.
        seed_point: x and y in pixels.
        path: Of the file, for messages.
        background: Its value; by default `background_of` the image.

    Raises:
        InputError: There is none, or none at the seed point.
    """
    values, counts = np.unique(labels, return_counts=True)
    others = values != (background_of(labels) if background is None else background)
    values, counts = values[others], counts[others]
    if not len(values):
        raise _nothing_in(path)
    if seed_point is None:
        return np.asarray(labels == values[counts.argmax()])
    row, column = pixel_at(seed_point, labels.shape)
    value = labels[row, column]
    if value not in values:
        raise _none_there(path, seed_point, len(values))
    return np.asarray(labels == value)


def pixel_at(seed_point: Sequence[float], shape: tuple[int, ...]) -> tuple[int, int]:
    """Row and column of the pixel; of a point in the outer half of the last one that pixel."""
    column, row = (round(value) for value in seed_point)
    return min(row, shape[0] - 1), min(column, shape[1] - 1)


def _nothing_in(path: Path) -> InputError:
    return InputError(f"{path}: holds no object, need the outline of a colony")


def _none_there(path: Path, seed_point: Sequence[float], count: int) -> InputError:
    column, row = (round(value) for value in seed_point)
    return InputError(f"{path}: no object at seed_point {column}, {row}, need a pixel of one of its {count}")


def _region(path: Path, shape: tuple[int, int], seed_point: Sequence[float] | None) -> Bool[np.ndarray, "row column"]:
    """The region of interest at the seed point, else the largest, filled; those that hold no pixel are left out."""
    try:
        import roifile
    except ImportError as error:
        raise InputError(f"{path}: roifile is not installed ({error}): pip install 'yeastfit[outlines]'") from error

    try:
        if path.suffix.lower() == ".roi" and _is_cut_off(path.read_bytes()):
            raise ValueError("it is cut off")
        read = roifile.roiread(path)
        regions = read if isinstance(read, list) else [read]
        each = [list(one.coordinates(multi=True)) for one in regions]
    except Exception as error:  # a damaged file makes readers raise anything at all
        raise InputError(f"{path}: cannot be read as ImageJ's regions ({error}), need a .roi or a .zip") from error
    lines = sorted({one.roitype.name.lower() for one in regions} - AREAS)
    if lines:
        raise InputError(
            f"{path}: holds a selection that is no area ({', '.join(lines)}), need {', '.join(sorted(AREAS))}"
        )
    if not all(np.isfinite(one).all() for paths in each for one in paths):
        raise InputError(f"{path}: a corner of a selection is no finite number, need pixels")
    count, largest, best = 0, 0, np.zeros(shape, dtype=bool)
    for paths in each:
        filled = _filled(paths, shape)
        size = int(filled.sum())
        count += size > 0
        if seed_point is not None and filled[pixel_at(seed_point, shape)]:
            return filled
        if size > largest:
            largest, best = size, filled
    if not count:
        raise _nothing_in(path)
    if seed_point is not None:
        raise _none_there(path, seed_point, count)
    return best


def _filled(paths: Sequence[Shaped[np.ndarray, "corner 2"]], shape: tuple[int, int]) -> Bool[np.ndarray, "row column"]:
    """Pixels whose centres lie inside: an odd number of edges cross their row to the left of them. Paths may be holes.

    Edges take their own rows only, so that an outline of a hundred thousand corners is no burden.
    """
    whole = [np.asarray(path, dtype=float) - 0.5 for path in paths if len(path) > 2]
    edges = np.concatenate([np.column_stack([path, np.roll(path, -1, axis=0)]) for path in whole] or [np.zeros((0, 4))])
    crossings = np.zeros((shape[0], shape[1] + 1), dtype=np.int32)
    for some in np.array_split(edges, len(edges) // EDGES + 1):
        x, y, to_x, to_y = some.T
        first, end = (np.clip(np.ceil(choose(y, to_y)), 0, shape[0]).astype(int) for choose in (np.minimum, np.maximum))
        edge = np.repeat(np.arange(len(some)), end - first)
        row = np.arange(len(edge)) - np.repeat(np.cumsum(end - first) - end, end - first)
        at = x[edge] + (row - y[edge]) * (to_x - x)[edge] / (to_y - y)[edge]
        np.add.at(crossings, (row, np.clip(np.ceil(at), 0, shape[1]).astype(int)), 1)
    return np.asarray(np.cumsum(crossings, axis=1)[:, :-1] % 2 == 1)


def _is_cut_off(roi: bytes) -> bool:
    """Whether the second header of an ImageJ region, of 64 bytes behind its corners, is not all there."""
    second = int.from_bytes(roi[60:64], "big")
    return len(roi) < 64 or (second > 0 and second + 64 > len(roi))


def _array(path: Path) -> Labels:
    """Labels of a .npy: an array, or the `masks` of cellpose's dictionary."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: more than {MAX_BYTES / 1e6:.0f} MB, need a smaller one")
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            if header(file)[2] != np.dtype(object):
                found: Any = np.load(path, allow_pickle=False)
            else:
                found = _unpickled(file.read())
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{path}: cannot be read ({error}), need labels as an array, or a _seg.npy") from error
    found = found.item() if isinstance(found, np.ndarray) and found.dtype == object and found.size == 1 else found
    labels = found.get("masks") if isinstance(found, dict) else found
    if not isinstance(labels, np.ndarray) or labels.ndim != 2 or labels.dtype.kind not in "bui":
        raise InputError(f"{path}: holds no flat array of labels, need one, or cellpose's dictionary with `masks`")
    return labels


def _unpickled(content: bytes) -> Any:
    """What a pickle holds, if it is harmless, and its places for objects are no more than its bytes."""
    for operation, argument, _ in pickletools.genops(content):
        if operation.name.endswith("PUT") and isinstance(argument, int) and argument > len(content):
            raise pickle.UnpicklingError("it asks for more memory than it can fill")
    return _Unpickler(io.BytesIO(content)).load()


class _Unpickler(pickle.Unpickler):
    """Of arrays, numbers, texts, lists and dictionaries, and of nothing that could run a program."""

    def find_class(self, module: str, name: str) -> Any:
        """Refuse everything else."""
        if (module, name) not in HARMLESS:
            raise pickle.UnpicklingError(f"it holds {module}.{name}, which is not read: save the masks as PNG or TIFF")
        return super().find_class(module, name)
