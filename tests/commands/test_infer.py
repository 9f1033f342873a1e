"""`yeastfit infer` from end to end, on colonies whose curves are known."""

import csv
import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import h5py
import known_colonies
import numpy as np
import pytest
from helpers import wrong_types
from infer_runs import arguments, finished
from known_colonies import TRUTH, KnownColonies, photographed, write_measurements
from known_posteriors import Drawing
from PIL import Image

from yeastfit.commands import app as cli
from yeastfit.commands.posterior_run.config import Request
from yeastfit.commands.posterior_run.doubts import doubts_of
from yeastfit.commands.posterior_run.leave_out import check_groups, single_colonies
from yeastfit.commands.posterior_run.run import InferRun
from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import LiDistance
from yeastfit.inference.abc.pilot import DistanceName, distance_of, pilot_of
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.neural_likelihood import network
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.samplers import SAMPLERS
from yeastfit.inference.simulator import seed_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulations import Simulations
from yeastfit.inference.targets import Targets
from yeastfit.model.parameters import PARAMETERS
from yeastfit.progress import Progress
from yeastfit.results.folder import results_folder

FILES = (
    *("run.json", "targets.csv", "simulations.h5", "posterior.npz", "posterior.csv", "diagnostics.json"),
    *("predictive.csv", "predictive.npz", "corner.png", "traces.png", "predictive.png", "colonies.png"),
    *("index.html", "manifest.json", "posterior.nc"),
)


