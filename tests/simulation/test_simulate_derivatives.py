"""Derivatives through `simulate`: both ways, in all that is real, of ensembles, at corners; and what they cost."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import grid, wrong_types
from jaxtyping import Array

from yeastfit import HARD, InputError, Model, Numerics, Parameters, Relaxation, Simulation, member_keys, simulate
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model import nutrient as nutrient_module
from yeastfit.model.colony import Colony, start
from yeastfit.model.laws.budding import TurnedBudding
from yeastfit.model.parameters import PARAMETERS
from yeastfit.model.snapshot import Snapshot

NUMERICS = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=14)  # no other test's: TOLERANCE is compiled in
NODES = 14
MEMBERS = 3  # an odd number, which stays on one of the tests' two devices, where sums of cotangents do not wait
TIMES = (1.2, 2.2)  # 10 steps after the first and the second event; other times up to 64 steps apart do not recompile
WIDTHS = {"union": 0.05, "contact": 0.15, "boundary": 0.2}
PARTS = ("positions", "nutrient", "weights")
WAYS = (*PARAMETERS.names, *WIDTHS, *PARTS, "turns")
LAM = {name: 0.9 * PARAMETERS[name].default for name in PARAMETERS.names}
STATE = ("positions", "parents", "weights", "lineages", "count", "nutrient", "step")
Named = dict[str, Any]  # arrays by name


@pytest.fixture(scope="module", autouse=True)
def precise() -> Iterator[None]:
    """Double precision, and a nutrient solve that leaves no error to speak of."""
    # statistics that are traced are no NumPy arrays, as they are annotated to be
    with wrong_types(), jax.enable_x64(True), pytest.MonkeyPatch.context() as patch:
        patch.setattr(nutrient_module, "TOLERANCE", 1e-13)
        yield


def few_colonies() -> Colony:
    """In nutrient that is lower on one side, so that no two nodes are fed alike and rounding decides nothing."""
    x, y = grid(NUMERICS)
    less = 0.1 * np.exp(-((x - 0.4) ** 2) - (y - 0.5) ** 2)
    colonies = jax.vmap(lambda key: start(key, NUMERICS))(member_keys(0, MEMBERS))
    return eqx.tree_at(lambda c: c.nutrient, colonies, colonies.nutrient - jnp.asarray(less, colonies.nutrient.dtype))


@pytest.fixture(scope="module")
def colonies() -> Colony:
    return few_colonies()


@pytest.fixture(scope="module")
def here() -> Array:
    """No step in any of `WAYS`."""
    return jnp.zeros(len(WAYS))


def run(amounts: Array, began: Colony, times: tuple[float, ...] = TIMES, lam: Named = LAM) -> Simulation:
    """A few colonies, moved by so much in each of `WAYS`: in log λ, in the logarithms of widths, and along directions.

    These are random displacements, a smooth bump of nutrient beside the colony, half a node less, and random turns.
    """
    rng = np.random.default_rng(0)
    x, y = grid(NUMERICS)
    first = np.arange(NODES) < 2
    directions = {
        "positions": rng.normal(size=(MEMBERS, NODES, 2)) * first[:, None],
        "nutrient": np.exp(-0.5 * ((x - 0.7) ** 2 + (y + 0.2) ** 2)),
        "weights": -0.5 * first,
        "turns": rng.normal(size=(2, NODES)),
    }
    by = dict(zip(WAYS, jnp.unstack(amounts), strict=True))
    along = {name: by[name] * jnp.asarray(direction, amounts.dtype) for name, direction in directions.items()}
    widths: Named = {name: value * jnp.exp(by[name]) for name, value in WIDTHS.items()}
    return simulate(
        Parameters(**{name: value * jnp.exp(by[name]) for name, value in lam.items()}),
        start=with_parts(began, {name: getattr(began, name) + along[name] for name in PARTS}),
        times=times,
        numerics=NUMERICS,
        relaxation=Relaxation(**widths),
        model=Model(budding=TurnedBudding(along["turns"])),
        throw=False,
    )


def with_parts(colony: Colony, parts: Named) -> Colony:
    return eqx.tree_at(lambda c: [getattr(c, name) for name in PARTS], colony, [parts[name] for name in PARTS])


def reverse(began: Colony, times: tuple[float, ...] = TIMES, lam: Named = LAM) -> tuple[Named, Callable[[Named], Any]]:
    """Statistics, and what takes their cotangents to those of the amounts, every entry of the start's parts, and λ."""

    def statistics(amounts: Array, parts: Named, lam: Named) -> Named:
        return run(amounts, with_parts(began, parts), times, lam).statistics

    lam = {name: jnp.broadcast_to(jnp.asarray(value, began.weights.dtype), MEMBERS) for name, value in lam.items()}
    parts = {name: getattr(began, name) for name in PARTS}
    return jax.vjp(statistics, jnp.zeros(len(WAYS), began.weights.dtype), parts, lam)


