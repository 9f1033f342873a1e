"""What `grow` and `grow_many` promise: one seed, one colony; every way to fail told in words."""

import subprocess
import sys

import numpy as np
import pytest

from reference import offlattice as reference
from yeastfit.errors import InputError
from yeastfit.offlattice import colony as module
from yeastfit.offlattice.cell_sets import CHILDLESS, add, eligible, empty_sets, member, remove
from yeastfit.offlattice.colony import OfflatticeColony, grow, grow_many
from yeastfit.offlattice.mothers import NO_CHILDLESS, NO_MOTHER, NO_SATED, after_transition, any_eligible
from yeastfit.offlattice.overlap import CELL, empty_cells
from yeastfit.offlattice.parameters import PARAMETERS, Rates
from yeastfit.offlattice.random_numbers import foreseen, place, return_to, seeded, uniform
from yeastfit.offlattice.status import Status

AWRI_50 = (0.6332, 0.6145, 0.2521, 0.1321, 0.1174)


def same(one: OfflatticeColony, other: OfflatticeColony) -> bool:
    arrays = ("x", "y", "direction", "pseudohyphal", "mother", "can_bud")
    return one.attempts == other.attempts and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays
    )


def test_one_seed_one_colony_in_any_batch_on_any_number_of_threads() -> None:
    values = np.random.default_rng(0).uniform(0.2, 0.9, (7, 5))
    seeds = np.arange(7, dtype=np.uint64) + np.uint64(2**64 - 7)
    alone = [grow(row, cells=800, seed=int(seed)) for row, seed in zip(values, seeds, strict=True)]
    for threads in (1, 2, 5, None):
        many = grow_many(values, seeds, cells=800, threads=threads)
        assert all(same(one, other) for one, other in zip(alone, many, strict=True))
    back = grow_many(values[::-1], seeds[::-1], cells=800, threads=2)[::-1]
    assert all(same(one, other) for one, other in zip(alone, back, strict=True))
    assert not same(alone[0], grow(values[0], cells=800, seed=1))


def test_a_seed_means_the_same_colony_for_ever() -> None:
    """Pinned: posteriors that were stored with their seeds must be found again."""
    colony = grow(AWRI_50, cells=2000, seed=11)
    assert (colony.attempts, colony.numbers_drawn, int(colony.pseudohyphal.sum())) == (5667, 16624, 264)
    assert colony.x.sum() == pytest.approx(-11951.919536972819, abs=1e-8)


def test_values_by_name_are_those_in_order() -> None:
    assert PARAMETERS.names == Rates._fields
    named = dict(zip(PARAMETERS.names, AWRI_50, strict=True))
    assert same(grow(named, cells=300, seed=5), grow(AWRI_50, cells=300, seed=5))
    defaults = grow({"fork": 0.9}, cells=300)
    assert defaults.rates == Rates(**(PARAMETERS.defaults | {"fork": 0.9}))


def test_no_cell_holds_the_centre_of_a_later_one() -> None:
    colony = grow(AWRI_50, cells=600, seed=2)
    assert colony.mother[0] == -1
    assert (colony.mother[1:] < np.arange(1, 600)).all()
    assert not colony.pseudohyphal[: colony.sated].any()
    np.testing.assert_array_equal(colony.theta, colony.direction * np.pi / 16)
    for k in range(1, 600):
        earlier = (array[:k] for array in (colony.x, colony.y, colony.theta, colony.pseudohyphal))
        assert not reference.covered(colony.x[k], colony.y[k], *earlier)
    with pytest.raises(ValueError, match="read-only"):
        colony.x[0] = 1.0


@pytest.mark.parametrize(
    ("values", "cells", "status", "words"),
    [
        ((0.5, 0.5, 0.5, 0.5, 1.1), 50, Status.OUTSIDE, "outside [0, 1]"),
        ((-0.1, 0.5, 0.5, 0.5, 0.5), 50, Status.OUTSIDE, "outside [0, 1]"),
        ((np.nan, 0.5, 0.5, 0.5, 0.5), 50, Status.OUTSIDE, "outside [0, 1]"),
        ((0.5, 0.5, 0.5, 0.5, 0.5), 10**12, Status.TOO_LARGE, "memory"),
    ],
)
def test_what_cannot_be_simulated_is_told_in_the_result(
    values: tuple[float, ...], cells: int, status: Status, words: str
) -> None:
    colony = grow(values, cells=cells)
    assert (colony.status, colony.x.size, colony.cells, colony.attempts) == (status, 0, cells, 0)
    assert pytest.approx(colony.rates, nan_ok=True) == values
    assert words in colony.message


