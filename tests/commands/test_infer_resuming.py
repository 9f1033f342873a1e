"""`yeastfit infer` stopped, killed, taken up again, made longer, and on the colonies of another run."""

import json
import os
import resource
import shutil
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import h5py
import known_colonies
import numpy as np
import pytest
from filelock import FileLock
from infer_runs import arguments, assert_same, finished
from known_colonies import KnownColonies

from yeastfit.commands import app as cli
from yeastfit.commands.posterior_run import run
from yeastfit.commands.posterior_run.config import Request
from yeastfit.commands.posterior_run.run import InferRun
from yeastfit.errors import InputError
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.store.simulation_store import DATASET
from yeastfit.progress import silent
from yeastfit.results.contents import LOCK
from yeastfit.results.folder import results_folder
from yeastfit.storage import WORK


class Stopped(BaseException):
    """Not an error that anything would catch."""


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("method", ["abc-mcmc", "abc-smc"])
def test_a_run_that_stopped_anywhere_comes_to_the_same_bits(
    data: Path, tmp_path: Path, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished(arguments(data, tmp_path / "whole", method))
    for calls in (1, 4, 7, 12):
        left = [calls]

        def stopping(simulator: Any, values: np.ndarray, seeds: np.ndarray, left: list[int] = left) -> None:
            left[0] -= 1
            if left[0] == 0:
                raise Stopped

        with monkeypatch.context() as patch:
            patch.setattr(known_colonies, "before", stopping)
            with pytest.raises(Stopped):
                cli.run(arguments(data, tmp_path / "parts", method, "--resume"))
        assert not (tmp_path / "parts" / "manifest.json").exists()
    finished(arguments(data, tmp_path / "parts", method, "--resume"))
    assert_same(tmp_path / "parts", tmp_path / "whole")


KILLED = """
import resource, sys
import known_colonies
from yeastfit.commands import app as cli
known_colonies.{dying}
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
sys.exit(cli.run(sys.argv[1:]))
"""


def run_apart(
    dying: str, arguments: list[str], limit: int = resource.RLIM_INFINITY
) -> subprocess.CompletedProcess[str]:
    """In a process of its own, killed as a function of known_colonies says; limit: bytes of the largest file."""
    tests = Path(__file__).parents[1]
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (tests, tests.parent)))}
    command = [sys.executable, "-c", KILLED.format(dying=dying, limit=limit), *arguments]
    return subprocess.run(command, env=where, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["emulator", "abc-mcmc", "abc-smc"])
def test_killed_for_real_it_comes_to_the_same_bits(data: Path, tmp_path: Path, method: str) -> None:
    finished(arguments(data, tmp_path / "whole", method))
    for _ in range(3):
        done = run_apart("kill_after(2)", arguments(data, tmp_path / "parts", method, "--resume"))
        assert done.returncode == -9, done.stderr
    finished(arguments(data, tmp_path / "parts", method, "--resume"))
    assert_same(tmp_path / "parts", tmp_path / "whole")


LONG = {
    "emulator": ["--simulations", "512"],
    "abc-mcmc": ["--steps", "1500"],
    "abc-smc": ["--population", "256", "--simulations", "20000", "--tolerance", "1.2"],
}


