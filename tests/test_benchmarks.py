"""The shape all benchmarks share. What they measure takes an idle machine, and no test does it."""

import json
import math
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import contest, optimisers, recovery
from benchmarks.programs import placed, samples
from benchmarks.report import Figure, Report, command, commit
from yeastfit import PARAMETERS, FitSettings, InputError, Observable, Targets
from yeastfit.inference.fit.response_surface import response_surface
from yeastfit.inference.parameter_space import ParameterSpace

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("value", "target", "at_least", "met"),
    [
        (12.0, 12, True, True),
        (11.9, 12, True, False),
        (15.0, 15, False, True),
        (15.1, 15, False, False),
        (math.nan, 12, True, False),
        (math.nan, 15, False, False),
        (math.nan, None, True, None),
    ],
)
def test_a_target_is_met_from_its_own_side_and_never_by_nan(
    value: float, target: float | None, at_least: bool, met: bool | None
) -> None:
    assert Figure("speed", value, "×", target, at_least).met is met


@pytest.mark.parametrize(("value", "status"), [(14.0, 0), (11.0, 1), (math.nan, 1)])
def test_exit_status_terminal_and_json(
    value: float, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(report: Report, quick: bool) -> None:
        assert quick
        report.stage("measuring")
        report.add("speed", value, "×", target=12, note="against something")
        report.add("load", 0.5, "")
        report.table("behind it", [{"nodes": 100, "ms": 1.25}, {"nodes": 1000, "ms": math.nan}])

    file = tmp_path / "new" / "figures.json"
    with pytest.raises(SystemExit) as left:
        command("example", run, ["--quick", "--json", str(file)])
    assert left.value.code == status
    printed = capsys.readouterr()
    assert "benchmarks.example --quick" in printed.out
    assert (" met " in printed.out) == (status == 0)
    assert ("MISSED" in printed.out) == (status == 1)
    assert "measuring" in printed.err

    written = json.loads(file.read_text())
    assert (written["benchmark"], written["quick"], written["met"]) == ("example", True, status == 0)
    assert {"cpu", "cores", "device", "precision", "python", "yeastfit", "jax", "numpy"} <= set(written["machine"])
    speed, load = written["figures"]
    assert speed == {
        "name": "speed",
        "value": "NaN" if math.isnan(value) else value,
        "unit": "×",
        "target": 12,
        "at_least": True,
        "note": "against something",
        "met": status == 0,
    }
    assert load["met"] is None
    assert written["tables"] == {"behind it": [{"nodes": 100, "ms": 1.25}, {"nodes": 1000, "ms": "NaN"}]}


def test_what_was_measured_before_a_failure_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run(report: Report, quick: bool) -> None:
        report.add("speed", 14, "×", target=12)
        raise RuntimeError("out of memory")

    with pytest.raises(RuntimeError, match="out of memory"):
        command("example", run, ["--json", str(tmp_path / "figures.json")])
    assert "speed" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_a_commit_is_that_of_the_checkout_and_says_whether_code_was_changed(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        own = ("-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path))
        return subprocess.run(("git", *own, *arguments), check=True, capture_output=True, text=True).stdout.strip()

    package = tmp_path / "yeastfit"
    package.mkdir()
    (package / "__init__.py").write_text("")
    assert commit(package) == ""  # not a checkout
    git("init")
    assert commit(package) == ""  # installed inside a checkout that does not track it
    git("add", "yeastfit")
    git("commit", "-m", "first")
    first = f"commit {git('rev-parse', '--short=9', 'HEAD')}"
    assert commit(package) == first
    (tmp_path / "page.md").write_text("written by a benchmark")
    assert commit(package) == first
    (package / "__init__.py").write_text("changed = True")
    assert commit(package) == f"{first} with changes"


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("model", "Targets"),
        ("convergence", "Targets"),
        ("recovery", "Targets"),
        ("optimisers", "Targets"),
        ("samplers", "'yeastfit[benchmarks]'"),
        ("segmentation", "RAW_DIR MASK_DIR"),
    ],
)
def test_help_says_what_is_measured(
    name: str, word: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "--help"])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(ROOT / "benchmarks" / f"{name}.py"), run_name="__main__")
    assert left.value.code == 0
    said = " ".join(capsys.readouterr().out.split())
    assert all(one in said for one in ("--quick", "--json", f"python -m benchmarks.{name} [", word))
    assert "[]" not in said


