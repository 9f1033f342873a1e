"""Samples as ArviZ has them: groups, names, a file that comes back, and what is said where ArviZ is missing."""

import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from yeastfit import InputError
from yeastfit.inference.posterior.arviz import groups_of, to_arviz, to_netcdf
from yeastfit.inference.posterior.diagnostics import autocorrelation_time
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.samples import Samples

PREDICTED = Predictive(
    free=("mobility", "aspect_ratio"),
    labels=("area", "length", "count"),
    values=np.ones((10, 2)),
    statistics=np.arange(30.0).reshape(10, 3),
    observed=np.array([0.1, 0.2, 0.3]),
    replicates=1,
    failed=0,
)


def samples(chains: int = 3, draws: int = 50, weights: np.ndarray | None = None) -> Samples:
    rng = np.random.default_rng(0)
    return Samples(
        free=("mobility", "aspect_ratio"),
        values=rng.normal(size=(chains, draws, 2)),
        weights=np.full((chains, draws), 1 / (chains * draws)) if weights is None else weights,
        log_probability=rng.normal(size=(chains, draws)),
        acceptance=np.linspace(0.2, 0.4, chains),
        labels=("area", "length", "count"),
        statistics=rng.normal(size=(chains, draws, 3)),
        simulations=1234,
        seconds=1.0,
        seed=5,
        method="ABC-MCMC",
        settings={"steps": 50, "matrix": np.eye(2)},
        warnings=["too short"],
    )


@pytest.fixture(scope="module")
def arviz() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        return pytest.importorskip("arviz")


def test_a_file_comes_back_with_all_groups(arviz: Any, tmp_path: Path) -> None:
    found = samples()
    to_netcdf(found, tmp_path / "posterior.nc", PREDICTED)
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
    assert (about["method"], about["seed"], about["simulations"]) == ("ABC-MCMC", 5, 1234)
    assert about["warnings"] == '["too short"]'
    assert [path.name for path in tmp_path.iterdir()] == ["posterior.nc"]


def test_arviz_finds_what_diagnostics_find(arviz: Any) -> None:
    """A random walk that returns slowly: ArviZ's effective sizes and split R̂ beside one's own."""
    from yeastfit.inference.posterior.diagnostics import split_r_hat

    rng = np.random.default_rng(1)
    chains = np.zeros((4, 4000, 2))
    for k in range(1, 4000):
        chains[:, k] = 0.8 * chains[:, k - 1] + rng.normal(size=(4, 2))
    found = Samples(**{**vars(samples(4, 4000)), "values": chains})
    data = to_arviz(found)
    sizes = arviz.ess(data, method="mean")
    own = 16000 / autocorrelation_time(chains)
    np.testing.assert_allclose(own, [float(sizes[name]) for name in found.free], rtol=0.15)
    r_hat = arviz.rhat(data)
    np.testing.assert_allclose(split_r_hat(chains), [float(r_hat[name]) for name in found.free], atol=1e-3)


def test_weighted_draws_and_what_is_not_there() -> None:
    weights = np.linspace(1, 2, 50)[None] / np.linspace(1, 2, 50).sum()
    found = samples(1, 50, weights)
    unsimulated = Samples(**{**vars(found), "statistics": np.full((1, 50, 3), np.nan), "acceptance": np.ones(4)})
    groups = groups_of(unsimulated)
    assert set(groups) == {"posterior", "sample_stats"}
    assert set(groups["sample_stats"]) == {"lp", "weight"}
    with pytest.raises(InputError, match=r"found is of area, count, expected .* area, length, count"):
        groups_of(found, replace(PREDICTED, labels=("area", "count")))


def test_what_arviz_1_is_called_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its documented signature: groups as one nested dictionary, attributes by group."""
    called: dict[str, Any] = {}

    def from_dict(data: dict[str, Any], *, dims: dict[str, Any], coords: dict[str, Any], attrs: dict[str, Any]) -> str:
        called.update(data=data, dims=dims, coords=coords, attrs=attrs)
        return "tree"

    monkeypatch.setitem(sys.modules, "arviz", SimpleNamespace(__version__="1.2.0", from_dict=from_dict))
    assert to_arviz(samples(), PREDICTED) == "tree"
    assert set(called["data"]) == {"posterior", "posterior_predictive", "sample_stats", "observed_data"}
    assert called["dims"] == {"statistics": ["statistic"], "simulated": ["statistic"]}
    assert called["coords"] == {"statistic": ["area", "length", "count"]}
    assert called["attrs"]["posterior"]["seed"] == 5


def test_without_arviz_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(InputError, match=r"ArviZ is not installed .*pip install yeastfit\[arviz\]"):
        to_arviz(samples())
