"""Pages of fits, designs and simulations: what is doubtful, numbers with their units, and one sentence on them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Reader
from made_posteriors import made_posterior
from sensitivities import made_up
from stand_in import FREE, SETTINGS, drawn, fitted

from yeastfit import Fit, Parameters, Prior, Scales, design
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.report.files.design_files import write_design
from yeastfit.report.files.fit_files import write_fit
from yeastfit.report.html import in_units
from yeastfit.report.learnt import learnt_by_fit, learnt_by_posterior
from yeastfit.report.pages.fit_page import fit_page

TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)


@pytest.fixture(scope="module")
def result() -> Fit:
    short = replace(SETTINGS, members=(64,), spreads=(0.1,), measurement_error={"radius": 0.02})
    start = {"mobility": 1.5, "metabolic_rate": 0.9, "aspect_ratio": 0.5}
    return fitted(drawn(TRUTH, np.random.default_rng(0)), settings=short, start=start)


def test_a_page_of_a_fit_begins_with_doubts_and_has_parameters_in_units(result: Fit, tmp_path: Path) -> None:
    doubted = replace(result, warnings=("the outlines are <rough>",))
    write_fit(tmp_path, doubted)
    text = fit_page(doubted, Algebraic(rate=0.5, length=8.0), tmp_path, {"seed": "0"}, TRUTH.asdict())  # type: ignore[arg-type]
    page = Reader(text)
    headings = ["Doubts", "Parameters", "Curves", "What the data see", "Convergence", "How this was made"]
    assert [text.index(f">{name}</h2>") for name in headings] == sorted(text.index(f">{n}</h2>") for n in headings)
    assert "the outlines are <rough>" in page.words
    mobility, error = result.values["mobility"], result.standard_errors["mobility"]
    assert in_units(mobility, 32.0, "µm²/h", error) in page.words  # λ5 μ* L0²
    assert f"± {32 * error:.2g} µm²/h" in page.words
    assert "fixed" in page.words
    assert learnt_by_fit(result) in page.words
    alts = [image["alt"] for image in page.of("img") if image["alt"]]
    assert {"Data with their standard errors, the fitted curves, and the residuals below"} < set(alts)


def test_what_is_fixed_at_0_is_shown(result: Fit, tmp_path: Path) -> None:
    (seen,) = result.conditions
    held = replace(result, conditions=(replace(seen, parameters={**seen.parameters, "repulsivity": 0.0}),))
    write_fit(tmp_path, held)
    assert "repulsivity" in fit_page(held, Algebraic(), tmp_path, {})


def test_what_a_fit_does_not_determine_is_said(result: Fit) -> None:
    best = min(result.free, key=result.log_standard_errors.__getitem__).replace("_", " ")
    assert learnt_by_fit(result).startswith(f"The data determine {best} to ")
    seen = replace(result.information, data=np.diag([0.0, 0.0, 2500.0]), noise=np.zeros((3, 3)), prior={})
    said = "The data determine aspect ratio to 2 %; they do not determine mobility and metabolic rate."
    assert learnt_by_fit(replace(result, information=seen)) == said


def test_pairs_are_shown_where_there_are_some_and_each_doubt_once(result: Fit, tmp_path: Path) -> None:
    seen = replace(result.information, data=np.diag([0.0, 0.0, 2500.0]), noise=np.zeros((3, 3)), prior={})
    doubted = replace(result, information=seen, warnings=tuple(seen.sentences()))
    assert len(doubted.warnings) > 1
    for name, shown, pairs in (("all", result, True), ("one", doubted, False)):
        write_fit(tmp_path / name, shown)
        page = Reader(fit_page(shown, Algebraic(), tmp_path / name, {}))
        alts = [image["alt"] for image in page.of("img")]
        assert ("Errors of pairs of parameters, one and two standard errors" in alts) == pairs
        table = page.words.split("these combinations", 1)[1].split("Convergence")[0]
        assert "aspect ratio" in table
        assert "_" not in table
        assert [page.words.count(one) for one in shown.warnings] == [1] * len(shown.warnings)


def test_what_a_posterior_has_learnt_is_against_its_prior() -> None:
    rng = np.random.default_rng(3)
    prior = Prior.of({name: {"distribution": "log-uniform", "low": 0.1, "high": 10.0} for name in FREE[:2]})
    narrow, wide = np.exp(0.01 * rng.standard_normal((1, 4000))), prior.sample(4000, rng)[:, 0][None]
    said = learnt_by_posterior(made_posterior(np.stack([narrow, wide], axis=2), prior=prior), Algebraic())
    assert said.startswith("With 90 % probability mobility is 0.98")
    assert "25." in said  # µm²/h: λ5 = 1 is μ* L0² = 25.9
    assert "over 100 times narrower than before" in said
    assert said.endswith("metabolic rate is as uncertain as before.")
    moved = 10.0 ** rng.uniform(0.7, 1.0, (1, 4000))
    moved[0, :400] = 0.1  # a tenth far away: the standard deviation is the prior's, the median is not
    said = learnt_by_posterior(made_posterior(np.stack([narrow, moved], axis=2), prior=prior), Algebraic())
    assert "metabolic rate is 0.1000 to" in said
    assert said.endswith("larger than before.")
    pair = np.stack([narrow, 1 / narrow], axis=2)
    assert "compensate each other (correlation −1.00)" in learnt_by_posterior(
        made_posterior(pair, prior=prior), Algebraic()
    )


def test_parameters_stand_in_micrometres_and_hours() -> None:
    scales = Scales(length=8.0, rate=0.5)
    assert scales.unit((2, 1)) == (32.0, "µm²/h")
    assert scales.unit((0, 1)) == (0.5, "1/h")
    assert scales.unit((1, 0)) == (8.0, "µm")
    assert scales.unit((0, 0)) == (1.0, "")
    assert Algebraic(rate=0.5, length=8.0).unit_of("repulsivity") == (4.0, "µm/h")


def test_a_page_of_a_design_says_what_comes_next(tmp_path: Path) -> None:
    found = made_up(("compactness", "radius"), [2.0, 3.0, 4.0], FREE)
    result = design(found, measured_times=[2.0], replicates=8, added=8, steps=2)
    write_design(tmp_path, result, Algebraic(), found, {"replicates": 8})
    page = Reader((tmp_path / "index.html").read_text(encoding="utf-8"))
    for sentence in result.sentences():
        assert sentence in page.words
    assert "λ5: drift along the nutrient gradient" in page.words
    assert page.words.index("Doubts") < page.words.index("What to measure next") < page.words.index("All candidates")
