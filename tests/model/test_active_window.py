"""The part of the grid that a step works on: which it is, and that the rest would not have changed."""

import dataclasses
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, pair, started
from jaxtyping import Array

from yeastfit import Numerics, Parameters, Relaxation
from yeastfit.model import active_window as window
from yeastfit.model.active_window import extent_of_cells, extent_of_change, on_window, windows
from yeastfit.model.cells import Cells, cells_of
from yeastfit.model.colony import Colony, start
from yeastfit.model.laws.medium import eaten
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.model import Model
from yeastfit.model.simulate import step

NUMERICS = Numerics(domain=17.0, spacing=0.1, capacity=60)  # squares of half sides 2.9, 4.2, 6 and 8.5
changed_to = eqx.filter_jit(extent_of_change)


@jax.jit
def on_squares(extent: Array) -> Array:
    return on_window(jnp.asarray, extent, 0.1, 401)


@pytest.mark.parametrize("points", [5, 48, 49, 68, 69, 70, 401, 402, 5657])
def test_squares_rise_to_the_whole_grid_and_share_its_centre(points: int) -> None:
    sizes = windows(points)
    assert sizes[-1] == points
    assert list(sizes) == sorted(set(sizes))
    assert all((points - size) % 2 == 0 for size in sizes)
    assert len(sizes) <= window.MOST
    assert all(large < window.GROWTH * (small + 2) for small, large in pairwise(sizes))


@pytest.mark.parametrize("extent", [0.0, 2.4, 5.01, 9.0, 14.0, 20.0, 21.0, np.inf])
def test_the_smallest_square_that_reaches_is_taken(extent: float) -> None:
    taken = on_squares(jnp.asarray(extent))
    assert int(taken) == min([n for n in windows(401) if 0.05 * (n - 1) >= extent], default=401)


def test_members_that_run_together_take_the_largest_they_need() -> None:
    together = np.asarray(jax.jit(jax.vmap(on_squares, axis_name="member"))(jnp.array([0.0, 9.0, 3.0])))
    assert len(set(together.tolist())) == 1
    assert int(together[0]) == int(on_squares(jnp.asarray(9.0)))


def test_extent_of_cells(double: None) -> None:
    """The farthest point of an ellipse that lies along an axis; an empty slot has none."""
    colony, extent = colony_of(pair(2.0, 0.0, (3.0, -0.5)), numerics=NUMERICS), jax.jit(extent_of_cells)
    cells: Cells = jax.jit(cells_of)(colony, jnp.asarray(0.5))
    assert float(extent(cells, 1.0)) == pytest.approx(4.0)
    assert float(extent(cells, 4.0)) == pytest.approx(5.0)
    none = jnp.asarray(np.zeros_like(cells.weights))
    assert float(extent(eqx.tree_at(lambda c: c.weights, cells, none), 1.0)) == 0.0


@pytest.mark.parametrize("value", [0.9, 1.1, 1.0 - 3e-7])
def test_extent_of_change_sees_every_point_that_is_not_at_rest(value: float) -> None:
    margin = 0.1 * window.MARGIN
    assert float(changed_to(jnp.zeros((41, 41)), 0.1)) == pytest.approx(margin)
    for i, j in ((20, 35), (5, 20), (33, 7)):
        nutrient = np.ones((41, 41))
        nutrient[i, j] = value
        found = float(changed_to(jnp.asarray(1.0 - nutrient, jnp.result_type(float)), 0.1))
        assert found == pytest.approx(0.1 * max(abs(i - 20), abs(j - 20)) + margin, rel=1e-5)


@pytest.fixture(params=[False, True], ids=["single", "double"])
def precision(request: pytest.FixtureRequest) -> bool:
    if request.param:
        request.getfixturevalue("double")
    return bool(request.param)


