"""The colony in a photograph.

How `segment` works, in grey levels, for a bright-field photograph I (colony darker than its background):

    light       L = polynomial of degree 4 in x and y, least squares on pixels kept by iterated one-sided clipping, plus
                the mean residual of background pixels within 5 % of the image's longer side
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

from dataclasses import dataclass
from math import ceil, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage
from skimage import filters, measure, segmentation

from yeastfit.errors import InputError
from yeastfit.measure.images import MIN_SIDE

Field = Float32[np.ndarray, "row column"]
Mask = Bool[np.ndarray, "row column"]
Samples = Float64[np.ndarray, " sample"]
Kept = Bool[np.ndarray, " sample"]

SMOOTHING = 0.8  # px, before the coarse threshold
DETECTION = 4.0  # deviations of the smoothed background
RIM_DEPTH, RIM_WIDTH = 2.5, 2.5  # px inside the boundary
RIM_REACH = 19  # px, side of the box that averages the rim's contrast, twice: a deviation of 7.7 px
SLOPE_SCALE = 0.7  # px, of the derivative that measures the blur
EIGHT = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class Segmentation:
    """The colony of one image.

    mask: True on the colony. background: grey level there would be without it. threshold: contrast with the background,
    in grey levels, from which a pixel counts as colony, median along the outline. blur: standard deviation of the
    optical blur in px, noise: that of the background in grey levels; both 0 for a ready-made mask. warnings: doubts, in
    words, empty where there are none.
    """

    mask: Mask
    background: Field
    threshold: float
    blur: float
    noise: float
    warnings: tuple[str, ...]


def segment(pixels: npt.NDArray[Any], *, name: str = "image", min_area: int = 20) -> Segmentation:
    """The colony in a bright-field photograph [rows, columns] (module docstring), or in a ready-made mask.

    An image of two values is a mask and kept as it is; the value that holds most of the border is the background. In a
    photograph the colony is the largest dark object of at least `min_area` pixels that is not held by the border: a
    near-black frame is left out, an object at the border is left out or, where it touches the colony, cut off at the
    neck. Smaller objects are dust. Holes and detached objects of at most 40 ρ pixels, at least 2 and at most 8, are
    noise and removed (ρ: scatter of the contrast over the rim, 0.05 on clean drawings, 0.2 on real colonies).

    `name` appears in messages. Raises `InputError` for an image that is not 2-D, finite and `MIN_SIDE` wide, is
    constant, holds no colony, or nothing but colony.
    """
    image = _checked(pixels, name)
    if bool(((image == image.min()) | (image == image.max())).all()):
        return _ready_made(image)
    seen = ~_frame(image)
    if seen.mean() < 0.1:
        raise InputError(f"{name}: {1 - seen.mean():.0%} of it is a black frame, need a bright-field photograph")
    light, noise = _light(image, seen, name)
    contrast = np.where(seen, light - image, np.float32(0))
    floor = DETECTION * _deviation(contrast, noise)
    _refuse_bright(contrast, floor, min_area, name)
    coarse = _coarse_rim(contrast, floor)
    region, warnings = _colony(coarse.found, ~seen, min_area, name)
    mask, rim, blur = _fine_mask(contrast, coarse, region, floor, noise)
    if mask.sum() < min_area:
        raise InputError(
            f"{name}: no colony (what seemed one is noise), need a dark object of {min_area} pixels or more"
        )
    threshold = float(np.median(rim[_outline(mask)])) / 2
    warnings += _doubts(mask, seen, threshold, noise, blur, name)
    return Segmentation(mask, light, threshold, blur, noise, tuple(warnings))


def _refuse_bright(contrast: Field, floor: float, min_area: int, name: str) -> None:
    smooth = _smooth(contrast, SMOOTHING)
    bright, dark = (
        abs(float(contrast[_without_specks(side, min_area - 1)].sum())) for side in (smooth < -floor, smooth > floor)
    )
    if bright > dark:
        raise InputError(
            f"{name}: what stands out is brighter than the rest, need a dark colony with background around it"
        )


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


def _ready_made(image: npt.NDArray[Any]) -> Segmentation:
    bright = image == image.max()
    share = float(_border(bright).mean())
    mask = ~bright if share >= 0.5 else bright
    warnings = ["polarity unsure: both values along the border"] if 0.2 < share < 0.8 else []
    sizes = np.sort(_areas(measure.label(mask, connectivity=2)))
    warnings += ["several objects"] if len(sizes) > 1 and sizes[-2] > 0.1 * sizes[-1] else []
    warnings += ["touches the border"] if _border(mask).any() else []
    low, high = float(image.min()), float(image.max())
    background = np.full(image.shape, high if share >= 0.5 else low, dtype=np.float32)
    return Segmentation(mask, background, (high - low) / 2, 0.0, 0.0, tuple(warnings))


def _border(field: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.concatenate([field[0], field[-1], field[:, 0], field[:, -1]])


def _areas(labels: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Pixels of every label, 0 for the background."""
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    return areas


