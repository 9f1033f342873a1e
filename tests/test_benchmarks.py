"""The shape all benchmarks share. What they measure takes an idle machine, and no test does it."""

import json
import math
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.programs import placed, samples
from benchmarks.report import Figure, Report, command, commit

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
