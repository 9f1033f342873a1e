"""Free parameters of several conditions as one vector, with and without bounds."""

from typing import Any

import numpy as np
import pytest

from yeastfit import PARAMETERS, InputError, Parameter, ParameterSet
from yeastfit.inference.parameter_space import ParameterSpace

FREE = PARAMETERS.subset(("mobility", "metabolic_rate", "aspect_ratio"))
CONDITIONS = ("rich", "poor")


@pytest.fixture(scope="module")
def space() -> ParameterSpace:
    return ParameterSpace.of(FREE, CONDITIONS, own=("metabolic_rate",), bounds={"mobility": (0.5, 8.0)})


def test_entries_are_shared_or_one_for_each_condition(space: ParameterSpace) -> None:
    assert space.names == ("mobility", "metabolic_rate of rich", "metabolic_rate of poor", "aspect_ratio")
    assert (space.columns("rich"), space.columns("poor")) == ([0, 1, 3], [0, 2, 3])
    np.testing.assert_allclose(np.exp(space.low[:2]), [0.5, FREE["metabolic_rate"].plausible[0]])
    np.testing.assert_allclose(np.exp(space.high[[0, 3]]), [8.0, 1.0])


def test_the_map_without_bounds_is_one_to_one(space: ParameterSpace) -> None:
    for z in np.random.default_rng(0).normal(0, 2, (50, 4)):
        theta = space.theta_of(z)
        assert ((theta > space.low) & (theta < space.high)).all()
        np.testing.assert_allclose(space.z_of(theta), np.clip(z, -np.log(999), np.log(999)), atol=1e-9)
        assert (space.theta_of(z + 0.1) > theta).all()


def test_bounds_are_taken_for_a_point_just_inside(space: ParameterSpace) -> None:
    for beyond in (space.low - 1.0, space.high, space.high + 1.0):
        back = space.theta_of(space.z_of(beyond))
        np.testing.assert_allclose(back, np.clip(beyond, space.low, space.high), atol=2e-3 * 6)
        assert ((back > space.low) & (back < space.high)).all()


def test_the_slope_is_that_of_differences(space: ParameterSpace) -> None:
    z = np.array([-1.0, 0.0, 0.7, 2.0])
    step = 1e-5
    differences = (space.theta_of(z + step) - space.theta_of(z - step)) / (2 * step)
    np.testing.assert_allclose(space.slope(space.theta_of(z)), differences, rtol=1e-8)


def test_values_of_each_condition_are_in_the_order_of_its_parameters(space: ParameterSpace) -> None:
    theta = np.log([2.0, 0.6, 1.4, 0.7])
    for name, rate in (("rich", 0.6), ("poor", 1.4)):
        values = space.values(name, np.stack([theta, theta]))
        np.testing.assert_allclose(values, [[2.0, rate, 0.7]] * 2, rtol=1e-12)


def test_a_start_is_given_by_parameter_or_entry_and_defaults_fill_in(space: ParameterSpace) -> None:
    start = space.start({"mobility": 2.0, "metabolic_rate": 0.6, "metabolic_rate of poor": 1.4}, FREE)
    np.testing.assert_allclose(np.exp(start), [2.0, 0.6, 1.4, FREE["aspect_ratio"].default])
    with pytest.raises(InputError, match="start names 'elasticity', which is not free: mobility, metabolic"):
        space.start({"elasticity": 5.0}, FREE)


def test_scattered_points_fill_the_box_and_follow_their_seed(space: ParameterSpace) -> None:
    points = space.sobol_points(64, seed=3)
    np.testing.assert_array_equal(points, space.sobol_points(64, seed=3))
    assert (points != space.sobol_points(64, seed=4)).all()
    np.testing.assert_array_equal(points[:20], space.sobol_points(20, seed=3)[:20])
    unit = (points - space.low) / (space.high - space.low)
    counts = [np.histogram(column, bins=64, range=(0, 1))[0] for column in unit.T]
    assert (np.array(counts) == 1).all()  # a net: one point in each of 64 slices, whatever the axis


def test_what_lies_at_a_bound_is_told(space: ParameterSpace) -> None:
    middle = 0.5 * (space.low + space.high)
    assert space.at_a_bound(middle) == []
    at = np.where(np.arange(4) == 2, space.high - 0.005 * (space.high - space.low), middle)
    assert [entry.name for entry in space.at_a_bound(at)] == ["metabolic_rate of poor"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"own": ["elasticity"]}, "own names 'elasticity', which is not free: mobility"),
        ({"bounds": {"elasticity": (1.0, 2.0)}}, "bounds names 'elasticity'"),
        ({"bounds": {"mobility": (2.0, 1.0)}}, "bounds of mobility are 2, 1: they must rise"),
        ({"bounds": {"mobility": (0.0, 1.0)}}, "from above 0"),
        ({"bounds": {"aspect_ratio": (0.5, 1.5)}}, "at most 1"),
        ({"conditions": ("",), "own": ["mobility"]}, "there is one condition only"),
    ],
    ids=str,
)
def test_bad_spaces_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ParameterSpace.of(**{"parameters": FREE, "conditions": CONDITIONS, **arguments})


@pytest.mark.parametrize("plausible", [(0.0, 1.0), (-1.0, 1.0)])
def test_a_range_that_reaches_0_has_no_logarithm(plausible: tuple[float, float]) -> None:
    shift = ParameterSet((Parameter("shift", "s", "of the origin", plausible, 0.5, smallest=-10.0),))
    with pytest.raises(InputError, match=r"shift is plausible from .* to 1: a fit works with its logarithm"):
        ParameterSpace.of(shift)
    assert ParameterSpace.of(shift, bounds={"shift": (0.1, 1.0)}).entries[0].bounds == (0.1, 1.0)


def test_bounds_keep_above_the_smallest_admissible_value() -> None:
    count = ParameterSet((Parameter("count", "n", "of cells", (2.0, 9.0), 3.0, smallest=1.0),))
    with pytest.raises(InputError, match=r"bounds of count are 0\.5, 3: they must rise, from at least 1"):
        ParameterSpace.of(count, bounds={"count": (0.5, 3.0)})


def test_a_start_outside_the_bounds_is_refused(space: ParameterSpace) -> None:
    with pytest.raises(InputError, match=r"start: mobility is 9, a free parameter starts inside \(0\.5, 8\)"):
        space.start({"mobility": 9.0}, FREE)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"name": "q r"}, "name is 'q r', it must be letters, digits and underscores"),
        ({"default": -5.0}, "q: default is -5, it must be finite and at least 0"),
        ({"plausible": (2.0, 1.0)}, r"q: plausible is \(2.0, 1.0\), it must rise"),
    ],
    ids=["name", "default", "plausible"],
)
def test_parameters_that_make_no_sense_are_refused(changed: dict[str, Any], words: str) -> None:
    given = {"name": "q", "symbol": "q", "meaning": "of a test", "plausible": (0.1, 1.0), "default": 0.5}
    with pytest.raises(InputError, match=words):
        Parameter(**{**given, **changed})
