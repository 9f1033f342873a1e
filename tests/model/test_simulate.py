"""The step against the plain reading in `reference.colony`, its repetition, and the derivative of a trajectory."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import started
from jaxtyping import Array
from scipy import stats

from reference import colony as plain
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model import nutrient as nutrient_module
from yeastfit.model.cells import level_set
from yeastfit.model.colony import Colony, start
from yeastfit.model.laws.budding import child_lineages, uniform_angles
from yeastfit.model.numerics import Numerics, map_members
from yeastfit.model.parameters import PARAMETERS, Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.simulate import Schedule, step, trajectory
from yeastfit.model.snapshot import Snapshot

NUMERICS = Numerics(domain=12.0, spacing=0.2, dt=0.02, capacity=64)
PLAIN = plain.Numerics(domain=12.0, spacing=0.2, dt=0.02, capacity=64)
CASES: dict[str, dict[str, float]] = {
    "the defaults": {},
    "mobile, hungry, slender": {"mobility": 2.5, "metabolic_rate": 3.0, "aspect_ratio": 0.4, "repulsivity": 0.1},
    "stiff, close, round": {"elasticity": 9.0, "repulsion_radius": 0.3, "aspect_ratio": 1.0, "diffusivity": 0.5},
}
SUBSTEPS = "the defaults, three steps of motion in each"
SHORT = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=12)
SAMPLES = (60, 110)  # steps: 10 after the first and the second event
OBSERVE = SmoothStatistics(extent=8.0, spacing=0.2)


@pytest.fixture(scope="module", autouse=True)
def precise() -> Iterator[None]:
    """Double precision, and a nutrient solve that leaves no error to speak of."""
    with jax.enable_x64(True), pytest.MonkeyPatch.context() as patch:
        patch.setattr(nutrient_module, "TOLERANCE", 1e-13)
        yield


# --- the hard step -------------------------------------------------------------------------------------------------


@dataclass
class Comparison:
    """Largest difference between package and reference at every step of one colony; births by event."""

    differences: dict[str, list[float]] = field(default_factory=dict)
    births: list[tuple[list[int], list[int]]] = field(default_factory=list)
    capacity_reached: list[tuple[bool, bool]] = field(default_factory=list)

    def add(self, name: str, ours: np.ndarray | float, theirs: np.ndarray | float) -> None:
        self.differences.setdefault(name, []).append(float(np.abs(np.asarray(ours) - theirs).max(initial=0.0)))


@pytest.fixture(scope="module", params=[*CASES, SUBSTEPS])
def comparison(request: pytest.FixtureRequest) -> Comparison:
    """310 steps and 6 mitosis events; each step of the package is repeated by the reference from the same state."""
    values = {name: info.default for name, info in PARAMETERS.items()} | CASES.get(request.param, {})
    parameters, reference = Parameters(**values), plain.Parameters(**values)
    substeps = 3 if request.param == SUBSTEPS else 1
    numerics, reference_numerics = replace(NUMERICS, substeps=substeps), replace(PLAIN, substeps=substeps)
    colony, found = started(jax.random.key(5), NUMERICS), Comparison()
    for _ in range(310):
        after, g, mu = _hard_step(colony, parameters, numerics)
        before = plain.Colony(*_nodes(colony), np.asarray(colony.nutrient), int(colony.step))
        expected, details = plain.step(before, reference, reference_numerics, _AnglesOf(colony), cg_tolerance=1e-13)

        nodes, slots = len(before.positions), int(after.count)
        positions, parents = _nodes(after)
        # a child is known by its parent: the two readings may break a tie between equally fed parents differently
        ours = np.append(np.arange(nodes), nodes + np.argsort(parents[nodes:]))
        theirs = np.append(np.arange(nodes), nodes + np.argsort(expected.parents[nodes:]))
        found.add("count", slots, len(expected.positions))
        found.add("positions", positions[ours], expected.positions[theirs])
        found.add("parents", parents[ours], expected.parents[theirs])
        found.add("nutrient", np.asarray(after.nutrient), expected.nutrient)
        found.add("growth rate", mu, details["growth_rate"])
        inside = details["level_set"] <= 0
        found.add("level set", g[inside], details["level_set"][inside])
        found.add("colony", (g <= 0).astype(int), inside.astype(int))
        if expected.step % PLAIN.event_interval == 0:
            found.births.append((parents[nodes:].tolist(), details["births"].tolist()))
            found.capacity_reached.append((bool(after.problems.capacity_reached), details["capacity_reached"]))
        colony = after
    return found


@eqx.filter_jit
def _compiled_step(
    colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics
) -> tuple[Colony, Snapshot, Array]:
    after, snapshot = step(colony, parameters, relaxation, numerics)
    g = level_set(snapshot.cells, relaxation.union, relaxation.union_reach, -6.0, 0.2, numerics.points)
    return after, snapshot, g


def _hard_step(colony: Colony, parameters: Parameters, numerics: Numerics) -> tuple[Colony, np.ndarray, float]:
    with jax.debug_nans(True):
        after, snapshot, g = _compiled_step(colony, parameters, HARD, numerics)
    return after, np.asarray(g), float(snapshot.growth_rate)


def _nodes(colony: Colony) -> tuple[np.ndarray, np.ndarray]:
    count = int(colony.count)
    return np.asarray(colony.positions)[:count], np.asarray(colony.parents)[:count]


class _AnglesOf:
    """The budding angles that the lineages of a colony's nodes give."""

    def __init__(self, colony: Colony) -> None:
        self.lineages = colony.lineages

    def __call__(self, event: int, parents: plain.Ints) -> plain.Floats:
        return np.asarray(_angles(self.lineages, jnp.asarray(event)), dtype=np.float64)[parents]


