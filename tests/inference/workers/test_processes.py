"""Workers that are processes of Dask: killed, with their scheduler and with the process that asks; unlike ones."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from wobble import Wobble, proposed

from yeastfit import ColonySimulator, Imaging, Posterior, Resolution, Simulator, Store, Targets, Workers, infer
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.simulator import labels_of
from yeastfit.inference.workers.admission import Patience

pytestmark = pytest.mark.slow
TESTS = Path(__file__).parents[2]
KILLS = 20
PERSISTENT = Patience(tries=100)
METHODS: dict[str, dict[str, Any]] = {
    "emulator": {"simulations": 192, "first": 64, "walkers": 8, "most_steps": 500},
    "abc-mcmc": {"steps": 30, "walkers": 16, "pilot": 64},
    "abc-smc": {"population": 64, "simulations": 1500, "pilot": 64, "populations": 4},
}


def bits(rows: np.ndarray) -> bytes:
    return np.ascontiguousarray(rows).tobytes()


@contextmanager
def killing(workers: Workers, kills: int, between: tuple[float, float], seed: int) -> Iterator[list[int]]:
    """Kill random workers at random moments when all are there, while there are kills left and the body runs."""
    rng, dead, ended = np.random.default_rng(seed), list[int](), threading.Event()
    crew: Any = workers._crew

    def kill() -> None:
        while len(dead) < kills and not ended.wait(rng.uniform(*between)):
            nannies = [one for one in crew.owned.workers.values() if one.pid]
            if len(crew.owned.scheduler.workers) == crew.wanted and nannies:
                pid = nannies[rng.integers(len(nannies))].pid
                os.kill(pid, signal.SIGKILL)
                dead.append(pid)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield dead
    finally:
        ended.set()
        thread.join()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_rows_are_the_serial_ones_though_workers_are_killed(count: int) -> None:
    """Twenty times, at random moments."""
    simulator, said, waves, blocks = Wobble(seconds=0.01), list[str](), 0, 0
    with (
        Workers(count, say=said.append, patience=PERSISTENT) as workers,
        killing(workers, KILLS, (0.2, 3.0), count) as dead,
    ):
        found = workers.spread(simulator)
        while len(dead) < KILLS:
            values, seeds = proposed(200, waves)
            assert bits(found(values, seeds)) == bits(Wobble()(values, seeds))
            waves, blocks = waves + 1, blocks + 25
    lost = sum(int(match[1]) for line in said if (match := re.match(r"(\d+) of the workers gone", line)))
    print(f"{count} workers: {len(dead)} kills, {lost} noticed in {blocks} blocks")
    assert len(dead) == KILLS
    assert lost > KILLS // 3  # some are killed before they are known, or between two waves


def colonies(model: str) -> tuple[Simulator, np.ndarray]:
    """A simulator of each model, and rows."""
    rng = np.random.default_rng(3)
    if model == "algebraic":
        means = {"compactness": [1.6, 2.1], "radius": [1.0, 1.6]}
        scatter = {"compactness": [0.1, 0.2], "radius": [0.05, 0.1]}
        targets = Targets.from_means(means, [1.5, 3.0], scatter=scatter, replicates=5, imaging=Imaging(extent=4.0))
        free = ("mobility", "aspect_ratio")
        values = np.exp(rng.uniform(np.log([0.3, 0.4]), np.log([3.0, 0.9]), (96, 2)))
        return ColonySimulator.of(targets, free, resolution=Resolution(dt=0.02, spacing=0.25)), values
    from yeastfit.offlattice import OfflatticeSimulator

    free = ("transition", "fork")
    return OfflatticeSimulator.of(("compactness", "area"), cells=3000, free=free), rng.uniform(0.1, 0.5, (400, 2))


@pytest.mark.parametrize("model", ["algebraic", "offlattice"])
def test_colonies_are_the_serial_ones(model: str) -> None:
    """With 1, 2 and 3 workers, of which some are killed."""
    simulator, values = colonies(model)
    seeds = np.arange(len(values))
    expected = simulator(values, seeds)
    for count in (1, 2, 3):
        said = list[str]()
        with (
            Workers(count, say=said.append, patience=PERSISTENT) as workers,
            killing(workers, 2, (2.0, 8.0), count) as dead,
        ):
            found = workers.spread(simulator)
            waves = 0
            while not waves or len(dead) < 2:
                assert bits(found(values, seeds)) == bits(expected)
                waves += 1
        assert not any("refused" in line for line in said), said


PRIORS = {
    "algebraic": {
        "mobility": {"distribution": "log-uniform", "low": 0.3, "high": 3.0},
        "aspect_ratio": {"distribution": "log-uniform", "low": 0.4, "high": 0.9},
    },
    "offlattice": {name: {"distribution": "uniform", "low": 0.1, "high": 0.5} for name in ("transition", "fork")},
}


@pytest.mark.parametrize("method", list(METHODS))
@pytest.mark.parametrize("model", list(PRIORS))
def test_posteriors_are_the_same_to_the_last_draw(model: str, method: str) -> None:
    """With 1, 2 and 3 workers, of which one is killed."""
    colony, values = colonies(model)
    observed = colony(values[:1], np.array([7]))[0]

    def posterior(simulator: Simulator) -> Posterior:
        prior = Prior.of(PRIORS[model])
        return infer(simulator, prior, observed, method=method, seed=2, replicates=2, **METHODS[method])

    serial = posterior(colony)
    for count in (1, 2, 3):
        with Workers(count, patience=PERSISTENT, say=print) as workers, killing(workers, 1, (2.0, 4.0), count) as dead:
            found = posterior(workers.spread(colony))
        print(f"{model}, {method}, {count} workers: {len(dead)} killed")
        assert bits(found.values) == bits(serial.values)
        assert bits(found.weights) == bits(serial.weights)
        assert bits(found.statistics) == bits(serial.statistics)


RUN = """
import sys
from pathlib import Path
from wobble import Wobble, proposed
from yeastfit import CachedSimulator, Store, Workers
from yeastfit.inference.simulator import labels_of

