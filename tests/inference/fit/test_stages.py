"""The stages of a fit on stand-ins: where it starts, what it counts, how it ends, and what it says."""

from dataclasses import replace

import numpy as np
import pytest
from stand_in import (
    CENTRE,
    CURVES,
    FREE,
    HELD,
    QUIET,
    ROOT,
    SETTINGS,
    STATISTICS,
    Mean,
    StandIn,
    bent,
    drawn,
    exact,
    fitted,
)

from yeastfit import FitSettings, FitStatus, Imaging, InputError, Parameters, SimulationError, Targets, fit
from yeastfit.inference.simulator import member_seeds
from yeastfit.model.parameters import PARAMETERS

TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)
NEAR = {"mobility": 1.5, "metabolic_rate": 0.9, "aspect_ratio": 0.5}
MOBILITY = PARAMETERS.names.index("mobility")


@pytest.fixture(scope="module")
def targets() -> Targets:
    return drawn(TRUTH, np.random.default_rng(0))


def test_every_simulation_is_counted_and_starts_go_in_batches(targets: Targets) -> None:
    simulator = StandIn()
    result = fitted(targets, simulator)
    assert result.simulations == simulator.simulated
    assert result.history[-1].simulations == simulator.simulated
    assert len(result.starts) == 2
    screening, first, *_ = simulator.batches
    assert screening == SETTINGS.screened
    assert first == 2 * SETTINGS.members[0]  # both starts in one call
    steps = {step.simulations for step in result.history}  # one number for all that were grown together
    assert len(simulator.batches) == 1 + len(steps)
    counts = [step.simulations for step in result.history]
    assert counts == sorted(counts)


def test_ensembles_grow_from_stage_to_stage(targets: Targets) -> None:
    result = fitted(targets)
    stages = list(dict.fromkeys((step.stage, step.members) for step in result.history))
    assert stages == [("stage 1", 16), ("stage 2", 64), ("stage 3", 256)]
    assert result.status == "converged"
    assert result.converged
    assert result.chi_square < 1.05 * result.history[-1].cost  # Σ is that of the last point, not of the stage's first


def test_the_last_ensemble_is_large_enough_for_the_covariance(targets: Targets) -> None:
    """Four simulations for each curve, whatever `members` says."""
    simulator = StandIn()
    fitted(targets, simulator, settings=replace(SETTINGS, members=(16,), spreads=(0.1,)), start=NEAR)
    assert set(simulator.batches) == {4 * CURVES}


