"""The widths, and their absence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types

from yeastfit.errors import InputError
from yeastfit.model.relaxation import HARD, Relaxation


@pytest.mark.parametrize("name", ["union", "contact", "boundary"])
def test_none_and_zero_are_the_hard_rule(name: str) -> None:
    with wrong_types():  # the whole number 0 is no float
        assert all(getattr(Relaxation(**{name: value}), name) is None for value in (None, 0, 0.0))  # type: ignore[arg-type]
    assert getattr(HARD, name) is None
    assert HARD.births == "whole"


@pytest.mark.parametrize("name", ["union", "contact", "boundary"])
@pytest.mark.parametrize("value", [-0.5, np.nan, np.inf])
def test_a_bad_width_is_named(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"relaxation width {name} is {value:g}, it must be above 0, or None"):
        Relaxation(**{name: value})  # type: ignore[arg-type]


def test_a_union_too_narrow_for_single_precision_is_named() -> None:
    with pytest.raises(InputError, match=r"relaxation width union is 0.01, it must be at least 0.0125"):
        Relaxation(union=0.01)
    assert Relaxation(union=0.0125).union is not None


def test_a_bad_rule_for_births_is_named() -> None:
    with wrong_types(), pytest.raises(InputError, match="births is 'half', it must be 'fractional' or 'whole'"):
        Relaxation(births="half")  # type: ignore[arg-type]


@pytest.mark.parametrize(("union", "boundary"), [(0.05, 0.2), (0.5, 0.2), (0.1, None), (None, 0.2)])
def test_beyond_reach_neither_union_nor_boundary_leaves_a_trace(union: float | None, boundary: float | None) -> None:
    """A cell's share of the union's boundary value is e⁻¹² there, and the smoothed indicator e⁻⁹."""
    relaxation = Relaxation(union=union, boundary=boundary)
    f = float(relaxation.reach) - 1.0
    if union is not None:
        assert np.exp(-f / union) <= np.exp(-12.0) * (1 + 1e-5)
    if boundary is not None:
        assert 0.5 - 0.5 * np.tanh(f / boundary) <= np.exp(-9.0) * (1 + 1e-5)


def test_the_hard_model_reaches_as_far_as_its_cells() -> None:
    assert HARD.reach == 1.0


def test_widths_are_traced_so_that_their_values_never_recompile() -> None:
    traces = []

    @jax.jit
    def reach(relaxation: Relaxation) -> jax.Array:
        traces.append(relaxation)
        return jnp.asarray(relaxation.reach)

    for width in (0.05, 0.1, 0.4):
        reach(Relaxation(union=width, contact=width, boundary=width, turning=width))
    assert len(traces) == 1
