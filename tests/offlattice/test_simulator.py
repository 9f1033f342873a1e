"""The off-lattice model as a simulator: it is one, and its rows are what growing and measuring by hand give."""

from functools import partial

import numpy as np
import pytest

from yeastfit.errors import InputError
from yeastfit.inference.simulator import Replicates, Simulator, labels_of, problems_of
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.registry import STATISTICS, register_statistic
from yeastfit.offlattice.colony import grow
from yeastfit.offlattice.masks import ellipse_mask
from yeastfit.offlattice.masks.area_matching import match_exactly, search_from_below
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.offlattice.simulator import OfflatticeSimulator, offlattice_simulator_of
from yeastfit.offlattice.statistics.li2024_statistics import ENTRIES, li2024_statistics

PUBLISHED = ("li2024_filament_area_index", "li2024_filament_radius_index", "li2024_branch_index")
VALUES = np.array([[0.6, 0.5, 0.3, 0.2, 0.1], [0.4, 0.6, 0.4, 0.1, 0.3], [0.6, 0.5, 0.3, 0.2, 0.1]])
SEEDS = np.array([3, 2**64 - 1, 3], dtype=np.uint64)


def test_it_is_a_simulator() -> None:
    simulator = OfflatticeSimulator.of(PUBLISHED, cells=1000)
    assert isinstance(simulator, Simulator)
    assert labels_of(simulator) == PUBLISHED
    assert simulator.parameters == PARAMETERS
    assert Replicates(simulator, 2)(VALUES, np.arange(3, dtype=np.uint64)).shape == (3, 3)


def test_rows_are_theirs_by_hand() -> None:
    simulator = OfflatticeSimulator.of((*PUBLISHED, "li2024_csr_radius"), cells=2000, area=25_000.0, threads=2)
    found = simulator(VALUES, SEEDS)
    for row, values, seed in zip(found, VALUES, SEEDS, strict=True):
        colony = grow(values, cells=2000, seed=int(seed))
        matched = search_from_below(BinnedOutlines.of(colony).mask, 2000, 25_000.0)
        expected = li2024_statistics(matched.mask)
        indices = [expected.filament_area_index, expected.filament_radius_index, expected.branch_index]
        assert row[:3].tolist() == pytest.approx(indices, rel=1e-12)
        assert row[3] == pytest.approx(expected.csr_radius / 0.646)
    alone = OfflatticeSimulator.of((*PUBLISHED, "li2024_csr_radius"), cells=2000, area=25_000.0, threads=1)
    np.testing.assert_array_equal(alone(VALUES[1:2], SEEDS[1:2])[0], found[1])
    assert not problems_of(simulator)


def test_each_colony_has_one_of_several_areas_by_its_seed() -> None:
    areas, values, seeds = (15_000.0, 25_000.0), np.tile(VALUES[0], (40, 1)), np.arange(40)
    simulator = OfflatticeSimulator.of(["area"], cells=2000, area=areas, match=match_exactly)
    drawn = np.array([simulator.area_of(seed) for seed in range(40)])
    assert set(drawn) == set(areas)
    assert 10 < (drawn == 15_000.0).sum() < 30  # 4 errors are 12.6
    found = simulator(values, seeds)
    np.testing.assert_array_equal(found[::-1], simulator(values, seeds[::-1]))
    np.testing.assert_allclose(found[:, 0] * 0.646**2, drawn, rtol=0.005)
    for area in areas:
        alone = OfflatticeSimulator.of(["area"], cells=2000, area=area, match=match_exactly)
        np.testing.assert_array_equal(found[drawn == area], alone(values, seeds)[drawn == area])
    assert simulator.about != alone.about
    again = offlattice_simulator_of(**simulator.specification.arguments)
    np.testing.assert_array_equal(again(values[:3], seeds[:3]), found[:3])