def test_same_seed_same_result_bit_for_bit(targets: Targets) -> None:
    first, again, other = (fitted(targets, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.theta, again.theta)
    np.testing.assert_array_equal(first.log_covariance, again.log_covariance)
    assert first.history == again.history
    for start, same in zip(first.starts, again.starts, strict=True):
        np.testing.assert_array_equal(start.begin, same.begin)
    assert (first.theta != other.theta).all()
    errors = np.sqrt(np.diag(first.log_covariance))
    assert (np.abs(first.theta - other.theta) < 1.5 * errors).all()


def valley(tilt: float) -> Mean:
    """Curves that log mobility and its opposite share but for a tilt: two minima, of which the right one is lower."""

    def mean(away: np.ndarray) -> np.ndarray:
        folded, x = away.copy(), away[:, MOBILITY]
        folded[:, MOBILITY] = 2.0 * np.abs(x)
        return bent(folded) * np.where(np.arange(CURVES) == 3, np.exp(tilt * x[:, None]), 1.0)

    return mean


@pytest.mark.parametrize(("tilt", "said"), [(0.001, True), (0.3, False)])
def test_of_two_minima_the_lower_is_found_and_the_other_reported(tilt: float, said: bool) -> None:
    mean = valley(tilt)
    truth = TRUTH.replace(mobility=3.0)
    settings = replace(SETTINGS, screened=128, starts=6)
    result = fitted(exact(truth, mean), StandIn(mean), bounds={"mobility": (0.1, 10.0)}, settings=settings)
    ends = np.array([start.end[0] for start in result.starts])
    assert (ends > 0.3).any()
    assert (ends < -0.3).any()
    others = [warning for warning in result.warnings if warning.startswith("another start ended at mobility ")]
    if said:
        assert len(others) == 1
        assert "where χ² is only" in others[0]
    else:
        assert not others
        assert abs(result.values["mobility"] - 3.0) < 3 * result.standard_errors["mobility"]


@pytest.mark.parametrize("seed", [0, 4, 5])
def test_conditions_with_parameters_of_their_own_begin_where_each_is_explained(seed: int) -> None:
    """The lower of two minima is on opposite sides in two conditions; no start of the box is on both by itself."""
    mean = valley(0.3)
    truth = {"poor": TRUTH.replace(mobility=3.0), "rich": TRUTH.replace(mobility=0.4)}
    targets = {name: exact(one, mean) for name, one in truth.items()}
    simulators = {name: StandIn(mean) for name in truth}
    settings = replace(SETTINGS, screened=64)
    result = fitted(targets, simulators, own=FREE, bounds={"mobility": (0.1, 10.0)}, settings=settings, seed=seed)
    for name, one in truth.items():
        assert result.values[f"mobility of {name}"] == pytest.approx(float(one.mobility), rel=0.05)


METABOLIC = PARAMETERS.names.index("metabolic_rate")


def flat_beyond(away: np.ndarray) -> np.ndarray:
    """Curves of the product of mobility and metabolic rate, and of their ratio only as long as it is below about 4."""
    one, other = away[:, MOBILITY], away[:, METABOLIC]
    seen, ratio = away.copy(), one - other
    seen[:, MOBILITY], seen[:, METABOLIC] = one + other, 1.5 * np.exp(-((np.maximum(ratio + 1.0, 0.0) / 1.2) ** 2))
    return bent(seen)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_fit_that_ended_where_its_data_see_nothing_looks_along_it(seed: int) -> None:
    """One start far up the valley ends there, where the ratio does not matter; the minimum is elsewhere."""
    truth, far = TRUTH.replace(mobility=0.8, metabolic_rate=1.0), {"mobility": 6.0, "metabolic_rate": 0.13}
    bounds = {"mobility": (0.05, 20.0), "metabolic_rate": (0.05, 20.0)}
    target = exact(truth, flat_beyond)
    result = fitted(target, StandIn(flat_beyond, QUIET), bounds=bounds, start={**NEAR, **far}, seed=seed)
    assert [start.number for start in result.starts] == list(range(1, 1 + len(result.starts)))
    assert len(result.starts) > 1
    assert not result.information.blind.any()
    for name in ("mobility", "metabolic_rate"):
        assert result.values[name] == pytest.approx(float(getattr(truth, name)), rel=0.1)


def test_data_that_see_nothing_anywhere_leave_it_at_that() -> None:
    """The ratio matters nowhere: other places are as good, and the fit says so."""

    def mean(away: np.ndarray) -> np.ndarray:
        seen = away.copy()
        seen[:, MOBILITY], seen[:, METABOLIC] = away[:, MOBILITY] + away[:, METABOLIC], 0.0
        return bent(seen)

    result = fitted(exact(TRUTH, mean), StandIn(mean), start=NEAR)
    assert result.information.blind.any()
    assert len(result.starts) > 1
    assert any("mobility · metabolic_rate" in warning for warning in result.warnings)
    assert any(warning.startswith("another start ended at ") for warning in result.warnings)


def test_means_that_bend_within_the_spread_are_told_of() -> None:
    """Fifteen times as steep: straight lines through ensembles of the default spreads miss them by far."""

    def steep(away: np.ndarray) -> np.ndarray:
        return bent(CENTRE + 15.0 * (away - CENTRE))

    truth, settings = HELD.replace(mobility=1.1, metabolic_rate=0.9), replace(SETTINGS, spreads=(0.05, 0.02, 0.01))
    near = {"mobility": 1.0, "metabolic_rate": 1.0, "aspect_ratio": 0.5}
    target = exact(truth, steep)
    wide, narrow = (fit(target, StandIn(steep, QUIET), settings=one, start=near) for one in (SETTINGS, settings))
    assert any("means bend within the spread of the last ensembles, 0.1" in one for one in wide.warnings)
    assert not any("means bend" in one for one in narrow.warnings)
    assert narrow.values["mobility"] == pytest.approx(1.1, rel=0.01)
    assert not any("means bend" in one for one in fit(exact(TRUTH), StandIn(), settings=SETTINGS, start=NEAR).warnings)


class Dying(StandIn):
    """Fails where mobility is below 1, once the box has been looked at."""

    everywhere = False

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        rows = super().__call__(values, seeds)
        dead = (values[:, FREE.index("mobility")] < 1) | self.everywhere
        return np.where(dead[:, None] & (len(self.batches) > 1), np.nan, rows)


def test_a_start_that_comes_to_nothing_does_not_stop_the_others() -> None:
    mean = valley(0.05)
    settings = replace(SETTINGS, screened=128, starts=6)
    truth = TRUTH.replace(mobility=3.0)
    result = fitted(exact(truth, mean), Dying(mean, QUIET), bounds={"mobility": (0.1, 10.0)}, settings=settings)
    lost = [start for start in result.starts if "failed" in start.ended]
    assert lost
    assert not any(start.carried for start in lost)
    assert all(start.begin[0] < 0.3 for start in lost)
    assert result.values["mobility"] == pytest.approx(3.0, rel=0.05)
    assert any("failed" in warning for warning in result.warnings)


def test_simulations_that_come_to_nothing_everywhere_end_the_fit(targets: Targets) -> None:
    simulator = Dying()
    simulator.everywhere = True
    with pytest.raises(SimulationError, match=r"no start led anywhere: mobility .* pairs of simulations failed"):
        fitted(targets, simulator)
    with pytest.raises(SimulationError, match="32 simulations all over the box failed"):
        fitted(targets, StandIn(lambda away: np.full((len(away), CURVES), np.nan)))


def test_what_simulations_ran_into_is_said(targets: Targets) -> None:
    class Full(StandIn):
        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
            self.problems["unstable"] += 5
            return super().__call__(values, seeds)

    result = fitted(targets, Full(), start=NEAR)
    steps = len([step for step in result.history if step.stage == "stage 3"])
    assert any(f"{5 * steps} simulations of the last stage: unstable" in warning for warning in result.warnings)


def test_a_limit_of_steps_is_said_with_what_is_left() -> None:
    short = replace(SETTINGS, members=(64,), spreads=(0.1,), max_steps=1)
    result = fitted(
        exact(TRUTH),
        StandIn(root=QUIET),
        start={"mobility": 0.3, "metabolic_rate": 3.0, "aspect_ratio": 0.3},
        settings=short,
    )
    assert not result.converged
    assert result.status is FitStatus.NOT_CONVERGED
    assert result.message.startswith("not converged: the limit of 1 steps was reached")
    assert "standard errors from the last point" in result.detail


def test_data_out_of_reach_are_said_with_the_worst_curve() -> None:
    reachable = exact(TRUTH)
    mean = reachable.mean.copy()
    mean[STATISTICS.index("radius"), 2] *= 2.0
    result = fitted(replace(reachable, mean=mean), start=NEAR)
    (said,) = [warning for warning in result.warnings if warning.startswith("the model does not reach the data")]
    residuals = result.conditions[0].residuals
    worst = int(np.abs(residuals).argmax())
    side = "above" if residuals[worst] > 0 else "below"
    named = f"{result.targets.observables[worst]} of the data is {abs(residuals[worst]):.1f} errors {side} the model's"
    assert f"chi-square {result.chi_square:.0f} on 9 degrees of freedom; {named}" in said


def test_a_parameter_that_runs_to_its_bound_is_said(targets: Targets) -> None:
    result = fitted(targets, bounds={"mobility": (0.05, 1.0)})
    assert result.values["mobility"] == pytest.approx(1.0, rel=0.04)
    assert result.values["mobility"] <= 1.0 + 1e-9
    assert any(w.startswith("mobility ran to an end of its range, 0.05 to 1") for w in result.warnings)


def test_progress_goes_from_nothing_to_all(targets: Targets) -> None:
    told: list[tuple[str, float]] = []
    fitted(targets, progress=lambda what, share: told.append((what, share)))
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert 0 <= shares[0] < shares[-1] <= 1
    assert told[0][0] == "trying starting points"
    assert told[-1][0].startswith("stage 3 of 3, step ")


# --- arguments --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"prior": {"elasticity": (5.0, 0.1)}}, "prior names 'elasticity', which is not free: mobility"),
        ({"prior": {"mobility": (1.0, 0.0)}}, "prior of mobility is 1, 0"),
        ({"prior": {"mobility": (-1.0, 0.1)}}, "prior of mobility is -1, 0.1"),
        (
            {"free": ["aspect_ratio"], "prior": {"aspect_ratio": (2.0, 0.1)}},
            r"prior of aspect_ratio is 2, 0.1: aspect_ratio",
        ),
        ({"start": {"mobility": 500.0}}, "start: mobility is 500"),
        ({"start": {"elasticity": 5.0}}, "start names 'elasticity', which is not free: mobility"),
        ({"fixed": {"rich": {"elasticity": 5.0}}}, "fixed is for 'rich', the conditions are ''"),
        ({"own": ["mobility"]}, "there is one condition only"),
        ({"free": PARAMETERS.names, "targets": exact(TRUTH, replicates=3)}, None),
    ],
    ids=lambda value: str(value)[:40],
)
def test_bad_arguments_are_named(arguments: dict, message: str | None, targets: Targets) -> None:
    few = Targets.from_means({"radius": np.arange(1.0, 8.0)}, np.arange(1.0, 8.0), imaging=Imaging())
    if message is None:
        arguments, message = (
            {"targets": few, "free": PARAMETERS.names},
            r"7 target values \(statistics × times\) cannot determine 7 free parameters",
        )
    with pytest.raises(InputError, match=message):
        fit(**{"targets": targets, **arguments})


def test_no_condition_is_refused() -> None:
    with pytest.raises(InputError, match="there is no condition"):
        fit({})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"starts": 0}, "starts is 0, it must be a whole number of at least 1"),
        ({"tolerance": 0.0}, "tolerance is 0.0, it must be a number above 0"),
        ({"members": (16,)}, "each stage has one of both"),
        ({"members": (9,), "spreads": (0.1,)}, "a stage has members 9 and spread 0.1"),
        ({"members": (16,), "spreads": (1.5,)}, "a stage has members 16 and spread 1.5"),
    ],
    ids=str,
)
def test_settings_are_checked(values: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        FitSettings(**values)


def test_the_noise_of_seeds_is_what_a_fit_sees_at_its_centre() -> None:
    """The stand-in itself: its covariance is the one it states, at any λ."""
    stand_in = StandIn()
    values = np.tile(np.exp(CENTRE[[PARAMETERS.names.index(name) for name in FREE]] + 0.3), (4000, 1))
    rows = stand_in(values, member_seeds(0, 4000)) - bent(stand_in.logarithms(values))
    np.testing.assert_allclose(np.cov(rows.T), ROOT @ ROOT.T, atol=0.1 * 0.01)
