"""Colonies without a capacity: the same as in arrays that are long enough, none cut, and grown until something."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from helpers import wrong_types

from yeastfit import InputError, Numerics, Parameters, Simulation, member_keys, simulate
from yeastfit.simulation.until import Until

OPEN = Numerics(domain=10.0, spacing=0.4, dt=0.05)
ROOMY = replace(OPEN, capacity=24)
TIMES = (2.5, 3.2)


@pytest.fixture(scope="module", autouse=True)
def small_is_large() -> Iterator[None]:
    """Colonies of any time grow in segments, with room for six nodes at first."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yeastfit.simulation.simulate.SHORT", 1)
        patch.setattr("yeastfit.simulation.simulate.FIRST_ROOM", 6)
        yield


@pytest.fixture(scope="module")
def segmented() -> Simulation:
    return simulate(Parameters(), member_keys(3, 1), times=TIMES, numerics=OPEN)


@pytest.fixture(scope="module")
def fixed() -> Simulation:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yeastfit.simulation.simulate.SHORT", 4096)
        return simulate(Parameters(), member_keys(3, 1), times=TIMES, numerics=ROOMY)


def assert_same_colonies(ours: Simulation, theirs: Simulation, tolerance: float = 2e-5) -> None:
    """The same tree and births, and places to rounding: arrays of another length are summed in another order."""
    np.testing.assert_array_equal(ours.colony.count, theirs.colony.count)
    for member, count in enumerate(np.asarray(ours.colony.count)):
        for name in ("parents", "lineages"):
            mine, other = (getattr(one.colony, name)[member, :count] for one in (ours, theirs))
            np.testing.assert_array_equal(mine, other)
        mine, other = (one.colony.positions[member, :count] for one in (ours, theirs))
        np.testing.assert_allclose(mine, other, atol=tolerance)
    for name, values in theirs.statistics.items():
        np.testing.assert_allclose(ours.statistics[name], values, rtol=2e-3, err_msg=name)


def test_room_follows_the_nodes_and_the_colony_is_the_same(segmented: Simulation, fixed: Simulation) -> None:
    assert_same_colonies(segmented, fixed)
    most = int(np.max(segmented.colony.count))
    assert most > 12  # the room of six was doubled at least twice
    assert most <= segmented.colony.positions.shape[1] < 2 * most
    assert not segmented.problems


@pytest.mark.thorough
def test_a_member_does_not_depend_on_the_others(segmented: Simulation) -> None:
    both = simulate(Parameters(), member_keys(3, 2), times=TIMES, numerics=OPEN)
    count = int(segmented.colony.count[0])
    np.testing.assert_array_equal(both.colony.positions[0, :count], segmented.colony.positions[0, :count])
    np.testing.assert_array_equal(both.statistics["area"][0], segmented.statistics["area"][0])
    other = simulate(Parameters(), member_keys(3, 2)[1], times=TIMES, numerics=OPEN)  # without an axis of members
    np.testing.assert_array_equal(both.statistics["area"][1], other.statistics["area"])


def test_a_colony_resumed_between_events_is_the_same(segmented: Simulation) -> None:
    half = simulate(Parameters(), member_keys(3, 1), times=TIMES[:1], numerics=OPEN)
    whole = simulate(Parameters(), times=TIMES[1:], start=half.colony, numerics=OPEN)
    np.testing.assert_array_equal(whole.colony.count, segmented.colony.count)
    np.testing.assert_array_equal(whole.statistics["area"][:, 0], segmented.statistics["area"][:, 1])


@pytest.mark.thorough
def test_a_limit_cuts_births_and_says_so() -> None:
    cut = simulate(Parameters(), member_keys(3, 1), times=TIMES, numerics=replace(OPEN, capacity=11))
    assert cut.colony.positions.shape[1] == 11
    np.testing.assert_array_equal(cut.colony.count, 11)
    assert cut.problems == {"capacity_reached": 1}
    # more room later does not hide that births were cut before
    on = simulate(Parameters(), start=cut.colony, times=[4.1], numerics=OPEN)
    assert (np.asarray(on.colony.count) > 11).all()
    assert on.problems == {"capacity_reached": 1}