@pytest.fixture(scope="module")
def value(here: Array, colonies: Colony) -> Simulation:
    """The colonies that have not been moved."""
    return run(here, colonies)


@pytest.fixture(scope="module")
def forward(here: Array, colonies: Colony) -> Named:
    """∂ statistic / ∂ amount, shape (member, time, way)."""
    return jax.jacfwd(lambda amounts: run(amounts, colonies).statistics)(here)


def ones(statistics: Named) -> Named:
    return jax.tree.map(jnp.ones_like, statistics)


# --- both ways -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
def test_forward_mode_is_the_limit_of_differences(
    way: str, here: Array, colonies: Colony, value: Simulation, forward: Named
) -> None:
    """Of every member, at the better of two steps: nodes that pass a line of the grid make kinks."""
    k, errors = WAYS.index(way), []
    assert (np.asarray(value.colony.count) > 5).all()
    for h in (1e-6, 1e-7):
        moves = h * np.eye(len(WAYS))[k]
        up, down = run(jnp.asarray(moves), colonies), run(jnp.asarray(-moves), colonies)
        for side in (up, down):
            np.testing.assert_array_equal(side.colony.parents, value.colony.parents)
        scale = {name: np.abs(forward[name][..., k]) + 0.01 * np.abs(value.statistics[name]) for name in forward}
        slopes = {name: (up.statistics[name] - down.statistics[name]) / (2 * h) for name in forward}
        errors.append([np.abs(slopes[name] - forward[name][..., k]) / scale[name] for name in forward])
    assert np.max(np.min(errors, axis=0)) < 3e-6
    assert all(np.abs(forward[name][..., k]).max() > 1e-6 for name in ("area", "radius", "compactness"))


@pytest.mark.slow
def test_reverse_mode_is_forward_mode(forward: Named, colonies: Colony) -> None:
    """To rounding: ⟨v, J d⟩ = ⟨Jᵀ v, d⟩ for every way d, all unit vectors v. Each member's λ has its own part."""
    statistics, pull = reverse(colonies)
    for name, values in forward.items():
        for at in np.ndindex(MEMBERS, len(TIMES)):
            unit = jax.tree.map(jnp.zeros_like, statistics)
            row, _, of_lam = pull(unit | {name: unit[name].at[at].set(1.0)})
            np.testing.assert_allclose(row, values[at], rtol=1e-9, atol=1e-11 * np.abs(values[at]).max())
            members = np.array([of_lam[name] * value for name, value in LAM.items()]).T
            np.testing.assert_allclose(members[at[0]], row[: len(PARAMETERS.names)], rtol=1e-9)
            np.testing.assert_array_equal(np.delete(members, at[0], axis=0), 0.0)


@pytest.mark.slow
def test_two_legs_have_the_derivative_of_one(here: Array, colonies: Colony, forward: Named) -> None:
    """The second starts from the traced colonies of the first."""
    of_start = jnp.asarray([name in PARTS for name in WAYS])

    def legs(amounts: Array) -> Named:
        half = run(amounts, colonies, (0.02, 1.2)).colony
        return run(jnp.where(of_start, 0.0, amounts), half, (1.3, 2.2)).statistics

    for name, values in jax.jacfwd(legs)(here).items():
        np.testing.assert_allclose(values[:, 1], forward[name][:, 1], rtol=1e-9, atol=1e-12)


def test_saved_colonies_go_on_bit_for_bit(here: Array, colonies: Colony, tmp_path: Path) -> None:
    run(here, colonies, (0.02, 0.8)).save(tmp_path / "half.npz")
    resumed = run(here, Simulation.load(tmp_path / "half.npz").colony, (0.84, 1.6))
    straight = run(here, colonies, (0.8, 1.6))
    assert (np.asarray(straight.colony.count) > 2).all()
    for name in STATE:
        np.testing.assert_array_equal(getattr(resumed.colony, name), getattr(straight.colony, name))
    for name, values in straight.statistics.items():
        np.testing.assert_array_equal(values[:, 1], resumed.statistics[name][:, 1])
    np.testing.assert_allclose(resumed.times, [0.84, 1.6])


