"""Doubts that have names, users who overrule, ready-made masks, and photographs that are hard."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from benchmarks.hard_cases import CASES, PLAIN, drawn_colony, photograph
from benchmarks.report import Report
from benchmarks.segmentation import INDICES, overlap, published, real, synthetic
from yeastfit.errors import InputError
from yeastfit.measure.outlining.doubts import DOUBTS
from yeastfit.measure.outlining.segmentation import segment
from yeastfit.text import quoted

SIDE = 200
Y, X = np.mgrid[:SIDE, :SIDE]


def disc(x: float, y: float, radius: float) -> np.ndarray:
    return np.hypot(X - x, Y - y) < radius


def taken(*discs: np.ndarray, contrast: float = 80, level: float = 150, blur: float = 1.0) -> np.ndarray:
    """A photograph of discs, with noise of 2.5 grey levels."""
    covered = ndimage.gaussian_filter(np.any(discs, axis=0) * 1.0, blur)
    image = level - contrast * covered + 2.5 * np.random.default_rng(0).standard_normal(covered.shape)
    return np.rint(image).clip(0, 255).astype(np.uint8)


COLONY = disc(100, 100, 40)
TWO = (disc(70, 100, 35), disc(150, 100, 25))
WIDE = np.pad(taken(disc(100, 100, 7)), 120, mode="reflect")

# ------------------------------------------------------------------------------------------------------------- doubts


# an image that leaves each doubt
DOUBTFUL: dict[str, np.ndarray] = {
    "several objects": taken(*TWO),
    "touches the border": taken(disc(100, 20, 45)),
    "cut off from an object at the border": taken(
        COLONY, (X < 30) & (abs(Y - 100) < 40), (X < 65) & (abs(Y - 100) < 4)
    ),
    "an object at the border is left out": taken(disc(120, 120, 15), (X < 60) & (Y < 50)),
    "low contrast": taken(COLONY, contrast=8),
    "saturated": taken(COLONY, level=251),
    "uneven light": (taken(COLONY) * (1 - X / 350)).astype(np.uint8),
    "blurred": taken(COLONY, blur=2.5),
    "tiny": taken(disc(100, 100, 4)),
    "nearly empty": WIDE,
    "fills the image": taken(disc(100, 100, 140) & (abs(X - 99.5) < 92) & (abs(Y - 99.5) < 92)),
    "polarity unsure": X < 100,
    "not quite black and white": np.where(np.random.default_rng(0).random(COLONY.shape) < 0.02, 3, 0) + 252 * COLONY,
}


@pytest.mark.parametrize("doubt", [doubt for doubt in DOUBTS if doubt != "corrected by hand"])
def test_every_doubt_is_reported(doubt: str) -> None:
    assert doubt in segment(DOUBTFUL[doubt]).warnings


@pytest.mark.parametrize("doubt", DOUBTS)
def test_every_doubt_is_a_sentence(doubt: str) -> None:
    assert DOUBTS[doubt][0].isupper()
    assert DOUBTS[doubt].endswith(".")


@pytest.mark.parametrize("added", [1000, 5000, 32768, 65280, -300])
def test_what_is_added_to_all_grey_values_changes_no_outline(added: int) -> None:
    """A camera's pedestal; ImageJ adds 32768 to signed numbers; what a float image holds may be negative."""
    photograph = taken(COLONY, disc(100, 150, 20)).astype(np.float32)
    plain, found = segment(photograph), segment(photograph + added)
    joint, either = (found.mask & plain.mask).sum(), (found.mask | plain.mask).sum()
    assert joint > 0.998 * either
    assert found.warnings == plain.warnings == ()
    assert abs(float(np.median(found.background)) - added - 150) < 1


@pytest.mark.parametrize("radius", [8, 20, 40, 70])
def test_clean_images_leave_no_doubt(radius: float) -> None:
    found = segment(taken(disc(100, 100, radius)))
    assert found.warnings == ()
    assert overlap(found.mask, disc(100, 100, radius)) > 0.96


def test_the_demo_leaves_no_doubt() -> None:
    """Every eleventh of 330 photographs; also near their true masks, in the mean."""
    report = Report("segmentation")
    synthetic(report, every=11)
    (rows,) = report.tables.values()
    assert [row["warnings"] for row in rows] == ["", "", ""]
    assert [row["images"] for row in rows] == [10, 10, 10]
    assert min(row["IoU median"] for row in rows) > 0.93
    assert np.mean([row["IoU median"] for row in rows]) > 0.95
    assert max(abs(row["compactness mean %"]) for row in rows) < 5


