"""Commands that end at random moments: nothing is lost, and what is repeated or resumed comes to the same bytes.

Three of four moments bring the kill that nobody can catch, the others Ctrl-C or SIGTERM. Every step of putting results
into place is killed in test_results_folder.
"""

import json
import os
import select
import signal
import subprocess
import sys
import time
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import h5py
import numpy as np
import psutil
import pytest
from known_colonies import RECIPE, write_measurements
from PIL import Image

from yeastfit.inference.store.simulation_store import DATASET
from yeastfit.results.contents import Contents
from yeastfit.storage import WORK, sha256_of

KILLS = 14
MOST_ATTEMPTS = 4 * KILLS
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGKILL, signal.SIGKILL, signal.SIGINT)
ANSWERED = 2.0 + 1.5  # seconds: what is promised, and what a busy machine adds
FREE = ("mobility", "metabolic_rate", "aspect_ratio")
UNLIKE = ("manifest.json", "index.html", "fit.json", "diagnostics.json", "run.json")  # hold times and arguments
MINE = ".mine.txt"  # a hidden file: beside another, an unfinished first run of infer is not gone on with
COUNTED = "problems.json"  # with simulations that were made and not yet stored
STORES = ("simulations.h5", "reused.h5")  # whose rows stand in the order in which they came
SMALL = ["--domain", "12", "--spacing", "0.2", "--capacity", "32", "--time", "2", "--every", "1", "--members", "2"]
KNOWN = ["--model", "known", "--free", "mobility,aspect-ratio"]
SAMPLED = {
    "emulator": ["--simulations", "128", "--walkers", "8", "--most-steps", "500"],
    "abc-mcmc": ["--steps", "200", "--walkers", "8", "--pilot", "96", "--pilot-quantile", "0.1"],
    "abc-smc": ["--population", "64", "--simulations", "2000", "--pilot", "96"],
}
SERVER = """
import json, os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores Ctrl-C
import known_colonies
from yeastfit.__main__ import main
from yeastfit.commands import app
app.loaded(sys.argv[1])
known_colonies.Known.fit_simulators = lambda self, targets, free, held: (self.simulator(targets, free, held),) * 2
known_colonies.before = lambda *batch: time.sleep(0.02)
for line in sys.stdin:
    sys.argv[1:], said = json.loads(line)
    if process := os.fork():
        print(process, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)
    else:
        os.setsid()
        for number, name in enumerate((os.devnull, said, said)):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_APPEND), number)
        main()
"""


@dataclass
class Server:
    """A process that has imported a command, and runs it in processes of their own."""

    process: subprocess.Popen[bytes]
    said: Path

    def run(self, command: list[str], seconds: float = 1e6, number: int = signal.SIGKILL) -> tuple[int, float]:
        """Run a command, send it a signal some time later; its exit code and its time.

        None of its processes is left, and an answered signal leaves one line.
        """
        self.said.unlink(missing_ok=True)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps([command, str(self.said)]).encode() + b"\n")
        session, began = int(self.process.stdout.readline()), time.perf_counter()
        if not select.select([self.process.stdout], [], [], seconds)[0]:
            sent = time.perf_counter()
            os.kill(session, number)
            assert select.select([self.process.stdout], [], [], ANSWERED)[0]
            assert time.perf_counter() - sent < ANSWERED
        code, took, said = int(self.process.stdout.readline()), time.perf_counter() - began, self.said.read_text()
        assert code in (-number, 128 + number, 0, 1), said
        assert "Traceback" not in said
        if code > 1:
            assert said.splitlines()[-1].startswith("interrupted: "), said
        began = time.perf_counter()
        while left := in_session(session):
            assert time.perf_counter() - began < ANSWERED, left
        return code, took


@pytest.fixture
def server(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Server]:
    """Of the command that the test is about; all its runs share compiled programs."""
    tests, name = Path(__file__).parents[1], request.getfixturevalue("name")
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (tests, tests.parent))), "JAX_NUM_CPU_DEVICES": "2"}
    where |= {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "jax"), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    program = [sys.executable, "-c", SERVER, "infer" if name in SAMPLED else name]
    pipe = subprocess.PIPE
    with subprocess.Popen(program, env=where, bufsize=0, stdin=pipe, stdout=pipe) as process:
        yield Server(process, tmp_path / "said.txt")


def in_session(session: int) -> list[int]:
    """Processes that were started by one, and run."""
    found = []
    for one in psutil.process_iter():
        try:
            if os.getsid(one.pid) == session and one.status() != psutil.STATUS_ZOMBIE:
                found.append(one.pid)
        except (OSError, psutil.Error):
            continue
    return found


def contents(folder: Path) -> dict[str, bytes]:
    found = {one.relative_to(folder).as_posix(): one for one in folder.rglob("*") if one.is_file()}
    return {name: one.read_bytes() for name, one in found.items()}


def essence(name: str, data: bytes) -> object:
    """A file's bytes; of an archive, all its arrays but what holds seconds; of a store, its rows in any order."""
    if Path(name).name in (*UNLIKE, COUNTED):
        return None
    if Path(name).name in STORES:
        with h5py.File(BytesIO(data)) as file:
            return sorted(row.tobytes() for row in file[DATASET][...])
    if name.endswith((".h5", ".nc")):
        arrays: dict[str, bytes] = {}
        with h5py.File(BytesIO(data)) as file:
            file.visititems(
                lambda at, one: (
                    arrays.update({at: repr(one[()].tolist()).encode()}) if isinstance(one, h5py.Dataset) else None
                )
            )
        return arrays
    if name.endswith(".npz"):
        with np.load(BytesIO(data)) as archive:
            found = {key: archive[key].tobytes() for key in archive.files if key != "configuration"}
            if "rest" in found:
                found["rest"] = json.dumps({**json.loads(str(archive["rest"])), "seconds": 0}).encode()
            return found
    return data


