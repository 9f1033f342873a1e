"""`simulate`: reproducible, batched, never recompiled, checked, saved, frank about problems; and its ensembles."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types
from jaxtyping import Array, PyTree

from reference import colony as plain
from yeastfit import HARD, InputError, Numerics, Parameters, Relaxation, Scales, Simulation, member_keys, simulate
from yeastfit.errors import SimulationError
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import start
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.model import Model
from yeastfit.model.parameters import PARAMETERS
from yeastfit.model.simulate import Schedule, trajectory
from yeastfit.model.snapshot import Snapshot
from yeastfit.simulation.simulate import schedule_of

SMALL = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=32)
TIMES = (1.2, 2.2, 3.2)
STATE = ("positions", "parents", "weights", "lineages", "count", "nutrient", "step")
TRACES: list[str] = []  # one entry whenever something is compiled


class Traced(SmoothStatistics):
    """The default observer, which also notes that it is being traced."""

    def __call__(self, snapshot: Snapshot) -> dict[str, Array]:
        TRACES.append("traced")
        return super().__call__(snapshot)


def grow(
    keys: Array, parameters: Parameters | None = None, times: Sequence[float] = TIMES, **values: object
) -> Simulation:
    """A small relaxed run; compiled once for each number of members."""
    observe = Traced(extent=SMALL.domain, spacing=SMALL.spacing)
    return simulate(parameters or Parameters(), keys, times=np.array(times), numerics=SMALL, observe=observe, **values)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def five() -> Simulation:
    return grow(member_keys(3, 5))


# --- the same again --------------------------------------------------------------------------------------------------


def test_same_key_same_result(five: Simulation) -> None:
    again = grow(member_keys(3, 5))
    for name in STATE:
        np.testing.assert_array_equal(getattr(again.colony, name), getattr(five.colony, name))
    for name, values in five.statistics.items():
        np.testing.assert_array_equal(again.statistics[name], values)
    assert np.ptp(five.statistics["mean_radius"], axis=0).min() > 0.001  # and other keys, other results


@pytest.mark.users_compiler
@pytest.mark.parametrize("members", [1, 2])
def test_a_member_does_not_depend_on_how_many_others_there_are(members: int, five: Simulation) -> None:
    """Its state to the last bit; a statistic to the last bits of its sums, which each batch size orders otherwise."""
    few = grow(member_keys(3, members))
    for name in STATE:
        np.testing.assert_array_equal(getattr(few.colony, name), getattr(five.colony, name)[:members])
    for name, values in few.statistics.items():
        assert values.shape == (members, 3)
        np.testing.assert_allclose(values, five.statistics[name][:members], rtol=3e-6)


def test_one_key_is_one_member_without_the_axis(five: Simulation) -> None:
    one = grow(member_keys(3, 5)[4])
    for name in STATE:
        np.testing.assert_array_equal(getattr(one.colony, name), getattr(five.colony, name)[4])
    assert one.statistics["area"].shape == (3,)
    assert one.capacity_reached.shape == ()


def test_members_keys_are_a_prefix_of_more_members() -> None:
    np.testing.assert_array_equal(
        jax.random.key_data(member_keys(7, 6))[:2], jax.random.key_data(member_keys(jax.random.key(7), 2))
    )


def test_each_member_may_have_its_own_parameters() -> None:
    """To the last bit what it does alone, though members on one device share the number of nutrient sweeps."""
    keys = member_keys(0, 5)
    diffusivity, mobility = np.array([0.05, 2.0, 0.3, 0.05, 0.1]), np.array([3.0, 0.2, 1.0, 5.0, 0.0])
    mixed = grow(keys, Parameters(diffusivity=diffusivity, mobility=mobility))
    for i in range(5):
        alone = grow(keys[i], Parameters(diffusivity=diffusivity[i], mobility=mobility[i]))
        for name in STATE:
            np.testing.assert_array_equal(getattr(mixed.colony, name)[i], getattr(alone.colony, name))


def test_values_never_recompile(five: Simulation) -> None:
    """λ, per member or shared, keys, widths and sample times are data."""
    before = len(TRACES)
    assert before > 0
    grow(member_keys(9, 5), Parameters(mobility=2.0, aspect_ratio=0.5))
    grow(member_keys(9, 5), Parameters(metabolic_rate=np.linspace(0.5, 1.5, 5)))
    grow(member_keys(3, 5), relaxation=Relaxation(union=0.1, contact=0.05, boundary=0.3))
    grow(member_keys(3, 5), times=(0.02, 0.5, 1.7))
    assert len(TRACES) == before
    two = grow(member_keys(3, 5), times=(0.7, TIMES[-1]))
    assert len(TRACES) > before  # the number of sample times is a shape, and the count does count
    # and it does not change the colony
    np.testing.assert_array_equal(two.colony.weights, five.colony.weights)
    # the step that is observed is compiled apart from the others, so that last bits may differ
    np.testing.assert_allclose(two.colony.positions, five.colony.positions, atol=1e-5)
    np.testing.assert_allclose(two.times, [0.7, 3.2])


# --- what is wrong is said -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "times", [(0.0,), (-1.0, 2.0), (2.0, 1.0), (1.0, 1.0), (1.0, 1.005), ((1.0, 2.0),), (0.001,)], ids=str
)
def test_times_that_do_not_rise_are_named(times: tuple) -> None:
    with pytest.raises(InputError, match=r"times is \[.*\], it must rise from at least dt = 0.02"):
        schedule_of(times, SMALL)


@pytest.mark.parametrize("times", [None, ["a"], [1 + 2j], [[1.0], [2.0, 3.0]]], ids=str)
def test_times_that_are_no_numbers_are_named(times: Any, unchecked: None) -> None:
    with pytest.raises(InputError, match=r"times is .*, it must be numbers"):
        schedule_of(times, SMALL)


@pytest.mark.parametrize("times", [(), (np.nan,), (1.0, np.inf)], ids=str)
def test_times_that_are_missing_or_not_finite_are_named(times: tuple) -> None:
    with pytest.raises(InputError, match="times is"):
        schedule_of(times, SMALL)


def test_times_are_rounded_to_steps() -> None:
    assert schedule_of([0.02, 0.049, 3.0], SMALL).steps.tolist() == [1, 2, 150]


@pytest.mark.parametrize(("members", "shown"), [(0, "0"), (-3, "-3"), (2.5, "2.5"), (True, "true")])
def test_an_ensemble_without_members_is_named(members: int, shown: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=f"members is {shown}, it must be a whole number of at least 1"):
        member_keys(0, members)


def test_what_are_no_keys_and_no_parameters_is_named() -> None:
    with wrong_types(), pytest.raises(InputError, match=r"keys is 0, it must be keys of jax, such as yeastfit.member"):
        simulate(Parameters(), 0, times=[1.0])  # type: ignore[arg-type]
    with wrong_types(), pytest.raises(InputError, match=r"parameters is .*mobility.*, it must be yeastfit.Parameters"):
        simulate({"mobility": 1.0}, member_keys(0, 1), times=[1.0])  # type: ignore[arg-type]


def test_parameters_for_another_number_of_members_are_named() -> None:
    with pytest.raises(InputError, match=r"mobility has shape \(3,\), it must be one number or one per member, \(2,\)"):
        simulate(Parameters(mobility=np.ones(3)), member_keys(0, 2), times=np.array([1.0]), numerics=SMALL)


@pytest.fixture(scope="module")
def troubled() -> dict[float, Simulation]:
    """A sound colony, one too stiff, one too mobile and one that overflows, to three times."""
    numerics = Numerics(domain=8.0, spacing=0.4, dt=0.05, capacity=10)
    parameters = Parameters(elasticity=np.array([5.0, 20.0, 5.0, 1e30]), mobility=np.array([1.0, 1.0, 60.0, 1.0]))
    return {
        t: simulate(parameters, member_keys(0, 4), times=np.array([t]), numerics=numerics, throw=False)
        for t in (0.05, 2.5, 3.5)
    }


def test_a_sound_run_has_nothing_to_report(five: Simulation) -> None:
    assert five.problems == {}
    assert five.warnings() == []
    assert not five.capacity_reached.any()


@pytest.mark.parametrize(
    ("problem", "time", "member", "words"),
    [
        ("unstable", 0.05, 1, "forward Euler oscillates: lower dt"),
        ("left_domain", 2.5, 2, "within one cell of the domain's edge: raise domain"),
        ("not_finite", 2.5, 3, "positions or nutrient are not finite"),
        ("capacity_reached", 3.5, 0, "every node slot was taken: raise capacity"),
    ],
)
def test_problems_are_reported(
    problem: str, time: float, member: int, words: str, troubled: dict[float, Simulation]
) -> None:
    result = troubled[time]
    flags = np.asarray(getattr(result.colony.problems, problem))
    assert flags[member]
    assert not flags[0] or problem == "capacity_reached"
    assert result.problems[problem] == flags.sum()
    assert any(
        warning.startswith(f"{flags.sum()} of 4 colonies:") and words in warning for warning in result.warnings()
    )


def test_a_time_step_too_large_for_the_springs_is_an_error_that_says_which_would_do() -> None:
    """Two nodes have degree 1, so Δt λ2 · 2 < 2: at dt = 0.1 an elasticity of 10 is the first to fail."""
    numerics = Numerics(domain=8.0, spacing=0.4, dt=0.1, capacity=10)
    with pytest.raises(InputError, match=r"dt is 0.1, too large for the springs: .* dt below 0.0833"):
        simulate(Parameters(elasticity=np.array([5.0, 12.0])), member_keys(0, 2), times=[0.1], numerics=numerics)
    sound = simulate(Parameters(elasticity=9.9), member_keys(0, 2), times=[0.1], numerics=numerics)
    assert not sound.problems


@pytest.mark.slow
def test_a_popular_parent_makes_springs_too_stiff_for_a_step_that_a_small_colony_stood() -> None:
    """Degrees grow with the colony: the same Δt holds at first, and at 230 nodes, of degree 6, no longer does."""
    numerics = Numerics(domain=24.0, spacing=0.2, dt=0.05, capacity=400)
    stiff = Parameters(elasticity=6.0)
    assert "unstable" not in simulate(stiff, member_keys(0, 1), times=[3.0], numerics=numerics).problems
    with pytest.raises(InputError, match=r"dt is 0.05, too large for the springs"):
        simulate(stiff, member_keys(0, 1), times=[8.0], numerics=numerics)


def test_a_state_that_is_not_finite_is_an_error() -> None:
    with pytest.raises(SimulationError, match=r"dt is 0.05 and positions or nutrient became not finite"):
        simulate(
            Parameters(repulsivity=1e38, mobility=1e38, elasticity=1e-3),
            member_keys(0, 4),
            times=[3.0],
            numerics=Numerics(domain=8.0, spacing=0.4, dt=0.05, capacity=10),
        )


class NoNumber(BiomassUptake):
    """A rule of a user that gives nan."""

    name = "no number"

    def rate(self, context: Any, level_set: Array, nutrient: Array) -> Array:
        return jnp.full_like(level_set, jnp.nan)


def test_a_rule_that_gives_nan_is_named() -> None:
    numerics = Numerics(domain=8.0, spacing=0.4, dt=0.05, capacity=10)
    with pytest.raises(SimulationError, match=r"lower dt, or see whether NoNumber returns nan$"):
        simulate(Parameters(), member_keys(0, 1), times=[0.5], numerics=numerics, model=Model(uptake=NoNumber()))


def test_a_colony_that_outgrew_its_dish_is_said_to_have() -> None:
    """Mobile cells run out of a narrow dish between two samples, and places become not finite beyond its edge."""
    with pytest.raises(SimulationError, match=r"domain is 6, .* a colony had come to its edge: raise domain"):
        simulate(
            Parameters(mobility=6.0),
            member_keys(0, 1),
            times=[9.0],
            numerics=Numerics(domain=6.0, spacing=0.25, dt=0.02, capacity=64),
        )


def test_a_diffusivity_beyond_what_single_precision_solves_is_named() -> None:
    numerics = Numerics(domain=8.0, spacing=0.1, capacity=10)
    with pytest.raises(InputError, match=r"diffusivity · dt / spacing² is 20, .* up to 8"):
        simulate(Parameters(diffusivity=10.0), member_keys(0, 1), times=[0.1], numerics=numerics)


def test_capacity_is_reported_per_member(troubled: dict[float, Simulation]) -> None:
    assert not troubled[2.5].capacity_reached.any()
    assert troubled[3.5].capacity_reached[0]
    assert troubled[3.5].statistics["cell_count"][0, 0] == 9


def test_statistics_of_a_colony_that_is_not_finite_are_not_numbers(troubled: dict[float, Simulation]) -> None:
    lost = np.asarray(troubled[2.5].colony.problems.not_finite)
    assert lost.any()
    assert np.isnan(troubled[2.5].statistics["mean_radius"][lost]).all()


# --- the result ------------------------------------------------------------------------------------------------------


def test_save_and_load(tmp_path: Path, five: Simulation) -> None:
    """Everything comes back, also what this run did not use."""
    result = replace(
        five,
        parameters=Parameters(mobility=np.linspace(0.5, 2.0, 5)),
        relaxation=Relaxation(union=0.1, contact=None, boundary=0.3, births="whole", turning=0.5),
        scales=Scales(length=5.0, rate=0.3),
        colony=eqx.tree_at(lambda c: c.problems.unstable, five.colony, jnp.arange(5) == 3),
    )
    result.save(tmp_path / "run.npz")
    loaded = Simulation.load(tmp_path / "run.npz")
    assert result.problems == {"unstable": 1}
    for name in ("numerics", "scales", "seconds", "problems"):
        assert getattr(loaded, name) == getattr(result, name)
    for name in ("colony", "parameters", "relaxation"):
        assert eqx.tree_equal(getattr(loaded, name), getattr(result, name))
    np.testing.assert_array_equal(loaded.times, result.times)
    assert loaded.statistics.keys() == result.statistics.keys()
    assert all(np.array_equal(values, result.statistics[name]) for name, values in loaded.statistics.items())


def test_what_is_saved_is_loaded_from_the_same_path(tmp_path: Path, five: Simulation) -> None:
    five.save(tmp_path / "run")
    Simulation.load(tmp_path / "run")


def test_rows_are_in_both_units(five: Simulation) -> None:
    rows = five.rows()
    assert len(rows) == 15
    assert [row["member"] for row in rows[::3]] == [0, 1, 2, 3, 4]
    row = rows[4]
    assert row["time"] == pytest.approx(2.2)
    assert row["hours"] == pytest.approx(2.2 / 0.46)
    for name, unit in (("radius_um", 7.5), ("mean_radius_um", 7.5), ("perimeter_um", 7.5), ("area_um2", 7.5**2)):
        assert row[name] == pytest.approx(unit * five.statistics[name.rpartition("_")[0]][1, 1])


# --- derivatives -----------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_derivatives_stay_finite_over_four_events_in_single_precision() -> None:
    def curves(log_values: Array) -> dict[str, Array]:
        parameters = Parameters.from_array(PARAMETERS.names, jnp.exp(log_values))
        numerics = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=40)
        schedule, observe = Schedule.of([110, 210]), SmoothStatistics(8.0, 0.2)
        return trajectory(parameters, start(jax.random.key(2), numerics), schedule, Relaxation(), numerics, observe)[1]

    slopes = jax.jit(jax.jacfwd(curves))(jnp.log(jnp.array([PARAMETERS[name].default for name in PARAMETERS.names])))
    for name, values in slopes.items():
        assert values.shape == (2, 7), name
        assert np.isfinite(values).all(), name
    assert (np.abs(slopes["area"]) > 0).all()


# --- ensembles -------------------------------------------------------------------------------------------------------

MEDIUM = Numerics(domain=16.0, spacing=0.2, dt=0.02, capacity=200)


class SmoothBesideHard(eqx.Module):
    """Smooth statistics of each relaxed colony, and scikit-image's of the hard union of the very same cells."""

    smooth: SmoothStatistics
    hard: HardStatistics

    def __call__(self, snapshot: Snapshot) -> PyTree:
        sharp = Relaxation(union=None, boundary=None)
        return self.smooth(snapshot), self.hard(eqx.tree_at(lambda s: s.relaxation, snapshot, sharp))

    def finish(self, observed: PyTree) -> dict[str, np.ndarray]:
        smooth, hard = self.smooth.finish(observed[0]), self.hard.finish(observed[1])
        return smooth | {f"hard {name}": values for name, values in hard.items()}


