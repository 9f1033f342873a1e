"""Who buds and when: patches and clocks against the plain reading, in their limits, and by growth rate."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, random_tree
from jaxtyping import Array

from reference import mechanisms as plain
from yeastfit.model.colony import Colony
from yeastfit.model.laws.budding import UniformBudding, bud
from yeastfit.model.laws.growth import GlobalBirths
from yeastfit.model.mechanisms.clock_births import ClockBirths
from yeastfit.model.mechanisms.patch_births import PatchBirths, apportioned
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.rules import BirthRule, Births, Context

NUMERICS = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=64)
PATCHES, CLOCKS = Model(births=PatchBirths()), Model(births=ClockBirths())
NODES = 30


@pytest.fixture(autouse=True)
def precise(double: None) -> None:
    """Double precision."""


def crowd(seed: int, relaxation: Relaxation = HARD, **values: float) -> Context:
    rng = np.random.default_rng(seed)
    weights = np.ones(NODES) if relaxation.births == "whole" else rng.uniform(0.1, 1.0, NODES)
    positions = rng.uniform(-3.5, 3.5, (NODES, 2))
    colony = colony_of(positions, random_tree(rng, NODES), weights, numerics=NUMERICS, step=50, seed=seed)
    fed = np.pad(rng.uniform(0.1, 0.6, NODES), (0, 34), constant_values=5.0)
    seen = {"growth_rate": jnp.asarray(np.average(fed, weights=colony.weights)), "local_nutrient": jnp.asarray(fed)}
    return context_of(colony, NUMERICS, relaxation, PATCHES.complete(Parameters(**values)), **seen)


@eqx.filter_jit
def births_by(rule: BirthRule, context: Context) -> Births:
    return rule.births(context)


def mothers(births: Births) -> list[int]:
    return np.asarray(births.parents)[np.asarray(births.weights) > 0].tolist()


# --- patches -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["whole", "fractional"])
def test_one_patch_that_holds_all_is_the_source(relaxation: Relaxation) -> None:
    context = crowd(0, relaxation, patch=40.0)
    ours, source = births_by(PatchBirths(), context), births_by(GlobalBirths(), context)
    np.testing.assert_array_equal(ours.parents, source.parents)
    np.testing.assert_allclose(ours.weights, source.weights, atol=1e-12)
    assert ours.event == source.event


@pytest.mark.parametrize("least", [0.0, 0.3])
def test_patches_have_the_parents_of_the_plain_reading(least: float) -> None:
    for seed in range(5):
        context = crowd(seed, patch=2.0, least_nutrient=least)
        positions, fed = np.asarray(context.colony.positions)[:NODES], np.asarray(context.local_nutrient)[:NODES]
        assert mothers(births_by(PatchBirths(), context)) == plain.patch_parents(positions, fed, 2.0, least)


def test_fractional_births_add_up_and_stay_below_their_parents() -> None:
    context = crowd(1, Relaxation(), patch=2.0)
    births, w = births_by(PatchBirths(), context), np.asarray(context.living)
    assert (np.asarray(births.weights) <= w[np.asarray(births.parents)] + 1e-12).all()
    shares = eqx.filter_jit(apportioned)
    whole = shares(jnp.array([0.3, 1.6, 2.0, 0.9]), jnp.array([1.0, 3.0, 2.0, 2.0]), HARD)
    assert whole.tolist() == [0, 2, 2, 1]
    part = shares(jnp.array([0.3, 1.6, 2.0, 0.9]), jnp.array([1.0, 3.0, 2.0, 2.0]), Relaxation())
    assert float(np.sum(part)) == pytest.approx(4.8 + 0.5)
    full = shares(jnp.array([2.0, 2.8]), jnp.array([2.0, 3.0]), Relaxation())
    assert full.tolist() == pytest.approx([2.0, 3.0])


def test_births_by_patches_are_differentiable_in_weights_and_nutrient() -> None:
    context = crowd(2, Relaxation(), patch=3.0)

    @jax.jit
    def mean_place(t: Array) -> Array:
        fed = context.local_nutrient + t * jnp.sin(jnp.arange(64.0))
        births = PatchBirths().births(dataclasses.replace(context, local_nutrient=fed))
        return jnp.sum(births.weights[:, None] * context.colony.positions[births.parents])

    exact, h = jax.grad(mean_place)(jnp.asarray(0.0)), 1e-6
    differences = (float(mean_place(jnp.asarray(h))) - float(mean_place(jnp.asarray(-h)))) / (2 * h)
    assert float(exact) == pytest.approx(differences, rel=1e-5)


# --- clocks --------------------------------------------------------------------------------------------------------


def grown(variation: float, steps: int, numerics: Numerics, seeds: int = 1, nutrient: float = 1.0) -> Colony:
    """Colonies that only bud, in one nutrient."""
    parameters, rule = CLOCKS.complete(Parameters(cycle_variation=variation)), ClockBirths()

    def step(colony: Colony, _: None) -> tuple[Colony, Array]:
        seen = dataclasses.replace(colony, step=colony.step + 1)
        context = context_of(seen, numerics, HARD, parameters, local_nutrient=jnp.full(colony.weights.shape, nutrient))
        advanced = dataclasses.replace(seen, node_state=rule.advance(context))
        context = dataclasses.replace(context, colony=advanced)
        after = jax.lax.cond(
            rule.due(context),
            lambda: bud(context, rule.births(context), UniformBudding(), rule.node_state()),
            lambda: advanced,
        )
        return after, after.count

    @eqx.filter_jit
    def run(keys: Array) -> tuple[Colony, Array]:
        return jax.vmap(lambda key: jax.lax.scan(step, CLOCKS.start(key, numerics), None, length=steps))(keys)

    colony, counts = run(jax.random.split(jax.random.key(7), seeds))
    return eqx.tree_at(lambda c: c.count, colony, counts)


def test_without_variation_a_colony_doubles_every_ln_2() -> None:
    numerics = Numerics(domain=4.0, spacing=1.0, dt=0.02, capacity=300)
    counts = np.asarray(grown(0.0, 240, numerics).count)[0]
    times = 0.02 * np.arange(1, 241)
    np.testing.assert_array_equal(counts, 2 ** (1 + np.floor(times / np.log(2) + 1e-9)).astype(int))


@pytest.mark.thorough
def test_with_variation_it_grows_at_the_rate_of_euler_and_lotka() -> None:
    """Slope of log mean count over 64 colonies, once the founders' phases are forgotten."""
    numerics = Numerics(domain=4.0, spacing=1.0, dt=0.02, capacity=700)
    counts = np.asarray(grown(0.4, 260, numerics, seeds=64).count).astype(float)
    first, last = counts[:, 129], counts[:, 259]
    assert last.max() < 700
    ratios = np.log(last.mean() / first.mean()) / 2.6
    jackknife = [np.log(np.delete(last, i).mean() / np.delete(first, i).mean()) / 2.6 for i in range(64)]
    error = np.sqrt(63 / 64 * np.sum((jackknife - np.mean(jackknife)) ** 2))
    expected = plain.euler_lotka(0.4)
    assert expected == pytest.approx(0.95, abs=0.08)  # not ln 2 / ln 2 = 1
    assert error < 0.02
    assert abs(ratios - expected) < 4 * error


