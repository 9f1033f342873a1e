"""ABC-MCMC: chains against posteriors that are known, and against themselves after a kill."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import known_posteriors
import numpy as np
import pytest
from emcee.backends import HDFBackend
from helpers import wrong_types
from known_posteriors import Drawing, Interrupted, Killed, assert_agrees, assert_same, run
from numpy.random import Generator, RandomState

from yeastfit import InputError
from yeastfit.inference.abc.distances import WeightedCurves
from yeastfit.inference.abc.mcmc import AbcMcmc, McmcDiagnostics
from yeastfit.inference.abc.proposals import Move, move_of
from yeastfit.inference.posterior.emcee_file import write_chains
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.samplers import infer
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.store.simulations import Simulations

GAUSSIAN = known_posteriors.gaussian()
SHORT = AbcMcmc(steps=30, walkers=4, pilot=60, pilot_quantile=0.2)


def opened(folder: Path) -> Store:
    return Store(folder / "simulations.h5", ("mean",), ("average",))


def reported(posterior: Posterior) -> McmcDiagnostics:
    assert isinstance(posterior.diagnostics, McmcDiagnostics)
    return posterior.diagnostics


# --- known answers ----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("move", ["gaussian", "stretch", "de"])
def test_gaussian_mean(move: Move) -> None:
    settings = AbcMcmc(steps=600, walkers=8, tolerance=0.3, kernel="gaussian", move=move, pilot=200)
    assert_agrees(run(GAUSSIAN, settings, seed=1), GAUSSIAN, 0.3)


@pytest.mark.usefixtures("unchecked")
def test_beta_binomial_is_exact_below_one() -> None:
    known = known_posteriors.beta_binomial()
    assert_agrees(run(known, AbcMcmc(steps=1000, walkers=8, tolerance=0.5), seed=2), known, 0.5)


@pytest.mark.usefixtures("unchecked")
def test_banana() -> None:
    known = known_posteriors.banana()
    settings = AbcMcmc(steps=1000, walkers=8, tolerance=0.4, kernel="gaussian", discard=50)
    assert_agrees(run(known, settings, seed=3), known, 0.4)


@pytest.mark.usefixtures("unchecked")
def test_bias_falls_with_epsilon() -> None:
    points, weights = GAUSSIAN.exact(0.0)
    exact = np.sqrt(weights @ points**2 - (weights @ points) ** 2)
    wider = []
    for epsilon in (2.0, 1.0, 0.2):
        found = run(GAUSSIAN, AbcMcmc(steps=500, walkers=8, tolerance=epsilon, kernel="gaussian", pilot=200), seed=4)
        assert_agrees(found, GAUSSIAN, epsilon)
        wider.append(float(found.sd[0] / exact[0] - 1))
    assert wider[0] > 1.5 * wider[1] > 6 * abs(wider[2])


@pytest.mark.usefixtures("unchecked")
def test_chains_walk_in_logarithms_where_the_prior_does() -> None:
    """log λ ~ uniform, one observation of log λ: the posterior of log λ is that of a flat prior, N(0, 0.3² + ε²)."""
    prior = Prior.of({"rate": {"distribution": "log-uniform", "low": 1e-3, "high": 1e3}})

    def draw(values: np.ndarray, rng: Generator) -> np.ndarray:
        return np.log(values) + 0.3 * rng.standard_normal(1)

    distance = WeightedCurves(np.array([0.0]), np.array([1.0]))
    simulator = Drawing(("rate",), ("log",), draw)
    sampler = AbcMcmc(steps=600, walkers=8, distance=distance, tolerance=0.4, kernel="gaussian")
    found = infer(simulator, prior, np.array([0.0]), method=sampler, seed=5)
    logs, size = np.log(found.flat), found.effective_size[0]
    assert abs(logs.mean()) < 4 * 0.5 / np.sqrt(size)
    assert abs(logs.std() / 0.5 - 1) < 4 / np.sqrt(2 * size)


@pytest.mark.usefixtures("unchecked")
def test_simulations_that_come_to_nothing_by_chance_change_nothing() -> None:
    def draw(values: np.ndarray, rng: Generator) -> np.ndarray:
        return np.where(rng.random() < 0.3, np.nan, values + 0.5 * rng.standard_normal(1))

    known = replace(GAUSSIAN, simulator=replace(GAUSSIAN.simulator, draw=draw))
    found = run(known, AbcMcmc(steps=600, walkers=8, tolerance=0.3, kernel="gaussian", pilot=200), seed=6)
    assert_agrees(found, known, 0.3)
    assert np.isfinite(found.statistics).all()


# --- how chains move --------------------------------------------------------------------------------------------------


def test_every_walker_has_a_proposal_of_its_own() -> None:
    """Unlike emcee's GaussianMove, whose full covariance moves all walkers by one vector."""
    covariance = np.array([[2.0, 0.6], [0.6, 0.5]])
    steps, factors = move_of("gaussian", covariance).get_proposal(np.zeros((40000, 2)), RandomState(0))
    np.testing.assert_allclose(np.cov(steps.T), covariance / 3, rtol=0.05)
    np.testing.assert_array_equal(factors, 0.0)
    assert len(np.unique(steps)) == steps.size


