"""`yeastfit fit`: a table of measurements in, tables and pictures out, and what it says of bad input."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from known_colonies import photographed, write_measurements
from PIL import Image
from stand_in import ROOT, SETTINGS, STATISTICS, TIMES, StandIn, bent, fitted, logs

from yeastfit import ColonySimulator, Fit, FitSettings, FitStatus, Parameters, Scales, Targets, read_truth
from yeastfit.commands import app as cli
from yeastfit.commands import fit as cli_fit
from yeastfit.commands.measured_source import Measurements
from yeastfit.commands.options import named_pairs_in
from yeastfit.errors import SimulationError
from yeastfit.inference.fit.bootstrap_profile import Explored, _box
from yeastfit.inference.fit.response_surface import response_surface
from yeastfit.measure.measurements_table import NEEDED, TABLE
from yeastfit.measure.statistics.registry import STATISTICS as KINDS
from yeastfit.model.parameters import PARAMETERS
from yeastfit.results.folder import results_folder
from yeastfit.storage import write_json, write_table

FILES = (
    *("fit.json", "parameters.csv", "targets.csv", "fit.png", "convergence.png", "spectrum.png", "ellipses.png"),
    *("bootstrap.csv", "bootstrap.png", "profiles.csv", "profiles.png", "index.html", "manifest.json"),
)
TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)
SCALES = Scales()


def table(folder: Path, conditions: dict[str, Parameters], replicates: int = 6) -> Path:
    """A measurements.csv of colonies like the stand-ins, without masks."""
    rng, lines = np.random.default_rng(0), list[dict[str, Any]]()
    for condition, truth in conditions.items():
        curves = bent(logs(truth)[None])[0] + rng.normal(size=(replicates, len(ROOT))) @ ROOT.T
        for colony, values in enumerate(curves.reshape(replicates, len(STATISTICS), len(TIMES)), start=1):
            for k, time in enumerate(TIMES):
                name = f"{condition}{colony}_{k}.tif"
                known = (name, condition, colony, SCALES.hours(time), 0.75, f"masks/{name}", 3.0 * SCALES.length)
                row = dict(zip(NEEDED, known, strict=True))
                sizes = dict(zip(STATISTICS, values[:, k], strict=True))
                lines.append(row | {n: v * SCALES.length ** KINDS[n].unit_power for n, v in sizes.items()})
    write_table(folder / TABLE, lines)
    return folder / TABLE


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Stand-ins in the place of colonies, for the fit and for what is grown around it; what the fit was asked for."""
    asked: list[dict[str, Any]] = []

    def run_fit(
        targets: dict[str, Targets], simulators: dict[str, ColonySimulator], *, settings: FitSettings, **options: Any
    ) -> Fit:
        (free,), fixed = {one.parameters.names for one in simulators.values()}, next(iter(simulators.values())).fixed
        asked.append({"targets": targets, "settings": settings, "free": free, "fixed": fixed, **options})
        options["progress"]("growing", 0.5)
        chosen = {name: options[name] for name in ("own", "bounds", "seed")}
        short = replace(SETTINGS, members=(64,), spreads=(0.1,), measurement_error=settings.measurement_error)
        held = dict.fromkeys(targets, Parameters(**fixed))
        return fitted(targets, held=held, settings=short, free=free, **chosen)

    def explore(result: Fit, simulators: dict[str, ColonySimulator], fine: dict[str, ColonySimulator]) -> Explored:
        held = Parameters(**result.parameters)
        stand_in = StandIn(free=[entry.parameter for entry in result.space.entries], held=held)
        simulate: Callable[[np.ndarray], np.ndarray] = lambda theta: bent(stand_in.logarithms(np.exp(theta)))  # noqa: E731
        return Explored(result, response_surface(simulate, *_box(result), 64, seed=0), 64)

    monkeypatch.setattr(cli_fit, "run_fit", run_fit)
    monkeypatch.setattr(cli_fit, "explore", explore)
    return asked


