"""Grid, time step, capacity, and members shared out over devices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types

from yeastfit.errors import InputError
from yeastfit.model.numerics import MEMBER, Numerics, largest_in_ensemble, map_members
from yeastfit.text import quoted


@pytest.mark.parametrize("name", ["domain", "spacing", "dt", "capacity", "bud_distance", "substeps"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), True, "1"])
def test_a_value_that_is_no_number_above_zero_is_named(name: str, value: object) -> None:
    with wrong_types(), pytest.raises(InputError, match=f"{name} is {quoted(value)}, it must be a number above 0"):
        Numerics(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("capacity", [1, 2.5])
def test_capacity_is_a_whole_number_of_at_least_two(capacity: float) -> None:
    with wrong_types(), pytest.raises(InputError, match=f"capacity is {capacity}, it must be a whole number"):
        Numerics(capacity=capacity)  # type: ignore[arg-type]


@pytest.mark.parametrize("substeps", [0.5, 2.5, 1001])
def test_substeps_are_a_whole_number_up_to_a_thousand(substeps: float) -> None:
    with wrong_types(), pytest.raises(InputError, match=f"substeps is {substeps}, it must be a whole number from 1 to"):
        Numerics(substeps=substeps)  # type: ignore[arg-type]


@pytest.mark.parametrize(("domain", "spacing"), [(10.0, 0.3), (0.3, 0.1)])
def test_the_domain_is_a_whole_number_of_intervals(domain: float, spacing: float) -> None:
    with pytest.raises(
        InputError, match=rf"spacing is {spacing:g}: domain / spacing is {domain:g} / {spacing:g} = .* at least 4"
    ):
        Numerics(domain=domain, spacing=spacing)


def test_the_grid_ends_on_both_edges() -> None:
    numerics = Numerics(domain=40.0, spacing=0.1)
    assert numerics.points == 401
    np.testing.assert_allclose(numerics.axis()[jnp.array([0, 200, -1])], [-20.0, 0.0, 20.0], atol=4e-6)


@pytest.mark.parametrize(
    ("dt", "steps"), [(0.02, 50), (0.01, 100), (1 / 49, 49), (0.3, 4), (0.03, 34), (1.0, 1), (2.0, 1)]
)
def test_an_event_comes_every_ceil_of_one_over_dt_steps(dt: float, steps: int) -> None:
    assert Numerics(dt=dt).steps_per_event == steps


@pytest.mark.parametrize("members", [1, 2, 5])
def test_every_member_is_mapped_once_and_in_order(members: int) -> None:
    squares = map_members(lambda x: {"square": x**2}, jnp.arange(float(members)))
    assert squares["square"].tolist() == [float(i**2) for i in range(members)]


def test_a_trip_count_is_the_largest_of_the_members_that_run_together() -> None:
    """On an accelerator, where they do; here the members of a device run one after the other, each with its own."""
    assert int(largest_in_ensemble(jnp.asarray(3))) == 3
    assert np.asarray(map_members(largest_in_ensemble, jnp.arange(6))).tolist() == list(range(6))
    assert jax.vmap(largest_in_ensemble, axis_name=MEMBER)(jnp.arange(6)).tolist() == [5] * 6
