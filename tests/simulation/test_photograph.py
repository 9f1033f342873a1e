"""Rendered colonies against closed forms, and what half contrast makes of their photographs."""

import errno
from collections.abc import Callable
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tifffile
from scipy.ndimage import distance_transform_edt

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import read_micrograph
from yeastfit.simulation.cell_coverage import coverage, true_mask
from yeastfit.simulation.photograph import KINDS, Optics, photograph, write_micrograph

PIXEL = 0.75  # µm
P, Q = 3.75, 2.7  # µm, half axes of a cell
PLAIN = Optics(gradient=0.0, curvature=0.0, texture=0.0, noise=0.0, specks=0.0)

Array = npt.NDArray[Any]
Cells = tuple[Array, Array, Array, Array]


def cells(centres: npt.ArrayLike, angles: npt.ArrayLike) -> Cells:
    angles = np.asarray(angles, dtype=float)
    count = np.ones(len(angles))
    return np.asarray(centres, dtype=float), np.stack([np.cos(angles), np.sin(angles)], 1), P * count, Q * count


def clump(seed: int, count: int = 60) -> Cells:
    """Overlapping cells, each budded on a random one before it."""
    rng = np.random.default_rng(seed)
    centres = np.zeros((1, 2))
    for angle in rng.uniform(0, 2 * pi, count - 1):
        mother = centres[rng.integers(len(centres))]
        centres = np.vstack([centres, mother + 6 * np.array([np.cos(angle), np.sin(angle)])])
    return cells(centres, rng.uniform(0, pi, count))


def single(seed: int) -> Cells:
    rng = np.random.default_rng(seed)
    return cells(rng.uniform(-0.4, 0.4, (1, 2)), rng.uniform(0, pi, 1))


def area(fraction: Array) -> float:
    return float(fraction.sum()) * PIXEL**2


# ------------------------------------------------------------------------------------------------------------- coverage


def test_area_of_an_ellipse_converges_with_supersampling() -> None:
    def error(supersample: int) -> float:
        ellipses = (coverage(*single(seed), 12.0, PIXEL, supersample)[0] for seed in range(20))
        return float(np.sqrt(np.mean([(area(fraction) / (pi * P * Q) - 1) ** 2 for fraction in ellipses])))

    assert error(4) < 0.005
    assert error(16) < 0.2 * error(2)


def test_thickness_is_the_volume_of_half_an_ellipsoid() -> None:
    _, thickness = coverage(*single(0), 12.0, PIXEL, 8)
    assert area(thickness) == pytest.approx(2 / 3 * pi * P * Q, rel=0.003)
    assert thickness.max() == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("angle", [0.3, 1.1, 2.0, 2.9])
def test_rotation_changes_neither_area_nor_volume(angle: float) -> None:
    still, turned = (coverage(*cells([[0, 0]], [each]), 12.0, PIXEL, 16) for each in (0, angle))
    assert turned[0].sum() == pytest.approx(still[0].sum(), rel=0.002)
    assert turned[1].sum() == pytest.approx(still[1].sum(), rel=0.002)


def test_a_quarter_turn_turns_the_image() -> None:
    centres, directions, p, q = clump(1, 12)
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    still = coverage(centres, directions, p, q, 60.0, PIXEL)
    turned = coverage(centres @ turn, directions @ turn, p, q, 60.0, PIXEL)
    for before, after in zip(still, turned, strict=True):
        np.testing.assert_allclose(np.rot90(before), after, atol=0.07)  # points on an outline may round either way
        assert np.abs(np.rot90(before) - after).mean() < 1e-4


def test_rows_go_down_and_columns_along_x() -> None:
    fraction, _ = coverage(*cells([[20, 10]], [0]), 60.0, PIXEL)
    row, column = (float((fraction * index).sum() / fraction.sum()) for index in np.indices(fraction.shape))
    assert fraction.shape == (80, 80)
    assert column == pytest.approx(20 / PIXEL + 39.5, abs=0.02)
    assert row == pytest.approx(-10 / PIXEL + 39.5, abs=0.02)


