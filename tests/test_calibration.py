"""Calibration's arithmetic where exact draws are at hand, and its folder; slow: a small study of the real samplers."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_posteriors import flat_prior, made_posterior
from scipy.stats import binomtest
from simulators import observables_named, parameters_named

from benchmarks import calibration, ranks
from benchmarks.calibration import Study
from benchmarks.calibration_models import Young
from benchmarks.calibration_parts import CELLS, FEW_CELLS, FULL, QUICK, Part
from benchmarks.ranks import JOINT, LIKELIHOOD, Record, Uniform
from benchmarks.recovery import BOX
from benchmarks.report import Report
from yeastfit import InputError
from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.store.simulation_store import Store

EMULATED, ABC = FULL
QUANTITIES = (*BOX, LIKELIHOOD, JOINT)


def posterior_of(values: np.ndarray) -> Posterior:
    """One chain of equal weights."""
    return made_posterior(values[None], prior=flat_prior(*BOX))


def log_likelihood(data: np.ndarray, values: np.ndarray) -> np.ndarray:
    return -0.5 * ((values - data) ** 2).sum(axis=1)


def records(part: Part, *, width: float = 1.0, moved: float = 0.5, seed: int = 0) -> list[Record]:
    """λ ~ N(0, 1) and y ~ N(λ, 1) have the posterior N(y / 2, 1 / 2), here N(moved · y, width² (1 − moved))."""
    rng, found = np.random.default_rng(seed), []
    for number in range(1, part.count + 1):
        truth = rng.standard_normal(len(BOX))
        data = truth + rng.standard_normal(len(BOX))
        draws = moved * data + width * np.sqrt(1 - moved) * rng.standard_normal((2000, len(BOX)))
        rest = {
            "effective": 2000.0,
            "weighed": 2000.0,
            "simulations": 9,
            "fresh": 5,
            "seconds": 2.0,
            "warnings": [],
            "rounds": 3,
        }
        rest |= {"tolerance": None if part.emulator else 1.5}
        where = calibration.placed(posterior_of(draws), truth, part.draws, rng, partial(log_likelihood, data))
        found.append({"number": number, "status": "done", **where, **rest})
    return found


def judged(part: Part, each: list[Record]) -> tuple[dict[str, float], set[str]]:
    """Figures by name, without the method's, and those that missed their targets."""
    report = Report("calibration")
    ranks.verdicts(report, part, each)
    report.print()
    names = {figure.name: figure.name.removeprefix(f"{part.method}: ") for figure in report.figures}
    missed = {names[figure.name] for figure in report.figures if figure.met is False}
    return {names[figure.name]: figure.value for figure in report.figures}, missed


def test_exact_posteriors_are_calibrated() -> None:
    each = records(EMULATED)
    values, missed = judged(EMULATED, each)
    assert missed == set()
    assert values["inside 50 % intervals"] == pytest.approx(50, abs=5)
    assert values["inside 90 % intervals"] == pytest.approx(90, abs=4)
    assert values["independent draws, median"] == 2000
    ranks = np.array([[record["rank"][name] for name in QUANTITIES] for record in each])
    assert ranks.min() >= 0
    assert ranks.max() <= 99
    np.testing.assert_allclose(ranks.mean(axis=0), 49.5, atol=3 * 28.9 / np.sqrt(200))


def test_a_posterior_that_is_too_narrow_has_ranks_at_the_ends_and_is_missed() -> None:
    each = records(EMULATED, width=0.6)
    values, missed = judged(EMULATED, each)
    assert missed == {"inside 50 % intervals", "inside 90 % intervals", "least p of uniform ranks"}
    assert values["inside 90 % intervals"] == pytest.approx(67.6, abs=5)  # 2 Φ(0.6 · 1.645) − 1
    found = ranks.column(each, "rank", "mobility")
    ends, middle = ((found < 10) | (found >= 90)).sum(), ((found >= 40) & (found < 60)).sum()
    assert ends > 2 * middle


def test_a_posterior_that_is_too_wide_is_missed_from_above() -> None:
    _, missed = judged(EMULATED, records(EMULATED, width=1.6))
    ends = {"inside 50 % intervals, at most", "inside 90 % intervals, at most"}
    assert missed == {*ends, "least p of uniform ranks"}