def test_who_has_waited_for_nutrient_buds_once() -> None:
    """Beyond the end of the cycle nothing is saved up: the child and its mother begin a cycle."""
    colony = crowd(3).colony
    state = {"phase": jnp.full(64, 3.0), "cycles": jnp.zeros(64)}
    waited = dataclasses.replace(colony, node_state=state)
    context = context_of(waited, NUMERICS, HARD, CLOCKS.complete(Parameters()))
    births = eqx.filter_jit(ClockBirths().births)(context)
    fed = np.asarray(context.local_nutrient)[:NODES]
    assert (np.asarray(births.newborn["phase"])[:NODES] <= NUMERICS.dt * fed).all()


@pytest.mark.parametrize("least", [0.0, 0.35])
def test_clocks_tick_as_the_plain_reading_s(least: float) -> None:
    rng, rule = np.random.default_rng(3), ClockBirths()
    colony = crowd(3).colony
    phase = jnp.asarray(np.pad(rng.uniform(0.2, 0.9, NODES), (0, 34)))
    colony = dataclasses.replace(colony, node_state={"phase": phase, "cycles": jnp.asarray(np.zeros(64))})
    fed = jnp.asarray(np.pad(rng.uniform(0.1, 1.0, NODES), (0, 34)))
    parameters = CLOCKS.complete(Parameters(cycle_variation=0.3, least_nutrient=least))

    @eqx.filter_jit
    def one_step(context: Context) -> tuple[Colony, Array, Array]:
        """After it, and lengths of cycles before and after."""
        advanced = dataclasses.replace(context.colony, node_state=rule.advance(context))
        context = dataclasses.replace(context, colony=advanced)
        after = bud(context, rule.births(context), UniformBudding(), rule.node_state())
        return after, rule._length(context), rule._length(dataclasses.replace(context, colony=after))

    after, *both = one_step(context_of(colony, NUMERICS, HARD, parameters, local_nutrient=fed))
    lengths, again = (np.asarray(one)[:NODES] for one in both)
    phases, ripe = plain.clock_step(np.asarray(phase)[:NODES], lengths, np.asarray(fed)[:NODES], 0.02, least)
    assert 3 < len(ripe) < NODES
    assert int(after.count) == NODES + len(ripe)
    np.testing.assert_array_equal(np.asarray(after.parents)[NODES : after.count], ripe)
    np.testing.assert_allclose(np.asarray(after.node_state["phase"])[: after.count], phases, atol=1e-12)
    cycles = np.asarray(after.node_state["cycles"])
    np.testing.assert_array_equal(np.flatnonzero(cycles), ripe)
    changed = np.flatnonzero(again != lengths)
    np.testing.assert_array_equal(changed, ripe)  # a new cycle has a length of its own
