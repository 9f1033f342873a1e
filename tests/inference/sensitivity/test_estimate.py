"""The estimators where the answer is known, their blend's risk, and the whole on small colonies."""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types

from benchmarks.gradients import compare, differences, estimates
from yeastfit import (
    InputError,
    Model,
    Numerics,
    Parameter,
    Parameters,
    ParameterSet,
    Relaxation,
    Sensitivity,
    SensitivityStatus,
    Targets,
    fit,
    sensitivity,
)
from yeastfit.errors import SimulationError
from yeastfit.inference.sensitivity import pathwise as module
from yeastfit.inference.sensitivity.estimate import STATISTICS
from yeastfit.inference.sensitivity.estimator import doubts
from yeastfit.inference.sensitivity.result import Estimate
from yeastfit.inference.sensitivity.shrinkage import combine
from yeastfit.inference.simulator import rows_of
from yeastfit.observable import Observable
from yeastfit.storage import read_json, write_json

SMALL = Numerics(domain=12.0, spacing=0.25, dt=0.02, capacity=64)
BIASED = Model.of({"budding": {"rule": "biased"}})


# --- the blend --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("quiet", [0.1, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("bias", [0.0, 0.5, 1.0, 2.0, 5.0])
def test_the_blend_is_never_worse_than_the_regression(quiet: float, bias: float) -> None:
    """Mean squared error over 20000 draws, in units of the regression's; the errors it states are of the right size."""
    rng = np.random.default_rng(1)
    off = rng.normal(size=7)
    off *= bias * np.sqrt(7) / np.linalg.norm(off)
    ones = np.ones((20000, 7))
    unbiased = Estimate(rng.normal(size=ones.shape), ones)
    pathwise = Estimate(off + quiet * rng.normal(size=ones.shape), quiet * ones)
    jacobian, error, share = combine(unbiased, pathwise)
    risk = np.mean(jacobian**2)
    assert risk < 1.01
    assert 0.6 < np.sqrt(np.mean((jacobian / error) ** 2)) < 1.3
    assert np.mean(np.abs(jacobian / error) > 3) < 0.03
    if bias == 0:  # between the blend that knows that there is no bias, and what James and Stein's factor costs
        assert quiet**2 / (1 + quiet**2) < risk < quiet**2 / (1 + quiet**2) + 0.25
    if bias == 5:
        assert share.mean() < 0.05


def test_the_blend_leaves_alone_what_it_cannot_better() -> None:
    unbiased = Estimate(np.ones((1, 7)), np.full((1, 7), 0.5))
    ones = np.ones((1, 7))
    for useless in (Estimate(np.nan * ones, ones), Estimate(ones, np.inf * ones)):
        jacobian, error, share = combine(unbiased, useless)
        assert share == 0
        np.testing.assert_array_equal(jacobian, unbiased.jacobian)
        np.testing.assert_array_equal(error, unbiased.error)
    known = Estimate(np.ones((1, 7)), np.zeros((1, 7)))  # the count before the first event
    assert combine(known, Estimate(np.zeros((1, 7)), np.ones((1, 7))))[2] == 0
    two = Estimate(np.ones((1, 2)), np.ones((1, 2)))  # fewer than three parameters
    assert combine(two, two)[2] == 0


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("given", [(1,), (3,), ()], ids=["one column", "three columns", "no columns"])
def test_rows_of_another_shape_are_refused(given: tuple[int, ...]) -> None:
    """By sensitivities and by fits, as by samplers."""

    class Shapeless:
        parameters = ParameterSet((Parameter("rate", "r", "growth", (0.1, 2.0), 0.5),))
        observables = (Observable("size", 1.0), Observable("size", 2.0))

        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
            return np.ones((len(seeds), *given))

    said = r"simulator gave shape \(.*\), expected \(.*, 2\): a row for each seed, a column for each observable"
    with pytest.raises(InputError, match=said):
        sensitivity(simulator=Shapeless(), at={"rate": 0.5}, runs=16)
    targets = Targets.from_replicates({"size": np.array([[1.0, 2.0], [1.1, 2.1], [0.9, 1.9]])}, [1.0, 2.0])
    with pytest.raises(InputError, match=said):
        fit(targets, Shapeless())


def test_rows_are_numbers() -> None:
    class Wordy:
        parameters = ParameterSet((Parameter("rate", "r", "growth", (0.1, 2.0), 0.5),))
        observables = (Observable("size", 1.0),)

        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> Any:
            return [["much"] for _ in seeds]

    with pytest.raises(InputError, match=r"simulator gave .*much.*, expected an array of numbers of shape \(2, 1\)"):
        rows_of(Wordy(), np.ones((2, 1)), np.arange(2))


