"""Posteriors by several methods beside each other and beside the truth: `benchmarks.agreement`."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_posteriors import made_posterior

from benchmarks import agreement, truth
from benchmarks.agreement import Found, Size, agree
from benchmarks.recovery import BOX
from benchmarks.report import Report
from yeastfit.inference.abc.distances import WeightedCurves
from yeastfit.inference.abc.smc import SmcDiagnostics
from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics, RoundDiagnostics
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.prior import Prior

FREE = tuple(BOX)
CENTRE, COVARIANCE = np.array([0.2, -0.1, -0.5]), np.array([[0.04, -0.03, 0.0], [-0.03, 0.05, 0.0], [0.0, 0.0, 0.01]])


def samples(seed: int, *, shift: float = 0.0, share: float = 0.0, draws: int = 400) -> Posterior:
    """Draws of log λ, normal; with a share of the emulator's error, which moves all of them."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(COVARIANCE)
    off = shift * np.sqrt(np.diag(COVARIANCE)) + np.sqrt(share * np.diag(COVARIANCE)) * rng.standard_normal(3)
    x = CENTRE + off + rng.standard_normal((4, draws // 4, 3)) @ root.T
    distance = WeightedCurves(np.ones(1), np.ones(1))
    diagnostics: Diagnostics = SmcDiagnostics((2.0, 0.5), (1.0, 0.5), (10, 20), "it ended", distance)
    if share:
        held_out = CrossValidation(("s",), np.zeros(1), np.eye(1), np.zeros(1), 10)
        diagnostics = EmulatorDiagnostics((RoundDiagnostics(10, 0, 0.1, share, True, held_out),), 10, 0)
    positive = {name: {"distribution": "log-uniform", "low": 1e-9, "high": 1e9} for name in FREE}
    more: dict[str, Any] = {"prior": Prior.of(positive), "labels": ("s",), "diagnostics": diagnostics}
    return made_posterior(np.exp(x), **more)


def test_a_posterior_holds_its_draws_with_their_probability() -> None:
    found = Found.of(samples(0, draws=4000))
    rng = np.random.default_rng(1)
    truths = CENTRE + rng.standard_normal((400, 3)) @ np.linalg.cholesky(COVARIANCE).T
    inside = [found.inside(truth) for truth in truths]
    assert np.mean([each for each, _ in inside]) == pytest.approx(0.9, abs=0.03)
    assert np.mean([joint for _, joint in inside]) == pytest.approx(0.9, abs=0.045)
    assert found.epsilon == 0.5
    np.testing.assert_allclose(found.mean, CENTRE, atol=5 * found.error.max())


@pytest.mark.parametrize(("shift", "wide"), [(0.0, 1.0), (0.6, 4.0)])
def test_scores_are_what_errors_say(shift: float, wide: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Posteriors of one law, and then one method beside it."""

    def made(name: str, seed: int, size: Size, work: Path, report: Report) -> dict[str, Found]:
        number = 100 * agreement.SETS.index(name) + 10 * seed
        return {
            "emulator": Found.of(samples(number, share=0.02)),
            "abc-smc": Found.of(samples(number + 1)),
            "abc-mcmc": Found.of(samples(number + 2, shift=shift)),
        }

    monkeypatch.setattr(agreement, "beside", made)
    monkeypatch.setattr(agreement, "truth_of", lambda name, free: CENTRE)
    report, size = Report("agreement"), Size(seeds=(1, 2, 3, 4))
    found = agree(report, size, tmp_path)
    figures = {figure.name: figure for figure in report.figures}
    between = figures["z of means between methods, rms"]
    assert between.value == pytest.approx(wide, rel=0.3) if shift == 0 else between.value > 2
    assert figures["z of means of one method, rms"].value == pytest.approx(1.0, rel=0.3)
    assert report.met is (shift == 0)
    agreement.picture(found, size, tmp_path / "agreement.png")
    text = agreement.markdown(report)
    assert "python -m" in text
    assert "shift, sd" in text


def test_few_data_are_the_first_colonies_at_two_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    masks = tmp_path / "demo" / "measured"

    class Data:
        rows = [  # noqa: RUF012
            {"replicate": str(colony), "hours": hours, "mask": f"masks/{colony}-{hours:g}.png"}
            for colony in range(1, 8)
            for hours in (5.0, 7.0, 9.0)
        ]
        folder = masks

    monkeypatch.setattr(agreement, "measure_source", lambda *given: Data)
    table = agreement.few("demo", tmp_path)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["replicate"], float(row["hours"])) for row in rows] == [
        (str(colony), hours) for colony in range(1, 5) for hours in agreement.HOURS
    ]
    assert (table.parent / rows[0]["mask"]).resolve() == (masks / "masks" / "1-7.png").resolve()


def test_truths_inside_and_outside_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two data sets one truth is three standard deviations off, in one λ."""
    off = {"demo": 0.0, "slender": 3.0}
    monkeypatch.setattr(truth, "posterior", lambda source, folder, request: Found.of(samples(1, draws=4000)))
    monkeypatch.setattr(truth, "truth_of", lambda name, free: CENTRE + off[name] * np.array([0.0, 0.0, 0.1]))
    report = Report("truth", docs=tmp_path)
    truth.judge(report, ("demo", "slender"), tmp_path)
    figures = {figure.name: (figure.value, figure.target, figure.met) for figure in report.figures}
    assert figures["λ inside their 90 % intervals"] == (5, 6, False)
    assert figures["sets inside their joint 90 % region"] == (1, 2, False)
    ((_, rows),) = report.tables.items()
    assert [row["inside"] for row in rows] == ["yes"] * 5 + ["no"]
    assert rows[5]["true"] == pytest.approx(np.exp(CENTRE[2] + 0.3))
    quick = Report("truth", quick=True)
    truth.judge(quick, ("demo",), tmp_path)
    assert not any(figure.target for figure in quick.figures)
