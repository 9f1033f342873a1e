"""Rows by workers that finish in random order, fail, die and hang are the serial rows, bit by bit and in order."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import distributed
import numpy as np
import pytest
from scattered_crew import MINE, Scattered, other_jaxlib
from wobble import Wobble, proposed

from yeastfit import CachedSimulator, InputError, Prior, SimulationError, Store, infer
from yeastfit.inference.simulator import Replicates, Simulator, labels_of
from yeastfit.inference.workers import dispatch, spread, worker
from yeastfit.inference.workers.admission import Patience
from yeastfit.inference.workers.crew import Answer
from yeastfit.inference.workers.dask_crew import STARTS, DaskCrew, local_crew
from yeastfit.inference.workers.spread import Spread, Workers
from yeastfit.inference.workers.worker import NotMade, admit, simulate
from yeastfit.specification import Specification

NEVER = Patience(tries=10**6, retry=0.0, look=0.0)
ROWS = 203


@pytest.fixture(autouse=True)
def same_arithmetic(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spread.Arithmetic, "of_this_process", staticmethod(lambda: MINE))


def by(crew: Scattered, simulator: Simulator | None = None, **more: Any) -> tuple[Spread, list[str]]:
    said = list[str]()
    return Spread(simulator or Wobble(), crew, **{"say": said.append, "patience": NEVER, **more}), said


def bits(rows: np.ndarray) -> bytes:
    return np.ascontiguousarray(rows).tobytes()


@pytest.mark.parametrize("workers", [1, 2, 3, 40])
def test_rows_are_the_serial_ones_whatever_happens(workers: int) -> None:
    """Until there have been ten deaths of workers and three of the scheduler."""
    deaths = losses = wave = unordered = 0
    while deaths < 10 or losses < 3:
        values, seeds = proposed(ROWS, wave)
        serial = Wobble()
        expected = serial(values, seeds)
        crew = Scattered(workers, wave, failing=0.1, dying=0.1, losing=0.02)
        found, said = by(crew)
        assert bits(found(values, seeds)) == bits(expected)
        assert found.problems == serial.problems
        assert bool(crew.deaths + crew.losses) == any("gone" in line for line in said)
        unordered += crew.order != sorted(crew.order)
        deaths, losses, wave = deaths + crew.deaths, losses + crew.losses, wave + 1
    assert unordered or workers == 1


def test_admitted_workers_stay_so_from_wave_to_wave() -> None:
    crew = Scattered(3, 0)
    found, said = by(crew)
    for wave in range(3):
        values, seeds = proposed(ROWS, wave)
        assert bits(found(values, seeds)) == bits(Wobble()(values, seeds))
    assert crew.tickets == len(crew.requests) + 3
    assert len(said) == 1


def test_blocks_do_not_depend_on_the_number_of_workers() -> None:
    values, seeds = proposed(ROWS)
    asked = []
    for workers in (1, 5):
        crew = Scattered(workers, 4)
        by(crew)[0](values, seeds)
        asked.append(sorted(crew.requests))
    assert asked[0] == asked[1]
    assert {len(one) for one in asked[0][:-1]} <= {8, ROWS % 8}
    assert sum(map(len, asked[0])) == ROWS - 2 * 8  # the first two are simulated here


def stored(path: Path, simulator: Any, waves: int, batch: int = 32) -> CachedSimulator:
    with Store(path, ("a", "b"), labels_of(Wobble())) as store:
        cached = CachedSimulator(simulator, batch, store)
        for wave in range(waves):
            cached(*proposed(ROWS, wave))
    return cached


def test_a_store_has_the_same_bytes(tmp_path: Path) -> None:
    stored(tmp_path / "serial.h5", Wobble(), 3)
    stored(tmp_path / "spread.h5", by(Scattered(3, 1, failing=0.1, dying=0.1, losing=0.01))[0], 3)
    assert (tmp_path / "serial.h5").read_bytes() == (tmp_path / "spread.h5").read_bytes()


def test_what_is_in_the_store_is_not_asked_for_again(tmp_path: Path) -> None:
    """A run of two workers ends in its middle, for want of workers; one of ten goes on."""
    stored(tmp_path / "serial.h5", Wobble(), 2)
    crew = Scattered(2, 5)
    one, _ = by(crew, patience=Patience(alone=0.0, retry=0.0))
    values, seeds = proposed(ROWS)
    with Store(tmp_path / "run.h5", ("a", "b"), labels_of(Wobble())) as store:
        cached, held = CachedSimulator(one, 32, store), one.blocks

        def ending(values: np.ndarray, seeds: np.ndarray, size: int) -> Any:
            for number, rows in enumerate(held(values, seeds, size)):
                if number == 9:
                    crew.count, crew.away = 0, 10**6
                    crew.losing = 1.0
                yield rows

        object.__setattr__(one, "blocks", ending)
        with pytest.raises(SimulationError, match="repeat the run to go on"):
            cached(values, seeds)
        kept = {int(seed) for seed in store.all()[1]}
    assert 9 * 8 <= len(kept) < ROWS
    later = Scattered(10, 6)
    stored(tmp_path / "run.h5", by(later)[0], 2)
    assert not kept & {seed for request in later.requests for seed in request}
    assert (tmp_path / "serial.h5").read_bytes() == (tmp_path / "run.h5").read_bytes()


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        ("abc-mcmc", {"steps": 20, "walkers": 16, "pilot": 64, "replicates": 2}),
        ("abc-smc", {"population": 32, "simulations": 600, "pilot": 64, "populations": 3}),
    ],
)
def test_posteriors_are_the_same_to_the_last_draw(method: str, settings: dict[str, Any]) -> None:
    prior = Prior.of({name: {"distribution": "log-uniform", "low": 0.2, "high": 5.0} for name in ("a", "b")})

    def posterior(simulator: Any) -> Any:
        return infer(simulator, prior, [2.0, 3.0, 4.0], method=method, seed=2, **settings)

    serial, found = posterior(Wobble()), posterior(by(Scattered(3, 2, failing=0.05, dying=0.05))[0])
    assert bits(found.values) == bits(serial.values)
    assert bits(found.weights) == bits(serial.weights)
    assert found.simulations == serial.simulations


def test_a_block_that_fails_three_times_ends_the_run() -> None:
    values, seeds = proposed(ROWS)
    simulator = Wobble(fails=int(seeds[50]))
    found, said = by(Scattered(2, 0), simulator, patience=Patience())
    rows = list[np.ndarray]()
    with pytest.raises(SimulationError, match=r"3 times 8 simulations .* out of order") as raised:
        rows.extend(found.blocks(values, seeds))
    assert len([line for line in said if "given to another" in line]) == 2
    assert f"seed {int(seeds[48])}" in str(raised.value)
    assert bits(np.concatenate(rows)) == bits(Wobble()(values[:48], seeds[:48]))  # what came before was handed on


def test_workers_that_hang_are_asked_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(np.arange(0.0, 1e6, 0.5))
    monkeypatch.setattr(dispatch.time, "monotonic", lambda: next(clock))
    values, seeds = proposed(ROWS)
    crew = Scattered(4, 1, hanging=("w1:1", "w3:1"))
    found, said = by(crew)
    assert bits(found(values, seeds)) == bits(Wobble()(values, seeds))
    assert sum("has not answered" in line for line in said) == 2


def test_other_arithmetic_is_refused_by_name() -> None:
    values, seeds = proposed(ROWS)
    expected = Wobble()(values, seeds)
    crew = Scattered(3, 0, others={"w1:1": other_jaxlib()}, shift={"w2:1": 1e-15})
    found, said = by(crew)
    assert bits(found(values, seeds)) == bits(expected)
    assert any("w1:1 is refused: jaxlib 0.0.1 instead of 1.0" in line for line in said)
    assert any("w2:1 is refused: its processor" in line and "instead of" in line for line in said)
    assert found.status.startswith("1 worker,")


def test_other_arithmetic_is_accepted_where_it_is_asked_for() -> None:
    values, seeds = proposed(ROWS)
    found, _ = by(Scattered(1, 0, shift={"w0:1": 1e-12}), mixed=True)
    rows, expected = found(values, seeds), Wobble()(values, seeds)
    np.testing.assert_allclose(rows, expected, rtol=1e-6)
    assert bits(rows) != bits(expected)
    assert len(found.unlike) == 1


def test_no_worker_is_left() -> None:
    values, seeds = proposed(ROWS)
    refused, _ = by(Scattered(2, 0, others={"w0:1": other_jaxlib(), "w1:1": other_jaxlib()}))
    with pytest.raises(SimulationError, match=r"all 2 workers at nowhere were refused .*--mixed-arithmetic"):
        refused(values, seeds)
    busy, _ = by(Scattered(2, 0, tasks=2))
    with pytest.raises(SimulationError, match="one as it does 2 tasks at once: start it with --nthreads 1") as error:
        busy(values, seeds)
    assert "--mixed-arithmetic" not in str(error.value)
    nobody, _ = by(Scattered(0), patience=Patience(alone=0.0))
    with pytest.raises(SimulationError, match="there has been no worker at nowhere"):
        nobody(values, seeds)
    gone, said = by(Scattered(2, 0, losing=1.0, away=9), patience=Patience(alone=0.0, retry=0.0))
    with pytest.raises(SimulationError, match="the scheduler at nowhere has been gone"):
        gone(values, seeds)
    assert any("trying to reach it" in line for line in said)


@dataclass
class Late(Scattered):
    """Its worker computes for 300 s and dies before it is admitted; the next one comes `later` seconds after that."""

    now: float = 0.0
    later: float = 100.0

    def wait(self, seconds: float) -> list[Answer]:
        self.now += 100.0
        if self.now == 300.0:
            self.queues.clear()
        self.count = int(not 300.0 <= self.now < 300.0 + self.later)
        return super().wait(seconds) if self.now > 300.0 else []


def test_the_next_worker_is_waited_for_from_when_the_last_one_was_there(monkeypatch: pytest.MonkeyPatch) -> None:
    values, seeds = proposed(ROWS)
    for later in (100.0, 400.0):
        crew = Late(1, later=later)
        monkeypatch.setattr(dispatch, "time", SimpleNamespace(monotonic=lambda crew=crew: crew.now))
        found, said = by(crew, patience=Patience(alone=200.0, least=1e9))
        if later == 100.0:
            assert bits(found(values, seeds)) == bits(Wobble()(values, seeds))
        else:
            with pytest.raises(SimulationError, match="there has been no worker at nowhere for 300 s"):
                found(values, seeds)
        assert said[0].startswith("1 of the workers gone: w0:1")


def test_what_is_to_be_gained_is_said_before_the_first_block() -> None:
    crew = Scattered(4, 0)
    found, said = by(crew, patience=Patience())  # two machines, on each of which one worker begins alone
    list(found.blocks(*proposed(3 * 8)))
    assert said[0].startswith("4 workers, blocks of 8: one takes 0.01 s on a worker")
    assert said[0].endswith("times as fast is expected where 4 blocks are asked for at once")


@pytest.mark.parametrize("rows", [0, 1, 8, 9, 16])
def test_small_waves(rows: int) -> None:
    found, _ = by(Scattered(2, 0))
    for wave in range(2):
        values, seeds = proposed(rows, wave)
        simulator = Wobble()
        assert bits(found(values, seeds)) == bits(simulator(values, seeds).reshape(rows, 3))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: Workers(), "need one of the two"),
        (lambda: Workers(2, "tcp://here:1"), "need one of the two"),
        (lambda: Workers(0), "processes is 0"),
        (lambda: Workers(2, block=0), "block is 0"),
        (lambda: Workers(10**9), "memory"),
        (lambda: Workers(2).spread(Wobble()), "not open"),
        (lambda: by(Scattered(1), Replicates(Wobble(), 2)), "no `specification`"),
    ],
)
def test_bad_input(wrong: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        wrong()


def test_workers_that_are_slow_to_end_do_not_fail_a_run() -> None:
    asked = list[float]()

    class Busy:
        def close(self, timeout: float) -> None:
            asked.append(timeout)
            raise TimeoutError(f"timed out after {timeout} s.")

    DaskCrew("this machine", lambda: None, Busy()).close()
    assert asked == [5]


@pytest.mark.parametrize("dying", [2, 3])
def test_workers_are_started_again_where_one_dies_while_it_starts(dying: int, monkeypatch: pytest.MonkeyPatch) -> None:
    started = list[int]()

    def cluster(**options: Any) -> Any:
        started.append(options["n_workers"])
        if len(started) <= dying:
            raise RuntimeError("Nanny failed to start.")
        return SimpleNamespace(close=lambda timeout: None)

    monkeypatch.setattr(distributed, "LocalCluster", cluster)
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: SimpleNamespace(close=lambda timeout: None))
    if dying < STARTS:
        local_crew(2, 1).close()
    else:
        with pytest.raises(SimulationError, match=r"a worker process ended while it started, 3 times.*Nanny failed"):
            local_crew(2, 1)
    assert started == [2, 2, 2]


def test_a_worker_serves_blocks_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that has served a run before is admitted by the next, whatever its blocks."""
    monkeypatch.setattr(worker, "_settled", {"threads": 1})  # this process stays what it is
    text = Wobble().specification.text
    digest, (values, seeds) = Specification.read(text).digest, proposed(16)
    for size in (8, 16, 4):
        block = values[:size], seeds[:size]
        answer = admit(text, size, 1, False, [block])
        assert bits(answer["rows"][0]) == bits(Wobble()(*block))
        assert bits(simulate(digest, size, *block)["rows"]) == bits(Wobble()(*block))
    with pytest.raises(NotMade):
        simulate(digest, 5, values[:5], seeds[:5])
