"""Comparisons of made-up runs: paired differences, verdicts, conditions, and what cannot be compared."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import wrong_types
from made_posteriors import made_posterior

from yeastfit import InputError
from yeastfit.inference.comparison.conditions import ConditionComparison
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.comparison.models import ModelComparison
from yeastfit.inference.comparison.runs import ComparedRun, Comparison
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.inference.prior.prior import Prior

COLONIES = 12


def predicted(density: np.ndarray, seed: int = 0, below: np.ndarray | None = None) -> LeftOut:
    """Predictions with these log densities of the same colonies; ranks are uniform unless they are given."""
    count = len(density)
    even = (np.arange(count) + 0.5) / count
    return LeftOut(
        ("area", "compactness"),
        tuple(map(str, range(count))),
        np.random.default_rng(seed).normal(10.0, 1.0, (count, 2)),
        np.arange(count) % 4,
        density,
        np.stack([even, even[::-1]], axis=1) if below is None else below,
        np.tile(np.linspace(-2, 2, 5)[None, :, None], (count, 1, 2)),
    )


def run(name: str, model: str, data: str, mean: float, left_out: LeftOut | None = None, **more: object) -> ComparedRun:
    """A run whose posterior of mobility is about `mean`."""
    draws = np.random.default_rng(7).normal(mean, 0.1, (4, 500, 1))
    settings = {"statistics": ("area", "compactness"), **more}
    return ComparedRun(name, model, (data,), settings, made_posterior(draws), left_out)


def test_paired_differences() -> None:
    """Colonies differ much from each other and runs little: the pairs tell runs apart that sums alone would not."""
    rng = np.random.default_rng(1)
    hard = rng.normal(-5.0, 4.0, COLONIES)
    lead = rng.normal(1.0, 0.5, COLONIES)
    found = ModelComparison.of({"worse": predicted(hard - lead), "better": predicted(hard)})
    best, other = found.runs
    assert (best.name, other.name) == ("better", "worse")
    assert best.behind == 0.0
    assert np.isclose(other.behind, lead.sum())
    assert np.isclose(other.error, np.sqrt(COLONIES) * lead.std(ddof=1))
    assert other.told_apart
    assert other.error < 0.3 * best.left_out.standard_error
    assert found.sentences() == [
        f"better predicts colonies left out better than worse, log density {lead.sum():+.1f} ± {other.error:.1f} "
        f"over {COLONIES} colonies"
    ]


def test_a_run_that_lacks_densities_is_judged_by_the_others() -> None:
    """Of its own sum it would be the best: fewer numbers below 0."""
    lacking = np.append(np.linspace(-6.1, -5.9, 3), np.full(COLONIES - 3, np.nan))
    found = ModelComparison.of({"bad": predicted(lacking), "good": predicted(np.full(COLONIES, -4.0))})
    assert [one.name for one in found.runs] == ["good", "bad"]
    assert found.runs[1].told_apart
    assert found.runs[1].behind == pytest.approx(6.0)
    assert "over 3 colonies" in found.sentences()[0]
    with pytest.raises(InputError, match="bad and good: no colony left out has a density in all of them"):
        ModelComparison.of({"bad": predicted(lacking), "good": predicted(np.where(np.isnan(lacking), -4.0, np.nan))})


def test_chance_tells_nothing_apart() -> None:
    """Of runs of one density but for noise, about one in 20 is called worse."""
    rng = np.random.default_rng(2)
    called = 0
    for _ in range(200):
        first, second = rng.normal(-3.0, 1.0, (2, COLONIES))
        found = ModelComparison.of({"a": predicted(first), "b": predicted(second)})
        called += found.runs[1].told_apart
    assert 1 <= called <= 22  # 10 ± 4 standard deviations of a binomial count


def test_what_no_run_explains() -> None:
    ends = np.stack([np.full(COLONIES, 0.999), (np.arange(COLONIES) + 0.5) / COLONIES], axis=1)
    off = {name: predicted(np.zeros(COLONIES) - k, below=ends) for k, name in enumerate("ab")}
    said = ModelComparison.of(off).sentences()
    assert "no run explains area" in said
    assert not any("explain compactness" in one for one in said)
    assert sum("does not explain area: predicted smaller than observed" in one for one in said) == 2


def test_conditions() -> None:
    """Two normal posteriors: their difference, its ratio and probability are the normal law's, weighted or not."""
    rng = np.random.default_rng(3)
    a, b = rng.normal(2.0, 0.3, (8, 1000, 1)), rng.normal(1.5, 0.4, (8, 1000, 1))
    found = ConditionComparison.of("x", made_posterior(a), "y", made_posterior(b)).changes[0]
    sd = 0.5  # of the difference
    np.testing.assert_allclose(found.difference, 0.5 + sd * np.array([-1.645, 0.0, 1.645]), atol=0.04)
    assert abs(found.larger - 0.841) < 0.02
    assert not found.told_apart
    assert np.isclose(found.error, np.sqrt(0.841 * 0.159 / 8000), rtol=0.2)
    low, middle, high = found.ratio
    assert 0.8 < low < middle < high
    assert abs(middle - 2.0 / 1.5) < 0.03
    twice = np.where(rng.random(a.shape[:2]) < 0.5, 2.0, 0.0)
    weighted = made_posterior(a, twice / twice.sum())
    other = ConditionComparison.of("x", weighted, "y", made_posterior(b)).changes[0]
    assert abs(other.larger - 0.841) < 0.03


