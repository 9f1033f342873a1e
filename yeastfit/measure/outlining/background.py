"""Estimate the background of a photograph, as it would be without a colony, its noise, and frames to leave out."""

from math import ceil, pi, sqrt

import numpy as np
import numpy.typing as npt
import scipy
from jaxtyping import Bool, Float64
from skimage import filters, measure

from yeastfit.errors import InputError
from yeastfit.measure.outlining.mask_operations import (
    NEIGHBOURS,
    SMOOTHING,
    Field,
    Mask,
    Small,
    areas_of,
    block_means,
    blurred,
    border_pixels,
    robust_deviation,
)
from yeastfit.measure.outlining.stitching import STEEP, add_tiles, row_and_column_steps

Coarse = Bool[np.ndarray, "small_row small_column"]
Samples = Float64[np.ndarray, " sample"]
Kept = Bool[np.ndarray, " sample"]

SLOPE_SCALE = (2.0, 4.0)  # px, of the derivative that finds edges: finest, and coarsest for noisy images
LEAST_RANGE = 0.4  # of the brightest, down to the darkest: photographs have 0.9, our synthetic ones 0.43 or more
GLARE = 2.0  # of the value that 99 % of the pixels are below; photographs of colonies reach 1.3 of it at most
LEAST_GROUND = 0.3  # of the border, that has the value of a ground
TRUE_SHAPE = 0.98  # of a bounding box, that is as in a rectangle or an ellipse
REACHES = (0.05, 0.015)  # of the image's longer side


def frame_mask(image: Field) -> Mask:
    """Find frames along the border, of stitching or of what a photograph was put on, and two more pixels.

    Black: below 3 % of the bright pixels. White: the brightest value there is, unless it holds over 10 % of the image.
    Or a ground (`_ground`). The two pixels are for interpolation.
    """
    sides = [image <= 0.03 * np.percentile(image, 95), image == image.max()]
    frame = np.zeros(image.shape, dtype=bool)
    for side in sides if sides[1].mean() < 0.1 else sides[:1]:
        frame |= _reaching_border(side)
    frame |= _ground(image)
    return scipy.ndimage.binary_dilation(frame, NEIGHBOURS, iterations=2) if frame.any() else frame


def _reaching_border(mask: Mask) -> Mask:
    """Those connected parts of a mask that reach the image's border."""
    labels = measure.label(mask, connectivity=1)
    touching = np.zeros(labels.max() + 1, dtype=bool)
    touching[border_pixels(labels)] = True
    touching[0] = False
    return touching[labels]


