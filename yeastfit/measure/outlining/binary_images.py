"""Ready-made masks: recognised, and told which of their two values is the colony."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool

from yeastfit.measure.outlining.mask_operations import Mask

UNSURE = (0.25, 0.75)  # share of the border's bright pixels between which polarity is unsure
LEVELS = 3  # grey levels around black and white that lossy compression may leave, of 255
NEARLY = 0.9  # share of pixels within them
BETWEEN = 0.01  # largest share of pixels in the middle half of the range


class ReadyMade(NamedTuple):
    """A mask as it came: colony pixels, the grey levels of colony and background, and doubts."""

    mask: Mask
    colony: float
    background: float
    doubts: list[str]


def ready_made(image: npt.NDArray[Any]) -> ReadyMade | None:
    """The mask that an image is, or None for a photograph.

    A mask has two values; or it has the full range of 8 or 16 bits, `NEARLY` all pixels at its ends and next to none
    between, as lossy compression leaves it. The background is the value along most of the border, of which only the
    stretches next to the corners count, a quarter of each side: a round colony that fills its image, or is cut by it,
    touches the middle of a side first.
    """
    low, high = float(image.min()), float(image.max())
    exact = bool(((image == image.min()) | (image == image.max())).all())
    if not exact and not _nearly_two_values(image, low, high):
        return None
    bright = image == image.max() if exact else image > (low + high) / 2
    share = float(_corners(bright).mean())
    doubts = [] if exact else ["not quite black and white"]
    doubts += ["polarity unsure"] if UNSURE[0] < share < UNSURE[1] else []
    if share >= 0.5:
        return ReadyMade(~bright, low, high, doubts)
    return ReadyMade(bright, high, low, doubts)


def _nearly_two_values(image: npt.NDArray[Any], low: float, high: float) -> bool:
    full = next((top for top in (255.0, 65535.0) if 0.97 * top <= high <= top), None)
    if full is None or low > 0.03 * full:
        return False
    ends = (image <= LEVELS / 255 * full) | (image >= (1 - LEVELS / 255) * full)
    between = (image > 0.25 * full) & (image < 0.75 * full)
    return bool(ends.mean() >= NEARLY and between.mean() <= BETWEEN)


def _corners(bright: Mask) -> Bool[np.ndarray, " pixel"]:
    """Border pixels within a quarter of a side from a corner."""
    rows, columns = (np.arange(size) for size in bright.shape)
    near_rows, near_columns = (np.minimum(at, at[::-1]) < max(1, at.size // 4) for at in (rows, columns))
    outer = np.zeros_like(bright)
    outer[0, near_columns] = outer[-1, near_columns] = True
    outer[near_rows, 0] = outer[near_rows, -1] = True
    return bright[outer]
