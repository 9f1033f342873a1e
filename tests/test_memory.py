"""Sizes are refused before anything is allocated, with the argument, what they would take and what the machine has."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from yeastfit import memory
from yeastfit.errors import InputError
from yeastfit.inference.abc.mcmc import AbcMcmc
from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.memory import check_count, check_memory, machine_memory
from yeastfit.model.numerics import Numerics, most_nodes
from yeastfit.model.parameters import Parameters
from yeastfit.simulation.simulate import member_keys, sample_times, schedule_of, simulate

SMALL = Numerics(domain=8.0, spacing=0.5, dt=0.1, capacity=8)


def test_a_groups_limit_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "GROUP", tmp_path / "memory.max")
    whole = machine_memory()
    assert whole > 2**28
    for text, expected in (("max\n", whole), (f"{2**27}\n", 2**27), (f"{2**60}\n", whole)):
        (tmp_path / "memory.max").write_text(text)
        assert machine_memory() == expected


def test_what_fits_is_admitted_to_the_last_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "machine_memory", lambda: 3 * 2**30)
    check_memory(3 * 2**30, "this")
    check_count("members", 3, 2.0**30)
    with pytest.raises(InputError, match=r"^this would take 3.5 GiB of memory, this machine has 3 GiB$"):
        check_memory(3.5 * 2**30, "this")
    with pytest.raises(InputError, match=r"^members is 4, which would take 4 GiB of memory, this machine has 3 GiB$"):
        check_count("members", 4, 2.0**30)


TOO_LARGE: dict[str, tuple[Callable[[], object], str]] = {
    "domain": (lambda: Numerics(domain=1e9), "domain / spacing is 1e+09 / 0.1: a grid of 1e+10² points"),
    "domain beyond floats": (lambda: Numerics(domain=1e308, spacing=1e-300), "a grid of inf² points"),
    "spacing": (lambda: Numerics(spacing=1e-7), "domain / spacing is 40 / 1e-07"),
    "capacity": (lambda: Numerics(capacity=10**10), "capacity is 1e+10, which"),
    "capacity beyond floats": (lambda: Numerics(capacity=10**400), "capacity is"),
    "keys": (lambda: member_keys(0, 10**9), "members is 1e+09, which"),
    "times": (lambda: sample_times(1e7, 0.1, Numerics(dt=0.1)), "every is 0.1, which in a time of 1e+07"),
    "starts": (lambda: FitSettings(starts=10**9), "starts is 1e+09"),
    "stages": (lambda: FitSettings(members=(10**9,), spreads=(0.1,)), "members is 1e+09"),
    "walkers": (lambda: AbcMcmc(walkers=10**9), "walkers is 1e+09"),
    "chains": (lambda: AbcMcmc(walkers=10**6, steps=10**6), "steps · walkers is 1000000 · 1000000"),
    "population": (lambda: AbcSmc(population=10**9), "population is 1e+09"),
    "simulations": (lambda: SequentialEmulator(simulations=2**40), "simulations is 1.09951e+12"),
}


@pytest.mark.parametrize("case", TOO_LARGE)
def test_sizes_that_no_memory_holds_are_refused(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "machine_memory", lambda: 2**33)
    make, words = TOO_LARGE[case]
    with pytest.raises(InputError) as caught:
        make()
    assert words in str(caught.value)
    assert str(caught.value).endswith("GiB of memory, this machine has 8 GiB")


def test_an_ensemble_is_refused_before_it_is_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = member_keys(0, 4)
    monkeypatch.setattr(memory, "machine_memory", lambda: int(3 * SMALL.state_size))
    with pytest.raises(InputError, match=r"members is 4, which would take .* GiB of memory"):
        simulate(Parameters(), keys, times=[1.0], numerics=SMALL)


@pytest.mark.parametrize("dt", [1e-300, 1e-10, 1001, 1e300])
def test_time_steps_can_be_counted(dt: float) -> None:
    with pytest.raises(InputError, match=r"dt is .*, it must be a number from 9\.31323e-10 to 1000"):
        Numerics(dt=dt)


@pytest.mark.parametrize("time", [1e9, 1e300])
def test_times_beyond_what_is_counted_are_refused(time: float) -> None:
    with pytest.raises(InputError, match=r"it must be at most 2\.14748e"):
        schedule_of([1.0, time], Numerics(dt=0.02))
    with pytest.raises(InputError, match=r"it must be at most 2\.14748e"):
        sample_times(time, 0.2, Numerics(dt=0.02))


@pytest.mark.parametrize(
    ("time", "every", "words"),
    [
        (np.inf, 1.0, "time is inf"),
        (np.nan, 1.0, "time is nan"),
        (0.0, 1.0, "time is 0"),
        (-1.0, 1.0, "time is -1"),
        (1.0, 0.0, "every is 0"),
        (1.0, np.nan, "every is nan"),
        (1.0, 2.0, "every is 2, it must be above 0 and at most the time, 1"),
        (10.0, 1e-300, "every is 1e-300, it must be at least dt = 0.1"),
    ],
)
def test_times_are_numbers_in_range(time: float, every: float, words: str) -> None:
    with pytest.raises(InputError) as caught:
        sample_times(time, every, SMALL)
    assert words in str(caught.value)


def test_times_are_regular_and_end_with_the_last() -> None:
    np.testing.assert_allclose(sample_times(1.0, 0.3, SMALL), [0.3, 0.6, 0.9, 1.0])
    np.testing.assert_allclose(sample_times(0.9, 0.3, SMALL), [0.3, 0.6, 0.9])


def test_nodes_double_in_a_unit_of_time_at_most() -> None:
    assert [most_nodes(time) for time in (0.5, 1.0, 2.9, 6.0)] == [2, 4, 8, 128]
    assert most_nodes(1e300) == most_nodes(60.0) == 2**61
    assert most_nodes(6.0, 1.5) == 2**10
    assert most_nodes(1.0, float("inf")) == 2**61