def _without_specks(mask: Mask, size: int, connectivity: int = 2) -> Mask:
    """A mask without its objects of at most `size` pixels."""
    labels = measure.label(mask, connectivity=connectivity)
    return np.asarray((_areas(labels) > size)[labels])


def _frame(image: Field) -> Mask:
    """Frames that stitching leaves along the border, and two more pixels for interpolation.

    Black: below 3 % of the bright pixels. White: the brightest value there is, unless it holds over 10 % of the image.
    """
    sides = [image <= 0.03 * np.percentile(image, 95), image == image.max()]
    frame = np.zeros(image.shape, dtype=bool)
    for side in sides if sides[1].mean() < 0.1 else sides[:1]:
        labels = measure.label(side, connectivity=1)
        touching = np.zeros(labels.max() + 1, dtype=bool)
        touching[_border(labels)] = True
        touching[0] = False
        frame |= touching[labels]
    return ndimage.binary_dilation(frame, EIGHT, iterations=2) if frame.any() else frame


def _light(image: Field, seen: Mask, name: str) -> tuple[Field, float]:
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
        deviation = max(noise, _spread(residual[residual > 0]))
        keep = (residual > -2 * deviation) & (residual < 3 * deviation)
    return table.reshape(degree + 1, degree + 1), keep, deviation


def _axis(size: int, longest: int) -> Float64[np.ndarray, " point"]:
    return (2 * np.arange(size) - (size - 1)) / longest


