"""What to measure next: brute force, closed forms, and that more data never tell less."""

import csv
import json
import math
from dataclasses import replace
from itertools import combinations_with_replacement, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from sensitivities import made_up

from yeastfit import InputError, Sensitivity, plot
from yeastfit.commands import app as cli
from yeastfit.inference.information.design import By, design
from yeastfit.inference.information.design_result import Candidate, Criterion, Design
from yeastfit.inference.information.result import Information
from yeastfit.model.parameters import PARAMETERS
from yeastfit.offlattice.parameters import PARAMETERS as OFFLATTICE
from yeastfit.storage import write_json

FREE = ("mobility", "metabolic_rate", "aspect_ratio")
STATISTICS, TIMES = ("compactness", "area"), [1.0, 2.0, 3.0]
FOUND = made_up(STATISTICS, TIMES, FREE)
WIDTHS = np.array([np.log(high / low) for low, high in (PARAMETERS[name].plausible for name in FREE)]) / np.sqrt(12)


def by_hand(groups: list[tuple[float, list[int]]]) -> np.ndarray:
    """F of independent groups of colonies without measurement error: a sum."""
    total = np.diag(WIDTHS**-2.0)
    slopes = FOUND.jacobian
    for count, seen in groups:
        total = total + count * slopes[seen].T @ np.linalg.solve(FOUND.scatter[np.ix_(seen, seen)], slopes[seen])
    return total


def typical(total: np.ndarray, criterion: str) -> float:
    """From the eigenvalues of the covariance."""
    variances = 1.0 / np.linalg.eigvalsh(total)
    return float(np.sqrt(variances.mean()) if criterion == "mean" else np.sqrt(np.exp(np.log(variances).mean())))


EVERY = {"image": [[0, 3], [1, 4], [2, 5]], "statistic": [[k] for k in range(6)]}


@pytest.mark.parametrize("criterion", ["mean", "volume"])
@pytest.mark.parametrize("by", ["image", "statistic"])
def test_every_step_is_the_best_of_all_single_additions(by: By, criterion: Criterion) -> None:
    found = design(FOUND, by=by, criterion=criterion, replicates=4, added=7, steps=3, measurement_error=0.0)
    groups: list[tuple[float, list[int]]] = [(4.0, list(range(6)))]
    assert found.typical_error == pytest.approx(typical(by_hand(groups), criterion), rel=1e-4)
    assert len(found.sequence) == 3
    for step in found.sequence:
        tried = [typical(by_hand([*groups, (7.0, seen)]), criterion) for seen in EVERY[by]]
        best = EVERY[by][int(np.argmin(tried))]
        groups.append((7.0, best))
        assert [STATISTICS.index(name) * 3 + TIMES.index(step.time) for name in step.statistics] == best
        assert step.typical_error == pytest.approx(min(tried), rel=1e-4)
        variances = np.diag(np.linalg.inv(by_hand(groups)))
        assert list(step.log_standard_errors.values()) == pytest.approx(np.sqrt(variances), rel=1e-4)


def test_a_sequence_of_two_is_near_the_best_pair() -> None:
    """Taking the best one by one loses little against all pairs: here less than a percent."""
    found = design(FOUND, by="statistic", replicates=4, added=7, steps=2, measurement_error=0.0)
    base = (4.0, list(range(6)))
    pairs = combinations_with_replacement(EVERY["statistic"], 2)
    best = min(typical(by_hand([base, (7.0, a), (7.0, b)]), "mean") for a, b in pairs)
    assert best * (1 - 1e-4) <= found.sequence[-1].typical_error < 1.01 * best


def test_the_same_colonies_seen_once_more() -> None:
    """Two curves of four known; the third joins with its correlations."""
    found = design(
        FOUND, measured_statistics=["area"], measured_times=[1, 3], new_replicates=False, steps=9, measurement_error=0.0
    )
    offered = [(c.statistics, c.time) for c in found.singles]
    assert offered == [(("compactness",), t) for t in TIMES] + [(("area",), 2.0)]
    assert [c.statistics for c in found.images] == [("compactness",), STATISTICS, ("compactness",)]
    for choice, new in zip(found.singles, (0, 1, 2, 4), strict=True):
        assert choice.typical_error == pytest.approx(typical(by_hand([(10.0, [3, 5, new])]), "mean"), rel=1e-4)
    assert len(found.sequence) == 3  # then nothing is left
    assert found.sequence[-1].typical_error == pytest.approx(
        typical(by_hand([(10.0, list(range(6)))]), "mean"), rel=1e-4
    )
    table = found.table()
    assert np.isnan(table[1, [0, 2]]).all()
    assert (table[0] > 0).all()


