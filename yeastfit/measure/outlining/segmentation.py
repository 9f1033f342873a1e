"""The colony in a photograph.

How `segment` works, in grey levels, for a bright-field photograph I (colony darker than its background):

    light       L = b(y) + a(x), steps of whole rows and columns, plus a polynomial of degree 4, fitted by least squares
                to the background, plus the background's mean residual within 5 %, then 1.5 %, of the image's longer
                side. Background is what no edge parts from the border and from a first polynomial, fitted by iterated
                one-sided clipping: a shadow's slope is below 0.4 % of L per pixel, a colony's edge above it
    contrast    D = L - I, with noise σ from the second differences of I (kernel of Immerkær 1996,
                doi:10.1006/cviu.1996.0060)
    coarse      the object: where D, smoothed by 0.8 px, exceeds 4 of its own deviations
    rim         c(x) = mean of D over colony pixels 2.5 - 5 px inside the boundary, averaged over about 8 px around x:
                what "wholly colony" looks like here, faint on a filament, dark on the core
    fine        D / c = h * φ + noise with φ the indicator of the colony and h a Gaussian blur, so
                φ = argmin over 0 <= φ <= 1 of ½ |h * φ - min(D / c, 1.1)|² + ½ λ |∇φ|²,   mask = {φ > ½}

For a straight edge the last line is a threshold at half the contrast of the rim, which moves no edge. For a small cell
it also undoes what blur does to curvature: half-contrast alone loses about π s² pixels of area for an object seen
through blur s (6 % of a cell of 10 by 7 px at s = 1) and closes gaps between cells. The blur s comes from the steepest
slope of the colony's edges, c / (√(2π) max|∇D|), and λ = 6 ρ³ from the scatter ρ of D / c over the rim: 0.001 on a
clean drawing (ρ = 0.05), 0.05 on a real colony (ρ = 0.2), whose texture would otherwise be sharpened into holes. The
minimum is found by FISTA (Beck & Teboulle 2009, doi:10.1137/080716542), as scikit-image's deconvolutions do not take
the bounds that carry most of the information here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from skimage import measure

from yeastfit.errors import InputError
from yeastfit.measure.outlining.background import background, frames
from yeastfit.measure.outlining.binary_images import ReadyMade, ready_made
from yeastfit.measure.outlining.boundary import boundary, coarse_rim, detection_floor, edge_blur, fine_mask
from yeastfit.measure.outlining.colony_selection import at_point, colony
from yeastfit.measure.outlining.mask_operations import EIGHT, SMOOTHING, Field, Mask, areas_of, blurred, without_specks
from yeastfit.measure.reading.images import MIN_SIDE
from yeastfit.measure.reading.segmentation_options import SegmentationOptions

DOUBTS: dict[str, str] = {
    "several objects": "There is another object of more than a tenth of the colony's size: in a photograph only the "
    "largest is measured, in a ready-made mask all are together.",
    "touches the border": "The colony reaches the border of the image (or of the region looked at): part of it may be "
    "missing.",
    "cut off from an object at the border": "The colony touches an object at the border and was cut off from it at "
    "the narrowest place: check the cut.",
    "an object at the border is left out": "A larger object at the border was taken for something else than the "
    "colony.",
    "low contrast": "The colony is hardly darker than the noise: thin parts may be missing.",
    "saturated": "Many pixels are as dark or as bright as the file can say: what differed there is lost.",
    "uneven light": "The background is more than twice as bright at one place as at another: the fainter side is "
    "measured less well.",
    "blurred": "Edges are blurred by almost 2 pixels or more: gaps and thin filaments may be lost.",
    "tiny": "The colony has fewer than 100 pixels: its outline is coarse.",
    "nearly empty": "The colony fills less than a thousandth of the image: it may be a speck.",
    "fills the image": "The colony fills over four fifths of the image: little background is left to compare with.",
    "polarity unsure": "Both values of the mask lie along its border: dark and bright may be mistaken for each other.",
    "not quite black and white": "Nearly a mask, as lossy compression leaves it: cut at half of its range.",
}
TINY = 100  # px
EMPTY = 1e-3  # of the image
FULL = 0.8  # of the image
BLURRED = 1.8  # px; the measured blur ends at 2
PILED_UP = 0.01  # of the image, at the end of the scale
UNEVEN = 2.0  # brightest over darkest background


@dataclass(frozen=True)
class Segmentation:
    """The colony of one image.

    mask: True on the colony. background: grey level there would be without it. threshold: contrast with the background,
    in grey levels, from which a pixel counts as colony, median along the outline. blur: standard deviation of the
    optical blur in px, noise: that of the background in grey levels; both 0 for a ready-made mask. warnings: doubts,
    keys of `DOUBTS`, which says them in words; empty where there are none.
    """

    mask: Mask
    background: Field
    threshold: float
    blur: float
    noise: float
    warnings: tuple[str, ...]


def segment(
    pixels: npt.NDArray[Any],
    *,
    name: str = "image",
    min_area: int = 20,
    seed_point: Sequence[float] | None = None,
    threshold: float | None = None,
    roi: Sequence[float] | None = None,
) -> Segmentation:
    """The colony in a bright-field photograph [rows, columns] (module docstring), or in a ready-made mask.

    An image of two values, or nearly so, is a mask and kept as it is; the value that holds most of the border is the
    background. In a photograph the colony is the largest dark object of at least `min_area` pixels that is not held by
    the border: a near-black frame is left out, an object at the border is left out or, where it touches the colony, cut
    off at the neck. Smaller objects are dust. Holes and detached objects of at most 200 ρ² pixels, and at most 8, are
    noise and removed (ρ: scatter of the contrast over the rim, 0.05 on clean drawings, 0.2 on real colonies).

    A user overrules this with

        seed_point (x, y)       pixels from the centre of the top-left one: the object there, or the nearest within 2 %
                                of the image's longer side (at least 10 px), is the colony, even at the border; of a
                                ready-made mask only that object is kept
        threshold               grey levels: colony is where the contrast D, smoothed by 0.8 px, exceeds it
        roi (x0, y0, x1, y1)    pixels, x0 <= x < x1 and y0 <= y < y1: all else is as if it were not in the image, its
                                background included; mask and background are of the whole image's size nevertheless

    `name` appears in messages. Raises `InputError` for an image that is not 2-D, finite and `MIN_SIDE` wide, is
    constant, holds no colony, or nothing but colony; and for an argument outside the image or of no meaning.
    """
    image = _checked(pixels, name)
    if isinstance(min_area, bool) or not isinstance(min_area, int | np.integer) or min_area < 1:
        raise InputError(f"{name}: min_area is {min_area!r}, need a whole number of pixels, at least 1")
    wish = SegmentationOptions(seed_point, threshold, roi)
    wish.check(image.shape, name)
    window = wish.window(image.shape)
    ready = ready_made(image)
    if ready is not None:
        return _kept(ready, window, wish, name)
    part = _photograph(_checked(image[window], name), min_area, wish, name)
    mask = np.zeros(image.shape, dtype=bool)
    mask[window] = part.mask
    around = [(at.start, size - at.stop) for at, size in zip(window, image.shape, strict=True)]
    light = np.pad(part.background, around, mode="edge")
    return Segmentation(mask, light, part.threshold, part.blur, part.noise, part.warnings)


def outline(mask: Mask) -> list[npt.NDArray[np.float64]]:
    """Closed contours [(row, column), ...] of a mask, holes included, for an overlay."""
    contours = measure.find_contours(np.pad(mask, 1).astype(np.float32), 0.5)
    return [contour - 1 for contour in contours]


def _checked(pixels: npt.NDArray[Any], name: str) -> npt.NDArray[Any]:
    image = np.asarray(pixels)
    if image.ndim != 2 or image.dtype.kind not in "buif":
        raise InputError(
            f"{name}: shape {image.shape} of {image.dtype}, need grey values [rows, columns]: see read_image"
        )
    if min(image.shape) < MIN_SIDE:
        raise InputError(f"{name}: {image.shape[1]} x {image.shape[0]} pixels, need at least {MIN_SIDE} a side")
    if not np.isfinite(image).all():
        raise InputError(
            f"{name}: {int((~np.isfinite(image)).sum())} pixels are NaN or infinite, need finite grey values"
        )
    if image.min() == image.max():
        raise InputError(f"{name}: every pixel is {image.flat[0]}, need a colony and its background")
    return image if image.dtype == bool else image.astype(np.float32)


def _kept(ready: ReadyMade, window: tuple[slice, slice], wish: SegmentationOptions, name: str) -> Segmentation:
    """A ready-made mask within the window, of which a seed point keeps one object."""
    contrast = abs(ready.background - ready.colony)
    if wish.threshold is not None and wish.threshold >= contrast:
        raise InputError(f"{name}: threshold is {wish.threshold:g}, need less than the {contrast:g} between its values")
    part = ready.mask[window]
    if not part.any():
        raise InputError(f"{name}: no colony within roi {wish.roi!r}, need one around it")
    labels = measure.label(part, connectivity=2)
    if (seed := wish.seed_within()) is not None:
        part = labels == at_point(labels, areas_of(labels) > 0, seed, name)
    sizes = np.sort(areas_of(labels))
    doubts = list(ready.doubts)
    if wish.seed_point is None and len(sizes) > 2 and sizes[-2] > 0.1 * sizes[-1]:
        doubts.append("several objects")
    doubts += _doubts_of_mask(part, np.ones_like(part))
    mask = np.zeros_like(ready.mask)
    mask[window] = part
    light = np.full(mask.shape, ready.background, dtype=np.float32)
    return Segmentation(mask, light, contrast / 2, 0.0, 0.0, tuple(doubts))


def _photograph(image: Field, min_area: int, wish: SegmentationOptions, name: str) -> Segmentation:
    seen = ~frames(image)
    if seen.mean() < 0.1:
        raise InputError(f"{name}: {1 - seen.mean():.0%} of it is a black frame, need a bright-field photograph")
    light, noise = background(image, seen, name)
    contrast = np.where(seen, light - image, np.float32(0))
    floor = detection_floor(contrast, noise)
    coarse = coarse_rim(contrast, floor)
    if wish.threshold is None:
        _refuse_bright(contrast, floor, min_area, name)
        region, doubts = colony(coarse.found, ~seen, min_area, name, wish.seed_within())
        mask, rim, blur = fine_mask(contrast, coarse, region, floor, noise)
        if mask.sum() < min_area:
            raise InputError(
                f"{name}: no colony (what seemed one is noise), need a dark object of {min_area} pixels or more"
            )
        level = float(np.median(rim[boundary(mask)])) / 2
    else:
        level = float(wish.threshold)
        found = blurred(contrast, SMOOTHING) > level
        region, doubts = colony(found, ~seen, min_area, name, wish.seed_within())
        mask, blur = region & found, edge_blur(contrast, coarse.contrast, region & found)
    doubts += _doubts_of_mask(mask, seen) + _doubts_of_photograph(image, seen, light, level, noise, blur)
    area, room = int(mask.sum()), int(seen.sum())
    if area > 0.95 * room:
        raise InputError(f"{name}: colony on {area / room:.0%} of the image, need background around it")
    return Segmentation(mask, light, level, blur, noise, tuple(doubts))


def _refuse_bright(contrast: Field, floor: float, min_area: int, name: str) -> None:
    smooth = blurred(contrast, SMOOTHING)
    bright, dark = (
        abs(float(contrast[without_specks(side, min_area - 1)].sum())) for side in (smooth < -floor, smooth > floor)
    )
    if bright > dark:
        raise InputError(
            f"{name}: what stands out is brighter than the rest, need a dark colony with background around it"
        )


def _doubts_of_mask(mask: Mask, seen: Mask) -> list[str]:
    area, room = int(mask.sum()), int(seen.sum())
    edge = ndimage.binary_dilation(~seen, EIGHT)
    edge[[0, -1], :] = edge[:, [0, -1]] = True
    doubts = {
        "touches the border": bool((mask & edge).any()),
        "tiny": area < TINY,
        "nearly empty": area < EMPTY * room,
        "fills the image": area > FULL * room,
    }
    return [doubt for doubt, holds in doubts.items() if holds]


def _doubts_of_photograph(
    image: Field, seen: Mask, light: Field, threshold: float, noise: float, blur: float
) -> list[str]:
    brightness = np.percentile(light[seen], [1, 99])
    doubts = {
        "low contrast": threshold < 2 * noise,
        "saturated": _piled_up(image[seen]),
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
