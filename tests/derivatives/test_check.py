"""A check of any function's derivatives: it passes what is right, fails what is wrong, says where it cannot tell."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types
from jaxtyping import Array

from yeastfit import (
    GradientCheck,
    InputError,
    check_derivatives,
)


@pytest.fixture(autouse=True, scope="module")
def unchecked() -> Iterator[None]:
    """Statistics that are traced are no NumPy arrays, as they are annotated to be."""
    with wrong_types():
        yield


def verdicts(check: GradientCheck, by: str = "differences") -> list[str]:
    return [c.verdict for c in check.comparisons if c.by == by]


def test_a_right_derivative_passes_from_single_precision_too() -> None:
    inputs = {"a": np.float32(1.0), "b": np.linspace(0.5, 2.0, 4), "c": [jnp.zeros(())]}
    check = check_derivatives(lambda x: {"f": jnp.sin(x["a"]) * x["b"] ** 2 + x["c"][0], "g": x["a"] ** 3}, inputs)
    assert check.passed
    assert check.counts == {"agrees": 3 * 5 + 3}
    assert {c.along for c in check.comparisons} == {"a", "b", "c.0"}
    assert {(c.output, c.index) for c in check.comparisons if c.by == "differences"} == {
        *(("f", (k,)) for k in range(4)),
        ("g", ()),
    }
    assert check.warnings() == []
    assert not jax.config.read("jax_enable_x64")


def factor(wrong: float) -> Callable[[Array], Array]:
    """sin with a derivative that is off by a factor."""

    @jax.custom_jvp
    def function(x: Array) -> Array:
        return jnp.sin(x)

    @function.defjvp
    def function_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
        return jnp.sin(primals[0]), wrong * jnp.cos(primals[0]) * tangents[0]

    return function


@pytest.mark.parametrize(
    ("wrong", "passes"), [(1.0, True), (1.00001, False), (0.99, False), (0.0, False), (-1.0, False)]
)
def test_a_wrong_factor_is_found(wrong: float, passes: bool) -> None:
    check = check_derivatives(factor(wrong), jnp.linspace(0.1, 1.2, 3))
    assert check.passed == passes
    assert verdicts(check) == ["agrees" if passes else "differs"] * 3
    assert verdicts(check, "transpose") == ["agrees"]
    assert check.warnings() == ([] if passes else ["3 of 4 derivatives differ"])


def test_a_stopped_gradient_is_found() -> None:
    assert verdicts(check_derivatives(lambda x: x * jax.lax.stop_gradient(x), 1.3)) == ["differs"]


def test_reverse_mode_of_its_own_is_held_against_forward_mode() -> None:
    """A linear map with a transpose that is none."""

    def wrong(x: Array) -> Array:
        solve = lambda matrix, b: b / 2.0  # noqa: E731
        return jax.lax.custom_linear_solve(lambda v: 2.0 * v, x, solve, transpose_solve=lambda matrix, b: b / 2.1)

    check = check_derivatives(wrong, jnp.ones(2))
    assert verdicts(check) == ["agrees"] * 2
    assert verdicts(check, "transpose") == ["differs"]
    assert not check.passed


def test_an_infinite_derivative_is_found() -> None:
    check = check_derivatives(jnp.sqrt, 0.0)
    assert check.counts == {"not finite": 2}
    assert check.warnings() == ["2 of 2 derivatives are not finite"]
    # finite value and forward derivative, but a gradient that is not a number
    hidden = check_derivatives(lambda x: jnp.where(x > 0, jnp.sqrt(x), 1.0), 0.0)
    assert verdicts(hidden, "transpose") == ["not finite"]


def test_a_kink_tells_nothing() -> None:
    assert verdicts(check_derivatives(jnp.abs, 0.0)) == ["uncertain"]
    assert check_derivatives(jnp.abs, 1e-3).passed  # of 1e-4 and less, no step reaches it


def test_what_rounding_drowns_is_uncertain() -> None:
    check = check_derivatives(lambda x: x.astype(jnp.float32) ** 2, 1.3)
    assert verdicts(check) == ["uncertain"]


def test_differences_across_a_decision_are_left_out() -> None:
    """A jump right beside: within the larger steps, so that the smaller ones serve; and at every step."""

    def jump(x: Array) -> tuple[Array, Array]:
        return x**2 + (x > 1.0), x > 1.0

    assert check_derivatives(jump, 1.0 - 3e-6, has_aux=True).passed
    across = check_derivatives(jump, 1.0, has_aux=True)
    assert verdicts(across) == ["crossed"]
    assert not across.passed
    assert "crosses a change of the order of parents" in across.warnings()[0]


def test_directions_of_ones_own() -> None:
    inputs = {"x": jnp.ones(3), "y": jnp.zeros(())}
    directions = {"x₀": {"x": jnp.array([1.0, 0.0, 0.0]), "y": jnp.zeros(())}}
    check = check_derivatives(lambda v: v["x"] @ jnp.arange(1.0, 4.0) + v["y"], inputs, directions)
    assert check.passed
    assert check.comparisons[0].along == "x₀"
    assert check.comparisons[0].forward == 1.0
    with pytest.raises(InputError, match="direction 'x₀' has shapes"):
        check_derivatives(lambda v: v["y"], inputs, {"x₀": {"x": jnp.ones(2), "y": jnp.zeros(())}})


def test_inputs_without_derivatives_are_named() -> None:
    with pytest.raises(InputError, match="inputs hold 3, they must be floating-point arrays"):
        check_derivatives(lambda x: x, 3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"function": lambda x: {}}, "function gives no output, there is nothing to compare"),
        ({"inputs": {}}, "inputs hold no array, there is nothing to differentiate by"),
        ({"directions": {"none": jnp.zeros(3)}}, "directions: 'none' is 0 everywhere, there is nothing to compare"),
        ({"tolerance": 0.0}, "tolerance is 0.0, it must be a number above 0"),
        ({"steps": ()}, r"steps is \[\], it must be numbers above 0"),
        ({"steps": (1e-3, 0.0)}, r"steps is \[0.001, 0.0\], it must be numbers above 0"),
        ({"steps": 1e-3}, r"steps is 0.001, it must be numbers above 0"),
    ],
    ids=["output", "inputs", "direction", "tolerance", "no steps", "step", "one number"],
)
def test_a_check_of_nothing_is_none(change: dict[str, Any], words: str) -> None:
    given = {"function": lambda x: 2.0 * x, "inputs": jnp.ones(3), **change}
    with pytest.raises(InputError, match=words):
        check_derivatives(given.pop("function"), given.pop("inputs"), **given)
