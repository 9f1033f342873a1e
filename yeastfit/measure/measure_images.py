"""Measure micrographs: read, outline and measure one image, or all images of a data set."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from yeastfit.measure.outlining.segmentation import Segmentation, given_outline, segment
from yeastfit.measure.reading.dataset import Dataset
from yeastfit.measure.reading.images import Micrograph, read_micrograph
from yeastfit.measure.reading.outline_files import read_outline
from yeastfit.measure.reading.segmentation_options import AUTOMATIC, SegmentationOptions
from yeastfit.measure.statistics.measure_mask import Shape, measure_mask
from yeastfit.progress import Progress, silent


@dataclass(frozen=True)
class MeasuredImage:
    """One measured micrograph.

    Attributes:
        micrograph: The photograph.
        segmentation: Its mask, and doubts about it.
        shape: The mask's statistics in µm.
    """

    micrograph: Micrograph
    segmentation: Segmentation
    shape: Shape

    def row(self) -> dict[str, Any]:
        """The row of a table: the file, its pixel size, every statistic, and the doubts by name."""
        image = self.micrograph
        return {
            "file": image.path.name,
            "um_per_pixel": image.pixel_size,
            "pixel_size_from": image.pixel_size_source,
            **self.shape,
            "warnings": "; ".join(self.segmentation.warnings),
        }


def measure_file(
    path: str | Path,
    pixel_size: float | None = None,
    options: SegmentationOptions = AUTOMATIC,
    outline: str | Path | None = None,
    frame: int | None = None,
) -> MeasuredImage:
    """Measure one micrograph.

    Arguments:
        path: A TIFF, PNG or JPEG file.
        pixel_size: In µm per pixel; without it, the one that the file states.
        options: How to outline the colony.
        outline: A file with its outline, made elsewhere, which is then taken as it is: a mask or label image, ImageJ's
            .roi or .zip, cellpose's _seg.npy.
        frame: Of a time lapse or a z-stack, from 1 on; may be left out where there is one.

    Returns:
        The photograph, its mask and the mask's statistics.

    Raises:
        InputError: The file is no image, states no pixel size, or shows no colony.
    """
    micrograph = read_micrograph(path, pixel_size, frame)
    segmentation = outlined(micrograph.pixels, str(path), options, outline)
    return MeasuredImage(micrograph, segmentation, measure_mask(segmentation.mask, micrograph.pixel_size))


def outlined(
    pixels: npt.NDArray[Any], name: str, options: SegmentationOptions, outline: str | Path | None = None
) -> Segmentation:
    """Outline a colony, or take the outline that was made elsewhere; for arguments and errors see `measure_file`."""
    if outline is None:
        return segment(pixels, name=name, **options.as_arguments())
    shape = (pixels.shape[0], pixels.shape[1])
    options.check(shape, name)
    return given_outline(pixels, read_outline(Path(outline), shape, options.seed_point))


def measure_dataset(dataset: Dataset, progress: Progress = silent) -> list[MeasuredImage]:
    """Measure every micrograph of a data set.

    Arguments:
        dataset: From `read_dataset`.
        progress: Told after each image.

    Returns:
        The measured images in the manifest's order.

    Raises:
        InputError: One of them cannot be measured.
    """
    results = []
    for frame in dataset.frames:
        results.append(measure_file(frame.path, frame.pixel_size, frame.options, frame.outline))
        count = len(dataset.frames)
        progress(f"measured {len(results)} of {count}", len(results) / count)
    return results