def test_a_posterior_that_ignores_the_data_covers_all_and_is_missed_by_the_log_likelihood() -> None:
    each = records(EMULATED, moved=0.0)
    _, missed = judged(EMULATED, each)
    assert missed == {"least p of uniform ranks"}
    uniform = Uniform.of(200, 99)
    p = {name: uniform.p_value(ranks.column(each, "rank", name)) for name in QUANTITIES}
    assert p["log-likelihood"] < 0.001
    assert min(p[name] for name in BOX) > 0.01


def test_fewer_data_sets_are_judged_by_the_same_targets() -> None:
    values, missed = judged(ABC, records(ABC, seed=1))
    assert missed == set()
    assert values["tolerance, a Mahalanobis distance, median"] == 1.5
    _, missed = judged(ABC, records(ABC, width=0.6, seed=1))
    assert missed == {"inside 50 % intervals", "inside 90 % intervals", "least p of uniform ranks"}


def test_an_interval_of_coverage_holds_it_with_95_percent() -> None:
    """Shares below the truth are uniform where posteriors are right; here they are the same for two of three λ."""
    shares = np.random.default_rng(0).random((1000, 100, 3))
    shares[:, :, 1] = shares[:, :, 0]
    found = np.array(
        [ranks.coverage([{"share": dict(zip(BOX, one, strict=True))} for one in each], 0.9) for each in shares]
    )
    held = (found[:, 1] <= 90) & (found[:, 2] >= 90)
    assert held.mean() == pytest.approx(0.95, abs=0.03)


def test_the_band_holds_all_of_the_ecdf_of_uniform_ranks_with_its_probability() -> None:
    uniform = Uniform.of(100, 19)
    low, high = uniform.band()
    rng = np.random.default_rng(5)
    sets = rng.integers(20, size=(1000, 100))
    ecdf = (sets[:, :, None] < np.arange(1, 20)).mean(axis=1) - uniform.at
    inside = ((ecdf >= low - 1e-12) & (ecdf <= high + 1e-12)).all(axis=1).mean()
    assert inside == pytest.approx(0.95, abs=0.025)
    p = np.array([uniform.p_value(one) for one in sets[:300]])
    assert np.mean(p <= 0.1) == pytest.approx(0.1, abs=0.06)
    assert uniform.p_value(np.zeros(100, dtype=int)) < 0.001


class Echo:
    """In the place of colonies: statistics are λ, with noise."""

    parameters = parameters_named(tuple(BOX))
    observables = observables_named(("a", "b", "c"))

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        return values + 0.1 * np.array([np.random.default_rng(seed).standard_normal(3) for seed in seeds])


@pytest.fixture
def echoed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Part, "simulator", lambda self: Echo())
    monkeypatch.setattr(Part, "judging", lambda self, simulator, seed, store: None)


def made(number: int) -> Record:
    return {**records(replace(QUICK[0], each=1), seed=number)[0], "number": number}


def test_a_study_goes_on_after_the_last_whole_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, echoed: None
) -> None:
    study, asked = Study(QUICK, tmp_path), list[int]()

    def stops_at(last: int) -> Callable[..., Record]:
        def calibrated(part: Part, number: int, *rest: object) -> Record:
            if number > last:
                raise KeyboardInterrupt
            asked.append(number)
            return made(number)

        return calibrated

    monkeypatch.setattr(calibration, "calibrated", stops_at(2))
    with pytest.raises(KeyboardInterrupt):
        calibration.grow(study, 0, 0)
    with study.file(0, 0, "jsonl").open("a") as file:
        file.write('{"number": 3, "ask')
    assert [record["number"] for record in study.done(0, 0)] == [1, 2]
    monkeypatch.setattr(calibration, "calibrated", stops_at(4))
    calibration.grow(study, 0, 0)
    calibration.grow(study, 0, 0)
    assert asked == [1, 2, 3, 4]
    assert [record["number"] for record in study.done(0, 0)] == [1, 2, 3, 4]


