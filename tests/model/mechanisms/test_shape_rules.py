"""Superelliptical cells: their level set, area, derivative in the exponent, and the ellipse as their limit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, grid, pair
from jaxtyping import Array

from reference import mechanisms as plain
from yeastfit.errors import InputError
from yeastfit.model.active_window import extent_of_cells
from yeastfit.model.cells import level_set
from yeastfit.model.mechanisms.superelliptical_cells import SuperellipticalCells
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.simulation.cell_coverage import coverage

NUMERICS = Numerics(domain=4.0, spacing=0.02, capacity=3)
MODEL = Model(shape=SuperellipticalCells())
ENDS = np.asarray(pair(1.5, 0.7, (0.2, -0.1)))
RATIO, REACH = 0.6, 1.8


@jax.jit
def level(exponent: Array) -> Array:
    """g of one cell, relaxed with a width that changes nothing of a single cell."""
    parameters = MODEL.complete(Parameters(aspect_ratio=RATIO)).replace(shape_exponent=exponent)
    cells = MODEL.shape.cells(colony_of(ENDS, numerics=NUMERICS), parameters)
    return level_set(cells, jnp.asarray(0.5), REACH, -2.0, 0.02, NUMERICS.points)


@pytest.mark.parametrize("exponent", [2.0, 3.5, 8.0])
def test_the_level_set_is_the_superellipse_s(exponent: float) -> None:
    """And nothing within `reach` is cut off; the area is the closed form's."""
    g = np.asarray(level(jnp.asarray(exponent)))
    expected = plain.superellipse_level(*grid(NUMERICS), ENDS, RATIO, exponent)
    near = expected < REACH - 1
    np.testing.assert_allclose(g[near], expected[near], atol=3e-5)
    assert (g[~near] > REACH - 1 - 1e-4).all()
    area = plain.superellipse_area(0.75, RATIO * 0.75, exponent)
    assert (g <= 0).sum() * 0.02**2 == pytest.approx(area, rel=4e-3)
    # the photograph's, in pixels of five points a side
    cell = np.array([[0.2, -0.1]]), np.array([[np.cos(0.7), np.sin(0.7)]]), np.array([0.75]), np.array([0.45])
    fraction, _ = coverage(*cell, 4.0, 0.04, exponents=np.array([exponent]))
    assert fraction.sum() * 0.04**2 == pytest.approx(area, rel=4e-3)


def test_the_ellipse_is_the_limit() -> None:
    @jax.jit
    def ellipse() -> Array:
        cells = Model().shape.cells(colony_of(ENDS, numerics=NUMERICS), Parameters(aspect_ratio=RATIO))
        return level_set(cells, jnp.asarray(0.5), REACH, -2.0, 0.02, NUMERICS.points)

    g = ellipse()
    np.testing.assert_allclose(level(jnp.asarray(2.0)), g, atol=3e-5)


def test_an_area_is_differentiable_in_the_exponent() -> None:
    """By the closed form, and finite at the centre and on the axes."""

    @jax.jit
    def area(exponent: Array) -> Array:
        return jnp.sum(0.5 + 0.5 * jnp.tanh(-level(exponent) / 0.1)) * 0.02**2

    slope = jax.jit(jax.jacfwd(area))
    # ∬ ½ + ½ tanh(−f/K) of f = r² − 1 is the area times ∫ ½ + ½ tanh((1 − s)/K) ds = 1 to e^(−2/K)
    for exponent in (2.0, 4.0):
        p, q, h = 0.75, RATIO * 0.75, 1e-4
        area_at = [plain.superellipse_area(p, q, exponent + sign * h) for sign in (1, -1)]
        exact = (area_at[0] - area_at[1]) / (2 * h)
        assert float(slope(jnp.asarray(exponent))) == pytest.approx(exact, rel=2e-2)


def test_corners_lie_within_the_window() -> None:
    parameters = MODEL.complete(Parameters(aspect_ratio=1.0, shape_exponent=50.0))
    extent = eqx.filter_jit(lambda colony: extent_of_cells(MODEL.shape.cells(colony, parameters), 1.0))
    assert float(extent(colony_of(pair(2.0, 0.0), numerics=NUMERICS))) >= 1.0
    assert float(extent(colony_of(pair(2.0, np.pi / 4), numerics=NUMERICS))) > 1.35


def test_no_star_is_a_cell() -> None:
    with pytest.raises(InputError, match=r"shape_exponent \(n\) is 1.5, it must be in \[2, 50\]"):
        MODEL.complete(Parameters(shape_exponent=1.5))