def test_an_overlap_counts_once_in_the_union_and_twice_in_the_layers() -> None:
    once, layer = coverage(*cells([[0.3, 0.2]], [0.4]), 12.0, PIXEL)
    twice, layers = coverage(*cells([[0.3, 0.2]] * 2, [0.4, 0.4]), 12.0, PIXEL)
    np.testing.assert_array_equal(once, twice)
    np.testing.assert_allclose(layers, 2 * layer)
    apart = coverage(*cells([[-8, 0], [8, 0]], [0, 1]), 40.0, PIXEL)[0]
    assert area(apart) == pytest.approx(2 * pi * P * Q, rel=0.01)


def test_nothing_is_drawn_of_cells_outside_or_without_size() -> None:
    fraction, thickness = coverage(*cells([[100, 0], [0, -100]], [0, 1]), 30.0, PIXEL)
    assert not fraction.any()
    assert not thickness.any()
    shrunk = coverage(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2), np.zeros(2), 30.0, PIXEL)
    assert not np.any(shrunk)
    half = coverage(*cells([[15, 0]], [0]), 30.0, PIXEL, 8)[0]
    assert area(half) == pytest.approx(pi * P * Q / 2, rel=0.01)


def test_an_empty_colony_and_an_extent_that_is_no_multiple() -> None:
    fraction, thickness = coverage(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), 10.0, 0.75)
    assert fraction.shape == thickness.shape == (13, 13)
    assert not true_mask(fraction).any()


# ----------------------------------------------------------------------------------------------------------- photograph


def half_contrast_area(pixels: Array, mask: Array, background: float) -> float:
    """µm² darker than half the median contrast 2 to 4 px inside, dust left out."""
    contrast = background - pixels.astype(float)
    inside = distance_transform_edt(mask)
    near = distance_transform_edt(~mask) < 5
    reference = np.median(contrast[(inside >= 2) & (inside <= 4)])
    return area((contrast > reference / 2) & near)


@pytest.mark.parametrize(("colony", "count", "extent"), [(single, 24, 60.0), (clump, 6, 120.0)])
def test_half_contrast_gives_the_true_area(colony: Callable[[int], Cells], count: int, extent: float) -> None:
    """Within 2 % in the mean, blur and rim being balanced; one small cell scatters by its pixels, texture and noise."""
    optics = Optics(gradient=0.0, curvature=0.0)
    errors = []
    for seed in range(count):
        fraction, thickness = coverage(*colony(seed), extent, PIXEL)
        pixels = photograph(fraction, thickness, PIXEL, np.random.default_rng(seed), optics)
        mask = true_mask(fraction)
        errors.append(half_contrast_area(pixels, mask, optics.background) / area(mask) - 1)
    assert abs(np.mean(errors)) < 0.02
    assert np.std(errors) < (0.05 if colony is single else 0.01)


def test_layers_darken_and_saturate() -> None:
    fraction = np.ones((9, 9))
    greys = [
        photograph(fraction, layers * fraction, PIXEL, np.random.default_rng(0), PLAIN).mean() for layers in range(1, 6)
    ]
    steps = -np.diff(greys)
    assert Optics().background - greys[0] > 60
    assert (steps > 0).all()
    assert (np.diff(steps) <= 0).all()


def test_a_colony_is_darker_than_its_field() -> None:
    fraction, thickness = coverage(*clump(3), 120.0, PIXEL)
    pixels = photograph(fraction, thickness, PIXEL, np.random.default_rng(3))
    assert pixels.dtype == np.uint8
    field, colony = pixels[fraction == 0], pixels[fraction == 1]
    assert abs(field.mean() - Optics().background) < 3
    assert field.mean() - colony.mean() > 55
    assert np.percentile(colony, 99) < np.percentile(field, 1) - 20


def test_an_empty_field_has_the_stated_light_and_noise() -> None:
    empty = np.zeros((200, 200))
    field = photograph(empty, empty, PIXEL, np.random.default_rng(0), replace(PLAIN, noise=3.0)).astype(float)
    assert field.mean() == pytest.approx(155, abs=0.1)
    assert field.std() == pytest.approx(np.hypot(3, 1 / np.sqrt(12)), rel=0.02)
    uneven = replace(PLAIN, gradient=0.06, curvature=0.03)
    light = photograph(empty, empty, PIXEL, np.random.default_rng(0), uneven).astype(float)
    assert light.mean() == pytest.approx(155, abs=0.2)
    assert 0.05 < np.ptp(light) / 155 < 0.2


