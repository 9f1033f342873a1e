"""How parameters scatter between colonies: coordinates, the prior of the scatter, and what colonies may have."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.variation_models import ClosedForm, closed_form_prior
from yeastfit import InputError
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.prior.variation import ColonyCoordinates, Variation, Varied
from yeastfit.parameter_set import Parameter, ParameterSet


def test_places_around_have_the_mean_of_any_cubic() -> None:
    """E[y_a² y_b], E[y_a y_b y_c] and so on, in logarithms and logits; at τ = 0 all are the place itself."""
    coordinates = ColonyCoordinates.of(ClosedForm().parameters)
    values, tau = np.array([[2.0, 0.3, 0.5], [0.7, 0.6, 1.5]]), np.array([0.4, 0.9])

    def y(one: np.ndarray) -> np.ndarray:
        logit = np.log(one[..., 1] / (1 - one[..., 1]))
        return np.stack([np.log(one[..., 0]), logit, np.log(one[..., 2])], axis=-1)

    around = coordinates.around(values, tau)
    found, middle, shares = y(around.values), y(values), around.shares
    np.testing.assert_allclose(shares, np.full(6, 1 / 6))
    np.testing.assert_allclose(np.einsum("p,rpi->ri", shares, found), middle, atol=1e-12)
    squares = np.einsum("p,rpi,rpj->rij", shares, found, found)
    expected = middle[:, :, None] * middle[:, None] + tau[:, None, None] ** 2 * np.eye(3)
    np.testing.assert_allclose(squares, expected, atol=1e-12)
    cubes = np.einsum("p,rpi,rpj,rpk->rijk", shares, found, found, found)
    a, same = middle, tau[:, None, None, None] ** 2 * np.eye(3)[:, :, None]
    exact = np.einsum("ri,rj,rk->rijk", a, a, a)
    exact += same * a[:, None, None, :] + np.moveaxis(same * a[:, None, None, :], 3, 1)
    exact += np.moveaxis(same * a[:, None, None, :], 3, 2)
    np.testing.assert_allclose(cubes, exact, atol=1e-12)
    still = coordinates.around(values, np.zeros(2)).values
    np.testing.assert_allclose(still, np.repeat(values[:, None], 6, axis=1), rtol=1e-15)


@pytest.mark.parametrize(("varying", "count"), [(("b",), 3), (("a", "c"), 5)])
def test_places_around_few_parameters_have_the_mean_of_each_fourth_power(varying: tuple[str, ...], count: int) -> None:
    """E (y_k − y)⁴ = 3 τ⁴, with which the variance of y² is right: three places for one parameter, five for two."""
    coordinates = ColonyCoordinates.of(ClosedForm().parameters, varying)
    values, tau = np.array([[2.0, 0.3, 0.5], [0.7, 0.6, 1.5]]), np.array([0.4, 0.9])
    around = coordinates.around(values, tau)
    found = around.values
    away = np.log(found / values[:, None])
    logit = np.log(found[..., 1] / (1 - found[..., 1]))
    away[..., 1] = logit - np.log(values[:, 1] / (1 - values[:, 1]))[:, None]
    assert found.shape == (2, count, 3)
    np.testing.assert_allclose(around.shares.sum(), 1.0)
    scatters = np.array([name in varying for name in "abc"])
    for power, moment in ((1, 0.0), (2, 1.0), (3, 0.0), (4, 3.0)):
        expected = moment * tau[:, None] ** power * scatters
        np.testing.assert_allclose(np.einsum("p,rpk->rk", around.shares, away**power), expected, atol=1e-12)


def test_one_colony_of_each_draw_scatters() -> None:
    """By τ of each draw, no farther than places around it are; λ itself where τ is 0, or colonies are all of one λ.

    Colonies may leave the prior; none leaves what is admissible, and no share its own prior.
    """
    simulator, prior = ClosedForm(), closed_form_prior()
    rows = np.ones((3, 5))
    problem = Problem.of(simulator, prior, rows, variation=Variation())
    values = np.tile(prior.quantile(np.full((1, 3), 0.5)), (4000, 1))
    x, tau = prior.coordinates(values), np.repeat([[0.0], [0.1], [0.2], [2.0]], 1000, axis=0)
    found = problem.scattered(x, tau, np.random.default_rng(0))
    moved = prior.values(found)
    np.testing.assert_array_equal(found[:1000], x[:1000])
    clipped = np.clip(np.random.default_rng(1).standard_normal(100_000), -np.sqrt(3), np.sqrt(3))
    for k, scatter in ((1, 0.1), (2, 0.2)):
        own = moved[1000 * k : 1000 * (k + 1)]
        spread = np.std([np.log(own[:, 0]), np.log(own[:, 1] / (1 - own[:, 1])), np.log(own[:, 2])], axis=1)
        np.testing.assert_allclose(spread, scatter * clipped.std(), rtol=0.1)
    assert np.abs(np.log(moved[3000:, [0, 2]] / values[3000:, [0, 2]])).max() <= 2.0 * np.sqrt(3) * (1 + 1e-12)
    assert np.isfinite(prior.log_density(moved[3000:])).mean() < 0.6
    assert problem.admits(moved).all()
    assert not problem.admits(np.array([[1.0, 1.5, 1.0], [-1.0, 0.5, 1.0], [np.inf, 0.5, 1.0]])).any()
    narrow = Prior({**prior.distributions, "b": Distribution("beta", {"low": 0.4, "high": 0.6, "a": 2.0, "b": 2.0})})
    share = replace(problem, prior=narrow)
    kept = narrow.values(share.scattered(x, tau, np.random.default_rng(0)))
    assert ((kept[:, 1] >= 0.4) & (kept[:, 1] <= 0.6)).all()
    assert (kept[3000:] == values[3000:]).all(axis=1).mean() > 0.7
    assert replace(problem, variation=None).scattered(x, tau[:, :0], np.random.default_rng(0)) is x


def test_coordinates_are_logarithms_and_logits() -> None:
    parameters = ClosedForm().parameters
    coordinates = ColonyCoordinates.of(parameters)
    values, step = np.array([[2.0, 0.3, 0.5], [1e-6, 1.0, 7.0], [0.0, 0.0, 3.0]]), np.array([[0.4, -1.1, 2.0]] * 3)
    moved = coordinates.moved(values, step)
    np.testing.assert_allclose(moved[:, ::2], values[:, ::2] * np.exp(step[:, ::2]))
    np.testing.assert_allclose(moved[0, 1], 1 / (1 + np.exp(1.1 - np.log(0.3 / 0.7))))
    np.testing.assert_array_equal(moved[1:, 1], [1.0, 0.0])
    unbounded = Parameter("d", "d", "d", (0.1, 1.0), 0.5, smallest=-np.inf)
    with pytest.raises(InputError, match=r"variation: d may be finite: need parameters that are above 0"):
        ColonyCoordinates.of(ParameterSet((unbounded,)))


def test_scatter_has_mass_at_zero_and_grows_with_z() -> None:
    variation = Variation(zero=0.3, sd=0.2)
    z = np.random.default_rng(0).standard_normal(20_000)
    tau = variation.tau(z)
    assert abs(np.mean(tau == 0) - 0.3) < 0.015
    above = np.sort(tau[tau > 0])
    np.testing.assert_allclose(np.sqrt(np.mean(above**2)), 0.2, rtol=0.02)
    assert (np.diff(variation.tau(np.linspace(-9, 9, 400))) >= 0).all()
    law = variation.prior.density
    shares = np.array([0.1, 0.3, 0.31, 0.5, 0.9, 0.999])
    np.testing.assert_allclose(law.cdf(law.ppf(shares)), np.maximum(shares, 0.3))
    np.testing.assert_allclose(law.median(), np.median(tau), atol=0.005)
    np.testing.assert_allclose(law.std(), tau.std(), rtol=0.02)
    np.testing.assert_allclose(np.exp(law.logpdf(np.array([0.0, 0.1]))), [0.3, law.pdf(np.array(0.1))])
    assert (Variation(zero=0.0, sd=0.2).tau(z) > 0).all()
    refused: list[dict[str, Any]] = [{"zero": 1.0}, {"zero": -0.1}, {"sd": 0.0}]
    for wrong in refused:
        with pytest.raises(InputError, match=r"variation: (zero|sd) is "):
            Variation(**wrong)


def test_colonies_scatter_by_their_seeds() -> None:
    varied = Varied(ClosedForm())
    row, seeds = np.array([[2.0, 0.3, 0.5, 0.4]]), np.arange(2000)
    each = varied.scattered(np.repeat(row, 2000, axis=0), seeds)
    np.testing.assert_allclose(np.std(np.log(each[:, [0, 2]]), axis=0), 0.4, rtol=0.05)
    np.testing.assert_allclose(np.std(np.log(each[:, 1] / (1 - each[:, 1]))), 0.4, rtol=0.05)
    np.testing.assert_array_equal(each[7:8], varied.scattered(row, seeds[7:8]))
    np.testing.assert_array_equal(varied(row, seeds[7:8]), ClosedForm()(each[7:8], seeds[7:8]))
    still = np.array([[2.0, 0.3, 0.5, 0.0]])
    np.testing.assert_allclose(varied.scattered(still, seeds[:1]), still[:, :3])


def test_what_all_colonies_share_does_not_scatter() -> None:
    """Places, draws and colonies leave it alone; those of the others are as without it. It may have no bounds."""
    a, b, c = ClosedForm().parameters.parameters
    shared = ClosedForm(ParameterSet((a, replace(b, shared=True), c)))
    values, tau = np.array([[2.0, 0.3, 0.5], [0.7, 0.6, 1.5]]), np.array([0.4, 0.9])
    found = ColonyCoordinates.of(shared.parameters).around(values, tau)
    assert found.values.shape == (2, 5, 3)
    np.testing.assert_array_equal(found.values[:, :, 1], np.repeat(values[:, None, 1], 5, axis=1))
    rest = ColonyCoordinates.of(ParameterSet((a, c))).around(values[:, ::2], tau)
    np.testing.assert_array_equal(found.values[:, :, ::2], rest.values)
    np.testing.assert_array_equal(found.shares, rest.shares)
    rows, seeds = np.column_stack([values, tau]), np.arange(2)
    both, all_scatter = Varied(shared).scattered(rows, seeds), Varied(ClosedForm()).scattered(rows, seeds)
    np.testing.assert_array_equal(both[:, 1], values[:, 1])
    np.testing.assert_array_equal(both[:, ::2], all_scatter[:, ::2])
    prior = closed_form_prior()
    problem = Problem.of(shared, prior, np.ones((3, 5)), variation=Variation())
    x = np.tile(prior.coordinates(values[:1]), (2000, 1))
    moved = problem.scattered(x, np.full((2000, 1), 5.0), np.random.default_rng(0))
    np.testing.assert_allclose(moved[:, 1], x[:, 1], rtol=1e-12)
    assert np.abs(moved[:, 0] - x[:, 0]).max() <= 5.0 * np.sqrt(3) * (1 + 1e-12)
    assert np.abs(moved[:, 0] - x[:, 0]).max() > 5.0 * np.sqrt(3) * 0.99
    unbounded = Parameter("d", "d", "d", (0.1, 1.0), 0.5, smallest=-np.inf, shared=True)
    with_it = ColonyCoordinates.of(ParameterSet((a, unbounded))).moved(np.array([[2.0, -3.0]]), np.array([[0.1, 0.1]]))
    np.testing.assert_allclose(with_it, [[2.0 * np.exp(0.1), -3.0]])
    with pytest.raises(InputError, match=r"variation: all colonies share d: free a parameter of growth, too"):
        ColonyCoordinates.of(ParameterSet((unbounded,)))


def test_parameters_that_vary_alone() -> None:
    """Places, draws and colonies are those of a simulator whose other parameters all colonies share."""
    a, b, c = ClosedForm().parameters.parameters
    alone = ClosedForm(ParameterSet((replace(a, shared=True), b, replace(c, shared=True))))
    rows, seeds = np.array([[2.0, 0.3, 0.5, 0.4], [0.7, 0.6, 1.5, 0.9]]), np.arange(2)
    found = ColonyCoordinates.of(ClosedForm().parameters, ("b",)).around(rows[:, :3], rows[:, 3])
    assert found.values.shape == (2, 3, 3)
    of_alone = ColonyCoordinates.of(alone.parameters).around(rows[:, :3], rows[:, 3])
    np.testing.assert_array_equal(found.values, of_alone.values)
    np.testing.assert_array_equal(found.shares, of_alone.shares)
    grown = Varied(ClosedForm(), ("b",)).scattered(rows, seeds)
    np.testing.assert_array_equal(grown, Varied(alone).scattered(rows, seeds))
    np.testing.assert_array_equal(grown[:, ::2], rows[:, :3:2])
    assert (grown[:, 1] != rows[:, 1]).all()
    prior, data = closed_form_prior(), np.ones((3, 5))
    problems = [
        Problem.of(ClosedForm(), prior, data, variation=Variation(varying=["b"])),
        Problem.of(alone, prior, data, variation=Variation()),
    ]
    x, tau = prior.coordinates(rows[:, :3]), rows[:, 3:]
    moved, same = (one.scattered(x, tau, np.random.default_rng(0)) for one in problems)
    np.testing.assert_array_equal(moved, same)
    for name, what in (("d", "varying names 'd', which is not free: need some of b"), ("a", "varying names a, which")):
        with pytest.raises(InputError, match=what):
            Problem.of(alone, prior, data, variation=Variation(varying=(name,)))
    with pytest.raises(InputError, match="varying is 'b', it must be a list"):
        Variation(varying="b")
