"""Detachment: number of networks, cells that are conserved, the tree, capacity."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, random_tree
from jaxtyping import Array
from scipy import stats

from reference import mechanisms as plain
from yeastfit.model.cells import cells_of
from yeastfit.model.colony import Colony
from yeastfit.model.mechanisms.random_detachment import RandomDetachment, split
from yeastfit.model.mechanisms.starvation_death import StarvationDeath
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD
from yeastfit.model.simulate import step

NUMERICS = Numerics(domain=8.0, spacing=1.0, dt=0.02, capacity=64)
MODEL = Model(detachment=RandomDetachment())
NODES = 30
parted = eqx.filter_jit(split)


def tree(seed: int) -> Colony:
    rng = np.random.default_rng(seed)
    return colony_of(rng.uniform(-2, 2, (NODES, 2)), random_tree(rng, NODES), numerics=NUMERICS, seed=seed)


@pytest.mark.thorough
def test_there_is_one_network_and_one_more_for_each_event() -> None:
    """1 + Poisson(k n t), for 400 colonies of 29 cells, which are conserved."""
    parameters = MODEL.complete(Parameters(detachment_rate=0.08))

    def one(lineages: Array) -> tuple[Array, Array, Array]:
        def step(colony: Colony, _: None) -> tuple[Colony, None]:
            colony = dataclasses.replace(colony, step=colony.step + 1)
            return MODEL.detachment.detached(context_of(colony, NUMERICS, HARD, parameters), {}), None

        start = dataclasses.replace(tree(0), lineages=lineages)
        after = jax.lax.scan(step, start, None, length=50)[0]
        cells = cells_of(after, jnp.asarray(0.7))
        return jnp.sum(after.alive & (after.parents < 0)), jnp.sum(cells.weights > 0), after.count

    seeds = jnp.asarray(np.stack([tree(seed).lineages for seed in range(400)]))
    networks, cells, count = map(np.asarray, eqx.filter_jit(jax.vmap(one))(seeds))
    assert (cells == NODES - 1).all()
    np.testing.assert_array_equal(count, NODES - 1 + networks)
    mean = 0.08 * (NODES - 1) * 1.0
    assert abs((networks - 1).mean() - mean) < 4 * np.sqrt(mean / 400)
    assert stats.chisquare(*_binned(networks - 1, mean)).pvalue > 1e-3


def _binned(found: np.ndarray, mean: float) -> tuple[np.ndarray, np.ndarray]:
    law, edge = stats.poisson(mean), 5
    observed = np.bincount(np.minimum(found, edge), minlength=edge + 1)
    expected = np.append(law.pmf(np.arange(edge)), law.sf(edge - 1)) * found.size
    return observed, expected


def test_a_cell_that_lets_go_keeps_its_place_and_its_buds() -> None:
    colony = tree(1)
    loose = np.zeros(64, bool)
    loose[[4, 9]] = True
    after = parted(colony, jnp.asarray(loose), 0.01, {})
    parents, x = np.asarray(after.parents), np.asarray(after.positions)
    mothers = np.asarray(colony.parents)[[4, 9]]
    assert parents[[4, 9]].tolist() == [-1, -1]
    assert parents[[NODES, NODES + 1]].tolist() == [4, 9]
    np.testing.assert_allclose(np.hypot(*(x[NODES : NODES + 2] - x[mothers]).T), 0.01, rtol=1e-3)
    others = np.delete(np.arange(NODES), [4, 9])
    np.testing.assert_array_equal(parents[others], np.asarray(colony.parents)[others])
    assert plain.networks(parents[: NODES + 2]) == 3


def test_of_a_dead_cell_that_lets_go_both_ends_are_dead() -> None:
    model = Model(detachment=RandomDetachment(), death=StarvationDeath("stay"))
    vitality = jnp.where(jnp.arange(64) % 2 == 0, 1.0, 0.0)
    colony = dataclasses.replace(tree(1), node_state={"vitality": vitality})
    parameters = model.complete(Parameters(detachment_rate=30.0))
    after = eqx.filter_jit(step)(colony, parameters, HARD, NUMERICS, model)[0]
    parents, left = np.asarray(after.parents), np.asarray(after.node_state["vitality"])
    ends = np.arange(NODES, int(after.count))
    assert len(ends) > 5
    np.testing.assert_array_equal(left[ends], left[parents[ends]])
    assert set(left[ends].tolist()) == {0.0, 1.0}


def test_what_finds_no_slot_stays_and_the_colony_says_so() -> None:
    small = dataclasses.replace(NUMERICS, capacity=NODES + 1)
    colony = colony_of(np.random.default_rng(0).uniform(-2, 2, (NODES, 2)), numerics=small)
    loose = np.zeros(NODES + 1, bool)
    loose[[4, 9]] = True
    after = parted(colony, jnp.asarray(loose), 0.01, {})
    assert int(after.count) == NODES + 1
    assert int(after.parents[9]) == 8
    assert bool(after.problems.capacity_reached)
    assert not bool(
        parted(colony, jnp.asarray(loose & (np.arange(NODES + 1) != 9)), 0.01, {}).problems.capacity_reached
    )