def test_no_ratio_of_what_may_be_negative() -> None:
    draws = np.random.default_rng(4).normal(0.0, 1.0, (4, 100, 1))
    found = ConditionComparison.of("x", made_posterior(draws + 9), "y", made_posterior(draws)).changes[0]
    assert np.isnan(found.ratio).all()
    assert found.larger == 1.0
    assert found.error > 0
    sentence = ConditionComparison("x", "y", (found,)).sentences()[0]
    assert sentence == "mobility is larger in x than in y, with probability 1.000"


def test_models_and_conditions_together() -> None:
    """Two models on two sets: a comparison of models of each set, and of conditions under each model."""
    density = np.linspace(-4, -2, COLONIES)
    runs = [
        run(f"{model}-{data}", model, data, mean, predicted(density - (model == "old"), seed=ord(data)))
        for model in ("new", "old")
        for data, mean in (("p", 1.0), ("q", 2.0))
    ]
    found = Comparison.of(runs)
    assert [[one.name for one in each.runs] for each in found.models] == [["new-p", "old-p"], ["new-q", "old-q"]]
    assert [(one.first, one.second) for one in found.conditions] == [("new-p", "new-q"), ("old-p", "old-q")]
    assert found.settled
    assert found.doubts == ()
    assert "mobility is smaller in new-p than in new-q by a factor of 2.00" in " ".join(found.sentences())


def test_the_same_numbers_are_the_same_data() -> None:
    """One run read the photographs, the other the table that was measured on them."""
    density = np.linspace(-4, -2, COLONIES)
    first, second = (run(name, "m", data, 1.0, predicted(density)) for name, data in (("a", "p"), ("b", "table")))
    seen = [replace(one, posterior=replace(one.posterior, observed=np.array([3.25]))) for one in (first, second)]
    found = Comparison.of(seen)
    assert [[one.name for one in each.runs] for each in found.models] == [["a", "b"]]
    assert found.conditions == ()
    assert Comparison.of([first, second]).models == ()  # 0 of both, as a count may be


def test_doubts() -> None:
    """What has not settled, what differs besides, and runs that left nothing out are said."""
    first, second = run("a", "m", "p", 1.0, cells=1000), run("b", "m", "q", 1.0, cells=2000)
    second = replace(second, posterior=replace(second.posterior, status=Status.STILL_MOVING))
    third = run("c", "n", "p", 1.0)
    found = Comparison.of([first, second, third])
    assert not found.settled
    assert any(one.startswith("b: not settled") for one in found.doubts)
    assert "cells is 1000 in a and 2000 in b: parameters may differ by that alone" in found.doubts
    assert any(one.startswith("c has left no colonies out") for one in found.doubts)


