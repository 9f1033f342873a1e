"""What `yeastfit infer --resume` and `--reuse` make of files that were lost, damaged or changed meanwhile."""

import json
import os
from pathlib import Path
from typing import Any

import h5py
import known_colonies
import numpy as np
import pytest
from infer_runs import arguments, assert_same, finished

from yeastfit.commands import app as cli
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.simulator import Wrapper
from yeastfit.inference.store.simulation_store import DATASET

pytestmark = pytest.mark.usefixtures("unchecked", "undrawn")
CUT = "births were cut because every node slot was taken: raise capacity or end earlier"


def stopped_after(colonies: int, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the command until so many colonies have grown, of which each batch has one that was cut."""
    grown = [0]

    def stopping(simulator: Any, values: np.ndarray, seeds: np.ndarray) -> None:
        if grown[0] >= colonies:
            raise KeyboardInterrupt
        grown[0] += len(values)
        simulator.problems[CUT] += 1

    with monkeypatch.context() as patch:
        patch.setattr(known_colonies, "before", stopping)
        assert cli.run(arguments) == 130


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert cli.run(arguments) == 2
    return " ".join(capsys.readouterr().err.split())


def warnings_of(folder: Path) -> list[str]:
    return json.loads((folder / "manifest.json").read_text())["warnings"]


@pytest.mark.thorough
def test_a_run_does_not_go_on_with_other_simulations_than_it_took_over(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wherever they lie; the path by which they came may be written otherwise, or left out."""
    finished(arguments(data, tmp_path / "first", "abc-smc"))
    again = arguments(data, tmp_path / "then", "abc-smc", "--reuse", str(tmp_path / "first"), "--seed", "5")
    stopped_after(1, again, monkeypatch)
    copy, whole = tmp_path / "then" / "reused.h5", (tmp_path / "then" / "reused.h5").read_bytes()
    with h5py.File(copy, "r+") as file:
        rows = file[DATASET][...]
        rows["statistics"][:200] += 1.0
        file[DATASET][...] = rows
    assert "reused.h5 holds other simulations than when the run began" in refused([*again, "--resume"], capsys)
    copy.write_bytes(whole)
    where = again.index("--reuse") + 1
    assert "reuse was " in refused([*again[:where], str(tmp_path), *again[where + 1 :], "--resume"], capsys)
    finished([*again[:where], os.path.relpath(tmp_path / "first"), *again[where + 1 :], "--resume"])
    finished(arguments(data, tmp_path / "whole", "abc-smc", "--reuse", str(tmp_path / "first"), "--seed", "5"))
    assert_same(tmp_path / "then", tmp_path / "whole")
    assert not any("last bit" in one for one in warnings_of(tmp_path / "then"))


def test_simulations_of_another_version_are_told_of(data: Path, tmp_path: Path) -> None:
    finished(arguments(data, tmp_path / "first", "abc-smc"))
    began = json.loads((tmp_path / "first" / "run.json").read_text())
    began["versions"]["yeastfit"] = "0.0.1"
    (tmp_path / "first" / "run.json").write_text(json.dumps(began))
    finished(arguments(data, tmp_path / "then", "abc-smc", "--reuse", str(tmp_path / "first")))
    told = [one for one in warnings_of(tmp_path / "then") if "not to the last bit" in one]
    assert len(told) == 1
    assert "first are not to the last bit what they would be now, as yeastfit was 0.0.1, is " in told[0]


def test_a_changed_result_is_named_before_a_finished_run_goes_on(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which stays finished; without that file it goes on, and makes it again."""
    finished(arguments(data, tmp_path / "whole", "abc-mcmc", "--draws", "20"))
    out = tmp_path / "out"
    finished(arguments(data, out, "abc-mcmc"))
    more = arguments(data, out, "abc-mcmc", "--draws", "20", "--resume")
    for name in ("chains.h5", "posterior.npz"):
        whole = (out / name).read_bytes()
        (out / name).write_bytes(whole[:3000])
        said = refused(more, capsys)
        assert f"{name} in {out} changed since the run wrote it: put it back, or remove it" in said
        assert (out / "manifest.json").is_file()
        (out / name).unlink()
        if name == "chains.h5":
            (out / name).write_bytes(whole)
    finished(more)
    assert_same(out, tmp_path / "whole")


def test_lost_simulations_are_told_of_and_counted_once(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    asked = arguments(data, out, "abc-smc")
    stopped_after(64, asked, monkeypatch)
    (out / "simulations.h5").unlink()
    stopped_after(64, [*asked, "--resume"], monkeypatch)
    said = " ".join(capsys.readouterr().err.split())
    assert "64 of 64 simulations are lost, and made again where they are needed" in said
    (out / "problems.json").write_text("")
    said = refused([*asked, "--resume"], capsys)
    assert "problems.json: this is no record of problems that was saved whole" in said
    assert "remove it and give --resume, what it says is counted anew" in said
    (out / "problems.json").unlink()
    finished([*asked, "--resume"])
    assert "problems.json is lost, and with it what simulations so far ran into" in capsys.readouterr().err


def test_problems_of_lost_simulations_are_counted_once(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, lose in (("whole", False), ("lost", True)):
        asked = arguments(data, tmp_path / name, "abc-smc")
        stopped_after(64, asked, monkeypatch)
        if lose:
            (tmp_path / name / "simulations.h5").unlink()
            stopped_after(64, [*asked, "--resume"], monkeypatch)
        finished([*asked, "--resume"])
    first, second = ([one for one in warnings_of(tmp_path / name) if CUT in one] for name in ("whole", "lost"))
    assert first == second != []


@pytest.mark.parametrize(
    "how",
    [pytest.param(["abc-smc"]), pytest.param(["emulator", "--leave-out", "2"], marks=pytest.mark.thorough)],
    ids=["abc-smc", "emulator"],
)
def test_a_posterior_is_kept_though_nothing_can_be_predicted(
    how: list[str], data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run finishes without a predictive check, and says so."""
    sampled = Posterior.predict

    def failing(posterior: Posterior, simulator: Any, **more: Any) -> Any:
        return sampled(posterior, Failing(simulator), **more)

    monkeypatch.setattr(Posterior, "predict", failing)
    finished(arguments(data, tmp_path / "out", *how))
    names = {one.name for one in (tmp_path / "out").iterdir()}
    assert ("left_out.csv" in names) == ("--leave-out" in how)
    assert {"posterior.csv", "posterior.npz", "index.html", "corner.png", "manifest.json"} <= names
    assert not {"predictive.csv", "predictive.npz", "predictive.png", "colonies.png"} & names
    assert "posterior predictive: 0 of 48 draws succeeded, a predictive check needs 10" in warnings_of(tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    assert "No prediction: too few simulations at draws of the posterior succeeded" in page
    found = json.loads((tmp_path / "out" / "diagnostics.json").read_text())
    assert (found["predictive_p_value"], found["observations_inside_90"]) == (None, None)


class Failing(Wrapper):
    """Of which every simulation fails."""

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        return np.full((len(seeds), len(self.observables)), np.nan)
