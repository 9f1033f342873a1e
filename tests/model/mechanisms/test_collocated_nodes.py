"""Collocated nodes: labels of groups against the matrices of the source's appendix A.1."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import context_of
from jaxtyping import Array

from reference import mechanisms as plain
from yeastfit.errors import InputError
from yeastfit.model.colony import Colony
from yeastfit.model.laws.budding import UniformBudding, bud
from yeastfit.model.mechanisms.collocated_nodes import CollocatedBirths, CollocatedSprings, slots_of_nodes
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import HARD

NUMERICS = Numerics(domain=6.0, spacing=1.0, dt=0.02, capacity=6)
MODEL = Model(births=CollocatedBirths(8), springs=CollocatedSprings(8))


def halved(colony: Colony, slot: int) -> Colony:
    """The group of one slot divides: it is the best fed, and growth is for one child."""
    return fed_so(colony, jnp.asarray(np.where(np.arange(6) == slot, 0.9, 0.0)))


@eqx.filter_jit
def fed_so(colony: Colony, fed: Array) -> Colony:
    context = context_of(colony, NUMERICS, HARD, local_nutrient=fed, growth_rate=jnp.asarray(0.05))
    return bud(context, MODEL.births.births(context), UniformBudding(), MODEL.node_state())


begin, slots_in = eqx.filter_jit(MODEL.start), jax.jit(slots_of_nodes, static_argnums=1)


def matrices(colony: Colony) -> tuple[np.ndarray, np.ndarray]:
    """A and C of the labels."""
    slot = np.asarray(slots_in(colony, 8))
    together = (slot[:, None] == slot).astype(int)
    differ = np.arange(8)[:, None] ^ np.arange(8)
    one_bit = (differ > 0) & (differ & (differ - 1) == 0)
    return (one_bit & (together == 0)).astype(int), together


def test_labels_give_the_appendix_s_matrices_after_each_division() -> None:
    """8 nodes: the founders, then the second group, then its first half; the last A as it is printed."""
    colony = begin(jax.random.key(0), NUMERICS)
    spring, together = np.zeros((8, 8), int), np.ones((8, 8), int)
    plain.divided(spring, together, 0, 8)
    for slot, first, size in ((None, 0, 0), (1, 4, 4), (1, 4, 2)):
        if slot is not None:
            colony = halved(colony, slot)
            plain.divided(spring, together, first, size)
        found = matrices(colony)
        np.testing.assert_array_equal(found[0], spring)
        np.testing.assert_array_equal(found[1], together)
    rows = ["00001000", "00000100", "00000010", "00000001", "10000110", "01001001", "00101000", "00010100"]
    np.testing.assert_array_equal(found[0], [[int(one) for one in row] for row in rows])
    assert np.asarray(colony.node_state["group_size"])[:4].tolist() == [4, 1, 2, 1]
    assert not bool(colony.problems.store_empty)
    # forces are those of the matrices
    rng = np.random.default_rng(0)
    colony = dataclasses.replace(colony, positions=jnp.asarray(rng.normal(size=(6, 2)), jnp.float32))
    slots = np.asarray(slots_in(colony, 8))
    expected = plain.collocated_pull(np.asarray(colony.positions)[slots].astype(float), spring, together)
    pull, stiffness = (eqx.filter_jit(one)(colony) for one in (MODEL.springs.pull, MODEL.springs.stiffness))
    np.testing.assert_allclose(np.asarray(pull)[slots], expected, atol=1e-5)
    assert float(stiffness) == 2 * 3
    # what cannot be halved does not bud, and is reported
    refused = halved(colony, 3)
    assert int(refused.count) == 4
    assert bool(refused.problems.store_empty)


def test_divisions_without_a_slot_keep_groups_whole() -> None:
    colony = begin(jax.random.key(0), NUMERICS)
    for slot in (0, 1, 0, 1):
        colony = halved(colony, slot)
    assert int(colony.count) == 6
    assert not bool(colony.problems.capacity_reached)
    colony = halved(colony, 2)
    assert int(colony.count) == 6
    assert bool(colony.problems.capacity_reached)
    assert float(np.sum(np.where(colony.alive, colony.node_state["group_size"], 0))) == 8


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ({"births": {"rule": "collocated"}}, "births: rule 'collocated' goes with springs 'collocated' only"),
        (
            {"births": {"rule": "clocks"}, "springs": {"rule": "collocated"}},
            "springs: rule 'collocated' goes with births 'collocated' only, not with births 'clocks'",
        ),
        (
            {"births": {"rule": "collocated", "nodes": 64}, "springs": {"rule": "collocated"}},
            "springs: rule 'collocated' has nodes 512 and births 'collocated' has 64: give both the same",
        ),
        ({"births": {"rule": "collocated", "nodes": 100}}, "nodes is 100, it must be a power of two"),
    ],
)
def test_what_does_not_go_with_groups_is_said(rules: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Model.of(rules)


def test_groups_do_not_take_over_a_tree() -> None:
    """Which group a node belongs to only its divisions tell."""
    colony = begin(jax.random.key(0), NUMERICS)
    MODEL.resumed(colony)
    with pytest.raises(InputError, match="births: rule 'collocated' cannot go on from a colony of other births, with"):
        MODEL.resumed(dataclasses.replace(colony, node_state={}))
