"""ABC-MCMC: chains against posteriors that are known, and against themselves after a kill."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import known_posteriors
import numpy as np
import pytest
from emcee.backends import HDFBackend
from helpers import wrong_types
from known_posteriors import Drawing, Interrupted, Killed, Known, assert_agrees
from numpy.random import Generator, RandomState

from yeastfit import InputError
from yeastfit.inference.abc.distances import WeightedCurves
from yeastfit.inference.abc.mcmc import abc_mcmc
from yeastfit.inference.abc.mcmc_settings import McmcSettings, Move, move_of
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.posterior.simulation_store import Store

GAUSSIAN = known_posteriors.gaussian()
SHORT = McmcSettings(steps=30, walkers=4, pilot=60, share=0.2)


def run(known: Known, settings: McmcSettings, **more: Any) -> Samples:
    return abc_mcmc(known.simulator, known.prior, known.distance, settings, **more)


def assert_same(found: Samples, expected: Samples) -> None:
    """Bit by bit."""
    for name in ("values", "weights", "log_probability", "acceptance", "statistics"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.simulations == expected.simulations
    assert found.diagnostics == expected.diagnostics


# --- known answers ----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("move", ["gaussian", "stretch", "de"])
def test_gaussian_mean(move: Move) -> None:
    settings = McmcSettings(steps=600, walkers=8, epsilon=0.3, kernel="gaussian", move=move, pilot=200)
    assert_agrees(run(GAUSSIAN, settings, seed=1), GAUSSIAN, 0.3)


@pytest.mark.usefixtures("unchecked")
def test_beta_binomial_is_exact_below_one() -> None:
    known = known_posteriors.beta_binomial()
    assert_agrees(run(known, McmcSettings(steps=1000, walkers=8, epsilon=0.5), seed=2), known, 0.5)


@pytest.mark.usefixtures("unchecked")
def test_banana() -> None:
    known = known_posteriors.banana()
    settings = McmcSettings(steps=1000, walkers=8, epsilon=0.4, kernel="gaussian", discard=50)
    assert_agrees(run(known, settings, seed=3), known, 0.4)


@pytest.mark.usefixtures("unchecked")
def test_bias_falls_with_epsilon() -> None:
    points, weights = GAUSSIAN.exact(0.0)
    exact = np.sqrt(weights @ points**2 - (weights @ points) ** 2)
    wider = []
    for epsilon in (2.0, 1.0, 0.2):
        found = run(GAUSSIAN, McmcSettings(steps=500, epsilon=epsilon, kernel="gaussian", pilot=200), seed=4)
        assert_agrees(found, GAUSSIAN, epsilon)
        wider.append(float(found.sd[0] / exact[0] - 1))
    assert wider[0] > 1.5 * wider[1] > 6 * abs(wider[2])


def test_chains_walk_in_logarithms_where_the_prior_does() -> None:
    """log λ ~ uniform, one observation of log λ: the posterior of log λ is that of a flat prior, N(0, 0.3² + ε²)."""
    prior = Prior.of({"rate": {"law": "log-uniform", "low": 1e-3, "high": 1e3}})

    def draw(values: np.ndarray, rng: Generator) -> np.ndarray:
        return np.log(values) + 0.3 * rng.standard_normal(1)

    distance = WeightedCurves(np.array([0.0]), np.array([1.0]))
    simulator = Drawing(("rate",), ("log",), draw)
    found = abc_mcmc(simulator, prior, distance, McmcSettings(steps=600, epsilon=0.4, kernel="gaussian"), seed=5)
    logs, size = np.log(found.flat), found.effective_size[0]
    assert abs(logs.mean()) < 4 * 0.5 / np.sqrt(size)
    assert abs(logs.std() / 0.5 - 1) < 4 / np.sqrt(2 * size)


def test_simulations_that_come_to_nothing_by_chance_change_nothing() -> None:
    def draw(values: np.ndarray, rng: Generator) -> np.ndarray:
        return np.where(rng.random() < 0.3, np.nan, values + 0.5 * rng.standard_normal(1))

    known = replace(GAUSSIAN, simulator=replace(GAUSSIAN.simulator, draw=draw))
    found = run(known, McmcSettings(steps=600, epsilon=0.3, kernel="gaussian", pilot=200), seed=6)
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
    known, interrupted = GAUSSIAN, Interrupted(GAUSSIAN.simulator, 10**6)
    found = abc_mcmc(interrupted, known.prior, known.distance, SHORT, seed=7)
    stays = np.diff(found.values[..., 0], axis=1) == 0
    assert 0.2 < stays.mean() < 0.9
    for one in (found.log_probability, found.statistics[..., 0]):
        np.testing.assert_array_equal(np.diff(one, axis=1)[stays], 0.0)
    assert found.simulations == SHORT.pilot + SHORT.steps * SHORT.walkers == 60 + 120  # one a proposal, no more
    assert interrupted.sizes == {4}
    np.testing.assert_allclose(found.acceptance, (~stays).mean(axis=1), atol=1 / 29)


def test_what_the_pilot_says_of_epsilon_and_starts() -> None:
    found = run(GAUSSIAN, replace(SHORT, steps=1, pilot=400, share=0.1), seed=8)
    everything = run(GAUSSIAN, replace(SHORT, steps=1, pilot=400, share=1.0), seed=8)
    assert found.diagnostics["epsilon"] < everything.diagnostics["epsilon"]
    assert (np.abs(found.statistics - 0.8) <= found.diagnostics["epsilon"]).all()
    given = run(GAUSSIAN, replace(SHORT, covariance=((0.3,),)), seed=8)
    np.testing.assert_allclose(given.diagnostics["proposal_covariance"], [[0.1]])


@pytest.mark.parametrize(("move", "rows"), [("gaussian", 6), ("stretch", 3), ("de", 3)])
def test_calls_have_one_size_and_parameters_outside_the_prior_are_not_simulated(move: Move, rows: int) -> None:
    known = known_posteriors.beta_binomial(successes=0)
    interrupted = Interrupted(known.simulator, 10**6)
    settings = replace(SHORT, walkers=6, move=move, covariance=((1.0,),), pilot=66)
    found = abc_mcmc(interrupted, known.prior, known.distance, settings, seed=9)
    assert interrupted.sizes == {rows}
    assert found.simulations < settings.pilot + settings.steps * settings.walkers
    assert ((found.values > 0) & (found.values < 1)).all()


# --- kill and resume --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("move", ["gaussian", "stretch"])
@pytest.mark.parametrize("stored", [True, False])
def test_killed_again_and_again_it_comes_to_the_same_bits(tmp_path: Path, move: Move, stored: bool) -> None:
    settings, rng = replace(SHORT, move=move), np.random.default_rng(10)
    expected = run(GAUSSIAN, settings, seed=11)
    kills = 0
    while True:
        store = Store(tmp_path / "simulations.h5", ("mean",), ("average",)) if stored else None
        pilot = 0 if stored else settings.pilot // settings.rows  # what has to be done again to get any further
        interrupted = Interrupted(GAUSSIAN.simulator, pilot + int(rng.integers(3, 15)))
        try:
            found = abc_mcmc(
                interrupted, GAUSSIAN.prior, GAUSSIAN.distance, settings, seed=11, path=tmp_path / "c.h5", store=store
            )
            break
        except Killed:
            kills += 1
        finally:
            if store is not None:
                store.close()
    assert kills >= 2
    assert_same(found, expected)
    assert found.warnings == expected.warnings


@pytest.mark.parametrize("lost", [1, 400, 2000, 4000, 8000])
def test_files_that_lost_their_ends_come_to_the_same_bits(tmp_path: Path, lost: int) -> None:
    expected = run(GAUSSIAN, SHORT, seed=12)
    chain, simulations = tmp_path / "chain.h5", tmp_path / "simulations.h5"
    with Store(simulations, ("mean",), ("average",)) as store:
        run(GAUSSIAN, replace(SHORT, steps=17), seed=12, path=chain, store=store)
    for path in (chain, simulations):
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size - lost)
    with Store(simulations, ("mean",), ("average",)) as store:
        found = run(GAUSSIAN, SHORT, seed=12, path=chain, store=store)
    assert_same(found, expected)
    assert any("simulations.h5 was torn" in said for said in found.warnings)
    assert any("chain.h5 was" in said for said in found.warnings)


@pytest.mark.parametrize("dataset", ["chain", "log_prob", "blobs", "steps"])
def test_a_step_that_was_half_written_is_taken_again(tmp_path: Path, dataset: str) -> None:
    expected, path = run(GAUSSIAN, SHORT, seed=13), tmp_path / "chain.h5"
    run(GAUSSIAN, replace(SHORT, steps=17), seed=13, path=path)
    with h5py.File(path, "r+") as file:
        group = file["mcmc"]
        group[dataset][16] = np.zeros_like(group[dataset][16])
        group.attrs["random_state_1"] = group.attrs["random_state_1"] + 1
    found = run(GAUSSIAN, SHORT, seed=13, path=path)
    assert_same(found, expected)
    assert found.warnings == ["chain.h5 was torn: 16 of 17 steps are whole, the chains go on after them"]


KILLS_ITSELF = """
import os, signal, sys, threading
from known_posteriors import gaussian
from yeastfit.inference.abc.mcmc import abc_mcmc
from yeastfit.inference.abc.mcmc_settings import McmcSettings
from yeastfit.inference.posterior.simulation_store import Store
folder, seconds = sys.argv[1], float(sys.argv[2])
known, settings = gaussian(), McmcSettings(steps=300, walkers=4, pilot=60, share=0.2)
threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGKILL)).start()
with Store(folder + "/simulations.h5", ("mean",), ("average",)) as store:
    path = folder + "/chain.h5"
    abc_mcmc(known.simulator, known.prior, known.distance, settings, seed=19, path=path, store=store)
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
    with Store(tmp_path / "simulations.h5", ("mean",), ("average",)) as store:
        assert len(store) > SHORT.pilot
        found = run(GAUSSIAN, settings, seed=19, path=tmp_path / "chain.h5", store=store)
    assert_same(found, run(GAUSSIAN, settings, seed=19))


