"""The study of recovery: its truths, what it counts, and how it goes on."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import recovery
from benchmarks.report import Report
from yeastfit import InputError


def record_of(study: recovery.Study, number: int, pulls: tuple[float, float, float], error: float = 0.1) -> dict:
    """A fit that is off by so many standard errors in mobility, metabolic rate and aspect ratio."""
    true = study.recipes[number - 1].parameters
    names = list(recovery.BOX)
    return {
        "truth": number,
        "asked": study.asked(number),
        "status": "converged",
        "converged": True,
        "simulations": 1000 + number,
        "seconds": 10.0 * number,
        "log": {name: math.log(true[name]) + pull * error for name, pull in zip(names, pulls, strict=True)},
        "error": dict.fromkeys(names, error),
        "warnings": [],
    }


def test_truths_are_spread_over_the_box_and_always_the_same(tmp_path: Path) -> None:
    study, again = (recovery.Study.of(False, tmp_path) for _ in range(2))
    assert study.recipes == again.recipes
    for name, (low, high) in recovery.BOX.items():
        values = np.array([recipe.parameters[name] for recipe in study.recipes])
        assert ((values > low) & (values < high)).all()
        thirds = np.histogram(np.log(values), bins=np.linspace(np.log(low), np.log(high), 4))[0]
        assert thirds.min() >= 4


def test_recovery_counts_what_is_inside_its_errors_and_missing_errors_apart(tmp_path: Path) -> None:
    study, report = recovery.Study.of(False, tmp_path), Report("recovery")
    records = [record_of(study, 1, (0.5, -1.5, 2.5)), record_of(study, 2, (-0.9, 1.9, 0.1))]
    records[1]["error"]["aspect_ratio"] = None
    recovery.verdicts(report, records)
    found = {figure.name: figure for figure in report.figures}
    assert found["within 2 standard errors"].value == pytest.approx(100 * 4 / 5)
    assert found["within 2 standard errors"].met is False
    assert found["within 2 standard errors, at most"].met is True
    assert found["within 1 standard error"].value == pytest.approx(100 * 2 / 5)
    assert found["without a standard error"].value == pytest.approx(100 / 6)
    assert found["mobility: rms pull"].value == pytest.approx(math.sqrt((0.5**2 + 0.9**2) / 2))
    assert found["mobility: median relative error"].value == pytest.approx(50 * (math.expm1(0.05) - math.expm1(-0.09)))
    assert found["a fit, median"].value == 15.0
    report.print()


def test_recovery_goes_on_after_the_last_whole_line_and_refuses_other_settings(tmp_path: Path) -> None:
    study = recovery.Study.of(False, tmp_path)
    for number in (1, 2):
        study.keep(record_of(study, number, (0.0, 0.0, 0.0)))
    with study.lines.open("a") as file:
        file.write('{"truth": 3, "ask')
    assert list(study.done()) == [1, 2]
    study.keep(record_of(study, 3, (0.0, 0.0, 0.0)))
    assert list(study.done()) == [1, 2, 3]
    study.keep({**record_of(study, 4, (0.0, 0.0, 0.0)), "asked": study.asked(5)})
    with pytest.raises(InputError, match="--again"):
        study.done()
