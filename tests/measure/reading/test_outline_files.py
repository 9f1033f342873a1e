"""Outlines made elsewhere: which object counts, what is refused, and a data set that brings them."""

import os
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy import ndimage

from yeastfit import InputError, measure_dataset, measure_file, read_dataset
from yeastfit.measure.reading.binary_images import recognise_labels
from yeastfit.measure.reading.outline_files import read_outline

SHAPE = (60, 80)
LARGE, SMALL = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
LARGE[10:40, 10:50], SMALL[45:55, 60:75] = True, True
LABELS = (7 * LARGE + 2 * SMALL).astype(np.uint16)


def photograph(path: Path) -> Path:
    """Noise, without any colony in it."""
    Image.fromarray(np.random.default_rng(0).integers(180, 200, SHAPE).astype(np.uint8)).save(path)
    return path


def written(path: Path) -> Path:
    """The labels in the format of the suffix."""
    if path.suffix == ".npy":
        np.save(path, {"masks": LABELS, "filename": "a.tif", "diameter": np.float64(30.0)}, allow_pickle=True)  # type: ignore[arg-type]
    elif path.suffix in (".roi", ".zip"):
        roifile = pytest.importorskip("roifile")
        corners = [[[10, 10], [50, 10], [50, 40], [10, 40]], [[60, 45], [75, 45], [75, 55], [60, 55]]]
        regions = [roifile.ImagejRoi.frompoints(np.array(one), name=str(k)) for k, one in enumerate(corners)]
        if path.suffix == ".roi":
            regions[0].tofile(path)
        else:
            roifile.roiwrite(path, regions)
    else:
        tifffile.imwrite(path, LABELS)
    return path


@pytest.mark.parametrize("name", ["labels.tif", "cells_seg.npy", "colony.zip"])
def test_the_object_at_the_seed_point_counts_else_the_largest(name: str, tmp_path: Path) -> None:
    path = written(tmp_path / name)
    np.testing.assert_array_equal(read_outline(path, SHAPE), LARGE)
    np.testing.assert_array_equal(read_outline(path, SHAPE, (65, 50)), SMALL)
    with pytest.raises(InputError, match="no object at seed_point 2, 3"):
        read_outline(path, SHAPE, (2, 3))


@pytest.mark.parametrize("name", ["labels.tif", "cells_seg.npy", "labels.npy"])
def test_zero_is_no_label_though_a_label_holds_most_corners(name: str, tmp_path: Path) -> None:
    labels = np.ones(SHAPE, np.uint8)
    labels[30:, 50:] = 0
    labels[40:45, 60:70] = 2
    one = labels == 1
    if name.endswith("_seg.npy"):
        labels[labels == 2] = 0  # there is one object only
        np.save(tmp_path / name, {"masks": labels}, allow_pickle=True)  # type: ignore[arg-type]
    elif name.endswith(".npy"):
        np.save(tmp_path / name, labels)
    else:
        tifffile.imwrite(tmp_path / name, labels)
    np.testing.assert_array_equal(read_outline(tmp_path / name, SHAPE), one)


@pytest.mark.parametrize("name", ["labels.tif", "labels.png"])
def test_labels_of_a_palette_are_its_numbers(name: str, tmp_path: Path) -> None:
    """Whatever the colours are: these two have one luminance."""
    labels = (LARGE + 2 * SMALL).astype(np.uint8)
    colours = np.zeros((3, 256), np.uint16)
    colours[:, 1], colours[:, 2] = (0, 200 << 8, 0), (0, 200 << 8, 0)
    if name.endswith(".tif"):
        tifffile.imwrite(tmp_path / name, labels, photometric="palette", colormap=colours)
    else:
        picture = Image.fromarray(labels, "P")
        picture.putpalette((colours >> 8).astype(np.uint8).T.tobytes())
        picture.save(tmp_path / name)
    np.testing.assert_array_equal(read_outline(tmp_path / name, SHAPE), LARGE)


def test_an_outline_of_few_pixels_is_refused(tmp_path: Path) -> None:
    for count in (1, 4, 5):
        mask = np.zeros(SHAPE, np.uint8)
        mask[20, 20 : 20 + count] = 255
        Image.fromarray(mask).save(tmp_path / f"{count}.png")
    for count in (1, 4):
        with pytest.raises(
            InputError, match=rf"{count}\.png: the colony of the mask has {count} pixels, need at least 5"
        ):
            read_outline(tmp_path / f"{count}.png", SHAPE)
    assert read_outline(tmp_path / "5.png", SHAPE).sum() == 5


def test_a_single_region_is_filled(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_outline(written(tmp_path / "one.roi"), SHAPE), LARGE)