@pytest.mark.parametrize("new_replicates", [True, False])
@pytest.mark.parametrize("error", [0.0, 0.5])
def test_adding_never_raises_errors(error: float, new_replicates: bool) -> None:
    """Also where derivatives are mostly noise, and with a measurement error that all colonies share."""
    for seed in range(5):
        noisy = made_up(STATISTICS, TIMES, FREE, seed, error)
        found = design(noisy, measured_times=[2.0], steps=4, by="statistic", new_replicates=new_replicates)
        states = [found.log_standard_errors, *(step.log_standard_errors for step in found.sequence)]
        for before, after in pairwise(states):
            assert all(after[name] <= before[name] * (1 + 1e-9) for name in FREE)
        for choice in (*found.images, *found.singles):
            assert choice.reduction > -1e-9
            assert all(
                choice.log_standard_errors[name] <= found.log_standard_errors[name] * (1 + 1e-9) for name in FREE
            )


def test_an_image_tells_at_least_as_much_as_each_of_its_statistics() -> None:
    found = design(FOUND)
    assert ([choice.reduction for choice in found.images] >= found.table().max(axis=0) - 1e-9).all()


def test_a_statistic_that_seems_to_tell_more_than_its_image_is_doubted() -> None:
    found = design(FOUND)
    assert found.doubts() == []
    image = found.images[0]
    more = [
        replace(one, reduction=image.reduction + 0.3) if one.time == image.time else one for one in found.singles[:2]
    ]
    (said,) = replace(found, singles=tuple(more)).doubts()
    assert said.startswith(f"{found.singles[0].statistics[0]} alone at {image.time:g} seems to lower")
    assert "take more runs" in said


def test_from_nothing_the_plausible_range_is_where_errors_start() -> None:
    """One parameter, then one image: variance 1 / (1/τ² + R jᵀS⁻¹j)."""
    found = design(FOUND, free=["mobility"], measured_times=[], added=10, steps=1, measurement_error=0.0)
    assert found.log_standard_errors["mobility"] == pytest.approx(WIDTHS[0])
    assert found.before.undetermined == ("mobility",)
    slopes = FOUND.jacobian[:, 0]
    for choice, seen in zip(found.images, EVERY["image"], strict=True):
        gained = 10 * slopes[seen] @ np.linalg.solve(FOUND.scatter[np.ix_(seen, seen)], slopes[seen])
        assert choice.log_standard_errors["mobility"] == pytest.approx((WIDTHS[0] ** -2 + gained) ** -0.5, rel=1e-4)


def test_a_measurement_error_that_replicates_share_sets_a_limit() -> None:
    """One curve: variance S / R + e² each, and e² between them: the same time, the same error."""
    one = made_up(("area",), [1.0], FREE[:1])
    slope, scatter, e2 = (
        float(one.jacobian.squeeze()),
        float(one.scatter.squeeze()),
        (0.1 * float(one.mean.item())) ** 2,
    )
    found = design(one, replicates=4, added=16, steps=1, measurement_error=0.1)
    sigma = np.array([[scatter / 4 + e2, e2], [e2, scatter / 16 + e2]])
    gained = slope**2 * np.linalg.inv(sigma).sum()
    expected = (WIDTHS[0] ** -2 + gained) ** -0.5
    assert found.sequence[0].log_standard_errors["mobility"] == pytest.approx(expected, rel=1e-4)


def test_a_statistic_that_alone_sees_a_parameter_is_taken_first() -> None:
    jacobian = FOUND.jacobian.copy()
    jacobian[:, 2] = 0.0
    jacobian[5, 2] = 3.0
    only = replace(FOUND, jacobian=jacobian)
    found = design(only, measured_statistics=["compactness"], by="statistic", steps=1)
    assert (found.sequence[0].statistics, found.sequence[0].time) == (("area",), 3.0)
    assert found.before.undetermined == ("aspect_ratio",)
    (sentence,) = found.sentences()
    assert sentence.startswith("measure area at 3 in 10 further replicates: the typical error falls from ")


