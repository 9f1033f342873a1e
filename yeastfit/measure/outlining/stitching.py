"""Recognise steps in brightness that stitching and lamps leave: bands across the whole image, and tiles."""

from math import pi, sqrt

import numpy as np
import numpy.typing as npt
import scipy

from yeastfit.measure.outlining.mask_operations import NEIGHBOURS, Field, Mask

BAND_SCALE = 2.0  # px, of the derivative across a band
STEEP_BAND = 0.0015  # of the background's brightness, per px, of a median
STEEP = 0.004  # of the background's brightness, per px: steeper than lamps make it, flatter than any colony's edge
COMMON = 0.4  # share of bright pixels in a row or column, at least
BRIGHT = 0.6  # of the background's brightness: darker pixels are a colony's core or another object
STRAIGHT = 0.6  # share of a seam whose two sides face each other along an axis
SIMILAR = 0.75  # ratio of brightness between two tiles, at least
REACH = 0.04  # of the image's longer side: the widest seam


def row_and_column_steps(image: Field, visible: Mask, noise: float) -> Field:
    """Estimate by how much whole rows and columns differ in brightness, b(y) + a(x), with mean 0.

    b is the sum over rows of the median slope along y, where that is steep and three quarters of the bright pixels
    agree in its sign: a colony's edges, which lie in few columns of any row, do not move a median. Rows with few bright
    pixels, or within 8 px of such, are left as they are. a likewise, over columns.

    Arguments:
        image: Grey values.
        visible: Which pixels are not a frame.
        noise: Of single pixels.

    Returns:
        b(y) + a(x) in grey levels.
    """
    inner = visible
    if not visible.all():
        inner = scipy.ndimage.binary_erosion(visible, NEIGHBOURS, iterations=4, border_value=1)
    level = float(np.percentile(image[::4, ::4], 95))
    down = _steps_between_rows(image, inner, level, noise)
    right = _steps_between_rows(image.T, inner.T, level, noise)
    total = down[:, None] + right[None, :]
    return total - total.mean()


def _steps_between_rows(image: Field, visible: Mask, level: float, noise: float) -> npt.NDArray[np.float32]:
    wide = max(1, image.shape[1] // 100)
    used = image.shape[1] // wide * wide
    parts = image[:, :used].reshape(len(image), -1, wide).mean(axis=2, dtype=np.float32)
    slope = scipy.ndimage.gaussian_filter1d(parts, BAND_SCALE, axis=0, order=1)
    whole = visible[:, :used].reshape(len(image), -1, wide).all(axis=2)
    ordered = np.sort(np.where(whole & (parts > BRIGHT * level), slope, np.nan), axis=1)  # NaN last
    count = np.isfinite(ordered).sum(axis=1)
    lower, middle, upper = (
        np.take_along_axis(ordered, (part * np.maximum(count - 1, 0)).astype(int)[:, None], axis=1)[:, 0]
        for part in (0.25, 0.5, 0.75)
    )
    common = scipy.ndimage.binary_erosion(count > COMMON * ordered.shape[1], np.ones(17, dtype=bool), border_value=1)
    steep = max(STEEP_BAND * level, 4 * noise / sqrt(4 * sqrt(pi) * BAND_SCALE**3 * wide))
    band = common & (np.abs(middle) > steep) & (np.sign(lower) == np.sign(upper))
    return np.cumsum(np.where(band, middle, np.float32(0)), dtype=np.float32)


def add_tiles(background: Mask, labels: npt.NDArray[np.integer], image: Field, areas: npt.NDArray[np.int64]) -> Mask:
    """Add to the background the regions that only a straight seam along an axis separates from it.

    Arguments:
        background: What is known of it.
        labels: Of all regions.
        image: Grey values; brightness may differ across a seam by `SIMILAR`.
        areas: Of the labels, in pixels; regions below half a per cent of the image are left out.

    Returns:
        The background with its tiles.
    """
    waiting = [int(k) for k in np.flatnonzero(areas > 0.005 * labels.size) if not background[labels == k].any()]
    while waiting and background.any():
        away, (rows, columns) = scipy.ndimage.distance_transform_edt(~background, return_indices=True)
        tiles = [k for k in waiting if _is_tile(labels == k, away, rows, columns, image)]
        if not tiles:
            break
        background = background | np.isin(labels, tiles)
        waiting = [k for k in waiting if k not in tiles]
    return background


def _is_tile(
    region: Mask,
    away: npt.NDArray[np.floating],
    rows: npt.NDArray[np.integer],
    columns: npt.NDArray[np.integer],
    image: Field,
) -> bool:
    gap = float(away[region].min())
    if gap > REACH * max(region.shape):
        return False
    row, column = np.nonzero(region & (away < gap + 4))
    facing = rows[row, column], columns[row, column]
    straight = (np.abs(row - facing[0]) <= 1) | (np.abs(column - facing[1]) <= 1)
    ratio = float(np.median(image[row, column] / np.maximum(image[facing], 1e-6)))
    return bool(straight.mean() > STRAIGHT and SIMILAR < ratio < 1 / SIMILAR)