@pytest.mark.parametrize(
    ("given", "words"),
    [([], "got nothing, need 2 folders: RAW MASKS"), (["here", "nowhere"], "got here nowhere, need 2 folders")],
)
def test_folders_that_are_missing_are_named(
    given: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    with pytest.raises(SystemExit) as left:
        command("example", lambda report, quick: pytest.fail("it ran"), given, ("RAW", "MASKS"))
    assert left.value.code == 2
    assert words in " ".join(capsys.readouterr().err.replace("│", " ").split())


def test_a_placed_colony_is_a_tree_as_dense_and_as_spread_out_as_asked_for() -> None:
    colony = placed(2000, 3.0, 1.5, 1.04, np.ones((401, 401), np.float32))
    positions, parents = np.asarray(colony.positions), np.asarray(colony.parents)
    assert parents[0] == -1
    assert (parents[1:] >= 0).all()
    assert (parents[1:] < np.arange(1, 2000)).all()
    lengths = np.hypot(*(positions[1:] - positions[parents[1:]]).T)
    assert np.median(lengths) == pytest.approx(1.04, abs=0.1)
    assert np.max(lengths) < 2.0
    radius = np.hypot(*positions.T).max()
    assert 2000 / (np.pi * radius**2) == pytest.approx(1.5, rel=0.2)
    assert colony.nutrient.shape == (801, 801)


def test_the_last_step_is_always_a_sample() -> None:
    assert samples(25, 10).steps.tolist() == [10, 20, 25]
    assert samples(20, 10).steps.tolist() == [10, 20]


def record_of(study: recovery.Study, number: int, pulls: tuple[float, float, float], error: float = 0.1) -> dict:
    """A fit that is off by so many standard errors in mobility, metabolic rate and aspect ratio."""
    true = study.recipes[number - 1].parameters
    names = list(recovery.BOX)
    return {
        "truth": number,
        "asked": study.asked(number),
        "status": "converged",
        "converged": True,
        "simulations": 1000 + number,
        "seconds": 10.0 * number,
        "log": {name: math.log(true[name]) + pull * error for name, pull in zip(names, pulls, strict=True)},
        "error": dict.fromkeys(names, error),
        "warnings": [],
    }


def test_truths_are_spread_over_the_box_and_always_the_same(tmp_path: Path) -> None:
    study, again = (recovery.Study.of(False, tmp_path) for _ in range(2))
    assert study.recipes == again.recipes
    for name, (low, high) in recovery.BOX.items():
        values = np.array([recipe.parameters[name] for recipe in study.recipes])
        assert ((values > low) & (values < high)).all()
        thirds = np.histogram(np.log(values), bins=np.linspace(np.log(low), np.log(high), 4))[0]
        assert thirds.min() >= 4


def test_recovery_counts_what_is_inside_its_errors_and_missing_errors_apart(tmp_path: Path) -> None:
    study, report = recovery.Study.of(False, tmp_path), Report("recovery")
    records = [record_of(study, 1, (0.5, -1.5, 2.5)), record_of(study, 2, (-0.9, 1.9, 0.1))]
    records[1]["error"]["aspect_ratio"] = None
    recovery.verdicts(report, records)
    found = {figure.name: figure for figure in report.figures}
    assert found["within 2 standard errors"].value == pytest.approx(100 * 4 / 5)
    assert found["within 2 standard errors"].met is False
    assert found["within 2 standard errors, at most"].met is True
    assert found["within 1 standard error"].value == pytest.approx(100 * 2 / 5)
    assert found["without a standard error"].value == pytest.approx(100 / 6)
    assert found["mobility: rms pull"].value == pytest.approx(math.sqrt((0.5**2 + 0.9**2) / 2))
    assert found["mobility: median relative error"].value == pytest.approx(50 * (math.expm1(0.05) - math.expm1(-0.09)))
    assert found["a fit, median"].value == 15.0
    report.print()


def test_recovery_goes_on_after_the_last_whole_line_and_refuses_other_settings(tmp_path: Path) -> None:
    study = recovery.Study.of(False, tmp_path)
    for number in (1, 2):
        study.keep(record_of(study, number, (0.0, 0.0, 0.0)))
    with study.lines.open("a") as file:
        file.write('{"truth": 3, "ask')
    assert list(study.done()) == [1, 2]
    study.keep(record_of(study, 3, (0.0, 0.0, 0.0)))
    assert list(study.done()) == [1, 2, 3]
    study.keep({**record_of(study, 4, (0.0, 0.0, 0.0)), "asked": study.asked(5)})
    with pytest.raises(InputError, match="--again"):
        study.done()


class Straight:
    """A simulator whose means are affine in log λ of mobility and aspect ratio, and do not scatter."""

    parameters = PARAMETERS.subset(("mobility", "aspect_ratio"))
    observables = tuple(Observable(name, time) for name in ("radius", "area") for time in (1.0, 2.0))

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        assert len(values) == len(seeds)
        return 100.0 + (np.log(values) - MIDDLE) @ SLOPES.T


SLOPES = np.array([[20.0, 5.0], [-5.0, 30.0], [10.0, 10.0], [0.0, -20.0]])
MIDDLE = np.log([1.3, 0.65])


@pytest.fixture
def straight() -> contest.Contest:
    targets = Targets.from_means({"radius": [100.0, 100.0], "area": [100.0, 100.0]}, [1.0, 2.0])
    simulator = Straight()
    space = ParameterSpace.of(simulator.parameters)

    def simulate(points: np.ndarray) -> np.ndarray:
        return simulator(np.exp(points), np.zeros(len(points)))

    surface = response_surface(simulate, MIDDLE, np.full(2, 0.2), 64, 0)
    found = surface.minimise(np.eye(4), targets.values[None])
    best, least = found.theta[0], float(found.chi_square[0])
    return contest.Contest(targets, simulator, space, FitSettings(), np.eye(4), surface, best, least)


def test_what_judges_knows_the_minimum_and_the_rise_around_it(straight: contest.Contest) -> None:
    np.testing.assert_allclose(straight.best, MIDDLE, atol=1e-3)
    away = np.array([0.05, -0.02])
    assert straight.rise(straight.best + away) == pytest.approx(np.sum((SLOPES @ away) ** 2), rel=0.02)
    assert straight.rise(straight.best + 0.3) == math.inf
    assert straight.directly(straight.best, 8) == pytest.approx(straight.least, abs=1e-2)


def test_differences_are_the_derivatives_in_z_and_are_counted(straight: contest.Contest) -> None:
    objective = contest.Objective(straight, members=8, seed=1, budget=1000)
    z = straight.space.z_of(np.log([3.0, 0.4]))
    objective.residuals(z)
    slope = straight.space.slope(straight.space.theta_of(z))
    np.testing.assert_allclose(objective.differences(z), SLOPES * slope, rtol=0.1, atol=0.1)
    assert objective.spent == 8 * (1 + 2)


@pytest.mark.parametrize("name", contest.ALTERNATIVES)
def test_an_alternative_arrives_is_counted_and_is_stopped_by_its_budget(name: str, straight: contest.Contest) -> None:
    size, start = optimisers.Size(members=8), np.log([3.0, 0.4])
    done, again = (optimisers.alternative(straight, size, name, 1, start, 4000.0) for _ in range(2))
    assert done["arrived"]
    assert done["colonies"] == again["colonies"]
    assert done["colonies"] % 8 == 0
    assert straight.rise(np.array(done["theta"])) < contest.MARGIN
    short = optimisers.alternative(straight, size, name, 1, start, done["colonies"] - 8.0)
    assert not short["arrived"]
    assert short["colonies"] < done["colonies"]
    assert "not within" in short["ended"]


def test_a_run_that_did_not_arrive_took_longer_than_all_others() -> None:
    runs = [{"colonies": count, "arrived": count < 900} for count in (300, 500, 400, 900, 900)]
    assert optimisers.median(runs) == 500
    assert optimisers.median([*runs, *runs[-1:]]) == math.inf


def test_starts_side_by_side_are_paid_for_until_the_first_arrives() -> None:
    """Of three seeds: 2 × 300, 2 × 500, and one that no start brings there."""
    spent = {1: ((300, True), (900, False)), 2: ((700, True), (500, True)), 3: ((900, False), (900, False))}
    runs = [
        {"seed": seed, "colonies": colonies, "seconds": colonies / 20, "arrived": arrived}
        for seed, starts in spent.items()
        for colonies, arrived in starts
    ]
    assert optimisers.side_by_side(runs) == 1000
    assert optimisers.side_by_side(runs, "seconds") == 50
    assert optimisers.side_by_side(runs[:2]) == 600
    assert optimisers.side_by_side(runs[4:]) == math.inf
