"""Targets: from means, from replicates, resampled, and refused where they make no sense."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from stand_in import STATISTICS, TIMES, drawn

from yeastfit import Imaging, InputError, Parameters, Scales, Targets
from yeastfit.storage import read_json, write_json

GOOD: dict[str, Any] = {
    "means": {"radius": [1.0, 2.0], "compactness": [0.5, 0.4]},
    "times": [1.0, 2.0],
    "imaging": Imaging(),
}


def test_means_are_taken_as_they_are() -> None:
    targets = Targets.from_means(
        {"radius": [1.0, np.nan], "area": [2.0, 5.0]},
        [1.0, 2.5],
        scatter={"area": [0.1, 0.2]},
        replicates=[4, 6],
        imaging=Imaging(),
    )
    assert targets.names == ("radius", "area")
    np.testing.assert_array_equal(targets.replicates, [[4, 0], [4, 6]])
    np.testing.assert_array_equal(targets.values, [1.0, 2.0, 5.0])
    np.testing.assert_array_equal(targets.scatter, [[np.nan, np.nan], [0.1, 0.2]])
    assert [str(one) for one in targets.observables] == ["radius at 1", "area at 1", "area at 2.5"]
    assert targets.imaging is not None
    assert targets.imaging.extent == pytest.approx(3 * 1.0 + 1)
    assert targets.curves is None


def test_replicates_are_averaged_where_they_are() -> None:
    curves = {"radius": np.array([[1.0, 2.0], [3.0, np.nan], [5.0, np.nan]]), "area": np.full((3, 2), np.nan)}
    curves["area"][0, 1] = 7.0
    targets = Targets.from_replicates(curves, np.array([1.0, 2.0]))
    np.testing.assert_array_equal(targets.mean, [[3.0, 2.0], [np.nan, 7.0]])
    np.testing.assert_array_equal(targets.scatter, [[2.0, np.nan], [np.nan, np.nan]])
    np.testing.assert_array_equal(targets.replicates, [[3, 1], [0, 1]])
    np.testing.assert_array_equal(targets.values, [3.0, 2.0, 7.0])
    assert targets.curves is not None
    assert targets.curves.shape == (3, 2, 2)


def test_one_replicate_has_no_scatter() -> None:
    targets = Targets.from_replicates({"radius": np.array([[1.0, 2.0]])}, np.array([1.0, 2.0]))
    assert np.isnan(targets.scatter).all()
    assert (targets.replicates == 1).all()


@pytest.mark.parametrize("missing", [False, True])
def test_targets_are_again_what_was_written(missing: bool, tmp_path: Any) -> None:
    targets = drawn(Parameters(), np.random.default_rng(0), replicates=3)
    if missing:
        curves = np.array(targets.curves)
        curves[1, 2] = np.nan
        targets = Targets.from_replicates({n: curves[:, k] for k, n in enumerate(STATISTICS)}, TIMES)
    write_json(tmp_path / "targets.json", targets.asdict())
    again = Targets.fromdict(read_json(tmp_path / "targets.json"))
    for name in ("times", "mean", "scatter", "replicates", "curves"):
        np.testing.assert_array_equal(getattr(again, name), getattr(targets, name))
    for name in ("names", "imaging"):
        assert getattr(again, name) == getattr(targets, name)


def test_resampled_means_have_the_variance_of_a_bootstrap() -> None:
    """scatter² / n · (n − 1) / n, and the correlations of a colony's curves; 4000 draws tell it to 2 %."""
    targets = drawn(Parameters(), np.random.default_rng(1), replicates=6)
    rng = np.random.default_rng(2)
    draws = np.array([targets.resampled(rng) for _ in range(4000)])
    np.testing.assert_allclose(draws.var(axis=0), targets.scatter[targets.measured] ** 2 / 6 * 5 / 6, rtol=0.12)
    np.testing.assert_allclose(draws.mean(axis=0), targets.values, atol=4 * 0.05 / np.sqrt(4000))
    assert targets.curves is not None
    expected = np.cov(targets.curves.reshape(6, -1).T, ddof=0) / 6
    np.testing.assert_allclose(np.cov(draws.T), expected, atol=0.1 * expected.diagonal().max())


def test_what_a_draw_leaves_empty_is_drawn_by_itself() -> None:
    curves = np.tile(np.arange(1.0, 5.0)[:, None], (1, 2))
    curves[1:, 1] = np.nan
    targets = Targets.from_replicates({"radius": curves}, np.array([1.0, 2.0]))
    rng = np.random.default_rng(0)
    draws = np.array([targets.resampled(rng) for _ in range(50)])
    np.testing.assert_array_equal(draws[:, 1], 1.0)
    assert draws[:, 0].std() > 0.2


def test_a_bootstrap_needs_single_colonies() -> None:
    for targets in (
        Targets.from_means(**GOOD),
        Targets.from_replicates({"radius": np.array([[1.0, 2.0]])}, np.array([1.0, 2.0])),
    ):
        with pytest.raises(InputError, match="at least two single replicates, make a profile instead"):
            targets.resampled(np.random.default_rng(0))


