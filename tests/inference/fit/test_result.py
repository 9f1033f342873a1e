"""The result of a fit: saved, loaded, tabled and drawn."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from stand_in import FREE, SETTINGS, drawn, fitted

from yeastfit import Fit, InputError, Parameters, plot
from yeastfit.inference.fit.bootstrap_profile import Bootstrap, Profile
from yeastfit.model.parameters import PARAMETERS

TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)
START = {"mobility": 1.5, "metabolic_rate": 0.9}
SHORT = replace(SETTINGS, members=(64,), spreads=(0.1,), measurement_error={"radius": 0.02})


@pytest.fixture(scope="module")
def alone() -> Fit:
    targets = drawn(TRUTH, np.random.default_rng(0))
    return fitted(targets, prior={"aspect_ratio": (0.6, 0.5)}, settings=SHORT, start=START | {"aspect_ratio": 0.5})


@pytest.fixture(scope="module")
def both() -> Fit:
    rng = np.random.default_rng(1)
    targets = {"rich": drawn(TRUTH, rng), "poor": drawn(TRUTH.replace(mobility=1.0), rng)}
    return fitted(targets, free=FREE[:2], own=("mobility",), settings=SHORT, start=START)


@pytest.mark.parametrize("which", ["alone", "both"])
def test_a_fit_is_loaded_as_it_was_saved(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    result: Fit = request.getfixturevalue(which)
    result.save(tmp_path / "fit.json")
    again = Fit.load(tmp_path / "fit.json")
    again.save(tmp_path / "again.json")
    assert (tmp_path / "fit.json").read_text() == (tmp_path / "again.json").read_text()
    for name in ("theta", "jacobian", "log_covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    plain = {each.name for each in fields(Fit)} - {"theta", "jacobian", "conditions", "information", "starts", "space"}
    for name in plain:
        assert getattr(again, name) == getattr(result, name), name
    assert again.space.entries == result.space.entries
    for one, other in zip(again.conditions, result.conditions, strict=True):
        assert one.parameters == other.parameters
        for part in ("fitted", "covariance", "residuals"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
    for begun, start in zip(again.starts, result.starts, strict=True):
        np.testing.assert_array_equal(begun.begin, start.begin)
        assert (begun.cost, begun.ended, begun.carried) == (start.cost, start.ended, start.carried)
    assert again.rows() == result.rows()


def test_rows_name_every_parameter_and_its_role(alone: Fit, both: Fit) -> None:
    rows = {row["parameter"]: row for row in alone.rows()}
    assert tuple(rows) == PARAMETERS.names
    for name in PARAMETERS.names:
        free = name in FREE
        assert rows[name]["role"] == ("free" if free else "fixed")
        assert rows[name]["standard_error"] == (alone.standard_errors[name] if free else None)
    table = {(row["condition"], row["parameter"]): row for row in both.rows()}
    assert len(table) == 2 * len(PARAMETERS.names)
    assert [table[name, "metabolic_rate"]["role"] for name in ("rich", "poor")] == ["shared", "shared"]
    assert table["rich", "metabolic_rate"]["value"] == table["poor", "metabolic_rate"]["value"]
    assert [table[name, "mobility"]["role"] for name in ("rich", "poor")] == ["free", "free"]
    assert table["rich", "mobility"]["standard_error"] == both.standard_errors["mobility of rich"]
    assert table["rich", "mobility"]["value"] > table["poor", "mobility"]["value"]


def test_errors_are_those_of_the_logarithm_times_the_value(alone: Fit) -> None:
    for k, name in enumerate(FREE):
        assert alone.standard_errors[name] == pytest.approx(alone.values[name] * np.sqrt(alone.log_covariance[k, k]))
        assert alone.values[name] == pytest.approx(alone.parameters[name], rel=1e-6)
    assert alone.degrees_of_freedom == 12 + 1 - 3


def test_of_several_conditions_there_is_no_single_one(both: Fit) -> None:
    for what in ("parameters", "targets"):
        with pytest.raises(InputError, match="the fit has the conditions 'rich', 'poor'"):
            getattr(both, what)


def words(figure: Figure) -> str:
    """Everything that is written in a figure."""
    figure.canvas.draw()
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    for axes in figure.axes:
        texts += [axes.get_title(), axes.get_xlabel(), axes.get_ylabel()]
        legend = axes.get_legend()
        texts += [text.get_text() for text in legend.get_texts()] if legend else []
    return "\n".join([*texts, figure.get_suptitle()])


def test_curves_are_drawn_with_the_fit_and_the_truth(alone: Fit, both: Fit) -> None:
    said = words(plot.fit(alone, {"mobility": 2.0}))
    for part in ("mobility", "true 2", "±", "chi-square", alone.message, "hours", "residual / error", "data", "fitted"):
        assert part in said
    assert "true" not in words(plot.fit(alone))
    said = words(plot.fit(both))
    for part in ("of rich", "of poor", "mobility of rich"):
        assert part in said


def test_conditions_of_any_name_are_drawn_as_they_are(both: Fit, tmp_path: Path) -> None:
    """No mathtext, no markup; warnings are errors, also those of missing glyphs and of labels that are too long."""
    both.save(tmp_path / "fit.json")
    plain = (tmp_path / "fit.json").read_text()
    for rich, poor in (("$\\frac{ 培养基 [red]", "_$50$ µM"), ("x " * 100, "y" * 200)):
        odd = plain.replace("rich", json.dumps(rich)[1:-1]).replace("poor", json.dumps(poor)[1:-1])
        (tmp_path / "odd.json").write_text(odd)
        result = Fit.load(tmp_path / "odd.json")
        assert result.free[:2] == (f"mobility of {rich}", f"mobility of {poor}")
        for figure in (plot.fit(result), plot.convergence(result), plot.spectrum(result.information)):
            words(figure)
        words(plot.ellipses(result.information))


def test_convergence_is_drawn_over_colonies(alone: Fit) -> None:
    said = words(plot.convergence(alone))
    for part in ("mobility", "metabolic rate", "aspect ratio", "simulations", "start 1", alone.message):
        assert part in said


def test_profiles_and_bootstraps_are_drawn(alone: Fit) -> None:
    values = np.exp(np.linspace(0.5, 0.9, 9))
    profile = Profile("mobility", 2.0, 0.1, values, (np.log(values / 2.0) / 0.1) ** 2)
    said = words(plot.profiles({"mobility": profile}))
    for part in ("mobility", "rise of χ²", "68 %", "95 %", "profile", "standard error"):
        assert part in said
    draws = np.exp(alone.theta + 0.05 * np.random.default_rng(0).normal(size=(20, 3)))
    found = Bootstrap(FREE, draws, dict.fromkeys(FREE, 0.05), dict.fromkeys(FREE, (0.9, 1.1)), 0.0, 0, 512)
    said = words(plot.bootstrap(found, alone))
    for part in ("mobility (%)", "aspect ratio (%)", "resampled replicates"):
        assert part in said
