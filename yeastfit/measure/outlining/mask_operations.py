"""Operations that several steps of segmentation share: objects of a mask, smoothing, a robust deviation."""

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy
from jaxtyping import Bool, Float32
from skimage import measure

Field = Float32[np.ndarray, "row column"]
Small = Float32[np.ndarray, "small_row small_column"]
Mask = Bool[np.ndarray, "row column"]

SMOOTHING = 0.8  # px, before a threshold on contrast
NEIGHBOURS = np.ones((3, 3), dtype=bool)


def border_pixels(field: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The outermost pixels of an image, corners twice."""
    return np.concatenate([field[0], field[-1], field[:, 0], field[:, -1]])


def areas_of(labels: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Number of pixels of every label; 0 for the background."""
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    return areas


def without_specks(mask: Mask, size: int, connectivity: int = 2) -> Mask:
    """A mask without its objects of at most `size` pixels."""
    labels = measure.label(mask, connectivity=connectivity)
    return np.asarray((areas_of(labels) > size)[labels])


def blurred(field: npt.NDArray[Any], width: float) -> Field:
    """Gaussian blur of `width` px, edges continued."""
    return scipy.ndimage.gaussian_filter(field.astype(np.float32, copy=False), width, mode="nearest", truncate=3.0)


def robust_deviation(values: npt.NDArray[Any]) -> float:
    """Standard deviation of normal values around 0, from the median of their absolute values."""
    return 1.4826 * float(np.median(np.abs(values))) if values.size else 0.0


def block_means(field: Field, step: int) -> Small:
    """Means over squares of `step` pixels; an incomplete last row or column is left out."""
    if step == 1:
        return field
    rows, columns = (size // step for size in field.shape)
    total = np.zeros((rows, columns), dtype=np.float32)
    for down in range(step):
        for right in range(step):
            total += field[down : rows * step : step, right : columns * step : step]
    return total / np.float32(step**2)