def test_memory_is_estimated_before_it_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LITTLE", 0)
    monkeypatch.setattr(module, "_free_memory", lambda: 1000 * module.BYTES_PER_CELL)
    assert grow(AWRI_50, cells=1001).status is Status.TOO_LARGE
    assert grow(AWRI_50, cells=1000).status is Status.GROWN


def test_one_cell() -> None:
    colony = grow(AWRI_50, cells=1)
    assert (colony.status, colony.x.tolist(), colony.mother.tolist()) == (Status.SINGLE, [0.0], [-1])
    assert "first cell" in colony.message


def test_no_pseudohyphal_mother() -> None:
    colony = grow((0.5, 0.5, 0.0, 0.5, 0.0), cells=40, seed=1)
    assert colony.status is Status.NO_PSEUDOHYPHAL_MOTHER
    assert colony.x.size == 20
    assert colony.message == "after 20 of 40 cells, no pseudohyphal cell could bud any more"


def test_an_endless_search_ends() -> None:
    """The first cell alone may bud, only pseudohyphal daughters, for which it has two places."""
    colony = grow((0.0, 1.0, 1.0, 0.0, 1.0), cells=20, seed=0, delay=1.0, most_attempts=1000)
    assert colony.status is Status.ENDLESS
    assert (colony.x.size, colony.message[:19]) == (3, "after 3 of 20 cells")
    assert colony.attempts >= 1000


def test_a_stream_that_ends() -> None:
    stream = np.random.default_rng(0).random(500)
    colony = grow(AWRI_50, cells=1000, stream=stream)
    assert colony.status is Status.STREAM_ENDED
    whole = grow(AWRI_50, cells=1000, stream=np.random.default_rng(0).random(20_000))
    np.testing.assert_array_equal(whole.x[: colony.x.size], colony.x)


def test_choices_among_no_cells() -> None:
    rates, numbers = Rates(0.5, 0.0, 0.5, 0.0, 0.5), seeded(0)
    sets, cells = empty_sets(4, by_birth=False), np.zeros(4, CELL)
    assert any_eligible(sets, numbers) == NO_MOTHER
    assert after_transition(cells, sets, numbers, 0, (0.5, 0.5, 0.1), True, rates) == NO_SATED
    cells["bears"] = 1
    assert after_transition(cells, sets, numbers, 0, (0.5, 0.5, 0.1), False, rates) == NO_CHILDLESS


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"parameters": {"forks": 0.5}}, "unknown parameter 'forks'"),
        ({"parameters": (0.5, 0.5)}, "got 2 values, need five"),
        ({"cells": 0}, "cells is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 2**64}, "below 2"),
        ({"delay": -0.1}, "delay is -0.1"),
        ({"stream": np.empty(0)}, "stream is empty"),
        ({"stream": np.full(99, np.nan)}, "stream holds nan, it must be a sequence of numbers of at least 0 and below"),
        ({"stream": np.array([0.5, 1.0])}, "stream holds 1, it must be"),
        ({"stream": np.full((2, 2), 0.5)}, r"stream has the shape \(2, 2\)"),
        ({"seed": 1.9}, "seed is 1.9, it must be a whole number"),
        ({"cells": 10.0}, "cells is 10.0, it must be a whole number of at least 1"),
        ({"parameters": {"fork": "a"}}, "fork is 'a', it must be a number"),
    ],
)
def test_wrong_calls(arguments: dict, words: str, unchecked: None) -> None:
    with pytest.raises(InputError, match=words):
        grow(**({"parameters": AWRI_50, "cells": 10} | arguments))


