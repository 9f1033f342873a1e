"""Compiled contact: the sum of `contact` in another order, on any configuration, and colonies that grow by it."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, random_tree
from jaxtyping import Array

from yeastfit.model.colony import Colony
from yeastfit.model.compiled import operations
from yeastfit.model.compiled.contact import CompiledNodeContact, compiled_contact
from yeastfit.model.compiled.medium import CompiledOneNutrient
from yeastfit.model.compiled.ranking import CompiledGlobalBirths
from yeastfit.model.compiled.rules import with_compiled_rules
from yeastfit.model.compiled.springs import CompiledTreeSprings
from yeastfit.model.laws.contact import contact
from yeastfit.model.mechanisms.cell_contact import CellContact
from yeastfit.model.mechanisms.morphogen_medium import MorphogenMedium
from yeastfit.model.mechanisms.patch_births import PatchBirths
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.simulate import step

pytest.importorskip("numba")

WIDE = Relaxation(contact=0.2, overhang=0.25)
LAWS = pytest.mark.parametrize("relaxation", [HARD, Relaxation(), WIDE], ids=["hard", "ramp", "wide ramp"])
NODES, ROOM = 300, 320
CONFIGURATIONS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "one heap": lambda rng: rng.normal(0.0, 0.15, (NODES, 2)),
    "spread": lambda rng: rng.uniform(-20.0, 20.0, (NODES, 2)) * [1.0, 0.05],
    "on the bins' edges": lambda rng: 0.5 * rng.integers(-4, 5, (NODES, 2)) + rng.choice([0.0, 1e-9], (NODES, 2)),
    "wider than the bins": lambda rng: rng.normal(0.0, 0.3, (NODES, 2)) + 150.0 * rng.integers(-10, 11, (NODES, 1)),
    "two places far apart": lambda rng: rng.normal(0.0, 0.3, (NODES, 2)) + 900.0 * rng.integers(2, size=(NODES, 1)),
}
compiled, plain = eqx.filter_jit(compiled_contact), eqx.filter_jit(contact)


def crowd(positions: np.ndarray, seed: int = 0) -> Colony:
    """A random tree over these nodes, with random weights and slots to spare."""
    rng, numerics = np.random.default_rng(seed), Numerics(domain=8.0, spacing=0.2, capacity=ROOM)
    tree, weights = random_tree(rng, len(positions)), rng.uniform(0.1, 1.0, len(positions))
    return colony_of(positions, tree, weights, numerics=numerics)


@LAWS
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_it_is_the_sum_of_contact(name: str, relaxation: Relaxation, double: None) -> None:
    for seed in range(3):
        colony = crowd(CONFIGURATIONS[name](np.random.default_rng(seed)), seed)
        for radius in (0.5, 0.23):
            found = compiled(colony, jnp.asarray(radius), relaxation)
            np.testing.assert_allclose(found, plain(colony, jnp.asarray(radius), relaxation), atol=1e-10)
            assert np.abs(found).max() > 0.1
            assert (np.asarray(found)[NODES:] == 0).all()


@LAWS
def test_in_single_precision_the_last_bits_differ(relaxation: Relaxation) -> None:
    colony = crowd(np.random.default_rng(3).normal(0.0, 1.0, (NODES, 2)))
    found, expected = (touch(colony, jnp.asarray(0.5), relaxation) for touch in (compiled, plain))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, expected, atol=2e-5 * float(np.abs(expected).max()))


def test_nodes_that_are_nowhere_push_nobody(double: None) -> None:
    """Where positions are not finite the colony is lost, and is said to be; the others' sums are not in danger."""
    at = np.random.default_rng(4).normal(0.0, 0.5, (NODES, 2))
    lost = at.copy()
    lost[7:10] = [[np.nan, 0.0], [np.inf, -np.inf], [1e300, 0.0]]
    kept = np.delete(np.arange(NODES), [7, 8, 9])
    weights = np.array(crowd(at).weights)
    weights[7:10] = 0.0
    without = eqx.tree_at(lambda c: c.weights, crowd(at), jnp.asarray(weights))
    found, expected = (compiled(colony, jnp.asarray(0.5), Relaxation()) for colony in (crowd(lost), without))
    np.testing.assert_allclose(np.asarray(found)[kept], np.asarray(expected)[kept], atol=1e-12)
    assert (np.asarray(found)[7:10] == 0).all()


def test_it_is_registered_once_whatever_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """XLA takes a name once, and each device traces its colony in a thread of its own."""
    registered = list[str]()

    def register(name: str, function: Callable[[Any], int]) -> None:
        time.sleep(0.05)
        registered.append(name)

    monkeypatch.setattr("yeastfit.model.compiled.foreign_call.register", register)
    monkeypatch.setattr(operations, "_registered", cache(operations._registered.__wrapped__))
    name = "yeastfit_contact_float32"
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(lambda _: operations.operation("contact", np.dtype("float32")), range(4))) == {name}
    assert registered == ["yeastfit_contact_float32"]


