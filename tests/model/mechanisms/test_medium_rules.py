"""Media of fields: nitrogen in a dish, a morphogen; conservation, closed forms, limits; what excludes what."""

import dataclasses
from collections.abc import Mapping
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import context_of, grid, scattered_tree
from jaxtyping import Array
from scipy import ndimage

from reference import mechanisms as plain
from yeastfit.errors import InputError
from yeastfit.model.colony import Colony
from yeastfit.model.laws.forces import velocity
from yeastfit.model.mechanisms.clock_births import ClockBirths
from yeastfit.model.mechanisms.morphogen_medium import MorphogenMedium
from yeastfit.model.mechanisms.nitrogen_medium import NitrogenMedium
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import closed_step
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.rules import Births, Context
from yeastfit.model.simulate import step

NUMERICS = Numerics(domain=6.0, spacing=0.5, dt=0.02, capacity=24)
RNG = np.random.default_rng(0)


@eqx.filter_jit
def _begin(model: Model, key: Array) -> Colony:
    return model.start(key, NUMERICS)


def begin(model: Model, seed: int) -> Colony:
    """A new colony, by one program."""
    return _begin(model, jax.random.key(seed))


@jax.jit
def closed(field: Array, rate: Array, source: Array) -> Array:
    return closed_step(field, rate, jnp.asarray(0.4), NUMERICS, source)


def test_what_a_dish_holds_and_what_was_eaten_is_constant() -> None:
    """To the solver's tolerance; and a step is the plain reading's."""
    field, rate = (RNG.uniform(0, 1, (13, 13)).astype(np.float32) for _ in range(2))
    held, gone = float(field.sum()), 0.0
    for _ in range(20):
        before, field = field, np.asarray(closed(field, 5 * rate, np.zeros_like(field)))
        gone += float(np.sum(5 * rate * 0.5 * (before + field)) * NUMERICS.dt)
    assert float(field.sum()) + gone == pytest.approx(held, rel=1e-5)
    assert gone > 0.5 * held
    source = RNG.uniform(0, 1, (13, 13)).astype(np.float32)
    known = field.astype(float), rate.astype(float), source.astype(float)
    expected = plain.closed_step(*known, 0.4, 0.5, 0.02)
    np.testing.assert_allclose(closed(field, rate, source), expected, atol=2e-6)


def test_a_morphogen_rises_to_secretion_over_decay() -> None:
    """m = s/k (1 − e^(−kt)) where all is colony, with Crank and Nicolson's factor (1 − kΔt/2) / (1 + kΔt/2)."""
    field, rate, source = jnp.zeros((13, 13)), jnp.full((13, 13), 2.0), jnp.full((13, 13), 3.0)
    for _ in range(25):
        field = closed(field, rate, source)
    np.testing.assert_allclose(field, 1.5 * (1 - (0.98 / 1.02) ** 25), rtol=1e-5)


class FreeBirths(NitrogenMedium):
    """Births that never ask for nitrogen."""

    name = "free births"

    def afforded(self, context: Context, births: Births) -> tuple[Colony, Births]:
        """All."""
        return context.colony, births


REACTION = Numerics(domain=6.0, spacing=0.15, dt=0.01, capacity=2)
SPREAD = (0.01, 0.4)  # diffusivities of u and v


@partial(jax.jit, static_argnames="steps")
def schnakenberg(u: Array, v: Array, steps: int) -> tuple[Array, Array]:
    """∂u/∂t = D_u ∇²u + a − u + u²v, ∂v/∂t = D_v ∇²v + b − u²v with a = 0.1, b = 0.9, by steps of closed fields."""

    def one(_: int, fields: tuple[Array, Array]) -> tuple[Array, Array]:
        u, v = fields
        made = 0.1 + u * u * v
        after = closed_step(u, jnp.ones_like(u), jnp.asarray(SPREAD[0]), REACTION, made)
        return after, closed_step(v, u * u, jnp.asarray(SPREAD[1]), REACTION, jnp.full_like(v, 0.9))

    return jax.lax.fori_loop(0, steps, one, (u, v))


