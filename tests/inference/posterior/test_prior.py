"""Priors against numerical integration, their coordinates, their files, and what is refused."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from scipy import stats
from simulators import parameters_named

from yeastfit import PARAMETERS, InputError
from yeastfit.inference.prior.distributions import FAMILIES, Distribution
from yeastfit.inference.prior.prior import Prior, template
from yeastfit.parameter_set import Parameter, ParameterSet

TABLES = {
    "u": {"distribution": "uniform", "low": -1.0, "high": 3.0},
    "lu": {"distribution": "log-uniform", "low": 0.02, "high": 20.0},
    "n": {"distribution": "normal", "mean": 1.0, "sd": 0.5, "low": 0.8},
    "ln": {"distribution": "log-normal", "median": 2.0, "sd": 0.7, "high": 5.0},
    "b": {"distribution": "beta", "a": 2.0, "b": 3.0, "low": 0.2, "high": 0.9},
}
PRIOR = Prior.of(TABLES)


def default_template(parameters: ParameterSet, **how: Any) -> str:
    return template(Prior.default(parameters, **how), parameters)


# --- densities --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TABLES)
def test_densities_integrate_to_the_cumulative_share_that_quantiles_invert(name: str) -> None:
    prior = Prior.of({name: TABLES[name]})
    low, high = prior.quantile(np.array([[0.1], [0.85]]))[:, 0].tolist()
    grid = np.linspace(low, high, 20001)
    share = np.trapezoid(np.exp(prior.log_density(grid[:, None])), grid)
    assert share == pytest.approx(0.75, abs=1e-6)


def test_distributions_are_those_of_the_textbooks() -> None:
    values = np.array([[2.5, 3.0, 1.2, 1.7, 0.4]])
    plain = [
        stats.uniform(-1, 4).logpdf(2.5),
        stats.loguniform(0.02, 20).logpdf(3.0),
        stats.norm(1, 0.5).logpdf(1.2) - stats.norm(1, 0.5).logsf(0.8),
        stats.lognorm(0.7, scale=2.0).logpdf(1.7) - stats.lognorm(0.7, scale=2.0).logcdf(5.0),
        stats.beta(2, 3, 0.2, 0.7).logpdf(0.4),
    ]
    np.testing.assert_allclose(PRIOR.log_density(values), [sum(plain)])


@pytest.mark.parametrize("name", TABLES)
def test_densities_are_scipys_to_the_last_bit_and_to_the_ends(name: str) -> None:
    one = PRIOR.distributions[name]
    x = np.concatenate([one.density.ppf(np.linspace(0.0, 1.0, 1001)[1:-1]), one.density.support()])
    np.testing.assert_array_equal(one.log_density(x), one.density.logpdf(x))


def test_outside_the_support_there_is_nothing() -> None:
    inside = PRIOR.quantile(np.full((1, 5), 0.5))
    outside = np.repeat(inside, 10, axis=0)
    for k, (low, high) in enumerate(PRIOR.support):
        outside[2 * k, k], outside[2 * k + 1, k] = low - 1e-6, min(high, 1e9) + 1.0
    outside[5, 2] = np.nan  # the normal law has no upper end
    assert np.isfinite(PRIOR.log_density(inside)).all()
    assert np.isneginf(PRIOR.log_density(outside)).all()
    assert PRIOR.contains(inside).all()
    assert not PRIOR.contains(outside).any()
    assert np.isneginf(PRIOR.log_density_of_coordinates(np.full((1, 5), 1e4))).all()


def test_coordinates_are_logarithms_where_the_law_is_one_of_logarithms() -> None:
    values = PRIOR.sample(50, np.random.default_rng(0))
    x = PRIOR.coordinates(values)
    np.testing.assert_allclose(PRIOR.values(x), values)
    np.testing.assert_allclose(x[:, [1, 3]], np.log(values[:, [1, 3]]))
    np.testing.assert_array_equal(x[:, [0, 2, 4]], values[:, [0, 2, 4]])
    jacobian = np.log(values[:, [1, 3]]).sum(axis=1)
    np.testing.assert_allclose(PRIOR.log_density_of_coordinates(x), PRIOR.log_density(values) + jacobian)


def test_samples_are_of_the_law() -> None:
    drawn = PRIOR.sample(4000, np.random.default_rng(1))
    for k, law in enumerate(PRIOR.distributions.values()):
        x = PRIOR.coordinates(drawn)[:, k]
        assert stats.kstest(x, law.density.cdf).pvalue > 0.001
    np.testing.assert_array_equal(drawn, PRIOR.sample(4000, np.random.default_rng(1)))


def test_ends_of_the_unit_cube_stay_in_the_support() -> None:
    prior = Prior.default(PARAMETERS)
    ends = prior.quantile(np.array([[0.0] * 7, [1.0] * 7]))
    np.testing.assert_allclose(ends.T, prior.support, rtol=1e-12)
    assert np.isfinite(prior.log_density(ends)).all()
    with pytest.raises(InputError, match=r"unit holds values from -0.1 to 0.5, they must lie in 0..1"):
        PRIOR.quantile(np.array([[-0.1, 0.5, 0.5, 0.5, 0.5]]))


# --- files ------------------------------------------------------------------------------------------------------------


def test_the_template_is_the_default_prior(tmp_path: Path) -> None:
    path = tmp_path / "prior.toml"
    path.write_text(default_template(PARAMETERS.subset(("mobility", "aspect_ratio"))), encoding="utf-8")
    prior = Prior.read(path, PARAMETERS.subset(("mobility", "aspect_ratio")))
    assert prior == Prior.default(PARAMETERS.subset(("mobility", "aspect_ratio")))
    assert prior.free == ("mobility", "aspect_ratio")
    assert [tuple(row) for row in prior.support] == [PARAMETERS[name].plausible for name in prior.free]
    assert all(name in default_template(PARAMETERS) for name in FAMILIES)
    assert PARAMETERS["mobility"].meaning in default_template(PARAMETERS)
    two = PARAMETERS.subset(("mobility", "repulsion_radius"))
    path.write_text(default_template(two, bounded="beta"), encoding="utf-8")
    families = {name: one.family for name, one in Prior.read(path, two).distributions.items()}
    assert families == {"repulsion_radius": "beta", "mobility": "log-uniform"}


def test_parameters_whose_plausible_range_reaches_0_have_a_uniform_prior() -> None:
    below = Parameter("shift", "s", "a shift", (-2.0, 3.0), 0.0, smallest=-10.0)
    above = Parameter("rate", "r", "a rate", (0.1, 3.0), 1.0, largest=5.0)
    prior = Prior.default(ParameterSet((below, above)))
    assert prior.asdict() == {
        "shift": {"distribution": "uniform", "low": -2.0, "high": 3.0},
        "rate": {"distribution": "log-uniform", "low": 0.1, "high": 3.0},
    }
    assert "# s: a shift" in prior.toml(ParameterSet((below, above)))
    assert "#" not in prior.toml()


def test_every_law_comes_back_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "prior.toml"
    path.write_text(PRIOR.toml(), encoding="utf-8")
    assert Prior.read(path, parameters_named(tuple(TABLES))) == PRIOR
    assert Prior.of(PRIOR.asdict()) == PRIOR
    named = parameters_named(("μ", "rate"))
    path.write_text(Prior.default(named).toml(named), encoding="utf-8")
    assert Prior.read(path, named) == Prior.default(named)
    path.write_text(PRIOR.toml(), encoding="utf-8")
    other = ("ln", "b", "n", "lu", "u")
    assert Prior.read(path, parameters_named(other)).free == other


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[mobility]\ndistribution = 'flat'",
            "prior of mobility: distribution is 'flat', expected one of uniform, log-uniform",
        ),
        ("[mobility]\ndistribution = 'normal'\nmean = 1", "normal needs mean, sd, sd is missing"),
        (
            "[mobility]\ndistribution = 'uniform'\nlow = 0\nhigh = 1\nsd = 2",
            "uniform has no 'sd', its numbers are low, high",
        ),
        ("[mobility]\ndistribution = 'uniform'\nlow = 'a'\nhigh = 1", "low is 'a', it must be a finite number"),
        ("[mobility]\ndistribution = 'uniform'\nlow = nan\nhigh = 1", "low is nan, it must be a finite number"),
        ("[mobility]\ndistribution = 'uniform'\nlow = true\nhigh = 2", "low is true, it must be a finite number"),
        ("[mobility]\ndistribution = 'uniform'\nlow = 2\nhigh = 1", "low is 2 and high 1, low must be below high"),
        (
            "[mobility]\ndistribution = 'uniform'\nlow = 1\nhigh = 1.0000000001",
            "uniform of low 1, high 1 is too narrow",
        ),
        (
            "[mobility]\ndistribution = 'normal'\nmean = 0.5\nsd = 1e300\nlow = 0.1\nhigh = 0.9",
            "is flat between low and high: give a uniform one instead",
        ),
        ("[mobility]\ndistribution = 'log-normal'\nmedian = 1\nsd = 1e-300", "log-normal of median 1, sd 1e-300"),
        ("[mobility]\ndistribution = 'beta'\na = 1e-300\nb = 1", "a is 1e-300, it must be at least 0.05"),
        (
            "[mobility]\ndistribution = 'log-uniform'\nlow = 0\nhigh = 1",
            "low is 0, log-uniform is a distribution of positive values",
        ),
        ("[mobility]\ndistribution = 'log-normal'\nmedian = 1\nsd = -1", "sd is -1, it must be above 0"),
        (
            "[mobility]\ndistribution = 'normal'\nmean = 1\nsd = 1",
            "normal reaches from -inf to inf, mobility must be finite and at least 0",
        ),
        (
            "[aspect_ratio]\ndistribution = 'uniform'\nlow = 0.5\nhigh = 2",
            "uniform reaches from 0.5 to 2, aspect_ratio must be in (0, 1]",
        ),
        ("[speed]\ndistribution = 'uniform'\nlow = 0\nhigh = 1", "unknown parameter 'speed', expected diffusivity"),
        ("mobility = 3", "prior of mobility is 3, it must be a table with distribution"),
        ("[mobility", "no prior can be read"),
        ("", "the prior is empty"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "prior.toml"
    path.write_text(text, encoding="utf-8")
    with wrong_types(), pytest.raises(InputError, match=r"prior\.toml") as caught:
        Prior.read(path, PARAMETERS)
    assert message in str(caught.value)


def test_files_must_be_there_and_hold_what_is_free(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no prior can be read"):
        Prior.read(tmp_path / "nowhere.toml", PARAMETERS)
    path = tmp_path / "prior.toml"
    path.write_text(default_template(PARAMETERS.subset(("mobility",))), encoding="utf-8")
    with pytest.raises(InputError, match=r"no prior of aspect_ratio"):
        Prior.read(path, PARAMETERS.subset(("mobility", "aspect_ratio")))


def test_priors_are_pickled_after_use_as_before() -> None:
    before = pickle.dumps(PRIOR)
    PRIOR.log_density(PRIOR.sample(3, np.random.default_rng(0)))
    again = pickle.loads(pickle.dumps(PRIOR))
    assert again == PRIOR == pickle.loads(before)
    values = PRIOR.sample(3, np.random.default_rng(1))
    np.testing.assert_array_equal(again.log_density(values), PRIOR.log_density(values))


def test_distributions_compare_by_their_numbers() -> None:
    assert Distribution("beta", {"a": 1, "b": 2}) == Distribution("beta", {"a": 1.0, "b": 2.0, "low": 0.0, "high": 1.0})
    assert Distribution("beta", {"a": 1, "b": 2}) != Distribution("beta", {"a": 1, "b": 3})


@pytest.mark.parametrize(
    "method",
    [
        *("log_density", "log_densities", "log_density_of_coordinates", "contains"),
        *("coordinates", "values", "quantile", "shares"),
    ],
)
@pytest.mark.parametrize("shape", [(5,), (2, 4), (2, 5, 1)])
def test_values_are_rows(method: str, shape: tuple[int, ...]) -> None:
    with wrong_types(), pytest.raises(InputError, match=rf"the shape \({shape[0]},.*they must have \[draws, 5\]"):
        getattr(PRIOR, method)(np.full(shape, 0.5))
