"""Recognise ready-made masks, and which of their two values is the colony."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool

Mask = Bool[np.ndarray, "row column"]
UNSURE = (0.25, 0.75)  # share of the border's bright pixels between which polarity is unsure
LEVELS = 3  # grey levels around black and white that lossy compression may leave, of 255
NEARLY = 0.9  # share of pixels within them
FLAT, MOST_LABELS = 0.3, 5000  # of a label's pixels, inside it; labels of an image
BETWEEN = 0.01  # largest share of pixels in the middle half of the range


class BinaryImage(NamedTuple):
    """A ready-made mask.

    Attributes:
        mask: Colony pixels.
        colony: Their grey level.
        background: That of all others.
        doubts: By name.
    """

    mask: Mask
    colony: float
    background: float
    doubts: list[str]


def recognise_binary(image: npt.NDArray[Any]) -> BinaryImage | None:
    """Recognise a ready-made mask; None for a photograph.

    A mask has two values; or it has the full range of 8 or 16 bits, `NEARLY` all pixels at its ends, of few grey levels
    each, and next to none between, as lossy compression leaves it. The background is the value along most of the
    border. Of that only a quarter of each side next to the corners counts, as a round colony that fills its image, or
    is cut by it, touches the middle of a side first.
    """
    low, high = float(image.min()), float(image.max())
    exact = bool(((image == image.min()) | (image == image.max())).all())
    if not exact and not _nearly_two_values(image, low, high):
        return None
    bright = image == image.max() if exact else image > (low + high) / 2
    share = float(_border_near_corners(bright).mean())
    doubts = [] if exact else ["not quite black and white"]
    doubts += ["polarity unsure"] if UNSURE[0] < share < UNSURE[1] else []
    if share >= 0.5:
        return BinaryImage(~bright, low, high, doubts)
    return BinaryImage(bright, high, low, doubts)


def _nearly_two_values(image: npt.NDArray[Any], low: float, high: float) -> bool:
    full = next((top for top in (255.0, 65535.0) if 0.97 * top <= high <= top), None)
    if full is None or low > 0.03 * full:
        return False
    ends = image <= LEVELS / 255 * full, image >= (1 - LEVELS / 255) * full
    between = (image > 0.25 * full) & (image < 0.75 * full)
    if ends[0].mean() + ends[1].mean() < NEARLY or between.mean() > BETWEEN:
        return False
    return all(_few_levels(image[end]) for end in ends)


def _few_levels(values: npt.NDArray[Any]) -> bool:
    """Whether `LEVELS` + 1 grey levels hold `NEARLY` all: in a dark photograph of 16 bits with hot pixels, none do."""
    counts = np.sort(np.unique(values, return_counts=True)[1])
    return bool(counts[-LEVELS - 1 :].sum() >= NEARLY * values.size)


def _border_near_corners(bright: Mask) -> Bool[np.ndarray, " pixel"]:
    """Border pixels within a quarter of a side from a corner."""
    rows, columns = (np.arange(size) for size in bright.shape)
    near_rows, near_columns = (np.minimum(at, at[::-1]) < max(1, at.size // 4) for at in (rows, columns))
    outer = np.zeros_like(bright)
    outer[0, near_columns] = outer[-1, near_columns] = True
    outer[near_rows, 0] = outer[near_rows, -1] = True
    return bright[outer]


def recognise_labels(image: npt.NDArray[Any]) -> npt.NDArray[np.int64] | None:
    """Recognise a label image of three values or more, as cellpose, napari and ilastik write them; None for others.

    Values are whole numbers from 0 or 1 on. Nearly every one of them fills areas: `FLAT` of its pixels have four
    neighbours of the same value; or it is a speck by itself, beside no value but the most frequent one. Neither noise
    nor the blurred edge of a photograph is like that.
    """
    if not 0 <= image.min() <= 1 or not (image == np.rint(image)).all():
        return None
    labels = image.astype(np.int64)
    values, inverse, counts = np.unique(labels, return_inverse=True, return_counts=True)
    if not 3 <= len(values) <= MOST_LABELS:
        return None
    inner = np.zeros(labels.shape, dtype=bool)
    middle = labels[1:-1, 1:-1]
    around = (labels[:-2, 1:-1], labels[2:, 1:-1], labels[1:-1, :-2], labels[1:-1, 2:])
    inner[1:-1, 1:-1] = np.logical_and.reduce([middle == one for one in around])
    numbers = inverse.reshape(labels.shape)
    flat = np.bincount(numbers.ravel(), weights=inner.ravel(), minlength=len(values)) / counts
    beside_others, ground = np.zeros(len(values), dtype=bool), counts.argmax()
    for one, other in ((numbers[:-1], numbers[1:]), (numbers[:, :-1], numbers[:, 1:])):
        meet = (one != other) & (one != ground) & (other != ground)
        beside_others[one[meet]] = beside_others[other[meet]] = True
    return labels if np.mean((flat >= FLAT) | ~beside_others) >= NEARLY else None