@jax.jit
def _angles(lineages: Array, event: Array) -> Array:
    return uniform_angles(child_lineages(lineages, event))


@pytest.mark.users_compiler
@pytest.mark.parametrize("name", ["count", "parents", "colony", "positions", "nutrient", "growth rate", "level set"])
def test_every_step_of_the_hard_model_is_the_references(comparison: Comparison, name: str) -> None:
    """Integers exactly; reals to 1e-10, a hundredfold of what either nutrient solve leaves."""
    assert len(comparison.differences[name]) == 310
    assert max(comparison.differences[name]) <= (0 if name in ("count", "parents", "colony") else 1e-10)


@pytest.mark.users_compiler
def test_every_event_of_the_hard_model_is_the_references(comparison: Comparison) -> None:
    assert len(comparison.births) == 6
    assert all(sorted(ours) == sorted(theirs) for ours, theirs in comparison.births)
    assert sum(len(ours) for ours, _ in comparison.births) > 20


def test_capacity_is_reached_when_the_reference_says_so(comparison: Comparison) -> None:
    ours, theirs = zip(*comparison.capacity_reached, strict=True)
    assert list(ours) == np.logical_or.accumulate(theirs).tolist()  # sticky here, of one event there


# --- start ---------------------------------------------------------------------------------------------------------


def test_start() -> None:
    """Two joined nodes at ±½(cos Θ, sin Θ) in nutrient 1, Θ uniform over keys, all other slots empty."""
    colonies = jax.jit(jax.vmap(lambda key: start(key, SHORT)))(jax.random.split(jax.random.key(0), 500))
    x = np.asarray(colonies.positions)
    np.testing.assert_allclose(np.hypot(*x[:, 0].T), 0.5, atol=1e-15)
    np.testing.assert_array_equal(x[:, 1], -x[:, 0])
    turns = np.arctan2(x[:, 0, 1], x[:, 0, 0]) % (2 * np.pi)
    assert stats.kstest(turns, stats.uniform(0, 2 * np.pi).cdf).pvalue > 0.01
    assert (np.asarray(colonies.parents) == [-1, 0] + [-1] * 10).all()
    assert (np.asarray(colonies.weights) == [1, 1] + [0] * 10).all()
    assert (x[:, 2:] == 0).all()
    assert (np.asarray(colonies.nutrient) == 1).all()
    assert len(np.unique(np.asarray(colonies.lineages)[:, :2].reshape(-1, 2), axis=0)) == 1000


# --- the relaxed trajectory ----------------------------------------------------------------------------------------


@eqx.filter_jit
def _short_run(log_values: Array) -> tuple[Colony, dict[str, Array]]:
    """About eight nodes, observed after the first and after the second event."""
    parameters = Parameters.from_array(PARAMETERS.names, jnp.exp(log_values))
    colony = start(jax.random.key(1), SHORT)
    return trajectory(parameters, colony, Schedule.of(SAMPLES), Relaxation(contact=0.1), SHORT, OBSERVE)