class Program:
    """What a pickle can hold: a call of anything."""

    def __init__(self, what: str) -> None:
        self.what = what

    def __reduce__(self) -> Any:
        return os.system, (self.what,)


def test_a_pickle_that_runs_a_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "evil_seg.npy"
    np.save(path, {"masks": LABELS, "more": Program(f"touch {tmp_path / 'ran'}")}, allow_pickle=True)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"holds posix\.system, which is not read: save the masks as PNG or TIFF"):
        read_outline(path, SHAPE)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(("name", "content"), [("a.npy", b"nonsense"), ("a.roi", b"nonsense"), ("a.zip", b"PK")])
def test_damaged_files_are_one_line(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match="cannot be read"):
        read_outline(tmp_path / name, SHAPE)


def test_an_outline_of_another_size_or_without_an_object_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "small.tif", LABELS[:30])
    with pytest.raises(InputError, match="an outline of 80 x 30 pixels, need 80 x 60 as its photograph has"):
        read_outline(tmp_path / "small.tif", SHAPE)
    tifffile.imwrite(tmp_path / "empty.tif", np.zeros(SHAPE, np.uint8))
    with pytest.raises(InputError, match="holds no object"):
        read_outline(tmp_path / "empty.tif", SHAPE)


def test_a_data_set_brings_outlines_beside_its_photographs(tmp_path: Path) -> None:
    photograph(tmp_path / "a.png")
    written(tmp_path / "a.tif")
    (tmp_path / "manifest.csv").write_text(
        "file,replicate,hours,um_per_pixel,mask,seed_point\na.png,1,3,0.5,a.tif,\na.png,2,3,0.5,a.tif,65 50\n"
    )
    first, second = measure_dataset(read_dataset(tmp_path))
    np.testing.assert_array_equal(first.segmentation.mask, LARGE)
    np.testing.assert_array_equal(second.segmentation.mask, SMALL)
    assert first.row()["warnings"] == "corrected by hand"
    assert first.shape.area == 0.25 * LARGE.sum()
    (tmp_path / "manifest.csv").write_text("file,replicate,hours,um_per_pixel,mask\na.png,1,3,0.5,b.tif\n")
    with pytest.raises(InputError, match=r"line 2: there is no file b\.tif"):
        read_dataset(tmp_path)


def test_a_label_image_is_no_photograph(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "labels.tif", LABELS)
    found = measure_file(tmp_path / "labels.tif", 0.5)
    np.testing.assert_array_equal(found.segmentation.mask, LARGE)
    assert "several objects" in found.segmentation.warnings
    ilastik = np.where(LARGE, 2, np.where(SMALL, 3, 1)).astype(np.uint8)
    assert recognise_labels(ilastik) is not None
    noise = np.random.default_rng(1).integers(0, 4, SHAPE)
    assert recognise_labels(noise) is None, "noise fills no areas"
    row, column = np.indices(SHAPE)
    blurred = np.rint(200 / (1 + np.exp(25 - np.hypot(row - 30, column - 40)))).astype(np.uint8)
    assert recognise_labels(blurred) is None, "levels of a blurred edge are no labels"


def test_a_selection_of_many_corners_and_holes_is_filled_at_once(tmp_path: Path) -> None:
    """ImageJ's composite selections are paths, those inside others holes."""
    roifile = pytest.importorskip("roifile")
    turn = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    paths = [150 + 120 * circle, 150 + 60 * circle, 150 + 20 * circle]
    one = roifile.ImagejRoi.frompoints(paths[0])
    one.roitype, one.n_coordinates = roifile.ROI_TYPE.RECT, 0
    one.subpixel_coordinates = one.integer_coordinates = None
    steps = [np.column_stack([np.r_[0, np.ones(len(path) - 1)], path]).ravel() for path in paths]
    one.multi_coordinates = np.concatenate([np.r_[step, 4.0] for step in steps]).astype(np.float32)
    one.shape_roi_size = len(one.multi_coordinates)
    one.tofile(tmp_path / "holes.roi")
    row, column = np.indices((300, 300))
    away = np.hypot(row + 0.5 - 150, column + 0.5 - 150)
    found = read_outline(tmp_path / "holes.roi", (300, 300))
    np.testing.assert_array_equal(found, (away < 120) & ~((away < 60) & (away >= 20)))


@pytest.mark.parametrize("corner", [np.nan, np.inf])
def test_a_selection_with_a_corner_that_is_no_number_is_refused(corner: float, tmp_path: Path) -> None:
    roifile = pytest.importorskip("roifile")
    one = roifile.ImagejRoi.frompoints(np.array([[10, 10], [50.5, 10], [50, 40], [10, 40]], np.float32))
    one.subpixel_coordinates[2, 0] = corner
    one.tofile(tmp_path / "a.roi")
    with pytest.raises(InputError, match=r"a\.roi: a corner of a selection is no finite number"):
        read_outline(tmp_path / "a.roi", SHAPE)


