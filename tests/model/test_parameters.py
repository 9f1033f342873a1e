"""λ1..λ7: what is admissible, what is said when it is not, and the scales."""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types

from yeastfit.errors import InputError
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.parameter_set import Parameter


def test_defaults_are_those_of_the_table_and_lie_in_the_plausible_range() -> None:
    for name, info in PARAMETERS.items():
        assert float(getattr(Parameters(), name)) == pytest.approx(info.default)
        low, high = info.plausible
        assert 0 < low <= info.default <= high <= info.largest
    assert [info.symbol for info in PARAMETERS.values()] == [f"λ{i}" for i in range(1, 8)]


@pytest.mark.parametrize(
    ("powers", "unit"),
    [
        *(((0, 0), ""), ((1, 0), "µm"), ((2, 1), "µm²/h"), ((0, 1), "1/h"), ((0, -1), "h"), ((-1, 0), "1/µm")),
        *(((1, -1), "µm h"), ((0, 2), "1/h²"), ((-2, 1), "1/µm²/h"), ((3, 0), "µm³"), ((0, -12), "h¹²")),
    ],
)
def test_units_of_any_powers(powers: tuple[int, int], unit: str) -> None:
    """λ L0^l μ*^r, L0 in µm and μ* per hour."""
    factor, found = Scales(length=2.0, rate=0.5).unit(powers)
    assert (factor, found) == (2.0 ** powers[0] * 0.5 ** powers[1], unit)
    assert Parameter("p", "p", "any", (0.1, 1.0), 0.5, powers=powers).powers == powers


@pytest.mark.parametrize("powers", [(1,), (0.5, 1), (1, 2, 3)])
def test_powers_are_two_whole_numbers(powers: tuple) -> None:
    with wrong_types(), pytest.raises(InputError, match=r"p: powers is .*, it must be two whole numbers"):
        Parameter("p", "p", "any", (0.1, 1.0), 0.5, powers=powers)


@pytest.mark.parametrize("name", PARAMETERS.names)
@pytest.mark.parametrize("value", [-0.5, math.nan, math.inf])
def test_a_bad_value_is_named_with_its_parameter(name: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"{name} \({PARAMETERS[name].symbol}\) is {value:g}, it must be"):
        Parameters(**{name: value})


@pytest.mark.parametrize(("name", "value"), [("repulsion_radius", 0.51), ("aspect_ratio", 1.01)])
def test_upper_bounds(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"{name} .* is {value:g}, it must be in"):
        Parameters(**{name: value})
    assert Parameters(**{name: PARAMETERS[name].largest}) is not None


@pytest.mark.parametrize("name", ["repulsion_radius", "aspect_ratio"])
def test_lengths_of_zero_are_refused_and_rates_of_zero_are_not(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} .* is 0, it must be in"):
        Parameters(**{name: 0.0})
    assert float(Parameters(mobility=0.0).mobility) == 0


@pytest.mark.parametrize("value", ["5", None, True, [1.0]])
def test_only_numbers_and_arrays_are_parameters(value: object) -> None:
    with wrong_types(), pytest.raises(InputError, match="must be a number or an array of numbers"):
        Parameters(mobility=value)  # type: ignore[arg-type]


def test_one_bad_member_is_found() -> None:
    with pytest.raises(InputError, match=r"mobility \(λ5\) is -2"):
        Parameters(mobility=np.array([1.0, -2.0, 3.0]))


def test_replace_changes_one_field_and_knows_its_names() -> None:
    changed = Parameters(elasticity=7.0).replace(mobility=2.0)
    assert changed.asdict() == pytest.approx(Parameters().asdict() | {"elasticity": 7.0, "mobility": 2.0})
    with pytest.raises(InputError, match="unknown parameter 'motility', expected one of diffusivity"):
        changed.replace(motility=1.0)


def test_as_dictionary_and_back_with_values_per_member() -> None:
    parameters = Parameters(metabolic_rate=np.array([0.5, 1.5]))
    again = Parameters(**{name: np.asarray(value) for name, value in parameters.asdict().items()})
    assert again.metabolic_rate.shape == (2,)
    assert again.asdict() == parameters.asdict()


def test_differentiable_in_every_field(double: None) -> None:
    def product(vector: jax.Array) -> jax.Array:
        parameters = Parameters.from_array(PARAMETERS.names, vector)
        return jnp.prod(jnp.stack([getattr(parameters, name) for name in PARAMETERS.names]))

    vector = jnp.array([info.default for info in PARAMETERS.values()])
    np.testing.assert_allclose(jax.jit(jax.grad(product))(vector), jnp.prod(vector) / vector, rtol=1e-14)


def test_values_of_further_parameters_travel_along() -> None:
    """Known to a model only: `within` checks them, fills in defaults, refuses others and keeps the set's order."""
    further = Parameter("bias", "κ", "of buds", (0.1, 10.0), 2.0), Parameter("q", "q", "", (0.1, 1.0), 0.5)
    both = PARAMETERS + further
    given = Parameters(q=0.25, mobility=np.array([1.0, 3.0]))
    assert float(given["q"]) == float(given.q) == 0.25
    complete = given.within(both)
    assert tuple(complete.values) == both.names
    assert float(complete["bias"]) == 2.0
    assert complete.within(both) is complete
    assert complete.replace(bias=3.0).asdict()["bias"] == 3.0
    table = complete.to_array(both.names)
    assert table.shape == (2, 9)
    assert Parameters.from_array(both.names, table).asdict()["mobility"] == [1.0, 3.0]
    with pytest.raises(InputError, match="unknown parameter 'q', expected one of diffusivity"):
        given.within(PARAMETERS)
    with pytest.raises(InputError, match=r"bias \(κ\) is -1, it must be finite and at least 0"):
        Parameters(bias=-1.0).within(both)
    with pytest.raises(AttributeError, match="no value of a parameter 'bias'"):
        _ = given.bias


def test_scales_convert_and_refuse() -> None:
    scales = Scales(length=5.0, rate=0.5)
    assert scales.hours(2.0) == 4.0
    assert scales.time(scales.hours(3.7)) == pytest.approx(3.7)
    np.testing.assert_array_equal(scales.hours(np.array([2.0, 3.0])), [4.0, 6.0])
    assert Scales().hours(1.0) == pytest.approx(2.174, abs=5e-4)
    for value in (0.0, -1.0, 1e-300, 1e300, math.nan, math.inf, "7.5"):
        with wrong_types(), pytest.raises(InputError, match=re.escape(f"scale length is {value!r}")):
            Scales(length=value)  # type: ignore[arg-type]