def test_what_is_stored_of_a_point_is_never_simulated_again() -> None:
    interrupted = Interrupted(GAUSSIAN.simulator, 10**6)
    found = run(replace(GAUSSIAN, simulator=interrupted), SHORT, seed=7)
    stays = np.diff(found.values[..., 0], axis=1) == 0
    assert 0.2 < stays.mean() < 0.9
    for one in (found.log_probability, found.statistics[..., 0]):
        np.testing.assert_array_equal(np.diff(one, axis=1)[stays], 0.0)
    assert found.simulations == SHORT.pilot + SHORT.steps * SHORT.walkers == 60 + 120  # one a proposal, no more
    assert interrupted.sizes == {4}
    np.testing.assert_allclose(found.acceptance, (~stays).mean(axis=1), atol=1 / 29)


def test_what_the_pilot_says_of_epsilon_and_starts() -> None:
    found = run(GAUSSIAN, replace(SHORT, steps=1, pilot=400, pilot_quantile=0.1), seed=8)
    everything = run(GAUSSIAN, replace(SHORT, steps=1, pilot=400, pilot_quantile=1.0), seed=8)
    assert reported(found).tolerance < reported(everything).tolerance
    assert (np.abs(found.statistics - 0.8) <= reported(found).tolerance).all()
    given = run(GAUSSIAN, replace(SHORT, covariance=((0.3,),)), seed=8)
    np.testing.assert_allclose(reported(given).proposal_covariance, [[0.1]])


@pytest.mark.parametrize(("move", "rows"), [("gaussian", 6), ("stretch", 3), ("de", 3)])
def test_calls_have_one_size_and_parameters_outside_the_prior_are_not_simulated(move: Move, rows: int) -> None:
    known = known_posteriors.beta_binomial(successes=0)
    interrupted = Interrupted(known.simulator, 10**6)
    settings = replace(SHORT, walkers=6, move=move, covariance=((1.0,),), pilot=66)
    found = run(replace(known, simulator=interrupted), settings, seed=9)
    assert interrupted.sizes == {rows}
    assert found.simulations < settings.pilot + settings.steps * settings.walkers
    assert ((found.values > 0) & (found.values < 1)).all()


def test_where_all_proposals_are_outside_the_prior_nothing_is_simulated() -> None:
    known = known_posteriors.beta_binomial()
    interrupted = Interrupted(known.simulator, 10**6)
    settings = replace(SHORT, walkers=2, covariance=((1e6,),), distance=known.distance, replicates=2)
    found = infer(interrupted, known.prior, np.array([7.0]), method=settings, noise=np.array([[0.1]]), seed=1)
    assert found.simulations == settings.replicates * settings.pilot
    assert not found.acceptance.any()


@pytest.mark.usefixtures("unchecked")
def test_a_data_set_is_a_mean_of_replicates_with_errors_of_measurement() -> None:
    """Of a simulator without noise the errors are all there is; with n replicates the sd falls by √n."""
    plain = replace(GAUSSIAN, simulator=replace(GAUSSIAN.simulator, draw=lambda values, rng: values))
    noise = np.array([[0.09]])
    exact = infer(
        plain.simulator,
        plain.prior,
        np.array([0.8]),
        method=AbcMcmc(steps=600, walkers=8, distance=GAUSSIAN.distance, tolerance=0.1, pilot=400),
        noise=noise,
        seed=3,
    )
    assert exact.sd[0] == pytest.approx(0.3, rel=0.15)
    sd = [
        run(GAUSSIAN, AbcMcmc(steps=600, walkers=8, tolerance=0.1, pilot=400, replicates=count), seed=3).sd[0]
        for count in (1, 4)
    ]
    assert sd[0] / sd[1] == pytest.approx(2.0, rel=0.25)


