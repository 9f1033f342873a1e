"""The command line from end to end, on small data, and what it says of bad input."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import tifffile
import typer
from PIL import Image

from yeastfit import FORWARD_MODELS, ForwardModel, Simulator, Targets
from yeastfit.commands import app as cli
from yeastfit.commands.generated.model import ChosenModel, ModelOptions
from yeastfit.commands.generated.options import generated
from yeastfit.errors import SimulationError
from yeastfit.measure.reading.dataset import read_dataset
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.simulation.result import Simulation

RECIPE = """
[small]
seed = 5
hours = [3, 5, 8]
replicates = 3
extent = 75.0
parameters = { mobility = 1.0, metabolic_rate = 1.0, aspect_ratio = 0.6 }
numerics = { domain = 14.0, spacing = 0.2, dt = 0.01, capacity = 32 }
"""


SIZE = ["--domain", "12", "--spacing", "0.2", "--capacity", "12", "--members", "2"]  # of all colonies: compiled once


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synthetic")
    (folder / "recipes.toml").write_text(RECIPE)
    assert cli.run(["synthesize", "--recipe", str(folder / "recipes.toml"), "--out", str(folder)]) == 0
    return folder / "small"


def smallest_side(path: Path) -> int:
    with Image.open(path) as image:
        return min(image.size)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_data_set_holds_what_it_should_and_is_made_again_bit_for_bit(dataset: Path, tmp_path: Path) -> None:
    frames = read_dataset(dataset).frames
    assert len(frames) == 9
    truth = json.loads((dataset / "truth" / "parameters.json").read_text())
    assert truth["aspect_ratio"] == pytest.approx(0.6)
    assert len(rows(dataset / "truth" / "curves.csv")) == 9
    with tifffile.TiffFile(frames[0].path) as file:
        assert file.pages[0].dtype == np.uint8
    recipe = str(dataset.parent / "recipes.toml")
    assert cli.run(["synthesize", "--recipe", recipe, "--only", "small", "--out", str(tmp_path)]) == 0
    for frame in frames:
        assert frame.path.read_bytes() == (tmp_path / "small" / "images" / frame.path.name).read_bytes()


@pytest.mark.parametrize("rules", ["--hard", "--relaxed"])
def test_simulate_writes_curves_and_pictures(tmp_path: Path, rules: str) -> None:
    how = ["--mobility", "0.8", rules, "--time", "2.4", "--every", "0.4"]
    assert cli.run(["simulate", "--out", str(tmp_path), *SIZE, *how]) == 0
    table = rows(tmp_path / "curves.csv")
    assert len(table) == 12
    expected = "member time hours compactness mean_radius growth_rate cell_count area perimeter radius"
    assert set(expected.split()) <= set(table[0])
    last = {name: float(value) for name, value in table[5].items()}
    assert last["hours"] == pytest.approx(2.4 / 0.46)
    assert last["cell_count"] == 7.0 or rules == "--relaxed"
    assert last["area_um2"] == pytest.approx(last["area"] * 7.5**2)
    assert smallest_side(tmp_path / "colony_1.png") > 300
    assert float(Simulation.load(tmp_path / "simulation.npz").parameters.mobility) == pytest.approx(0.8)
    assert json.loads((tmp_path / "manifest.json").read_text())["configuration"]["hard"] == (rules == "--hard")


@pytest.mark.usefixtures("undrawn")
def test_capacity_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["simulate", "--out", str(tmp_path), *SIZE, "--time", "3.6", "--every", "0.6"]) == 0
    assert "2 of 2 colonies: births were cut" in capsys.readouterr().err


@pytest.mark.thorough
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("statistics", ["compactness", "compactness,area"])
def test_colonies_grow_to_an_area_whatever_is_measured(tmp_path: Path, statistics: str) -> None:
    how = ["--until-area", "3", "--statistics", statistics, "--time", "3.6"]
    assert cli.run(["simulate", "--out", str(tmp_path), *SIZE, *how]) == 0
    for row in rows(tmp_path / "curves.csv"):
        assert float(row["time"]) < 3
        assert float(row["compactness"]) > 1
        assert ("area" in row) is (statistics != "compactness")
        assert 3 <= float(row.get("area", 3)) < 4


@pytest.mark.thorough
def test_measure_a_data_set(dataset: Path, tmp_path: Path) -> None:
    assert cli.run(["measure", str(dataset), "--out", str(tmp_path), "--jobs", "1"]) == 0
    frames = read_dataset(dataset).frames
    table = rows(tmp_path / "measurements.csv")
    assert [row["file"] for row in table] == [f"images/{frame.path.name}" for frame in frames]
    assert [(row["replicate"], float(row["hours"])) for row in table] == [(f.replicate, f.hours) for f in frames]
    units = {name: column["unit"] for name, column in json.loads((tmp_path / "columns.json").read_text()).items()}
    assert list(units) == list(table[0])
    assert (units["area"], units["radius"], units["compactness"]) == ("µm²", "µm", "")
    curves = rows(tmp_path / "curves.csv")
    assert len({curve["statistic"] for curve in curves}) * 3 == len(curves)
    for curve in curves:
        if curve["statistic"] in ("area", "compactness"):
            values = [float(row[curve["statistic"]]) for row in table if row["hours"] == curve["hours"]]
            assert int(curve["count"]) == len(values) == 3
            assert float(curve["mean"]) == pytest.approx(np.mean(values))
            assert float(curve["standard_error"]) == pytest.approx(np.std(values, ddof=1) / 3**0.5)
    for part in ("masks", "overlays"):
        assert {path.stem for path in (tmp_path / part).iterdir()} == {frame.path.stem for frame in frames}
    assert all(smallest_side(tmp_path / name) > 300 for name in ("curves.png", "contact_sheet.png"))
    assert (tmp_path / "index.html").read_text(encoding="utf-8").count("<img ") == 9 + 1 + 1
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert len(manifest["inputs"]) == 10
    assert manifest["failed"] == []
    assert "seed" not in manifest  # measuring draws nothing


def test_measure_goes_on_after_bad_files_and_says_so(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = read_dataset(dataset).frames[-1].path
    bad, bare = tmp_path / "notes.tif", tmp_path / "bare.png"
    bad.write_text("not an image")
    Image.fromarray(tifffile.imread(good)).save(bare)
    out = tmp_path / "out"
    assert cli.run(["measure", str(bad), str(bare), str(good), "--out", str(out)]) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert len(errors) == 2
    assert "notes.tif" in errors[0]
    assert "--pixel-size" in errors[1]
    (row,) = rows(out / "measurements.csv")
    assert row["file"] == good.name
    assert float(row["um_per_pixel"]) == pytest.approx(0.75, rel=1e-4)
    # what has no scale is outlined all the same
    assert {path.name for path in (out / "masks").iterdir()} == {"bare.png", f"{good.stem}.png"}
    with Image.open(out / "masks" / f"{good.stem}.png") as image:
        mask = np.asarray(image)
    assert mask.sum() * 0.75**2 == pytest.approx(float(row["area"]), rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "--aspect-ratio", "1.5"], ["--aspect-ratio", "1.5", "(0, 1]"]),
        (["simulate", "--mobility", "-1"], ["mobility", "-1"]),
        (["simulate", "--mobility", "nan"], ["mobility", "nan"]),
        (["simulate", "--domain", "10.03"], ["domain / spacing"]),
        (["simulate", "--every", "20"], ["every is 20"]),
        (["simulate", "--members", "0"], ["members is 0"]),
        (["simulate", "--capacity", "1"], ["capacity is 1"]),
        (["fit", "nowhere"], ["nowhere", "manifest.csv"]),
        (["synthesize", "--recipe", "nowhere.toml"], ["nowhere.toml"]),
        (["measure", "nowhere.tif"], ["nowhere.tif"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run([*arguments, "--out", str(tmp_path / "out")]) == 2
    output = capsys.readouterr()
    (line,) = output.err.strip().splitlines()
    assert line.startswith("error: ")
    assert all(word in line for word in words)
    assert not list((tmp_path / "out").glob("*.csv"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("colony01_03.0h.tif", "gone.tif"), ["line 2", "gone.tif"]),
        (lambda text: text.replace(",3,0.75", ",nan,0.75", 1), ["line 2", "hours is 'nan'"]),
    ],
)
def test_a_bad_data_set_leaves_an_older_fit_as_it_was(
    change, words: list[str], dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "images").symlink_to(dataset / "images")
    (tmp_path / "manifest.csv").write_text(change((dataset / "manifest.csv").read_text()))
    out = tmp_path / "out"
    out.mkdir()
    (out / "fit.json").write_text("an older fit")
    assert cli.run(["fit", str(tmp_path), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert all(word in error for word in words)
    assert (out / "fit.json").read_text() == "an older fit"


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([command, "--help"]) == 0
    said = capsys.readouterr().out
    assert "--out" in said
    assert cli.loaded(command).help.partition("\n")[0] == cli.COMMANDS[command]


def test_an_option_that_is_given_again_is_told_of(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    again = ["--births", "clocks", "--births", "clocks", "--only", "a", "--only", "b"]
    assert cli.run(["synthesize", "--recipe", str(tmp_path / "none.toml"), "--out", str(tmp_path), *again[:2]]) == 2
    assert "more than once" not in capsys.readouterr().err
    given = ["--recipe", str(tmp_path / "none.toml"), "--out", str(tmp_path), *again]
    assert cli.run(["synthesize", *given]) == 2
    assert capsys.readouterr().err.splitlines()[:-1] == [
        "warning: --births is given more than once, the last one counts"
    ]


def test_a_computation_that_comes_to_nothing_is_one_line_and_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*arguments: object, **options: object) -> None:
        raise SimulationError("nothing came of it")

    monkeypatch.setattr("yeastfit.inference.models.algebraic.run_simulation", fails)
    assert cli.run(["simulate", "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().err.strip() == "error: nothing came of it"


def test_options_follow_from_any_set_of_parameters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Culture(ForwardModel):
        parameters = ParameterSet(
            (
                Parameter("growth_rate", "r", "growth per cell", (0.1, 1.0), 0.5, unit="1/h"),
                Parameter("capacity", "K", "cells at most", (10.0, 1000.0), 100.0),
            )
        )
        free = ("growth_rate",)

        def simulator(self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]) -> Simulator:
            raise NotImplementedError

    monkeypatch.setitem(FORWARD_MODELS, "culture", Culture)
    received: list[tuple[int, ChosenModel]] = []

    @generated(chosen=ModelOptions("fit"))
    def command(count: Annotated[int, typer.Option()] = 1, *, chosen: ChosenModel) -> None:
        received.append((count, chosen))

    def run(*arguments: str) -> None:
        app = typer.Typer()
        app.command()(command.called_with(arguments))
        app(arguments, standalone_mode=False)

    run("--model", "culture", "--growth-rate", "0.25", "--count", "3")
    ((count, chosen),) = received
    assert (count, chosen.name, chosen.values) == (3, "culture", {"growth_rate": 0.25})
    run("--model", "culture", "--help")
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "r, growth per cell. Plausible: 0.1 to 1 1/h. Default: 0.5." in said


def test_real_micrographs_are_outlined(real_data: Path, tmp_path: Path) -> None:
    """One of them; all nine are a slow test of the segmentation."""
    path = real_data / "raw" / "awri796_50um_s10.tif"
    assert cli.run(["measure", str(path), "--out", str(tmp_path)]) == 0
    (row,) = rows(tmp_path / "measurements.csv")
    assert float(row["um_per_pixel"]) == pytest.approx(1.55008, rel=1e-4)
    assert "border" in row["warnings"]