@pytest.fixture(scope="module")
def hard_ensemble() -> Simulation:
    return simulate(Parameters(), member_keys(0, 48), times=np.array([2.0, 4.0, 6.0]), numerics=MEDIUM, relaxation=HARD)


@pytest.fixture(scope="module")
def relaxed_ensemble() -> Simulation:
    observe = SmoothBesideHard(SmoothStatistics(16.0, 0.2), HardStatistics(16.0, 0.2))
    return simulate(Parameters(), member_keys(1, 48), times=np.array([2.0, 4.0, 6.0]), numerics=MEDIUM, observe=observe)


def reference_ensemble(members: int, times: Sequence[float], numerics: Numerics) -> list[list[dict[str, Any]]]:
    """Colonies of the plain reading, each with its own generator."""
    values = {name: info.default for name, info in PARAMETERS.items()}
    same = plain.Numerics(numerics.domain, numerics.spacing, numerics.dt, numerics.room, numerics.bud_distance)
    return [
        plain.run(plain.Parameters(**values), same, times[-1], np.random.default_rng(i), times, cg_tolerance=1e-9)
        for i in range(members)
    ]


def standard_scores(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Difference of two ensembles' means in combined standard errors; 0 where both never vary and agree."""
    error = np.sqrt(ours.var(axis=0, ddof=1) / len(ours) + theirs.var(axis=0, ddof=1) / len(theirs))
    gap = ours.mean(axis=0) - theirs.mean(axis=0)
    return np.divide(gap, error, out=np.where(np.abs(gap) > 1e-6, np.inf, 0.0), where=error > 0)


def assert_same_means(ours: Simulation, runs: list[list[dict[str, Any]]]) -> None:
    """Within 4 combined standard errors at every time; compactness of both by one estimator."""
    for name in ("cell_count", "growth_rate", "mean_radius", "area", "radius"):
        theirs = np.array([[record[name] for record in run] for run in runs], dtype=float)
        assert np.abs(standard_scores(ours.statistics[name], theirs)).max() < 4.0, name
    spacing = ours.numerics.spacing
    theirs = np.array([[measure_mask(record["image"], spacing).compactness for record in run] for run in runs])
    assert np.abs(standard_scores(ours.statistics["compactness"], theirs)).max() < 4.0


@pytest.mark.slow
def test_means_of_the_hard_model_are_the_references(hard_ensemble: Simulation) -> None:
    """At t = 2, 4 and 6: 4 standard errors are about 1 % of each mean at t = 6, 5 % of compactness."""
    assert hard_ensemble.problems == {}
    assert_same_means(hard_ensemble, reference_ensemble(20, (2.0, 4.0, 6.0), MEDIUM))


@pytest.mark.slow
def test_means_of_the_hard_model_are_the_references_on_the_sources_grid() -> None:
    numerics, times = Numerics(domain=40.0, spacing=0.1, dt=0.02, capacity=600), (2.0, 4.0, 6.0, 8.0, 10.0)
    ours = simulate(Parameters(), member_keys(0, 48), times=np.array(times), numerics=numerics, relaxation=HARD)
    assert_same_means(ours, reference_ensemble(12, times, numerics))


@pytest.mark.runs_long
@pytest.mark.parametrize(
    ("name", "bound"), [("area", 0.015), ("radius", 0.005), ("perimeter", 0.03), ("compactness", 0.07)]
)
@pytest.mark.slow
def test_smooth_statistics_are_close_to_the_hard_ones_of_the_same_colonies(
    name: str, bound: float, relaxed_ensemble: Simulation
) -> None:
    """Mean ratio − 1 at t = 4 and 6, s = 0.025, K = 0.2, h = 0.2: area −1.1 and −1.2 %, radius +0.2 and +0.2 %,
    perimeter +1.0 and +2.5 %, compactness +3.1 and +6.4 %."""
    ratio = relaxed_ensemble.statistics[name] / relaxed_ensemble.statistics[f"hard {name}"]
    assert np.abs(ratio.mean(axis=0) - 1.0)[1:].max() < bound


@pytest.mark.thorough
@pytest.mark.runs_long
@pytest.mark.parametrize(
    ("name", "bound"), [("cell_count", 0.02), ("growth_rate", 0.03), ("mean_radius", 0.03), ("area", 0.04)]
)
def test_the_relaxed_model_is_close_to_the_hard_one(
    name: str, bound: float, relaxed_ensemble: Simulation, hard_ensemble: Simulation
) -> None:
    """Means of 48 at t = 6: cells −0.7 %, μ −1.6 %, d̄ −1.6 %, area −2.6 %, each ± 0.5 to 1 %; with Δt = 0.02 the
    hard contact's chatter has its part in it (docs/convergence.md has the limit)."""
    relaxed, hard = (ensemble.statistics[name].mean(axis=0) for ensemble in (relaxed_ensemble, hard_ensemble))
    assert np.abs(relaxed / hard - 1.0).max() < bound
