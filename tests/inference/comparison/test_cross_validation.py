"""Colonies left out: densities and ranks beside exact ones of a plane; missing statistics, and words."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from helpers import wrong_types
from jax import Array
from known_likelihoods import Known, linear, positive, simulations
from made_posteriors import made_posterior
from scipy.stats import multivariate_normal, norm

from yeastfit import InputError
from yeastfit.inference.comparison import cross_validation
from yeastfit.inference.comparison.cross_validation import cross_validate, without
from yeastfit.inference.comparison.left_out import LeftOut, scale_of
from yeastfit.inference.comparison.models import difference_of_data
from yeastfit.inference.comparison.predictive_mixture import PredictiveMixture
from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.places import Places
from yeastfit.inference.prior.variation import Variation
from yeastfit.inference.simulator import seed_of

SETTINGS = SequentialEmulator(
    first=512, simulations=512, batch=512, walkers=64, training=TrainingSettings(members=2, width=16, steps=400)
)
TRUTH, COLONIES = (1.3, 0.8), 8

Made = tuple[Known, np.ndarray, Posterior, Problem, tuple[np.ndarray, np.ndarray]]


class Exact(Emulator):
    """An emulator of `linear` that knows what it emulates."""

    def likelihood(self, observed: np.ndarray, replicates: int = 1, noise: np.ndarray | None = None) -> Any:
        """Of the known normal distribution, whose mean is linear in the prior's coordinates."""
        (start, *ends), covariance = linear().moments(np.exp(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])))

        def of_rows(x: Array) -> Any:
            mean = start + x @ (np.array(ends) - start)
            return jax.scipy.stats.multivariate_normal.logpdf(observed - mean, np.zeros(4), covariance[0] / replicates)

        return of_rows

    def moments(self, values: np.ndarray | Places[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The known ones; there is no error."""
        mean, covariance = linear().moments(Places.of(values).values[:, 0])
        return mean, covariance, np.zeros_like(covariance), np.ones(len(mean))


@pytest.fixture
def known_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is learnt."""

    def emulator(problem: Problem, simulations: Any, *_: Any) -> Emulator:
        made = object.__new__(Exact)
        object.__setattr__(made, "coordinates", Coordinates.of(problem.prior, simulations[0]))
        return made

    monkeypatch.setattr(cross_validation, "_emulator", emulator)


@pytest.fixture(scope="module")
def made() -> Made:
    """Eight colonies of `linear`, draws near their posterior, and simulations from the prior."""
    known = linear()
    rows = known(np.repeat(np.array([TRUTH]), COLONIES, axis=0), seed_of(3, range(COLONIES)))
    draws = np.array(TRUTH) * np.exp(0.2 * np.random.default_rng(1).standard_normal((4, 100, 2)))
    posterior = made_posterior(draws, prior=known.prior, labels=known.labels)
    problem = Problem(known, known.prior, rows.mean(axis=0), COLONIES)
    return known, rows, posterior, problem, simulations(known, 512, seed=2)


def expected(known: Known, kept: np.ndarray, colony: np.ndarray) -> tuple[float, np.ndarray]:
    """Log density of a further colony, and predicted shares below it: sums over a grid of the whole prior."""
    axis = np.linspace(-2.0, 2.0, 241)
    values = np.exp(np.stack([one.ravel() for one in np.meshgrid(axis, axis)], axis=1))
    mean, covariance = known.moments(values)
    weight = multivariate_normal(np.zeros(4), covariance[0] / len(kept)).logpdf(kept.mean(axis=0) - mean)
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    density = weight @ multivariate_normal(np.zeros(4), covariance[0]).pdf(colony - mean)
    return float(np.log(density)), weight @ norm.cdf((colony - mean) / np.sqrt(np.diag(covariance[0])))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.usefixtures("known_exactly")
def test_of_a_plane(made: Made) -> None:
    """Densities of single colonies, and where they lie in what the others predict, are the exact ones."""
    found = cross_validate(made[2], made[3], made[1], made[4], groups=4, settings=SETTINGS)
    known, rows = made[:2]
    np.testing.assert_array_equal(found.group, np.arange(COLONIES) % 4)
    volume = np.log(rows.std(axis=0, ddof=1)).sum()
    density, below = np.zeros(COLONIES), np.zeros(rows.shape)
    for r in range(COLONIES):
        density[r], below[r] = expected(known, rows[found.group != found.group[r]], rows[r])
    density += volume
    # log densities differ from draw to draw by up to √(10 / 6), where a colony is √10 deviations off and six were kept:
    # 64 chains of 20 autocorrelation times know the mean density to √((e^(10/6) − 1) / 1280) = 0.058 then; four of it
    np.testing.assert_allclose(found.log_density, density, atol=0.23)
    assert np.isclose(found.total, found.log_density.sum())
    np.testing.assert_allclose(found.below, below, atol=0.02)
    assert np.isclose(found.standard_error, np.sqrt(COLONIES) * found.log_density.std(ddof=1))
    edges = found.quantiles[:, [0, -1]]
    inside = (edges[:, 0] <= rows) & (rows <= edges[:, 1])
    np.testing.assert_array_equal(inside.sum(axis=0), found.inside(0.9))


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked", "known_exactly")
def test_the_order_of_a_table_does_not_matter(made: Made) -> None:
    """Colonies are dealt into groups by their names, in which numbers count."""
    names, order = [f"s{r + 5}" for r in range(COLONIES)], np.random.default_rng(3).permutation(COLONIES)
    first = cross_validate(made[2], made[3], made[1], made[4], groups=4, names=names, settings=SETTINGS)
    problem = replace(made[3], observed=made[1].mean(axis=0))
    mixed = [names[r] for r in order]
    other = cross_validate(made[2], problem, made[1][order], made[4], groups=4, names=mixed, settings=SETTINGS)
    assert other.colonies == tuple(mixed)
    again = other.in_order()
    assert again.colonies == tuple(names)
    np.testing.assert_array_equal(again.group, first.group)
    np.testing.assert_array_equal(again.observed, first.observed)
    np.testing.assert_allclose(again.log_density, first.log_density, rtol=1e-3)
    assert difference_of_data(first, again) == ""


@pytest.mark.thorough
def test_units_do_not_matter(made: Made) -> None:
    """By emulators that are trained: the same densities in other units, near the exact ones in the middle."""
    known, rows, posterior, problem, (values, statistics) = made
    factor = np.array([1e3, 1e-2, 1.0, 7.0])
    found = [
        cross_validate(
            posterior,
            replace(problem, observed=problem.observed * scale),
            rows * scale,
            (values, statistics * scale),
            groups=2,
            settings=SETTINGS,
            seed=5,
        )
        for scale in (np.ones(4), factor)
    ]
    np.testing.assert_allclose(found[1].log_density, found[0].log_density, atol=0.05)
    below = np.stack([expected(known, rows[found[0].group != r % 2], rows[r])[1] for r in range(COLONIES)])
    np.testing.assert_allclose(found[0].below, below, atol=0.1)


def expected_of_scattered(
    known: Known, variation: Variation, kept: np.ndarray, colony: np.ndarray
) -> tuple[float, np.ndarray]:
    """As `expected`, where log λ scatters by τ: sums over grids of λ and of τ."""
    axis, step = np.linspace(-2.0, 2.0, 61), 0.2
    values = np.exp(np.stack([one.ravel() for one in np.meshgrid(axis, axis)], axis=1))
    mean, covariance = known.moments(values)
    slopes = known.moments(np.exp(np.eye(2)))[0].T
    above = np.arange(0.5 * step, 4.0, step)
    total, density, shares = 0.0, 0.0, np.zeros(len(colony))
    for tau, prior in zip([0.0, *above], [variation.zero, *(step * variation.prior.density.pdf(above))], strict=True):
        spread = covariance[0] + tau**2 * slopes @ slopes.T
        normal = multivariate_normal(np.zeros(len(colony)), spread)
        weight = prior * np.exp(sum(normal.logpdf(one - mean) for one in kept) + 60.0)
        total += weight.sum()
        density += weight @ normal.pdf(colony - mean)
        shares += weight @ norm.cdf((colony - mean) / np.sqrt(np.diag(spread)))
    return float(np.log(density / total)), shares / total


@pytest.mark.thorough
def test_of_colonies_whose_parameters_scatter(made: Made) -> None:
    """By an emulator that is trained: near the exact sums, from which those of one λ for all are far."""
    known, posterior, (values, statistics) = positive(made[0]), made[2], made[4]
    own = np.array([TRUTH]) * np.exp(0.8 * np.random.default_rng(5).standard_normal((COLONIES, 2)))
    rows, variation = known(own, seed_of(4, range(COLONIES))), Variation(sd=1.0)
    problem = Problem.of(known, known.prior, rows, variation=variation)
    draws = np.concatenate([posterior.values, np.full((4, 100, 1), 0.3)], axis=2)
    wide = made_posterior(draws, prior=problem.inferred_prior, labels=known.labels)
    found = cross_validate(wide, problem, rows, (values, statistics), groups=2, settings=SETTINGS, seed=5)
    volume = np.log(rows.std(axis=0, ddof=1)).sum()
    exact, alike = [], []
    for r in range(COLONIES):
        kept = rows[found.group != r % 2]
        exact.append(expected_of_scattered(known, variation, kept, rows[r]))
        alike.append(expected(known, kept, rows[r])[0] + volume)
    np.testing.assert_allclose(found.below, [below for _, below in exact], atol=0.1)
    densities = np.array([density for density, _ in exact]) + volume
    error, otherwise = (np.sqrt(np.mean((one - densities) ** 2)) for one in (found.log_density, np.array(alike)))
    # 512 simulations leave a plane of 6 terms an error of 0.11 scatters, and colonies lie up to 3 scatters off
    assert error < 0.33
    assert otherwise > 3 * error, (error, otherwise)


@pytest.mark.thorough
@pytest.mark.usefixtures("known_exactly")
def test_a_statistic_that_is_missing(made: Made) -> None:
    """The colony is named and not scored, its other statistics are ranked, and the others' means do without it."""
    _, rows, posterior, problem, stored = made
    holes = rows.copy()
    holes[2, 1] = np.nan
    found = cross_validate(posterior, problem, holes, stored, groups=2, settings=SETTINGS, names="abcdefgh")
    assert "is not counted: c" in found.doubts[0]
    assert len(found.scored) == COLONIES - 1
    assert np.isnan(found.log_density[2])
    assert np.isnan(found.below[2, 1])
    assert np.isfinite(found.below[2, [0, 2, 3]]).all()
    np.testing.assert_array_equal(found.counts, [8, 7, 8, 8])
    kept = without(problem, holes[:4])
    assert kept.replicates == 3
    np.testing.assert_allclose(kept.observed[1], rows[[0, 1, 3], 1].mean())


@pytest.mark.parametrize(
    ("groups", "count", "words"),
    [(2, 1, "1 is known by itself"), (9, 8, "8 colonies can be dealt into 2 to 8"), (1, 8, "groups is 1")],
)
def test_refused(made: Made, groups: int, count: int, words: str) -> None:
    _, rows, posterior, problem, stored = made
    with pytest.raises(InputError, match=words):
        cross_validate(posterior, problem, rows[:count], stored, groups=groups)


def test_a_statistic_of_one_group_alone(made: Made) -> None:
    rows = made[1].copy()
    rows[1:, 3] = np.nan
    with pytest.raises(InputError, match="s3 is of colonies of one group alone"):
        without(made[3], rows[1:])


def test_mixtures() -> None:
    """Two normal distributions, one of half the success: density, shares below and quantiles by a sum over a grid."""
    covariance = np.array([[[1.0, 0.3], [0.3, 2.0]], [[0.5, -0.2], [-0.2, 1.0]]])
    mixture = PredictiveMixture(np.array([[0.0, 1.0], [3.0, -1.0]]), covariance, np.log([0.5, 0.25]))
    parts = [multivariate_normal(mean, cov) for mean, cov in zip(mixture.mean, covariance, strict=True)]
    point = np.array([1.0, 0.5])
    density = 0.5 * parts[0].pdf(point) + 0.25 * parts[1].pdf(point)
    assert np.isclose(mixture.log_density(point), np.log(density))
    share = 2 / 3 * norm.cdf(1.0, 0.0, 1.0) + 1 / 3 * norm.cdf(1.0, 3.0, np.sqrt(0.5))
    assert np.isclose(mixture.below(point)[0], share)
    quantiles = mixture.quantiles(np.array([0.05, 0.5, 0.95]))
    np.testing.assert_allclose(mixture.below(quantiles), [[0.05, 0.05], [0.5, 0.5], [0.95, 0.95]], atol=1e-9)


def ranked(below: np.ndarray) -> LeftOut:
    """Made up from ranks."""
    count, statistics = below.shape
    return LeftOut(
        tuple(f"s{k}" for k in range(statistics)),
        tuple(map(str, range(count))),
        np.arange(count * statistics, dtype=float).reshape(below.shape),
        np.arange(count),
        np.linspace(-3.0, -2.0, count),
        below,
        np.zeros((count, 5, statistics)),
    )


def test_what_fails() -> None:
    """Uniform ranks do not; ranks at one end, at both ends, and in the middle do, each with its words."""
    even = (np.arange(20) + 0.5) / 20
    ends = np.where(even < 0.5, 1e-3, 1 - 1e-3)
    found = ranked(np.stack([even, 0.8 + 0.2 * even, ends, 0.4 + 0.2 * even], axis=1))
    failures = found.failures()
    assert set(failures) == {"s1", "s2", "s3"}
    assert "predicted smaller than observed" in failures["s1"]
    assert failures["s2"] == "0 of 20 colonies in the interval of 90 %"
    assert failures["s3"] == "predicted wider than observed: 20 of 20 colonies in the interval of 50 %"
    assert found.inside(0.9).tolist() == [18, 15, 0, 20]
    assert np.isclose(found.coverage(0.5), (10 + 0 + 0 + 20) / 80)
    assert [row["fails"] == "" for row in found.rows()] == [True, False, False, False]
    assert len(found.sentences()) == 3


def test_saved_and_loaded(tmp_path: Path) -> None:
    found = replace(ranked(np.random.default_rng(0).random((6, 3))), doubts=("a doubt",))
    found.save(tmp_path / "left_out.npz")
    again = LeftOut.load(tmp_path / "left_out.npz")
    assert (again.labels, again.colonies, again.doubts) == (found.labels, found.colonies, found.doubts)
    np.testing.assert_array_equal(again.below, found.below)
    np.testing.assert_array_equal(again.log_density, found.log_density)
    np.testing.assert_array_equal(again.scale, scale_of(found.observed))
    assert again.colony_rows() == found.colony_rows()
    unseen = replace(found, observed=np.where(np.arange(3) == 1, np.nan, found.observed))
    unseen.save(tmp_path / "unseen.npz")
    with pytest.raises(InputError, match=rf"unseen.npz.*observed has fewer than two colonies with {found.labels[1]}"):
        LeftOut.load(tmp_path / "unseen.npz")
    (tmp_path / "other.npz").write_text("nothing")
    with pytest.raises(InputError, match=r"other.npz: this is no prediction of colonies left out that was saved"):
        LeftOut.load(tmp_path / "other.npz")
    with wrong_types():
        narrow = replace(found, below=found.below[:, :2])
    narrow.save(tmp_path / "narrow.npz")
    with pytest.raises(InputError, match=r"narrow.npz.*below has shape \(6, 2\), need numbers of shape \(6, 3\)"):
        LeftOut.load(tmp_path / "narrow.npz")
