"""Where exactly the colony ends: contrast along its rim, blur of its edges, and the part of a pixel that is colony.

The equations are in `yeastfit.measure.segmentation`: `coarse_rim` and `fine_mask` are its lines "coarse" to "fine".
"""

from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from yeastfit.measure.outlining.mask_operations import SMOOTHING, Field, Mask, blurred, shrunk, spread, without_specks

DETECTION = 4.0  # deviations of the smoothed background
RIM_DEPTH, RIM_WIDTH = 2.5, 2.5  # px inside the boundary
RIM_REACH = 19  # px, side of the box that averages the rim's contrast, twice: a deviation of 7.7 px
SLOPE_SCALE = 0.7  # px, of the derivative that measures the blur


def _nearby(field: npt.NDArray[Any]) -> Field:
    """Mean over a triangular window of `RIM_REACH`, zero outside the image; of a large one on squares of 2 by 2 px."""
    step = 2 if min(field.shape) > 400 else 1
    padded = np.pad(field.astype(np.float32, copy=False), [(0, -size % step) for size in field.shape])
    mean = shrunk(padded, step)
    for _ in range(2):
        mean = ndimage.uniform_filter(mean, RIM_REACH // step, mode="constant")
    return np.repeat(np.repeat(mean, step, axis=0), step, axis=1)[: field.shape[0], : field.shape[1]]


def detection_floor(contrast: Field, noise: float) -> float:
    """Contrast that stands out: `DETECTION` deviations of the smoothed background.

    The deviation is that of its negative half, and at least what smoothing leaves of the noise.
    """
    smooth = blurred(contrast, SMOOTHING)
    return DETECTION * max(spread(smooth[smooth < 0]), noise / (2 * sqrt(pi) * SMOOTHING))


class Rim(NamedTuple):
    """Where colony may be, and the contrast c(x) that it has there."""

    found: Mask
    mask: Mask
    contrast: Field


def coarse_rim(contrast: Field, floor: float) -> Rim:
    """Twice: the contrast along the inside of a mask, then the mask at half of it. `found` joins at 35 % of it.

    A filament too thin for `RIM_DEPTH` gives its ridge. The first mask, at the floor, is about 1 px too wide.
    """
    smooth = blurred(contrast, SMOOTHING)
    mask = without_specks(smooth > floor, 4)
    rim = np.zeros_like(contrast)
    for depth, source in ((RIM_DEPTH + 1, smooth), (RIM_DEPTH, contrast)):
        inside = _depth(mask)
        ridge = (inside >= 1) & (inside < depth) & (inside == ndimage.maximum_filter(inside, 5))
        band = (ridge | ((inside >= depth) & (inside <= depth + RIM_WIDTH))).astype(np.float32)
        rim = np.divide(_nearby(source * band), np.maximum(_nearby(band), 1e-4), dtype=np.float32)
        rim = np.maximum(rim, np.float32(2 * floor))
        mask = smooth > 0.5 * rim
    return Rim(smooth > 0.35 * rim, mask, rim)


def _depth(mask: Mask) -> Field:
    """Distance to the background in px, up to 12 % too long: mean of chessboard and taxicab, ten times as fast."""
    total = ndimage.distance_transform_cdt(mask, "chessboard") + ndimage.distance_transform_cdt(mask, "taxicab")
    return total.astype(np.float32) / 2


def fine_mask(contrast: Field, coarse: Rim, region: Mask, floor: float, noise: float) -> tuple[Mask, Field, float]:
    """Mask, rim contrast and blur of the colony in `region`: the last line of the module docstring, three times over.

    Between rounds the rim's contrast is measured anew on the mask just found, each pixel divided by what blur leaves of
    the mask there and outliers beyond two deviations ρ dropped, and so is the blur.
    """
    window = tuple(
        slice(max(0, part.start - 16), part.stop + 16) for part in ndimage.find_objects(region.astype(np.uint8))[0]
    )
    contrast, near, mask = contrast[window], region[window], coarse.mask[window] & region[window]
    rim, slope = coarse.contrast[window], _steepest(contrast)
    share: Field | None = None
    blur, scatter = 0.5, 0.0
    for steps in (4, 6, 25):
        if not mask.any():
            break
        blur = _blur(rim, slope, mask)
        rim, scatter = _rim_of(contrast, mask, rim, blur, noise)
        rim = np.maximum(rim, np.float32(2 * floor))
        data = np.where(near, np.clip(contrast / rim, -0.5, 1.1), np.float32(0))
        share = _deblurred(data, blur, 6 * scatter**3, share, steps)
        mask = share > 0.5
    speck = min(round(200 * scatter**2), 8)
    mask = without_specks(mask, speck)
    whole, whole_rim = np.zeros(region.shape, dtype=bool), coarse.contrast.copy()
    whole[window] = ~without_specks(~mask, speck, connectivity=1)
    whole_rim[window] = rim
    return whole, whole_rim, blur


def boundary(mask: Mask) -> Mask:
    """Pixels of a mask with a side at its background."""
    return mask & ~ndimage.binary_erosion(mask)


def edge_blur(contrast: Field, rim: Field, mask: Mask) -> float:
    """Standard deviation of the blur, 0.5 to 2 px: a blurred step of height c has the slope c / (√(2π) s) at most."""
    return _blur(rim, _steepest(contrast), mask)


def _steepest(contrast: Field) -> Field:
    """The largest slope within a pixel."""
    return ndimage.maximum_filter(ndimage.gaussian_gradient_magnitude(contrast, SLOPE_SCALE), 3)


def _blur(rim: Field, slope: Field, mask: Mask) -> float:
    edge = boundary(mask)
    width = float(np.median(rim[edge] / np.maximum(slope[edge], 1e-6 * rim[edge]))) / sqrt(2 * pi)
    return min(sqrt(max(width**2 - SLOPE_SCALE**2, 0.25)), 2.0)


def _rim_of(contrast: Field, mask: Mask, rim: Field, blur: float, noise: float) -> tuple[Field, float]:
    """c(x) and the scatter ρ of contrast / c over the rim of a mask; that of noise alone where blur leaves no rim."""
    covered = blurred(mask, blur)
    band = (covered > 0.75) & (ndimage.distance_transform_cdt(mask) <= RIM_DEPTH + RIM_WIDTH)
    scatter = noise / float(np.median(rim[mask]))
    for _ in range(2):
        residual = contrast / rim - covered
        if not band.any():
            break
        scatter = spread(residual[band] - np.median(residual[band]))
        weight = (band & (np.abs(residual) < 2 * max(scatter, 1e-3))).astype(np.float32)
        known = _nearby(weight * covered)
        rim = np.where(known > 1e-3, _nearby(weight * contrast) / np.maximum(known, np.float32(1e-3)), rim)
    return rim, scatter


def _deblurred(data: Field, blur: float, smoothness: float, share: Field | None, steps: int) -> Field:
    """φ of the module docstring by FISTA, from `share` or else the smoothed data (a sharp start would stay as it is).

    Ends early where all but 1 in 100 pixels of the colony settle to 0.002; fine detail comes last.
    """
    target = blurred(data, blur)
    share = np.clip(target, 0, 1) if share is None else share
    ahead, momentum = share, 1.0
    for _ in range(steps):
        new = target - blurred(ahead, sqrt(2) * blur)
        new += np.float32(smoothness) * ndimage.laplace(ahead, mode="nearest")
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