@pytest.mark.parametrize(("exponent", "fewer"), [(1.0, 1200), (0.5, 1549)])
def test_a_colony_of_less_area_may_have_fewer_cells(exponent: float, fewer: int) -> None:
    """It is the colony of N (area / largest)^s; the largest is that of all N; nothing else changes."""
    areas, values, seeds = (15_000.0, 25_000.0), np.tile(VALUES[0], (12, 1)), np.arange(12)
    of = partial(OfflatticeSimulator.of, ("area", "compactness"), match=match_exactly)
    simulator = of(cells=2000, area=areas, fixed={"nutrient_exponent": exponent})
    drawn = np.array([simulator.area_of(seed) for seed in range(12)])
    cells_of = [simulator.cells_of(VALUES[0].tolist(), seed) for seed in range(12)]
    assert cells_of == np.where(drawn == areas[0], fewer, 2000).tolist()
    assert {simulator.colony(VALUES[0].tolist(), seed).x.size for seed in range(12)} == {fewer, 2000}
    found = simulator(values, seeds)
    free = of(cells=2000, area=areas, free=(*PARAMETERS.names, "nutrient_exponent"))
    np.testing.assert_array_equal(free(np.column_stack([values, np.full(12, exponent)]), seeds), found)
    for area, cells in zip(areas, (fewer, 2000), strict=True):
        alone = of(cells=cells, area=area)
        np.testing.assert_array_equal(found[drawn == area], alone(values, seeds)[drawn == area])
    alike = of(cells=2000, area=areas)
    assert (found[:, 1] != alike(values, seeds)[:, 1]).tolist() == (drawn == areas[0]).tolist()
    assert f", nutrient_exponent {exponent}, " in simulator.about
    assert "nutrient" not in alike.about
    again = offlattice_simulator_of(**simulator.specification.arguments)
    np.testing.assert_array_equal(again(values[:3], seeds[:3]), found[:3])
    np.testing.assert_array_equal(simulator.covered(values, seeds), alike.covered(values, seeds))


def test_rows_are_ours_by_hand() -> None:
    names = ("compactness", "branch_length", "area")
    simulator = OfflatticeSimulator.of(names, cells=2000, area=20_000.0, draw=Ellipses.of, match=match_exactly)
    ellipses = Ellipses.of(grow(VALUES[1], cells=2000, seed=2**64 - 1))
    mask = match_exactly(ellipses.mask, 2000, 20_000.0).mask
    expected = measure_mask(mask, 1.55008, names)
    assert simulator(VALUES, SEEDS)[1] == pytest.approx([expected[name] for name in names])


def test_some_parameters_are_held() -> None:
    simulator = OfflatticeSimulator.of(["area"], cells=500, free=("fork", "transition"), fixed={"any_mother": 0.9})
    assert simulator.parameters.names == ("transition", "fork")
    assert simulator.fixed == {name: value for name, value in PARAMETERS.defaults.items() if name[0] in "sp"} | {
        "any_mother": 0.9
    }
    colony = simulator.colony((0.3, 0.8), 7)
    assert (colony.rates.transition, colony.rates.fork, colony.rates.any_mother) == (0.3, 0.8, 0.9)


def test_what_came_to_nothing_is_nan_and_told() -> None:
    simulator = OfflatticeSimulator.of(["area"], cells=200, area=1e9)
    values = np.array([[1.0, 0.5, 0.5, 0.5, 0.5], [1.5, 0.5, 0.5, 0.5, 0.5], [0.5, 0.5, 0.0, 0.5, 0.0]])
    found = simulator(np.concatenate([values, values]), np.zeros(6, dtype=np.uint64))
    assert np.isnan(found[:, 0]).tolist() == [False, True, True, False, True, True]
    assert simulator.problems == {
        "all cells together cover no more than the area: all are kept": 1,
        "not simulated: a parameter lies outside [0, 1]; left out": 1,
        "no pseudohyphal cell could bud any more; left out": 1,
    }


