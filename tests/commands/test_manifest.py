"""`yeastfit manifest`: names that say what images show, and names that do not."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from yeastfit import InputError, read_dataset
from yeastfit.commands import app as cli
from yeastfit.measure.reading.file_names import NamePattern
from yeastfit.measure.reading.outline_files import write_mask

PATTERN = "{condition} s{replicate} {hours}h {objective}"
SIZES = ["--pixel-size", "4X=1.55008", "--pixel-size", "10X=0.62"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two media, colonies 2 and 10, early at ten times, later at four."""
    for medium in ("50um", "500um"):
        for replicate in (2, 10):
            for hours, objective in (("25.5", "10X"), ("121", "4X")):
                (tmp_path / f"AWRI 796 {medium} s{replicate} {hours}h {objective} binary.tif").touch()
    (tmp_path / "notes.txt").touch()
    return tmp_path


def test_a_folder_becomes_a_data_set(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES]) == 0
    frames = read_dataset(folder).frames
    assert len(frames) == 8
    for frame in frames:
        assert f"{frame.condition} s{frame.replicate} {frame.hours:g}h" in frame.path.name
        assert frame.pixel_size == (0.62 if "10X" in frame.path.name else 1.55008)
    assert [frame.replicate for frame in frames[:4]] == ["2", "2", "10", "10"]  # as numbers count
    shown = capsys.readouterr()
    assert "AWRI 796 500um" in shown.out
    assert "Not read, at the end of names: binary" in shown.out
    assert "notes.txt" in shown.err


def test_a_manifest_that_is_there_stays(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "manifest.csv").write_text("mine")
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (folder / "manifest.csv").read_text() == "mine"


def test_beside_the_images(folder: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "sets" / "one"
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES, "--out", str(elsewhere)]) == 0
    assert all(frame.path.is_file() for frame in read_dataset(elsewhere).frames)
    assert not (folder / "manifest.csv").exists()


def test_in_a_folder_that_is_a_link(folder: Path, tmp_path: Path) -> None:
    """To one that lies at another depth."""
    elsewhere = tmp_path / "some" / "where" / "else"
    elsewhere.mkdir(parents=True)
    (tmp_path / "link").symlink_to(elsewhere)
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES, "--out", str(tmp_path / "link")]) == 0
    assert all(frame.path.is_file() for frame in read_dataset(elsewhere).frames)


def test_a_name_that_a_spreadsheet_would_compute_is_written_as_a_path(tmp_path: Path) -> None:
    (tmp_path / "=1+1 s1 24h 4X.tif").touch()
    assert cli.run(["manifest", str(tmp_path), "--pattern", PATTERN, *SIZES[:2]]) == 0
    assert "\n./=1+1 s1 24h 4X.tif," in (tmp_path / "manifest.csv").read_text()
    assert read_dataset(tmp_path).frames[0].path.is_file()


def test_a_name_that_is_no_text_is_refused_by_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = os.fsdecode(b"caf\xe9 s1 24h 4X.tif")
    try:
        (folder / name).touch()
    except OSError:
        pytest.skip("this file system has names of text only")
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES]) == 2
    assert "caf\\xe9 s1 24h 4X.tif: its name is not UTF-8" in capsys.readouterr().err
    assert not (folder / "manifest.csv").exists()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("  s1 24h 4X.tif", "'  s1 24h 4X.tif': begins or ends with a blank"),
        ("a\u202eb s1 24h 4X.tif", "24h 4X.tif': condition is 'a\\u202eb', it must be one line of at most 200 visible"),
        (f"{'x' * 201} s1 24h 4X.tif", "condition is 'xxx"),
    ],
)
def test_a_name_that_no_manifest_can_hold_is_refused_by_name(
    name: str, said: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / name).touch()
    out = tmp_path / "elsewhere"
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES, "--out", str(out)]) == 2
    assert said in " ".join(capsys.readouterr().err.split("\n"))
    assert not out.exists()


def test_a_folder_with_the_name_of_an_image_is_refused_by_name(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "of.tif").mkdir()
    assert cli.run(["manifest", str(folder), "--pattern", "{}", "--hours", "5"]) == 2
    assert "of.tif: is a folder with the name of an image" in capsys.readouterr().err
    assert not (folder / "manifest.csv").exists()


def test_one_size_for_two_objectives_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With spaces in the folder's name the next command is one that a shell takes."""
    folder = tmp_path / "two lenses"
    folder.mkdir()
    for name in ("a 5h 4X.png", "b 5h 10X.png"):
        (folder / name).touch()
    asked = ["manifest", str(folder), "--pattern", "{replicate} {hours}h {objective}", "--pixel-size"]
    assert cli.run([*asked, "1.5"]) == 2
    assert "images have the objectives '4X', '10X', and one pixel size is given for all" in capsys.readouterr().err
    assert not (folder / "manifest.csv").exists()
    assert cli.run([*asked, "4X=1.5", "--pixel-size", "10X=0.6"]) == 0
    assert f"yeastfit measure '{folder}' --out" in "".join(capsys.readouterr().out.split("\n"))


def test_sizes_that_files_must_state_are_looked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(np.zeros((40, 40), np.uint8)).save(tmp_path / "a1.tif")
    write_mask(tmp_path / "b1.tif", np.zeros((40, 40), bool), 1.55)
    assert cli.run(["manifest", str(tmp_path), "--pattern", "{condition}{replicate}", "--hours", "10"]) == 0
    shown = capsys.readouterr()
    assert "none in the files" in shown.out
    assert "1.55 in the first file" in shown.out
    assert "a1.tif states no size of its pixels: give --pixel-size" in shown.err
    assert "b1.tif" not in shown.err


