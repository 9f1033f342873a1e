"""Posteriors as ArviZ has them: groups, names, a file that comes back, and what is said where ArviZ is missing."""

import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from made_posteriors import made_posterior
from scipy.stats import uniform

from yeastfit import InputError
from yeastfit.inference.posterior.arviz import Beside, groups_of, resampled
from yeastfit.inference.posterior.calibration_ranks import Calibration
from yeastfit.inference.posterior.chain_diagnostics import autocorrelation_time
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.prior import Prior

PREDICTED = Predictive(
    free=("mobility", "aspect_ratio"),
    labels=("area", "length", "count"),
    values=np.ones((10, 2)),
    statistics=np.arange(30.0).reshape(10, 3),
    observed=np.array([0.1, 0.2, 0.3]),
    replicates=1,
    failed=0,
)


CALIBRATED = Calibration(
    free=("mobility", "aspect_ratio"),
    truths=np.zeros((20, 2)),
    ranks=np.stack([np.arange(20), np.arange(20)[::-1]], axis=1),
    joint_ranks=np.arange(20),
    draws=19,
)


def made_up(chains: int = 3, draws: int = 50, weights: np.ndarray | None = None) -> Posterior:
    rng = np.random.default_rng(0)
    return made_posterior(
        rng.normal(size=(chains, draws, 2)),
        weights,
        log_probability=rng.normal(size=(chains, draws)),
        acceptance=np.linspace(0.2, 0.4, chains),
        labels=("area", "length", "count"),
        statistics=rng.normal(size=(chains, draws, 3)),
        simulations=1234,
        seed=5,
        method="abc-mcmc",
        settings={"steps": 50, "matrix": np.eye(2)},
        warnings=("too short",),
    )


@pytest.fixture(scope="module")
def arviz() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        return pytest.importorskip("arviz")


def test_a_file_comes_back_with_all_groups(arviz: Any, tmp_path: Path) -> None:
    found = made_up()
    found.to_netcdf(tmp_path / "posterior.nc", PREDICTED)
    back = arviz.from_netcdf(str(tmp_path / "posterior.nc"), engine="h5netcdf")
    np.testing.assert_array_equal(back["posterior"]["mobility"].values, found.values[:, :, 0])
    assert back["posterior"]["aspect_ratio"].dims == ("chain", "draw")
    predictive = back["posterior_predictive"]["statistics"]
    assert predictive.dims == ("chain", "draw", "statistic")
    np.testing.assert_array_equal(predictive.sel(statistic="length").values, PREDICTED.statistics[None, :, 1])
    simulated = back["sample_stats"]["simulated"]
    np.testing.assert_array_equal(simulated.sel(statistic="length").values, found.statistics[:, :, 1])
    np.testing.assert_array_equal(back["observed_data"]["statistics"].sel(statistic="count").values, 0.3)
    np.testing.assert_array_equal(back["sample_stats"]["lp"].values, found.log_probability)
    np.testing.assert_allclose(back["sample_stats"]["acceptance_rate"].mean("draw").values, [0.2, 0.3, 0.4])
    about = back["posterior"].attrs
    assert (about["method"], about["seed"], about["simulations"]) == ("abc-mcmc", 5, 1234)
    assert about["warnings"] == '["too short"]'
    assert [path.name for path in tmp_path.iterdir()] == ["posterior.nc"]


def test_arviz_finds_what_diagnostics_find(arviz: Any) -> None:
    """A random walk that returns slowly: ArviZ's effective sizes and split R̂ beside one's own."""
    from yeastfit.inference.posterior.chain_diagnostics import split_r_hat

    rng = np.random.default_rng(1)
    chains = np.zeros((4, 4000, 2))
    for k in range(1, 4000):
        chains[:, k] = 0.8 * chains[:, k - 1] + rng.normal(size=(4, 2))
    found = replace(made_up(4, 4000), values=chains)
    data = found.to_arviz()
    sizes = arviz.ess(data, method="mean")
    own = 16000 / autocorrelation_time(chains)
    np.testing.assert_allclose(own, [float(sizes[name]) for name in found.free], rtol=0.15)
    r_hat = arviz.rhat(data)
    np.testing.assert_allclose(split_r_hat(chains), [float(r_hat[name]) for name in found.free], atol=1e-3)