def test_a_disk_that_fills_up_is_told_of_and_chains_go_on_once_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = iter([1 << 30] * 16)  # looked for when the file is made, when it grows, and before each step
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=next(room, 1000)))
        with pytest.raises(OSError, match=r"No space left on device: .*chain\.h5"):
            run(GAUSSIAN, SHORT, seed=21, path=tmp_path / "chain.h5")
    assert HDFBackend(str(tmp_path / "chain.h5"), read_only=True).iteration == 14
    assert_same(run(GAUSSIAN, SHORT, seed=21, path=tmp_path / "chain.h5"), run(GAUSSIAN, SHORT, seed=21))


def test_emcee_reads_the_file(tmp_path: Path) -> None:
    found = run(GAUSSIAN, SHORT, seed=21, path=tmp_path / "chain.h5")
    backend = HDFBackend(str(tmp_path / "chain.h5"), read_only=True)
    np.testing.assert_array_equal(backend.get_chain(), np.swapaxes(found.values, 0, 1))
    np.testing.assert_array_equal(backend.get_log_prob(), found.log_probability.T)
    np.testing.assert_array_equal(backend.accepted / SHORT.steps, found.acceptance)


def test_steps_are_the_total(tmp_path: Path) -> None:
    path = tmp_path / "chain.h5"
    longer = run(GAUSSIAN, SHORT, seed=14, path=path)
    with Store(tmp_path / "simulations.h5", ("mean",), ("average",)) as store:
        shorter = run(GAUSSIAN, replace(SHORT, steps=12), seed=14, path=path, store=store)
        assert len(store) == SHORT.pilot
    assert_same(shorter, run(GAUSSIAN, replace(SHORT, steps=12), seed=14))
    np.testing.assert_array_equal(shorter.values, longer.values[:, :12])
    assert run(GAUSSIAN, replace(SHORT, discard=10), seed=14, path=path).values.shape == (4, 20, 1)