@pytest.mark.parametrize("waves", [5, 8, 13])
def test_a_reaction_grows_at_the_rate_of_linear_theory(waves: int) -> None:
    """Schnakenberg's about u = 1, v = 0.9, where e^(rt) has the eigenvalue r of J − k² D; k² of the stencil."""
    h, points = REACTION.spacing, REACTION.points
    k = waves * np.pi / (points * h)
    squared = 2 * (1 - np.cos(k * h)) / h**2
    rates, vectors = np.linalg.eig(np.array([[0.8, 1.0], [-1.8, -1.0]]) - squared * np.diag(SPREAD))
    fastest = int(np.argmax(rates.real))
    shape = vectors[:, fastest].real
    wave = np.tile(np.cos(k * h * (np.arange(points) + 0.5)), (points, 1))  # of squares with walls around them
    u, v = (jnp.asarray(rest + 2e-3 * part * wave, jnp.float32) for rest, part in zip((1.0, 0.9), shape, strict=True))
    grown = schnakenberg(u, v, 150)[0]
    ratio = float(np.sum((np.asarray(grown) - 1) * wave) / np.sum((np.asarray(u) - 1) * wave))
    assert np.log(ratio) / (150 * REACTION.dt) == pytest.approx(rates[fastest].real, abs=0.01)
    assert abs(rates[fastest].real) > 0.05


def test_a_reaction_saturates_into_spots() -> None:
    """By t = 30 their height has settled; they still move about a little."""
    start = 1 + 0.01 * np.random.default_rng(5).standard_normal((REACTION.points,) * 2)
    u, v = jnp.asarray(start, jnp.float32), jnp.full(start.shape, 0.9, jnp.float32)
    heights: list[float] = []
    for _ in range(2):
        u, v = schnakenberg(u, v, 3000 if not heights else 500)
        heights.append(float(np.std(u)))
    assert 100 * 0.01 < heights[0] == pytest.approx(heights[1], rel=0.01)
    assert ndimage.label(np.asarray(u) > 2.0)[1] > 10


def tree(numerics: Numerics, medium: Mapping[str, Array]) -> Colony:
    return dataclasses.replace(scattered_tree(9, 1.0, numerics), medium=dict(medium))


@pytest.mark.thorough
def test_two_equal_nutrients_are_one() -> None:
    """A reservoir of nitrogen that diffuses and is eaten as carbon is: the source's colony, to rounding."""
    both = Model(medium=NitrogenMedium("reservoir"))
    parameters = both.complete(Parameters(metabolic_rate=3.0, nitrogen_uptake=3.0))
    colony = both.resumed(tree(NUMERICS, {}))

    @eqx.filter_jit
    def grown(model: Model, colony: Colony, parameters: Parameters) -> Colony:
        return jax.lax.fori_loop(0, 5, lambda _, c: step(c, parameters, HARD, NUMERICS, model)[0], colony)

    # the step before an event of budding
    begun = dataclasses.replace(colony, step=jnp.asarray(47))
    found = grown(both, begun, parameters)
    source = grown(Model(), Model().resumed(begun), Parameters(metabolic_rate=3.0))
    np.testing.assert_array_equal(found.medium["nitrogen"], found.nutrient)
    np.testing.assert_allclose(found.positions, source.positions, atol=1e-6)
    assert int(found.count) == int(source.count) > 9


