"""Contact between cells: overlap areas, forces, and pairs that part."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of
from jaxtyping import Array

from reference import mechanisms as plain
from yeastfit.errors import InputError
from yeastfit.model.cell_overlap import overlap_area
from yeastfit.model.cells import cells_of
from yeastfit.model.colony import Colony
from yeastfit.model.laws.forces import velocity
from yeastfit.model.mechanisms.cell_contact import CellContact
from yeastfit.model.mechanisms.constrained_contact import ConstrainedContact, nonnegative
from yeastfit.model.mechanisms.pair_overlap import overlap_and_slope
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD
from yeastfit.model.rules import ContactRule
from yeastfit.simulation.simulate import member_keys, simulate

NUMERICS = Numerics(domain=6.0, spacing=1.0, dt=0.02, capacity=8)
BOTH = {"cells": Model(contact=CellContact()), "constraint": Model(contact=ConstrainedContact())}
WIDTHS = 0.1, 0.2
CROSSED = np.array([[0.5, 0.1], [-0.5, 0.05], [0.35, 0.45], [-0.3, -0.4]])
TREE = [-1, 0, -1, 2]  # two cells


@pytest.mark.parametrize("ends", [CROSSED, CROSSED + np.array([[0, 0], [0, 0], [0.3, 0.5], [0.3, 0.4]])])
def test_overlaps_and_forces_are_those_of_the_plain_reading(ends: np.ndarray, double: None) -> None:
    area, slope = jax.jit(lambda ends: overlap_and_slope(ends, jnp.asarray(0.6), *WIDTHS))(jnp.asarray(ends)[None])
    assert float(area[0]) == pytest.approx(plain.cell_overlap(ends, 0.6, 0.1, 0.2), rel=2e-3)
    h = 1e-4
    for node, axis in ((0, 0), (1, 1), (3, 0)):
        step = np.zeros((4, 2))
        step[node, axis] = h
        above, below = (plain.cell_overlap(ends + sign * step, 0.6, 0.1, 0.2) for sign in (1, -1))
        assert float(slope[0, node, axis]) == pytest.approx((above - below) / (2 * h), rel=2e-2, abs=2e-3)


def test_two_circles_overlap_in_a_lens() -> None:
    """With little smoothing; ellipses of aspect ratio 1."""
    for distance in (0.3, 0.6):
        ends = jnp.array([[0.5, 0.0], [-0.5, 0.0], [0.5, distance], [-0.5, distance]])
        area = float(jax.jit(lambda ends: overlap_and_slope(ends, jnp.asarray(1.0), 0.02, 0.08))(ends[None])[0][0])
        assert area == pytest.approx(plain.lens_area(0.5, distance), rel=0.02)


@pytest.mark.thorough
@pytest.mark.parametrize("widths", [(0.1, 0.2), (0.02, 0.08), (0.3, 0.5)])
def test_slopes_are_the_derivatives_of_the_area(widths: tuple[float, float], double: None) -> None:
    """By the nodes, of pairs that cross, touch, lie apart, share a node, all but coincide, or have no length."""
    rng = np.random.default_rng(3)
    ends = rng.normal(size=(40, 4, 2)) * [0.4, 0.6]
    ends[:5, 2] = ends[:5, 1]  # a mother and her daughter
    ends[5, 2:] = ends[5, :2] + 1e-4
    ends[6, 1] = ends[6, 0]
    ends[7, 2:] += 9.0
    ratio = jnp.asarray(0.6)

    def areas(ends: Array) -> Array:
        return overlap_and_slope(ends, ratio, *widths)[0]

    found, slopes = (
        np.asarray(one) for one in jax.jit(lambda ends: overlap_and_slope(ends, ratio, *widths))(jnp.asarray(ends))
    )
    wanted = np.asarray(jax.jit(jax.grad(lambda ends: jnp.sum(areas(ends))))(jnp.asarray(ends)))
    assert (found > 1e-3).sum() >= 20
    assert found[7] < 1e-6
    np.testing.assert_allclose(slopes, wanted, atol=1e-10 * np.abs(wanted).max())

    # and once more: both ways agree along a direction
    toward, weights = rng.normal(size=(2, *ends.shape))

    def weighed(ends: Array) -> Array:
        return jnp.sum(overlap_and_slope(ends, ratio, *widths)[1][8:] * weights[8:])

    along = float(jax.jit(lambda ends: jax.jvp(weighed, (ends,), (jnp.asarray(toward),))[1])(jnp.asarray(ends)))
    back = float(np.sum(np.asarray(jax.jit(jax.grad(weighed))(jnp.asarray(ends))) * toward))
    assert along == pytest.approx(back, rel=1e-9)


@eqx.filter_jit
def pushed(contact: ContactRule, colony: Colony) -> Array:
    parameters = BOTH[contact.name].complete(Parameters(aspect_ratio=0.6))
    return contact.velocity(context_of(colony, NUMERICS, parameters=parameters), jnp.zeros((8, 2)))


@pytest.mark.parametrize("name", BOTH)
def test_forces_sum_to_zero(name: str) -> None:
    """And so do torques; without contact there is no force."""
    contact = BOTH[name].contact
    colony = colony_of(CROSSED, TREE, numerics=NUMERICS)
    force = np.asarray(pushed(contact, colony))
    assert np.abs(force).max() > 0.05
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-5)
    torque = CROSSED[:, 0] * force[:4, 1] - CROSSED[:, 1] * force[:4, 0]
    assert abs(torque.sum()) < 1e-5
    apart = colony_of(CROSSED + 2.0 * np.outer([0, 0, 1, 1], [0, 1]), TREE, numerics=NUMERICS)
    assert not np.asarray(pushed(contact, apart)).any()


@pytest.mark.thorough
@pytest.mark.parametrize("name", BOTH)
def test_overlapping_cells_part_symmetrically(name: str) -> None:
    """Two parallel cells: their common centre stays, one is the other's image, and the overlap ends."""
    model = BOTH[name]
    parameters = model.complete(Parameters(aspect_ratio=0.6, mobility=0.0))
    ends = np.array([[0.5, 0.2], [-0.5, 0.2], [0.5, -0.2], [-0.5, -0.2]])

    @eqx.filter_jit
    def run(colony: Colony) -> tuple[Array, Array]:
        def one(colony: Colony, _: None) -> tuple[Colony, Array]:
            moved = velocity(context_of(colony, NUMERICS, parameters=parameters), model.contact)
            colony = dataclasses.replace(colony, positions=colony.positions + NUMERICS.dt * moved)
            return colony, overlap_and_slope(colony.positions[None, :4], jnp.asarray(0.6), *WIDTHS)[0][0]

        colony, areas = jax.lax.scan(one, colony, None, length=150)
        return colony.positions[:4], areas

    positions, areas = (np.asarray(found) for found in run(colony_of(ends, TREE, numerics=NUMERICS)))
    first = plain.cell_overlap(ends, 0.6, 0.1, 0.2)
    np.testing.assert_allclose(positions[:2], positions[2:] * [1, -1], atol=1e-4)
    np.testing.assert_allclose(positions.mean(axis=0), 0, atol=1e-5)
    assert (np.diff(areas) < 1e-6).all()
    assert areas[-1] < 0.06 * first  # what is left is of smoothed outlines:
    assert plain.cell_overlap(positions, 0.6, 1e-3, 2e-3) < 1e-9  # the ellipses themselves have nothing in common
    if name == "constraint":  # to the tolerated overlap, as e^(−αt)
        exact = 0.005 + (first - 0.005) * (1 - 5 * NUMERICS.dt) ** np.arange(1, 151)
        np.testing.assert_allclose(areas, exact, atol=0.02)


