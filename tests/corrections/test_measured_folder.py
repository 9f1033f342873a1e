"""Outlines corrected by hand, from results into the data set and back, without napari."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from measured_discs import SIDE, disc, measured
from PIL import Image

from yeastfit import InputError, read_dataset
from yeastfit.commands import app as cli
from yeastfit.corrections.manifest_masks import name_mask
from yeastfit.corrections.measured_folder import MeasuredFolder
from yeastfit.corrections.reader import layers_of, place_in, read_layers, reader_of
from yeastfit.measure.reading.images import read_micrograph
from yeastfit.storage import read_json, write_json


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Read only."""
    return measured(tmp_path_factory.mktemp("measured"))


@pytest.fixture
def copies(folders: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """Data and results, moved together to another place."""
    shutil.copytree(folders[0].parent, tmp_path / "moved")
    return tmp_path / "moved" / "data", tmp_path / "moved" / "results"


def rows(results: Path) -> dict[str, dict[str, str]]:
    with (results / "measurements.csv").open(newline="", encoding="utf-8") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def test_doubtful_photographs_are_those_with_doubts_and_those_not_measured(folders: tuple[Path, Path]) -> None:
    folder = MeasuredFolder.of(folders[1])
    assert [one.image.label for one in folder.photographs] == ["a.png", "b.png", "c.png"]
    assert [one.doubtful for one in folder.photographs] == [False, True, True]
    assert [folder.next_doubtful(after) for after in (None, 0, 1, 2)] == [1, 1, 2, 1]
    a, b, c = folder.photographs
    assert a.remarks == []
    assert b.remarks[0].startswith("several objects: There is another")
    assert c.remarks[0].startswith("Not measured. ")
    assert not c.outline().any()
    assert (a.outline() == disc(30)).mean() > 0.98


def test_layers_are_photograph_outline_and_doubts_in_micrometres(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folders[1])  # not where it was measured
    for path in (".", "measurements.csv", str(folders[1])):
        reader = reader_of(path)
        assert reader is not None
        (pixels, image, kind), (labels, outline, other) = reader(path)
        assert (kind, other) == ("image", "labels")
        assert pixels.shape == labels.shape == (SIDE, SIDE)
        assert set(np.unique(labels)) == {0, 1}
        assert image["name"] == "b.png"  # the first doubtful one
        assert image["scale"] == outline["scale"] == (0.5, 0.5)
        assert image["metadata"]["yeastfit"]["doubts"][0].startswith("several objects")
        place = place_in(outline["metadata"])
        assert place is not None
        assert place[1] == 1


def test_other_folders_and_files_are_left_to_other_readers(folders: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "measurements.csv").write_text("file,area\n")
    for path in (str(tmp_path), str(tmp_path / "measurements.csv"), str(folders[0]), str(tmp_path / "missing")):
        assert reader_of(path) is None
    assert reader_of([str(folders[1])]) is None
    assert place_in({}) is None
    with pytest.raises(InputError, match="holds no results of yeastfit measure"):
        read_layers(str(tmp_path))


def test_a_corrected_outline_is_measured_next_and_marked(copies: tuple[Path, Path]) -> None:
    data, results = copies
    folder = MeasuredFolder.of(results)
    drawn = {"b.png": disc(20, 88, 88), "c.png": disc(10) | disc(5, 100, 20)}
    for number, mask in enumerate(drawn.values(), 1):
        folder = folder.corrected(number, mask)
    assert folder.next_doubtful() is None
    assert MeasuredFolder.of(results).next_doubtful() is None  # before it is measured again
    np.testing.assert_array_equal(MeasuredFolder.of(results).photographs[1].outline(), drawn["b.png"])
    assert read_micrograph(data / "corrected" / "b.png").pixel_size == pytest.approx(0.5, rel=1e-4)

    assert cli.run(["measure", str(data), "--out", str(results), "--jobs", "1"]) == 0
    table = rows(results)
    for name, mask in drawn.items():
        assert float(table[name]["area"]) == mask.sum() * 0.25
        assert "corrected by hand" in table[name]["warnings"]
    assert table["a.png"]["warnings"] == ""
    assert MeasuredFolder.of(results).next_doubtful() is None
    assert (results / "index.html").read_text(encoding="utf-8").count("corrected by hand") > 2


def test_only_the_mask_of_a_row_is_written(copies: tuple[Path, Path]) -> None:
    manifest = copies[0] / "manifest.csv"
    before = manifest.read_bytes()
    name_mask(manifest, copies[0] / "c.png", "b.png")
    first, *others, last = before.decode().split("\r\n")
    expected = "\r\n".join([f"{first},mask", *(one and f"{one}," for one in others), last])
    assert manifest.read_bytes().decode() == f"{expected},b.png\r\n"
    name_mask(manifest, copies[0] / "c.png", "a.png")
    assert manifest.read_bytes().decode() == f"{expected},a.png\r\n"


def test_comments_of_a_manifest_in_toml_are_kept(copies: tuple[Path, Path]) -> None:
    (copies[0] / "manifest.csv").unlink()
    manifest = copies[0] / "manifest.toml"
    images = "\n".join(
        f'[[image]]\nfile = "{name}.png"  # {name}\nreplicate = 1\nhours = {k + 5}\n' for k, name in enumerate("abc")
    )
    manifest.write_text(f"um_per_pixel = 0.5 # of all\n\n{images}", encoding="utf-8")
    before = manifest.read_text(encoding="utf-8")
    name_mask(manifest, copies[0] / "b.png", "c.png")
    after = manifest.read_text(encoding="utf-8")
    assert read_dataset(copies[0]).frames[1].outline == copies[0] / "c.png"
    assert after.replace('mask = "c.png"\n', "") == before


def test_a_manifest_that_could_not_be_read_is_not_written(copies: tuple[Path, Path]) -> None:
    manifest = copies[0] / "manifest.csv"
    before = manifest.read_bytes()
    with pytest.raises(InputError, match=r"there is no file corrected/missing\.png"):
        name_mask(manifest, copies[0] / "c.png", "corrected/missing.png")
    with pytest.raises(InputError, match="has no row of"):
        name_mask(manifest, copies[0] / "d.png", "a.png")
    assert manifest.read_bytes() == before


def test_a_second_correction_replaces_the_first_and_no_other_file(copies: tuple[Path, Path]) -> None:
    data, results = copies
    (data / "corrected").mkdir()
    own = data / "corrected" / "b.png"
    Image.fromarray(disc(3)).save(own)
    kept = own.read_bytes()
    folder = MeasuredFolder.of(results).corrected(1, disc(20, 88, 88)).corrected(1, disc(21, 88, 88))
    assert own.read_bytes() == kept
    assert sorted(one.name for one in own.parent.iterdir()) == ["b.png", "b_2.png"]
    np.testing.assert_array_equal(folder.photographs[1].outline(), disc(21, 88, 88))
    assert read_dataset(data).frames[1].outline == data / "corrected" / "b_2.png"


def test_an_outline_of_several_photographs_stays_that_of_the_others(copies: tuple[Path, Path]) -> None:
    data, results = copies
    MeasuredFolder.of(results).corrected(1, disc(20, 88, 88))
    name_mask(data / "manifest.csv", data / "c.png", "./corrected/b.png")
    MeasuredFolder.of(results).corrected(1, disc(21, 88, 88))
    _, b, c = read_dataset(data).frames
    assert (b.outline, c.outline) == (data / "corrected" / "b_2.png", data / "corrected" / "b.png")
    np.testing.assert_array_equal(MeasuredFolder.of(results).photographs[2].outline(), disc(20, 88, 88))


def test_a_seed_point_in_the_outer_half_of_the_last_pixel_is_on_it(copies: tuple[Path, Path]) -> None:
    data, results = copies
    manifest = data / "manifest.csv"
    first, *others = manifest.read_text(encoding="utf-8-sig").split()
    seeds = [f"{one},{SIDE - 0.3} 88" if "b.png" in one else f"{one}," for one in others]
    manifest.write_text("\n".join([f"{first},seed_point", *seeds, ""]), encoding="utf-8")
    folder = MeasuredFolder.of(results)
    with pytest.raises(InputError, match=f"b.png: the seed_point of its manifest, {SIDE - 0.3:g} 88, is not on"):
        folder.corrected(1, disc(20, 88, 88))
    folder.corrected(1, disc(20, SIDE - 20, 88))
    np.testing.assert_array_equal(MeasuredFolder.of(results).photographs[1].outline(), disc(20, SIDE - 20, 88))


def test_a_photograph_that_its_manifest_has_lost_keeps_its_outline(copies: tuple[Path, Path]) -> None:
    data, results = copies
    manifest, first = data / "manifest.csv", MeasuredFolder.of(results)
    folder = first.corrected(1, disc(20, 88, 88))
    kept = [one for one in manifest.read_text(encoding="utf-8-sig").splitlines() if "b.png" not in one]
    manifest.write_text("\n".join([*kept, ""]), encoding="utf-8")
    for one in (first, folder):
        with pytest.raises(InputError, match=r"has no row of .*b\.png"):
            one.corrected(1, disc(21, 88, 88))
    np.testing.assert_array_equal(folder.photographs[1].outline(), disc(20, 88, 88))
    assert [one.name for one in (data / "corrected").iterdir()] == ["b.png"]


def test_what_cannot_be_saved_changes_nothing(copies: tuple[Path, Path]) -> None:
    data, results = copies
    manifest = data / "manifest.csv"
    first, *others = manifest.read_text(encoding="utf-8-sig").split()
    seeds = [f"{one},{'90 90' if 'b.png' in one else ''}" for one in others]
    manifest.write_text("\n".join([f"{first},seed_point", *seeds, ""]), encoding="utf-8")
    before = manifest.read_bytes()
    folder = MeasuredFolder.of(results)
    for mask, words in (
        (np.zeros((SIDE, SIDE), bool), "b.png: nothing is painted"),
        (disc(10, 40, 40), "b.png: the seed_point of its manifest, 90 90, is not on the colony"),
        (np.ones((SIDE, SIDE), bool), "b.png: the colony fills the image, need background"),
        (np.arange(SIDE * SIDE).reshape(SIDE, SIDE) == 90 * SIDE + 90, "b.png: the colony of the mask has 1 pixels"),
        (np.indices((SIDE, SIDE)).sum(axis=0) > SIDE // 2, "b.png: the colony covers two corners of the image or more"),
    ):
        with pytest.raises(InputError, match=words):
            folder.corrected(1, mask)
    assert manifest.read_bytes() == before
    assert list((data / "corrected").iterdir()) == []


def test_without_a_manifest_outlines_are_shown_and_not_saved(copies: tuple[Path, Path]) -> None:
    _, results = copies
    record = read_json(results / "manifest.json")
    write_json(results / "manifest.json", record | {"dataset": None})
    folder = MeasuredFolder.of(results)
    assert [layers_of(folder, number)[0][1]["name"] for number in range(3)] == ["a.png", "b.png", "c.png"]
    with pytest.raises(InputError, match="measured without a manifest"):
        folder.corrected(1, disc(10))


def test_photographs_that_have_gone_are_named(copies: tuple[Path, Path]) -> None:
    data, results = copies
    (data / "a.png").rename(data / "z.png")
    with pytest.raises(InputError, match=r"there is no file a\.png"):
        MeasuredFolder.of(results)
    (data / "manifest.csv").unlink()
    with pytest.raises(InputError, match=r"manifest.csv: is not there any more"):
        MeasuredFolder.of(results)


def test_nothing_of_it_is_imported_unless_napari_asks() -> None:
    program = (
        "import sys, yeastfit; from yeastfit.commands import app; app.run(['measure', '--help']);"
        "assert not {name for name in sys.modules if name.startswith(('yeastfit.corrections', 'napari', 'magicgui'))};"
        "import yeastfit.corrections.reader;"
        "assert not {name for name in sys.modules if name.startswith(('napari', 'magicgui', 'qtpy', 'PyQt'))}"
    )
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL, env={**os.environ})