def test_a_table_becomes_a_fit_with_tables_pictures_and_a_manifest(
    quick: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = table(tmp_path, {"": TRUTH}), tmp_path / "out"
    write_json(tmp_path / "truth" / "parameters.json", TRUTH.asdict())
    arguments = ["--statistics", ",".join(STATISTICS), "--bootstrap", "20", "--profile", "--truth", "--seed", "3"]
    assert cli.run(["fit", str(source), "--out", str(out), *arguments]) == 0
    assert {path.name for path in out.iterdir()} == {*FILES, "targets.csv", "colonies.csv"}
    for picture in out.glob("*.png"):
        with Image.open(picture) as image:
            assert min(image.size) > 200
    (asked,) = quick
    (targets,) = asked["targets"].values()
    assert targets.imaging.estimator == "mask"
    assert targets.mean.shape == (3, 4)
    result = Fit.load(out / "fit.json")
    assert result.seed == 3
    for name, value in (("mobility", 2.0), ("metabolic_rate", 0.7), ("aspect_ratio", 0.6)):
        assert abs(result.values[name] - value) < 4 * result.standard_errors[name]
    assert [row["parameter"] for row in rows(out / "parameters.csv")] == list(PARAMETERS.names)
    curves = rows(out / "targets.csv")
    assert len(curves) == 12
    assert {row["estimator"] for row in curves} == {"mask"}
    assert float(curves[0]["mean"]) == pytest.approx(result.targets.mean[0, 0])
    assert len(rows(out / "bootstrap.csv")) == 20
    assert {row["parameter"] for row in rows(out / "profiles.csv")} == set(result.free)
    manifest = json.loads((out / "manifest.json").read_text())
    assert [Path(path).name for path in manifest["inputs"]] == [TABLE]
    assert manifest["status"] == result.message
    said = " ".join(capsys.readouterr().out.split())
    for part in ("bootstrap of replicates: mobility", "profile of aspect_ratio", "converged", "true", "fixed"):
        assert part in said


@pytest.mark.usefixtures("undrawn", "quick")
def test_a_fit_is_kept_whose_profile_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def explore(*fit: object, **fine: object) -> None:
        raise SimulationError("40 of 64 simulations around the estimate failed (not finite)")

    monkeypatch.setattr(cli_fit, "explore", explore)
    arguments = ["fit", str(table(tmp_path, {"": TRUTH})), "--statistics", ",".join(STATISTICS), "--profile"]
    assert cli.run([*arguments, "--out", str(tmp_path / "out")]) == 1
    assert "no bootstrap and no profile: 40 of 64 simulations around" in capsys.readouterr().out
    assert Fit.load(tmp_path / "out" / "fit.json").converged
    assert "no bootstrap and no profile" in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.usefixtures("undrawn")
def test_a_bootstrap_of_one_colony_that_is_measured_ends_before_the_fit(
    quick: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The manifest names six: five cannot be read."""
    seen = Measurements.seen

    def one_left(data: Measurements, *arguments: Any) -> Any:
        rows = [row for row in data.rows if str(row["replicate"]) == "1"]
        return seen(replace(data, rows=rows), *arguments)

    monkeypatch.setattr(Measurements, "seen", one_left)
    arguments = ["fit", str(table(tmp_path, {"": TRUTH})), "--statistics", ",".join(STATISTICS), "--bootstrap", "20"]
    assert cli.run([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert "--bootstrap is 20 and a condition has one colony, need at least two" in capsys.readouterr().err
    assert not quick
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_conditions_are_fitted_together_and_options_arrive(
    quick: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = table(tmp_path, {"rich": TRUTH, "poor": TRUTH.replace(mobility=1.0), "other": TRUTH})
    several = ["--condition", "rich", "--condition", "poor", "--own", "mobility", "--free", "mobility,aspect-ratio"]
    numbers = ["--prior", "aspect-ratio=0.6:0.3", "--bounds", "mobility=0.1:10", "--measurement-error", "0.02"]
    how = ["--statistics", ",".join(STATISTICS), "--metabolic-rate", "0.7", "--starts", "2", "--method", "dogleg"]
    assert cli.run(["fit", str(source), "--out", str(tmp_path / "out"), *several, *numbers, *how]) == 0
    (asked,) = quick
    assert list(asked["targets"]) == ["rich", "poor"]
    assert (asked["free"], asked["own"]) == (("mobility", "aspect_ratio"), ("mobility",))
    assert asked["prior"] == {"aspect_ratio": (0.6, 0.3)}
    assert asked["bounds"] == {"mobility": (0.1, 10.0)}
    settings = asked["settings"]
    assert (settings.starts, settings.method, settings.measurement_error) == (2, "dogleg", 0.02)
    assert asked["fixed"]["metabolic_rate"] == pytest.approx(0.7)
    found = {(row["condition"], row["parameter"]): row for row in rows(tmp_path / "out" / "parameters.csv")}
    assert found["rich", "aspect_ratio"]["role"] == "shared"
    assert float(found["rich", "mobility"]["value"]) > float(found["poor", "mobility"]["value"])
    assert "condition" in capsys.readouterr().out


@pytest.mark.usefixtures("undrawn")
def test_a_fit_that_did_not_converge_is_exit_code_1(
    quick: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_fit = cli_fit.run_fit
    ended: dict[str, Any] = {"status": FitStatus.NOT_CONVERGED, "detail": "the limit of 8 steps was reached"}
    monkeypatch.setattr(cli_fit, "run_fit", lambda *a, **k: replace(run_fit(*a, **k), **ended))
    source = table(tmp_path, {"": TRUTH})
    assert cli.run(["fit", str(source), "--out", str(tmp_path / "out"), "--statistics", ",".join(STATISTICS)]) == 1
    assert "not converged: the limit of 8 steps was reached" in " ".join(capsys.readouterr().out.split())
    assert (tmp_path / "out" / "fit.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--prior", "1:0.1"], ["--prior is '1:0.1'", "mobility=1:0.1"]),
        (["--prior", "mobility"], ["--prior is 'mobility'", "mobility=1:0.1"]),
        (["--prior", "mobility=1:wide"], ["--prior is 'mobility=1:wide'"]),
        (["--prior", "elasticity=5:0.1"], ["--prior names 'elasticity'", "not free"]),
        (["--prior", "mobility=1:0"], ["--prior of mobility is 1, 0"]),
        (["--bounds", "mobility=2"], ["--bounds is 'mobility=2'"]),
        (["--bounds", "mobility=2:1"], ["--bounds of mobility are 2, 1"]),
        (["--own", "elasticity"], ["--own names 'elasticity'"]),
        (["--own", "mobility"], ["there is one condition only"]),
        (["--free", "speed"], ["--free names 'speed', which is unknown"]),
        (["--condition", "none"], ["condition: got 'none'"]),
        (["--method", "guess"], ["method is 'guess'", "dogleg"]),
        (["--statistics", "colour"], ["'colour'"]),
    ],
    ids=lambda value: " ".join(value)[:40],
)
def test_bad_options_are_one_line_and_exit_code_2(
    arguments: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = table(tmp_path, {"": TRUTH})
    known = ["--statistics", ",".join(STATISTICS)]
    with wrong_types():
        assert cli.run(["fit", str(source), "--out", str(tmp_path / "out"), *known, *arguments]) == 2
    *others, line = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert all("masks are missing" in one or "--statistics is given more than once" in one for one in others)
    assert all(word in line for word in words), line
    assert not (tmp_path / "out" / "fit.json").exists()


def test_of_several_conditions_one_is_to_be_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = table(tmp_path, {"rich": TRUTH, "poor": TRUTH})
    assert cli.run(["fit", str(source), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--condition: the data have 'rich', 'poor'; choose one, or several" in line


def test_that_is_asked_before_anything_is_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = ["file,replicate,hours,um_per_pixel,condition", "a.tif,1,5,0.75,rich", "b.tif,1,5,0.75,poor"]
    (tmp_path / "manifest.csv").write_text("\n".join(lines))
    for name in ("a.tif", "b.tif"):
        (tmp_path / name).write_bytes(b"no image, which measuring would find out")
    for options, said in (
        ([], "the data have 'rich', 'poor'; choose one"),
        (["--condition", "salty"], "got 'salty', the data have 'rich', 'poor'"),
    ):
        for command in ("fit", "infer"):
            assert (
                cli.run([command, str(tmp_path), "--out", str(tmp_path / f"out-{command}{len(options)}"), *options])
                == 2
            )
            (line,) = capsys.readouterr().err.strip().splitlines()
            assert f"--condition: {said}" in line
    assert not list(tmp_path.glob("out-infer*"))


def test_an_older_fit_outlives_a_failed_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    with results_folder(out, "fit") as results:
        for name in FILES[:-1]:
            (results.partial / name).write_text("an older fit")
        results.finish(inputs=[])
    table = str(write_measurements(tmp_path / "measurements.csv"))
    for wrong in ([str(tmp_path / "nowhere.csv")], [table, "--condition", "rich"], [table, "--bounds", "mobility=1"]):
        assert cli.run(["fit", *wrong, "--out", str(out)]) == 2
        assert wrong[-1].split("/")[-1] in capsys.readouterr().err
        assert len(list(out.iterdir())) == len(FILES), "what cannot begin leaves all as it was"
    assert cli.run(["fit", table, "--statistics", "area", "--free", "mobility", "--out", str(out)]) == 2
    assert "'area' is not in the table" in capsys.readouterr().err
    assert {path.name for path in out.iterdir()} == set(FILES)


def test_names_and_numbers_are_read() -> None:
    found = named_pairs_in("--bounds", ["mobility=0.1:10", "aspect-ratio = 0.3:0.9"], "the ends of a range")
    assert found == {"mobility": (0.1, 10.0), "aspect_ratio": (0.3, 0.9)}
    found = named_pairs_in("--prior", ["aspect-ratio of low-N=1:0.1"], "its centre and width")
    assert found == {"aspect_ratio of low-N": (1.0, 0.1)}, "conditions keep their names"
    found = named_pairs_in("--prior", ["mobility of pH=5=1.5:0.1"], "its centre and width")
    assert found == {"mobility of pH=5": (1.5, 0.1)}


def test_the_truth_lies_beside_the_table_or_in_the_folder(tmp_path: Path) -> None:
    assert read_truth(tmp_path) is None
    write_json(tmp_path / "truth" / "parameters.json", TRUTH.asdict())
    (tmp_path / TABLE).write_text("")
    for source in (tmp_path, tmp_path / TABLE):
        assert read_truth(source) == pytest.approx(TRUTH.asdict())


@pytest.mark.slow
def test_photographs_become_a_fit(tmp_path: Path) -> None:
    """The whole way, with colonies: measured, fitted, resampled and profiled."""
    small = photographed(tmp_path)
    out, options = tmp_path / "fit", ["--free", "aspect-ratio", "--bootstrap", "20", "--profile", "--truth"]
    assert cli.run(["fit", str(small), "--out", str(out), *options]) == 0
    result = Fit.load(out / "fit.json")
    assert result.targets.imaging is not None
    assert result.targets.imaging.estimator == "smooth"
    assert abs(result.values["aspect_ratio"] - 0.6) < 3 * result.standard_errors["aspect_ratio"]
    assert result.standard_errors["aspect_ratio"] < 0.15 * 0.6
    assert {*FILES, TABLE, "index.html", "masks"} <= {path.name for path in out.iterdir()}
    manifest = json.loads((out / "manifest.json").read_text())
    assert len(manifest["inputs"]) == 19
    assert not any("truth" in path for path in manifest["inputs"])
