"""Compiled springs and compiled readings of the nutrient: the numbers of the plain ones."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, random_tree
from jaxtyping import Array

from yeastfit.model.colony import Colony
from yeastfit.model.compiled.interpolation import compiled_gradient_at, compiled_nutrient_at
from yeastfit.model.compiled.ranking import CompiledGlobalBirths
from yeastfit.model.compiled.springs import compiled_springs
from yeastfit.model.interpolation import gradient_at, nutrient_at
from yeastfit.model.laws.forces import springs
from yeastfit.model.laws.growth import GlobalBirths
from yeastfit.model.numerics import Numerics

pytest.importorskip("numba")

NODES = 400
NUMERICS = Numerics(domain=20.0, spacing=0.4, capacity=520)  # more room than 500: read corner by corner
Reading = Callable[[Colony, Numerics], Array]


@pytest.fixture
def colony() -> Colony:
    """A random tree in three parts, with coincident nodes, nodes on lines of the grid and beyond the dish."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-11.0, 11.0, (NODES, 2))
    at[50:90] = 0.4 * rng.integers(-25, 26, (40, 2))
    at[90:100] = at[80:90]
    tree = random_tree(rng, NODES)
    tree[95] = 85
    tree[[100, 200]] = -1
    nutrient = rng.uniform(size=(NUMERICS.points,) * 2)
    return colony_of(at, tree, rng.uniform(0.1, 1.0, NODES), nutrient, numerics=NUMERICS)


def compared(ours: Array, plain: Array, single: float, double: float) -> None:
    assert ours.dtype == plain.dtype
    tolerance = single if ours.dtype == jnp.float32 else double
    np.testing.assert_allclose(ours, plain, atol=tolerance * float(np.abs(plain).max()))
    assert np.abs(ours).max() > 0.1


@pytest.mark.parametrize("precision", ["single", "double"])
def test_springs(precision: str, request: pytest.FixtureRequest) -> None:
    if precision == "double":
        request.getfixturevalue("double")
    colony = request.getfixturevalue("colony")
    ours, plain = (eqx.filter_jit(pull)(colony) for pull in (compiled_springs, springs))
    compared(ours, plain, 2e-5, 1e-12)
    assert (np.asarray(ours)[NODES:] == 0).all()


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(
    "readings", [(compiled_nutrient_at, nutrient_at), (compiled_gradient_at, gradient_at)], ids=["nutrient", "gradient"]
)
def test_readings(readings: tuple[Reading, Reading], precision: str, request: pytest.FixtureRequest) -> None:
    if precision == "double":
        request.getfixturevalue("double")
    colony = request.getfixturevalue("colony")
    ours, plain = (eqx.filter_jit(read)(colony, NUMERICS) for read in readings)
    compared(ours[:NODES], plain[:NODES], 2e-5, 1e-10)
    assert (np.asarray(ours)[NODES:] == 0).all()


def test_nodes_that_are_nowhere_read_nothing(colony: Colony) -> None:
    """Their nutrient is no number, so that the colony is seen to be lost; the others' is what it was."""
    positions = np.array(colony.positions)
    positions[7:9] = [[np.nan, 0.0], [0.0, np.inf]]
    lost = eqx.tree_at(lambda one: one.positions, colony, jnp.asarray(positions))
    kept = np.delete(np.arange(NODES), [7, 8])
    for read in (compiled_nutrient_at, compiled_gradient_at):
        reading = eqx.filter_jit(read)
        found, before = (np.asarray(reading(one, NUMERICS)) for one in (lost, colony))
        np.testing.assert_array_equal(found[kept], before[kept])
        assert not np.isfinite(found[7:9]).all()


@pytest.mark.parametrize("precision", ["single", "double"])
def test_ranking(precision: str, request: pytest.FixtureRequest) -> None:
    """The same order, of equal ones and of what is infinite or no number, too."""
    if precision == "double":
        request.getfixturevalue("double")
    rng = np.random.default_rng(1)
    hunger = np.concatenate([-rng.uniform(size=300), rng.choice([-0.5, -0.0, 0.0], 300), np.full(80, np.inf)])
    hunger[[5, 70]] = np.nan
    given = jnp.asarray(rng.permutation(hunger))
    ours, plain = (eqx.filter_jit(rule.ranking)(given) for rule in (CompiledGlobalBirths(), GlobalBirths()))
    assert ours.dtype == plain.dtype
    np.testing.assert_array_equal(ours, plain)
