"""Find where exactly the colony ends: contrast along its edge, blur of the edge, and the colony's part of each pixel.

The equations are in `segmentation`: `coarse_outline` and `fine_mask` are its lines "coarse" to "fine".
"""

from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from yeastfit.measure.outlining.mask_operations import (
    SMOOTHING,
    Field,
    Mask,
    block_means,
    blurred,
    robust_deviation,
    without_specks,
)

DETECTION = 4.0  # deviations of the smoothed background
DEPTH, WIDTH = 2.5, 2.5  # px inside the boundary
REACH = 19  # px, side of the box that averages contrast along the edge, twice: a deviation of 7.7 px
SLOPE_SCALE = 0.7  # px, of the derivative that measures the blur


def _local_mean(field: npt.NDArray[Any]) -> Field:
    """Mean over a triangular window of `REACH`, zero outside the image; of a large one on squares of 2 by 2 px."""
    step = 2 if min(field.shape) > 400 else 1
    padded = np.pad(field.astype(np.float32, copy=False), [(0, -size % step) for size in field.shape])
    mean = block_means(padded, step)
    for _ in range(2):
        mean = scipy.ndimage.uniform_filter(mean, REACH // step, mode="constant")
    return np.repeat(np.repeat(mean, step, axis=0), step, axis=1)[: field.shape[0], : field.shape[1]]


def detection_limit(contrast: Field, noise: float) -> float:
    """The contrast that stands out: `DETECTION` deviations of the smoothed background.

    The deviation is that of its negative half, and at least what smoothing leaves of the noise.
    """
    smooth = blurred(contrast, SMOOTHING)
    return DETECTION * max(robust_deviation(smooth[smooth < 0]), noise / (2 * sqrt(pi) * SMOOTHING))


class CoarseOutline(NamedTuple):
    """A first outline of all dark objects.

    Attributes:
        joined: Pixels of at least 35 % of the contrast at the edge, which join filaments to their colony.
        mask: Pixels of at least half of it.
        edge_contrast: c(x), the contrast of what is wholly colony, near each edge.
    """

    joined: Mask
    mask: Mask
    edge_contrast: Field


def coarse_outline(contrast: Field, limit: float) -> CoarseOutline:
    """Outline dark objects: twice the contrast along the inside of a mask, then the mask at half of it.

    A filament too thin for `DEPTH` gives its ridge. The first mask, at the detection limit, is about 1 px too wide.
    """
    smooth = blurred(contrast, SMOOTHING)
    mask = without_specks(smooth > limit, 4)
    edge_contrast = np.zeros_like(contrast)
    for depth, source in ((DEPTH + 1, smooth), (DEPTH, contrast)):
        inside = _depth_inside(mask)
        ridge = (inside >= 1) & (inside < depth) & (inside == scipy.ndimage.maximum_filter(inside, 5))
        band = (ridge | ((inside >= depth) & (inside <= depth + WIDTH))).astype(np.float32)
        edge_contrast = np.divide(_local_mean(source * band), np.maximum(_local_mean(band), 1e-4), dtype=np.float32)
        edge_contrast = np.maximum(edge_contrast, np.float32(2 * limit))
        mask = smooth > 0.5 * edge_contrast
    return CoarseOutline(smooth > 0.35 * edge_contrast, mask, edge_contrast)


def _depth_inside(mask: Mask) -> Field:
    """Distance to the background in px: the mean of chessboard and taxicab distance, up to 12 % too long but fast."""
    chessboard, taxicab = (scipy.ndimage.distance_transform_cdt(mask, metric) for metric in ("chessboard", "taxicab"))
    return (chessboard + taxicab).astype(np.float32) / 2


def fine_mask(
    contrast: Field, coarse: CoarseOutline, region: Mask, limit: float, noise: float
) -> tuple[Mask, Field, float]:
    """Outline the colony finely: the line "fine" of `segmentation`, three times over.

    Between rounds the contrast at the edge is measured anew on the mask just found: each pixel is divided by what blur
    leaves of the mask there, and outliers beyond two deviations ρ are dropped. So is the blur.

    Arguments:
        contrast: D.
        coarse: The first outline.
        region: Where the colony may be.
        limit: The contrast that stands out.
        noise: Of the background.

    Returns:
        The mask, the contrast at the edge, and the blur in px.
    """
    holds = scipy.ndimage.find_objects(region.astype(np.uint8))[0]
    window = tuple(slice(max(0, part.start - 16), part.stop + 16) for part in holds)
    contrast, near, mask = contrast[window], region[window], coarse.mask[window] & region[window]
    edge_contrast, slope = coarse.edge_contrast[window], _steepest_slope(contrast)
    share: Field | None = None
    blur, scatter = 0.5, 0.0
    for steps in (4, 6, 25):
        if not mask.any():
            break
        blur = _blur_of_edges(edge_contrast, slope, mask)
        edge_contrast, scatter = _edge_contrast(contrast, mask, edge_contrast, blur, noise)
        edge_contrast = np.maximum(edge_contrast, np.float32(2 * limit))
        data = np.where(near, np.clip(contrast / edge_contrast, -0.5, 1.1), np.float32(0))
        share = _deconvolved(data, blur, 6 * scatter**3, share, steps)
        mask = share > 0.5
    speck = min(round(200 * scatter**2), 8)
    mask = without_specks(mask, speck)
    whole, whole_contrast = np.zeros(region.shape, dtype=bool), coarse.edge_contrast.copy()
    whole[window] = ~without_specks(~mask, speck, connectivity=1)
    whole_contrast[window] = edge_contrast
    return whole, whole_contrast, blur


def boundary_pixels(mask: Mask) -> Mask:
    """Pixels of a mask that share a side with its background."""
    return mask & ~scipy.ndimage.binary_erosion(mask)


def edge_blur(contrast: Field, edge_contrast: Field, mask: Mask) -> float:
    """Standard deviation of the blur, 0.5 to 2 px: a blurred step of height c has the slope c / (√(2π) s) at most."""
    return _blur_of_edges(edge_contrast, _steepest_slope(contrast), mask)


def _steepest_slope(contrast: Field) -> Field:
    """The steepest slope within a pixel of each pixel."""
    return scipy.ndimage.maximum_filter(scipy.ndimage.gaussian_gradient_magnitude(contrast, SLOPE_SCALE), 3)


def _blur_of_edges(edge_contrast: Field, slope: Field, mask: Mask) -> float:
    edge = boundary_pixels(mask)
    width = float(np.median(edge_contrast[edge] / np.maximum(slope[edge], 1e-6 * edge_contrast[edge]))) / sqrt(2 * pi)
    return min(sqrt(max(width**2 - SLOPE_SCALE**2, 0.25)), 2.0)


def _edge_contrast(contrast: Field, mask: Mask, edge_contrast: Field, blur: float, noise: float) -> tuple[Field, float]:
    """c(x), and the scatter ρ of contrast / c along the edge; that of noise alone where blur leaves no edge."""
    covered = blurred(mask, blur)
    band = (covered > 0.75) & (scipy.ndimage.distance_transform_cdt(mask) <= DEPTH + WIDTH)
    scatter = noise / float(np.median(edge_contrast[mask]))
    for _ in range(2):
        residual = contrast / edge_contrast - covered
        if not band.any():
            break
        scatter = robust_deviation(residual[band] - np.median(residual[band]))
        weight = (band & (np.abs(residual) < 2 * max(scatter, 1e-3))).astype(np.float32)
        weights = _local_mean(weight * covered)
        measured = _local_mean(weight * contrast) / np.maximum(weights, np.float32(1e-3))
        edge_contrast = np.where(weights > 1e-3, measured, edge_contrast)
    return edge_contrast, scatter


def _deconvolved(data: Field, blur: float, smoothness: float, share: Field | None, steps: int) -> Field:
    """φ of `segmentation` by FISTA, from `share` or else the smoothed data (a sharp start would stay as it is).

    It ends early once all but 1 in 100 pixels of the colony have settled to 0.002; fine detail comes last.
    """
    target = blurred(data, blur)
    share = np.clip(target, 0, 1) if share is None else share
    ahead, momentum = share, 1.0
    for _ in range(steps):
        new = target - blurred(ahead, sqrt(2) * blur)
        new += np.float32(smoothness) * scipy.ndimage.laplace(ahead, mode="nearest")
        new /= np.float32(1 + 8 * smoothness)
        new += ahead
        np.clip(new, 0, 1, out=new)
        momentum, last = (1 + sqrt(1 + 4 * momentum**2)) / 2, momentum
        change = new - share
        ahead = new + np.float32((last - 1) / momentum) * change
        moving = np.count_nonzero(np.abs(change, out=change) > 0.002)
        share = new
        if moving <= 1e-2 * np.count_nonzero(share > 0.5):
            break
    return share