def test_growth_is_by_the_scarcer_nutrient_and_drift_along_both() -> None:
    model = Model(medium=NitrogenMedium())
    x, y = grid(NUMERICS)
    colony = tree(NUMERICS, {"nitrogen": jnp.asarray(0.5 + 0.05 * x)})
    colony = dataclasses.replace(colony, nutrient=jnp.asarray(0.5 + 0.05 * y))
    parameters = model.complete(Parameters(nitrogen=1.5, mobility=2.0, nitrogen_mobility=0.5))
    px, py = np.asarray(colony.positions)[:9].T
    carbon, nitrogen = 0.5 + 0.05 * py, 1.5 * (0.5 + 0.05 * px)
    supply, drift = eqx.filter_jit(model.medium.supply), eqx.filter_jit(model.medium.drift)
    fed, soft = (np.asarray(supply(colony, parameters, each, NUMERICS))[:9] for each in (HARD, Relaxation()))
    np.testing.assert_allclose(fed, np.minimum(carbon, nitrogen), atol=1e-6)
    np.testing.assert_allclose(soft, np.minimum(carbon, nitrogen), atol=0.01)
    moved = np.asarray(drift(context_of(colony, NUMERICS, parameters=parameters)))[:9]
    np.testing.assert_allclose(moved, np.tile([0.5 * 1.5 * 0.05, 2.0 * 0.05], (9, 1)), atol=1e-6)


DISH = Model(medium=NitrogenMedium())
FULL = {"nitrogen": 2.0, "nitrogen_per_birth": 7.3, "nitrogen_uptake": 0.0}  # 84.5 c0 L0² on 13² points: 11 children


@eqx.filter_jit
def fed_by_a_dish(
    model: Model, parameters: Parameters, relaxation: Relaxation, colony: Colony, steps: int
) -> tuple[Colony, tuple[Array, Array, Array]]:
    """A colony some steps later; at each its weights, the nitrogen of the dish and the growth rate."""

    def one(colony: Colony, _: None) -> tuple[Colony, tuple[Array, Array, Array]]:
        after, snapshot = step(colony, parameters, relaxation, NUMERICS, model)
        return after, (after.weights, after.medium["nitrogen"], snapshot.growth_rate)

    return jax.lax.scan(one, colony, None, length=steps)


@pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["hard", "relaxed"])
def test_births_take_their_nitrogen_from_the_dish(relaxation: Relaxation) -> None:
    """What the dish holds and what children took is constant to rounding, and births end when it is used up."""
    parameters, begun = DISH.complete(Parameters(**FULL)), begin(DISH, 4)
    colony, (weights, fields, rate) = fed_by_a_dish(DISH, parameters, relaxation, begun, 300)
    children = np.asarray(weights, np.float64).sum(axis=1) - 2
    held = 2.0 * 0.25 * np.asarray(fields, np.float64).sum(axis=(1, 2))
    np.testing.assert_allclose(held + 7.3 * children, 2.0 * 0.25 * 169, rtol=1e-6)
    assert 0 <= held[-1] < (7.3 if relaxation == HARD else 1e-4)
    assert not bool(colony.problems.capacity_reached)
    assert float(colony.medium["nitrogen"].min()) >= -1e-6
    if relaxation == HARD:  # event by event as the plain reading, which knows how many the colony asks for
        events = np.arange(49, 300, 50)
        nodes = np.append(2, 2 + children[events])
        wanted = np.minimum(np.ceil(np.expm1(np.asarray(rate)[events]) * nodes[:-1] - 1e-6), nodes[:-1])
        assert plain.nitrogen_births(wanted.tolist(), 2.0 * 0.25 * 169, 7.3) == np.diff(nodes).tolist()
        assert np.diff(nodes)[-1] < wanted[-1]  # the dish ran out


@pytest.mark.thorough
def test_births_that_cost_nothing_are_those_of_before() -> None:
    """With q = 0 to the last bit, whatever the boundary."""

    for boundary in ("dish", "reservoir"):
        model = Model(medium=NitrogenMedium(boundary))
        parameters = model.complete(Parameters(nitrogen=0.7, nitrogen_uptake=5.0))
        begun = begin(model, 1)
        found = fed_by_a_dish(model, parameters, HARD, begun, 120)[0]
        free = Model(medium=FreeBirths(boundary))
        expected = fed_by_a_dish(free, parameters, HARD, begun, 120)[0]
        assert int(found.count) > 4
        assert eqx.tree_equal(found, expected)