def test_what_round_colonies_have_none_of_may_be_0_or_below() -> None:
    means = {"branch_count": np.array([0.0, 2.0]), "filament_radius_index": np.array([-0.05, 0.1])}
    found = Targets.from_means(means, [1.0, 2.0], imaging=Imaging(3.0, "mask"))
    np.testing.assert_array_equal(found.values, [0.0, 2.0, -0.05, 0.1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": [1.0, 1.0]}, "times must rise"),
        ({"times": [0.0, 1.0]}, "times must rise from above 0"),
        ({"times": [1.0, np.nan]}, "times must rise"),
        ({"times": [1.0, 2.0, 3.0]}, r"mean has shape \(2, 2\)|shape"),
        ({"means": {"radius": [1.0, -2.0]}}, "mean of radius at time 2 \\(4.35 hours\\) is -2, it must be above 0"),
        ({"means": {"radius": [0.0, 2.0]}}, "mean of radius at time 1 \\(2.17 hours\\) is 0"),
        (
            {"means": {"colour": [1.0, 2.0]}, "imaging": Imaging(3.0)},
            "statistic 'colour' is unknown, expected some of compactne",
        ),
        ({"means": {"outer_compactness": [1.0, 2.0]}, "imaging": Imaging(3.0)}, 'measured on masks: estimator "mask"'),
        ({"means": {"compactness": [1.0, 2.0]}}, "extent is missing"),
        ({"means": {"radius": [np.nan, np.nan]}, "imaging": Imaging(3.0)}, "nothing is measured"),
        ({"scatter": {"area": [1.0, 2.0]}}, "scatter of 'area', but there are means of radius, compactness only"),
        (
            {"scatter": {"radius": [0.1, 0.0]}, "replicates": 5},
            "scatter of radius at time 2 \\(4.35 hours\\) is 0, so no error",
        ),
        ({"means": {"radius": [1.0, np.inf]}, "imaging": Imaging(3.0)}, "mean of radius at time 2 .* is inf"),
        ({"replicates": 2.7}, r"replicates is 2\.7, need whole numbers from 0 on"),
        ({"replicates": [-1, 3]}, "replicates is .*-1, 3.*, need whole numbers"),
        ({"replicates": np.nan}, "replicates is nan, need whole numbers"),
        ({"replicates": "many"}, "replicates is 'many', need one whole number, or one for each of 2 times"),
        ({"replicates": [1, 2, 3]}, "replicates is .*, need one whole number, or one for each of 2 times"),
        ({"scatter": {"radius": [0.1, -0.1]}}, "scatter of radius at time 2 \\(4.35 hours\\) is -0.1"),
    ],
    ids=str,
)
def test_bad_targets_are_refused_in_words(change: dict[str, Any], message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        Targets.from_means(**{**GOOD, **change})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"spacing": 0.0}, "spacing is 0"),
        ({"smoothing": -0.1}, "smoothing -0.1"),
        ({"extent": -1.0}, "extent -1"),
        ({"estimator": "eye"}, "estimator is 'eye', it must be one of smooth, mask"),
    ],
    ids=str,
)
def test_imaging_that_cannot_be_is_refused(values: dict[str, Any], message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        Imaging(**values)


def test_without_imaging_names_times_and_signs_are_any() -> None:
    targets = Targets.from_means({"height": [-1.0, 0.0]}, [0.0, 3.0], scatter={"height": [0.1, 0.2]}, replicates=4)
    np.testing.assert_array_equal(targets.clock, [0.0, 3.0])
    assert (targets.clock_label, targets.measurement_errors()) == ("time", {"height": 0.0})


def test_imaged_colonies_have_hours_and_errors_of_measurement() -> None:
    targets = Targets.from_means(**GOOD)
    np.testing.assert_allclose(targets.clock, Scales().hours(np.array([1.0, 2.0])))
    assert targets.clock_label == "hours"
    assert targets.measurement_errors() == {"radius": 0.01, "compactness": 0.02}
    assert targets.measurement_errors({"radius": 0.3}) == {"radius": 0.3, "compactness": 0.02}
    assert targets.measurement_errors(0.0) == {"radius": 0.0, "compactness": 0.0}


def test_curves_must_be_those_of_the_means(unchecked: None) -> None:
    with pytest.raises(InputError, match="curves have infinite numbers"):
        Targets.from_replicates({"a": np.array([[1.0, 2.0], [2.0, np.inf]])}, [1, 2])
    known = Targets.from_replicates({"a": np.array([[1.0, 2.0], [2.0, 3.0]])}, [1, 2])
    with pytest.raises(InputError, match=r"curves have shape \(2, 1, 5\), \(statistics, times\) is \(1, 2\)"):
        replace(known, curves=np.ones((2, 1, 5)))
    with pytest.raises(InputError, match="measurement_error of 'aera', but the targets are of a only"):
        known.measurement_errors({"aera": 0.5})


def test_shapes_that_disagree_and_repeated_names_are_refused() -> None:
    targets = Targets.from_means(**GOOD)
    with wrong_types():
        with pytest.raises(InputError, match=r"scatter has shape \(1, 2\), \(statistics, times\) is \(2, 2\)"):
            replace(targets, scatter=targets.scatter[:1])
        with pytest.raises(InputError, match="each once"):
            replace(targets, names=("radius", "radius"))


def test_copies_of_one_colony_are_refused() -> None:
    with pytest.raises(InputError, match="are the replicates copies of each other"):
        Targets.from_replicates({"radius": np.ones((3, 2))}, np.array([1.0, 2.0]))