def test_data_sets_of_other_settings_are_refused_before_anything_is_run(
    tmp_path: Path, echoed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = Study(QUICK, tmp_path)
    study.keep(1, 0, {**made(1), "asked": study.asked(1)})
    other = Study((QUICK[0], replace(QUICK[1], draws=9)), tmp_path)
    said = r"abc-smc00\.jsonl holds data sets of other settings or other code; name another folder"
    with pytest.raises(InputError, match=said):
        calibration.calibrate(Report("calibration"), other, 1)
    assert not study.file(0, 0, "jsonl").exists()
    monkeypatch.setattr(calibration, "code", lambda: "0" * 8)
    with pytest.raises(InputError, match=said):
        calibration.calibrate(Report("calibration"), study, 1)


def test_a_posterior_that_fails_is_kept_counted_and_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, echoed: None
) -> None:
    def fails(self: Part, *rest: object) -> Posterior:
        raise InputError("nothing came of it")

    monkeypatch.setattr(Part, "posterior", fails)
    study = Study((replace(EMULATED, groups=1, each=1),), tmp_path)
    calibration.grow(study, 0, 0)
    (record,) = study.done(0, 0)
    assert record["status"] == "failed: nothing came of it"
    good = records(EMULATED)
    values, missed = judged(EMULATED, [*good, record])
    assert values["posteriors that failed"] == 1
    assert missed == {"posteriors that failed"}


def test_truths_are_draws_from_the_prior_and_data_differ_from_one_to_the_next(tmp_path: Path) -> None:
    part, seen = replace(EMULATED, groups=2, each=40), list[dict[str, Any]]()

    class Kept(Part):
        def posterior(self, *rest: object) -> Posterior:
            raise InputError("not wanted")

    kept = Kept(**{name: getattr(part, name) for name in part.__dataclass_fields__})
    with Store(tmp_path / "store.h5", tuple(BOX), ("a", "b", "c")) as store:
        judge: Any = None
        seen = [calibration.calibrated(kept, n, Echo(), 0, store, judge) for n in range(1, kept.count + 1)]
    for k, (name, (low, high)) in enumerate(BOX.items()):
        truths = np.array([record["truth"][name] for record in seen])
        share = np.log(truths / low) / np.log(high / low)
        assert np.abs(np.sort(share) - (np.arange(80) + 0.5) / 80).max() < 1.63 / np.sqrt(80)
        data = np.array([record["observed"][k] for record in seen])
        assert np.std(data - truths) == pytest.approx(0.1 / np.sqrt(part.replicates), rel=0.3)


@pytest.mark.thorough
def test_page_and_picture_are_of_what_was_kept(tmp_path: Path, echoed: None) -> None:
    study = Study(QUICK, tmp_path / "work")
    for k, part in enumerate(QUICK):
        for record in records(part, seed=k):
            study.keep(k, 0, {**record, "asked": study.asked(k)})
    report = Report("calibration", quick=True, docs=tmp_path / "docs")
    calibration.calibrate(report, study, 1)
    assert report.met
    assert not any(figure.target for figure in report.figures)
    page = (tmp_path / "docs" / "calibration.md").read_text()
    assert "![Ranks of the truth](calibration.png)" in page
    assert "Talts et al. 2018" in page
    assert "simulations 128 (default 12288)" in page
    assert "--quick" not in page
    assert (tmp_path / "docs" / "calibration.png").stat().st_size > 10_000
    assert len(json.loads(json.dumps(report.asdict()))["data sets"][1]) == 4