def _ground(image: Field) -> Mask:
    """The ground that a photograph was put on, as a page or a wider canvas; nothing where there is none.

    One grey value along the border, with a rectangle or a round field of view in it: what fills its bounding box, or
    the ellipse in that, within `TRUE_SHAPE`. Along its edge lies the brighter of the two classes of its grey values
    (Otsu), which differ clearly: a colony on a ground without any noise, drawn or overexposed, has no background in it.
    And that edge is sharp, while a round colony's is blurred.
    """
    border = border_pixels(image)
    values, counts = np.unique(border, return_counts=True)
    nothing = np.zeros(image.shape, dtype=bool)
    if counts.max() < LEAST_GROUND * border.size:
        return nothing
    value = float(values[counts.argmax()])
    ground = _reaching_border(image == value)
    rows, columns = (np.flatnonzero((~ground).any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return nothing
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    inner = ~ground[box]
    row, column = (2 * (np.arange(size) + 0.5) / size - 1 for size in inner.shape)
    ellipse = row[:, None] ** 2 + column**2 <= 1
    if not any((inner == shape).mean() > TRUE_SHAPE for shape in (np.ones_like(inner), ellipse)):
        return nothing
    rim = inner & ~scipy.ndimage.binary_erosion(inner)
    edge = scipy.ndimage.binary_erosion(inner, NEIGHBOURS, iterations=2)
    edge &= ~scipy.ndimage.binary_erosion(inner, NEIGHBOURS, iterations=6)
    part = image[box].astype(np.float64)
    middle = filters.threshold_otsu(part[inner])
    bright = part > middle
    if not edge.any() or bright[edge].mean() < 0.9:
        return nothing
    clear = part[inner & ~bright].mean() < 0.8 * part[inner & bright].mean()
    at_rim, within = np.median(part[rim]), np.median(part[edge])
    sharp = abs(at_rim - within) <= max(0.25 * abs(value - within), part[edge].std())
    return ground if clear and sharp else nothing


def without_glare(image: Field) -> Field:
    """The image with what is far brighter than its background, a scale bar or hot pixels, at `GLARE` times its 99 %."""
    limit = GLARE * float(np.percentile(image, 99))
    return np.minimum(image, np.float32(limit)) if 0 < limit < image.max() else image


def pedestal_of(image: Field) -> float:
    """What to take off all grey values, as brightness is compared with 0: a camera or a file may have added something.

    It is 0 where the darkest place of an image is darker than 1 − `LEAST_RANGE` of the brightest. Else it leaves just
    that range, so that what is added to all values changes no outline. Of negative values it makes the darkest 0. A
    place is 2 × 2 pixels, all as dark or as bright: a dead pixel is none.
    """
    squares = [image[i : i - 1 or None, j : j - 1 or None] for i in (0, 1) for j in (0, 1)]
    low, high = float(np.maximum.reduce(squares).min()), float(np.minimum.reduce(squares).max())
    if low >= 0 and high - low > LEAST_RANGE * high:
        return 0.0
    pedestal = high - (high - low) / LEAST_RANGE if low >= 0 else low
    return float(np.floor(pedestal)) if (image == np.rint(image)).all() else pedestal


def estimate_background(image: Field, visible: Mask, name: str) -> tuple[Field, float]:
    """Estimate the background L and its noise: the line "background" of `segmentation`.

    The fit starts from bright pixels, so that a colony over half the image is no background; then residuals between −2
    and 3 deviations are kept, the deviation taken from positive ones alone. Where no background is visible, the
    polynomial stays within what it is elsewhere.

    Arguments:
        image: Grey values.
        visible: Which pixels are not a frame.
        name: What messages begin with.

    Returns:
        L and the standard deviation of pixel noise.

    Raises:
        InputError: Most of the border is dark.
    """
    noise = _noise(image, visible)
    shade = row_and_column_steps(image, visible, noise)
    even = image - shade
    step = ceil(sqrt(visible.sum() / 5_000))
    rows, columns = np.nonzero(visible[::step, ::step])
    values = even[::step, ::step][rows, columns].astype(np.float64)
    keep = _bright_samples(even, visible, values, name)
    u, v = (_axis(size, max(image.shape)) for size in image.shape[::-1])
    at = u[columns * step], v[rows * step]
    for degree, rounds in ((2, 12), (4, 6)):
        table, keep, deviation = _clipped_fit(*at, values, degree, keep, noise, rounds)
    surface = _polynomial_surface(table, u, v, rows * step, columns * step, keep)
    background, small = _visible_background(even, surface, visible, noise, 2.5 * deviation)
    row, column = (
        np.minimum(place // small, size - 1)
        for place, size in zip((rows * step, columns * step), background.shape, strict=True)
    )
    sampled = background[row, column]
    if sampled.sum() > 100:
        keep = sampled
        table = _fit(*at, values, 4, keep)
    surface = _polynomial_surface(table, u, v, rows * step, columns * step, keep)
    return surface + shade + _local_mean(even - surface, background, small), noise


def _polynomial_surface(
    table: Float64[np.ndarray, "power power"],
    u: Float64[np.ndarray, " column"],
    v: Float64[np.ndarray, " row"],
    rows: npt.NDArray[np.integer],
    columns: npt.NDArray[np.integer],
    keep: Kept,
) -> Field:
    """The polynomial on all pixels, clipped to its range on the samples kept."""
    surface = np.polynomial.polynomial.polygrid2d(u, v, table).T.astype(np.float32)
    on_samples = surface[rows, columns][keep]
    return np.clip(surface, on_samples.min(), on_samples.max())


def _bright_samples(image: Field, visible: Mask, values: Samples, name: str) -> Kept:
    """Samples in the brighter of Otsu's classes where these differ clearly, else all."""
    middle = filters.threshold_otsu(values)
    bright = values > middle
    edge = visible & ~scipy.ndimage.binary_erosion(visible)
    bright_border = (image[edge] > middle).mean() > 0.5
    ratio = values[~bright].mean() / values[bright].mean()
    if ratio < 0.6 and not bright_border:
        raise InputError(f"{name}: most of its border is dark, need a dark colony with bright background around it")
    return bright if ratio < 0.8 and bright_border else np.ones(values.shape, dtype=bool)


def _clipped_fit(
    u: Samples, v: Samples, values: Samples, degree: int, keep: Kept, noise: float, rounds: int
) -> tuple[Float64[np.ndarray, "power power"], Kept, float]:
    """Coefficients of `_fit`, the samples kept and their deviation."""
    for _ in range(rounds):
        table = _fit(u, v, values, degree, keep)
        residual = values - np.polynomial.polynomial.polyval2d(u, v, table)
        deviation = max(noise, robust_deviation(residual[residual > 0]))
        keep = (residual > -2 * deviation) & (residual < 3 * deviation)
    return table, keep, deviation


def _fit(u: Samples, v: Samples, values: Samples, degree: int, keep: Kept) -> Float64[np.ndarray, "power power"]:
    """Coefficients [power of u, power of v] of total `degree`, least squares over the samples kept."""
    power = np.arange(degree + 1)
    total = (power[:, None] + power[None, :] <= degree).ravel()
    basis = np.polynomial.polynomial.polyvander2d(u[keep], v[keep], [degree, degree])[:, total]
    table = np.zeros(total.size)
    # normal equations by einsum: on a busy machine BLAS threads would wait for each other
    square, side = np.einsum("si,sj->ij", basis, basis), np.einsum("si,s->i", basis, values[keep])
    table[total] = np.linalg.lstsq(square, side, rcond=None)[0]
    return table.reshape(degree + 1, degree + 1)


def _axis(size: int, longest: int) -> Float64[np.ndarray, " point"]:
    return (2 * np.arange(size) - (size - 1)) / longest


def _visible_background(image: Field, surface: Field, visible: Mask, noise: float, limit: float) -> tuple[Coarse, int]:
    """Where background is visible, on a grid of about 800 points a side, and that grid's step in px.

    It is `_regions_without_edges` where these are 3 % of the image or more, else what is not darker than the surface by
    `limit`.
    """
    step = max(1, round(max(image.shape) / 800))
    small, flat = block_means(image, step), block_means(surface, step)
    whole = block_means(visible.astype(np.float32), step) > 0.99
    background = _regions_without_edges(small, flat, whole, noise / step, step, limit)
    if background.mean() < 0.03:
        dark = blurred(flat - small, SMOOTHING / step) > limit
        background = whole & ~scipy.ndimage.binary_dilation(dark, iterations=2)
    return background, step


def _local_mean(residual: Field, background: Coarse, step: int) -> Field:
    """Mean residual over the background nearby, wide and then narrow: shading that no polynomial follows."""
    share, coarse = background.astype(np.float32)[::2, ::2], block_means(residual, step)[::2, ::2]
    mean = np.zeros_like(coarse)
    for reach in REACHES:
        width = reach * max(coarse.shape)
        mean += blurred((coarse - mean) * share, width) / (blurred(share, width) + np.float32(0.02))
    zoom = [full / part for full, part in zip(residual.shape, mean.shape, strict=True)]
    return scipy.ndimage.zoom(mean, zoom, order=1, mode="nearest", grid_mode=True)


def _regions_without_edges(image: Small, surface: Small, visible: Mask, noise: float, step: int, limit: float) -> Mask:
    """Background as what no edge separates from it: regions without steep slopes, mostly within `limit` of the surface.

    They reach the border of what is visible, as a faint colony's inside does not. A shadow has no edge and is
    background; a colony has one, however faint. Regions behind a straight seam count too. Two more pixels along every
    edge are left out, which closes gaps in it. `noise` is that of the image averaged over blocks.
    """
    level = float(np.median(surface))
    drowned = sqrt(5 * noise / (sqrt(8 * pi) * STEEP * step * max(level, 1e-6)))  # where noise is as steep as an edge
    scale = min(max(1.0, SLOPE_SCALE[0] / step, drowned), SLOPE_SCALE[1] / step)
    slope = scipy.ndimage.gaussian_gradient_magnitude(image, scale)
    steep = np.maximum(np.float32(5 * noise / (sqrt(8 * pi) * scale**2)), np.float32(STEEP * step) * surface)
    flat = scipy.ndimage.binary_erosion(visible & (slope < steep), NEIGHBOURS, iterations=2, border_value=1)
    labels = measure.label(flat, connectivity=1)
    areas = areas_of(labels)
    near = np.bincount(labels.ravel(), weights=(np.abs(image - surface) < limit).ravel())
    edge = ~scipy.ndimage.binary_erosion(visible, NEIGHBOURS, iterations=4)
    outside = np.zeros(areas.size, dtype=bool)
    outside[labels[edge]] = True
    background = (near > 0.5 * areas) & (areas >= 20) & outside
    return add_tiles(background[labels], labels, image, areas)


def _noise(image: Field, visible: Mask) -> float:
    """Standard deviation of pixel noise, at least that of rounding to the image's grey levels."""
    kernel = np.outer([1, -2, 1], [1, -2, 1]) / 6
    second = scipy.ndimage.convolve(image, kernel.astype(np.float32))[visible]
    whole = bool((image == np.rint(image)).all())
    return max(robust_deviation(second), sqrt(1 / 12) if whole else 1e-3 * float(np.ptp(image)))