@pytest.mark.parametrize("method", [pytest.param("emulator", marks=pytest.mark.slow), "abc-mcmc", "abc-smc"])
def test_a_table_becomes_a_posterior(
    drawn_data: Path, tmp_path: Path, method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = drawn_data, tmp_path / "out"
    (data.parent / "truth").mkdir()
    (data.parent / "truth" / "parameters.json").write_text(json.dumps({**ColonyDefaults, **TRUTH}))
    finished(arguments(data, out, method, "--truth"))
    assert all((out / name).is_file() for name in FILES)
    with (out / "predictive.csv").open() as file:
        assert [float(row["hours"]) for row in csv.DictReader(file)] == [4.0, 6.0, 8.0] * 2
    with (out / "posterior.csv").open() as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["mobility", "aspect_ratio"]
    for name, row in rows.items():
        assert float(row["q05"]) < float(row["median"]) < float(row["q95"])
        assert abs(np.log(float(row["median"]) / TRUTH[name])) < 1.0
        assert row["inside_90"] == str(float(row["q05"]) <= TRUTH[name] <= float(row["q95"]))
    found = json.loads((out / "diagnostics.json").read_text())
    assert found["observations"] == 6
    assert found["warnings"] == json.loads((out / "manifest.json").read_text())["warnings"]
    run = json.loads((out / "run.json").read_text())
    assert run["configuration"]["method"] == method
    assert len(run["inputs"]["measurements.csv"]) == 64
    assert "Results in" in capsys.readouterr().out
    finished(arguments(data, out, method, "--resume"))
    assert "this run is finished" in capsys.readouterr().out
    (out / "posterior.csv").write_text("mine")
    finished(arguments(data, out, method, "--resume"))
    assert "posterior.csv has changed since the run finished" in capsys.readouterr().err
    (out / "index.html").unlink()
    assert cli.run(arguments(data, out, method, "--resume")) == 2
    assert (
        "index.html is gone since the run finished: put it back, or begin anew by --overwrite"
        in capsys.readouterr().err
    )


@pytest.mark.usefixtures("unchecked")
def test_colonies_are_left_out(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are predicted by the others, from the simulations of the run; more groups than colonies are refused."""
    monkeypatch.setattr(network, "STEPS", 100)  # what networks learn is not the matter
    out = tmp_path / "out"
    finished(arguments(data, out, "emulator", "--leave-out", "2"))
    assert "colonies left out in 2 groups" in " ".join(capsys.readouterr().out.split())
    found = LeftOut.load(out / "left_out.npz")
    assert np.isfinite(found.log_density).all()
    assert found.labels[0].endswith("at 4 hours")
    with (out / "left_out.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(found.colonies) * len(found.labels)
    assert json.loads((out / "diagnostics.json").read_text())["left_out"]["groups"] == 2
    assert "Colonies left out" in (out / "index.html").read_text(encoding="utf-8")
    asked = Posterior.load(out / "posterior.npz").simulations
    with h5py.File(out / "simulations.h5") as file:
        assert (file["simulations"]["seed"] != 0).sum() <= asked + (12 + 40) * len(found.colonies)
    assert cli.run(arguments(data, tmp_path / "other", "emulator", "--leave-out", "99")) == 2
    assert "--leave-out is 99, the data have" in capsys.readouterr().err
    assert not list((tmp_path / "other").glob("*"))  # nothing that the next run would be told to resume


ColonyDefaults = {
    **{"diffusivity": 0.1, "elasticity": 5.0, "repulsivity": 5.0, "repulsion_radius": 0.5},
    **{"mobility": 1.0, "metabolic_rate": 1.0, "aspect_ratio": 0.6},
}


def test_a_truth_that_is_not_known_is_said_at_once(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(arguments(data, tmp_path / "out", "abc-mcmc", "--truth")) == 2
    assert "--truth: " in (said := " ".join(capsys.readouterr().err.split()))
    assert "has no truth/parameters.json beside it" in said
    assert not (tmp_path / "out").exists()


def test_colonies_that_are_seen_once_each_are_doubted(data: Path, tmp_path: Path) -> None:
    def doubts(table: Path, name: str) -> list[str]:
        request = Request(free=("mobility",), model="known")
        with results_folder(tmp_path / name, "infer", resume=False) as results:
            run = InferRun.begin(request, table, results, False, 1, lambda done, total: None)
            return doubts_of(run.targets, run.problem, run.model.nouns)

    assert doubts(data, "together") == []
    head, *lines = data.read_text().splitlines()
    once = tmp_path / "once" / "measurements.csv"
    once.parent.mkdir()
    once.write_text("\n".join([head, *(lines[3 * k + k % 3] for k in range(6))]) + "\n")  # each hour has other ones
    (said,) = doubts(once, "apart")
    assert "not every disc is in all points of the curves, some two of them share 0" in said


def test_a_time_step_too_long_for_the_prior_is_refused_at_once(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    many = ["infer", str(data), "--out", str(tmp_path / "out"), "--free", "diffusivity", "--dt", "0.02"]
    assert cli.run(many) == 2
    assert "diffusivity · dt / spacing² is 19.9" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("method", "given", "said"),
    [
        ("emulator", ["--first", "16"], "the first round has 16 simulations"),
        ("abc-mcmc", ["--walkers", "2", "--move", "stretch"], "walkers is 2"),
        ("abc-smc", ["--pilot", "2", "--distance", "mahalanobis"], "pilot is 2"),
    ],
)
def test_settings_that_a_sampler_refuses_leave_nothing(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], method: str, given: list[str], said: str
) -> None:
    """So that the corrected command can be given."""
    assert cli.run(arguments(data, tmp_path / "out", method, *given)) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_what_lies_in_the_folder_is_never_overwritten(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    grown = [0]

    def failing(simulator: Any, values: np.ndarray, seeds: np.ndarray) -> None:
        if grown[0] > 0:
            raise InputError("no more colonies today")
        grown[0] += len(values)

    monkeypatch.setattr(known_colonies, "before", failing)
    first = arguments(data, tmp_path / "out", "abc-mcmc")
    monkeypatch.setattr(sys, "argv", ["yeastfit", *first])

    def refused(*arguments: str) -> str:
        capsys.readouterr()
        assert cli.run(list(arguments)) == 2
        (line,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: ")]
        return line

    assert "no more colonies today" in refused(*first)
    before = (tmp_path / "out" / "run.json").read_bytes()
    assert "a run that was not finished: give --resume" in refused(*first)
    assert "--mobility is 3, but mobility is free" in refused(*first, "--resume", "--mobility", "3")
    said = refused(*first, "--resume", "--seed", "4", "--dt", "0.02", "--elasticity", "6", "--distance", "li")
    for words in (
        "seed was 0, now it is 4",
        "dt was none, now it is 0.02",
        "elasticity was",
        "distance was mahalanobis",
        f"; it began as yeastfit {shlex.join(first)}",
    ):
        assert words in said
    write_measurements(data, seed=4)
    assert "measurements.csv has changed" in refused(*first, "--resume")
    assert (tmp_path / "out" / "run.json").read_bytes() == before
    assert "holds the data" in refused(*arguments(data, data.parent, "abc-mcmc"))


@dataclass(frozen=True)
class NearestReport(Diagnostics):
    """The largest difference that was accepted."""

    caption = "Simulations from the prior, the nearest of them."

    largest: float

    def facts(self) -> list[tuple[str, str]]:
        return [("largest difference", f"{self.largest:.3g}")]

    def sentences(self) -> list[str]:
        return ["the nearest of few are not near"]


@dataclass(frozen=True)
class Nearest:
    """A method that nobody has heard of: the nearest of simulations from the prior."""

    tries: Annotated[int, Setting("How many simulations.", extends=True)] = 64
    kept: int = 16

    def run(self, problem: Problem, store: Simulations, seed: int, progress: Progress) -> Posterior:
        simulate = CachedSimulator(problem.simulator, 32, store)
        values = problem.prior_values(self.tries, seed)
        rows = simulate(values, seed_of(seed, range(self.tries)))
        differences = np.abs(rows - problem.observed).sum(axis=1)
        near = np.argsort(differences)[: self.kept]
        report = NearestReport(float(differences[near[-1]]))
        return Posterior.of(
            problem, values[None, near], statistics=rows[None, near], simulations=self.tries, diagnostics=report
        )


def test_a_sampler_that_is_registered_has_options_a_run_and_a_page(
    drawn_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(SAMPLERS, "nearest", Nearest)
    assert cli.run(["infer", "--help"]) == 0
    assert "--tries" in capsys.readouterr().out
    out = tmp_path / "out"
    command = ["infer", str(drawn_data), "--out", str(out), "--model", "known", "--draws", "12", "--method", "nearest"]
    assert cli.run([*command, "--kept", "12"]) == 1  # so few draws are too short a chain
    assert "not settled: chains are too short" in capsys.readouterr().out
    assert all((out / name).is_file() for name in FILES)
    posterior = Posterior.load(out / "posterior.npz")
    assert (posterior.method, posterior.settings, posterior.simulations) == ("nearest", {"tries": 64, "kept": 12}, 64)
    assert isinstance(posterior.diagnostics, NearestReport)
    page = (out / "index.html").read_text()
    for words in ("the nearest of them", "largest difference", "nearest of few are not near"):
        assert words in page
    assert cli.run([*command, "--kept", "12", "--tries", "32", "--resume"]) == 2
    assert "holds a run of 64 tries, now it is 32" in " ".join(capsys.readouterr().err.split())
    assert cli.run([*command, "--kept", "13", "--resume"]) == 2
    assert "kept was 12, now it is 13" in " ".join(capsys.readouterr().err.split())
    assert cli.run([*command, "--kept", "12", "--tries", "96", "--resume"]) == 1
    assert Posterior.load(out / "posterior.npz").simulations == 96
    assert cli.run([*command, "--steps", "5", "--resume"]) == 2
    assert "steps is a setting of abc-mcmc, not of nearest: leave it out" in " ".join(capsys.readouterr().err.split())


def test_the_exit_code_says_whether_the_posterior_has_settled(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(arguments(data, tmp_path / "short", "abc-mcmc")) == 1
    assert "not settled: chains are too short or disagree" in capsys.readouterr().out
    assert json.loads((tmp_path / "short" / "manifest.json").read_text())["status"] == "CHAINS_TOO_SHORT"
    assert cli.run(arguments(data, tmp_path / "short", "abc-mcmc", "--resume")) == 1
    assert "this run is finished" in capsys.readouterr().out
    wide = ["--population", "200", "--simulations", "2000", "--tolerance", "6"]
    assert cli.run(arguments(data, tmp_path / "wide", "abc-smc", *wide)) == 0
    assert "the posterior has settled" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("method", "settings", "said"),
    [
        ("abc", {}, "method is 'abc', it must be one of emulator, abc-mcmc, abc-smc"),
        ("emulator", {"tolerance": 0.1}, "tolerance is a setting of abc-mcmc and abc-smc, not of emulator"),
        ("abc-smc", {"steps": 100}, "steps is a setting of abc-mcmc"),
        ("abc-mcmc", {"simulations": 100}, "simulations is a setting of emulator and abc-smc"),
        ("abc-mcmc", {"speed": 100}, "speed is no setting of any method"),
        ("abc-mcmc", {"tolerance": 0.1, "pilot_quantile": 0.1}, "need one of the two"),
        ("abc-mcmc", {"distance": "far"}, "distance is 'far'"),
        ("abc-mcmc", {"replicates": 0}, "replicates is 0, it must be a whole number of at least 1"),
        ("abc-smc", {"pilot": 0}, "pilot is 0, it must be a whole number of at least 2"),
        ("abc-mcmc", {"walkers": -3}, "walkers is -3"),
        ("abc-mcmc", {"move": "far"}, "move is 'far'"),
        ("abc-smc", {"population": 1}, "population is 1"),
        ("emulator", {"walkers": 2}, "walkers is 2"),
    ],
)
def test_settings_that_do_not_go_together(method: str, settings: dict[str, Any], said: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=said):
        Request.of(method, settings)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"statistics": ("compactnes",)}, "'compactnes' is unknown, expected some of angular_index, area"),
        ({"model": "other"}, "--model is 'other', it must be one of algebraic"),
        ({"free": ("speed",)}, "free names 'speed', which is unknown"),
        ({"fixed": {"aspect_ratio": 2.0}}, "aspect_ratio .* is 2, it must be in"),
    ],
)
def test_options_that_make_no_sense(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Request(**options)


def test_what_one_group_alone_has_cannot_be_left_out() -> None:
    nouns = ("colony", "colonies")
    check_groups(2, ("1", "2", "3"), {"at 6 hours": [True, True, False]}, nouns)
    with pytest.raises(InputError, match="--leave-out is 2: at 8 hours there is only colony 3, which no others"):
        check_groups(2, ("1", "2", "3"), {"at 6 hours": [True] * 3, "at 8 hours": [False, False, True]}, nouns)
    with pytest.raises(InputError, match="only colony 1, 3"):
        check_groups(2, ("1", "2", "3"), {"at 8 hours": [True, False, True]}, nouns)
    check_groups(0, ("1",), {"at 8 hours": [True]}, nouns)
    means = Targets(("radius",), np.array([6.0]), np.array([[1.0]]), np.array([[0.1]]), np.array([[4]]))
    with pytest.raises(InputError, match="--leave-out is 2, the data have 0 single colonies"):
        single_colonies(means, 2, nouns)


def test_li_and_coauthors() -> None:
    request = Request.of_li(None, {"tolerance": 0.03})
    settings = request.configuration()["settings"]
    names = ("distance", "kernel", "move", "replicates", "tolerance")
    chosen = {"distance": "li", "kernel": "indicator", "move": "gaussian", "replicates": 1, "tolerance": 0.03}
    assert {name: settings[name] for name in names} == chosen
    assert request.measurement_error == 0.0
    assert request.statistics == ("compactness", "radius", "area")
    assert Request.of_li(None, {}, statistics=("radius",)).statistics == ("radius",)
    assert request.the_prior().asdict() == {
        "mobility": {"distribution": "log-uniform", "low": 0.02, "high": 20.0},
        "metabolic_rate": {"distribution": "log-uniform", "low": 0.05, "high": 20.0},
        "aspect_ratio": {"distribution": "beta", "a": 2.0, "b": 2.0, "low": 0.2, "high": 1.0},
    }
    with wrong_types(), pytest.raises(InputError, match=r"^kernel is gaussian, with --li it is indicator"):
        Request.of_li(None, {"kernel": "gaussian"})
    with pytest.raises(InputError, match=r"^measurement_error is 0\.1, with --li it is 0"):
        Request.of_li(None, {}, measurement_error=0.1)
    with pytest.raises(InputError, match="not of emulator"):
        Request.of_li("emulator", {})


def problem_of(simulator: Drawing, observed: np.ndarray) -> Problem:
    return Problem(simulator, Prior.default(PARAMETERS.subset(("mobility",))), observed)


def test_the_last_area_is_a_condition_of_li_and_coauthors() -> None:
    labels, data = ("area", "area", "compactness"), np.array([9.0, 20.0, 3.0])

    def distance(area: str = "area") -> LiDistance:
        problem = problem_of(Drawing(("mobility",), (labels[0], area, labels[2]), lambda value, rng: data), data)
        found = distance_of("li", problem, problem.simulator, 64, 0)
        assert isinstance(found, LiDistance)
        return found

    assert distance().area == 1
    assert distance("radius").area == 0
    larger = problem_of(Drawing(("mobility",), labels, lambda value, rng: data * (1.2 + rng.random(3))), data)
    with pytest.raises(InputError, match=r"none of 64 .* area within 5 % of the observed one: .*area was observed"):
        pilot_of(larger, larger.simulator, distance(), 64, 0)


@pytest.mark.parametrize("name", ["mahalanobis", "curves"])
def test_distances_by_scatter_take_statistics_of_any_sign(name: DistanceName) -> None:
    data, sd = np.array([-40.0, 3.0]), np.array([2.0, 0.5])
    drawing = Drawing(("mobility",), ("slope", "radius at 2"), lambda value, rng: data + sd * rng.normal(size=2))
    distance = distance_of(name, problem_of(drawing, data), drawing, 512, 0)
    expected = 3.0 if name == "mahalanobis" else 3.0 / np.sqrt(2)
    np.testing.assert_allclose(distance(data + np.diag(3 * sd)), expected, rtol=0.1)


def test_prior_of_a_file_and_its_template(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["infer", "--print-prior", "--free", "mobility"]) == 0
    text = capsys.readouterr().out
    file = tmp_path / "prior.toml"
    file.write_text(text.replace("high = 20.0", "high = 4.0"))
    request = Request(free=("mobility",), prior=file)
    assert request.configuration()["prior"] == {"mobility": {"distribution": "log-uniform", "low": 0.02, "high": 4.0}}
    file.write_text("[mobility]\ndistribution = 'cauchy'\n[aspect_ratio]\ndistribution = 'beta'\na = 2\nb = 2\n")
    assert cli.run(arguments(data, tmp_path / "out", "abc-mcmc", "--prior", str(file))) == 2
    assert "cauchy" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_why_simulations_failed_is_said(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where too few are left to learn from."""

    def failing(simulator: KnownColonies, values: np.ndarray, seeds: np.ndarray) -> None:
        simulator.problems["it rained"] += len(values)
        values *= np.nan

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(known_colonies, "before", failing)
        assert cli.run(arguments(data, tmp_path / "out", "emulator")) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "0 of 64 simulations succeeded" in said
    assert said.endswith("; 64 of 64 discs: it rained")


def test_what_is_missing_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for given, said in (
        (["infer"], "SOURCE is missing"),
        (["infer", str(tmp_path)], "--out is missing"),
        (["infer", str(tmp_path), "--out", str(tmp_path / "out")], "no data there, need a data set"),
    ):
        assert cli.run(given) == 2
        assert said in capsys.readouterr().err


def test_one_condition_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = write_measurements(tmp_path / "data" / "measurements.csv", conditions=("a", "b"))
    assert cli.run(arguments(two, tmp_path / "out", "abc-mcmc")) == 2
    assert capsys.readouterr().err.endswith("--condition: the data have 'a', 'b'; choose one\n")


@pytest.mark.slow
def test_photographs_become_a_posterior(tmp_path: Path) -> None:
    """The whole way, with colonies: photographed, measured, inferred, predicted, and shown beside each other."""
    small = photographed(tmp_path)
    out, how = tmp_path / "out", ["--free", "aspect-ratio", "--dt", "0.02", "--spacing", "0.2", "--truth"]
    assert cli.run(["infer", str(small), "--out", str(out), "--simulations", "256", *how]) == 0
    with (out / "posterior.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["sd"]) < 0.1
    assert abs(float(row["mean"]) - 0.6) < 3 * float(row["sd"])
    page = (out / "index.html").read_text()
    assert "Above, photographs at the last time" in page
    with Image.open(out / "colonies.png") as picture:
        above = np.asarray(picture.convert("L"))[: picture.height // 2]
    assert np.ptp(above) > 100
    assert len(np.unique(above)) > 50, "grey values of photographs"
    assert len(json.loads((out / "run.json").read_text())["inputs"]) == 19