def test_results_are_kept_and_drawn(tmp_path: Path) -> None:
    for by in ("image", "statistic"):
        found = design(FOUND, measured_times=[2], new_replicates=by == "image", by=by, prior={"mobility": 0.5})
        found.save(tmp_path / "design.json")
        again = Design.load(tmp_path / "design.json")
        assert again.sequence == found.sequence
        assert again.rows() == found.rows()
        assert again.sentences() == found.sentences()
        assert isinstance(again.images[0], Candidate)
        np.testing.assert_array_equal(again.table(), found.table())
        assert again.before.sentences() == found.before.sentences()
        plot.save(plot.design(found), tmp_path / f"{by}.png")
        assert (tmp_path / f"{by}.png").stat().st_size > 5000
    reductions = [row["reduction_percent"] for row in found.rows()]
    assert reductions == sorted(reductions, reverse=True)


def test_infinite_errors_are_kept(tmp_path: Path) -> None:
    found = design(FOUND, measured_times=[2], steps=1)
    found = replace(found, typical_error=np.inf, log_standard_errors=dict.fromkeys(found.free, np.inf))
    found.save(tmp_path / "design.json")
    again = Design.load(tmp_path / "design.json")
    assert (again.typical_error, again.log_standard_errors) == (found.typical_error, found.log_standard_errors)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"added": 0}, "added is 0"),
        ({"replicates": -1}, "replicates is -1"),
        ({"steps": 0}, "steps is 0"),
        ({"by": "hand"}, "by is 'hand', it must be one of image, statistic"),
        ({"criterion": "best"}, "criterion is 'best', it must be one of mean, volume"),
        ({"free": ["speed"]}, "free is speed"),
        ({"measured_times": [9.0]}, "time 9 is not in the sensitivity"),
        ({"prior": {"speed": 1.0}}, "prior names 'speed'"),
        ({"prior": [1.0]}, r"prior is \[1.0\], it must be standard deviations of log λ, by parameter"),
        ({"prior": {"mobility": "a"}}, "prior of mobility is 'a', it must be a number above 0"),
        ({"steps": 2.5}, "steps is 2.5, it must be a whole number from 1 to 1000"),
        ({"free": "speed"}, r"free is 'speed', it must be a list of names, such as \['speed'\]"),
        ({"measured_statistics": "area"}, r"statistics is 'area', it must be a list of names, such as \['area'\]"),
        ({"measurement_error": {"area": 0.1}}, "measurement_error is of area, compactness needs one, too"),
        ({"measurement_error": "a"}, "measurement_error is .*'a'.*, it must be numbers"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(values: dict, message: str) -> None:
    found: Sensitivity = FOUND
    with wrong_types(), pytest.raises(InputError, match=message):
        design(found, **values)


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_command_reads_a_sensitivity(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    FOUND.save(tmp_path / "found.json")
    out = tmp_path / "out"
    options = ["--measured-times", "1,2", "--measured-statistics", "area", "--by", "statistic", "--steps", "2"]
    assert cli.run(["design", "--sensitivity", str(tmp_path / "found.json"), "--out", str(out), *options]) == 0
    errors = {"compactness": 0.02, "area": 0.01}
    chosen: dict[str, Any] = {"measured_times": [1, 2], "measured_statistics": ["area"], "by": "statistic", "steps": 2}
    expected = design(FOUND, measurement_error=errors, **chosen)
    assert Design.load(out / "design.json").sentences() == expected.sentences()
    assert Information.load(out / "information.json").sentences() == expected.before.sentences()
    with (out / "design.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 + 6
    assert float(rows[0]["reduction_percent"]) == pytest.approx(expected.rows()[0]["reduction_percent"])
    for name in ("design.png", "spectrum.png", "ellipses.png"):
        assert (out / name).stat().st_size > 5000
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["command"], manifest["configuration"]["measured_times"]) == ("design", [1.0, 2.0])
    assert manifest["configuration"]["measurement_error"] == errors
    assert "1. measure " in capsys.readouterr().out


def test_errors_of_measurement_are_those_of_the_model(tmp_path: Path) -> None:
    """Of the off-lattice model those of outlines, as in its fits, unless one is given."""
    statistics = ("filament_area_index", "smoothed_branch_index")
    free = ("transition", "fork")
    plausible = {name: OFFLATTICE[name].plausible for name in free}
    colonies = replace(
        made_up(statistics, [math.nan], FREE[:2]), free=free, at=OFFLATTICE.defaults, plausible=plausible
    )
    colonies.save(tmp_path / "found.json")
    for given, errors in (((), (0.044, 0.13)), (("--measurement-error", "0.5"), (0.5, 0.5))):
        out = tmp_path / str(len(given))
        options = ["--model", "offlattice", "--free", ",".join(free), "--replicates", "8", "--out", str(out), *given]
        assert cli.run(["design", "--sensitivity", str(tmp_path / "found.json"), *options]) == 0
        manifest = json.loads((out / "manifest.json").read_text())
        assert manifest["configuration"]["measurement_error"] == dict(zip(statistics, errors, strict=True))


@pytest.mark.slow
def test_the_command_grows_colonies(tmp_path: Path) -> None:
    """Two curves at 4 and 8 nodes; what it leaves is read again, and then gives the same."""
    first, second = tmp_path / "first", tmp_path / "second"
    small = ["--times", "1.5,2.5", "--statistics", "area,radius", "--runs", "32", "--dt", "0.02", "--seed", "3"]
    assert cli.run(["design", "--out", str(first), "--free", "aspect-ratio", "--aspect-ratio", "0.6", *small]) == 0
    found = Sensitivity.load(first / "sensitivity.json")
    assert found.free == PARAMETERS.names
    assert (found.method, found.seed, found.runs) == ("regression", 3, {"mean": 8, "regression": 32})
    assert found.at["aspect_ratio"] == pytest.approx(0.6)
    again = ["--sensitivity", str(first / "sensitivity.json"), "--free", "aspect_ratio"]
    assert cli.run(["design", "--out", str(second), *again]) == 0
    assert (first / "design.csv").read_bytes() == (second / "design.csv").read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--mobility", "2"], "--mobility is given beside --sensitivity, but "),
        (["--runs", "64"], "--runs is given beside --sensitivity, but "),
        (["--free", "speed"], "free is speed, the sensitivity holds mobility, metabolic_rate, aspect_ratio"),
        (["--measured-times", "soon"], "--measured-times is 'soon', it must be numbers with commas"),
        (["--by", "hand"], "by is 'hand'"),
        (["--measured-times", "9"], "--measured-times is 9, need some of those in "),
        (["--measured-statistics", "speed"], "--measured-statistics: 'speed' is not among compactness, area"),
    ],
    ids=str,
)
def test_the_command_names_bad_input(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    FOUND.save(tmp_path / "found.json")
    with wrong_types():
        code = cli.run(
            ["design", "--sensitivity", str(tmp_path / "found.json"), "--out", str(tmp_path / "out"), *options]
        )
    assert code == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_sensitivity_by_no_estimator_is_refused(tmp_path: Path) -> None:
    write_json(tmp_path / "found.json", {**FOUND.asdict(), "method": -1})
    with wrong_types(), pytest.raises(InputError, match="method is -1, it must be one of combined"):
        Sensitivity.load(tmp_path / "found.json")


@pytest.mark.parametrize("text", [None, "", "{}", '{"free": 1}'], ids=str)
def test_the_command_names_a_file_that_is_no_sensitivity(
    text: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "found.json"
    if text is not None:
        path.write_text(text)
    assert cli.run(["design", "--sensitivity", str(path), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    wrong = "there is no such file" if text is None else "this is no sensitivity that was saved whole ("
    assert error.startswith(f"error: --sensitivity: {path}: {wrong}")
    assert error.endswith("need the sensitivity.json of an earlier run\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize("times", ["-1,2", "nan", "none"])
def test_times_that_cannot_be_are_named(times: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["design", "--times", times, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: --times is ")