if __name__ == "__main__":
    simulator = Wobble(seconds=0.01)
    with Store(Path(sys.argv[1]), ("a", "b"), labels_of(simulator)) as store, Workers(2) as workers:
        cached = CachedSimulator(workers.spread(simulator), 32, store)
        print("open", flush=True)
        for wave in range(5):
            cached(*proposed(400, wave))
        print(cached.fresh, flush=True)
"""


def test_the_process_that_asks_is_killed_and_goes_on(tmp_path: Path) -> None:
    script, path = tmp_path / "run.py", tmp_path / "simulations.h5"
    script.write_text(RUN)
    rng, kills, kept = np.random.default_rng(0), 0, 0
    while True:
        process = started([sys.executable, str(script), str(path)], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        children = psutil.Process(process.pid).children(recursive=True)
        if kills < 5:
            time.sleep(rng.uniform(1.0, 5.0))
            if process.poll() is None:
                process.kill()
                kills += 1
            process.wait()
            process.stdout.close()
            _, alive = psutil.wait_procs(children, timeout=20)
            assert not alive
            with Store(path, ("a", "b"), labels_of(Wobble())) as store:
                assert len(store) >= kept
                kept = len(store)
            continue
        fresh = int(process.stdout.readline())
        assert process.wait() == 0
        process.stdout.close()
        break
    print(f"{kills} kills, {kept} of 2000 rows were kept, {fresh} were simulated then")
    assert fresh == 2000 - kept
    with Store(tmp_path / "serial.h5", ("a", "b"), labels_of(Wobble())) as store:
        for wave in range(5):
            values, seeds = proposed(400, wave)
            for start in range(0, 400, 8):
                store.append(
                    values[start : start + 8], seeds[start : start + 8], Wobble()(values, seeds)[start : start + 8]
                )
    assert path.read_bytes() == (tmp_path / "serial.h5").read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a stopped process stays")
def test_ctrl_c_is_answered_by_the_process_that_asks(tmp_path: Path) -> None:
    """In a terminal all processes of a command get it. Workers end with the one that asks, stopped ones, too."""
    (tmp_path / "run.py").write_text(RUN)
    command = [sys.executable, str(tmp_path / "run.py"), str(tmp_path / "simulations.h5")]
    how: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "start_new_session": True}
    process = started(command, text=True, **how)
    assert process.stdout is not None
    assert process.stdout.readline() == "open\n"
    children = psutil.Process(process.pid).children(recursive=True)
    worker = next(one for one in children if "spawn_main" in " ".join(one.cmdline()))
    worker.suspend()
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert said.strip().endswith("KeyboardInterrupt")
    assert "Dask Worker process" not in said
    _, alive = psutil.wait_procs(children, timeout=20)
    assert not [one for one in alive if one.status() != psutil.STATUS_ZOMBIE]


def started(command: Sequence[str], **how: Any) -> "subprocess.Popen[str]":
    """A process that imports what the tests import."""
    paths = os.pathsep.join([*how.pop("first", []), str(TESTS), str(TESTS.parent)])
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, **how)


@contextmanager
def dask(port: int) -> Iterator[dict[str, Any]]:
    """Functions that start a scheduler and workers, as on a terminal; all end at the end."""
    running = list[subprocess.Popen[str]]()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    tool = [sys.executable, "-m", "dask"]

    def scheduler() -> "subprocess.Popen[str]":
        where = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        running.append(started([*tool, "scheduler", *where], **quiet))
        return running[-1]

    def worker(name: str, first: Sequence[str] = ()) -> "subprocess.Popen[str]":
        where = [f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--name", name, "--no-dashboard"]
        running.append(started([*tool, "worker", *where], first=list(first), **quiet))
        return running[-1]

    try:
        yield {"scheduler": scheduler, "worker": worker}
    finally:
        for one in reversed(running):
            one.terminate()
        for one in running:
            one.wait()


@pytest.fixture
def port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def test_a_scheduler_is_killed_and_started_again(port: int) -> None:
    said = list[str]()
    simulator = Wobble(seconds=0.01)
    with dask(port) as start:
        first = start["scheduler"]()
        start["worker"]("one")
        time.sleep(5)

        def restart() -> None:
            first.kill()
            time.sleep(2)
            start["scheduler"]()
            start["worker"]("two")

        again = threading.Timer(3.0, restart)
        with Workers(scheduler=f"tcp://127.0.0.1:{port}", say=said.append) as workers:
            found = workers.spread(simulator)
            values, seeds = proposed(1200)
            again.start()
            rows = found(values, seeds)
        again.join()
    assert bits(rows) == bits(Wobble()(values, seeds))
    print(*said, sep="\n")
    assert any("the scheduler at tcp" in line and "is gone" in line for line in said)
    assert any("is there again" in line for line in said)


def test_a_worker_with_another_jaxlib_is_refused(port: int, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import importlib.metadata as m\n"
        "real = m.version\n"
        "m.version = lambda name: '9.9.9' if name == 'jaxlib' else real(name)\n"
    )
    said = list[str]()
    with dask(port) as start:
        start["scheduler"]()
        start["worker"]("other", [str(tmp_path)])
        start["worker"]("usual")
        time.sleep(8)
        with Workers(scheduler=f"tcp://127.0.0.1:{port}", say=said.append) as workers:
            values, seeds = proposed(200)
            rows = workers.spread(Wobble(seconds=0.01))(values, seeds)
        with Workers(scheduler=f"tcp://127.0.0.1:{port}", mixed_arithmetic=True, say=said.append) as workers:
            assert bits(workers.spread(Wobble())(values, seeds)) == bits(rows)
            unlike = workers.asdict()["mixed_arithmetic"]
    assert bits(rows) == bits(Wobble()(values, seeds))
    refused = [line for line in said if "is refused" in line]
    assert len(refused) == 1
    assert re.match(r"worker other on \S+ is refused: jaxlib 9.9.9 instead of ", refused[0])
    assert len(unlike) == 1
    assert unlike[0].startswith("other on ")