# --- where it might not be finite ----------------------------------------------------------------------------------

SINGULAR: dict[str, tuple[Callable[[Array], Array], tuple[float, float]]] = {
    "coincident nodes": (lambda x: 0.0 * x, TIMES),
    "a cell of length δ": (lambda x: 0.01 * x, TIMES),
    "just born": (lambda x: x, (1.0, 2.0)),
    "on lines of the grid": (lambda x: jnp.zeros_like(x).at[:, 0, 0].set(0.6).at[:, 1, 0].set(-0.4), TIMES),
    "far beyond contact": (lambda x: 5.0 * x, TIMES),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", SINGULAR)
def test_value_and_gradient_are_finite_at(name: str, colonies: Colony) -> None:
    """In everything; and nothing depends on where empty slots are."""
    change, times = SINGULAR[name]
    began = eqx.tree_at(lambda c: c.positions, colonies, change(colonies.positions))
    statistics, pull = reverse(began, times)
    amounts, parts, of_lam = pull(ones(statistics))
    for array in (*statistics.values(), amounts, *parts.values(), *of_lam.values()):
        assert np.isfinite(array).all()
    assert np.abs(amounts).max() > 1e-3
    assert np.abs(parts["nutrient"]).max() > 1e-6
    np.testing.assert_array_equal(parts["positions"][:, 2:], 0.0)


ENDS = {
    "diffusivity": (0.0, 1e-5, 10.0),
    "elasticity": (0.0, 1e-3, 20.0),  # the largest that dt stands with four springs at a node
    "repulsivity": (0.0, 2e-5, 50.0),
    "repulsion_radius": (1e-6, 0.1, 0.5),
    "mobility": (0.0, 2e-5, 20.0),
    "metabolic_rate": (0.0, 5e-5, 20.0),
    "aspect_ratio": (0.2, 0.7, 1.0),  # narrower cells slip between grid points and have no shape
}


@pytest.mark.thorough
@pytest.mark.parametrize("double", [True, False], ids=["double", "single"])
def test_value_and_gradient_are_finite_at_corners_of_the_box(double: bool) -> None:
    """Each λ at 0 or its lowest, tiny, or the largest plausible; 24 corners, three at a time."""
    picked = np.random.default_rng(1).integers(3, size=(8, MEMBERS, len(PARAMETERS.names)))
    # where steep gradients meet the largest mobility, dt throws nodes out of the dish
    picked[..., 4] = np.where(picked[..., 5] == 2, np.minimum(picked[..., 4], 1), picked[..., 4])
    with jax.enable_x64(double):
        colonies = few_colonies()
        for corner in picked:
            lam = {name: np.array(ENDS[name])[corner[:, k]] for k, name in enumerate(PARAMETERS.names)}
            statistics, pull = reverse(colonies, lam=lam)
            amounts, parts, of_lam = pull(ones(statistics))
            for name, array in (*statistics.items(), ("amounts", amounts), *parts.items(), *of_lam.items()):
                assert array.dtype == (jnp.float64 if double else jnp.float32)
                assert np.isfinite(array).all(), (name, lam)


# --- what cannot be done is said -----------------------------------------------------------------------------------


def test_keys_or_start_but_not_both(colonies: Colony) -> None:
    for more in ({}, {"keys": jax.random.key(0), "start": colonies}):
        with pytest.raises(InputError, match="either keys, for new colonies, or start"):
            simulate(Parameters(), times=TIMES, numerics=NUMERICS, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("times", [(1.2,), (1.0, 2.0), (0.5,)], ids=str)
def test_times_come_after_the_start(times: tuple[float, ...], colonies: Colony) -> None:
    later = eqx.tree_at(lambda c: c.step, colonies, jnp.full(MEMBERS, 60))
    with pytest.raises(InputError, match=r"times is \[.*\], it must rise from at least 1.2 \+ dt = 0.02"):
        simulate(Parameters(), start=later, times=times, numerics=NUMERICS)


def test_colonies_to_go_on_from_are_at_one_step(colonies: Colony) -> None:
    apart = eqx.tree_at(lambda c: c.step, colonies, jnp.asarray([60, 61, 60]))
    with pytest.raises(InputError, match=r"start holds colonies at steps \[60, 61\]"):
        simulate(Parameters(), start=apart, times=[2.0], numerics=NUMERICS)


@pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["hard", "relaxed"])
def test_hard_statistics_cannot_be_traced(relaxation: Relaxation) -> None:
    observe = None if relaxation is HARD else HardStatistics(extent=8.0, spacing=0.2)

    def area(mobility: Array) -> Array:
        parameters = Parameters(mobility=mobility)
        return simulate(
            parameters, jax.random.key(0), times=[1.0], numerics=NUMERICS, relaxation=relaxation, observe=observe
        ).statistics["area"][0]

    for derivative in (jax.grad, jax.jacfwd, jax.jit):
        with pytest.raises(InputError, match="HardStatistics, which jax cannot trace: use SmoothStatistics"):
            derivative(area)(jnp.asarray(1.0))


@pytest.mark.parametrize("begin", ["keys", "start"])
def test_it_can_be_compiled_into_a_larger_program(begin: str, colonies: Colony) -> None:
    """From keys, and from a colony the program closes over."""
    began: dict[str, Any] = {"start": colonies} if begin == "start" else {"keys": jax.random.key(0)}
    traced = jax.eval_shape(lambda p: simulate(p, times=TIMES, numerics=NUMERICS, **began).statistics, Parameters())
    assert traced["area"].shape[-1] == len(TIMES)


# --- second derivatives, memory ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_hessian_is_symmetric_and_the_limit_of_differences(here: Array, colonies: Colony) -> None:
    """Forwards over backwards, in all seven λ."""

    def radius(logarithms: Array) -> Array:
        return run(here.at[:7].set(logarithms), colonies).statistics["radius"][0, 1]

    gradient, at = jax.grad(radius), jnp.zeros(7)
    hessian = np.asarray(jax.jacfwd(gradient)(at))
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-8, atol=1e-9 * np.abs(hessian).max())
    for k in range(7):
        errors = []
        for h in (1e-6, 1e-7):
            slope = (gradient(at.at[k].add(h)) - gradient(at.at[k].add(-h))) / (2 * h)
            errors.append(np.abs(slope - hessian[k]) / np.abs(hessian).max())
        assert np.max(np.min(errors, axis=0)) < 1e-5