# --- kill and resume --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("move", ["gaussian", "stretch"])
def test_killed_again_and_again_it_comes_to_the_same_bits(tmp_path: Path, move: Move) -> None:
    settings, rng = replace(SHORT, move=move), np.random.default_rng(10)
    expected = run(GAUSSIAN, settings, seed=11)
    kills = 0
    while True:
        interrupted = Interrupted(GAUSSIAN.simulator, int(rng.integers(3, 15)))
        try:
            with opened(tmp_path) as store:
                found = run(replace(GAUSSIAN, simulator=interrupted), settings, seed=11, store=store)
            break
        except Killed:
            kills += 1
    assert kills >= 2
    assert_same(found, expected)
    assert found.warnings == expected.warnings


@pytest.mark.parametrize("lost", [1, 400, 2000, 4000, 8000])
def test_a_file_that_lost_its_end_comes_to_the_same_bits(tmp_path: Path, lost: int) -> None:
    expected = run(GAUSSIAN, SHORT, seed=12)
    with opened(tmp_path) as store:
        run(GAUSSIAN, replace(SHORT, steps=17), seed=12, store=store)
    path = tmp_path / "simulations.h5"
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - lost)
    with opened(tmp_path) as store:
        found = run(GAUSSIAN, SHORT, seed=12, store=store)
    assert_same(found, expected)
    assert any("simulations.h5 was torn" in said for said in found.warnings)


KILLS_ITSELF = """
import os, signal, sys, threading
from known_posteriors import gaussian, run
from yeastfit.inference.abc.mcmc import AbcMcmc
folder, seconds = sys.argv[1], float(sys.argv[2])
settings = AbcMcmc(steps=300, walkers=4, pilot=60, pilot_quantile=0.2)
threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGKILL)).start()
run(gaussian(), settings, seed=19, store=folder + "/simulations.h5")
os._exit(0)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_killed_for_real(tmp_path: Path) -> None:
    """The operating system's kill, at random, until enough is done."""
    settings, rng = replace(SHORT, steps=300), np.random.default_rng(20)
    where = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, (Path(__file__).parents[2], Path(__file__).parents[3]))),
    }
    for seconds in rng.uniform(0.05, 0.5, size=8):
        subprocess.run([sys.executable, "-c", KILLS_ITSELF, str(tmp_path), str(seconds)], env=where, check=False)
    with opened(tmp_path) as store:
        assert len(store) > SHORT.pilot
        found = run(GAUSSIAN, settings, seed=19, store=store)
    assert_same(found, run(GAUSSIAN, settings, seed=19))


def test_emcee_reads_the_file_of_the_chains(tmp_path: Path) -> None:
    found = run(GAUSSIAN, SHORT, seed=21)
    assert found.backend is not None
    write_chains(tmp_path / "chain.h5", found.backend)
    backend = HDFBackend(str(tmp_path / "chain.h5"), read_only=True)
    np.testing.assert_array_equal(backend.get_chain(), np.swapaxes(found.values, 0, 1))
    np.testing.assert_array_equal(backend.get_log_prob(), found.log_probability.T)
    np.testing.assert_array_equal(backend.get_blobs()[:, :, 1:], np.swapaxes(found.statistics, 0, 1))
    np.testing.assert_array_equal(backend.accepted / SHORT.steps, found.acceptance)


def test_steps_are_the_total(tmp_path: Path) -> None:
    store = Simulations(("mean",), ("average",))
    shorter = run(GAUSSIAN, replace(SHORT, steps=12), seed=14, store=store)
    assert len(store) == SHORT.pilot + 12 * SHORT.walkers
    longer = run(GAUSSIAN, SHORT, seed=14, store=store)
    assert len(store) == SHORT.pilot + SHORT.steps * SHORT.walkers
    assert_same(longer, run(GAUSSIAN, SHORT, seed=14))
    np.testing.assert_array_equal(shorter.values, longer.values[:, :12])
    assert run(GAUSSIAN, replace(SHORT, discard=10), seed=14, store=store).values.shape == (4, 20, 1)
    assert len(store) == SHORT.pilot + SHORT.steps * SHORT.walkers