def test_doubts_of_colonies_left_out_name_their_run() -> None:
    """And those of a run that is compared by conditions alone are none."""
    density = np.linspace(-4.0, -3.0, COLONIES)
    short = replace(predicted(density), doubts=("chains are too short",))
    pairs = replace(predicted(density - 1.0), group=np.arange(COLONIES) % 6)
    found = Comparison.of([run("a", "m", "p", 1.0, short), run("b", "n", "p", 1.0, pairs)])
    assert found.doubts == (
        "colonies were left out in 4 groups in a and in 6 in b, and predicted from other numbers of colonies: "
        "densities may differ by that alone",
        "a: chains are too short",
    )
    other = replace(predicted(density, seed=3), doubts=("chains are too short",))
    assert Comparison.of([run("a", "m", "p", 1.0, short), run("b", "m", "q", 1.0, other)]).doubts == ()


def test_colonies_of_both_conditions_are_a_doubt() -> None:
    first, second = predicted(np.zeros(COLONIES)), predicted(np.zeros(COLONIES), seed=3)
    observed = second.observed.copy()
    observed[:3], observed[0, 1] = first.observed[5:8], np.nan
    runs = [run("a", "m", "p", 1.0, first), run("b", "m", "q", 1.0, replace(second, observed=observed))]
    assert Comparison.of(runs).doubts == ("a and b have 3 colonies in common, and are compared as if all were others",)


def test_the_density_of_some_colonies_is_said_to_be_of_those() -> None:
    density = np.where(np.arange(COLONIES) < 2, np.nan, -3.0)
    words = "12 colonies left out in 4 groups: log predictive density of 10 of them -30.0 ± 0.0; "
    assert predicted(density).sentence().startswith(words)


def test_colonies_are_known_without_any_left_out() -> None:
    """By what is observed of both, other statistics besides; whole numbers alone are no colony's own."""
    rows = [{"area at 9": 11.5 + k, "holes at 9": 3.0} for k in range(5)]
    others = [{"area at 9": 12.5, "solidity at 9": 0.9}, {"area at 9": 99.5, "holes at 9": 3.0}, {"holes at 9": 3.0}]
    runs = [
        replace(run("a", "m", "p", 1.0), colonies=tuple(rows)),
        replace(run("b", "m", "q", 1.0), colonies=tuple(others)),
    ]
    assert Comparison.of(runs).doubts == ("a and b have 1 colony in common, and are compared as if all were others",)


@pytest.mark.parametrize("level", [90, -0.1, np.nan, "half"])
def test_levels_are_shares(level: float) -> None:
    with wrong_types(), pytest.raises(InputError, match=r"level is .*, it must be a number in 0\.\.1, such as 0\.9"):
        predicted(np.zeros(COLONIES)).coverage(level)


def test_other_priors_are_doubts() -> None:
    first, second = run("a", "m", "p", 1.0), run("b", "m", "q", 1.0)
    assert Comparison.of([first, second]).doubts == ()
    name = first.posterior.free[0]
    narrow = Prior({name: Distribution("uniform", {"low": 0.0, "high": 2.5})})
    second = replace(second, posterior=replace(second.posterior, prior=narrow))
    (doubt,) = Comparison.of([first, second]).doubts
    assert doubt.startswith(f"the prior of {name} is ")
    assert doubt.endswith(" in a and uniform (low 0, high 2.5) in b: posteriors may differ by that alone")


@pytest.mark.parametrize(
    ("runs", "words"),
    [
        ([run("a", "m", "p", 1.0)], "got a, need at least two"),
        ([run("a", "m", "p", 1.0), run("a", "m", "q", 1.0)], "a is given twice"),
        ([run("a", "m", "p", 1.0), run("b", "n", "q", 1.0)], "other models and other data"),
        ([run("a", "m", "p", 1.0), run("b", "n", "p", 1.0)], "a has left no colonies out"),
    ],
)
def test_nothing_to_compare(runs: list[ComparedRun], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Comparison.of(runs)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"labels": ("area", "radius")}, "densities compare only of the same ones"),
        ({"observed": predicted(np.zeros(COLONIES), seed=5).observed}, "of the colonies is another one"),
    ],
)
def test_other_data(change: dict[str, object], words: str) -> None:
    first = predicted(np.zeros(COLONIES))
    second = replace(first, **change)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=words):
        ModelComparison.of({"a": first, "b": second})
    with pytest.raises(InputError, match="of 12 and 5 colonies"):
        ModelComparison.of({"a": first, "b": predicted(np.zeros(5))})