# ----------------------------------------------------------------------------------------------------------- overruled


def test_a_seed_point_chooses_the_object() -> None:
    image = taken(*TWO)
    for seed, true in (((70, 100), TWO[0]), ((150, 100), TWO[1]), ((150, 130), TWO[1])):
        found = segment(image, seed_point=seed)
        assert overlap(found.mask, true) > 0.97
        assert found.warnings == ()


def test_a_seed_point_chooses_an_object_at_the_border() -> None:
    image = DOUBTFUL["an object at the border is left out"]
    found = segment(image, seed_point=(20, 20))
    assert overlap(found.mask, (X < 60) & (Y < 50)) > 0.95
    assert found.warnings == ("touches the border",)
    parted = DOUBTFUL["cut off from an object at the border"]
    assert overlap(segment(parted, seed_point=(100, 100)).mask, COLONY) > 0.95
    assert overlap(segment(parted, seed_point=(10, 80)).mask, COLONY) < 0.8


def test_a_seed_point_chooses_an_object_of_a_mask() -> None:
    mask = np.any(TWO, axis=0)
    assert segment(mask).warnings == ("several objects",)
    found = segment(mask, seed_point=(150.0, 100.0))
    np.testing.assert_array_equal(found.mask, TWO[1])
    assert found.warnings == ()


def test_a_seed_point_far_from_everything_is_refused() -> None:
    for image in (taken(COLONY), COLONY):
        with pytest.raises(InputError, match=r"plate: no object at seed_point \(5, 5\).*within 10 pixels"):
            segment(image, name="plate", seed_point=(5, 5))


def test_a_threshold_is_the_contrast_that_counts() -> None:
    """A disc of contrast 80 within one of contrast 30: the user says which edge is meant."""
    inner = disc(100, 100, 25)
    image = taken(COLONY, contrast=30).astype(float) - 50 * ndimage.gaussian_filter(inner * 1.0, 1.0)
    for threshold, true in ((15.0, COLONY), (55, inner)):
        found = segment(image, threshold=threshold)
        assert overlap(found.mask, true) > 0.97
        assert found.threshold == threshold
    with pytest.raises(InputError, match="no colony"):
        segment(image, threshold=120)


def test_a_threshold_of_a_mask_lies_between_its_values() -> None:
    mask = COLONY * np.uint8(255)
    np.testing.assert_array_equal(segment(mask, threshold=100).mask, COLONY)
    with pytest.raises(InputError, match="threshold is 300, need less than the 255"):
        segment(mask, threshold=300)


@pytest.mark.parametrize("roi", [(105, 60, 195, 140), (110, 0, 200, 200)])
def test_nothing_is_seen_outside_the_roi(roi: tuple[int, int, int, int]) -> None:
    for image in (taken(*TWO), np.any(TWO, axis=0)):
        found = segment(image, roi=roi)
        assert found.mask.shape == found.background.shape == image.shape
        assert overlap(found.mask, TWO[1]) > 0.97
        assert found.warnings == ()
    changed = taken(*TWO)
    changed[:, :100] = 0
    np.testing.assert_array_equal(segment(changed, roi=roi).mask, segment(taken(*TWO), roi=roi).mask)


def test_a_colony_cut_by_the_roi_touches_its_border() -> None:
    for image in (taken(COLONY), COLONY):
        assert "touches the border" in segment(image, roi=(0, 0, 110, 200)).warnings


def test_all_three_together() -> None:
    found = segment(taken(*TWO), roi=(100, 50, 200, 150), seed_point=(150, 100), threshold=40)
    assert overlap(found.mask, TWO[1]) > 0.97


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"seed_point": (200, 10)}, "within the image of 200 x 200"),
        ({"seed_point": (-1, 10)}, "within the image"),
        ({"seed_point": (10, float("nan"))}, "two numbers"),
        ({"seed_point": (10,)}, "two numbers"),
        ({"seed_point": (10, 10), "roi": (50, 50, 150, 150)}, "within the roi"),
        ({"threshold": 0}, "above 0"),
        ({"threshold": -3.0}, "above 0"),
        ({"threshold": float("inf")}, "above 0"),
        ({"threshold": True}, "above 0"),
        ({"roi": (150, 0, 50, 100)}, "x0 < x1"),
        ({"roi": (0, 0, 201, 100)}, "within the image of 200 x 200"),
        ({"roi": (-1, 0, 100, 100)}, "within the image"),
        ({"roi": (0, 0, 100)}, "four whole numbers"),
        ({"roi": (0, 0, 99.5, 100)}, "four whole numbers"),
        ({"roi": (0, 0, 10, 100)}, "at least 16"),
        ({"min_area": 0}, "at least 1"),
    ],
)
def test_what_a_user_says_is_checked(given: dict[str, Any], words: str) -> None:
    (argument, value), *_ = given.items()
    for image in (taken(COLONY), COLONY):
        with pytest.raises(InputError) as caught:
            segment(image, name="plate 7", **given)
        assert str(caught.value).startswith("plate 7: ")
        assert words in str(caught.value)
        assert argument in str(caught.value)
        assert "need" in str(caught.value)
        assert quoted(value) in str(caught.value)