@pytest.mark.parametrize("capacity", [None, 5000])
def test_a_short_colony_that_outgrows_its_first_arrays_is_grown_again(fixed: Simulation, capacity: int | None) -> None:
    """Those are no longer because more nodes are allowed than one program has room for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yeastfit.simulation.simulate.SHORT", 4096)
        patch.setattr("yeastfit.model.numerics.FIRST_ROOM", 6)
        outgrown = simulate(Parameters(), member_keys(3, 1), times=TIMES, numerics=replace(OPEN, capacity=capacity))
    assert_same_colonies(outgrown, fixed)
    assert outgrown.colony.positions.shape[1] < 100
    assert not outgrown.problems


@pytest.mark.parametrize(
    "until", [{"area": 4.0}, *(pytest.param(one, marks=pytest.mark.thorough) for one in ({"nodes": 9}, {"cells": 8.0}))]
)
def test_growth_ends_at_the_first_step_that_is_large_enough(until: dict[str, float]) -> None:
    found = simulate(Parameters(), member_keys(3, 1), times=[3.2], until=until, numerics=OPEN)
    assert found.reached is not None
    np.testing.assert_allclose(found.clock, found.scales.hours(found.ends), rtol=1e-6)
    ((name, value),) = until.items()
    for member, time in enumerate(found.reached):
        assert time == pytest.approx(float(found.colony.step[member]) * OPEN.dt)
        just, before = (
            simulate(Parameters(), member_keys(3, 1)[member], times=[time - back], numerics=OPEN)
            for back in (0.0, OPEN.dt)
        )
        for one, reached in ((just, True), (before, False)):
            size = one.statistics["area"][0] if name == "area" else int(one.colony.count) - (name == "cells")
            assert bool(size >= value) is reached
        np.testing.assert_array_equal(just.colony.count, found.colony.count[member])
        np.testing.assert_allclose(found.statistics["area"][member, 0], just.statistics["area"][0], rtol=1e-6)
    assert not found.warnings()
    assert [row["time"] for row in found.rows()] == pytest.approx(found.reached.tolist())


def test_of_several_ends_the_first_counts() -> None:
    """Whichever is reached; a warning names all of them."""
    how: dict[str, Any] = {"times": [3.2], "numerics": OPEN}
    keys = member_keys(3, 1)
    nodes = simulate(Parameters(), keys, until={"nodes": 9}, **how)
    for other in ({"area": 1e4}, {"cells": 1e4}):
        both = simulate(Parameters(), keys, until={**other, "nodes": 9}, **how)
        np.testing.assert_array_equal(both.ends, nodes.ends)
        np.testing.assert_array_equal(both.reached, nodes.reached)
    neither = simulate(Parameters(), keys, until={"area": 1e4, "nodes": 1000}, **how)
    assert neither.warnings() == [
        "1 of 1 colonies: area was below 10000 and nodes was below 1000 at t = 3.2: end later"
    ]


def test_a_colony_that_stays_too_small_is_said_and_saved(tmp_path: Path) -> None:
    small = simulate(Parameters(), member_keys(3, 1), times=[3.0], until={"area": 1e4}, numerics=OPEN)
    assert small.reached is not None
    assert np.isnan(small.reached).all()
    assert small.warnings() == ["1 of 1 colonies: area was below 10000 at t = 3: end later"]
    small.save(tmp_path / "small.npz")
    again = Simulation.load(tmp_path / "small.npz")
    assert again.until == {"area": 1e4}
    assert again.warnings() == small.warnings()


@pytest.mark.parametrize(
    ("until", "times", "message"),
    [
        ({"area": -1.0}, [2.0], "area is -1.0, it must be a number above 0"),
        ({"breadth": 3.0}, [2.0], "until is of 'breadth', expected one of nodes, cells, "),
        ({}, [2.0], "it must be a name and its value"),
        ({"area": 3.0}, [1.0, 2.0], "give one time"),
        ({"cells": 10**400}, [2.0], r"until: cells is 10+ \.\.\. 0+, it must be a number above 0"),
        ({"cells": True}, [2.0], "until: cells is true, it must be a number above 0"),
    ],
    ids=lambda one: str(one)[:40],
)
def test_what_cannot_be_grown_until_is_named(until: dict[str, float], times: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(Parameters(), member_keys(3, 1), times=times, until=until, numerics=OPEN)


@pytest.mark.parametrize("value", [np.int64(50), np.float32(50), np.float64(50)])
def test_numbers_of_numpy_are_numbers_to_grow_until(value: Any) -> None:
    with wrong_types():
        assert Until.of({"cells": value}, None).values == {"cells": 50.0}


def test_derivatives_need_a_time() -> None:
    def area(mobility: jax.Array) -> jax.Array:
        found = simulate(Parameters(mobility=mobility), member_keys(0, 1), times=[1.0], until={"area": 2.0})
        return found.statistics["area"][0, 0]

    with pytest.raises(InputError, match="trace only with times"):
        jax.grad(area)(1.0)
