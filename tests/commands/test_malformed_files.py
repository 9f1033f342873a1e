"""Malformed files given to the commands: each ends in one line and exit code 2, or costs its own row only."""

import csv
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from helpers import wrong_types
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from malformed_images import REFUSED
from PIL import Image

from yeastfit.commands import app as cli
from yeastfit.errors import InputError
from yeastfit.measure.measurements_table import NEEDED, read_measurements

DISC = np.where(np.hypot(*(np.mgrid[:64, :64] - 31.5)) < 15, 60, 150).astype(np.uint8)
DISC += np.random.default_rng(0).integers(0, 5, DISC.shape).astype(np.uint8)
Run = Callable[[Sequence[str | Path]], str]
Case = tuple[str | bytes, str]  # what a file holds, and words of the message


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command that must be refused; the line it says."""

    def run(arguments: Sequence[str | Path]) -> str:
        with wrong_types():
            assert cli.run([*map(str, arguments), "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr()
        (line,) = said.err.splitlines()
        assert line.startswith("error: ")
        assert "fault" not in line
        assert len(line) < 2 * len(str(tmp_path)) + 400
        assert not list((tmp_path / "out").glob("*.csv"))
        return line

    return run


def written(path: Path, data: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


# --------------------------------------------------------------------------------------------------------------- images


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_a_device_and_an_endless_file_cost_their_own_row_only(tmp_path: Path) -> None:
    """Nothing waits for a pipe, and nothing without an end is read to it."""
    images, out = tmp_path / "images", tmp_path / "out"
    images.mkdir()
    Image.fromarray(DISC).save(images / "good.png")
    os.mkfifo(images / "pipe.png")
    (images / "device.png").symlink_to("/dev/zero")
    with (images / "sparse.tif").open("wb") as file:
        file.truncate(10**13)
    assert cli.run(["measure", str(images), "--out", str(out), "--pixel-size", "1", "--jobs", "1"]) == 2
    assert [row["file"] for row in rows(out / "measurements.csv")] == ["good.png"]
    failures = {row["file"]: row["error"] for row in rows(out / "failures.csv")}
    assert set(failures) == {"pipe.png", "device.png", "sparse.tif"}
    assert "is no regular file" in failures["pipe.png"]
    assert "is no image" in failures["sparse.tif"]


ODD_NAMES = (
    "a\nb.png",
    "a\tb.png",
    "a\x1b[31mb.png",
    "a'b\".png",
    "<script>alert(1)<script>.png",
    "=HYPERLINK(1).png",
    "-rf.png",
    "gpj.\u202epng.png",
    "x" * 246 + ".png",
    "é" * 120 + ".png",
    "$x_1$.png",
    "[bold]x.png",
    "培养基 👩\u200d🔬.png",
    ":smile:.png",
    " .png",
    "\\alpha.png",
    "%s{0}.png",
)
NO_UTF_8 = os.fsdecode(b"caf\xe9.png")


def test_every_file_of_a_survey_costs_its_own_row_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    images, out = tmp_path / "images", tmp_path / "out"
    images.mkdir()
    bad = {name: case for name, case in REFUSED.items() if name != "folder.tif"}  # which would be looked into
    for name, (make, _) in bad.items():
        make(images / name)
    Image.fromarray(DISC).save(tmp_path / "good.png")
    for name in (*ODD_NAMES, NO_UTF_8):
        shutil.copy(tmp_path / "good.png", images / name)
    monkeypatch.chdir(images)
    files = [name if name[0] != "-" else f"./{name}" for name in sorted(os.listdir("."))]
    assert cli.run(["measure", *files, "--out", str(out), "--pixel-size", "1", "--jobs", "1"]) == 2

    measured, failures = rows(out / "measurements.csv"), rows(out / "failures.csv")
    assert [row["file"] for row in failures] == sorted(bad)
    for row in failures:
        words = bad[row["file"]][1]
        assert row["error"].startswith(f"{row['file']}: ")
        assert words in row["error"]
        assert "fault" not in row["error"]
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if line.startswith("error")] == [f"error: {row['error']}" for row in failures]

    names = {row["file"] for row in measured}
    assert len(measured) == len(names) == len(ODD_NAMES) + 1
    assert {"./=HYPERLINK(1).png", "./-rf.png", r"a\nb.png", r"gpj.\u202epng.png", r"caf\xe9.png"} < names
    assert len((out / "measurements.csv").read_text("utf-8").splitlines()) == len(measured) + 1
    masks = {row["mask"] for row in measured}
    assert len(masks) == len(measured)
    assert all((out / mask).is_file() and mask.isprintable() is (mask == mask.replace("\u200d", "")) for mask in masks)
    assert all(len(os.fsencode(Path(mask).name)) <= 140 for mask in masks)
    page = (out / "index.html").read_text("utf-8")
    assert "<script>alert" not in page
    assert not {"\x1b", "\u202e"} & set(page)


# ------------------------------------------------------------------------------------------------------------ manifests

HEADER = "file,replicate,hours,um_per_pixel\n"
IMAGE = "[[image]]\nfile = 'a.png'\nreplicate = 1\nhours = 2\num_per_pixel = 1\n"
CSV: dict[str, Case] = {
    "empty": (b"", "no column 'file'"),
    "blank": ("\n\n\n", "no column 'file'"),
    "no rows": (HEADER, "no rows"),
    "empty rows": (HEADER + ",,,\n\n", "no rows"),
    "utf-16": ((HEADER + "a.png,1,2,1\n").encode("utf-16"), "is a text file in UTF-16, need UTF-8"),
    "utf-16 without mark": ((HEADER + "a.png,1,2,1\n").encode("utf-16-le"), "line 1: holds a NUL"),
    "latin-1": (HEADER.encode() + b"\xe9.png,1,2,1\n", "line 2: not a text file in UTF-8"),
    "nul": (HEADER + "a.png,1,2\0,1\n", "line 2: holds a NUL"),
    "binary": (bytes(range(1, 256)), "not a text file in UTF-8"),
    "image": (b"\x89PNG\r\n\x1a\n\0\0", "not a text file in UTF-8"),
    "huge cell": (HEADER + f"{'x' * 200_000},1,2,1\n", "line 2: not CSV (field larger"),
    "long cell": (HEADER + f"{'x' * 100_000},1,2,1\n", "line 2: there is no file xxxx"),
    "open quote": (HEADER + 'a.png,"1,2,1\n', "line 2: not CSV"),
    "text after quote": (HEADER + '"a.png"x,1,2,1\n', "line 2: not CSV"),
    "semicolons": (HEADER.replace(",", ";") + "a.png;1;2,5;1\n", "by commas and not by semicolons"),
    "tabs": (HEADER.replace(",", "\t"), "by commas and not by tabs"),
    "missing column": ("file,replicate,hours\na.png,1,2\n", "no column 'um_per_pixel'"),
    "twice a column": (HEADER.replace("hours", "hours,hours"), "line 1: a column appears twice, 'hours'"),
    "unknown column": (HEADER.replace("\n", ",size\n"), "'size' is unknown"),
    "escape in column": (HEADER.replace("\n", ",\x1b[31m\n"), r"'\x1b[31m' is unknown"),
    "no name of a column": (HEADER.replace("\n", ",\n"), "'' is unknown"),
    "many cells": (HEADER + "a.png,1,2,1,5,6\n", "line 2: 6 cells, the first line names 4 columns"),
    "few cells": (HEADER + "a.png,1\n", "line 2: 2 cells, the first line names 4 columns: the file may be cut off"),
    "cut off in a number": (HEADER + "a.png,1,12,0.75\na.png,2,1", "line 3: 3 cells, the first line names 4 columns"),
    "no file": (HEADER + "b.png,1,2,1\n", "line 2: there is no file b.png"),
    "folder": (HEADER + ".,1,2,1\n", "line 2: there is no file ."),
    "empty file": (HEADER + ",1,2,1\n", "line 2: file is empty"),
    "empty replicate": (HEADER + "a.png,,2,1\n", "line 2: replicate is empty"),
    "twice": (HEADER + "a.png,1,2,1\r\nb.png,1,2.0,1\r\n", "line 3: there is no file b.png"),
    "twice a colony": (
        HEADER + "a.png,1,2,1\r\na.png,1,2.0,1\r\n",
        "line 3: replicate 1 at 2 hours appears twice, as a.png here and as a.png in line 2",
    ),
    "hours of text": (HEADER + "a.png,1,two,1\n", "line 2: hours is 'two', it must be a number from 0.001 to 1"),
    "hours 1_0": (HEADER + "a.png,1,1_0,1\n", "line 2: hours is '1_0'"),
    "hours of other digits": (HEADER + "a.png,1,١٢,1\n", "line 2: hours is '١٢'"),
    "hours in hexadecimal": (HEADER + "a.png,1,0x10,1\n", "line 2: hours is '0x10'"),
    "hours with a comma": (HEADER + 'a.png,1,"2,5",1\n', "line 2: hours is '2,5'"),
    "hours nan": (HEADER + "a.png,1,nan,1\n", "line 2: hours is 'nan'"),
    "hours infinite": (HEADER + "a.png,1,1e999,1\n", "line 2: hours is '1e999'"),
    "hours 0": (HEADER + "a.png,1,0,1\n", "line 2: hours is '0'"),
    "hours of a century": (HEADER + "a.png,1,1e6,1\n", "line 2: hours is '1e6'"),
    "pixels 0": (HEADER + "a.png,1,2,0\n", "line 2: um_per_pixel is '0', it must be a number from 0.001 to 1000 µm"),
    "pixels of nothing": (HEADER + "a.png,1,2,1e-200\n", "line 2: um_per_pixel is '1e-200'"),
    "pixels of a metre": (HEADER + "a.png,1,2,1e6\n", "line 2: um_per_pixel is '1e6'"),
    "pixels with a unit": (HEADER + "a.png,1,2,1 µm\n", "line 2: um_per_pixel is '1 µm'"),
    "escape in replicate": (HEADER + "a.png,\x1b[31m,2,1\n", r"line 2: replicate is '\x1b[31m', it must be one line"),
    "line end in replicate": (HEADER + 'a.png,"a\nb",2,1\n', r"line 3: replicate is 'a\nb'"),
    "long replicate": (HEADER + f"a.png,{'x' * 5000},2,1\n", "line 2: replicate is 'xxxx"),
    "hidden condition": (HEADER.replace("\n", ",condition\n") + "a.png,1,2,1,\u202ex\n", r"condition is '\u202ex'"),
    "bad roi": (HEADER.replace("\n", ",roi\n") + 'a.png,1,2,1,"1,2,1_0,9"\n', "line 2: roi is '1,2,1_0,9'"),
    "bad threshold": (HEADER.replace("\n", ",threshold\n") + "a.png,1,2,1,-3\n", "line 2: threshold is '-3'"),
}
TOML: dict[str, Case] = {
    "empty": (b"", "no rows"),
    "no toml": ("image = = 1", "not TOML"),
    "hours as text": (IMAGE.replace("2", "'2'"), "to 100000 hours, without quotation marks"),
    "utf-16": (IMAGE.encode("utf-16"), "need UTF-8"),
    "latin-1": (b"# \xe9\n", "line 1: not a text file in UTF-8"),
    "nul": ("a = '\0'", "line 1: holds a NUL"),
    "thousands of digits": (IMAGE.replace("2", "1" * 5000), "not TOML (Exceeds the limit (4300 digits)"),
    "hundreds of digits": (IMAGE.replace("2", "1" * 500), "image 1 (a.png): hours is 1111"),
    "nested": ("note = " + "[" * 3000 + "]" * 3000, "too many"),
    "image is a number": ("image = 3", "image is 3"),
    "image is a table": ("[image]\nfile = 'a.png'\n", "write a table [[image]]"),
    "images are numbers": ("image = [3]", "image 1: is 3"),
    "file is a number": (IMAGE.replace("'a.png'", "3"), "there is no file 3"),
    "file is a list": (IMAGE.replace("'a.png'", "[3]"), "file is [3]"),
    "hours true": (IMAGE.replace("2", "true"), "hours is true"),
    "hours nan": (IMAGE.replace("2", "nan"), "hours is nan"),
    "hours a date": (IMAGE.replace("2", "2024-01-01"), "hours is 2024-01-01"),
    "hidden replicate": (IMAGE.replace("replicate = 1", r'replicate = "\u0007"'), r"replicate is '\x07'"),
    "long list": (IMAGE + f"roi = {list(range(5000))}", "roi is [0, 1, 2"),
    "unknown key": ("size = 3\n" + IMAGE, "'size' is unknown"),
    "pixels shared": (IMAGE + "[um_per_pixel]\nx = 1\n", "um_per_pixel is {x = 1}"),
}
MANIFESTS = [("manifest.csv", *case) for case in CSV.items()] + [("manifest.toml", *case) for case in TOML.items()]


@pytest.mark.parametrize(("file", "name", "case"), MANIFESTS, ids=lambda value: value if isinstance(value, str) else "")
def test_a_malformed_manifest_is_refused(tmp_path: Path, refused: Run, file: str, name: str, case: Case) -> None:
    data, words = case
    written(tmp_path / "data" / "a.png", b"x")
    line = refused(["measure", written(tmp_path / "data" / file, data).parent])
    assert words in line
    assert f"{file}" in line


SIZES = {
    "of two sizes": ("1.0", "2.0", "um_per_pixel runs from 1 to 2"),
    "of no cell": ("0.75", "0.001", "a.png: um_per_pixel is 0.001, it must be a number from 0.00"),
    "of many cells": ("0.75", "500", "a.png: um_per_pixel is 500, it must be a number from 0.00"),
}


@pytest.mark.parametrize(("model", "free"), [("algebraic", "mobility"), ("offlattice", "fork")])
@pytest.mark.parametrize("command", ["fit", "infer"])
@pytest.mark.parametrize("name", SIZES)
def test_pixels_that_cannot_be_compared_are_refused_before_an_image_is_read(
    tmp_path: Path, refused: Run, name: str, command: str, model: str, free: str
) -> None:
    *sizes, words = SIZES[name]
    lines = [f"a.png,{number},2,{size}\n" for number, size in enumerate(sizes)]
    written(tmp_path / "data" / "manifest.csv", "".join([HEADER, *lines]))
    written(tmp_path / "data" / "a.png", b"x")
    options = ["--model", model, "--free", free, "--statistics", "solidity,hole_count"]
    assert words in refused([command, tmp_path / "data", *options])


def test_a_manifest_of_another_system_is_read(tmp_path: Path) -> None:
    """With a byte order mark, carriage returns, quotes, spaces and empty lines."""
    (tmp_path / "data").mkdir()
    Image.fromarray(DISC).save(tmp_path / "data" / "a b.png")
    text = '\ufeff"file", replicate ,hours,um_per_pixel\r\n\r\n"a b.png", 1 ,"2.5",1e0\r\n,,,\r\n'
    manifest = written(tmp_path / "data" / "manifest.csv", text)
    assert cli.run(["measure", str(manifest), "--out", str(tmp_path / "out")]) == 0
    (row,) = rows(tmp_path / "out" / "measurements.csv")
    assert (row["file"], row["replicate"], row["hours"]) == ("a b.png", "1", "2.5")


# --------------------------------------------------------------------------------------------------------------- tables

ROW = {
    "file": "a.png",
    "condition": "x",
    "replicate": "1",
    "hours": "4",
    "um_per_pixel": "1",
    "area": "700",
    "perimeter": "95",
    "compactness": "1.02",
    "radius": "10",
    "max_radius": "15",
    "object_count": "1",
    "hole_count": "0",
    "solidity": "0.97",
    "radial_index": "0.1",
    "warnings": "",
    "mask": "masks/a.png",
}


def table(changed: dict[str, str] | None = None, **more: str) -> str:
    """A table of two colonies, the second of which is changed."""
    second = ROW | {"replicate": "2"} | (changed or {}) | more
    return "\n".join(",".join(row.values()) for row in (dict(zip(second, second, strict=True)), ROW, second)) + "\n"


CELLS = {
    ("hours", "1_0"): "it must be a number from 0.001 to 100000 hours",
    ("hours", "-4"): "it must be a number from 0.001",
    ("hours", "1e300"): "to 100000 hours",
    ("um_per_pixel", "1e-200"): "from 0.001 to 1000 µm",
    ("um_per_pixel", "0"): "from 0.001 to 1000 µm",
    ("um_per_pixel", "1e4"): "from 0.001 to 1000 µm",
    ("area", "-700"): "it must be a number above 0 µm²",
    ("area", "0"): "it must be a number above 0 µm²",
    ("area", "many"): "it must be a number above 0 µm²",
    ("area", "inf"): "it must be a number above 0 µm²",
    ("area", "７００"): "it must be a number above 0 µm²",
    ("perimeter", "-1"): "it must be a number above 0 µm",
    ("compactness", "0.5"): "it must be a number from 0.9 to 1e+09",
    ("compactness", "-1"): "it must be a number from 0.9 to 1e+09",
    ("compactness", "1e999"): "it must be a number from 0.9 to 1e+09",
    ("radius", "0"): "it must be a number above 0 µm",
    ("max_radius", "-15"): "it must be a number above 0 µm",
    ("object_count", "0"): "it must be a number above 0",
    ("object_count", "1.5"): "it must be a whole number",
    ("hole_count", "-1"): "it must be a number of at least 0",
    ("solidity", "1.2"): "it must be a number above 0, up to 1",
    ("radial_index", "-0.1"): "it must be a number from 0 to 1",
}


@pytest.mark.parametrize(("cell", "words"), CELLS.items(), ids=lambda value: "=".join(value) if value in CELLS else "")
def test_a_number_that_no_colony_has_is_refused_by_line_and_column(
    tmp_path: Path, refused: Run, cell: tuple[str, str], words: str
) -> None:
    name, value = cell
    source = written(tmp_path / "measurements.csv", table({name: value}))
    line = refused(["fit", source, "--free", "mobility"])
    assert f"measurements.csv, line 3: {name} is '{value}'" in line
    assert words in line


OFFLATTICE = ["--model", "offlattice", "--free", "fork", "--statistics", "smoothed_branch_index,solidity"]


def with_branches(*values: str) -> str:
    """A table of colonies with smoothed I_B."""
    lines = [f"{','.join((ROW | {'replicate': str(number)}).values())},{one}" for number, one in enumerate(values)]
    return "\n".join([f"{','.join(ROW)},smoothed_branch_index", *lines]) + "\n"


@pytest.mark.parametrize("command", ["fit", "infer"])
@pytest.mark.parametrize("value", ["abc", "0,17", "-3", "inf"])
def test_a_number_of_a_statistic_that_measure_does_not_know_is_refused_by_name(
    tmp_path: Path, refused: Run, command: str, value: str
) -> None:
    line = refused([command, written(tmp_path / "measurements.csv", with_branches("0.1", f'"{value}"')), *OFFLATTICE])
    assert f"a.png: smoothed_branch_index is '{value}', it must be a number of at least -0.0434783" in line


@pytest.mark.parametrize("command", ["fit", "infer"])
def test_a_statistic_without_any_number_is_refused_by_name(tmp_path: Path, refused: Run, command: str) -> None:
    line = refused([command, written(tmp_path / "measurements.csv", with_branches("", "")), *OFFLATTICE])
    assert "statistics: 'smoothed_branch_index' has no number in any of the 2 rows: leave it out" in line


TABLES: dict[str, Case] = {
    "empty": ("", "no rows"),
    "header only": (table().splitlines()[0], "no rows"),
    "utf-16": (table().encode("utf-16"), "need UTF-8"),
    "nul": (table().replace("700", "7\0"), "line 2: holds a NUL"),
    "latin-1": (table().replace("masks", "é").encode("latin-1"), "line 2: not a text file in UTF-8"),
    "no column": (table().replace("max_radius", "largest"), "no column max_radius"),
    "semicolons": (table().replace(",", ";"), "separated by commas and not by semicolons"),
    "semicolons, and commas in numbers": (table().replace(",", ";").replace(".", ","), "and not by semicolons"),
    "tabs": (table().replace(",", "\t"), "separated by commas and not by tabs"),
    "twice a column": (table().replace("warnings", "area", 1), "line 1: a column appears twice, 'area'"),
    "open quote": (table() + '"', "line 4: not CSV"),
    "many cells": (table() + "," * 15 + "1,2\n", "line 4: 17 cells, the first line names 16 columns"),
    "cut off": (table().rpartition(",")[0].rpartition(",")[0] + "\n", "cells, the first line names 16 columns"),
    "other quantities": ("time,value\n1,2\n", "no column file, condition"),
    "hidden condition": (table(condition="x\x1b"), r"line 3: condition is 'x\x1b'"),
    "radius beyond the largest": (table(radius="20"), "line 3: radius is 20 µm, it must be at most max_radius, 15 µm"),
    "area beyond the largest": (table(area="900"), "line 3: area is 900 µm², it must be at most 775"),
    "pixels and area": (table(um_per_pixel="1000", area="9e9"), "line 3: area is 9e+09 µm², it must be at most"),
    "no hours": (table(hours=""), "a.png: its hours are unknown"),
    "no hours of any": (table(hours="").replace(",4,", ",,"), "a.png: its hours are unknown"),
    "no pixel size": (
        table(um_per_pixel=""),
        "a.png: um_per_pixel is empty in the table, it must be a number from 0.001 to 1000 µm",
    ),
    "radius below that of a disc": (table(radius="5"), "line 3: radius is 5 µm, it must be at least"),
    "largest radius without end": (table(max_radius="1e300"), "line 3: max_radius is 1e+300 µm, it must be at most"),
    "compactness without end": (table(compactness="1e300"), "it must be a number from 0.9 to 1e+09"),
    "no largest radius": (
        table(max_radius=""),
        "a.png: max_radius is empty in the table, it must be a number above 0 µm",
    ),
    "largest radius of ten metres": (table(max_radius="1e7"), "a.png: max_radius is 1e+07 µm, the largest of its"),
    "a colony twice": (table(replicate="1"), "line 3: replicate '1' at 4 hours appears twice, line 2 is of it, too"),
    "pixels of no cell": (table(um_per_pixel="0.001"), "a.png: um_per_pixel is 0.001, it must be a number from 0.0075"),
    "pixels of many cells": (table(um_per_pixel="20"), "a.png: um_per_pixel is 20, it must be a number from 0.0075"),
    "no cell": (table().replace("700", "1").replace("10,15", ".5,1"), "a.png: max_radius is 1 µm, the largest"),
    "two conditions": (table(condition="y"), "the data have 'x', 'y'"),
    "pixels of two sizes": (table(um_per_pixel="1.5"), "um_per_pixel runs from 1 to 1.5"),
}


@pytest.mark.parametrize("command", ["fit", "infer"])
@pytest.mark.parametrize("name", TABLES)
def test_a_malformed_table_is_refused(tmp_path: Path, refused: Run, name: str, command: str) -> None:
    data, words = TABLES[name]
    written(tmp_path / "measurements.csv", data)
    assert words in refused([command, tmp_path / "measurements.csv", "--free", "mobility"])


BESIDE: dict[str, tuple[str, str | bytes, str]] = {
    "failures of other columns": ("failures.csv", "image,reason\na,b\n", "no columns file and error"),
    "failures in utf-16": ("failures.csv", "file,error\na,b\n".encode("utf-16"), "need UTF-8"),
    "failures without an end": ("failures.csv", 'file,error\na,"b\n', "line 2: not CSV"),
    "empty failures": ("failures.csv", "", "no columns file and error"),
    "empty mask": ("masks/a.png", b"", "a.png: is empty (0 bytes)"),
    "mask of text": ("masks/a.png", b"colony", "a.png: is no image"),
}


@pytest.mark.parametrize("name", BESIDE)
def test_a_malformed_file_beside_a_table_is_refused(tmp_path: Path, refused: Run, name: str) -> None:
    file, data, words = BESIDE[name]
    written(tmp_path / "data" / "measurements.csv", table())
    written(tmp_path / "data" / file, data)
    line = refused(["fit", tmp_path / "data" / "measurements.csv", "--free", "mobility"])
    assert file in line
    assert words in line


def test_a_number_that_a_mask_has_and_its_table_has_not_is_refused(tmp_path: Path, refused: Run) -> None:
    """Who empties a cell to leave an image out is told how to."""
    source = written(tmp_path / "data" / "measurements.csv", table().replace("700", ""))
    (tmp_path / "data" / "masks").mkdir()
    Image.fromarray(DISC < 100).save(tmp_path / "data" / "masks" / "a.png")
    line = refused(["fit", source, "--free", "mobility"])
    assert "a.png: area is empty in the table, its mask" in line
    assert "leave the row out for the image not to count" in line


def test_a_mask_of_another_image_is_refused(tmp_path: Path, refused: Run) -> None:
    source = written(tmp_path / "data" / "measurements.csv", table())
    (tmp_path / "data" / "masks").mkdir()
    Image.fromarray(DISC < 100).save(tmp_path / "data" / "masks" / "a.png")
    other = table().replace("700", "600")
    written(source, other)
    assert "a.png: area is 600 µm² in the table, its mask" in refused(["fit", source, "--free", "mobility"])


TRUTHS = {"empty": "", "list": "[1]", "other names": "{}", "text": '{"diffusivity": "much"}', "nested": "[" * 10**5}


@pytest.mark.parametrize("name", TRUTHS)
def test_a_malformed_truth_is_refused(tmp_path: Path, refused: Run, name: str) -> None:
    written(tmp_path / "measurements.csv", table())
    written(tmp_path / "truth" / "parameters.json", TRUTHS[name])
    assert "parameters.json: " in refused(["fit", tmp_path / "measurements.csv", "--truth", "--free", "mobility"])


PRIORS: dict[str, Case] = {
    "empty": ("", "the prior is empty"),
    "no toml": ("[mobility", "no prior can be read"),
    "utf-16": ("[mobility]".encode("utf-16"), "no prior can be read: is a text file in UTF-16"),
    "nested": ("a = " + "[" * 3000, "no prior can be read: not TOML"),
    "digits": (f"a = {'1' * 5000}", "no prior can be read: not TOML"),
    "other": ("[colour]\n", "unknown parameter 'colour'"),
    "number": ("mobility = 3", "prior of mobility is 3"),
    "text": ("[mobility]\ndistribution = 'uniform'\nlow = '1'\nhigh = 2", "low is '1', it must be a finite number"),
    "hundreds of digits": (f"[mobility]\ndistribution = 'uniform'\nlow = {'1' * 400}\nhigh = 2", "low is 1111"),
}


@pytest.mark.parametrize("name", PRIORS)
def test_a_malformed_prior_is_refused(tmp_path: Path, refused: Run, name: str) -> None:
    data, words = PRIORS[name]
    written(tmp_path / "measurements.csv", table())
    line = refused(["infer", tmp_path / "measurements.csv", "--prior", written(tmp_path / "prior.toml", data)])
    assert "prior.toml: " in line
    assert words in line


def test_recipes_are_refused_by_the_command_too(tmp_path: Path, refused: Run) -> None:
    """tests/simulation/test_recipes.py has the others."""
    line = refused(["synthesize", "--recipe", written(tmp_path / "r.toml", "")])
    assert "r.toml: no data set there" in line


# ------------------------------------------------------------------------------------------------------------ any bytes

FAST = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
PIECES = st.sampled_from(
    [
        *ROW,
        *ROW.values(),
        ",",
        "\n",
        "\r\n",
        '"',
        ";",
        "\0",
        "\ufeff",
        "-",
        "e",
        ".",
        "nan",
        "1_0",
        "[[image]]",
        "=",
        "'",
    ]
)
TEXTS = st.lists(st.one_of(PIECES, st.text(max_size=3)), max_size=40).map("".join)
NUMBERS = st.one_of(st.floats().map(repr), st.text(st.characters(codec="utf-8"), max_size=6))


@FAST
@given(TEXTS, st.sampled_from([HEADER, ""]), st.sampled_from(["manifest.csv", "manifest.toml"]))
def test_any_manifest_is_refused_in_one_line(tmp_path: Path, refused: Run, text: str, head: str, name: str) -> None:
    for other in (tmp_path / "data").glob("manifest.*"):
        other.unlink()
    refused(["measure", written(tmp_path / "data" / name, (head + text).encode(errors="replace")).parent])


@FAST
@given(st.dictionaries(st.sampled_from([name for name in ROW if name not in ("file", "mask")]), NUMBERS, min_size=1))
def test_any_table_is_read_or_refused_in_one_line(tmp_path: Path, refused: Run, changed: dict[str, str]) -> None:
    row = {**ROW, **changed}
    with (tmp_path / "measurements.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(row))
        writer.writerows([dict(zip(row, row, strict=True)), row])
    try:
        (read,) = read_measurements(tmp_path / "measurements.csv")
    except InputError:
        assert "line " in refused(["fit", tmp_path / "measurements.csv"])
        return
    assert set(NEEDED) <= set(read)
    for name in ("area", "radius", "max_radius", "um_per_pixel", "hours"):
        assert not read[name] <= 0
        assert read[name] != float("inf")
