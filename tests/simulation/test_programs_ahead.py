"""Programs that are compiled beside a colony's steps: in order, once, waited for, and no other colony."""

import threading
from collections.abc import Iterable

import numpy as np
import pytest

from yeastfit import Numerics, Parameters, simulate
from yeastfit.simulation.programs_ahead import ProgramsAhead, programs_ahead
from yeastfit.simulation.simulate import member_keys


def test_programs_are_compiled_in_order_once_and_waited_for() -> None:
    compiled, may = list[tuple[int, str]](), threading.Event()

    def compile_for(room: int) -> None:
        may.wait(10.0)
        compiled.append((room, threading.current_thread().name))

    with programs_ahead(compile_for) as ahead:
        ahead.ask([8, 32])
        ahead.ask([32, 8])
        ahead.await_for(512)  # not asked for
        assert compiled == []
        may.set()
        ahead.await_for(32)
        rooms, threads = zip(*compiled, strict=True)
        assert rooms == (8, 32)
        assert threading.current_thread().name not in threads


def test_at_the_end_no_other_begins() -> None:
    begun, compiled, may = threading.Event(), list[int](), threading.Event()

    def compile_for(room: int) -> None:
        begun.set()
        may.wait(10.0)
        compiled.append(room)

    with programs_ahead(compile_for) as ahead:
        ahead.ask([8, 32])
        begun.wait(10.0)
    assert compiled == []  # and the end has not waited for it
    may.set()
    ahead.await_for(8)
    assert compiled == [8]


def test_what_goes_wrong_is_left_to_who_runs_it() -> None:
    def fails(room: int) -> None:
        raise ValueError

    with programs_ahead(fails) as ahead:
        ahead.ask([8])
        ahead.await_for(8)


@pytest.mark.thorough
def test_colonies_in_wide_dishes_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """As that of one program, to rounding, and they ask for the next two sizes."""
    numerics = Numerics(domain=102.0, spacing=0.4, dt=0.025)
    how = {"parameters": Parameters(), "keys": member_keys(0, 1)[0], "times": [3.2], "numerics": numerics}
    asked, ask = list[int](), ProgramsAhead.ask

    def noticed(self: ProgramsAhead, rooms: Iterable[int]) -> None:
        asked.extend(rooms := list(rooms))
        ask(self, rooms)

    plain = simulate(**how)  # type: ignore[arg-type]
    monkeypatch.setattr(ProgramsAhead, "ask", noticed)
    monkeypatch.setattr("yeastfit.simulation.simulate.SHORT", 2)
    grown = simulate(**how)  # type: ignore[arg-type]
    assert set(asked) >= {8, 32}
    count = int(plain.colony.count)
    assert 2 < count <= 32
    assert grown.colony.positions.shape[0] < plain.colony.positions.shape[0]
    assert int(grown.colony.count) == count
    np.testing.assert_array_equal(grown.colony.parents[:count], plain.colony.parents[:count])
    np.testing.assert_allclose(grown.colony.positions[:count], plain.colony.positions[:count], atol=2e-5)
