"""Commands that are killed at random moments: nothing is lost, and what is repeated comes to the same bytes.

`infer` is killed in test_infer, and every step of putting results into place in test_results_folder.
"""

import json
import os
import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from known_colonies import RECIPE, write_measurements
from PIL import Image

from yeastfit.results_contents import Contents
from yeastfit.storage import sha256_of

KILLS = 8
FREE = ("mobility", "metabolic_rate", "aspect_ratio")
UNLIKE = ("index.html", "fit.json", "parameters.json")  # hold times, or where they were made
KILLED = """
import sys
import known_colonies
from yeastfit.commands import app as cli
cli.loaded(sys.argv[2])
known_colonies.Known.fit_simulators = lambda self, targets, free, held: (self.simulator(targets, free, held),) * 2
known_colonies.kill_within(float(sys.argv[1]), 0.0)
sys.exit(cli.run(sys.argv[2:]))
"""


def run(command: list[str], seconds: float = 1e6) -> tuple[int, float]:
    """In a process of its own, killed some time after its imports: its exit code, and how long it took."""
    tests = Path(__file__).parents[1]
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (tests, tests.parent)))}
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(seconds), *command], env=where, capture_output=True, text=True, check=False
    )
    assert done.returncode in (-9, 0, 1), done.stderr
    return done.returncode, time.perf_counter() - began


def contents(folder: Path) -> dict[str, bytes]:
    found = {one.relative_to(folder).as_posix(): one for one in folder.rglob("*") if one.is_file()}
    return {name: one.read_bytes() for name, one in found.items()}


def essence(name: str, data: bytes) -> object:
    """A file's bytes; of an archive, all its arrays but the configuration, which holds seconds."""
    if not name.endswith(".npz"):
        return data
    with np.load(BytesIO(data)) as archive:
        return {key: archive[key].tobytes() for key in archive.files if key != "configuration"}


def command_of(name: str, inputs: Path, out: Path) -> list[str]:
    small = ["--domain", "12", "--spacing", "0.2", "--capacity", "32", "--time", "2", "--every", "1", "--members", "2"]
    table = str(inputs / "measurements.csv")
    known = ["--model", "known", "--free", "mobility,aspect-ratio"]
    given = {
        "simulate": small,
        "measure": [str(inputs / "images"), "--pixel-size", "1", "--jobs", "2"],
        "fit": [table, *known, "--starts", "1"],
        "design": ["--sensitivity", str(inputs / "sensitivity.json")],
        "synthesize": ["--recipe", str(inputs / "recipes.toml")],
    }
    return [name, *given[name], "--out", str(out)]


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
@pytest.mark.parametrize("name", ["measure", "synthesize"])
def test_killed_at_random_moments_it_comes_to_the_same_bytes(name: str, inputs: Path, tmp_path: Path) -> None:
    """Half of the kills meet a folder with results, half one without; a file of the user's lies in the former."""
    below = "small" if name == "synthesize" else "."
    _, apart = run([*command_of(name, inputs, tmp_path / "none"), "--help"])
    _, length = run(command_of(name, inputs, tmp_path / "whole"))
    whole = {file: text for file, text in contents(tmp_path / "whole" / below).items() if file != "manifest.json"}
    rng, kills, unfinished = np.random.default_rng(3), 0, 0
    for attempt in range(4 * KILLS):
        if kills == KILLS:
            break
        out, mine = tmp_path / f"out{attempt % 2}", b""
        if attempt % 2 and (out / below / "manifest.json").is_file():
            (out / below / "mine.txt").write_text("mine")
            mine = b"mine"
        code, _ = run(command_of(name, inputs, out), float(rng.uniform(0.0, max(length - apart, 0.5))))
        kills += code == -9
        found = Contents.of(out / below)
        if mine:
            assert (out / below / "mine.txt").read_bytes() == mine
        if found.finished:
            listed = json.loads((out / below / "manifest.json").read_text())["files"]
            assert listed == {file: sha256_of(out / below / file) for file in listed}
            assert set(listed) == set(whole)
        else:
            unfinished += 1
            assert found.command in ("", name)
        if attempt % 2:
            code, _ = run(command_of(name, inputs, out))
            assert code in (0, 1)
            again = contents(out / below)
            assert {file for file in again if file not in ("manifest.json", "mine.txt")} == set(whole)
            for file, text in whole.items():
                if Path(file).name not in UNLIKE:
                    assert essence(file, again[file]) == essence(file, text), file
    assert kills == KILLS
    print(f"{name}: {kills} kills, {unfinished} left unfinished")
