"""What may be wrong with an outline, by name and in words, and when each of these doubts is raised."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
import scipy

from yeastfit.measure.outlining.mask_operations import NEIGHBOURS, Field, Mask

BY_HAND = "corrected by hand"  # a remark among the doubts: somebody has looked
DOUBTS: dict[str, str] = {
    "several objects": "There is another object of more than a tenth of the colony's size: in a photograph only the "
    "largest is measured, in a ready-made mask all are together.",
    "touches the border": "The colony reaches the border of the image (or of the region looked at): part of it may be "
    "missing.",
    "cut off from an object at the border": "The colony touches an object at the border and was cut off from it at "
    "the narrowest place: check the cut.",
    "an object at the border is left out": "A larger object at the border was not taken for the colony.",
    "low contrast": "The colony is hardly darker than the noise: thin parts may be missing.",
    "saturated": "Many pixels are as dark or as bright as the file can say: what differed there is lost.",
    "uneven light": "The background is more than twice as bright at one place as at another: the fainter side is "
    "measured less well.",
    "blurred": "Edges are blurred by almost 2 pixels or more: gaps and thin filaments may be lost.",
    "tiny": "The colony has fewer than 100 pixels: its outline is coarse.",
    "nearly empty": "The colony fills less than a thousandth of the image: it may be a speck.",
    "fills the image": "The colony fills over four fifths of the image: little background is left to compare with.",
    BY_HAND: "The outline was given beside the photograph, not found in it.",
    "polarity unsure": "Both values of the mask lie along its border: dark and bright may be mistaken for each other.",
    "not quite black and white": "Nearly a mask, as lossy compression leaves it: cut at half of its range.",
}
TINY = 100  # px
EMPTY = 1e-3  # of the image
FULL = 0.8  # of the image
BLURRED = 1.8  # px; the measured blur ends at 2
PILED_UP = 0.01  # of the image, at the end of the scale
UNEVEN = 2.0  # brightest over darkest background


def to_be_checked(doubts: Iterable[str]) -> tuple[str, ...]:
    """Those of which somebody should check the outline."""
    return tuple(doubt for doubt in doubts if doubt != BY_HAND)


def doubts_of_mask(mask: Mask, visible: Mask) -> list[str]:
    """Names of what may be wrong with a mask, given where the image shows anything."""
    area, available = int(mask.sum()), int(visible.sum())
    edge = scipy.ndimage.binary_dilation(~visible, NEIGHBOURS)
    edge[[0, -1], :] = edge[:, [0, -1]] = True
    doubts = {
        "touches the border": bool((mask & edge).any()),
        "tiny": area < TINY,
        "nearly empty": area < EMPTY * available,
        "fills the image": area > FULL * available,
    }
    return [doubt for doubt, holds in doubts.items() if holds]


def doubts_of_photograph(
    image: Field, visible: Mask, background: Field, threshold: float, noise: float, blur: float
) -> list[str]:
    """Names of what may be wrong with a photograph; noise and threshold in grey levels, blur in px."""
    brightness = np.percentile(background[visible], [1, 99])
    doubts = {
        "low contrast": threshold < 2 * noise,
        "saturated": _piled_up(image[visible]),
        "uneven light": bool(brightness[1] > UNEVEN * max(brightness[0], 1e-6)),
        "blurred": blur > BLURRED,
    }
    return [doubt for doubt, holds in doubts.items() if holds]


def _piled_up(values: npt.NDArray[np.float32]) -> bool:
    """Whether many pixels hold the least or largest value that 8 to 16 bits, or a share, can have."""
    top = values.max()
    ends = [0.0] if values.min() == 0 else []
    ends += [float(top)] if top in (1, 255, 1023, 4095, 16383, 65535) else []
    return any(float((values == end).mean()) > PILED_UP for end in ends)