def _local_light(residual: Field, seen: Mask, limit: float) -> Field:
    """Mean residual of background pixels nearby; it follows shading that a polynomial cannot."""
    step = max(1, max(residual.shape) // 400)
    dark = _smooth(-residual, SMOOTHING) > limit
    weight = (seen & ~ndimage.binary_dilation(dark, iterations=2)).astype(np.float32)[::step, ::step]
    reach = 0.05 * max(residual.shape) / step
    mean = _smooth(residual[::step, ::step] * weight, reach) / (_smooth(weight, reach) + 0.02)
    zoom = [full / coarse for full, coarse in zip(residual.shape, mean.shape, strict=True)]
    return mean if step == 1 else ndimage.zoom(mean, zoom, order=1, mode="nearest", grid_mode=True)


def _noise(image: Field, seen: Mask) -> float:
    """Standard deviation of pixel noise, at least that of rounding to the image's grey levels."""
    kernel = np.outer([1, -2, 1], [1, -2, 1]) / 6
    second = ndimage.convolve(image, kernel.astype(np.float32))[seen]
    whole = bool((image == np.rint(image)).all())
    return max(_spread(second), sqrt(1 / 12) if whole else 1e-3 * float(np.ptp(image)))


def _spread(values: npt.NDArray[Any]) -> float:
    """Standard deviation of normal values around 0, from the median of their sizes."""
    return 1.4826 * float(np.median(np.abs(values))) if values.size else 0.0


def _smooth(field: npt.NDArray[Any], width: float) -> Field:
    return ndimage.gaussian_filter(field.astype(np.float32, copy=False), width, mode="nearest", truncate=3.0)


def _nearby(field: npt.NDArray[Any]) -> Field:
    """Mean over a triangular window of `RIM_REACH`, zero outside the image."""
    once = ndimage.uniform_filter(field.astype(np.float32, copy=False), RIM_REACH, mode="constant")
    return ndimage.uniform_filter(once, RIM_REACH, mode="constant")


def _deviation(contrast: Field, noise: float) -> float:
    """Of the smoothed background, from its negative half; at least what smoothing leaves of the noise."""
    smooth = _smooth(contrast, SMOOTHING)
    return max(_spread(smooth[smooth < 0]), noise / (2 * sqrt(pi) * SMOOTHING))


class Rim(NamedTuple):
    """Where colony may be, and the contrast c(x) that it has there."""

    found: Mask
    mask: Mask
    contrast: Field


def _coarse_rim(contrast: Field, floor: float) -> Rim:
    """Twice: the contrast along the inside of a mask, then the mask at half of it. `found` joins at 35 % of it.

    A filament too thin for `RIM_DEPTH` gives its ridge. The first mask, at the floor, is about 1 px too wide.
    """
    smooth = _smooth(contrast, SMOOTHING)
    mask = _without_specks(smooth > floor, 4)
    rim = np.zeros_like(contrast)
    for depth, source in ((RIM_DEPTH + 1, smooth), (RIM_DEPTH, contrast)):
        inside = ndimage.distance_transform_edt(mask).astype(np.float32)
        ridge = (inside >= 1) & (inside < depth) & (inside == ndimage.maximum_filter(inside, 5))
        band = (ridge | ((inside >= depth) & (inside <= depth + RIM_WIDTH))).astype(np.float32)
        rim = np.divide(_nearby(source * band), np.maximum(_nearby(band), 1e-4), dtype=np.float32)
        rim = np.maximum(rim, np.float32(2 * floor))
        mask = smooth > 0.5 * rim
    return Rim(smooth > 0.35 * rim, mask, rim)


def _colony(found: Mask, frame: Mask, min_area: int, name: str) -> tuple[Mask, list[str]]:
    """The object that is the colony, widened by 3 px but not into others, and warnings."""
    labels = measure.label(found, connectivity=2)
    areas = _areas(labels)
    if areas.max() < min_area:
        what = (
            f"the largest object has {areas.max()} pixels" if areas.max() else "nothing is darker than the background"
        )
        raise InputError(
            f"{name}: no colony ({what}), need a dark object of {min_area} pixels or more, background around it"
        )
    edge = frame.copy()
    edge[[0, -1], :] = edge[:, [0, -1]] = True
    held = np.setdiff1d(labels[edge], [0])
    free = areas.copy()
    free[held] = 0
    largest = int(areas.argmax())
    chosen, warnings = labels == largest, []
    if largest in held:
        core = _without_border_object(chosen, edge)
        if core is not None and core.sum() > free.max():
            chosen, warnings = core, ["cut off from an object at the border"]
        elif free.max() >= max(min_area, 0.05 * areas.max()):
            largest = int(free.argmax())
            chosen, warnings = labels == largest, ["an object at the border is left out"]
    free[largest] = 0
    if free.max() > 0.1 * chosen.sum() and free.max() >= min_area:
        warnings.append("several objects")
    return ndimage.binary_dilation(chosen, EIGHT, iterations=3) & (chosen | ~found), warnings


def _without_border_object(joined: Mask, edge: Mask) -> Mask | None:
    """The part of an object around its thickest place away from the border, where a neck parts it from the border.

    Watershed of the distance to the background, on a grid of about 400 points a side, between that thickest place and
    the border. None where the object is thickest at the border, or where it only reaches the border with a tip (less
    than 1 % of it would be cut).
    """
    step = max(1, max(joined.shape) // 400)
    small = measure.block_reduce(joined, (step, step), np.max)
    border = measure.block_reduce(edge & joined, (step, step), np.max)
    inside = ndimage.distance_transform_edt(ndimage.binary_fill_holes(small))
    for share in (0.5, 0.25):
        cores = measure.label(inside > share * inside.max(), connectivity=2)
        areas = _areas(cores)
        areas[cores[border]] = 0
        if areas.max():
            break
    else:
        return None
    seeds = np.where(border, 1, np.where(cores == areas.argmax(), 2, 0))
    parts = segmentation.watershed(-inside, seeds, mask=small, connectivity=2)
    if (parts == 1).sum() < 0.01 * small.sum():
        return None
    core = np.kron(parts == 2, np.ones((step, step), dtype=bool))[: joined.shape[0], : joined.shape[1]]
    labels = measure.label(core & joined, connectivity=2)
    part: Mask = labels == _areas(labels).argmax()
    return part


def _fine_mask(contrast: Field, coarse: Rim, region: Mask, floor: float, noise: float) -> tuple[Mask, Field, float]:
    """Mask, rim contrast and blur of the colony in `region`: the last line of the module docstring, three times over.

    Between rounds the rim's contrast is measured anew on the mask just found, each pixel divided by what blur leaves of
    the mask there and outliers beyond two deviations ρ dropped, and so is the blur.
    """
    window = tuple(
        slice(max(0, part.start - 16), part.stop + 16) for part in ndimage.find_objects(region.astype(np.uint8))[0]
    )
    contrast, near, mask = contrast[window], region[window], coarse.mask[window] & region[window]
    rim, slope = coarse.contrast[window], ndimage.gaussian_gradient_magnitude(contrast, SLOPE_SCALE)
    slope = ndimage.maximum_filter(slope, 3)
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
    speck = int(np.clip(round(40 * scatter), 2, 8))
    mask = _without_specks(mask, speck)
    whole, whole_rim = np.zeros(region.shape, dtype=bool), coarse.contrast.copy()
    whole[window] = ~_without_specks(~mask, speck, connectivity=1)
    whole_rim[window] = rim
    return whole, whole_rim, blur


def _outline(mask: Mask) -> Mask:
    return mask & ~ndimage.binary_erosion(mask)


def _blur(rim: Field, slope: Field, mask: Mask) -> float:
    """Standard deviation of the blur, 0.5 to 2 px: a blurred step of height c has the slope c / (√(2π) s) at most."""
    edge = _outline(mask)
    width = float(np.median(rim[edge] / np.maximum(slope[edge], 1e-6 * rim[edge]))) / sqrt(2 * pi)
    return min(sqrt(max(width**2 - SLOPE_SCALE**2, 0.25)), 2.0)


def _rim_of(contrast: Field, mask: Mask, rim: Field, blur: float, noise: float) -> tuple[Field, float]:
    """c(x) and the scatter ρ of contrast / c over the rim of a mask; that of noise alone where blur leaves no rim."""
    covered = _smooth(mask, blur)
    band = (covered > 0.75) & (ndimage.distance_transform_cdt(mask) <= RIM_DEPTH + RIM_WIDTH)
    scatter = noise / float(np.median(rim[mask]))
    for _ in range(2):
        residual = contrast / rim - covered
        if not band.any():
            break
        scatter = _spread(residual[band] - np.median(residual[band]))
        weight = (band & (np.abs(residual) < 2 * max(scatter, 1e-3))).astype(np.float32)
        known = _nearby(weight * covered)
        rim = np.where(known > 1e-3, _nearby(weight * contrast) / np.maximum(known, np.float32(1e-3)), rim)
    return rim, scatter


def _deblurred(data: Field, blur: float, smoothness: float, share: Field | None, steps: int) -> Field:
    """φ of the module docstring by FISTA, from `share` or else the smoothed data (a sharp start would stay as it is).

    Ends early where all but 1 in 1000 pixels of the colony settle to 0.002; fine detail comes last.
    """
    target = _smooth(data, blur)
    share = np.clip(target, 0, 1) if share is None else share
    ahead, momentum = share, 1.0
    for _ in range(steps):
        descent = target - _smooth(ahead, sqrt(2) * blur)
        descent += smoothness * ndimage.laplace(ahead, mode="nearest")
        new = np.clip(ahead + descent / (1 + 8 * smoothness), 0, 1).astype(np.float32, copy=False)
        momentum, last = (1 + sqrt(1 + 4 * momentum**2)) / 2, momentum
        ahead = new + np.float32((last - 1) / momentum) * (new - share)
        moving = np.count_nonzero(np.abs(new - share) > 0.002)
        share = new
        if moving <= 1e-3 * np.count_nonzero(share > 0.5):
            break
    return share


def _doubts(mask: Mask, seen: Mask, threshold: float, noise: float, blur: float, name: str) -> list[str]:
    """Warnings about a mask; `InputError` where it leaves no background."""
    area, room = int(mask.sum()), int(seen.sum())
    if area > 0.95 * room:
        raise InputError(f"{name}: colony on {area / room:.0%} of the image, need background around it")
    edge = ndimage.binary_dilation(~seen, EIGHT)
    edge[[0, -1], :] = edge[:, [0, -1]] = True
    doubts = {
        "touches the border": bool((mask & edge).any()),
        "low contrast": threshold < 2 * noise,
        "tiny": area < 100,
        "fills the image": area > 0.8 * room,
        "blurred": blur > 1.8,
    }
    return [doubt for doubt, holds in doubts.items() if holds]