@pytest.mark.thorough
def test_a_colony_of_200_cells_overlaps_less_than_by_contact_of_nodes() -> None:
    """By the exact area of ellipses: half as much where cells push, a tenth by constraints, for each of three seeds."""
    values = Parameters(diffusivity=0.1, metabolic_rate=1.0, aspect_ratio=0.7)
    numerics = Numerics(domain=20.0, spacing=0.2, capacity=256)
    keys = member_keys(seed=0, members=3)
    areas = {}
    for name, model in {"nodes": Model(), **BOTH}.items():
        run = simulate(values, keys, times=[7.5], model=model, numerics=numerics, relaxation=HARD)
        assert (np.abs(np.asarray(run.colony.count) - 181) <= 25).all()  # the source's are the fewest
        cells = jax.vmap(lambda colony: cells_of(colony, jnp.asarray(0.7)))(run.colony)
        areas[name] = np.asarray(jax.jit(jax.vmap(lambda one: overlap_area(one, None, None)))(cells))
    assert (areas["cells"] < 0.5 * areas["nodes"]).all()
    assert (areas["constraint"] < 0.1 * areas["nodes"]).all()
    assert (areas["nodes"] > 40.0).all()


def test_multipliers_are_those_of_the_problem_of_complementarity() -> None:
    """0 ≤ μ ⊥ A μ − b ≥ 0, of a random matrix."""
    rng = np.random.default_rng(0)
    slopes = rng.normal(size=(5, 7))
    matrix, wanted = jnp.asarray(slopes @ slopes.T), jnp.asarray(rng.normal(size=5))
    size = jnp.asarray((np.abs(slopes) @ np.abs(slopes).T).sum(axis=1))
    found = np.asarray(jax.jit(lambda wanted: nonnegative(lambda m: matrix @ m, wanted, size, sweeps=400))(wanted))
    rest = np.asarray(matrix) @ found - np.asarray(wanted)
    assert (found >= 0).all()
    np.testing.assert_allclose(np.minimum(found, rest), 0, atol=1e-4)


def test_a_union_far_wider_than_outlines_is_refused() -> None:
    for rule in ("cells", "constraint"):
        with pytest.raises(InputError, match=r"contact: union is 10\.0, it must be at most 20 times boundary"):
            Model.of({"contact": {"rule": rule, "union": 10.0}})


def test_rules_that_exclude_each_other_are_named() -> None:
    with pytest.raises(InputError, match="contact: rule 'cells' pushes ellipses apart, not shape 'superellipse'"):
        Model.of({"contact": {"rule": "cells"}, "shape": {"rule": "superellipse"}})