def test_who_is_refused_a_child_keeps_its_clock() -> None:
    """Two ripe nodes and nitrogen for one child: the other is still ripe, and buds when there is more."""
    model = Model(medium=NitrogenMedium(), births=ClockBirths())
    parameters = model.complete(Parameters(nitrogen=2.0, nitrogen_per_birth=50.0))
    colony = begin(model, 0)
    ripe = jnp.asarray(np.append([0.7, 0.7], np.asarray(colony.node_state["phase"])[2:]).astype(np.float32))
    colony = dataclasses.replace(colony, node_state={**colony.node_state, "phase": ripe})
    context = context_of(colony, NUMERICS, HARD, parameters)
    paid, births = eqx.filter_jit(lambda context: model.medium.afforded(context, model.births.births(context)))(context)
    assert np.asarray(births.weights).tolist() == [1.0] + [0.0] * 23
    assert np.asarray(births.node_state["phase"])[:2] == pytest.approx([0.7 - np.log(2), 0.7], abs=5e-8)
    assert np.asarray(births.node_state["cycles"])[:2].tolist() == [1, 0]
    np.testing.assert_allclose(paid.medium["nitrogen"], 1 - 50 / (2.0 * 0.25 * 169), rtol=1e-6)


def test_a_child_without_a_slot_takes_nothing() -> None:
    colony = DISH.resumed(tree(dataclasses.replace(NUMERICS, capacity=10), {}))
    births = Births(jnp.asarray(np.arange(10)), colony.weights, jnp.asarray(1))
    parameters = DISH.complete(Parameters(nitrogen_per_birth=1.0))
    context = context_of(colony, NUMERICS, HARD, parameters)
    paid, allowed = eqx.filter_jit(DISH.medium.afforded)(context, births)
    assert float(np.sum(allowed.weights)) == 9  # asked for, so that the run says that the capacity was reached
    taken = np.asarray(colony.medium["nitrogen"]) - np.asarray(paid.medium["nitrogen"])
    assert float(np.sum(taken)) * 0.25 == pytest.approx(1.0, rel=1e-4)


def test_cells_flee_from_a_morphogen() -> None:
    model = Model(medium=MorphogenMedium())
    x, _ = grid(NUMERICS)
    colony = tree(NUMERICS, {"morphogen": jnp.asarray(0.1 * x)})
    parameters = model.complete(Parameters(morphogen_repulsion=3.0))
    context = context_of(colony, NUMERICS, parameters=parameters)
    velocity_in = eqx.filter_jit(velocity)
    fled = np.asarray(velocity_in(context, model.contact, model.medium))
    moved = fled - np.asarray(velocity_in(context, model.contact))
    np.testing.assert_allclose(moved[:9], np.tile([-0.3, 0.0], (9, 1)), atol=1e-5)


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ({"medium": {"rule": "walkers"}}, "medium: rule 'walkers' excludes births 'global'.*it needs births 'walkers'"),
        ({"births": {"rule": "walkers"}}, "births: rule 'walkers' needs walkers: choose medium 'walkers', too"),
        ({"medium": {"rule": "nitrogen", "boundary": "sea"}}, "boundary is 'sea', it must be 'dish' or 'reservoir'"),
        ({"medium": {"rule": "nitrogen", "carbon_boundary": 1}}, "carbon_boundary is 1, it must be 'dish' or"),
        ({"medium": {"rule": "morphogen", "nutrient_boundary": "sea"}}, "nutrient_boundary is 'sea', it must be"),
    ],
)
def test_what_does_not_go_together_is_said(rules: dict, words: str, unchecked: None) -> None:
    with pytest.raises(InputError, match=words):
        Model.of(rules)