@pytest.fixture(scope="module")
def at() -> Array:
    """log λ a little below the defaults, but hungry: at the second event not every node can bud."""
    values = {name: 0.9 * info.default for name, info in PARAMETERS.items()} | {"metabolic_rate": 5.0}
    return jnp.asarray(np.log([values[name] for name in PARAMETERS.names]))


@pytest.fixture(scope="module")
def slopes(at: Array) -> dict[str, np.ndarray]:
    """∂ statistic / ∂ log λ at both samples."""
    found = jax.jit(jax.jacfwd(lambda v: _short_run(v)[1]))(at)
    return {name: np.asarray(values) for name, values in found.items()}


@pytest.fixture(scope="module")
def differences(at: Array) -> dict[str, np.ndarray]:
    """The same by central differences of 1e-5, with an error of the order of 1e-10."""
    columns = []
    for move in 1e-5 * np.eye(7):
        up, down = (_short_run(jnp.asarray(np.asarray(at) + e * move))[1] for e in (1, -1))
        columns.append({name: (np.asarray(up[name]) - np.asarray(down[name])) / 2e-5 for name in up})
    return {name: np.stack([column[name] for column in columns], axis=-1) for name in columns[0]}


def test_a_trajectory_repeats_the_step(at: Array) -> None:
    parameters = Parameters.from_array(PARAMETERS.names, jnp.asarray(np.exp(at)))
    colony = started(jax.random.key(1), SHORT)
    one = eqx.filter_jit(lambda c: step(c, parameters, Relaxation(contact=0.1), SHORT))
    observed, observe = [], eqx.filter_jit(OBSERVE)
    for number in range(1, SAMPLES[-1] + 1):
        colony, snapshot = one(colony)
        if number in SAMPLES:
            observed.append(observe(snapshot))
    last, statistics = _short_run(at)
    assert int(last.step) == int(colony.step) == SAMPLES[-1]
    assert 6 <= int(last.count) <= 8
    assert 0 < float(last.weights[int(last.count) - 1]) < 1
    np.testing.assert_allclose(last.nutrient, colony.nutrient, atol=1e-11)
    # by lineage: the last bit decides who of two nodes that are fed alike buds first, and so gets the lower slot
    slots, others = (np.lexsort(np.asarray(c.lineages).T)[-int(c.count) :] for c in (last, colony))
    for name in ("positions", "weights", "lineages"):
        np.testing.assert_allclose(
            np.asarray(getattr(last, name))[slots], np.asarray(getattr(colony, name))[others], atol=1e-11
        )
    mothers = [np.asarray(c.lineages)[np.asarray(c.parents)[at]] for c, at in ((last, slots), (colony, others))]
    np.testing.assert_array_equal(*mothers)
    for name, values in statistics.items():
        np.testing.assert_allclose(values, [o[name] for o in observed], rtol=1e-11)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["mean_radius", "area", "cell_count", "growth_rate", "radius", "perimeter"])
def test_derivative_of_a_trajectory(
    name: str, slopes: dict[str, np.ndarray], differences: dict[str, np.ndarray]
) -> None:
    """To 1e-5 of each parameter's derivative; what is below 1e-7 in either counts as zero."""
    np.testing.assert_allclose(slopes[name], differences[name], rtol=1e-5, atol=1e-7)


def test_every_statistic_depends_on_every_parameter(slopes: dict[str, np.ndarray]) -> None:
    """After the second event; before it the count depends on none: two nodes cannot have more than two buds."""
    for name in ("mean_radius", "area", "growth_rate", "perimeter", "radius"):
        found = dict(zip(PARAMETERS.names, np.abs(slopes[name][1]) > 1e-6, strict=True))
        assert found == dict.fromkeys(PARAMETERS.names, True)
    assert (slopes["cell_count"][0] == 0).all()
    assert (np.abs(slopes["cell_count"][1]) > 1e-6).all()


def test_double_precision_leaves_single_precision_alone() -> None:
    """Both can be traced in one process, one after the other."""

    def one(key: Array) -> dict[str, Array]:
        return trajectory(Parameters(), start(key, SHORT), Schedule.of([1, 2]), Relaxation(), SHORT, OBSERVE)[1]

    for double in (True, False):
        with jax.enable_x64(double):
            traced = jax.eval_shape(lambda keys: map_members(one, keys), jax.random.split(jax.random.key(0), 2))
            assert traced["area"].dtype == (jnp.float64 if double else jnp.float32)