def test_specks_beside_a_colony_are_objects_of_a_label_image(tmp_path: Path) -> None:
    """As `scipy.ndimage.label` numbers them: many are too small to fill an area."""
    specks = LARGE.copy()
    specks[2:60:6, 1] = specks[2:60:12, 2] = True
    labels, count = ndimage.label(specks)
    assert count > 8
    tifffile.imwrite(tmp_path / "labels.tif", labels.astype(np.uint16))
    np.testing.assert_array_equal(read_outline(tmp_path / "labels.tif", SHAPE), LARGE)


@pytest.mark.parametrize("kind", ["ANGLE", "POINT", "POLYLINE", "LINE"])
def test_selections_that_are_no_areas_are_refused(kind: str, tmp_path: Path) -> None:
    roifile = pytest.importorskip("roifile")
    region = roifile.ImagejRoi.frompoints(np.array([[2, 2], [12, 3], [7, 11]]))
    region.roitype = roifile.ROI_TYPE[kind]
    region.tofile(tmp_path / "a.roi")
    with pytest.raises(InputError, match=f"no area \\({kind.lower()}\\), need freehand, oval, polygon, rect, traced"):
        read_outline(tmp_path / "a.roi", SHAPE)


def test_masks_that_were_compressed_are_masks_and_photographs_are_none(tmp_path: Path) -> None:
    """JPEG leaves grey levels around black and white; those of a photograph, or of soft edges, are no labels."""
    y, x = np.mgrid[:200, :300]
    disc = np.hypot(x - 150, y - 100) < 60
    Image.fromarray(np.where(disc, 255, 0).astype(np.uint8)).save(tmp_path / "mask.jpg", quality=90)
    found = read_outline(tmp_path / "mask.jpg", disc.shape)
    assert (found != disc).sum() < 20
    soft = np.clip(255 * (0.5 - (np.hypot(x - 150, y - 100) - 60) / 40), 0, 255).astype(np.uint8)
    noisy = np.random.default_rng(0).normal(120, 20, disc.shape).clip(0, 255).astype(np.uint8)
    for name, image in (("soft.png", soft), ("photograph.png", noisy)):
        Image.fromarray(image).save(tmp_path / name)
        with pytest.raises(InputError, match=f"{name}: neither black and white nor a label image"):
            read_outline(tmp_path / name, disc.shape)


def test_small_files_take_little_memory(tmp_path: Path) -> None:
    """A pickle of 137 bytes that asks for 2 GB, and a label image of four thousand labels: 1 MB each would be 4 GB."""
    crafted = b"\x80\x04Nr" + struct.pack("<I", 0x0FFFFFFF) + b"."
    with (tmp_path / "a_seg.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
        file.write(crafted)
    with pytest.raises(InputError, match="it asks for more memory than it can fill"):
        read_outline(tmp_path / "a_seg.npy", SHAPE)
    labels = np.zeros((1000, 1000), dtype=np.uint16)
    for k in range(3900):
        labels[16 * (k // 62) + 4 : 16 * (k // 62) + 12, 16 * (k % 62) + 4 : 16 * (k % 62) + 12] = k + 1
    labels[4:12, 4:14] = 1
    tifffile.imwrite(tmp_path / "labels.tif", labels)
    tracemalloc.start()
    found = read_outline(tmp_path / "labels.tif", labels.shape)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(found, labels == 1)
    assert peak < 200e6
    assert read_outline(tmp_path / "labels.tif", labels.shape, (24.0, 8.0)).sum() == 64


def test_a_region_that_is_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    roifile = pytest.importorskip("roifile")
    region = roifile.ImagejRoi.frompoints(np.array([[2, 2], [12, 3], [17, 11], [4, 16]]))
    region.tofile(tmp_path / "whole.roi")
    whole = (tmp_path / "whole.roi").read_bytes()
    assert read_outline(tmp_path / "whole.roi", SHAPE).any()
    for size in range(0, int.from_bytes(whole[60:64], "big") + 64, 3):  # up to the end of the second header
        (tmp_path / "cut.roi").write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"cut\.roi: cannot be read as ImageJ's regions"):
            read_outline(tmp_path / "cut.roi", SHAPE)


def test_a_mask_of_several_pages_is_refused_without_an_option_that_is_not_for_it(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "stack.tif", np.zeros((3, *SHAPE), np.uint8), photometric="minisblack")
    with pytest.raises(InputError, match=r"stack\.tif: holds several pages or planes, need an outline of one image$"):
        read_outline(tmp_path / "stack.tif", SHAPE)
