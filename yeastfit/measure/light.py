"""The background of a photograph: the light there would be without a colony, its noise, and frames to leave out."""

from math import ceil, sqrt

import numpy as np
from jaxtyping import Bool, Float64
from scipy import ndimage
from skimage import filters, measure

from yeastfit.errors import InputError
from yeastfit.measure.raster import EIGHT, SMOOTHING, Field, Mask, blurred, border, spread

Samples = Float64[np.ndarray, " sample"]
Kept = Bool[np.ndarray, " sample"]


def frames(image: Field) -> Mask:
    """Frames that stitching leaves along the border, and two more pixels for interpolation.

    Black: below 3 % of the bright pixels. White: the brightest value there is, unless it holds over 10 % of the image.
    """
    sides = [image <= 0.03 * np.percentile(image, 95), image == image.max()]
    frame = np.zeros(image.shape, dtype=bool)
    for side in sides if sides[1].mean() < 0.1 else sides[:1]:
        labels = measure.label(side, connectivity=1)
        touching = np.zeros(labels.max() + 1, dtype=bool)
        touching[border(labels)] = True
        touching[0] = False
        frame |= touching[labels]
    return ndimage.binary_dilation(frame, EIGHT, iterations=2) if frame.any() else frame


def background(image: Field, seen: Mask, name: str) -> tuple[Field, float]:
    """Background and noise (module docstring).

    The fit starts from bright pixels, so that a colony over half the image is no background; then residuals between -2
    and 3 deviations are kept, the deviation taken from positive ones alone. Where there is no background to see, L
    stays within what it is elsewhere.
    """
    step = ceil(sqrt(seen.sum() / 5_000))
    rows, columns = np.nonzero(seen[::step, ::step])
    values = image[::step, ::step][rows, columns].astype(np.float64)
    noise = _noise(image, seen)
    keep = _bright_start(image, seen, values, name)
    u, v = (_axis(size, max(image.shape)) for size in image.shape[::-1])
    for degree, rounds in ((2, 12), (4, 6)):
        table, keep, deviation = _clipped_fit(u[columns * step], v[rows * step], values, degree, keep, noise, rounds)
    surface = np.polynomial.polynomial.polygrid2d(u, v, table).T.astype(np.float32)
    known = surface[rows * step, columns * step][keep]
    surface = np.clip(surface, known.min(), known.max())
    return surface + _local_light(image - surface, seen, 2.5 * deviation), noise


def _bright_start(image: Field, seen: Mask, values: Samples, name: str) -> Kept:
    """Samples in the brighter class of Otsu where the classes differ clearly, else all."""
    middle = filters.threshold_otsu(values)
    bright = values > middle
    rim = seen & ~ndimage.binary_erosion(seen)
    bright_border = (image[rim] > middle).mean() > 0.5
    ratio = values[~bright].mean() / values[bright].mean()
    if ratio < 0.6 and not bright_border:
        raise InputError(f"{name}: most of its border is dark, need a dark colony with bright background around it")
    return bright if ratio < 0.8 and bright_border else np.ones(values.shape, dtype=bool)


def _clipped_fit(
    u: Samples, v: Samples, values: Samples, degree: int, keep: Kept, noise: float, rounds: int
) -> tuple[Float64[np.ndarray, "power power"], Kept, float]:
    """Coefficients [power of u, power of v] of total `degree`, the samples kept and their deviation."""
    power = np.arange(degree + 1)
    total = (power[:, None] + power[None, :] <= degree).ravel()
    basis = np.polynomial.polynomial.polyvander2d(u, v, [degree, degree])[:, total]
    table = np.zeros(total.size)
    for _ in range(rounds):
        kept = basis[keep]  # normal equations by einsum: on a busy machine BLAS threads would wait for each other
        square, side = np.einsum("si,sj->ij", kept, kept), np.einsum("si,s->i", kept, values[keep])
        table[total] = np.linalg.lstsq(square, side, rcond=None)[0]
        residual = values - np.einsum("si,i->s", basis, table[total])
        deviation = max(noise, spread(residual[residual > 0]))
        keep = (residual > -2 * deviation) & (residual < 3 * deviation)
    return table.reshape(degree + 1, degree + 1), keep, deviation


def _axis(size: int, longest: int) -> Float64[np.ndarray, " point"]:
    return (2 * np.arange(size) - (size - 1)) / longest


def _local_light(residual: Field, seen: Mask, limit: float) -> Field:
    """Mean residual of background pixels nearby; it follows shading that a polynomial cannot."""
    step = max(1, max(residual.shape) // 400)
    dark = blurred(-residual, SMOOTHING) > limit
    weight = (seen & ~ndimage.binary_dilation(dark, iterations=2)).astype(np.float32)[::step, ::step]
    reach = 0.05 * max(residual.shape) / step
    mean = blurred(residual[::step, ::step] * weight, reach) / (blurred(weight, reach) + 0.02)
    zoom = [full / coarse for full, coarse in zip(residual.shape, mean.shape, strict=True)]
    return mean if step == 1 else ndimage.zoom(mean, zoom, order=1, mode="nearest", grid_mode=True)


def _noise(image: Field, seen: Mask) -> float:
    """Standard deviation of pixel noise, at least that of rounding to the image's grey levels."""
    kernel = np.outer([1, -2, 1], [1, -2, 1]) / 6
    second = ndimage.convolve(image, kernel.astype(np.float32))[seen]
    whole = bool((image == np.rint(image)).all())
    return max(spread(second), sqrt(1 / 12) if whole else 1e-3 * float(np.ptp(image)))
