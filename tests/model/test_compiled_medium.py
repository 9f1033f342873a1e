"""The compiled step of the nutrient: the numbers of `eaten`, and work at the rim only."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, random_tree
from jaxtyping import Array

from yeastfit.model.cells import LARGEST, cells_of
from yeastfit.model.colony import Colony
from yeastfit.model.compiled.eating import TILE
from yeastfit.model.compiled.exponentials import falling_exponential, logarithm
from yeastfit.model.compiled.medium import CompiledOneNutrient
from yeastfit.model.compiled.nitrogen import CompiledNitrogenMedium
from yeastfit.model.compiled.rules import with_compiled_rules
from yeastfit.model.compiled.superellipses import squared_norms
from yeastfit.model.laws.medium import Boundary, OneNutrient
from yeastfit.model.laws.shape import EllipticalCells
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.mechanisms.nitrogen_medium import NitrogenMedium
from yeastfit.model.mechanisms.superelliptical_cells import SuperellipticalCells
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.rules import ShapeRule, UptakeRule

pytest.importorskip("numba")

NODES, ROOM = 200, 220
GRIDS = {"coarse": Numerics(40.0, 0.4, 0.025, ROOM), "fine": Numerics(24.0, 0.15, 0.02, ROOM)}
LAWS = pytest.mark.parametrize("relaxation", [HARD, Relaxation(), Relaxation(union=0.3)], ids=["hard", "soft", "wide"])
ELLIPSES = EllipticalCells()
SHAPES = pytest.mark.parametrize("shape", [ELLIPSES, SuperellipticalCells()], ids=["ellipses", "blocky"])
EXPONENT = 5.0
VALUES = {"mobility": 1.3, "metabolic_rate": 3.0, "aspect_ratio": 0.65}
PLACES: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "one heap": lambda rng: rng.normal(0.0, 0.8, (NODES, 2)),
    "spread, and beyond the dish": lambda rng: rng.uniform(-21.0, 21.0, (NODES, 2)),
    "filaments": lambda rng: np.linspace(0.0, 9.0, NODES)[:, None] * rng.choice([-1.0, 0.3, 1.0], (NODES, 2)),
}


def crowd(positions: np.ndarray, numerics: Numerics, seed: int = 0) -> Colony:
    """A chain of cells, some of them long, of random weights and some of none, in nutrient with a hole."""
    rng = np.random.default_rng(seed)
    tree = np.where(rng.uniform(size=NODES) < 0.8, np.arange(NODES) - 1, random_tree(rng, NODES))
    weights = rng.choice([0.0, 0.3, 1.0], NODES)
    axis = np.abs(np.linspace(-20.0, 20.0, numerics.points))
    nutrient = np.clip(np.maximum(axis[:, None], axis) - 5.0, 0.0, 1.0) * rng.uniform(0.9, 1.0)
    nutrient[np.maximum(axis[:, None], axis) > 11.0] = 1.0
    return colony_of(positions, tree, weights, nutrient, numerics=numerics)


@eqx.filter_jit
def fed(
    colony: Colony,
    relaxation: Relaxation,
    numerics: Numerics,
    medium: OneNutrient,
    uptake: UptakeRule,
    shape: ShapeRule = ELLIPSES,
) -> Array:
    """The nutrient after three steps."""
    parameters = Parameters(**VALUES, shape_exponent=EXPONENT)  # in the precision of the test

    def one(_: Array, colony: Colony) -> Colony:
        context = context_of(colony, numerics, relaxation, parameters)
        return medium.stepped(context, shape.cells(colony, parameters), uptake)

    return jax.lax.fori_loop(0, 3, one, colony).nutrient


def compare(
    colony: Colony,
    relaxation: Relaxation,
    numerics: Numerics,
    tolerance: float,
    shape: ShapeRule = ELLIPSES,
) -> None:
    ours, plain = (
        fed(colony, relaxation, numerics, medium, BiomassUptake(), shape)
        for medium in (CompiledOneNutrient(), OneNutrient())
    )
    assert ours.dtype == plain.dtype == colony.nutrient.dtype
    np.testing.assert_allclose(ours, plain, atol=tolerance)
    assert np.abs(np.asarray(ours) - np.asarray(colony.nutrient)).max() > 0.01


@pytest.mark.thorough
@LAWS
@SHAPES
@pytest.mark.parametrize("grid", GRIDS)
def test_it_is_the_step_of_the_medium(grid: str, shape: ShapeRule, relaxation: Relaxation, double: None) -> None:
    numerics = GRIDS[grid]
    for seed, places in enumerate(PLACES.values()):
        compare(crowd(places(np.random.default_rng(seed)), numerics, seed), relaxation, numerics, 1e-10, shape)


@LAWS
@SHAPES
def test_in_single_precision_the_last_bits_differ(shape: ShapeRule, relaxation: Relaxation) -> None:
    numerics = GRIDS["coarse"]
    for seed, places in enumerate(PLACES.values()):
        compare(crowd(places(np.random.default_rng(seed)), numerics, seed), relaxation, numerics, 2e-5, shape)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1.5e-7), (np.float64, 1e-15)])
def test_exponentials_are_exact_to_the_last_bits(dtype: type, tolerance: float) -> None:
    given: np.ndarray = np.linspace(-LARGEST, LARGEST, 100_001).astype(dtype)
    found = given.copy()
    falling_exponential(found, len(given) - 1)
    np.testing.assert_allclose(found[:-1], np.exp(-given[:-1].astype(float)), rtol=tolerance)
    assert found[-1] == given[-1]


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 2e-7), (np.float64, 1e-15)])
def test_logarithms_are_exact_to_the_last_bits(dtype: type, tolerance: float) -> None:
    """Of all sizes, and next to 1, where a logarithm is about as large as the difference."""
    near = 1.0 + np.linspace(-0.01, 0.01, 20_001)
    given: np.ndarray = np.concatenate([np.exp(np.linspace(-87.0, 88.0, 100_000)), near, [7.0]]).astype(dtype)
    found = given.copy()
    logarithm(found, len(given) - 1)
    np.testing.assert_allclose(found[:-1], np.log(given[:-1].astype(float)), rtol=tolerance)
    assert found[-1] == given[-1]


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-6), (np.float64, 1e-14)])
def test_squared_norms_are_those_of_cells(dtype: type, tolerance: float) -> None:
    """Down to the axes and the centre, of all exponents and of their duals; of n = 2 that of Pythagoras."""
    rng = np.random.default_rng(0)
    u, v = rng.normal(0.0, 2.0, (2, 4000)) * rng.choice([0.0, 1e-6, 1.0], (2, 4000))
    n = np.concatenate([np.full(1000, 2.0), rng.uniform(2.0, 50.0, 2000), rng.uniform(1.02, 2.0, 1000)])
    given: list[np.ndarray] = [one.astype(dtype) for one in (u**2, v**2, n)]
    first, second, exponents = given
    precision = float(np.finfo(dtype).eps)
    squared_norms(first, second, exponents, 4000)
    larger = np.maximum(np.abs(u), np.abs(v))
    ratio = np.divide(np.minimum(np.abs(u), np.abs(v)), larger, out=np.zeros(4000), where=larger > 0)
    np.testing.assert_allclose(first, larger**2 * (1.0 + ratio**n) ** (2.0 / n), rtol=tolerance, atol=precision)
    np.testing.assert_allclose(first[:1000], (u**2 + v**2)[:1000], rtol=tolerance, atol=precision)


def test_nothing_is_done_where_nutrient_is_gone_or_untouched() -> None:
    """A disc of cells that have eaten all inside: there nutrient keeps its bits, and it is what the plain step has."""
    numerics, rng = Numerics(120.0, 0.4, 0.025, ROOM), np.random.default_rng(3)
    axis = np.linspace(-60.0, 60.0, numerics.points)
    distance = np.hypot(axis[:, None], axis)
    nutrient = np.maximum(np.clip((distance - 32.0) / 8.0, 0.0, 1.0), 1e-12).astype(np.float32)
    angle, radius = rng.uniform(0.0, 2.0 * np.pi, NODES), 39.0 * np.sqrt(rng.uniform(size=NODES))
    at = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    colony = colony_of(at, np.arange(NODES) - 1, nutrient=nutrient, numerics=numerics)
    compare(colony, Relaxation(), numerics, 2e-6)
    ours = np.asarray(fed(colony, Relaxation(), numerics, CompiledOneNutrient(), BiomassUptake()))
    far = (2.0 * np.sqrt(2.0) * TILE + 8) * numerics.spacing  # two tiles along their diagonal, and what three steps see
    quiet = (distance < 32.0 - far) | (distance > 40.0 + far)
    assert quiet.mean() > 0.2
    np.testing.assert_array_equal(ours[quiet], nutrient[quiet])
    assert (ours != nutrient)[(distance > 33.0) & (distance < 39.0)].mean() > 0.9


def test_cells_that_are_nowhere_eat_nothing() -> None:
    """Where positions are not finite the colony is lost, and is said to be; the process is not."""
    numerics = GRIDS["coarse"]
    colony = crowd(PLACES["one heap"](np.random.default_rng(4)), numerics)
    positions, weights = np.array(colony.positions), np.array(colony.weights)
    positions[7:9], weights[7:9] = [np.nan, np.inf], 0.0
    lost = eqx.tree_at(lambda one: one.positions, colony, jnp.asarray(positions))
    without = eqx.tree_at(lambda one: one.weights, colony, jnp.asarray(weights))
    found, expected = (
        fed(one, Relaxation(), numerics, CompiledOneNutrient(), BiomassUptake()) for one in (lost, without)
    )
    np.testing.assert_array_equal(found, expected)


class HalfUptake(BiomassUptake):
    """Another rule, which eats half as much."""

    name = "half"

    def rate(self, context, level_set, nutrient):
        return 0.5 * super().rate(context, level_set, nutrient)


def test_another_uptake_is_asked() -> None:
    numerics = GRIDS["coarse"]
    colony = crowd(PLACES["spread, and beyond the dish"](np.random.default_rng(5)), numerics)
    ours, plain = (fed(colony, HARD, numerics, one, HalfUptake()) for one in (CompiledOneNutrient(), OneNutrient()))
    np.testing.assert_array_equal(ours, plain)
    usual = fed(colony, HARD, numerics, OneNutrient(), BiomassUptake())
    assert np.abs(np.asarray(ours) - np.asarray(usual)).max() > 0.01


def test_it_has_no_derivative() -> None:
    numerics = GRIDS["coarse"]
    colony = crowd(PLACES["one heap"](np.random.default_rng(5)), numerics)

    def eaten(nutrient: Array) -> Array:
        changed = eqx.tree_at(lambda one: one.nutrient, colony, nutrient)
        return fed(changed, Relaxation(), numerics, CompiledOneNutrient(), BiomassUptake())

    with pytest.raises(ValueError, match="cannot be differentiated"):
        jax.grad(lambda nutrient: eaten(nutrient).sum())(colony.nutrient)


@pytest.mark.thorough
@pytest.mark.parametrize(("boundary", "carbon"), [("dish", "reservoir"), ("reservoir", "reservoir"), ("dish", "dish")])
@pytest.mark.parametrize("uptake", [0.0, 2.0])
@pytest.mark.parametrize("places", ["filaments", "spread, and beyond the dish"])
def test_nitrogen_is_eaten_as_by_the_plain_rule(
    places: str, boundary: Boundary, carbon: Boundary, uptake: float
) -> None:
    """Both nutrients, drift and supply, with nitrogen lowered by births; nobody eats it where its uptake is 0.

    Filaments do not feel the wall of the dish, cells that are spread do.
    """
    numerics = Numerics(40.0, 0.4, 0.025, ROOM)
    rules = CompiledNitrogenMedium(boundary, carbon), NitrogenMedium(boundary, carbon)
    given = {**VALUES, "nitrogen_uptake": uptake, "nitrogen_per_birth": 5.0, "nitrogen_mobility": 0.7}
    parameters = Model(medium=rules[1]).complete(Parameters(**given))
    bare = crowd(PLACES[places](np.random.default_rng(6)), numerics)
    nitrogen = jnp.full_like(bare.nutrient, 0.6)
    colony = eqx.tree_at(lambda one: one.medium, bare, {"nitrogen": nitrogen}, is_leaf=lambda x: x is bare.medium)

    @eqx.filter_jit
    def asked(rule: NitrogenMedium) -> tuple[Array, ...]:
        def one(_: Array, colony: Colony) -> Colony:
            context = context_of(colony, numerics, Relaxation(), parameters)
            return rule.stepped(context, cells_of(colony, parameters.aspect_ratio), BiomassUptake())

        after = jax.lax.fori_loop(0, 3, one, colony)
        context = context_of(after, numerics, Relaxation(), parameters)
        fed = rule.supply(after, parameters, Relaxation(), numerics)[:NODES]
        return after.nutrient, after.medium["nitrogen"], fed, rule.drift(context)[:NODES]

    ours, plain = asked(rules[0]), asked(rules[1])
    for one, other, tolerance in zip(ours, plain, (2e-5, 2e-6, 1e-5, 1e-4), strict=True):
        np.testing.assert_allclose(one, other, atol=tolerance)
    assert jnp.all(ours[1] == 0.6) if uptake == 0.0 else jnp.min(ours[1]) < 0.55


def test_a_rule_keeps_its_settings_when_it_is_compiled() -> None:
    found = with_compiled_rules(Model(medium=NitrogenMedium("reservoir", "dish"))).medium
    assert type(found) is CompiledNitrogenMedium
    assert (found.boundary, found.carbon_boundary) == ("reservoir", "dish")
