"""The compiled level set: that of `cells` as far as cells reach, and the statistics that are taken from it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, random_tree
from jaxtyping import Array

from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.cells import FAR
from yeastfit.model.compiled.level_set import CompiledSnapshot
from yeastfit.model.laws.shape import EllipticalCells
from yeastfit.model.mechanisms.superelliptical_cells import SuperellipticalCells
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.snapshot import Snapshot

pytest.importorskip("numba")

NODES, NUMERICS = 300, Numerics(domain=24.0, spacing=0.4, capacity=320)
LAWS = pytest.mark.parametrize(
    "relaxation",
    [HARD, Relaxation(), Relaxation(union=0.3), Relaxation(union=0.0125, boundary=0.5)],
    ids=["hard", "soft", "wide", "narrow union, wide boundary"],
)
GRIDS = pytest.mark.parametrize("grid", [(0.4, 61), (0.1, 151)], ids=["coarse", "fine"])


def snapshot(relaxation: Relaxation, exponent: float = 2.0, seed: int = 0) -> Snapshot:
    """A crowd of cells of all lengths, some of less weight and some of none; superellipses by another exponent."""
    rng = np.random.default_rng(seed)
    at = rng.normal(0.0, 3.0, (NODES, 2))
    colony = colony_of(at, random_tree(rng, NODES), rng.choice([0.0, 0.4, 1.0], NODES), numerics=NUMERICS)
    parameters = Parameters(aspect_ratio=0.5, shape_exponent=exponent)
    cells = (SuperellipticalCells() if exponent > 2 else EllipticalCells()).cells(colony, parameters)
    return Snapshot(cells, jnp.ones(()), colony, parameters, relaxation)


@eqx.filter_jit
def level_set(one: Snapshot, spacing: float, points: int) -> Array:
    return one.level_set(one.relaxation.reach, -0.5 * spacing * (points - 1), spacing, points)


@LAWS
@GRIDS
@pytest.mark.parametrize("exponent", [2.0, 2.5, 8.0])
def test_it_is_that_of_cells(exponent: float, grid: tuple[float, int], relaxation: Relaxation, double: None) -> None:
    """Inside, and outside as far as a cell counts; beyond, cells of the plain one are cut off at other points."""
    plain = snapshot(relaxation, exponent)
    expected, found = (np.asarray(level_set(one, *grid)) for one in (plain, CompiledSnapshot.of(plain)))
    assert found.dtype == expected.dtype
    near = expected < (0.0 if relaxation.union is None else 0.25 * (float(relaxation.reach) - 1.0))
    assert near.any()
    np.testing.assert_allclose(found[near], expected[near], atol=1e-4)
    inside = expected < -0.05
    cut = 0.0 if relaxation.union is None else 3.0 * float(relaxation.union) * np.exp(-12.0)  # of three cells each
    np.testing.assert_allclose(found[inside], expected[inside], atol=cut + 1e-12)
    assert ((found > 0) == (expected > 0)).all()
    assert (found[expected == FAR] == FAR).all()


@pytest.mark.thorough
@LAWS
@pytest.mark.parametrize("estimator", [SmoothStatistics, HardStatistics])
def test_statistics_are_the_same(estimator: type, relaxation: Relaxation) -> None:
    plain, observe = snapshot(relaxation), estimator(extent=20.0, spacing=0.2, statistics=("area", "compactness"))
    found, expected = (
        observe.finish({name: np.asarray(value) for name, value in eqx.filter_jit(observe)(one).items()})
        for one in (CompiledSnapshot.of(plain), plain)
    )
    for name in ("area", "compactness"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-4)