def test_no_threads(unchecked: None) -> None:
    for threads in (0, -1, 1.5):
        with pytest.raises(InputError, match=r"threads is .*, it must be a whole number of at least 1, or None"):
            grow_many(np.full((1, 5), 0.5), [1], cells=10, threads=threads)  # type: ignore[arg-type]


def test_as_many_seeds_as_rows() -> None:
    with pytest.raises(InputError, match="2 rows of values and 1 seeds"):
        grow_many(np.full((2, 5), 0.5), [1], cells=10)


def test_without_numba_a_call_says_what_to_install() -> None:
    program = (
        "import sys; sys.modules['numba'] = None\n"
        "from yeastfit.errors import InputError\n"
        "from yeastfit.offlattice.colony import grow\n"
        "try: grow({}, cells=10)\n"
        "except InputError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "pip install 'yeastfit[offlattice]'" in run.stdout


def test_numbers_are_those_of_xoshiro256pp() -> None:
    """Against the published C code in whole numbers of Python."""
    numbers, most = seeded(12345), 2**64 - 1
    s = [int(word) for word in numbers.state]

    def turned(word: int, bits: int) -> int:
        return (word << bits | word >> (64 - bits)) & most

    for _ in range(200):
        word = (turned((s[0] + s[3]) & most, 23) + s[0]) & most
        t = s[1] << 17 & most
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = turned(s[3], 45)
        assert uniform(numbers) == (word >> 11) / 2**53
    assert numbers.drawn[0] == 200


def test_foreseen_numbers_are_those_that_come() -> None:
    numbers = seeded(3)
    for skipped in (0, 1, 4):
        two = foreseen(numbers, skipped)
        drawn = [uniform(numbers) for _ in range(skipped + 2)]
        assert two == tuple(drawn[skipped:])


def test_drawing_returns_to_a_place() -> None:
    numbers = seeded(4)
    uniform(numbers)
    here = place(numbers)
    three = [uniform(numbers) for _ in range(3)]
    return_to(here, numbers)
    assert numbers.drawn[0] == 1
    assert [uniform(numbers) for _ in range(3)] == three


def test_no_cell_lies_across_two_lines_of_the_cache() -> None:
    for count in (0, 1, 5, 1_000_000):
        cells = empty_cells(count)
        assert (cells.size, cells.dtype) == (count, CELL)
        assert count == 0 or cells.ctypes.data % CELL.itemsize == 0
    assert 64 % CELL.itemsize == 0


@pytest.mark.parametrize("by_birth", [False, True])
def test_sets_hold_what_was_added(by_birth: bool) -> None:
    draw, held = np.random.default_rng(3), [set[int](), set[int](), set[int]()]
    sets = empty_sets(50, by_birth)
    for _ in range(2000):
        which, cell = int(draw.integers(3)), int(draw.integers(50))
        if cell in held[which]:
            held[which].remove(cell)
            remove(sets, which, cell)
        elif which == CHILDLESS or cell not in held[1 - which]:
            held[which].add(cell)
            add(sets, which, cell)
        found = [[member(sets, k, rank) for rank in range(sets.size[k])] for k in range(3)]
        found.append([eligible(sets, rank) for rank in range(sets.size[0] + sets.size[1])])
        expected = [sorted(one) for one in (*held, held[0] | held[1])]
        assert [sorted(one) for one in found] == expected
        assert not by_birth or found == expected


def test_the_generators_colonies_are_those_of_the_stream_in_distribution() -> None:
    """Order of the sets and source of the numbers apart, both are one program: attempts and forms agree."""
    draw = np.random.default_rng(7)
    ours = np.array([counts(grow(AWRI_50, cells=400, seed=k)) for k in range(150)])
    theirs = np.array([counts(grow(AWRI_50, cells=400, stream=draw.random(8000))) for _ in range(150)])
    error = np.sqrt((ours.var(axis=0) + theirs.var(axis=0)) / 150)
    assert (np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) < 3.5 * error).all()


def counts(colony: OfflatticeColony) -> tuple[float, ...]:
    grown = colony.status is Status.GROWN
    return (colony.attempts, colony.pseudohyphal.sum(), colony.can_bud.sum(), np.hypot(colony.x, colony.y).max(), grown)
