"""The page of off-lattice posteriors: what is kept, resumed and said of it; slow: all of it in a quick look."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from known_posteriors import Killed, assert_same

from benchmarks import offlattice_posteriors as page
from benchmarks.li2024_published import PUBLISHED_POSTERIORS
from benchmarks.offlattice_posteriors import QUICK, chain_error, density, drifts, effective, parameters
from benchmarks.offlattice_runs import FIVE, METHODS, Run, real_colonies
from benchmarks.offlattice_words import in_words, missing, unreached
from benchmarks.real_tables import main as write_tables
from benchmarks.report import Report
from yeastfit import LI2024, InputError
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.simulator import Wrapper
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED

KEY = "awri796-50um"
SIZES = replace(QUICK, sets={KEY: replace(QUICK.sets[KEY], chains=3, steps=4)}, at_mean=2)


def run_of(folder: Path, method: str = "protocol") -> Run:
    return Run(KEY, method, SIZES, folder, threads=2)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    run = run_of(tmp_path_factory.mktemp("work"))
    run.infer(print)
    return run


def test_what_is_finished_is_kept_and_not_repeated(finished: Run) -> None:
    assert finished.finished
    before = finished.file("npz").stat().st_mtime_ns
    finished.infer(print)
    assert finished.file("npz").stat().st_mtime_ns == before
    assert finished.posterior().values.shape == (3, 4, 5)
    assert len(finished.simulations()[0]) == finished.posterior().simulations
    assert finished.seconds()["processor"] > 0


def test_a_killed_run_goes_on(finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = run_of(tmp_path)

    whole = Run.simulator
    monkeypatch.setattr(Run, "simulator", property(lambda self: _Dying(whole.fget(self))))  # type: ignore[attr-defined]
    with pytest.raises(Killed):
        run.infer(print)
    assert not run.finished
    monkeypatch.setattr(Run, "simulator", whole)
    said = missing([run, finished])
    assert "Not finished" in said
    assert f"{run.colonies.name}: {METHODS['protocol']} (" in said
    with monkeypatch.context() as patched:
        patched.setattr(Run, "simulations", in_use)
        assert missing([run]).endswith(f"{METHODS['protocol']}, which is being computed")
    run.infer(print)
    assert_same(run.posterior(), finished.posterior())
    assert missing([run]) == "All posteriors are finished."


def test_chains_that_were_stopped_say_so_and_go_on(finished: Run, tmp_path: Path) -> None:
    run = replace(run_of(tmp_path), steps=2)
    run.infer(print)
    assert (run.there, run.done, run.finished) == (True, 2, False)
    assert run.name == "protocol reproduced, first 2 of 4 steps"
    assert "protocol reproduced" in missing([run])
    np.testing.assert_array_equal(run.posterior().values, finished.posterior().values[:, :2])
    whole = replace(run, steps=None)
    whole.infer(print)
    assert whole.finished
    assert_same(whole.posterior(), finished.posterior())


def test_what_the_model_does_not_reach_is_said(finished: Run) -> None:
    class Found:
        settled, warnings = True, ("x was observed as 2, the prior's simulations have 0..1",)
        statistics = np.random.default_rng(0).normal([0.2126, 0.1642, 0.2], [0.01, 0.01, 0.02], (2, 500, 3))

    said = unreached(finished, Found())  # type: ignore[arg-type]
    assert len(said) == 2
    assert "x was observed as 2" in said[0]
    assert "I_F" not in said[1]
    assert "I_B is" in said[1]
    words = in_words([finished], {(finished.key, finished.method): 100.0})
    assert "p_ps" in words[0] or "γ by" in words[0]
    assert len(words) == 3
    assert "100 % of its colonies reach beyond the frame" in words[-1]
    assert len(in_words([finished], {(finished.key, finished.method): 10.0})) == 2


def in_use(run: Run) -> None:
    raise InputError(f"{run.key} is in use by another process")


@dataclass(frozen=True)
class _Dying(Wrapper):
    """A simulator that dies at its third call."""

    calls: list[int] = field(default_factory=list)

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        self.calls.append(len(values))
        if len(self.calls) > 2:
            raise Killed
        return self.simulator(values, seeds)


def test_page_of_one_finished_posterior(finished: Run, tmp_path: Path) -> None:
    report = Report("offlattice_posteriors", quick=True, docs=tmp_path)
    runs = [run_of(finished.folder, method) for method in METHODS]
    page.study(report, SIZES, runs, [])
    text = (tmp_path / "offlattice.md").read_text()
    assert "- AWRI 796, 50 µM: ABC-SMC to the same ε" in text
    assert "- AWRI 796, 50 µM: protocol reproduced" not in text
    assert "0.6332" in text or "0.633" in text
    assert "drifts of the chains" in text
    assert "attempts per cell" in text
    assert (tmp_path / "offlattice.png").stat().st_size > 10_000


def test_tables_hold_what_the_posterior_says(finished: Run) -> None:
    found = finished.posterior()
    rows = parameters(KEY, {"protocol": found}, METHODS)
    assert len(rows) == 10
    theirs = PUBLISHED_POSTERIORS[KEY]
    assert rows[0]["mean"] == theirs.mean[0]
    assert rows[3]["mean"] == pytest.approx(found.mean[1])
    assert rows[3]["mean − published, errors"] == pytest.approx((found.mean[1] - theirs.mean[1]) / theirs.error[1])
    means = found.values.mean(axis=1)
    np.testing.assert_allclose(chain_error(found), means.std(axis=0, ddof=1) / np.sqrt(3))
    assert (effective("protocol", found) > 0).all()
    assert density(found, 0)(np.array([0.5])).shape == (1,)


def test_drifts_have_signs() -> None:
    theirs = PUBLISHED_POSTERIORS["awri796-500um"]

    class Chains:
        values = np.concatenate([np.full((4, 100, 5), 0.5), np.full((4, 1, 5), 0.4)], axis=1)
        values[:, -1, 1] = 0.6

    rows = drifts(theirs, Chains(), None)  # type: ignore[arg-type]
    assert [row["same sign"] for row in rows] == ["yes", "no", "no", "no", "no"]
    drift, error = np.array(theirs.last) - np.array(theirs.early), np.array(theirs.last_error)
    chances = 100 * scipy.stats.norm.cdf(np.abs(drift) / error)  # all chains here end alike
    np.testing.assert_allclose([row["its chance, %"] for row in rows], chances)


def test_real_tables_are_those_of_the_masks(real_data: Path, tmp_path: Path) -> None:
    one = tmp_path / "masks"
    one.mkdir()
    for stem in ("awri796_50um_s01", "awri796_500um_s02", "simiwhite_50um_s01"):
        (one / f"{stem}.tif").symlink_to(real_data / "masks" / f"{stem}.tif")
    write_tables(one, tmp_path)
    for key in LI2024:
        lines = (tmp_path / key / "measurements.csv").read_text().splitlines()
        committed = (Path(__file__).parents[1] / "data/real" / key / "measurements.csv").read_text().splitlines()
        assert lines == committed[:2]


def test_single_colonies_scatter_about_the_published_means() -> None:
    for key, colonies in LI2024.items():
        assert real_colonies(key, FIVE).shape == (8, 5)
        rows = real_colonies(key, PUBLISHED)
        error = rows.std(axis=0, ddof=1) / np.sqrt(8)
        assert (np.abs(rows.mean(axis=0) - colonies.observed) < 3 * error).all()


@pytest.mark.slow
def test_all_of_it_in_a_quick_look(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as left:
        page.main(["--quick", "--set", KEY, "--work", str(tmp_path), "--docs", str(tmp_path / "docs")])
    assert left.value.code == 0
    found = {method: Posterior.load(tmp_path / "quick" / KEY / f"{method}.npz") for method in METHODS}
    assert found["emulator"].labels == FIVE
    assert found["emulator-theirs"].labels == PUBLISHED
    assert found["emulator-theirs"].replicates == 14
    assert found["protocol"].settings["tolerance"] == found["smc"].settings["tolerance"]
    assert "what the model reaches" in (tmp_path / "docs" / "offlattice.md").read_text()