def test_blur_keeps_the_light() -> None:
    fraction, thickness = coverage(*single(0), 30.0, PIXEL)
    sharp, blurred = (
        photograph(fraction, thickness, PIXEL, np.random.default_rng(0), replace(PLAIN, blur=blur)).astype(float)
        for blur in (0.0, 1.0)
    )
    lost = [float((155 - image).sum()) for image in (sharp, blurred)]
    assert lost[1] == pytest.approx(lost[0], rel=0.02)
    assert np.abs(np.diff(blurred)).max() < 0.6 * np.abs(np.diff(sharp)).max()


def test_the_same_seed_gives_the_same_picture() -> None:
    fraction, thickness = coverage(*clump(4), 120.0, PIXEL)
    first, again, other = (photograph(fraction, thickness, PIXEL, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_dust_keeps_away_from_the_colony_and_the_border() -> None:
    fraction, thickness = coverage(*clump(5), 120.0, PIXEL)
    dusty = replace(PLAIN, specks=40.0)
    clean, dust = (
        photograph(fraction, thickness, PIXEL, np.random.default_rng(5), optics) for optics in (PLAIN, dusty)
    )
    changed = clean != dust
    assert changed.sum() > 100
    assert distance_transform_edt(fraction == 0)[changed].min() > 4
    assert not changed[[0, -1]].any()
    assert not changed[:, [0, -1]].any()
    assert (dust[changed] < clean[changed]).all()


def test_dust_is_left_out_where_there_is_no_room() -> None:
    full = np.ones((20, 20))
    pixels = photograph(full, full, PIXEL, np.random.default_rng(0), replace(PLAIN, specks=40.0))
    assert np.ptp(pixels) == 0


# ---------------------------------------------------------------------------------------------------------------- files


@pytest.fixture
def pixels() -> Array:
    fraction, thickness = coverage(*clump(6, 12), 40.0, PIXEL)
    return photograph(fraction, thickness, PIXEL, np.random.default_rng(6))


@pytest.mark.parametrize("pixel_size", [0.75, 1.5500764525993882, 1 / 3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_states_its_pixels_and_their_size(tmp_path: Path, pixels: Array, kind: str, pixel_size: float) -> None:
    path = tmp_path / "colony.tif"
    write_micrograph(path, pixels, pixel_size, kind)
    micrograph = read_micrograph(path)
    np.testing.assert_array_equal(micrograph.pixels, pixels)
    assert micrograph.pixel_size == pytest.approx(pixel_size, rel=1e-5)
    assert {"tiff": "centimetre", "imagej": "micron", "ome": "OME"}[kind] in micrograph.pixel_size_source


def test_tags_are_those_of_each_kind(tmp_path: Path, pixels: Array) -> None:
    for kind in KINDS:
        write_micrograph(tmp_path / kind, pixels, PIXEL, kind)
    with tifffile.TiffFile(tmp_path / "tiff") as tif:
        tags: Any = tif.pages.first.tags
        assert tags["XResolution"].value[0] / tags["XResolution"].value[1] == pytest.approx(1e4 / PIXEL)
        assert tags["ResolutionUnit"].value == 3
        assert not tif.is_imagej
        assert not tif.is_ome
        assert tags["Compression"].value == 8
    with tifffile.TiffFile(tmp_path / "imagej") as tif:
        tags = tif.pages.first.tags
        assert (tif.imagej_metadata or {})["unit"] == "micron"
        assert tags["YResolution"].value[0] / tags["YResolution"].value[1] == pytest.approx(1 / PIXEL)
    with tifffile.TiffFile(tmp_path / "ome") as tif:
        assert tif.is_ome
        assert 'PhysicalSizeX="0.75"' in (tif.ome_metadata or "")
        assert 'PhysicalSizeYUnit="µm"' in (tif.ome_metadata or "")
        assert tif.pages.first.tags["Compression"].value == 8


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_image_makes_the_same_bytes(tmp_path: Path, pixels: Array, kind: str) -> None:
    for name in ("a.tif", "b.tif", "b.tif"):
        write_micrograph(tmp_path / name, pixels, PIXEL, kind)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tif", "b.tif"]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, pixels: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "colony.tif"
    path.write_bytes(b"old")

    def fail(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "disk full")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_micrograph(path, pixels, PIXEL, "tiff")
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"old"]


# --------------------------------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"centres": np.zeros((2, 3))}, r"centres: got shape \[2, 3\]"),
        ({"centres": np.full((2, 2), np.nan)}, "centres: 4 of 4 values are NaN"),
        ({"directions": np.ones((2, 2))}, "directions: got a vector of length 1.41"),
        ({"directions": np.ones((3, 2))}, r"directions: got shape \[3, 2\], need \[2, 2\]"),
        ({"half_lengths": np.ones((2, 1))}, "half_lengths: got shape"),
        ({"half_widths": np.array([1.0, -2.0])}, "half_widths: got -2"),
        ({"extent": 0.0}, "extent: got 0.0"),
        ({"extent": 1e6}, "extent: got 1e[+]06"),
        ({"extent": 0.1}, "extent: got 0.1"),
        ({"pixel_size": float("nan")}, "pixel_size: got nan"),
        ({"supersample": 0}, "supersample: got 0"),
    ],
)
def test_bad_cells_are_refused(changes: dict[str, Any], message: str) -> None:
    centres, directions, p, q = cells([[0, 0], [1, 1]], [0, 1])
    good: dict[str, Any] = {"centres": centres, "directions": directions, "half_lengths": p, "half_widths": q}
    good |= {"extent": 30.0, "pixel_size": PIXEL}
    with pytest.raises(InputError, match=f"^{message}"):
        coverage(**{**good, **changes})


@pytest.mark.parametrize(
    ("fraction", "thickness", "pixel_size", "message"),
    [
        (np.full((4, 4), 1.2), np.ones((4, 4)), PIXEL, "fraction: got 1.2 to 1.2"),
        (np.ones((4, 4)), np.ones((4, 5)), PIXEL, r"thickness: got shape \[4, 5\], need \[4, 4\]"),
        (np.ones((4, 4)), -np.ones((4, 4)), PIXEL, "thickness: got -1"),
        (np.ones(4), np.ones(4), PIXEL, r"fraction: got shape \[4\]"),
        (np.ones((0, 4)), np.ones((0, 4)), PIXEL, "fraction: got shape .* need at least one pixel"),
        (np.ones((4, 4)), np.ones((4, 4)), -1.0, "pixel_size: got -1.0"),
    ],
)
def test_bad_coverage_is_refused(fraction: Array, thickness: Array, pixel_size: float, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        photograph(fraction, thickness, pixel_size, np.random.default_rng(0))


@pytest.mark.parametrize(
    "field",
    [
        {"speck_darkness": (0.1, 1.5)},
        {"blur": -1.0},
        {"noise": float("nan")},
        {"background": 300.0},
        {"speck_radius": (2.0, 1.0)},
        {"gradient": 2.0},
    ],
)
def test_bad_optics_are_refused(field: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"^optics {next(iter(field))}: got "):
        Optics(**field)


def test_a_bad_file_is_refused(tmp_path: Path, pixels: Array) -> None:
    path = tmp_path / "colony.tif"
    with pytest.raises(InputError, match=r"^kind: got 'png', need one of tiff, imagej, ome"):
        write_micrograph(path, pixels, PIXEL, "png")
    with pytest.raises(InputError, match=r"^pixels: got shape .* of float64, need uint8"):
        write_micrograph(path, pixels.astype(float), PIXEL)
    with pytest.raises(InputError, match=r"^pixel_size: got 0\.0"):
        write_micrograph(path, pixels, 0.0)
    with pytest.raises(InputError, match="missing is no folder"):
        write_micrograph(tmp_path / "missing" / "colony.tif", pixels, PIXEL)
    assert not list(tmp_path.iterdir())