def test_why_all_simulations_failed_is_said() -> None:
    class Failing:
        parameters = ParameterSet((Parameter("rate", "r", "growth", (0.1, 2.0), 0.5),))
        observables = (Observable("size", 1.0),)

        def __init__(self) -> None:
            self.problems = Counter[str]()

        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
            self.problems["no cell could bud"] += len(seeds)
            return np.full((len(seeds), 1), np.nan)

    with pytest.raises(SimulationError, match=r"^8 simulations at rate 0.5 failed: no cell could bud \(8 of them\)$"):
        sensitivity(simulator=Failing(), at={"rate": 0.5}, runs=16)


# --- on colonies ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found() -> Sensitivity:
    """Two times, 8 and 16 nodes, of the hard model."""
    return sensitivity(Parameters(aspect_ratio=0.7), times=[3.5, 4.5], numerics=SMALL, runs=128, paths=8)


@pytest.mark.thorough
def test_a_result_is_whole(found: Sensitivity, tmp_path: Path) -> None:
    for one in (found.jacobian, found.error):
        assert found.on_grid(one).shape == (5, 2, 7)
        np.testing.assert_array_equal(found.on_grid(one).reshape(10, 7), one)
    for one in (found.mean, found.mean_error, found.pathwise_share, found.tails):
        assert found.on_grid(one).shape == (5, 2)
    assert (found.pathwise_share >= 0).all()
    assert found.scatter.shape == found.correlation.shape == (10, 10)
    np.testing.assert_array_equal(found.scatter, found.scatter.T)
    assert np.linalg.eigvalsh(found.scatter).min() > -1e-9 * np.trace(found.scatter)
    alone = np.sqrt(32) * found.mean_error[:8]  # of 32 colonies at λ, known to 13 %; of the count it may be 0
    beside = np.sqrt(np.diag(found.scatter))[:8] / alone
    assert (np.abs(beside - 1) < 0.45).all()
    assert found.runs == {"mean": 32, "regression": 128, "pathwise": 8}
    rows = found.rows()
    assert len(rows) == 5 * 2 * 7
    assert {row["carried_by"] for row in rows} <= {"regression", "pathwise"}
    found.save(tmp_path / "sensitivity.json")
    again = Sensitivity.load(tmp_path / "sensitivity.json")
    for name in ("times", "mean", "jacobian", "error", "pathwise_share", "tails", "scatter", "correlation"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    assert again.rows() == rows
    assert (again.at, again.plausible, again.observables) == (found.at, found.plausible, found.observables)
    assert again.warnings == found.warnings
    assert again.status is (SensitivityStatus.DOUBTFUL if found.warnings else SensitivityStatus.ESTIMATED)
    replace(found, jacobian=np.where(np.arange(7) == 3, np.nan, found.jacobian)).save(tmp_path / "damaged.json")
    with pytest.raises(InputError, match=r"damaged\.json.*jacobian holds NaN"):
        Sensitivity.load(tmp_path / "damaged.json")
    whole = read_json(tmp_path / "sensitivity.json")
    for name, most in (
        ("mean", "1e\\+300, it can be at most 1e"),
        ("pathwise_share", "1e\\+300, it can be at most 1.00001"),
    ):
        write_json(tmp_path / "damaged.json", {**whole, name: [1e300, *whole[name][1:]]})
        with pytest.raises(InputError, match=rf"damaged\.json.*{name} holds {most}"):
            Sensitivity.load(tmp_path / "damaged.json")
    damaged: dict[str, object] = {
        "seed": {},
        "spread": "x",
        "seconds": {"mean": -1},
        "runs": {"mean": "many"},
        "warnings": [1],
        "status": "fine",
        "plausible": {"a": {}},
    }
    damaged["mean_error"] = [-1.0, *whole["mean_error"][1:]]
    for name, wrong in damaged.items():
        write_json(tmp_path / "damaged.json", {**whole, name: wrong})
        with pytest.raises(InputError, match=rf"damaged\.json: .*{name}"):
            Sensitivity.load(tmp_path / "damaged.json")
    for name in ("at", "runs", "free", "observables", "mean", "jacobian", "error", "scatter", "correlation"):
        for value in (None, "x", list[str](), -1):
            write_json(tmp_path / "damaged.json", {**whole, name: value})
            with pytest.raises(InputError, match=r"damaged\.json: this is no sensitivity that was saved whole"):
                Sensitivity.load(tmp_path / "damaged.json")


@pytest.mark.thorough
def test_every_estimator_beside_central_differences(found: Sensitivity) -> None:
    """The audit, reduced: the hard model at 16 and 31 nodes, 32 colonies on each side of the differences."""
    truth, _ = differences(Parameters(**found.at), found.times, SMALL, 32)
    for method, estimate in estimates(found).items():
        beside = compare(estimate, truth)
        outside = (np.abs(beside["z"]) > 4) & (beside["relative"] > 0.15)
        informed = np.array([name != "cell_count" for name in STATISTICS])  # nearly all nodes bud whatever λ is
        if method == "pathwise":  # biased: right in direction, which is what it is for
            assert (beside["cosine"][informed] > 0.9).all()
        else:
            assert not outside.any(), method
            assert (beside["cosine"][informed] > 0.95).all(), method


@pytest.mark.slow
def test_pathwise_and_regression_agree_where_both_are_right() -> None:
    """Exact derivatives of the relaxed model before parents are chosen, against a regression of the very same model."""
    exact = Relaxation(contact=0.2)
    both = sensitivity(
        Parameters(repulsion_radius=0.4, aspect_ratio=0.7),
        times=[2.5],
        numerics=SMALL,
        runs=256,
        paths=64,
        spread=0.1,
        statistics=["area", "mean_radius"],
        relaxation=exact,
        path_relaxation=exact,
        path_numerics=SMALL,
    )
    regressed, pathwise = both.parts["regression"], both.parts["pathwise"]
    z = (regressed.jacobian - pathwise.jacobian) / np.hypot(regressed.error, pathwise.error)
    assert np.abs(z).max() < 4
    assert (np.abs(regressed.jacobian / regressed.error).max(axis=-1) > 15).all()  # there is something to agree on


@pytest.mark.slow
def test_what_colonies_run_into_is_said() -> None:
    """Eight slots are too few at t = 3.5, for both parts."""
    found = sensitivity(times=[3.5, 4.5], numerics=replace(SMALL, capacity=8), runs=16, paths=8, statistics=["area"])
    met = [warning for warning in found.warnings if " simulations: " in warning]
    assert [warning.partition(" simulations: ")[0] for warning in met] == ["regression and mean: 24", "pathwise: 8"]
    assert all("raise capacity" in warning for warning in met)
    assert found.status is SensitivityStatus.DOUBTFUL


@pytest.mark.slow
def test_paths_end_where_they_are_of_no_use(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ask = partial(sensitivity, times=[2.5, 3.5], numerics=SMALL, runs=16, paths=4, statistics=["area", "radius"])
    monkeypatch.setattr(module, "PATH_NODES", 12)  # 8 nodes at 2.5, 16 at 3.5
    found = ask()
    first, second = np.array([0, 2]), np.array([1, 3])  # two statistics at either time
    assert np.isfinite(found.parts["pathwise"].jacobian[first]).all()
    assert np.isnan(found.parts["pathwise"].jacobian[second]).all()
    np.testing.assert_array_equal(found.pathwise_share[second], 0)
    np.testing.assert_array_equal(found.jacobian[second], found.parts["regression"].jacobian[second])
    found.save(tmp_path / "found.json")
    again = Sensitivity.load(tmp_path / "found.json").parts["pathwise"]
    np.testing.assert_array_equal(again.jacobian, found.parts["pathwise"].jacobian)
    whole = ask(method="pathwise").parts["pathwise"]
    np.testing.assert_allclose(whole.jacobian[first], found.parts["pathwise"].jacobian[first], rtol=1e-4)
    assert np.isfinite(whole.jacobian).all()
    monkeypatch.setattr(module, "PATH_NODES", 4)
    none = ask()
    assert set(none.parts) == {"regression"}
    assert set(none.carried_by) == {"regression"}


def test_exploded_tails_are_said() -> None:
    observables = tuple(Observable(name, time) for name in ("area", "radius") for time in (3.0, 6.0))
    (warning,) = doubts(np.array([1.0, 50.0, 1.0, 1.1]), observables, "pathwise")
    assert warning.startswith("area from t = 6")
    assert "use the regression" in warning


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"free": ["speed"]}, "free names 'speed', which is unknown"),
        ({"free": []}, "free names no parameter, need at least one of"),
        ({"free": "mobility"}, r"free is 'mobility', it must be a list of names, such as \['mobility'\]"),
        ({"free": ["mobility", "mobility"]}, "free names 'mobility' twice"),
        ({"method": "guess"}, "method is 'guess'"),
        ({"runs": 20}, "runs is 20, it must be a multiple of 16"),
        ({"runs": 16, "model": BIASED, "parameters": Parameters(budding_bias=2.0)}, "runs is 16, 8 parameters need at"),
        ({"paths": 2}, "paths is 2"),
        ({"spread": 1.5}, "spread is 1.5"),
        ({"statistics": ["colour"]}, "statistics: got 'colour'"),
        ({"parameters": Parameters(mobility=0.0)}, "mobility is 0.0, derivatives in log λ"),
        ({"times": [2.0, 1.0]}, "times is"),
        ({"times": None}, "times are missing"),
        ({"at": {"mobility": 1.0}}, "at is given without simulator"),
        ({"simulator": 1}, r"simulator \(int\) has no parameters and no observables"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(values: dict, message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        sensitivity(**{"times": [1.2], "numerics": replace(SMALL, capacity=8), **values})