def test_a_roi_without_a_colony_is_refused() -> None:
    for image in (taken(TWO[0]), TWO[0]):
        with pytest.raises(InputError, match="no colony"):
            segment(image, roi=(120, 0, 200, 200))


# --------------------------------------------------------------------------------------------------- ready-made masks


LARGE = disc(100, 100, 97)  # three quarters of the image
CUT = disc(100, 60, 70)  # cut by one side
FULL = disc(100, 100, 112)  # cut by all four, at their middles
CORNER = disc(30, 30, 60)  # cut at a corner


@pytest.mark.parametrize("mask", [COLONY, LARGE, CUT, FULL, CORNER], ids=["plain", "large", "cut", "full", "corner"])
@pytest.mark.parametrize("values", [(0, 255), (255, 0), (0, 1), (1, 0), (False, True), (0, 65535)])
def test_polarity_is_told_from_the_border_near_the_corners(mask: np.ndarray, values: tuple[Any, Any]) -> None:
    found = segment(np.where(mask, values[1], values[0]))
    np.testing.assert_array_equal(found.mask, mask)
    assert ("touches the border" in found.warnings) == (mask is CUT or mask is FULL or mask is CORNER)


@pytest.mark.parametrize("quality", [60, 75, 95])
@pytest.mark.parametrize("dark", [True, False])
def test_lossy_compression_leaves_a_mask(quality: int, dark: bool) -> None:
    buffer = BytesIO()
    Image.fromarray(((COLONY ^ dark) * 255).astype(np.uint8)).save(buffer, "JPEG", quality=quality)
    found = segment(np.asarray(Image.open(buffer)))
    assert found.warnings == ("not quite black and white",)
    assert overlap(found.mask, COLONY) > 0.99


def test_a_mask_of_a_speck_is_refused() -> None:
    """Of fewer than five pixels the compactness is that of no shape, which tables and fits refuse."""
    mask = np.zeros((60, 60), bool)
    mask[30, 30:34] = True
    with pytest.raises(InputError, match="speck: the colony of the mask has 4 pixels, need at least 5"):
        segment(mask, name="speck")
    mask[31, 30] = True
    assert set(segment(mask).warnings) == {"tiny"}