def test_a_lost_chain_is_made_again_from_stored_simulations(tmp_path: Path) -> None:
    with Store(tmp_path / "simulations.h5", ("mean",), ("average",)) as store:
        expected = run(GAUSSIAN, SHORT, seed=15, store=store)
        nothing = Interrupted(GAUSSIAN.simulator, 0)
        assert_same(abc_mcmc(nothing, GAUSSIAN.prior, GAUSSIAN.distance, SHORT, seed=15, store=store), expected)


def test_chains_of_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "chain.h5"
    run(GAUSSIAN, SHORT, seed=16, path=path)
    with pytest.raises(InputError, match=r"chain\.h5 holds other chains: seed was 16, now it is 17"):
        run(GAUSSIAN, SHORT, seed=17, path=path)
    with pytest.raises(InputError, match=r"holds other chains: share was 0.2, now it is 0.3"):
        run(GAUSSIAN, replace(SHORT, share=0.3), seed=16, path=path)
    with pytest.raises(InputError, match=r"holds other chains: distance's observed was \[0.8\], now it is \[0.9\]"):
        run(known_posteriors.gaussian(0.9), SHORT, seed=16, path=path)
    with (
        Store(tmp_path / "simulations.h5", ("mean",), ("average",), about="another model") as store,
        pytest.raises(InputError, match=r"holds other chains: about was , now it is another model"),
    ):
        run(GAUSSIAN, SHORT, seed=16, path=path, store=store)
    path.write_text("notes")
    with pytest.raises(InputError, match=r"chain\.h5 exists and is no file of chains"):
        run(GAUSSIAN, SHORT, seed=16, path=path)


