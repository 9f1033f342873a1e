"""`yeastfit compare`, of run folders that a test has made up: results, exit codes, and what is no run."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_posteriors import made_posterior

from yeastfit.commands import app as cli
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.posterior.status import Status
from yeastfit.results.folder import results_folder
from yeastfit.storage import write_json

COLONIES = 8


def left_out(density: float) -> LeftOut:
    even = (np.arange(COLONIES) + 0.5) / COLONIES
    rng = np.random.default_rng(0)
    return LeftOut(
        ("area", "compactness"),
        tuple(map(str, range(COLONIES))),
        rng.normal(10.0, 1.0, (COLONIES, 2)),
        np.arange(COLONIES) % 4,
        density + 0.1 * even,
        np.stack([even, even[::-1]], axis=1),
        np.tile(np.linspace(8, 12, 5)[None, :, None], (COLONIES, 1, 2)),
    )


def run(folder: Path, model: str, data: str, mean: float, density: float | None = None, settled: bool = True) -> str:
    """A finished run in a folder."""
    draws = np.random.default_rng(3).normal(mean, 0.05, (4, 250, 2))
    posterior = replace(made_posterior(draws), status=Status.SETTLED if settled else Status.STILL_MOVING)
    configuration: dict[str, Any] = {
        "model": model,
        "condition": None,
        "settings": {},
        "statistics": ["area", "compactness"],
    }
    more = {"seed": 0, "versions": {}, "device": "cpu"}
    with results_folder(folder, "infer", resume=False) as results:
        known = {"command": "infer", "configuration": configuration, "inputs": {"measurements.csv": data}, **more}
        write_json(folder / "run.json", known)
        posterior.save(results.partial / "posterior.npz")
        if density is not None:
            left_out(density).save(results.partial / "left_out.npz")
        results.finish(inputs=[], kept=["run.json"])
    return str(folder)


def test_models_and_conditions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [
        run(tmp_path / "old", "algebraic", "x", 1.0, -4.0),
        run(tmp_path / "new", "offlattice", "x", 1.0, -3.0),
        run(tmp_path / "rich", "offlattice", "y", 2.0),
    ]
    out = tmp_path / "out"
    assert cli.run(["compare", *runs, "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "new predicts colonies left out better than old, log density +8.0 ± 0.0 over 8 colonies" in said
    assert "mobility is smaller in new than in rich by a factor of 2.00" in said
    with (out / "models.csv").open() as file:
        assert [(row["run"], row["worse"]) for row in csv.DictReader(file)] == [("new", "no"), ("old", "yes")]
    with (out / "conditions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["parameter"] for row in rows] == ["mobility", "aspect_ratio"]
    assert float(rows[0]["first_larger"]) == 0.0
    verdicts = json.loads((out / "comparison.json").read_text())
    assert verdicts["doubts"] == []
    page = (out / "index.html").read_text(encoding="utf-8")
    assert all(verdict in page.replace("−", "-") for verdict in verdicts["verdicts"])
    assert {"left_out_1.png", "marginals.png", "colonies.csv", "statistics.csv"} <= {one.name for one in out.iterdir()}
    assert cli.run(["compare", *runs, "--out", str(out)]) == 0  # its own results are replaced


def test_runs_are_called_by_as_much_of_their_paths_as_tells_them_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [
        run(tmp_path / "old" / "one", "algebraic", "x", 1.0, -4.0),
        run(tmp_path / "new" / "one", "offlattice", "x", 1.0, -3.0),
    ]
    assert cli.run(["compare", *runs, "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "new/one predicts colonies left out better than old/one, log density +8.0" in said
    assert str(tmp_path / "old") not in said


def test_a_posterior_that_has_not_settled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [run(tmp_path / "a", "m", "x", 1.0), run(tmp_path / "b", "m", "y", 1.0, settled=False)]
    assert cli.run(["compare", *runs, "--out", str(tmp_path / "out")]) == 1
    assert "b: not settled" in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "out" / "index.html").is_file()


def test_damaged_runs_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cut, of other bytes, nested too deeply, another run's: one line that names the file, and nothing is written."""
    one, other = (run(tmp_path / name, "m", name, 1.0, -3.0) for name in ("one", "other"))
    third = Path(run(tmp_path / "third", "m", "third", 2.0, -2.0))
    for name in ("run.json", "posterior.npz", "left_out.npz"):
        file = tmp_path / "one" / name
        whole = file.read_bytes()
        middle = len(whole) // 2
        flipped = whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :]
        for damaged in (b"", whole[:middle], flipped, b"[" * 20_000, b"null", (third / name).read_bytes()):
            file.write_bytes(damaged)
            assert cli.run(["compare", one, other, "--out", str(tmp_path / "out")]) == 2
            (said,) = capsys.readouterr().err.splitlines()
            assert said.startswith(f"error: {file}: has changed since yeastfit wrote it")
            assert not (tmp_path / "out").exists()
        file.unlink()
        assert cli.run(["compare", one, other, "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert said in (
            f"error: {file}: is gone, need the file whose SHA-256 manifest.json lists\n",
            f"error: {one} holds no run.json, need the folder of a run of yeastfit infer\n",
        )
        file.write_bytes(whole)
    assert cli.run(["compare", one, other, "--out", str(tmp_path / "out")]) == 0


def test_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line each, and nothing is written."""
    one = run(tmp_path / "one", "m", "x", 1.0)
    other = run(tmp_path / "other", "n", "x", 1.0)
    (tmp_path / "unfinished").mkdir()
    (tmp_path / "unfinished" / "run.json").write_text((tmp_path / "one" / "run.json").read_text())
    shutil.copytree(tmp_path / "unfinished", tmp_path / "damaged")
    (tmp_path / "damaged" / "manifest.json").write_text('{"command": "inf')
    cases = [
        ([one], "need at least two"),
        ([one, one], "is given twice"),
        ([one, other], "one has left no colonies out"),
        ([one, str(tmp_path)], "holds no run.json"),
        ([one, str(tmp_path / "unfinished")], "holds an unfinished run"),
        (
            [one, str(tmp_path / "damaged")],
            "manifest.json is damaged: restore it, or repeat yeastfit infer into another folder",
        ),
    ]
    for runs, words in cases:
        assert cli.run(["compare", *runs, "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert words in said
        assert said.count("\n") == 1
        assert not (tmp_path / "out").exists()
    assert cli.run(["compare", one, other, "--out", one]) == 2  # a run that is read is not written into
    assert "error:" in capsys.readouterr().err