def test_colonies_without_nodes_or_with_one_are_at_rest() -> None:
    for count in (0, 1):
        colony = eqx.tree_at(lambda c: c.count, crowd(np.zeros((NODES, 2))), jnp.asarray(count))
        assert (np.asarray(compiled(colony, jnp.asarray(0.5), HARD)) == 0).all()


def test_colonies_on_two_devices_at_once_are_the_same_as_one_after_the_other() -> None:
    colonies = [crowd(np.random.default_rng(seed).normal(0.0, 1.0, (NODES, 2)), seed) for seed in range(8)]
    alone = [np.asarray(compiled(one, jnp.asarray(0.5), HARD)) for one in colonies]
    devices = jax.local_devices()
    placed = [jax.device_put(one, devices[k % len(devices)]) for k, one in enumerate(colonies)]
    together = [compiled(one, jax.device_put(jnp.asarray(0.5), one.count.device), HARD) for one in placed]
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_only_rules_that_have_been_compiled_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    every = Model(
        births=CompiledGlobalBirths(),
        contact=CompiledNodeContact(),
        medium=CompiledOneNutrient(),
        springs=CompiledTreeSprings(),
    )
    assert with_compiled_rules(Model()) == every
    others = Model(births=PatchBirths(), contact=CellContact(), medium=MorphogenMedium())
    assert with_compiled_rules(others) == replace(others, springs=CompiledTreeSprings())
    monkeypatch.setattr(operations, "find_spec", lambda _: None)  # no numba
    assert with_compiled_rules(Model()) == Model()


def test_it_has_no_derivative() -> None:
    colony = crowd(np.random.default_rng(5).normal(0.0, 1.0, (NODES, 2)))
    with pytest.raises(ValueError, match="cannot be differentiated"):
        jax.jvp(lambda radius: compiled_contact(colony, radius, Relaxation()), (0.5,), (1.0,))


def in_a_dish(nodes: int, domain: float) -> tuple[Colony, Numerics]:
    """A crowd as dense as colonies are, each node joined to a near one, in nutrient that varies."""
    rng = np.random.default_rng(6)
    numerics = Numerics(domain=domain, spacing=0.4, dt=0.025, capacity=nodes)
    at = rng.normal(0.0, 0.1 * domain, (nodes, 2))
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    apart[np.triu_indices(nodes)] = np.inf
    tree = np.concatenate([[-1], np.argmin(apart[1:], axis=1)])
    nutrient = np.ones((numerics.points,) * 2)
    nutrient[1:-1, 1:-1] = rng.uniform(0.2, 1.0, (numerics.points - 2,) * 2)
    return colony_of(at, tree, nutrient=nutrient, numerics=numerics, step=1), numerics


@pytest.mark.thorough
def test_a_large_colony_moves_as_the_plain_reading_has_it(double: None) -> None:
    """2000 nodes step for step against `tests/reference`, by the hard rules."""
    from reference import colony as reference

    colony, numerics = in_a_dish(2000, 40.0)
    values = {"mobility": 1.3, "metabolic_rate": 0.9, "aspect_ratio": 0.65}
    theirs = reference.Colony(
        np.asarray(colony.positions, float), np.asarray(colony.parents), np.asarray(colony.nutrient, float), 1
    )
    same = reference.Numerics(numerics.domain, numerics.spacing, numerics.dt, numerics.room, numerics.bud_distance)
    parameters, rules = Parameters(**values), with_compiled_rules(Model())
    ours = jax.tree.map(lambda leaf: leaf.astype(float) if jnp.issubdtype(leaf.dtype, jnp.inexact) else leaf, colony)
    advance = eqx.filter_jit(lambda c: step(c, parameters, HARD, numerics, rules)[0])
    for _ in range(3):
        ours = advance(ours)
        theirs, _ = reference.step(
            theirs, reference.Parameters(**{**_defaults(), **values}), same, lambda *_: np.zeros(0), cg_tolerance=1e-12
        )
        np.testing.assert_allclose(ours.positions, theirs.positions, atol=1e-6)
    np.testing.assert_allclose(ours.nutrient, theirs.nutrient, atol=5e-6)  # the solver's tolerance


def _defaults() -> dict[str, float]:
    return {name: float(value) for name, value in Parameters().values.items()}


@pytest.mark.thorough
def test_the_plain_rules_can_be_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    from yeastfit.simulation import segments

    asked: list[bool] = []

    def noticed(model: Model) -> Model:
        asked.append(choice)
        return with_compiled_rules(model)

    monkeypatch.setattr(segments, "with_compiled_rules", noticed)
    monkeypatch.setattr(segments, "FIRST_ROOM", 50)
    colony, numerics = in_a_dish(100, 8.0)
    rules = Model().complete(Parameters()), Relaxation()
    walked: list[Array] = []
    for choice in (True, False):
        how = segments.Segments(*rules, replace(numerics, compiled=choice), lambda s: s.growth_rate, Model())
        walked.append(how.grown(colony, [2])[0].positions)
    assert asked == [True]
    np.testing.assert_allclose(walked[0], walked[1], atol=2e-6)
    assert (np.asarray(walked[0]) != np.asarray(colony.positions)).any()