@pytest.mark.parametrize("pixels", ["a scale bar", "hot pixels"])
@pytest.mark.parametrize("level", [150, 700])
def test_a_dark_photograph_of_16_bits_is_no_mask(pixels: str, level: int) -> None:
    """What is white in it is at the end of the range, and all the rest near the other."""
    image = taken(COLONY, level=150).astype(np.uint16) * np.uint16(level // 150)
    if pixels == "a scale bar":
        image[190:194, 120:170] = 65535
    else:
        image[tuple(np.random.default_rng(1).integers(0, SIDE, (2, 30)))] = 65535
    found = segment(image)
    assert "not quite black and white" not in found.warnings
    assert overlap(found.mask, COLONY) > 0.95


def test_a_photograph_is_no_mask() -> None:
    """Not even one of full range: black core, white background, faint rim."""
    image = taken(COLONY, contrast=250, level=252).astype(int)
    image -= 60 * (disc(100, 100, 48) & ~COLONY)
    found = segment(image.clip(0, 255).astype(np.uint8))
    assert "not quite black and white" not in found.warnings
    assert overlap(found.mask, disc(100, 100, 48)) > 0.95


# ---------------------------------------------------------------------------------------------------------- hard cases


@pytest.mark.parametrize("case", CASES)
def test_hard_cases(case: str) -> None:
    rng = np.random.default_rng(11)
    mask = drawn_colony(rng, (420, 560), 110)
    found = segment(photograph(rng, mask, CASES[case]))
    assert overlap(found.mask, mask) > 0.9
    assert set(found.warnings) <= EXPECTED.get(case, set())


FALLING = {
    "light falls off to one side",
    "light falls off at one side",
    "light falls off into a corner",
    "light falls off all round",
}
EXPECTED = {
    **{case: {"uneven light"} for case in FALLING},
    "object touching the colony": {"cut off from an object at the border"},
    "object by itself": {"several objects"},
    "faint": {"low contrast"},
    "noise": {"low contrast"},
    "blur": {"blurred"},
}


def test_what_is_drawn_is_what_was_asked_for() -> None:
    """Contrast at the outline and noise of the background, of the plain case."""
    mask = drawn_colony(np.random.default_rng(1), (300, 400), 70)
    image = photograph(np.random.default_rng(2), mask, PLAIN).astype(float)
    assert image[ndimage.distance_transform_edt(~mask) > 8].mean() == pytest.approx(165, rel=0.03)
    depth = ndimage.distance_transform_edt(mask)
    assert image[(depth > 2) & (depth < 4)].mean() == pytest.approx(165 - PLAIN.contrast, abs=8)


@pytest.mark.parametrize("radius", [20, 40, 60])
@pytest.mark.parametrize("contrast", [9, 12])
def test_faint_colonies_are_found(radius: float, contrast: float) -> None:
    """At 3.6 and 4.8 deviations of the noise, over up to a quarter of the image."""
    true = disc(100, 100, radius)
    found = segment(taken(true, contrast=contrast))
    assert overlap(found.mask, true) > 0.93
    assert set(found.warnings) <= {"low contrast"}


# ---------------------------------------------------------------------------------------------------------- benchmark


def test_the_benchmark_pairs_by_name(tmp_path: Path) -> None:
    """Two photographs of three masks, dark on white; the conditions' means differ from the published ones."""
    raw, folder = tmp_path / "raw", tmp_path / "masks"
    raw.mkdir()
    folder.mkdir()
    masks = {}
    for number in range(3):
        rng, name = np.random.default_rng(number), f"awri796_50um_s{number}.png"
        masks[name] = drawn_colony(rng, (240, 300), 50)
        Image.fromarray(~masks[name]).save(folder / name)
        if number:
            Image.fromarray(photograph(rng, masks[name], PLAIN)).save(raw / name)
    report = Report("segmentation")
    real(report, raw, masks)
    published(report, masks)
    pairs, means = report.tables.values()
    assert [row["file"] for row in pairs] == ["awri796_50um_s1.png", "awri796_50um_s2.png"]
    assert min(row["IoU"] for row in pairs) > 0.95
    assert [(row["statistic"], row["n"], row["N"]) for row in means] == [(name, 3, 14) for name in INDICES]
    assert not report.met
    areas = np.array([mask.sum() for mask in masks.values()])
    assert means[2]["mean here"] == pytest.approx(areas.mean())
    assert means[2]["sampling error %"] == pytest.approx(
        100 * areas.std(ddof=1) / np.sqrt(3) * np.sqrt(11 / 14) / 573_920
    )


@pytest.mark.parametrize("level", [150, 200, 240, 255])
@pytest.mark.parametrize("shape", ["canvas", "page", "field of view"])
def test_a_ground_around_a_photograph_is_left_out(level: int, shape: str) -> None:
    """Lighter than the photograph or as light as its background, without any noise."""
    image, colony = taken(COLONY, level=150), COLONY
    if shape == "field of view":
        image = np.where(np.hypot(Y - 100, X - 100) < 96, image, level).astype(np.uint8)
    else:
        around = 50 if shape == "canvas" else ((0, 0), (0, 120))
        image, colony = np.pad(image, around, constant_values=level), np.pad(colony, around)
    found = segment(image)
    assert overlap(found.mask, colony) > 0.97


@pytest.mark.parametrize("core", [0, 20, 60, 90])
def test_a_colony_on_a_ground_without_noise_is_a_colony(core: int) -> None:
    """Of a photograph that is overexposed, even where it is as round as a field of view, and darker in its middle."""
    inside = 140 + core * disc(100, 100, 20)
    image = 280 - ndimage.gaussian_filter(1.0 * inside * COLONY, 1.0)
    image += 2.5 * np.random.default_rng(0).standard_normal(image.shape)
    found = segment(np.rint(image).clip(0, 255).astype(np.uint8))
    assert overlap(found.mask, COLONY) > 0.97