def test_one_time_and_one_size(tmp_path: Path) -> None:
    for replicate in "ab":
        (tmp_path / f"white_{replicate}.png").touch()
    arguments = ["manifest", str(tmp_path), "--pattern", "{condition}_{replicate}", "--hours", "233"]
    assert cli.run([*arguments, "--pixel-size", "1.55"]) == 0
    frames = read_dataset(tmp_path).frames
    assert {(f.condition, f.replicate, f.hours, f.pixel_size) for f in frames} == {
        ("white", "a", 233.0, 1.55),
        ("white", "b", 233.0, 1.55),
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--pattern", "{condition} r{replicate} {hours}h"], "does not match"),
        (["--pattern", "{condition}{replicate} {hours}h"], "two ways"),
        (["--pattern", "{condition} s{replicate} {}", "--hours", "25"], "one image at one time"),
        (["--pattern", "{condition} s{replicate} {}"], "give those of all images"),
        (["--pattern", PATTERN, "--hours", "25"], "leave out those of all"),
        (["--pattern", "{condition} {hours}h"], "no {replicate}"),
        (["--pattern", "{}{}", "--hours", "3"], "--pattern '{}{}': has no {replicate}"),
        (["--pattern", "{strain} s{replicate} {hours}h"], "{strain} is unknown"),
        (["--pattern", "{hours} s{replicate} {hours}h"], "{hours} appears twice"),
        (["--pattern", "{condition s{replicate} {hours}h"], "a brace is open"),
        (["--pattern", PATTERN, "--pixel-size", "4X=1.55"], "objective '10X'"),
        (["--pattern", PATTERN, *SIZES, "--pixel-size", "20X=0.3"], "no image has the objective '20X'"),
        (["--pattern", PATTERN, *SIZES, "--pixel-size", "4X=1.6"], "is the second"),
        (["--pattern", PATTERN, *SIZES, "--pixel-size", "1.6"], "one size for all images"),
        (["--pattern", PATTERN, "--pixel-size", "4X=1e9"], "0.001 to 1000"),
        (["--pattern", PATTERN, "--pixel-size", "4X"], "--pixel-size '4X'"),
        (["--pattern", PATTERN, "--pixel-size", "=1.55"], "--pixel-size is '=1.55', it must be a number, or like"),
        (["--pattern", PATTERN, "--pixel-size", "4X=1=2"], "--pixel-size is '4X=1=2', it must be a number, or like"),
        (["--pattern", "{}a{}b{}c{}d{}e{replicate}"], "has {} 5 times, need it at most 4 times"),
        (["--pattern", "{condition} s{replicate} {}", "--hours", "0"], "--hours"),
    ],
)
def test_what_is_ambiguous_is_refused(
    folder: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["manifest", str(folder), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in " ".join(error.split())
    assert not (folder / "manifest.csv").exists()


def test_a_full_disk_leaves_no_half_manifest(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("yeastfit.commands.manifest.os.path.relpath", full)
    for place in (folder, folder / "new" / "and" / "another"):
        assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES, "--out", str(place)]) == 2
        assert capsys.readouterr().err == f"error: {place / 'manifest.csv'}: No space left on device\n"
        assert not (place / "manifest.csv").exists()
    assert not (folder / "new").exists()


def test_a_manifest_has_its_name_only_when_it_is_whole(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a kill there is none, or all of it."""
    there, relpath = [], os.path.relpath

    def looked(*arguments: str) -> str:
        there.append((folder / "manifest.csv").exists())
        return relpath(*arguments)

    monkeypatch.setattr("yeastfit.commands.manifest.os.path.relpath", looked)
    assert cli.run(["manifest", str(folder), "--pattern", PATTERN, *SIZES]) == 0
    assert there
    assert not any(there)
    assert (folder / "manifest.csv").exists()
    assert not list(folder.glob(".*"))


def test_any_text_behind_any_text_takes_no_time() -> None:
    assert NamePattern.of("{}" * 30 + "{replicate}{hours}").readings("a" * 100) == []


def test_a_name_is_read_in_one_way_or_refused() -> None:
    assert NamePattern.of("{replicate}-{hours}").readings("a-5-later") == [
        {"replicate": "a", "hours": "5", "rest": "-later"}
    ]
    assert NamePattern.of("{condition}_{replicate}").readings("a_b_c") == [
        {"condition": "a", "replicate": "b", "rest": "_c"},
        {"condition": "a_b", "replicate": "c", "rest": ""},
    ]
    for pattern, name, of in (
        ("{replicate}{hours}h", "A12h", [("A", "12"), ("A1", "2")]),
        ("s{replicate}{hours}h", "s1012h", [("1", "012"), ("101", "2")]),
        ("s{replicate}{hours}h", "s112.5h", [("1", "12.5"), ("11", "2.5")]),
    ):
        assert [(one["replicate"], one["hours"]) for one in NamePattern.of(pattern).readings(name)] == of
    assert len(NamePattern.of("{objective}-{replicate}").readings("a-b-c")) == 2
    for pattern, name in (  # between the shortest and the longest text that is not read
        ("{}_{replicate}_{}_{hours}h", "plate_A_crop_A_edit_5h"),
        ("{}p{replicate}{}_{hours}h", "p1xp2yp1_5h"),
        ("{}s{replicate} {} {hours}h", "run s1 vs s2 and s1 x 5h"),
    ):
        assert len(NamePattern.of(pattern).readings(name)) == 2
    assert [one["hours"] for one in NamePattern.of("{replicate} {hours}").readings("7 12.5 old")] == ["12.5"]
    with pytest.raises(InputError, match="unknown"):
        NamePattern.of("{}{replicate}{colony}")