def test_a_colony_too_wide_for_an_image_is_left_out_and_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Others of the same call are measured."""
    simulator = OfflatticeSimulator.of(["area"], cells=500, draw=Ellipses.of)
    values = np.array([[1.0, 0.5, 0.5, 0.5, 0.5], [0.1, 0.05, 0.9, 0.05, 0.05]])
    sides = [len(Ellipses.of(simulator.colony(row, 0)).first) for row in values.tolist()]
    assert sides[0] < sides[1]
    monkeypatch.setattr(ellipse_mask, "MOST_PIXELS", sides[0] ** 2)
    seeds = np.zeros(2, dtype=np.uint64)
    assert np.isnan(simulator(values, seeds)[:, 0]).tolist() == [False, True]
    assert np.isnan(simulator.covered(values, seeds)).tolist() == [False, True]
    assert simulator.problems == {"its filaments reach so far that an image of it would be enormous; left out": 1}


def test_a_colony_that_the_frame_cuts_is_told_of() -> None:
    whole = OfflatticeSimulator.of(["area"], cells=500)
    cut = OfflatticeSimulator.of(["area"], cells=500, draw=partial(BinnedOutlines.of, frame=(20, 40)))
    assert cut(VALUES, SEEDS)[0, 0] < whole(VALUES, SEEDS)[0, 0]
    assert cut.problems == {"the frame of Li et al.'s masks cuts the colony off (--masks bins shows all of it)": 2}
    assert not whole.problems


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"statistics": ["areas"]}, "got 'areas', need some of li2024_csr_radius"),
        ({"statistics": ["cell_count"]}, "got 'cell_count'"),
        ({"statistics": []}, "need at least one"),
        ({"statistics": "area"}, r"statistics is 'area', it must be a list of names, such as \['area'\]"),
        ({"area": ()}, "area: got none, need at least one, or None for whole colonies"),
        ({"area": 50.0, "fixed": {"nutrient_exponent": 0.5}}, r"is for several areas, and area is 50\.0"),
        ({"free": ("fork", "nutrient_exponent")}, "is for several areas, and area is None"),
        (
            {"area": (5.0, 6.0), "fixed": {"nutrient_exponent": 1.5}},
            r"is 1\.5, it must be in \[0, 1\]",
        ),
        ({"limits": ((0.0, 1.0), (0.0, 1.0))}, "limits are 2 pairs, each of the 1 statistics needs one"),
        ({"free": ("fork", "gap")}, r"free names 'gap', which is that of ellipses, and draw is BinnedOutlines\.whole"),
        ({"free": ("forks",)}, "free names 'forks', which is unknown"),
        ({"fixed": {"fork": 0.5}}, "'fork' is free"),
        ({"free": ("fork",), "fixed": {"any_mother": 2.0}}, "any_mother"),
    ],
)
def test_wrong_simulators(arguments: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        OfflatticeSimulator.of(**({"statistics": ["area"], "cells": 10} | arguments))


def test_wrong_rows(unchecked: None) -> None:
    simulator = OfflatticeSimulator.of(["area"], cells=10)
    with pytest.raises(InputError, match=r"values have the shape \(3, 4\), it must be \(3, 5\), a row for each seed"):
        simulator(VALUES[:, :4], SEEDS)
    with pytest.raises(InputError, match=r"seed is 1\.5, it must be a whole number"):
        simulator(VALUES[:1], np.array([1.5]))


def test_photographs_are_measured_by_the_same_entries(monkeypatch: pytest.MonkeyPatch) -> None:
    for entry in ENTRIES:
        monkeypatch.delitem(STATISTICS, entry.name, raising=False)
        register_statistic(entry)
    mask = BinnedOutlines.of(grow(VALUES[0], cells=3000)).mask(3000)
    found = measure_mask(mask, 2.0, [entry.name for entry in ENTRIES])
    expected = li2024_statistics(mask)
    assert found["li2024_csr_radius"] == 2 * expected.csr_radius
    indices = [expected.filament_area_index, expected.filament_radius_index, expected.branch_index]
    assert [found[name] for name in PUBLISHED] == pytest.approx(indices, rel=1e-12)
    for entry in ENTRIES:
        del STATISTICS[entry.name]


def test_limits_hold_back_what_is_farther() -> None:
    names = ("compactness", "area")
    plain = OfflatticeSimulator.of(names, cells=300)
    values, seeds = np.tile([0.6, 0.5, 0.3, 0.2, 0.2], (3, 1)), np.arange(3)
    free = plain(values, seeds)
    low, high = np.median(free, axis=0) * 0.999, np.median(free, axis=0) * 1.001
    held = OfflatticeSimulator.of(names, cells=300, limits=list(zip(low, high, strict=True)))
    np.testing.assert_array_equal(held(values, seeds), np.clip(free, low, high))
    assert (held(values, seeds) != free).any()
    again = offlattice_simulator_of(**held.specification.arguments)
    np.testing.assert_array_equal(again(values, seeds), held(values, seeds))
