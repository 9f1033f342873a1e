"""Outline the colony in a micrograph.

How `segment` works, in grey levels, for a bright-field photograph I (colony darker than its background):

    background  L = b(y) + a(x), steps of whole rows and columns, plus a polynomial of degree 4, fitted by least squares
                to the background, plus the background's mean residual within 5 %, then 1.5 %, of the image's longer
                side. Background is what no edge separates from the border and from a first polynomial, fitted by
                iterated one-sided clipping: a shadow's slope is below 0.4 % of L per pixel, a colony's edge above it.
                Where a camera or a file has added to all values, brightness counts from there (`pedestal_of`)
    contrast    D = L − I, with noise σ from the second differences of I (kernel of Immerkær 1996, "Fast noise variance
                estimation", Comput. Vis. Image Underst. 64:300, doi:10.1006/cviu.1996.0060)
    coarse      the object: where D, smoothed by 0.8 px, exceeds 4 of its own deviations
    edge        c(x) = mean of D over colony pixels 2.5 − 5 px inside the boundary, averaged over about 8 px around x:
                what "wholly colony" looks like there, faint on a filament, dark on the core
    fine        D / c = h * φ + noise with φ the indicator of the colony and h a Gaussian blur, so
                φ = argmin over 0 ≤ φ ≤ 1 of ½ |h * φ − min(D / c, 1.1)|² + ½ λ |∇φ|²,   mask = {φ > ½}

For a straight edge the last line is a threshold at half the contrast c, which moves no edge. For a small cell it also
undoes what blur does to curvature: half-contrast alone loses about π s² pixels of area for an object seen through blur
s (6 % of a cell of 10 by 7 px at s = 1) and closes gaps between cells. The blur s comes from the steepest slope of the
colony's edges, c / (√(2π) max|∇D|), and λ = 6 ρ³ from the scatter ρ of D / c along the edge: 0.001 on a clean drawing
(ρ = 0.05), 0.05 on a real colony (ρ = 0.2), whose texture would otherwise be sharpened into holes. The minimum is found
by FISTA (Beck & Teboulle 2009, "A fast iterative shrinkage-thresholding algorithm for linear inverse problems", SIAM J.
Imaging Sci. 2:183, doi:10.1137/080716542), as scikit-image's deconvolutions do not take the bounds that carry most of
the information here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from skimage import measure

from yeastfit.errors import InputError
from yeastfit.measure.outlining.background import estimate_background, frame_mask, pedestal_of, without_glare
from yeastfit.measure.outlining.boundary import boundary_pixels, coarse_outline, detection_limit, edge_blur, fine_mask
from yeastfit.measure.outlining.colony_selection import object_at, select_colony
from yeastfit.measure.outlining.doubts import BY_HAND, doubts_of_mask, doubts_of_photograph, to_be_checked
from yeastfit.measure.outlining.mask_operations import (
    SMOOTHING,
    Field,
    Mask,
    areas_of,
    blurred,
    without_specks,
)
from yeastfit.measure.reading.binary_images import BinaryImage, recognise_binary, recognise_labels
from yeastfit.measure.reading.images import MIN_SIDE
from yeastfit.measure.reading.outline_files import background_of, check_outline, object_in
from yeastfit.measure.reading.segmentation_options import SegmentationOptions


@dataclass(frozen=True)
class Segmentation:
    """The colony of one image.

    Attributes:
        mask: True on the colony.
        background: Grey level that there would be without it.
        threshold: Contrast with the background, in grey levels, from which a pixel counts as colony: the median along
            the outline.
        blur: Standard deviation of the optical blur in px; 0 for a ready-made mask.
        noise: Standard deviation of the background in grey levels; 0 for a ready-made mask.
        warnings: Doubts by name, keys of `doubts.DOUBTS`, which puts them in words.
    """

    mask: Mask
    background: Field
    threshold: float
    blur: float
    noise: float
    warnings: tuple[str, ...]

    @property
    def ready_made(self) -> bool:
        """Whether the mask was given and not found in a photograph."""
        return self.blur == 0 and self.noise == 0


def segment(
    pixels: npt.NDArray[Any],
    *,
    name: str = "image",
    min_area: int = 20,
    seed_point: Sequence[float] | None = None,
    threshold: float | None = None,
    roi: Sequence[float] | None = None,
    colonies: str | None = None,
) -> Segmentation:
    """Outline the colony in a bright-field photograph, or take a ready-made mask as it is.

    An image of two values, or nearly so, is a mask; the value that holds most of the border is the background. In a
    photograph the colony is the largest dark object that the border does not hold: a near-black frame is left out, and
    an object at the border is left out or, where it touches the colony, cut off at the neck. Smaller objects are dust.
    Holes and detached objects of at most 200 ρ² pixels, and at most 8, are noise and removed (ρ as in the module
    docstring).

    Arguments:
        pixels: Grey values [rows, columns].
        name: What messages begin with.
        min_area: The fewest pixels of a colony in a photograph.
        seed_point: x and y in pixels from the centre of the top-left one. The object there, or the nearest within 2 %
            of the image's longer side (at least 10 px), is the colony, even at the border; of a ready-made mask only
            that object is kept.
        threshold: In grey levels: colony is where the contrast D, smoothed by 0.8 px, exceeds it.
        roi: x0, y0, x1, y1 in pixels. Everything but x0 ≤ x < x1 and y0 ≤ y < y1 is as if it were not in the image, its
            background included; mask and background have the whole image's size nevertheless.
        colonies: "all": every object that the border does not hold and that is no dust, of at least twice `min_area`
            pixels and a hundredth of the largest; of a ready-made mask, which holds all by default, "one" keeps the
            largest.

    Returns:
        The mask, and doubts about it.

    Raises:
        InputError: The image is not 2-D, finite and `MIN_SIDE` wide, is constant, or shows no colony or nothing else;
            or an argument lies outside the image or makes no sense.
    """
    image = _checked(pixels, name)
    if isinstance(min_area, bool) or not isinstance(min_area, int | np.integer) or min_area < 1:
        raise InputError(f"{name}: min_area is {min_area!r}, need a whole number of pixels, at least 1")
    options = SegmentationOptions(seed_point, threshold, roi, colonies)
    options.check(image.shape, name)
    window = options.window(image.shape)
    binary = recognise_binary(image)
    if binary is not None:
        return _segment_binary(binary, window, options, name)
    labels = recognise_labels(image)
    if labels is not None:
        inside = np.zeros(labels.shape, dtype=bool)
        inside[window] = True
        background = background_of(labels)
        kept = np.where(inside, labels, background)
        count = len(np.setdiff1d(labels[window], [background]))
        if not count:
            raise InputError(f"{name}: no object within roi {roi!r}, need one around it")
        one = kept != background if colonies == "all" else object_in(kept, seed_point, Path(name))
        check_outline(one, name)
        found = given_outline(image, one)
        several = ("several objects",) if seed_point is None and colonies is None and count > 1 else ()
        doubts = (*several, *to_be_checked(found.warnings))
        return Segmentation(found.mask, found.background, 0.5, 0.0, 0.0, doubts)
    part = _segment_photograph(_checked(image[window], name), min_area, options, name)
    mask = np.zeros(image.shape, dtype=bool)
    mask[window] = part.mask
    around = [(at.start, size - at.stop) for at, size in zip(window, image.shape, strict=True)]
    background = np.pad(part.background, around, mode="edge")
    return Segmentation(mask, background, part.threshold, part.blur, part.noise, part.warnings)


def given_outline(pixels: npt.NDArray[Any], mask: Mask) -> Segmentation:
    """The colony of a photograph whose outline was made elsewhere; the background is the median of the rest."""
    level = float(np.median(pixels[~mask])) if not mask.all() else float(np.max(pixels))
    doubts = [BY_HAND, *doubts_of_mask(mask, np.ones_like(mask))]
    background = np.full(mask.shape, level, dtype=np.float32)
    contrast = max(level - float(np.median(pixels[mask])), 0.0)
    return Segmentation(mask, background, contrast / 2, 0.0, 0.0, tuple(doubts))


def outline(mask: Mask) -> list[npt.NDArray[np.float64]]:
    """Closed contours [(row, column), …] of a mask, holes included, for an overlay."""
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


def _segment_binary(
    binary: BinaryImage, window: tuple[slice, slice], options: SegmentationOptions, name: str
) -> Segmentation:
    """The part of a ready-made mask in the window; with a seed point, one object of it."""
    contrast = abs(binary.background - binary.colony)
    if options.threshold is not None and options.threshold >= contrast:
        raise InputError(
            f"{name}: threshold is {options.threshold:g}, need less than the {contrast:g} between its values"
        )
    part = binary.mask[window]
    if not part.any():
        raise InputError(f"{name}: no colony within roi {options.roi!r}, need one around it")
    labels = measure.label(part, connectivity=2)
    if (seed := options.seed_within()) is not None:
        part = labels == object_at(labels, areas_of(labels) > 0, seed, name)
    elif options.colonies == "one":
        part = labels == areas_of(labels).argmax()
    sizes = np.sort(areas_of(labels))
    doubts = list(binary.doubts)
    if options.seed_point is None and options.colonies is None and len(sizes) > 2 and sizes[-2] > 0.1 * sizes[-1]:
        doubts.append("several objects")
    check_outline(part, name)
    doubts += doubts_of_mask(part, np.ones_like(part))
    mask = np.zeros_like(binary.mask)
    mask[window] = part
    background = np.full(mask.shape, binary.background, dtype=np.float32)
    return Segmentation(mask, background, contrast / 2, 0.0, 0.0, tuple(doubts))


def _segment_photograph(photograph: Field, min_area: int, options: SegmentationOptions, name: str) -> Segmentation:
    image = without_glare(photograph)
    pedestal = np.float32(pedestal_of(image))
    image = image - pedestal
    visible = ~frame_mask(image)
    if visible.mean() < 0.1:
        raise InputError(f"{name}: {1 - visible.mean():.0%} of it is a black frame, need a bright-field photograph")
    background, noise = estimate_background(image, visible, name)
    contrast = np.where(visible, background - image, np.float32(0))
    limit = detection_limit(contrast, noise)
    coarse = coarse_outline(contrast, limit)
    selection = options.seed_within(), options.colonies == "all"
    if options.threshold is None:
        _refuse_bright(contrast, limit, min_area, name)
        region, doubts = select_colony(coarse.joined, ~visible, min_area, name, *selection)
        mask, edge_contrast, blur = fine_mask(contrast, coarse, region, limit, noise)
        if mask.sum() < min_area:
            raise InputError(
                f"{name}: no colony (what seemed one is noise), need a dark object of {min_area} pixels or more"
            )
        level = float(np.median(edge_contrast[boundary_pixels(mask)])) / 2
    else:
        level = float(options.threshold)
        dark = blurred(contrast, SMOOTHING) > level
        region, doubts = select_colony(dark, ~visible, min_area, name, *selection)
        mask, blur = region & dark, edge_blur(contrast, coarse.edge_contrast, region & dark)
    background += pedestal
    doubts += doubts_of_mask(mask, visible) + doubts_of_photograph(photograph, visible, background, level, noise, blur)
    area, available = int(mask.sum()), int(visible.sum())
    if area > 0.95 * available:
        raise InputError(f"{name}: colony on {area / available:.0%} of the image, need background around it")
    return Segmentation(mask, background, level, blur, noise, tuple(doubts))


def _refuse_bright(contrast: Field, limit: float, min_area: int, name: str) -> None:
    smooth = blurred(contrast, SMOOTHING)
    bright, dark = (
        abs(float(contrast[without_specks(side, min_area - 1)].sum())) for side in (smooth < -limit, smooth > limit)
    )
    if bright > dark:
        raise InputError(
            f"{name}: what stands out is brighter than the rest, need a dark colony with background around it"
        )