# --- what is said -----------------------------------------------------------------------------------------------------


def test_a_file_in_a_folder_that_is_not_there_yet_and_a_seed_of_numpy(tmp_path: Path) -> None:
    with wrong_types():
        found = run(GAUSSIAN, SHORT, seed=np.int64(5), path=tmp_path / "new" / "chains.h5")
    found.save(tmp_path / "samples.npz")
    np.testing.assert_array_equal(Samples.load(tmp_path / "samples.npz").values, run(GAUSSIAN, SHORT, seed=5).values)


def test_a_prior_that_excludes_the_data_is_said() -> None:
    far = known_posteriors.gaussian(observed=50.0)
    with pytest.raises(InputError, match=r"epsilon is 0.1, none of 60 simulations .* nearest .*; average was observed"):
        run(far, replace(SHORT, epsilon=0.1))
    found = run(far, SHORT)
    assert any("average was observed as 50, the prior's simulations have" in said for said in found.warnings)


def test_a_simulator_of_nothing_is_said() -> None:
    nothing = replace(GAUSSIAN.simulator, draw=lambda values, rng: values * np.nan)
    with pytest.raises(InputError, match="all 60 simulations from the prior came to nothing"):
        run(replace(GAUSSIAN, simulator=nothing), SHORT)


def test_a_chain_that_cannot_move_is_said() -> None:
    stuck = run(GAUSSIAN, replace(SHORT, covariance=((1e8,),)), seed=18)
    assert stuck.warnings[0] == (
        "chain 0 accepted none of 30 proposals: a larger tolerance epsilon would let it move, or smaller proposals"
    )
    assert len(stuck.warnings) == 4
    np.testing.assert_array_equal(stuck.acceptance, 0.0)
    assert 1 <= stuck.effective_size[0] <= 4
    sticky = run(GAUSSIAN, replace(SHORT, steps=300, epsilon=0.02, pilot=1000, covariance=((100.0,),)), seed=18)
    assert any("stood still for" in said for said in sticky.warnings)
    assert run(GAUSSIAN, SHORT, seed=18).warnings == []


def test_progress_is_told() -> None:
    said: list[tuple[str, float]] = []
    run(GAUSSIAN, SHORT, progress=lambda what, share: said.append((what, share)))
    assert said[0] == ("pilot", 0.0)
    assert said[-1] == ("chains", 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 0}, "steps is 0, it must be at least 1"),
        ({"discard": 30}, "discard is 30, it must be below the number of steps, 30"),
        ({"epsilon": -1.0}, "epsilon is -1.0, it must be above 0"),
        ({"share": 0.0}, "share is 0.0, it must lie in"),
        ({"move": "walk"}, "move is 'walk'"),
        ({"walkers": 3, "move": "stretch"}, "walkers is 3, stretch with 1 parameters needs at least 4"),
        ({"covariance": ((-1.0,),)}, r"covariance is \[\[-1.0\]\], it must be symmetric and positive definite, 1 by 1"),
        ({"epsilon": 0.02, "move": "de"}, r"epsilon is 0.02, only \d of 60 pilot .* de starts 4 walkers at different"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict[str, Any], message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        run(GAUSSIAN, replace(SHORT, **change), seed=3)


def test_problems_that_do_not_fit_together_are_refused() -> None:
    other = known_posteriors.beta_binomial()
    with pytest.raises(InputError, match="prior is of share, the simulator takes mean"):
        abc_mcmc(GAUSSIAN.simulator, other.prior, GAUSSIAN.distance, SHORT)
    with pytest.raises(InputError, match="observed has 2 statistics, the simulator gives average"):
        abc_mcmc(GAUSSIAN.simulator, GAUSSIAN.prior, known_posteriors.banana().distance, SHORT)