@pytest.mark.slow
@pytest.mark.parametrize("method", list(LONG))
def test_killed_at_twenty_random_moments_it_comes_to_the_same_bits(data: Path, tmp_path: Path, method: str) -> None:
    """Nothing that is on disk when the kill comes is lost, and what was never disturbed is what comes out.

    Moments are even over what a run takes that nobody disturbs, results included. A run that was done before its kill
    came is compared, and the next one begins anew.
    """
    long = (*LONG[method], "--draws", "10")
    began = time.perf_counter()
    done = run_apart("kill_within(1e6, nap=0.02)", arguments(data, tmp_path / "whole", method, *long))
    assert done.returncode in (0, 1), done.stderr
    length = time.perf_counter() - began
    parts, kept, kills, rng = tmp_path / "parts", 0, 0, np.random.default_rng(7)
    for _ in range(60):
        if kills == 20:
            break
        dying = f"kill_within({rng.uniform(0.0, length):.4f}, nap=0.02)"
        done = run_apart(dying, arguments(data, parts, method, *long, "--resume"))
        assert done.returncode in (-9, 0, 1), done.stderr
        if done.returncode != -9:
            assert_same(parts, tmp_path / "whole")
            shutil.rmtree(parts)
            kept = 0
            continue
        kills += 1
        if (parts / "simulations.h5").is_file():
            with h5py.File(parts / "simulations.h5") as file:
                rows = file[DATASET][...]
            now = sum(zlib.crc32(row.tobytes()[: -row["check"].nbytes]) == row["check"] for row in rows)
            assert now >= kept
            kept = now
    assert kills == 20
    finished(arguments(data, parts, method, *long, "--resume"))
    assert_same(parts, tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "file"), [("emulator", "simulations.h5"), ("abc-mcmc", "simulations.h5"), ("abc-smc", "simulations.h5")]
)
def test_a_full_disk_is_one_line_and_loses_nothing(data: Path, tmp_path: Path, method: str, file: str) -> None:
    finished(arguments(data, tmp_path / "whole", method))
    largest = (tmp_path / "whole" / file).stat().st_size
    done = run_apart("kill_after(-1)", arguments(data, tmp_path / "parts", method), limit=largest // 2)
    assert done.returncode == 2
    errors = [line for line in done.stderr.splitlines() if not line.startswith("warning: ")]
    assert len(errors) == 1, done.stderr
    assert "--resume" in errors[0]
    finished(arguments(data, tmp_path / "parts", method, "--resume"))
    assert_same(tmp_path / "parts", tmp_path / "whole")


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(("first", "then"), [("abc-smc", "emulator"), ("emulator", "abc-mcmc")])
def test_colonies_of_another_run_serve_again(
    data: Path, tmp_path: Path, first: str, then: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished(arguments(data, tmp_path / "first", first))
    asked = list[bytes]()

    def counting(simulator: Any, values: np.ndarray, seeds: np.ndarray) -> None:
        asked.extend(row.tobytes() + seed.tobytes() for row, seed in zip(values, seeds, strict=True))

    monkeypatch.setattr(known_colonies, "before", counting)
    again = arguments(data, tmp_path / "then", then, "--reuse", str(tmp_path / "first"))
    finished([*again, "--draws", "10"])
    with h5py.File(tmp_path / "first" / "simulations.h5") as file:
        kept = {row["values"].tobytes() + row["seed"].tobytes() for row in file[DATASET][:] if row["check"]}
    assert not kept & set(asked)
    with h5py.File(tmp_path / "then" / "simulations.h5") as file:
        both = {row["values"].tobytes() + row["seed"].tobytes() for row in file[DATASET][:] if row["check"]}
    assert both == kept | set(asked)
    found = Posterior.load(tmp_path / "then" / "posterior.npz")
    if then == "emulator":  # its first 64 were there; and the predictive check has 10 means of 6
        assert len(set(asked)) == found.simulations - 64 + 10 * 6
        assert isinstance(found.diagnostics, EmulatorDiagnostics)
        assert found.diagnostics.reused == len(kept)
    shutil.rmtree(tmp_path / "first")
    finished([*again, "--draws", "10", "--resume"])


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(("more", "other"), [(["--seed", "5"], "seed"), (["--colonies", "2"], "replicates"), ([], "")])
def test_a_run_that_abc_has_no_use_for_is_told_of(
    data: Path, tmp_path: Path, more: list[str], other: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """And one that it has use for is not."""
    finished(arguments(data, tmp_path / "first", "abc-smc"))
    capsys.readouterr()
    again = arguments(data, tmp_path / "then", "abc-smc", "--reuse", str(tmp_path / "first"), *more)
    finished(again)
    said = " ".join(capsys.readouterr().err.split())
    assert (f"will be of use, it has other {other} than this run: abc-smc takes what it would" in said) == bool(more)
    counts = []
    for folder in ("first", "then"):
        with h5py.File(tmp_path / folder / "simulations.h5") as file:
            counts.append(sum(row["check"] != 0 for row in file[DATASET][:]))
    assert (counts[1] > counts[0]) == bool(more)


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked", "undrawn")
def test_a_run_that_was_killed_serves_again(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what it has simulated; not while it goes on."""

    def counting(simulator: Any, values: np.ndarray, seeds: np.ndarray) -> None:
        grown[0] += len(values)
        if len(grown) == 1 and grown[0] > 100:
            raise InputError("no more colonies today")

    grown = [0]
    monkeypatch.setattr(known_colonies, "before", counting)
    assert cli.run(arguments(data, tmp_path / "first", "abc-smc")) == 2
    with h5py.File(tmp_path / "first" / "simulations.h5") as file:
        kept = int((file[DATASET]["check"] != 0).sum())
    assert kept > 0
    again = arguments(data, tmp_path / "then", "emulator", "--reuse", str(tmp_path / "first"))
    (tmp_path / "first" / WORK).mkdir(exist_ok=True)
    with FileLock(tmp_path / "first" / WORK / LOCK):
        assert cli.run(again) == 2
    assert "first is in use: " in " ".join(capsys.readouterr().err.split())
    grown.append(0)
    finished(again)
    found = Posterior.load(tmp_path / "then" / "posterior.npz")
    assert isinstance(found.diagnostics, EmulatorDiagnostics)
    assert found.diagnostics.reused == kept


def test_what_cannot_be_reused_is_refused(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(arguments(data, tmp_path / "one", "emulator", "--reuse", str(tmp_path))) == 2
    assert "holds no simulations.h5" in capsys.readouterr().err
    assert not (tmp_path / "one").exists()
    finished(arguments(data, tmp_path / "other", "abc-smc", "--dt", "0.01"))
    assert cli.run(arguments(data, tmp_path / "two", "abc-smc", "--reuse", str(tmp_path / "other"))) == 2
    said = capsys.readouterr().err
    assert "--reuse: " in said
    assert "holds other simulations: dt was 0.01, now it is" in said
    (tmp_path / "other" / "run.json").write_text("{")
    assert (
        cli.run(arguments(data, tmp_path / "two", "abc-smc", "--dt", "0.01", "--reuse", str(tmp_path / "other"))) == 2
    )
    assert "run.json: this is no run that was saved whole" in capsys.readouterr().err
    (tmp_path / "other" / "run.json").unlink()
    (tmp_path / "other" / "manifest.json").unlink()
    assert cli.run(arguments(data, tmp_path / "two", "abc-smc", "--reuse", str(tmp_path / "other"))) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "has neither manifest.json nor run.json, need the folder of a run of infer" in said
    assert not (tmp_path / "two").exists()  # nor reused.h5, which the next run would find in its way


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_a_damaged_simulation_is_made_again_and_changes_no_prediction(data: Path, tmp_path: Path) -> None:
    """Although the file has it in another place then."""
    out, asked = tmp_path / "out", arguments(data, tmp_path / "out", "abc-smc", "--leave-out", "2")
    finished(asked)
    expected = {name: (out / name).read_text() for name in ("left_out.csv", "posterior.csv")}
    for name in (*json.loads((out / "manifest.json").read_text())["files"], "manifest.json"):
        if name not in ("run.json", "simulations.h5"):
            (out / name).unlink()
    with h5py.File(out / "simulations.h5", "r+") as file:
        row = file[DATASET][100]
        row["statistics"][0] += 1.0
        file[DATASET][100] = row
    finished([*asked, "--resume"])
    assert {name: (out / name).read_text() for name in expected} == expected


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_more_steps_make_a_run_longer(data: Path, tmp_path: Path) -> None:
    longer = [*arguments(data, tmp_path / "long", "abc-mcmc"), "--steps", "55"]
    finished(longer)
    finished(arguments(data, tmp_path / "parts", "abc-mcmc"))
    finished([*arguments(data, tmp_path / "parts", "abc-mcmc"), "--steps", "55", "--resume"])
    assert_same(tmp_path / "parts", tmp_path / "long")


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked", "undrawn")
def test_a_finished_run_predicts_anew(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With more draws and colonies left out: what a run of these has from its beginning, and no colony twice.

    What is not asked for stays as it is.
    """
    more, asked_for_nothing = ["--draws", "20", "--leave-out", "2"], arguments(data, tmp_path / "parts", "emulator")
    at = asked_for_nothing.index("--draws")
    del asked_for_nothing[at : at + 2]
    finished(arguments(data, tmp_path / "whole", "emulator", *more))
    finished(arguments(data, tmp_path / "parts", "emulator"))
    asked = list[bytes]()

    def counting(simulator: Any, values: np.ndarray, seeds: np.ndarray) -> None:
        asked.extend(row.tobytes() + seed.tobytes() for row, seed in zip(values, seeds, strict=True))

    monkeypatch.setattr(known_colonies, "before", counting)
    with h5py.File(tmp_path / "parts" / "simulations.h5") as file:
        kept = {row["values"].tobytes() + row["seed"].tobytes() for row in file[DATASET][:] if row["check"]}
    finished(arguments(data, tmp_path / "parts", "emulator", *more, "--resume"))
    assert_same(tmp_path / "parts", tmp_path / "whole")
    assert not kept & set(asked)
    for name in ("left_out.csv", "posterior.csv"):
        assert (tmp_path / "parts" / name).read_text() == (tmp_path / "whole" / name).read_text()
    listed = json.loads((tmp_path / "parts" / "manifest.json").read_text())
    assert (listed["configuration"]["draws"], listed["configuration"]["leave_out"]) == (20, 2)
    finished([*asked_for_nothing, "--resume"])
    assert "this run is finished" in capsys.readouterr().out
    assert (tmp_path / "parts" / "left_out.csv").is_file()


@pytest.mark.usefixtures("unchecked", "undrawn")
def test_a_finished_run_that_cannot_predict_so_is_as_it_was(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where one colony alone has a statistic, which is known once the images are measured."""
    finished(arguments(data, tmp_path / "out", "emulator"))
    before = {one.name: one.read_bytes() for one in (tmp_path / "out").iterdir() if one.is_file()}

    def lacking(*_: Any) -> None:
        raise InputError("--leave-out is 2: radius there is only disc 3")

    monkeypatch.setattr(run, "single_colonies", lacking)
    assert cli.run(arguments(data, tmp_path / "out", "emulator", "--leave-out", "2", "--resume")) == 2
    assert "only disc 3" in capsys.readouterr().err
    assert {one.name: one.read_bytes() for one in (tmp_path / "out").iterdir() if one.is_file()} == before


def test_a_run_goes_on_in_files_of_its_own(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store that is a link to a file elsewhere is not written."""
    out = tmp_path / "out"

    def stopping(*arguments: Any) -> None:
        raise Stopped

    with monkeypatch.context() as patch:
        patch.setattr(known_colonies, "before", stopping)
        with pytest.raises(Stopped):
            cli.run(arguments(data, out, "abc-smc"))
    (out / "simulations.h5").rename(tmp_path / "elsewhere.h5")
    (out / "simulations.h5").symlink_to(tmp_path / "elsewhere.h5")
    before = (tmp_path / "elsewhere.h5").read_bytes()
    capsys.readouterr()
    assert cli.run(arguments(data, out, "abc-smc", "--resume")) == 2
    assert "simulations.h5 is a link" in capsys.readouterr().err
    assert (tmp_path / "elsewhere.h5").read_bytes() == before


def test_a_damaged_manifest_is_told_before_anything_is_computed(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    finished(arguments(data, out, "abc-smc"))
    (out / "manifest.json").write_text("null")
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    monkeypatch.setattr(KnownColonies, "__call__", None)  # nothing is simulated
    capsys.readouterr()
    assert cli.run(arguments(data, out, "abc-smc", "--resume")) == 2
    assert "manifest.json is damaged: restore it, or give another folder" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before


def test_a_run_is_not_made_shorter(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What was found by more would be written over."""
    finished(arguments(data, tmp_path / "out", "abc-mcmc"))
    before = (tmp_path / "out" / "posterior.csv").read_bytes()
    assert cli.run([*arguments(data, tmp_path / "out", "abc-mcmc"), "--steps", "20", "--resume"]) == 2
    assert "holds a run of 40 steps, now it is 20: give --steps 40 or more" in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "out" / "manifest.json").is_file()
    assert (tmp_path / "out" / "posterior.csv").read_bytes() == before
    finished([*arguments(data, tmp_path / "out", "abc-mcmc"), "--resume"])


def test_a_longer_run_of_the_emulator_keeps_its_first_round(data: Path, tmp_path: Path) -> None:
    """Although so many simulations would have begun with a larger one."""

    def begun(simulations: int, resume: bool) -> InferRun:
        request = Request.of("emulator", {"simulations": simulations}, model="known")
        with results_folder(tmp_path / "out", "infer", resume=resume) as results:
            return InferRun.begin(request, data, results, resume, 1, silent)

    assert begun(64, False).folder.configuration["settings"]["first"] == 64
    longer = begun(300, True)
    assert longer.request.configuration()["settings"]["first"] == 128
    assert longer.folder.configuration["settings"]["first"] == 64
    assert isinstance(longer.sampler, SequentialEmulator)
    assert (longer.sampler.first, longer.sampler.each, longer.sampler.simulations) == (64, 64, 300)
    assert json.loads((tmp_path / "out" / "run.json").read_text())["configuration"]["settings"]["first"] == 64
    assert begun(300, True).folder.configuration["settings"]["first"] == 64


def test_problems_of_colonies_are_told_of_however_often_a_run_was_stopped(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grown = [0]

    def truncated(simulator: KnownColonies, values: np.ndarray, seeds: np.ndarray) -> None:
        if grown[0] >= 64:
            raise KeyboardInterrupt
        grown[0] += len(values)
        simulator.problems["births were cut because every node slot was taken: raise capacity or end earlier"] += 3

    with monkeypatch.context() as patch:
        patch.setattr(known_colonies, "before", truncated)
        assert cli.run(arguments(data, tmp_path / "out", "abc-smc")) == 130
    finished(arguments(data, tmp_path / "out", "abc-smc", "--resume"))
    said = json.loads((tmp_path / "out" / "manifest.json").read_text())["warnings"]
    assert any(one.startswith("6 of 920 discs: births were cut") for one in said)


def test_ctrl_c_says_how_to_go_on(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*given: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(known_colonies, "before", interrupted)
    assert cli.run(arguments(data, tmp_path / "out", "abc-mcmc")) == 130
    assert "repeat the command with --resume" in capsys.readouterr().err
    monkeypatch.setattr(InferRun, "begin", interrupted)  # while photographs are measured
    assert cli.run(arguments(data, tmp_path / "other", "abc-mcmc")) == 130
    assert "repeat the command with --resume" in capsys.readouterr().err
