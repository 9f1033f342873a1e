"""A folder of results of `yeastfit measure`: its photographs, their outlines, and what is doubtful about them."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool

from yeastfit.corrections.manifest_masks import name_mask
from yeastfit.errors import InputError
from yeastfit.measure.outlining.doubts import BY_HAND, DOUBTS
from yeastfit.measure.reading.batch_inputs import InputImage, dataset_images
from yeastfit.measure.reading.dataset import read_dataset
from yeastfit.measure.reading.images import read_image
from yeastfit.measure.reading.outline_files import check_outline, pixel_at, read_outline, write_mask
from yeastfit.results.contents import MANIFEST, Contents, check_finished
from yeastfit.storage import read_json, written_whole
from yeastfit.text import short
from yeastfit.text_files import read_csv

CORRECTED = "corrected"  # folder of the data set in which corrected outlines are saved

Mask = Bool[np.ndarray, "row column"]


@dataclass(frozen=True)
class MeasuredPhotograph:
    """One photograph that was measured, or could not be.

    Attributes:
        image: The file, and what its manifest says of it.
        mask: What was measured; None where nothing could be outlined.
        pixel_size: In µm; None where nobody said it.
        doubts: Names of the warnings about the outline.
        error: Why it was not measured; empty where it was.
    """

    image: InputImage
    mask: Path | None
    pixel_size: float | None
    doubts: tuple[str, ...] = ()
    error: str = ""

    @property
    def doubtful(self) -> bool:
        """Whether somebody should look at the outline; not where its manifest names one, made by hand."""
        return bool(self.doubts or self.error) and BY_HAND not in self.doubts and self.image.outline is None

    @property
    def remarks(self) -> list[str]:
        """Everything to be doubted, in words."""
        own = [f"The manifest names an outline: {self.image.outline.name}."] if self.image.outline else []
        told = [f"{doubt}: {DOUBTS.get(doubt, '')}" for doubt in self.doubts]
        return [*([f"Not measured. {self.error}"] if self.error else []), *told, *own]

    @cached_property
    def pixels(self) -> npt.NDArray[Any]:
        """Grey values of the photograph. Raises `InputError` where it is no longer there, or no image."""
        return read_image(self.image.path, self.image.frame)

    def outline(self) -> Mask:
        """The outline that the next `measure` would take or, without one in the manifest, the last one found.

        Raises:
            InputError: It cannot be read, or does not fit the photograph.
        """
        shape = self.pixels.shape
        if self.image.outline is not None:
            return read_outline(self.image.outline, shape, self.image.options.seed_point)
        if self.mask is None or not self.mask.is_file():
            return np.zeros(shape, dtype=bool)
        found = read_image(self.mask) > 0
        if found.shape != shape:
            raise InputError(f"{self.mask}: is not of the size of {self.image.path}: measure it again")
        return found


@dataclass(frozen=True)
class MeasuredFolder:
    """Results of `yeastfit measure`.

    Attributes:
        path: The folder.
        manifest: Of the data set that was measured; None where there was none.
        photographs: In the order of the results, those that were not measured last.
    """

    path: Path
    manifest: Path | None
    photographs: tuple[MeasuredPhotograph, ...]

    @staticmethod
    def of(path: str | Path) -> "MeasuredFolder":
        """Read a folder.

        Arguments:
            path: The folder, or a file in it.

        Returns:
            What was measured; what the manifest of the data set says of it is read anew. No image is read.

        Raises:
            InputError: It holds no results of `yeastfit measure`, unfinished ones, or those of a version that did not
                write down where its photographs are; or they are no longer there.
        """
        path = Path(path)
        path = path if path.is_dir() else path.parent
        check_finished(path)
        if Contents.of(path).command != "measure":
            raise InputError(f"{path}: holds no results of yeastfit measure")
        record = read_json(path / MANIFEST)
        places = record.get("photographs")
        if not isinstance(places, dict):
            raise InputError(f"{path}: does not say where its photographs are: measure them again into this folder")
        manifest = path / record["dataset"] if record.get("dataset") else None
        images = _images(path, places, manifest, record.get("configuration", {}).get("frame"))
        found = tuple(_photographs(path, images))
        if not found:
            raise InputError(f"{path}: none of its photographs is in its data set any more: measure it again")
        return MeasuredFolder(path, manifest, found)

    def next_doubtful(self, after: int | None = None) -> int | None:
        """The next photograph that somebody should look at, from the first one on after the last; None for none."""
        numbers = [number for number, one in enumerate(self.photographs) if one.doubtful]
        later = [number for number in numbers if after is None or number > after]
        return next(iter([*later, *numbers]), None)

    def corrected(self, number: int, mask: Mask) -> "MeasuredFolder":
        """Save the outline of a photograph and name it in the manifest, so that the next `measure` takes it.

        Arguments:
            number: Of the photograph.
            mask: True on the colony.

        Returns:
            The folder, with this outline.

        Raises:
            InputError: There is no manifest, it cannot be read or written, or has lost the photograph or names a pixel
                of the colony that is not on the mask; or the mask is empty. Nothing is changed then.
        """
        photograph = self.photographs[number]
        if self.manifest is None:
            raise InputError(
                f"{self.path}: was measured without a manifest, in which outlines are named: write one, by hand or "
                "with yeastfit manifest, and measure again"
            )
        if not mask.any():
            raise InputError(f"{photograph.image.label}: nothing is painted, need the outline of a colony")
        if mask.all():
            raise InputError(f"{photograph.image.label}: the colony fills the image, need background")
        check_outline(mask, photograph.image.label)
        seed_point = photograph.image.options.seed_point
        if seed_point is not None and not mask[pixel_at(seed_point, mask.shape)]:
            raise InputError(
                f"{photograph.image.label}: the seed_point of its manifest, {seed_point[0]:g} {seed_point[1]:g}, is "
                "not on the colony: paint there, or take it out of the manifest"
            )
        folder = self.manifest.parent
        file = _free_place(folder, photograph)
        before = file.read_bytes() if file.is_file() else None
        with written_whole(file) as temporary:
            write_mask(temporary, mask, photograph.pixel_size)
            if not np.array_equal(read_outline(temporary, (mask.shape[0], mask.shape[1])), mask):
                raise InputError(
                    f"{photograph.image.label}: the colony covers two corners of the image or more, where masks have "
                    "their background: leave corners free, or take a larger part of the photograph"
                )
        try:
            name_mask(self.manifest, photograph.image.path, file.relative_to(folder).as_posix())
        except Exception:
            if before is None:
                file.unlink()
            else:
                file.write_bytes(before)
            raise
        now = replace(photograph, image=replace(photograph.image, outline=file))
        return replace(self, photographs=(*self.photographs[:number], now, *self.photographs[number + 1 :]))


def _images(folder: Path, places: dict[str, str], manifest: Path | None, frame: int | None) -> dict[str, InputImage]:
    """The images by their names in tables: as the manifest has them now, or where they were."""
    if manifest is None:
        found = [InputImage(folder / place, label, Path(label).stem) for label, place in places.items()]
    elif manifest.is_file():
        found = [image for image in dataset_images(read_dataset(manifest.parent)) if image.label in places]
    else:
        raise InputError(f"{manifest}: is not there any more, but was measured in {folder}: measure it again")
    return {image.label: replace(image, frame=frame) for image in found}


def _photographs(folder: Path, images: dict[str, InputImage]) -> list[MeasuredPhotograph]:
    """Measured ones, then those that failed, without those that have left the data set."""
    tables = [folder / name for name in ("measurements.csv", "failures.csv")]
    measured, failed = (read_csv(table)[1] if table.is_file() else [] for table in tables)
    found = []
    for where, row in [*measured, *failed]:
        image = images.get(row.get("file", ""))
        if image is None:
            continue
        mask = folder / row.get("mask", f"masks/{image.name}.png")
        if not mask.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"{where}: mask is {short(row['mask'])}, it must be in {folder}")
        doubts = tuple(filter(None, row.get("warnings", "").split("; ")))
        size = float(row["um_per_pixel"]) if "um_per_pixel" in row else image.pixel_size
        found.append(MeasuredPhotograph(image, mask, size, doubts, row.get("error", "")))
    return found


def _free_place(folder: Path, photograph: MeasuredPhotograph) -> Path:
    """Where to save in a data set: over the outline that was saved for it alone before, else where there is no file."""
    image, corrected = photograph.image, folder / CORRECTED
    own = image.outline
    if own is not None and own.parent == corrected and own.suffix == ".png":
        rows = [one.outline for one in read_dataset(folder).frames if one.outline is not None]
        if sum(one.resolve() == own.resolve() for one in rows) < 2:
            return own
    names = (f"{image.name}{f'_{k}' if k > 1 else ''}.png" for k in range(1, 10_000))
    return next(corrected / name for name in names if not (corrected / name).exists())