@pytest.mark.slow
def test_jacrev_is_jacfwd(here: Array, colonies: Colony, forward: Named) -> None:
    for name, values in jax.jacrev(lambda amounts: run(amounts, colonies).statistics)(here).items():
        np.testing.assert_allclose(values, forward[name], rtol=1e-9, atol=1e-11 * np.abs(forward[name]).max())


class Radius(SmoothStatistics):
    """The mean distance of nodes alone, which compiles in less time."""

    def __call__(self, snapshot: Snapshot) -> Named:
        return {"radius": jnp.sum(snapshot.colony.positions**2)}


def temporary_bytes(way: Callable[..., Any], steps: int, numerics: Numerics, observe: SmoothStatistics) -> int:
    """What a compiled derivative in λ needs beside its inputs and outputs, in single precision."""

    def last(parameters: Parameters) -> Array:
        times = [steps * numerics.dt]
        run = simulate(parameters, jax.random.key(0), times=times, numerics=numerics, observe=observe)
        return next(iter(run.statistics.values()))[0]

    with jax.enable_x64(False):
        analysis = jax.jit(way(last)).lower(Parameters()).compile().memory_analysis()
    assert analysis is not None
    return analysis.temp_size_in_bytes


@pytest.mark.slow
def test_memory_is_constant_forwards_and_grows_with_the_root_of_the_steps_backwards() -> None:
    """64 times as many steps: as much, and between 2 and 16 times as much, where what does not grow is included."""
    observe = Radius(extent=8.0, spacing=0.2)
    few, many = (temporary_bytes(jax.jacfwd, steps, NUMERICS, observe) for steps in (50, 400))
    assert many <= 1.01 * few
    few, many = (temporary_bytes(jax.grad, steps, NUMERICS, observe) for steps in (32, 2048))
    assert 2 * few < many < 16 * few


@pytest.mark.slow
def test_memory_of_the_sources_size_backwards() -> None:
    """35 hours of 500 nodes on 401² grid points: 805 steps."""
    numerics = Numerics()
    observe = SmoothStatistics(extent=numerics.domain, spacing=numerics.spacing)
    assert temporary_bytes(jax.grad, 805, numerics, observe) < 2e9
