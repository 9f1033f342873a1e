"""Who buds, when and where: counts, order, lineages, capacity, and what is continuous."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, random_tree
from jaxtyping import Array
from scipy import stats

from yeastfit.model.colony import Colony
from yeastfit.model.interpolation import growth_rate
from yeastfit.model.laws.budding import UniformBudding, bud, uniform_angles
from yeastfit.model.laws.growth import GlobalBirths, number_of_births
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import HARD, Relaxation

NODES = 30
NUMERICS = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=64)
TIGHT = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=35)
FRACTIONAL = Relaxation()
RULES = pytest.mark.parametrize("relaxation", [HARD, FRACTIONAL], ids=["whole", "fractional"])


def budded(colony: Colony, mu: Array, fed: Array, relaxation: Relaxation, numerics: Numerics = NUMERICS) -> Colony:
    """One event of nodes that are fed like this."""
    context = context_of(colony, numerics, relaxation, growth_rate=mu, local_nutrient=fed)
    return bud(context, GlobalBirths().births(context), UniformBudding(), {})


_bud, births_of = eqx.filter_jit(budded), eqx.filter_jit(number_of_births)


def crowd(seed: int, numerics: Numerics = NUMERICS, whole: bool = False, event: int = 3) -> Colony:
    rng = np.random.default_rng(seed)
    weights = np.ones(NODES) if whole else rng.choice([1.0, 0.3, 1e-3], NODES) * rng.uniform(0.1, 1.0, NODES)
    positions = rng.uniform(-2, 2, (NODES, 2))
    return colony_of(positions, random_tree(rng, NODES), weights, numerics=numerics, step=50 * event, seed=seed)


def food(seed: int, numerics: Numerics = NUMERICS) -> Array:
    """Nutrient at the nodes; most in the empty slots, which must not bud."""
    fed = np.random.default_rng(100 + seed).uniform(0.1, 0.9, numerics.room)
    fed[NODES:] = 5.0
    return jnp.asarray(fed)


def there(values: Array, places: np.ndarray) -> Array:
    """Some of them, or in another order."""
    return jnp.asarray(np.asarray(values)[places])


def after(colony: Colony, mu: float, fed: Array, relaxation: Relaxation, numerics: Numerics = NUMERICS) -> Colony:
    return _bud(colony, jnp.asarray(mu), fed, relaxation, numerics)


@pytest.mark.parametrize(
    ("mu", "nodes", "whole", "fractional"),
    [
        (np.log(1.25), 8.0, 2.0, 2.5),
        (np.log(1.26), 8.0, 3.0, 2.58),
        (0.0, 8.0, 0.0, 0.5),
        (0.9, 8.0, 8.0, 8.0),
        (np.log(1.95), 8.0, 8.0, 8.0),
    ],
)
def test_number_of_births(mu: float, nodes: float, whole: float, fractional: float, double: None) -> None:
    """⌈(e^μ − 1) W⌉ or (e^μ − 1) W + ½, at most W."""
    exactly = mu - 1e-12 if mu == np.log(1.25) else mu
    assert float(births_of(jnp.asarray(exactly), jnp.asarray(nodes), HARD)) == whole
    assert float(births_of(jnp.asarray(mu), jnp.asarray(nodes), FRACTIONAL)) == pytest.approx(fractional, abs=1e-12)


def test_half_a_birth_is_the_mean_of_the_ceiling(double: None) -> None:
    """Over growths spread evenly, whole and fractional births have the same mean, where the cap does not bind."""
    mus = jnp.asarray(np.log1p(np.linspace(0.1, 0.9, 8001)[:-1]))
    whole, fractional = (
        np.asarray(jax.jit(jax.vmap(lambda mu, r=r: number_of_births(mu, jnp.asarray(100.0), r)))(mus))
        for r in (HARD, FRACTIONAL)
    )
    assert float(whole.mean()) == pytest.approx(float(fractional.mean()), abs=0.01)


def test_growth_rate_is_the_weighted_mean(double: None) -> None:
    fed, weights = jnp.array([0.2, 0.8, 7.0]), jnp.array([1.0, 0.5, 0.0])
    assert float(jax.jit(growth_rate)(fed, weights)) == pytest.approx(0.4)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5, 0.69, 0.9])
def test_weights_of_children_sum_to_the_births(seed: int, mu: float, double: None) -> None:
    colony = crowd(seed)
    total = float(np.sum(colony.weights))
    born = np.asarray(after(colony, mu, food(seed), FRACTIONAL).weights)[NODES:]
    assert float(np.sum(born)) == pytest.approx(min(np.expm1(mu) * total + 0.5, total), abs=1e-13 * total)


@pytest.mark.parametrize("seed", range(4))
def test_best_fed_nodes_bud_in_order(seed: int, double: None) -> None:
    """clip(B − S_i, 0, w_i): whole shares for the best fed, what is left for the last, nothing beyond."""
    colony, mu = crowd(seed), 0.4
    grown = after(colony, mu, food(seed), FRACTIONAL)
    order = np.argsort(-np.asarray(food(seed))[:NODES])
    born = int(grown.count) - NODES
    assert (np.asarray(grown.parents)[NODES : NODES + born] == order[:born]).all()
    shares, weights = np.asarray(grown.weights)[NODES : NODES + born], np.asarray(colony.weights)[order[:born]]
    np.testing.assert_allclose(shares[:-1], weights[:-1], atol=1e-14)
    assert 0 < shares[-1] <= weights[-1]
    assert (np.asarray(grown.weights)[NODES + born :] == 0).all()
    assert (np.asarray(grown.parents)[NODES + born :] == -1).all()


def test_whole_births_are_the_ceiling(double: None) -> None:
    colony = crowd(0, whole=True)
    grown = after(colony, np.log(1.21), food(0), HARD)
    assert int(grown.count) - NODES == 7
    assert np.asarray(grown.weights)[: int(grown.count)].tolist() == [1.0] * 37
    best = np.argsort(-np.asarray(food(0))[:NODES])[:7]
    assert (np.asarray(grown.parents)[NODES:37] == best).all()


@RULES
def test_what_is_there_stays(relaxation: Relaxation) -> None:
    colony = crowd(1, whole=True)
    grown = after(colony, 0.5, food(1), relaxation)
    for name in ("positions", "parents", "weights", "lineages"):
        now, before = (np.asarray(getattr(one, name))[:NODES] for one in (grown, colony))
        np.testing.assert_array_equal(now, before)
    np.testing.assert_array_equal(grown.nutrient, colony.nutrient)
    assert int(grown.step) == int(colony.step)


@RULES
def test_capacity_is_kept_and_said_to_be_reached(relaxation: Relaxation) -> None:
    """The best fed get the slots that are left; the flag stays once it is up."""
    colony, fed = crowd(2, TIGHT, whole=True), food(2, TIGHT)
    enough = after(colony, np.log(1.14), fed, relaxation, TIGHT)  # 4.2 births: 5 whole, or 4 and a share
    assert int(enough.count) == 35
    assert not bool(enough.problems.capacity_reached)
    full = after(colony, 0.5, fed, relaxation, TIGHT)
    assert int(full.count) == 35
    assert bool(full.problems.capacity_reached)
    assert (np.asarray(full.parents)[NODES:] == np.argsort(-np.asarray(fed)[:NODES])[:5]).all()
    again = after(eqx.tree_at(lambda c: c.problems, colony, full.problems), np.log(1.14), fed, relaxation, TIGHT)
    assert bool(again.problems.capacity_reached)


def test_children_appear_at_the_budding_distance() -> None:
    grown = after(crowd(3, whole=True), 0.6, food(3), HARD)
    children = np.arange(NODES, int(grown.count))
    offsets = np.asarray(grown.positions)[children] - np.asarray(grown.positions)[np.asarray(grown.parents)[children]]
    np.testing.assert_allclose(np.hypot(*offsets.T), 0.01, rtol=1e-4)  # single precision of positions up to 2


@RULES
def test_a_childs_place_depends_on_its_lineage_and_not_on_slots(relaxation: Relaxation, double: None) -> None:
    colony, fed = crowd(4), food(4)
    shuffled = np.append(np.random.default_rng(0).permutation(NODES), np.arange(NODES, 64))
    back = np.argsort(shuffled)
    parents = np.asarray(colony.parents)[shuffled]
    moved = dataclasses.replace(
        colony,
        positions=there(colony.positions, shuffled),
        weights=there(colony.weights, shuffled),
        lineages=there(colony.lineages, shuffled),
        parents=jnp.asarray(np.where(colony.alive, back[np.maximum(parents, 0)], -1).astype(parents.dtype)),
    )
    one, other = after(colony, 0.4, fed, relaxation), after(moved, 0.4, there(fed, shuffled), relaxation)
    assert int(one.count) == int(other.count) > NODES
    children = np.arange(NODES, int(one.count))
    np.testing.assert_array_equal(shuffled[np.asarray(other.parents)[children]], np.asarray(one.parents)[children])
    np.testing.assert_array_equal(there(other.lineages, children), there(one.lineages, children))
    np.testing.assert_array_equal(there(other.positions, children), there(one.positions, children))
    np.testing.assert_allclose(there(other.weights, children), there(one.weights, children), atol=1e-13)


def test_lineages_never_repeat_and_angles_are_uniform() -> None:
    """All descendants of 30 nodes over 7 events at full growth: 3810 draws."""
    numerics = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=NODES * 2**7)
    colony = crowd(5, numerics, whole=True)
    for event in range(1, 8):
        colony = eqx.tree_at(lambda c: c.step, colony, jnp.asarray(50 * event))
        colony = after(colony, 1.0, food(5, numerics), HARD, numerics)
    assert int(colony.count) == NODES * 2**7
    assert len(np.unique(np.asarray(colony.lineages), axis=0)) == NODES * 2**7
    nodes = np.asarray(jax.jit(uniform_angles)(colony.lineages))
    angles, parents = nodes[NODES:], np.asarray(colony.parents)[NODES:]
    assert stats.kstest(angles, stats.uniform(0, 2 * np.pi).cdf).pvalue > 0.01
    related = stats.pearsonr(np.cos(angles), np.cos(nodes[parents]))
    assert related.pvalue > 0.01


def test_a_parents_buds_of_two_events_differ() -> None:
    angles = [
        np.asarray(after(crowd(6, whole=True, event=event), 1.0, food(6), HARD).positions)[NODES : 2 * NODES]
        for event in (3, 4)
    ]
    assert (np.abs(angles[0] - angles[1]).max(axis=1) > 1e-5).all()


def test_births_are_continuous_in_growth(double: None) -> None:
    """Every weight moves by no more than the births do, where a further child comes in as elsewhere."""
    colony, fed = crowd(7), food(7)
    weights = np.array([np.asarray(after(colony, mu, fed, FRACTIONAL).weights) for mu in np.linspace(0.2, 0.6, 400)])
    births_between = np.diff(weights.sum(axis=1))
    assert (births_between > 0).all()
    np.testing.assert_allclose(np.abs(np.diff(weights, axis=0)).sum(axis=1), births_between, rtol=1e-9)
    assert len(np.unique((weights > 0).sum(axis=1))) > 5


def test_derivative_of_births(double: None) -> None:
    """dB/dμ = e^μ W, all of it on the last child."""
    colony, fed = crowd(8), food(8)

    @jax.jit
    def births(mu: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda mu: budded(colony, mu, fed, FRACTIONAL, NUMERICS).weights, (mu,), (jnp.ones(()),))

    value, slope = map(np.asarray, births(jnp.asarray(0.4)))
    total = float(np.sum(colony.weights))
    assert float(np.sum(slope)) == pytest.approx(np.exp(0.4) * total)
    assert np.flatnonzero(slope).tolist() == [np.flatnonzero(value)[-1]]


def test_no_slot_is_skipped_whatever_the_last_bits_of_a_running_sum() -> None:
    """Nodes fill the slots below `count`, each with a weight, also where the last to bud weigh next to nothing."""
    rng = np.random.default_rng(0)
    numerics = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=256)
    weights = np.where(np.arange(120) < 80, rng.uniform(0.5, 1.0, 120), 10 ** rng.uniform(-7, -5, 120))
    colony = colony_of(rng.uniform(-2, 2, (120, 2)), random_tree(rng, 120), weights, numerics=numerics, step=50)
    fed = jnp.asarray(np.linspace(0.9, 0.1, 256))
    wanted = weights[:80].sum() + rng.uniform(-3e-5, 3e-5, 1000)
    mus = jnp.asarray(np.log1p((wanted - 0.5) / weights.sum()))
    grown = eqx.filter_jit(jax.vmap(lambda mu: budded(colony, mu, fed, FRACTIONAL, numerics)))(mus)
    assert ((np.asarray(grown.weights) > 0) == (np.arange(256) < np.asarray(grown.count)[:, None])).all()