@pytest.mark.thorough
def test_one_method_has_a_page_of_its_own(
    tmp_path: Path, echoed: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def calibrated(part: Part, number: int, *rest: object) -> Record:
        return {**records(part)[number - 1], "number": number}

    monkeypatch.setattr(calibration, "calibrated", calibrated)
    where = ["--work", str(tmp_path), "--docs", str(tmp_path / "docs"), "--jobs", "1"]
    with pytest.raises(SystemExit) as left:
        calibration.main(["--quick", "--method", "abc-smc", *where])
    assert left.value.code == 0
    assert sorted(one.name for one in (tmp_path / "docs").iterdir()) == [
        "calibration-abc-smc.md",
        "calibration-abc-smc.png",
    ]
    page = (tmp_path / "docs" / "calibration-abc-smc.md").read_text()
    assert "![Ranks of the truth](calibration-abc-smc.png)" in page
    assert "Written by `python -m benchmarks.calibration --method abc-smc --docs docs` on" in page
    assert "ABC-SMC: inside 90 % intervals" in page
    assert "emulator: inside" not in page
    with pytest.raises(SystemExit):
        calibration.main(["--quick", "--method", "abc"])
    assert "invalid choice: 'abc' (choose from" in capsys.readouterr().err


def test_the_off_lattice_model_has_studies_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = Study((CELLS,), tmp_path, model="offlattice")
    assert study.name == "calibration-offlattice"
    assert study.asked(0)["cells"] == 5000
    assert CELLS.count == 100
    simulator = FEW_CELLS.simulator()
    assert simulator.parameters.names == FEW_CELLS.prior.free
    rows = simulator(FEW_CELLS.prior.sample(3, np.random.default_rng(0)), np.arange(3))
    assert np.isfinite(rows).all()
    assert rows.shape == (3, 5)
    with pytest.raises(SystemExit):
        calibration.main(["--model", "offlattice", "--method", "abc-smc", "--work", str(tmp_path)])
    assert "abc-smc is not calibrated on the offlattice model" in capsys.readouterr().err


def test_coverage_is_of_the_parameters_that_were_ranked() -> None:
    shares: list[Record] = [{"share": {"fork": 0.5, "transition": 0.99, LIKELIHOOD: 0.99, JOINT: 0.99}}] * 4
    assert ranks.quantities(shares) == ("fork", "transition", LIKELIHOOD, JOINT)
    assert ranks.coverage(shares, 0.9)[0] == 50


@pytest.mark.slow
def test_the_off_lattice_study_from_command_to_page(tmp_path: Path) -> None:
    where = ["--work", str(tmp_path), "--docs", str(tmp_path / "docs"), "--jobs", "1"]
    with pytest.raises(SystemExit) as left:
        calibration.main(["--quick", "--model", "offlattice", *where])
    assert left.value.code == 0
    page = (tmp_path / "docs" / "calibration-offlattice.md").read_text()
    assert "Colonies of 600 cells, compared at 9000 pixels" in page
    assert "pseudohyphal from sated" in page
    assert "posteriors that failed | 0 " in page
    assert "python -m benchmarks.calibration --model offlattice --docs docs" in page


def test_help_says_what_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        calibration.main(["--help"])
    said = capsys.readouterr().out
    assert all(word in said for word in ("--quick", "--json", "python -m benchmarks.calibration", "Targets"))


@pytest.mark.slow
def test_real_posteriors_of_a_small_study_are_calibrated(tmp_path: Path) -> None:
    networks = TrainingSettings(members=3, width=32, steps=500)
    small: dict[str, Any] = {"groups": 1, "model": Young((1.5, 2.5, 3.5)), "judged": 256, "judge": networks}
    parts = (
        replace(EMULATED, each=20, **small, settings=SequentialEmulator(640, first=256, each=128, training=networks)),
        replace(ABC, each=10, **small, settings=AbcSmc(population=128, simulations=1024, pilot=256, batch=64)),
    )
    report = Report("calibration")
    calibration.calibrate(report, Study(parts, tmp_path), 1)
    found = {figure.name: figure for figure in report.figures}
    for part in parts:
        assert found[f"{part.method}: posteriors that failed"].value == 0
        assert found[f"{part.method}: least p of uniform ranks"].value > 0.001
        assert found[f"{part.method}: draws by their weights alone, median"].value > part.draws
    assert found["emulator: independent draws, median"].value > EMULATED.draws
    assert found["ABC-SMC: independent draws, median"].value > 5  # that the mean of so few, adjusted, is worth
    for level, (low, high) in ranks.LEVELS.items():  # ten data sets tell little: their interval must not lie outside,
        for name in BOX:  # a binomial one, as that from their scatter has no width where all truths are inside
            shares = ranks.column(report.details["data sets"][1], "share", name)
            inside = int(np.sum(np.abs(shares - 0.5) <= 0.5 * level))
            ends = binomtest(inside, len(shares)).proportion_ci(method="wilson")
            assert 100 * ends.high >= low, f"{name}: {inside} of {len(shares)} inside {level:.0%} intervals"
            assert 100 * ends.low <= high, f"{name}: {inside} of {len(shares)} inside {level:.0%} intervals"
    assert 32 < found["emulator: inside 50 % intervals"].value < 68  # two standard errors are some 15 %
    assert found["emulator: inside 90 % intervals"].value > 78


def test_a_further_study_has_truths_of_its_own() -> None:
    seeds = [replace(part, again=again).seed for again in (0, 1, 2) for part in FULL]
    assert len(set(seeds)) == 6
