"""Many files at once: which are measured, under what names, in how many processes, and what is left in the folder."""

import csv
import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from own_statistics import SIDE
from PIL import Image

from yeastfit import STATISTICS
from yeastfit.commands import app as cli
from yeastfit.commands.measure_batch import measure_batch
from yeastfit.commands.measured_source import measure_once, recorded_warnings
from yeastfit.commands.run_folder import inputs_of
from yeastfit.errors import InputError
from yeastfit.measure.measurements_table import read_measurements
from yeastfit.measure.reading.batch_inputs import find_images
from yeastfit.measure.reading.segmentation_options import SegmentationOptions
from yeastfit.measure.replicate_curves import condition_curves
from yeastfit.progress import silent
from yeastfit.results.folder import results_folder


def write_disc(path: Path, radius: float = 30.0, side: int = 120) -> Path:
    """A dark disc on a bright, slightly noisy ground."""
    path.parent.mkdir(parents=True, exist_ok=True)
    x = np.arange(side) - side / 2
    dark = np.hypot(x[:, None], x[None, :]) <= radius
    noise = np.random.default_rng(0).normal(0, 2, dark.shape)
    Image.fromarray((np.where(dark, 60, 180) + noise).astype(np.uint8)).save(path)
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


# --------------------------------------------------------------------------------------------------------------- images


def test_all_images_of_a_folder_are_measured_in_counting_order(tmp_path: Path) -> None:
    for name in ("s10.png", "s9.PNG", "notes.txt", ".hidden.png"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "s1.png").symlink_to(tmp_path / "s10.png")
    images, dataset, skipped = find_images([tmp_path], 0.5, SegmentationOptions(threshold=9.0))
    assert [image.label for image in images] == ["s9.PNG", "s10.png"]
    assert all(image.pixel_size == 0.5 and image.options.threshold == 9 and image.hours is None for image in images)
    assert dataset is None
    assert [path.name for path in skipped] == ["notes.txt", "s1.png"]


def test_a_run_goes_on_with_the_measurements_that_it_made(tmp_path: Path, undrawn: None) -> None:
    """And not with a table that has lost its last colony since."""
    data, out = tmp_path / "data", tmp_path / "out"
    lines = ["file,replicate,hours,um_per_pixel"]
    for number in (1, 2):
        write_disc(data / f"{number}.png")
        lines.append(f"{number}.png,{number},5,1")
    (data / "manifest.csv").write_text("\n".join(lines))
    with results_folder(out, "infer", resume=False) as results:
        assert [len(measure_once(data, results, 1, silent).rows) for _ in range(2)] == [2, 2]
        table = out / "measured" / "measurements.csv"
        table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
        with pytest.raises(InputError, match=r"--resume: .*measurements\.csv has changed since the run wrote it"):
            measure_once(data, results, 1, silent)


def test_what_the_manifest_says_goes_before_the_options(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "manifest.csv").write_text(
        "file,replicate,hours,um_per_pixel,condition,seed_point,threshold\na.png,1,2,0.3,x,5 6,\nb.png,1,2,,y,,7\n"
    )
    for path in (tmp_path, tmp_path / "manifest.csv"):
        (a, b), dataset, _ = find_images([path], 0.5, SegmentationOptions((1.0, 2.0), 3.0))
        assert dataset is not None
        assert (a.condition, a.pixel_size, a.options) == ("x", 0.3, SegmentationOptions((5.0, 6.0), 3.0))
        assert (b.condition, b.pixel_size, b.options) == ("y", 0.5, SegmentationOptions((1.0, 2.0), 7.0))


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["a.png", "b.png"], ["a", "b"]),
        (["a.png", "A.tif"], ["a.png", "A.tif"]),
        (["x/1.png", "y/1.png"], ["x_1.png", "y_1.png"]),
        (["x/1.png", "y/1.png", "x_1.png"], ["0001_1", "0002_1", "0003_x_1"]),
    ],
)
def test_masks_never_share_a_name(tmp_path: Path, files: list[str], names: list[str]) -> None:
    for file in files:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(b"x")
    images, _, _ = find_images([tmp_path / file for file in files])
    assert [image.name for image in images] == names
    assert len({image.label for image in images}) == len(files)


