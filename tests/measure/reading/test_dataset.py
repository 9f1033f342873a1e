"""Manifests, and the way from a folder of micrographs to curves."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from yeastfit.errors import InputError
from yeastfit.measure.measure_images import measure_dataset
from yeastfit.measure.reading.dataset import Frame, read_dataset
from yeastfit.measure.reading.segmentation_options import SegmentationOptions
from yeastfit.measure.replicate_curves import replicate_curves
from yeastfit.measure.statistics.smooth_statistics import measure_mask_smoothly

DEMO = Path(__file__).parents[3] / "data" / "synthetic" / "demo"
HEADER = "file,replicate,hours,um_per_pixel\n"


def folder(tmp_path: Path, text: str | bytes) -> Path:
    (tmp_path / "a.png").write_bytes(b"x")
    (tmp_path / "manifest.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    return tmp_path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no column 'file'"]),
        ("file,replicate,hours\na.png,1,2\n", ["no column 'um_per_pixel'"]),
        (HEADER, ["no rows"]),
        (HEADER + "b.png,1,2,0.5\n", ["line 2", "no file b.png"]),
        (HEADER + "a.png,1,nan,0.5\n", ["line 2", "hours is 'nan'"]),
        (HEADER + "a.png,1,,0.5\n", ["line 2", "hours is ''"]),
        (HEADER + "a.png,1,2,-1\n", ["line 2", "um_per_pixel is '-1'"]),
        (HEADER + "a.png,,2,1\n", ["line 2", "replicate is empty"]),
        (HEADER + "a.png,,,\n", ["line 2", "replicate is empty"]),
        (HEADER + "a.png,1,2,1\na.png,1,2,1\n", ["replicate 1 at 2 hours appears twice"]),
        (HEADER + "a.png,1,2,1\na.png,2,2,1\n\na.png,1,2.0,1\n", ["line 5: replicate 1 at 2 hours appears twice"]),
        (b"\xff\xfe\x00\xd8", ["UTF-8"]),
        (HEADER + "a.png,1,2,1,9\n", ["line 2", "5 cells", "4 columns"]),
        (HEADER + 'a.png,"1,2,1\n', ["line 2", "not CSV"]),
        ("file;replicate;hours;um_per_pixel\n", ["no column 'file'", "not by semicolons"]),
        (HEADER.replace("\n", ",conditon\n"), ["line 1", "'conditon' is unknown", "did you mean 'condition'?"]),
        (HEADER.replace("\n", ",Seed point\n"), ["'Seed point' is unknown", "did you mean 'seed_point'?"]),
        (HEADER.replace("\n", ",xyz\n"), ["'xyz' is unknown", "known are file, replicate"]),
        (HEADER + "a.png,1 µm,2,1\na.png,1 \u03bcm,2,1\n", [r"replicates '1 \xb5m' and '1 \u03bcm' look alike"]),
        (HEADER.replace("\n", ",hours\n"), ["line 1", "appears twice"]),
        (HEADER.replace("\n", ",roi\n") + "a.png,1,2,1,1 2 3\n", ["line 2", "roi is '1 2 3'", "4 numbers"]),
        (HEADER.replace("\n", ",seed_point\n") + "a.png,1,2,1,1 inf\n", ["line 2", "seed_point is '1 inf'"]),
        (HEADER.replace("\n", ",threshold\n") + "a.png,1,2,1,0\n", ["line 2", "threshold is '0'"]),
    ],
)
def test_a_bad_manifest_is_refused_by_row(tmp_path: Path, text: str | bytes, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        read_dataset(folder(tmp_path, text))
    message = str(caught.value)
    assert all(word in message for word in words)
    assert "\n" not in message


IMAGE = "[[image]]\nfile = 'a.png'\nreplicate = 1\nhours = 2\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no rows"]),
        ("a = = 1", ["not TOML", "line 1"]),
        ("pixel_size = 2\n" + IMAGE, ["at the top", "'pixel_size' is unknown"]),
        ("um_per_pixel = -2\n" + IMAGE, ["at the top", "um_per_pixel is -2"]),
        ("image = 3", ["image is 3", "[[image]]"]),
        ("image = [3]", ["image 1", "[[image]]"]),
        (IMAGE + IMAGE.replace("a.png", "b.png"), ["image 2 (b.png)", "no file b.png"]),
        (IMAGE + "hour = 3\n", ["image 1 (a.png)", "'hour' is unknown", "did you mean 'hours'?"]),
        (IMAGE.replace("2", "true"), ["image 1 (a.png)", "hours is true"]),
        (IMAGE.replace("hours = 2", ""), ["image 1 (a.png)", "hours is ''"]),
        (IMAGE.replace("'a.png'", "[1]"), ["image 1", "file is [1]"]),
        (IMAGE + "roi = [1, 2, 3, '4x']\n", ["image 1 (a.png)", "roi is [1, 2, 3, '4x']"]),
        (IMAGE + "roi = [0.5, 1, 20, 30]\n", ["image 1 (a.png)", "roi is [0.5, 1, 20, 30]", "four whole numbers"]),
        (IMAGE + IMAGE + "condition = 'x'\n" + IMAGE, ["image 3 (a.png)", "replicate 1 at 2 hours appears twice"]),
        (
            "condition = 'x'\n" + IMAGE + IMAGE,
            ["image 2 (a.png)", "replicate 1 of condition 'x' at 2 hours appears twice"],
        ),
    ],
)
def test_a_bad_toml_manifest_is_refused_by_image(tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "a.png").write_bytes(b"x")
    (tmp_path / "manifest.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_dataset(tmp_path)
    message = str(caught.value)
    assert all(word in message for word in ["manifest.toml", *words])
    assert "\n" not in message


def test_csv_and_toml_say_the_same(tmp_path: Path) -> None:
    columns = "condition,seed_point,threshold,roi,note"
    folder(
        tmp_path,
        f"\ufeff{HEADER.strip()},{columns}\n"
        'a.png,1,2,0.5,AWRI 796,"10.5, 20",12,1 2 30 40,taken twice\n'
        "a.png, left ,2.5,0.5,AWRI 796,,,,\n,,,,,,,,\na.png,1,2,0.75,other,,7,,\n",
    )
    from_csv = read_dataset(tmp_path)
    (tmp_path / "manifest.csv").unlink()
    (tmp_path / "manifest.toml").write_text(
        "um_per_pixel = 0.5\ncondition = 'AWRI 796'\n"
        + IMAGE
        + "seed_point = [10.5, 20]\nthreshold = 12\nroi = [1, 2, 30, 40]\nnote = 'taken twice'\n"
        + IMAGE.replace("replicate = 1", "replicate = 'left'").replace("hours = 2", "hours = 2.5")
        + IMAGE
        + "um_per_pixel = 0.75\ncondition = 'other'\nthreshold = 7\n"
    )
    from_toml = read_dataset(tmp_path)
    assert from_csv == from_toml
    first, second, third = from_toml.frames
    assert first.options == SegmentationOptions((10.5, 20.0), 12.0, (1, 2, 30, 40))
    assert (second.replicate, second.hours, second.options) == ("left", 2.5, SegmentationOptions())
    assert third == Frame(tmp_path / "a.png", "1", 2.0, 0.75, "other", SegmentationOptions(threshold=7.0))
    assert from_toml.conditions == ("AWRI 796", "other")
    assert from_toml.of("other").frames == (third,)
    assert from_toml.manifest == tmp_path / "manifest.toml"
    with pytest.raises(InputError, match=r"condition: got 'none'.* 'AWRI 796', 'other'"):
        from_toml.of("none")
    # one colony in two conditions is two colonies, whose curves must not be pooled
    values = [{"area": 5.0}, {"area": 6.0}, {"area": 7.0}]
    with pytest.raises(InputError, match="conditions 'AWRI 796', 'other', curves are of one"):
        replicate_curves(from_toml, values, ("area",))
    curves, _ = replicate_curves(from_toml.of("AWRI 796"), values[:2], ("area",))
    np.testing.assert_array_equal(curves["area"], [[5, np.nan], [np.nan, 6]])


def test_a_folder_has_one_manifest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no manifest\.csv or manifest\.toml"):
        read_dataset(tmp_path)
    folder(tmp_path, HEADER + "a.png,1,2,1\n")
    (tmp_path / "manifest.toml").write_text(IMAGE)
    with pytest.raises(InputError, match=r"holds manifest\.csv and manifest\.toml"):
        read_dataset(tmp_path)


def test_an_empty_pixel_size_is_left_to_the_file(tmp_path: Path) -> None:
    (frame,) = read_dataset(folder(tmp_path, HEADER + "a.png,1,2.5,\n")).frames
    assert frame.pixel_size is None
    assert frame.hours == 2.5


def test_smooth_statistics_of_a_disc_are_exact_and_do_not_depend_on_the_pixel() -> None:
    """A that of the pixels, C = 1 + O(smoothing²), mean radius 2R/3 of a disc of radius 3, at three pixel sizes."""
    # pixels of 0.2 are coarser than the smoothing: their stairs still show in the perimeter
    for pixel, excess in ((0.05, 0.01), (0.1, 0.01), (0.2, 0.02)):
        x = (np.arange(round(10 / pixel)) + 0.5) * pixel - 5
        disc = np.hypot(x[:, None], x[None, :]) <= 3
        values = measure_mask_smoothly(disc, pixel, spacing=0.1, smoothing=0.15)
        assert values["area"] == pytest.approx(disc.sum() * pixel**2, rel=2e-3)
        assert values["compactness"] == pytest.approx(1, abs=excess)
        # blurring moves mass outwards: ∬|x| φ gains s²/2 · perimeter / R / A to first order, 0.2 % here
        own = np.hypot(x[:, None], x[None, :])[disc].mean()
        assert values["radius"] == pytest.approx(own, rel=7e-3)


def test_missing_frames_are_nan(tmp_path: Path) -> None:
    data = read_dataset(folder(tmp_path, HEADER + "a.png,1,2,1\na.png,2,3,1\n"))
    curves, hours = replicate_curves(data, [{"area": 5.0}, {"area": 6.0}], ("area",))
    np.testing.assert_array_equal(hours, [2, 3])
    np.testing.assert_array_equal(curves["area"], [[5, np.nan], [np.nan, 6]])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["demo", "slender", "compact"])
def test_photographs_give_the_curves_of_the_true_masks_everywhere(name: str) -> None:
    check_against_true_masks(DEMO.parent / name, every=1)


@pytest.mark.thorough
def test_photographs_give_the_curves_of_the_true_masks() -> None:
    """Every fifth photograph of the demo: mean area, radius and compactness of segmented and true masks."""
    check_against_true_masks(DEMO, every=5)


def check_against_true_masks(path: Path, every: int) -> None:
    data = read_dataset(path)
    data = type(data)(data.folder, data.frames[::every])
    ratios = []
    for frame, one in zip(data.frames, measure_dataset(data), strict=True):
        with Image.open(data.folder / "truth" / "masks" / f"{frame.path.stem}.png") as image:
            truth = np.asarray(image)
        both = [
            measure_mask_smoothly(mask, one.micrograph.pixel_size / 7.5, spacing=0.1, smoothing=0.15)
            for mask in (one.segmentation.mask, truth)
        ]
        ratios.append([both[0][name] / both[1][name] for name in ("area", "radius", "compactness")])
    area, radius, compactness = np.mean(ratios, axis=0) - 1
    # what a fit may assume of a measured mean: its measurement_error of 1 % (2 % in compactness of a few frames)
    assert abs(area) < 0.015
    assert abs(radius) < 0.004
    assert abs(compactness) < 0.02


@pytest.mark.parametrize("kind", ["folder", "link"])
def test_a_manifest_that_is_no_file_is_not_passed_over(kind: str, tmp_path: Path) -> None:
    """The images would be measured as if there were none."""
    manifest = tmp_path / "manifest.csv"
    if kind == "folder":
        manifest.mkdir()
    else:
        manifest.symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"manifest\.csv: a folder, a pipe or a link to nowhere"):
        read_dataset(tmp_path)