@pytest.mark.thorough
@pytest.mark.parametrize("relaxation", [Relaxation(), Relaxation(None, None, None, "whole")], ids=["relaxed", "hard"])
def test_what_is_left_out_would_not_have_changed(
    precision: bool, relaxation: Relaxation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over two events, against steps on the whole grid: the nutrient to the rounding of 110 steps."""

    def grown(most: int) -> tuple[Colony, list[float]]:
        monkeypatch.setattr(window, "MOST", most)
        compiled = eqx.filter_jit(lambda c: step(c, Parameters(), relaxation, NUMERICS)[0])
        colony, taken = start(jax.random.key(4), NUMERICS), []
        for _ in range(110):
            taken.append(float(extent_of_change(1.0 - colony.nutrient, NUMERICS.spacing)))
            colony = compiled(colony)
        return colony, taken

    ours, extents = grown(window.MOST)
    whole, _ = grown(1)
    assert extents[0] < 1.0
    assert 2.9 < extents[-1] < 6.0  # the smallest square was left, and the whole grid never taken
    # a difference in the last bit may grow tenfold over a hundred steps
    bound = 1e-13 if precision else 1e-6
    np.testing.assert_allclose(ours.nutrient, whole.nutrient, rtol=0.0, atol=bound)
    # by lineage: the last bit decides who of two nodes that are fed alike buds first, and so gets the lower slot
    slots, others = (np.lexsort(np.asarray(c.lineages).T)[-int(c.count) :] for c in (ours, whole))
    np.testing.assert_array_equal(ours.lineages[slots], whole.lineages[others])
    np.testing.assert_array_equal(ours.lineages[ours.parents[slots]], whole.lineages[whole.parents[others]])
    np.testing.assert_allclose(ours.positions[slots], whole.positions[others], rtol=0.0, atol=30 * bound)


def test_nutrient_of_any_kind_is_stepped_wherever_it_is() -> None:
    """A hole in the nutrient far from every cell fills up; it would not on a square that held the cells only."""
    colony = started(jax.random.key(0), NUMERICS)
    hole = np.array(colony.nutrient)
    hole[20:30, 20:30] = 0.2

    @jax.jit
    def after(nutrient: Array) -> Array:
        there = dataclasses.replace(colony, nutrient=nutrient)
        return eaten(context_of(there, NUMERICS), cells_of(there, jnp.asarray(0.7)), BiomassUptake())

    changed = np.abs(np.asarray(after(hole)) - hole)[15:35, 15:35]
    assert changed.max() > 1e-2


@pytest.mark.thorough
def test_no_derivative_is_lost_at_the_squares_edge(double: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the nutrient by diffusivity and by metabolic rate, against steps on the whole grid."""
    numerics = Numerics(domain=12.0, spacing=0.1, capacity=60)  # half sides 2.9, 4.2 and 6, of which the last is idle
    colony = start(jax.random.key(2), numerics)

    def grown(log_rates: Array) -> Array:
        parameters = Parameters(diffusivity=jnp.exp(log_rates[0]), metabolic_rate=jnp.exp(log_rates[1]))

        def once(colony: Colony, _: None) -> tuple[Colony, None]:
            return step(colony, parameters, Relaxation(), numerics)[0], None

        return jax.lax.scan(once, colony, None, length=30)[0].nutrient

    def slopes(most: int) -> np.ndarray:
        monkeypatch.setattr(window, "MOST", most)
        return np.asarray(jax.jit(jax.jacfwd(lambda rates: grown(rates)))(jnp.log(jnp.array([0.1, 1.0]))))

    whole = slopes(1)
    assert (np.abs(whole).max(axis=(0, 1)) > 1e-2).all()
    np.testing.assert_allclose(slopes(7), whole, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("medium", ["nutrient", "nitrogen", "morphogen"])
def test_no_step_holds_an_empty_constant(medium: str) -> None:
    """On which jaxlib 0.11.2 ends the process, where members are shared out over devices."""
    model = Model.of({"medium": {"rule": medium}})
    colony = model.start(jax.random.key(0), NUMERICS)
    rules = model.complete(Parameters()), Relaxation(), NUMERICS, model
    traced = jax.make_jaxpr(lambda one: step(one, *rules)[0])(colony)
    assert [constant for constant in traced.consts if not np.size(constant)] == []
