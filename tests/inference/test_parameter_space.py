"""Free parameters of several conditions as one vector, with and without bounds."""

import numpy as np
import pytest

from yeastfit import InputError, Parameters
from yeastfit.inference.parameter_space import Space, check_free
from yeastfit.model.parameters import NAMES, PARAMETERS

FREE = ("mobility", "metabolic_rate", "aspect_ratio")
FIXED = {"rich": Parameters(elasticity=4.0), "poor": Parameters(elasticity=8.0)}


@pytest.fixture(scope="module")
def space() -> Space:
    return Space.of(FREE, FIXED, own=("metabolic_rate",), bounds={"mobility": (0.5, 8.0)})


def test_entries_are_shared_or_one_for_each_condition(space: Space) -> None:
    assert space.names == ("mobility", "metabolic_rate of rich", "metabolic_rate of poor", "aspect_ratio")
    assert (space.columns("rich"), space.columns("poor")) == ([0, 1, 3], [0, 2, 3])
    np.testing.assert_allclose(np.exp(space.low[:2]), [0.5, PARAMETERS["metabolic_rate"].plausible[0]])
    np.testing.assert_allclose(np.exp(space.high[[0, 3]]), [8.0, 1.0])


def test_the_map_without_bounds_is_one_to_one(space: Space) -> None:
    for z in np.random.default_rng(0).normal(0, 2, (50, 4)):
        theta = space.of_z(z)
        assert ((theta > space.low) & (theta < space.high)).all()
        np.testing.assert_allclose(space.to_z(theta), np.clip(z, -np.log(999), np.log(999)), atol=1e-9)
        assert (space.of_z(z + 0.1) > theta).all()


def test_bounds_are_taken_for_a_point_just_inside(space: Space) -> None:
    for beyond in (space.low - 1.0, space.high, space.high + 1.0):
        back = space.of_z(space.to_z(beyond))
        np.testing.assert_allclose(back, np.clip(beyond, space.low, space.high), atol=2e-3 * 6)
        assert ((back > space.low) & (back < space.high)).all()


def test_the_slope_is_that_of_differences(space: Space) -> None:
    z = np.array([-1.0, 0.0, 0.7, 2.0])
    step = 1e-5
    differences = (space.of_z(z + step) - space.of_z(z - step)) / (2 * step)
    np.testing.assert_allclose(space.slope(space.of_z(z)), differences, rtol=1e-8)


def test_parameters_of_each_condition(space: Space) -> None:
    theta = np.log([2.0, 0.6, 1.4, 0.7])
    found = space.parameters(theta)
    for name, rate, elasticity in (("rich", 0.6, 4.0), ("poor", 1.4, 8.0)):
        values = found[name].asdict()
        expected = {**FIXED[name].asdict(), "mobility": 2.0, "metabolic_rate": rate, "aspect_ratio": 0.7}
        assert values == pytest.approx(expected, rel=1e-6)
        logs = space.log_parameters(name, np.stack([theta, theta]))
        np.testing.assert_allclose(np.exp(logs), [[values[one] for one in NAMES]] * 2, rtol=1e-6)
        assert values["elasticity"] == elasticity
    np.testing.assert_allclose(space.theta(found), theta, rtol=1e-6)


def test_a_fixed_parameter_may_be_zero() -> None:
    space = Space.of(("mobility",), {"": Parameters(diffusivity=0.0)})
    logs = space.log_parameters("", np.zeros((1, 1)))[0]
    assert logs[NAMES.index("diffusivity")] == -np.inf
    assert logs[NAMES.index("mobility")] == 0.0


def test_scattered_points_fill_the_box_and_follow_their_seed(space: Space) -> None:
    points = space.scattered(64, seed=3)
    np.testing.assert_array_equal(points, space.scattered(64, seed=3))
    assert (points != space.scattered(64, seed=4)).all()
    np.testing.assert_array_equal(points[:20], space.scattered(20, seed=3)[:20])
    unit = (points - space.low) / (space.high - space.low)
    counts = [np.histogram(column, bins=64, range=(0, 1))[0] for column in unit.T]
    assert (np.array(counts) == 1).all()  # a net: one point in each of 64 slices, whatever the axis


def test_what_lies_at_a_bound_is_told(space: Space) -> None:
    middle = 0.5 * (space.low + space.high)
    assert space.at_a_bound(middle) == []
    at = np.where(np.arange(4) == 2, space.high - 0.005 * (space.high - space.low), middle)
    assert [entry.name for entry in space.at_a_bound(at)] == ["metabolic_rate of poor"]


def test_free_names_come_in_the_order_of_the_model() -> None:
    assert check_free(["aspect_ratio", "mobility"]) == ("mobility", "aspect_ratio")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"free": ["speed"]}, "'speed' is unknown"),
        ({"free": []}, "at least one parameter"),
        ({"free": ["mobility", "mobility"]}, "each once"),
        ({"own": ["elasticity"]}, "own names 'elasticity', which is not free: mobility"),
        ({"bounds": {"elasticity": (1.0, 2.0)}}, "bounds names 'elasticity'"),
        ({"bounds": {"mobility": (2.0, 1.0)}}, "bounds of mobility are 2, 1: they must rise"),
        ({"bounds": {"mobility": (0.0, 1.0)}}, "from above 0"),
        ({"free": ["aspect_ratio"], "bounds": {"aspect_ratio": (0.5, 1.5)}}, "at most 1"),
        ({"fixed": {"": Parameters()}, "own": ["mobility"]}, "there is one condition only"),
    ],
    ids=str,
)
def test_bad_spaces_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Space.of(**{"free": FREE, "fixed": FIXED, **arguments})


def test_a_start_outside_the_bounds_is_refused(space: Space) -> None:
    with pytest.raises(InputError, match=r"start: mobility is 9, a free parameter starts inside \(0\.5, 8\)"):
        space.theta(dict.fromkeys(FIXED, Parameters(mobility=9.0)))