def test_paths_that_cannot_be_meant_are_refused(tmp_path: Path) -> None:
    image = write_disc(tmp_path / "images" / "a.png")
    (tmp_path / "manifest.csv").write_text("file,replicate,hours,um_per_pixel\nimages/a.png,1,2,1\n")
    (tmp_path / "empty").mkdir()
    (tmp_path / "linked").mkdir()
    for name in ("a.png", "b.png"):
        (tmp_path / "linked" / name).hardlink_to(image)
    with results_folder(tmp_path / "fitted", "fit", reads=[]) as results:
        write_disc(results.partial / "curves.png")
        results.finish(inputs=[], configuration={})
    for paths, words in (
        ([tmp_path / "gone.png"], "gone.png: there is no such file"),
        ([tmp_path / "empty"], "empty: no manifest and no image"),
        ([tmp_path, image], "is a data set, measure it by itself"),
        ([image, image.parent / ".." / "images" / "a.png"], "is given twice"),
        ([tmp_path / "linked"], "b.png: is given twice, it is a.png, too, each image is measured once"),
        ([tmp_path / "fitted"], "fitted: holds results of yeastfit fit, need micrographs"),
    ):
        with pytest.raises(InputError, match=words):
            find_images(paths)
    for out in (image.parent, tmp_path):
        assert cli.run(["measure", str(image), "--out", str(out)]) == 2
        assert not (out / "index.html").exists()


def test_an_outline_made_elsewhere_is_an_input(tmp_path: Path) -> None:
    image, mask = write_disc(tmp_path / "data" / "a.png"), tmp_path / "masks" / "b.png"
    mask.parent.mkdir()
    Image.fromarray(np.pad(np.ones((60, 60), dtype=bool), 30)).save(mask)
    manifest = tmp_path / "data" / "manifest.csv"
    manifest.write_text("file,replicate,hours,um_per_pixel,mask\na.png,1,2,1,../masks/b.png\n")
    assert inputs_of(tmp_path / "data") == [manifest, image, tmp_path / "data" / "../masks/b.png"]
    assert cli.run(["measure", str(tmp_path / "data"), "--out", str(mask.parent)]) == 2  # it holds the data
    assert cli.run(["measure", str(tmp_path / "data"), "--out", str(tmp_path / "out")]) == 0
    named = json.loads((tmp_path / "out" / "manifest.json").read_text())["inputs"]
    assert [Path(name).name for name in named] == ["manifest.csv", "a.png", "b.png"]


def test_a_pixel_size_that_overrules_the_file_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = "is 2 µm given by the user; the file says 1 µm (PNG resolution)"
    for name in ("a.png", "b.png"):
        with Image.open(write_disc(tmp_path / name)) as image:
            image.save(tmp_path / name, dpi=(25_400, 25_400))
    assert cli.run(["measure", str(tmp_path), "--pixel-size", "2", "--out", str(tmp_path / "out")]) == 0
    assert f"pixel size of a.png {said}; likewise 1 more" in " ".join(capsys.readouterr().err.split())
    rows = read_measurements(tmp_path / "out" / "measurements.csv", ())
    assert f"pixel size of a.png {said}; likewise 1 more" in recorded_warnings(rows, tmp_path / "out")
    assert cli.run(["measure", str(tmp_path), "--pixel-size", "1", "--out", str(tmp_path / "same")]) == 0
    assert "pixel size" not in capsys.readouterr().err


@pytest.mark.thorough
def test_options_without_effect_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_disc(tmp_path / "a.png")
    mask = np.pad(np.ones((60, 60), dtype=bool), 30)
    for name in ("b.png", "c.png"):
        Image.fromarray(mask if name == "b.png" else np.asarray(Image.open(tmp_path / "a.png"))).save(tmp_path / name)

    def said(*options: str) -> str:
        code = cli.run(["measure", str(tmp_path), *options, "--out", str(tmp_path / "out")])
        assert code == 0, options
        return " ".join(capsys.readouterr().err.split())

    assert "--threshold has no effect on 1 of 3 images" in said("--threshold", "20", "--pixel-size", "1")
    assert "no effect" not in said("--roi", "0,0,120,120", "--colonies", "one", "--pixel-size", "1")
    header = "file,replicate,hours,um_per_pixel,mask\n"
    (tmp_path / "manifest.csv").write_text(f"{header}a.png,1,2,1,b.png\nc.png,2,2,1,\n")
    found = said("--pixel-size", "2", "--roi", "0,0,120,120", "--threshold", "20", "--colonies", "one")
    assert "--pixel-size has no effect: manifest.csv says it of every image" in found
    for name in ("--roi", "--threshold", "--colonies"):
        assert f"{name} has no effect on 1 of 2 images: their outlines are ready-made" in found
    (tmp_path / "manifest.csv").write_text(f"{header}a.png,1,2,1,b.png\nc.png,2,2,,\n")
    assert "no effect" not in said("--pixel-size", "2")