WEIGHTS = np.linspace(0.1, 2, 400)[None] / np.linspace(0.1, 2, 400).sum()


def test_what_is_not_there() -> None:
    found = replace(made_up(), statistics=np.full((3, 50, 3), np.nan), acceptance=np.ones(4))
    groups = groups_of(found)
    assert set(groups) == {"posterior", "sample_stats", "log_prior", "prior"}
    assert set(groups["sample_stats"]) == {"lp"}
    other = replace(PREDICTED, labels=("area", "count"))
    with pytest.raises(InputError, match=r"^predictive is of area, count, expected .* area, length, count"):
        groups_of(found, Beside(other))
    with pytest.raises(InputError, match=r"^prior_predictive is of area, count, expected .* area, length, count"):
        groups_of(found, Beside(None, other))
    with pytest.raises(InputError, match=r"calibration is of rate, expected the parameters .* mobility, aspect_ratio"):
        groups_of(found, Beside(calibration=replace(CALIBRATED, free=("rate",))))


def test_weighted_draws_are_resampled_and_kept(arviz: Any, tmp_path: Path) -> None:
    """ArviZ, which reads no weights, finds the weighted mean and standard deviation; the weights are there, too."""
    found = made_up(1, 400, WEIGHTS)
    found.to_netcdf(tmp_path / "posterior.nc", PREDICTED)
    back = arviz.from_netcdf(str(tmp_path / "posterior.nc"), engine="h5netcdf")
    own = back["weighted_draws"]
    np.testing.assert_array_equal(own["mobility"].values, found.values[:, :, 0])
    np.testing.assert_array_equal(own["weight"].values, WEIGHTS)
    np.testing.assert_array_equal(own["lp"].values, found.log_probability)
    np.testing.assert_array_equal(own["simulated"].sel(statistic="length").values, found.statistics[:, :, 1])
    posterior, stats = back["posterior"], back["sample_stats"]
    for k, name in enumerate(found.free):
        assert posterior[name].shape == (1, 400)
        assert abs(float(posterior[name].mean()) - found.mean[k]) < 0.1 * found.sd[k]
        assert float(posterior[name].std()) == pytest.approx(found.sd[k], rel=0.1)
    drawn = {value: k for k, value in enumerate(found.values[0, :, 0].tolist())}
    numbers = [drawn[value] for value in posterior["mobility"].values[0].tolist()]
    np.testing.assert_array_equal(stats["lp"].values[0], found.log_probability[0, numbers])
    np.testing.assert_array_equal(stats["simulated"].values[0], found.statistics[0, numbers])
    np.testing.assert_array_equal(
        back["posterior"]["mobility"].values, found.to_arviz()["posterior"]["mobility"].values
    )


def test_sensitivities_to_prior_and_data_are_those_of_a_gaussian(arviz: Any, tmp_path: Path) -> None:
    """ArviZ's psense, on the file: of λ ~ N(0, 1) seen once with variance v, mean m = o / (1 + v).

    Raising prior or likelihood to the power 1 + δ moves the posterior's mean by ∓ δ o v / (1 + v)²; where the
    likelihood says little (v large) the prior alone moves the spread, and the other way round.
    """
    rng, prior = np.random.default_rng(2), {"distribution": "normal", "mean": 0.0, "sd": 1.0}
    told = {}
    for name, variance in (("data", 0.01), ("prior", 100.0)):
        values = np.sqrt(variance / (1 + variance)) * rng.standard_normal((4, 1000, 1))
        found = made_posterior(
            values, prior=Prior.of({"mobility": prior}), log_likelihood=-0.5 * values[..., 0] ** 2 / variance
        )
        found.to_netcdf(tmp_path / "posterior.nc")
        told[name] = sensitivities(arviz, arviz.from_netcdf(str(tmp_path / "posterior.nc"), engine="h5netcdf"))
    assert told["data"][1] > 0.05 > told["data"][0]
    assert told["prior"][0] > 0.05 > told["prior"][1]