@dataclass
class Command:
    """A command, where its results go, and what they are if nobody disturbs it.

    Attributes:
        name: Of the command, and of its method.
        inputs: Folder of what it reads.
        results: What it makes, by name.
        rows: Simulations that were whole in its folder so far.
    """

    name: str
    inputs: Path
    results: dict[str, object] = field(default_factory=dict)
    rows: int = 0

    @property
    def resumes(self) -> bool:
        return self.name in SAMPLED

    @property
    def of(self) -> str:
        return "infer" if self.resumes else self.name

    def below(self, out: Path) -> Path:
        return out / "small" if self.name == "synthesize" else out

    def line(self, out: Path) -> list[str]:
        table = str(self.inputs / "measurements.csv")
        given = {
            "simulate": SMALL,
            "measure": [str(self.inputs / "images"), "--pixel-size", "1", "--jobs", "2"],
            "fit": [table, *KNOWN, "--starts", "1"],
            "design": ["--sensitivity", str(self.inputs / "sensitivity.json")],
            "synthesize": ["--recipe", str(self.inputs / "recipes.toml")],
        }
        sampled = [table, *KNOWN, "--draws", "12", "--method", self.name, *SAMPLED.get(self.name, ()), "--resume"]
        return [self.of, *given.get(self.name, sampled), "--out", str(out)]

    def check(self, out: Path) -> bool:
        """Check a folder after any end: whole, or said to be unfinished; whether it is whole."""
        folder = self.below(out)
        found = Contents.of(folder)
        if not found.finished:
            assert found.command in ("", self.of)
            if self.resumes and (folder / "simulations.h5").is_file():
                before, self.rows = self.rows, whole_rows(folder / "simulations.h5")
                assert self.rows >= before
            return False
        self.rows = 0
        listed = json.loads((folder / "manifest.json").read_text())["files"]
        assert listed == {file: sha256_of(folder / file) for file in listed}
        if self.results:
            assert set(listed) | {"manifest.json"} == set(self.results)
        return True

    def compare(self, out: Path) -> None:
        """Check that results are those of the run that nobody disturbed."""
        found = contents(self.below(out))
        assert {name for name in found if not name.startswith(WORK)} - {MINE} == set(self.results)
        for name, expected in self.results.items():
            assert essence(name, found[name]) == expected, name


def whole_rows(store: Path) -> int:
    """Simulations of a store whose check is right."""
    with h5py.File(store) as file:
        rows = file[DATASET][...]
    return sum(zlib.crc32(row.tobytes()[: -row["check"].nbytes]) == row["check"] for row in rows)


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    from sensitivities import made_up

    where = tmp_path / "inputs"
    (where / "images").mkdir(parents=True)
    x = np.hypot(*np.mgrid[-60:60, -60:60])
    for k in range(12):
        noise = np.random.default_rng(k).normal(0, 2, x.shape)
        pixels = np.where(x < 30 + k, 60, 180) + noise
        Image.fromarray(pixels.astype(np.uint8)).save(where / "images" / f"{k}.png")
    (where / "recipes.toml").write_text(RECIPE)
    write_measurements(where / "measurements.csv")
    made_up(("area", "radius"), [1.0, 2.0, 3.0], FREE).save(where / "sensitivity.json")
    return where


@pytest.mark.slow
@pytest.mark.parametrize("name", ["measure", "synthesize", "simulate", "fit", "design", *SAMPLED])
def test_ended_at_random_moments_it_comes_to_the_same_bytes(
    name: str, inputs: Path, server: Server, tmp_path: Path
) -> None:
    """Two runs of three begin where the last one was ended, the third one is left in peace; a user's file stays."""
    command = Command(name, inputs)
    server.run(command.line(tmp_path / "first"))  # compiles
    code, length = server.run(command.line(tmp_path / "whole"))
    assert code in (0, 1)
    assert command.check(tmp_path / "whole")
    command.results = {one: essence(one, data) for one, data in contents(command.below(tmp_path / "whole")).items()}
    rng, kills, number, unfinished = np.random.default_rng(3), Counter[int](), 0, 0
    for attempt in range(MOST_ATTEMPTS):
        if kills.total() == KILLS:
            break
        out = tmp_path / f"out{number}"
        mine = command.below(out) / MINE
        if Contents.of(command.below(out)).finished or (command.below(out) / "run.json").is_file():
            mine.write_text("mine")
        before = mine.is_file()
        code, _ = server.run(command.line(out), float(rng.uniform(0.0, length)), SIGNALS[attempt % len(SIGNALS)])
        if whole := command.check(out):
            command.compare(out)
        assert whole or code not in (-signal.SIGTERM, -signal.SIGINT)  # which Python leaves alone while it ends
        unfinished += not whole
        kills.update([code] if code not in (0, 1) else [])
        if code not in (0, 1) and kills.total() % 3 == 0:
            code, _ = server.run(command.line(out))
            assert not (command.below(out) / WORK).exists()
            assert command.check(out)
            command.compare(out)
        assert not before or mine.read_text() == "mine"
        number += code in (0, 1) and (command.resumes or kills.total() % 2 == 0)
    assert kills.total() == KILLS
    print(f"{name}: {dict(kills)}, {unfinished} unfinished, {length:.1f} s")