def test_one_object_and_all_of_them_are_not_both_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_disc(tmp_path / "a.png")
    (tmp_path / "manifest.csv").write_text("file,replicate,hours,um_per_pixel,colonies\na.png,1,2,1,all\n")
    options = ["--seed-point", "60,60", "--out", str(tmp_path / "out")]
    assert cli.run(["measure", str(tmp_path), *options]) == 2
    assert "a.png: colonies and seed_point are 'all' and 60,60, which means one" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# ------------------------------------------------------------------------------------------------------------ processes


@pytest.mark.thorough
def test_two_processes_find_what_one_finds_and_a_dead_one_takes_only_its_own_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Registered statistics too, which they import."""
    monkeypatch.setitem(STATISTICS, SIDE.name, SIDE)
    files = [write_disc(tmp_path / f"{k}.png", radius=20 + k) for k in range(9)]
    images, _, _ = find_images(files, 0.5)
    environment = dict(os.environ)
    alone = measure_batch(images, tmp_path / "alone")
    images[4] = replace(images[4], path=_Deadly(files[4]))
    seen: list[tuple[str, float]] = []
    together = measure_batch(images, tmp_path / "together", jobs=2, progress=lambda *counts: seen.append(counts))
    assert seen == [(f"measured {k} of 9", k / 9) for k in range(1, 10)]
    for k, (one, other) in enumerate(zip(alone, together, strict=True)):
        if k == 4:
            assert other.row is None
            assert "4.png: its process died" in other.error
            continue
        assert one == other
        assert one.row is not None
        assert one.row["side"] == pytest.approx(one.row["area"] ** 0.5)
        mask = Path("masks") / f"{k}.png"
        assert (tmp_path / "alone" / mask).read_bytes() == (tmp_path / "together" / mask).read_bytes()
    assert dict(os.environ) == environment


class _Deadly(type(Path())):  # type: ignore[misc]
    """A path that ends the process it is sent to."""

    def __reduce__(self) -> tuple:
        return os._exit, (1,)


ON_A_TERMINAL = """import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores Ctrl-C
from yeastfit.__main__ import main
main()"""


@pytest.mark.parametrize("to", [os.killpg, os.kill], ids=["terminal", "alone"])
def test_ctrl_c_ends_all_processes_without_a_traceback(to: Callable[[int, int], None], tmp_path: Path) -> None:
    folder, out = tmp_path / "images", tmp_path / "out"
    for k in range(200):
        write_disc(folder / f"{k}.png")
    command = [sys.executable, "-c", ON_A_TERMINAL, "measure", str(folder), "--out", str(out), "--pixel-size", "1"]
    with subprocess.Popen([*command, "--jobs", "2"], stderr=subprocess.PIPE, start_new_session=True) as process:
        deadline = time.monotonic() + 120
        while not list(out.rglob("overlays/*.png")):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.1)
        to(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in errors.decode()
    assert "Traceback" not in errors.decode()
    assert ends(process.pid, deadline)
    assert not out.exists()


def ends(group: int, deadline: float) -> bool:
    """Whether no process of a group is left; what keeps the books of the others ends a moment after them."""
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


# -------------------------------------------------------------------------------------------------------------- results


def test_mean_and_spread_of_conditions() -> None:
    table = [
        {"condition": condition, "replicate": k, "hours": hours, "area": area}
        for condition, hours, areas in (("b", 2.0, (1.0, 2.0, 6.0)), ("b", 1.0, (4.0,)), ("a", 1.0, (5.0, np.nan, 7.0)))
        for k, area in enumerate(areas)
    ]
    first, second, third = condition_curves(table, ["area"])
    assert [(c["condition"], c["hours"]) for c in (first, second, third)] == [("b", 1), ("b", 2), ("a", 1)]
    assert (first["count"], first["mean"]) == (1, 4)
    assert np.isnan([first["standard_deviation"], first["standard_error"]]).all()
    assert (second["count"], second["mean"]) == (3, 3)
    assert second["standard_deviation"] == pytest.approx(7**0.5)
    assert second["standard_error"] == pytest.approx((7 / 3) ** 0.5)
    assert (third["count"], third["mean"], third["standard_deviation"]) == (2, 6, pytest.approx(2**0.5))


def test_earlier_results_are_never_mixed_with_later_ones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = write_disc(tmp_path / "a.png"), tmp_path / "b.png"
    bad.write_text("no image")
    out = tmp_path / "out"
    assert cli.run(["measure", str(good), str(bad), "--out", str(out), "--pixel-size", "1"]) == 2
    (failure,) = rows(out / "failures.csv")
    assert failure["file"] == "b.png"
    assert "is no image" in failure["error"]
    assert cli.run(["measure", str(good), "--out", str(out), "--pixel-size", "1"]) == 0
    assert not (out / "failures.csv").exists()
    before = (out / "measurements.csv").read_bytes(), (out / "manifest.json").read_bytes()
    assert cli.run(["measure", str(bad), "--out", str(out), "--pixel-size", "1"]) == 2  # nothing: what is there stays
    assert "no micrograph was measured: the earlier results in" in capsys.readouterr().err
    assert ((out / "measurements.csv").read_bytes(), (out / "manifest.json").read_bytes()) == before
    assert {path.name for path in out.iterdir()} >= {"measurements.csv", "manifest.json"}
    assert not (out / ".yeastfit").exists()
    fresh = tmp_path / "fresh"
    assert cli.run(["measure", str(bad), "--out", str(fresh), "--pixel-size", "1"]) == 2
    assert not (fresh / "measurements.csv").exists()
    assert json.loads((fresh / "manifest.json").read_text())["failed"] == [failure["error"]]


def test_a_folder_of_bad_files_costs_only_themselves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "images", tmp_path / "out"
    write_disc(folder / "good.png")
    (folder / "empty.png").write_bytes(b"")
    (folder / "loop.tif").symlink_to("loop.tif")
    (folder / "gone.tif").symlink_to("nowhere.tif")
    (folder / "folder.tif").mkdir()
    assert cli.run(["measure", str(folder), "--out", str(out), "--pixel-size", "1", "--jobs", "1"]) == 2
    assert [row["file"] for row in rows(out / "measurements.csv")] == ["good.png"]
    failures = rows(out / "failures.csv")
    assert [row["file"] for row in failures] == ["empty.png", "folder.tif", "gone.tif", "loop.tif"]
    assert all(row["file"] in row["error"] and "fault" not in row["error"] for row in failures)
    errors = capsys.readouterr().err.splitlines()
    assert errors == [f"error: {row['error']}" for row in failures]


def test_a_full_disk_is_not_the_fault_of_an_image(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, *more: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # as a write does: without the file's name

    monkeypatch.setattr("yeastfit.commands.measure_batch.write_mask", full)
    write_disc(tmp_path / "a.png")
    out = tmp_path / "out"
    assert cli.run(["measure", str(tmp_path / "a.png"), "--pixel-size", "1", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"error: {out / '.yeastfit' / 'results' / 'masks' / 'a.png'}: No space left on device"
    assert not out.exists()


def test_a_region_and_a_seed_point_choose_the_colony(tmp_path: Path) -> None:
    pixels = np.full((120, 240), 180.0)
    x, y = np.arange(240), np.arange(120)[:, None]
    for centre, radius in ((60, 35), (180, 25)):
        pixels[np.hypot(x - centre, y - 60) <= radius] = 60
    pixels += np.random.default_rng(1).normal(0, 2, pixels.shape)
    Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "two.png")
    for options, radius in (([], 35), (["--seed-point", "180,60"], 25), (["--roi", "130,10,230,110"], 25)):
        out = tmp_path / str(len(options) and options[0])
        arguments = ["measure", str(tmp_path / "two.png"), "--out", str(out), "--pixel-size", "2", *options]
        assert cli.run(arguments) == 0
        (row,) = rows(out / "measurements.csv")
        assert float(row["area"]) == pytest.approx(np.pi * (2 * radius) ** 2, rel=0.03)
        manifest = json.loads((out / "manifest.json").read_text())
        assert bool(manifest["configuration"]["overruled"]) == bool(options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--seed-point", "5"], "--seed-point is '5', it must be 2 numbers"),
        (["--roi", "1,2,3,x"], "roi is '1,2,3,x', it must be 4 numbers"),
        (["--threshold", "-1"], "--threshold is -1.0, it must be a number above 0"),
        (["--roi", "0,0,500,500"], "roi"),
    ],
)
def test_bad_overrules_are_one_line(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = write_disc(tmp_path / "a.png")
    assert cli.run(["measure", str(image), "--out", str(tmp_path / "out"), "--pixel-size", "1", *options]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert words in line


def test_an_image_is_measured_without_jax(tmp_path: Path) -> None:
    """A process that only measures does not wait for JAX, which takes longer to import than an image to measure."""
    write_disc(tmp_path / "disc.png")
    arguments = ["measure", str(tmp_path / "disc.png"), "--pixel-size", "0.5", "--out", str(tmp_path / "out")]
    code = (
        "import sys; from yeastfit.commands import app; "
        f"assert app.run({arguments!r}) == 0; "
        "print([name for name in ('jax', 'jaxlib', 'equinox') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "device" not in json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert rows(tmp_path / "out" / "measurements.csv")[0]["file"] == "disc.png"