def sensitivities(arviz: Any, data: Any) -> tuple[float, float]:
    """To the prior and to the data, by either ArviZ."""
    if hasattr(arviz, "psense_summary"):
        table = arviz.psense_summary(data)
        return float(table["prior"].iloc[0]), float(table["likelihood"].iloc[0])
    each = [arviz.psens(data, component=part)["mobility"] for part in ("prior", "likelihood")]
    return float(each[0]), float(each[1])


def test_arviz_draws_ranks_and_the_ecdf_of_a_calibration(arviz: Any, tmp_path: Path) -> None:
    """From the file, with what the group holds: all groups and their attributes are there."""
    found = replace(made_up(), log_likelihood=np.zeros((3, 50)))
    found.to_netcdf(tmp_path / "posterior.nc", PREDICTED, PREDICTED, CALIBRATED)
    tree = arviz.from_netcdf(str(tmp_path / "posterior.nc"), engine="h5netcdf")
    groups = set(getattr(tree, "children", None) or tree.groups())
    assert groups >= {"log_prior", "log_likelihood", "prior", "prior_predictive", "prior_sbc"}
    np.testing.assert_array_equal(tree["prior"]["mobility"].values[0, :10], PREDICTED.values[:, 0])
    assert np.ptp(tree["prior"]["mobility"].values) > 1e6
    density = found.prior.log_density(found.flat).reshape(3, 50)
    np.testing.assert_allclose(tree["log_prior"]["mobility"] + tree["log_prior"]["aspect_ratio"], density)
    np.testing.assert_allclose(tree["prior_sbc"]["joint"].values[0], (np.arange(20) + 0.5) / 20)
    if hasattr(arviz, "plot_ecdf_pit"):  # ArviZ 1.x
        assert len(arviz.plot_ecdf_pit(tree, group="prior_sbc").viz["ecdf_lines"].data_vars) == 3
        assert len(arviz.plot_rank(tree).viz["ecdf_lines"].data_vars) == 2
    else:
        shares = tree["prior_sbc"]["joint"].values.ravel()
        assert arviz.plot_ecdf(
            shares, eval_points=shares, cdf=uniform.cdf, difference=True, confidence_bands=True
        ).lines
        assert len(np.ravel(arviz.plot_rank(tree))) == 2
    plt.close("all")
    near = groups_of(found, Beside(calibration=replace(CALIBRATED, near=True)))
    assert "posterior_sbc" in near
    assert "prior_sbc" not in near


def test_draws_are_resampled_as_often_as_their_weight_says() -> None:
    numbers = resampled(WEIGHTS[0], np.random.default_rng(3))
    counts = np.bincount(numbers, minlength=400)
    assert counts.sum() == 400
    assert (np.abs(counts - 400 * WEIGHTS[0]) < 1).all()
    assert np.abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.15, "they are in order"
    assert resampled(np.array([0.0, 1.0, 0.0]), np.random.default_rng(0)).tolist() == [1, 1, 1]


def test_what_arviz_1_is_called_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its documented signature: groups as one nested dictionary, attributes by group."""
    called: dict[str, Any] = {}

    def from_dict(data: dict[str, Any], *, dims: dict[str, Any], coords: dict[str, Any], attrs: dict[str, Any]) -> str:
        called.update(data=data, dims=dims, coords=coords, attrs=attrs)
        return "tree"

    monkeypatch.setitem(sys.modules, "arviz", SimpleNamespace(__version__="1.2.0", from_dict=from_dict))
    assert made_up().to_arviz(PREDICTED) == "tree"
    of_draws = {"posterior", "sample_stats", "log_prior", "prior"}
    assert set(called["data"]) == {*of_draws, "posterior_predictive", "observed_data"}
    assert called["dims"] == {"statistics": ["statistic"], "simulated": ["statistic"]}
    assert called["coords"] == {"statistic": ["area", "length", "count"]}
    assert called["attrs"]["posterior"]["seed"] == 5
    made_up(1, 400, WEIGHTS).to_arviz()
    assert set(called["data"]) == {*of_draws, "weighted_draws"}


def test_without_arviz_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(InputError, match=r"ArviZ is not installed .*pip install yeastfit\[arviz\]"):
        made_up().to_arviz()
