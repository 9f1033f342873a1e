"""Growth to the last cell: against the authors' table, an independent reading of the rules, and itself."""

import numpy as np
import pytest

from reference import offlattice as reference
from yeastfit.offlattice.colony import OfflatticeColony, grow
from yeastfit.offlattice.status import Status

# Colonies of the follow-up's table ss_AWRI796_500um_04June2025.csv (Li et al. 2025), grown from one stream of MATLAB's
# rng(18): where a colony's five parameters stand in it, attempts, t, pseudohyphal cells, cells that can bud at the end.
TABLE = {
    0: (0, 452_566, 65_037, 23_354, 34_208),
    1: (1_575_089, 374_288, 63_364, 11_421, 32_782),
    2: (2_798_772, 471_067, 47_071, 25_811, 47_075),
    3: (4_829_874, 445_700, 67_791, 24_538, 32_867),
    5: (11_280_982, 376_589, 89_370, 2_913, 11_326),
    7: (18_687_410, 586_531, 39_123, 9_315, 55_574),
    8: (21_223_125, 799_162, 11_314, 69_834, 85_200),
    10: (28_423_847, 440_743, 52_655, 31_385, 43_464),
}
MOST_NUMBERS = 8_000_000  # of one colony


def table_colonies(last: int) -> dict[int, tuple[int, OfflatticeColony]]:
    """Rows 0 to `last` of the table, one after the other: where each began in the stream, and the colony."""
    source = np.random.RandomState(18)
    stream, start, found = np.empty(0), 0, {}
    for row in range(last + 1):
        stream = np.concatenate([stream, source.random_sample(MOST_NUMBERS - stream.size)])
        colony = grow(stream[:5], cells=100_000, stream=stream[5:])
        found[row] = start, colony
        start += 5 + colony.numbers_drawn
        stream = stream[5 + colony.numbers_drawn :]
    return found


def check_row(row: int, start: int, colony: OfflatticeColony) -> None:
    counts = colony.attempts, colony.sated, int(colony.pseudohyphal.sum()), int(colony.can_bud.sum())
    assert (start, *counts) == TABLE[row]
    assert colony.status is Status.GROWN
    assert colony.x.size == 100_000


def test_two_published_colonies_to_the_last_cell() -> None:
    colonies = table_colonies(1)
    for row, (start, colony) in colonies.items():
        check_row(row, start, colony)
    _, first = colonies[0]
    np.testing.assert_allclose(first.x[1:4], [-1.008746777, -5.686330743, -4.677583966], atol=1e-9)
    np.testing.assert_allclose(first.y[1:4], [-4.568571044, -4.666651038, -0.098079995], atol=1e-9)
    assert first.direction[1:4].tolist() == [23, 16, 39]
    assert not first.pseudohyphal[:4].any()
    assert (first.x[-1], first.y[-1]) == pytest.approx((-259.251262532, -608.755018092), abs=1e-8)
    assert (first.direction[-1], first.pseudohyphal[-1]) == (1114, True)
    assert (first.x.sum(), first.y.sum()) == pytest.approx((-1783905.115661, -581446.327511), abs=1e-5)


@pytest.mark.slow
def test_all_published_colonies_to_the_last_cell() -> None:
    """Rows that are not in `TABLE` are grown too: a number too many or too few would shift all that follow."""
    colonies = table_colonies(10)
    for row in TABLE:
        check_row(row, *colonies[row])


def test_a_small_colony_in_full() -> None:
    stream = np.random.RandomState(1).random_sample(51_034)
    colony = grow((0.5, 0.5, 0.3, 0.3, 0.3), cells=5000, stream=stream)
    assert (colony.numbers_drawn, colony.attempts, colony.sated_attempts) == (51_034, 14_663, 9_014)
    assert (colony.sated, colony.pseudohyphal.sum(), colony.can_bud.sum()) == (2500, 1189, 2647)
    np.testing.assert_allclose(colony.x[1:4], [-1.008746777, 1.008746777, 1.008746777], atol=1e-9)
    np.testing.assert_allclose(colony.y[1:4], [-4.568571044, -4.568571044, 4.568571044], atol=1e-9)
    assert colony.direction[1:4].tolist() == [23, -7, 7]
    assert (colony.x[-1], colony.y[-1]) == pytest.approx((126.921745117, 155.638330771), abs=1e-9)
    assert (colony.direction[-1], colony.pseudohyphal[-1]) == (286, False)
    assert (colony.x.sum(), colony.y.sum()) == pytest.approx((-2296.991429374, 47083.007370427), abs=1e-8)


def check_against_reference(values: tuple[float, ...], cells: int, seed: int, delay: float = 0.02) -> bool:
    """Equal cell for cell, or nothing in both."""
    stream = np.random.RandomState(seed).random_sample(200 * cells)
    numbers = iter(stream)
    colony = grow(values, cells=cells, stream=stream, delay=delay)
    try:
        expected = reference.grow(values, cells, lambda: float(next(numbers)), delay)  # type: ignore[arg-type]
    except reference.CameToNothing:
        assert "could bud any more" in colony.message
        return False
    assert colony.status is Status.GROWN
    assert colony.attempts == expected.attempts
    assert colony.numbers_drawn == stream.size - len(list(numbers))
    np.testing.assert_array_equal(colony.mother, expected.mother)
    np.testing.assert_array_equal(colony.pseudohyphal, expected.pseudo)
    np.testing.assert_array_equal(colony.can_bud, expected.tries < 4)
    np.testing.assert_allclose(colony.theta, expected.theta, atol=1e-10)
    np.testing.assert_allclose(colony.x, expected.x, atol=1e-10)
    np.testing.assert_allclose(colony.y, expected.y, atol=1e-10)
    return True


def test_equal_to_a_plain_reading_of_the_rules() -> None:
    """Random parameters, sizes and delays; some colonies come to nothing in both."""
    draw = np.random.default_rng(0)
    grown = [
        check_against_reference(tuple(draw.random(5)), int(draw.integers(200, 500)), k, (0.02, 0.01)[k % 2])
        for k in range(10)
    ]
    assert sum(grown) >= 7


@pytest.mark.parametrize(
    "values",
    [
        (0.0, 0.5, 0.5, 0.5, 0.5),
        (1.0, 0.5, 0.5, 0.5, 0.5),
        (0.5, 0.0, 1.0, 0.0, 0.0),
        (0.5, 1.0, 0.0, 1.0, 1.0),
        (0.3, 0.0, 0.0, 1.0, 0.0),
        (0.3, 0.3, 0.0, 0.0, 0.0),
    ],
)
def test_equal_to_a_plain_reading_at_the_ends_of_the_ranges(values: tuple[float, ...]) -> None:
    check_against_reference(values, 300, 3)


@pytest.mark.parametrize("cells", [2, 3, 4, 5, 8])
def test_equal_to_a_plain_reading_for_a_few_cells(cells: int) -> None:
    for seed in range(40):
        check_against_reference((0.5, 0.5, 0.5, 0.5, 0.5), cells, seed)


@pytest.mark.slow
def test_equal_to_a_plain_reading_for_many_random_parameters() -> None:
    draw = np.random.default_rng(0)
    grown = [check_against_reference(tuple(draw.random(5)), int(draw.integers(2, 1500)), k) for k in range(60)]
    assert np.mean(grown) > 0.8
