"""Micrographs to numbers: one image, or all frames of a data set."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from skimage.transform import rescale

from yeastfit.errors import InputError
from yeastfit.measure.dataset import Dataset
from yeastfit.measure.images import Micrograph, read_micrograph
from yeastfit.measure.segmentation import Segmentation, segment
from yeastfit.measure.smooth import smooth_shape
from yeastfit.measure.statistics import Shape, measure_mask

SMOOTH = ("compactness", "radius", "area", "perimeter")  # what an image and a model can be compared in


@dataclass(frozen=True)
class Measured:
    """One micrograph, its mask and the mask's statistics in µm."""

    micrograph: Micrograph
    segmentation: Segmentation
    shape: Shape

    def row(self) -> dict[str, Any]:
        """Tidy row of a table."""
        shape, image = self.shape, self.micrograph
        return {
            "file": image.path.name,
            "um_per_pixel": image.pixel_size,
            "pixel_size_from": image.pixel_size_source,
            "area": shape.area,
            "perimeter": shape.perimeter,
            "outer_perimeter": shape.outer_perimeter,
            "compactness": shape.compactness,
            "outer_compactness": shape.outer_compactness,
            "radius": shape.radius,
            "max_radius": shape.max_radius,
            "objects": shape.object_count,
            "holes": shape.hole_count,
            "warnings": "; ".join(self.segmentation.warnings),
        }


def measure_file(path: str | Path, pixel_size: float | None = None) -> Measured:
    """Read, segment and measure one micrograph. Raises `InputError`; see `read_micrograph` and `segment`."""
    micrograph = read_micrograph(path, pixel_size)
    segmentation = segment(micrograph.pixels, name=str(path))
    return Measured(micrograph, segmentation, measure_mask(segmentation.mask, micrograph.pixel_size))


def measure_dataset(dataset: Dataset, progress: Callable[[int, int], None] | None = None) -> list[Measured]:
    """Every frame, in the manifest's order."""
    results = []
    for frame in dataset.frames:
        results.append(measure_file(frame.path, frame.pixel_size))
        if progress:
            progress(len(results), len(dataset.frames))
    return results


def smooth_statistics(
    mask: Bool[np.ndarray, "row column"], pixel_size: float, *, spacing: float, smoothing: float
) -> dict[str, float]:
    """The statistics of `smooth_shape` of a mask, resampled from pixels of `pixel_size` to a grid of `spacing`.

    pixel_size, spacing and smoothing in one unit of length, which is the result's. A model measured on the same grid
    with the same smoothing can be compared. Raises `InputError` where pixels are too coarse for that.
    """
    if pixel_size > 2.5 * spacing:
        raise InputError(
            f"pixel size is {pixel_size:.3g}, at most {2.5 * spacing:.3g} resolves a cell well enough to fit"
        )
    scale = pixel_size / spacing
    phi = np.pad(mask, math.ceil(2 / scale)).astype(np.float32)
    if abs(scale - 1) > 1e-3:
        phi = rescale(phi, scale, order=1, anti_aliasing=scale < 1)
    values = _smooth_shape(jnp.asarray(phi), spacing, smoothing)
    return {name: float(values[name]) for name in SMOOTH}


_smooth_shape = jax.jit(smooth_shape, static_argnums=(1, 2))


def replicate_curves(
    dataset: Dataset, rows: list[dict[str, float]], names: tuple[str, ...]
) -> tuple[dict[str, Float[np.ndarray, "replicate time"]], Float[np.ndarray, " time"]]:
    """Rows of statistics, one per frame, as a curve per replicate over the rising hours; NaN where one is missing."""
    hours = sorted({frame.hours for frame in dataset.frames})
    replicates = sorted({frame.replicate for frame in dataset.frames})
    curves = {name: np.full((len(replicates), len(hours)), np.nan) for name in names}
    for frame, row in zip(dataset.frames, rows, strict=True):
        for name in names:
            curves[name][replicates.index(frame.replicate), hours.index(frame.hours)] = row[name]
    return curves, np.array(hours)