def test_chains_are_made_again_from_stored_simulations(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        expected = run(GAUSSIAN, SHORT, seed=15, store=store)
        nothing = Interrupted(GAUSSIAN.simulator, 0)
        assert_same(run(replace(GAUSSIAN, simulator=nothing), SHORT, seed=15, store=store), expected)


def test_what_a_simulator_raises_is_raised_and_not_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(Killed):
        run(replace(GAUSSIAN, simulator=Interrupted(GAUSSIAN.simulator, 20)), SHORT)
    assert capsys.readouterr() == ("", "")


# --- what is said -----------------------------------------------------------------------------------------------------


def test_a_seed_of_numpy(tmp_path: Path) -> None:
    with wrong_types():
        found = run(GAUSSIAN, SHORT, seed=np.int64(5))
    found.save(tmp_path / "posterior.npz")
    again = Posterior.load(tmp_path / "posterior.npz")
    np.testing.assert_array_equal(again.values, run(GAUSSIAN, SHORT, seed=5).values)
    assert reported(again).tolerance == reported(found).tolerance
    np.testing.assert_array_equal(reported(again).distance.observed, [0.8])
    assert again.settings["distance"]["kind"] == "WeightedCurves"


def test_a_prior_that_excludes_the_data_is_said() -> None:
    far = known_posteriors.gaussian(observed=50.0)
    with pytest.raises(
        InputError, match=r"tolerance is 0.1, none of 60 simulations .* nearest .*; average was observed"
    ):
        run(far, replace(SHORT, tolerance=0.1, pilot_quantile=None))
    found = run(far, SHORT)
    assert any("average was observed as 50, the prior's simulations have" in said for said in found.warnings)


def test_a_simulator_of_nothing_is_said() -> None:
    nothing = replace(GAUSSIAN.simulator, draw=lambda values, rng: values * np.nan)
    with pytest.raises(InputError, match="all 60 simulations from the prior failed"):
        run(replace(GAUSSIAN, simulator=nothing), SHORT)


def test_a_chain_that_cannot_move_is_said() -> None:
    stuck = run(GAUSSIAN, replace(SHORT, covariance=((1e8,),)), seed=18)
    assert stuck.warnings[0] == (
        "chain 0 accepted none of 30 proposals: a larger tolerance would let it move, or smaller proposals"
    )
    assert len(stuck.warnings) == 4
    np.testing.assert_array_equal(stuck.acceptance, 0.0)
    assert 1 <= stuck.effective_size[0] <= 4
    settings = replace(SHORT, steps=300, tolerance=0.02, pilot_quantile=None, pilot=1000, covariance=((100.0,),))
    sticky = run(GAUSSIAN, settings, seed=18)
    assert any("stood still for" in said for said in sticky.warnings)
    assert run(GAUSSIAN, SHORT, seed=18).warnings == ()


@pytest.mark.usefixtures("unchecked")
def test_chains_have_settled_once_they_are_long_enough() -> None:
    assert run(GAUSSIAN, SHORT, seed=18).status is Status.CHAINS_TOO_SHORT
    settings = AbcMcmc(steps=800, walkers=8, tolerance=1.0, kernel="gaussian", pilot=200, covariance=((9.0,),))
    found = run(GAUSSIAN, settings, seed=18)
    assert found.settled
    assert found.sentences() == []


def test_progress_is_told() -> None:
    said: list[tuple[str, float]] = []
    run(GAUSSIAN, SHORT, progress=lambda what, share: said.append((what, share)))
    assert said[0] == ("pilot", 0.0)
    assert said[-1] == ("chains", 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 0}, "steps is 0, it must be a whole number of at least 1"),
        ({"discard": 30}, "discard is 30, it must be below the number of steps, 30"),
        ({"tolerance": -1.0, "pilot_quantile": None}, "tolerance is -1.0, it must be above 0"),
        ({"tolerance": 1.0}, "tolerance and pilot_quantile are given, need one of the two"),
        ({"pilot_quantile": 0.0}, "pilot_quantile is 0.0, it must lie in"),
        ({"move": "walk"}, "move is 'walk'"),
        ({"kernel": "far"}, "kernel is 'far'"),
        ({"replicates": 0}, "replicates is 0, it must be a whole number of at least 1"),
        ({"walkers": 3, "move": "stretch"}, "walkers is 3, stretch with 1 parameters needs at least 4"),
        ({"covariance": ((-1.0,),)}, r"covariance is \[\[-1.0\]\], it must be symmetric and positive definite, 1 by 1"),
        (
            {"tolerance": 0.02, "pilot_quantile": None, "move": "de"},
            r"tolerance is 0.02, only \d of 60 pilot .* de starts 4 walkers at different",
        ),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict[str, Any], message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        run(GAUSSIAN, replace(SHORT, **change), seed=3)
