"""Fisher information on curves whose answer is known: closed forms, words, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from helpers import wrong_types
from sensitivities import made_up

from yeastfit import InformationStatus, InputError, Observable, plot
from yeastfit.inference.curve_covariance import mean_covariance, measurement_covariance
from yeastfit.inference.information.experiment import information_of
from yeastfit.inference.information.fisher import information
from yeastfit.inference.information.identifiability import blind_sentence, combination, percent, power_law, sparse_basis
from yeastfit.inference.information.result import Information

RNG = np.random.default_rng(0)
HALF = RNG.normal(size=(6, 12))
SIGMA = HALF @ HALF.T / 1000.0
SLOPES = RNG.normal(size=(6, 3))
FREE = ("mobility", "metabolic_rate", "aspect_ratio")


# --- closed forms -----------------------------------------------------------------------------------------------------


def test_two_curves_with_independent_errors() -> None:
    """y1 = a, y2 = a + b: var a = σ1², var b = σ1² + σ2², covariance −σ1²."""
    found = information(np.array([[1.0, 0.0], [1.0, 1.0]]), np.diag([0.04, 0.09]), free=FREE[:2])
    np.testing.assert_allclose(found.log_covariance, [[0.04, -0.04], [-0.04, 0.13]])
    assert found.log_standard_errors == pytest.approx({"mobility": 0.2, "metabolic_rate": np.sqrt(0.13)})
    assert not found.blind.any()
    assert found.sentences() == []
    assert found.best_fixed is None


def test_generalised_least_squares_scatters_as_the_covariance_says() -> None:
    found = information(SLOPES, SIGMA, free=FREE)
    np.testing.assert_allclose(found.log_covariance, np.linalg.inv(SLOPES.T @ np.linalg.inv(SIGMA) @ SLOPES), rtol=1e-9)
    noise = np.random.default_rng(1).multivariate_normal(np.zeros(6), SIGMA, size=20000)
    whiten = np.linalg.inv(np.linalg.cholesky(SIGMA))
    estimates = np.linalg.lstsq(whiten @ SLOPES, whiten @ noise.T, rcond=None)[0]
    np.testing.assert_allclose(estimates.std(axis=1), list(found.log_standard_errors.values()), rtol=0.03)


def test_errors_fall_as_one_over_the_root_of_replicates() -> None:
    five, twenty = (
        information(SLOPES, mean_covariance(SIGMA, replicates=count), free=FREE).log_standard_errors
        for count in (5, 20)
    )
    assert five == pytest.approx({name: 2 * error for name, error in twenty.items()})


def test_directions_are_eigenvectors_and_errors_along_them() -> None:
    found = information(SLOPES, SIGMA, free=FREE)
    np.testing.assert_allclose(found.directions @ found.directions.T, np.eye(3), atol=1e-12)
    along = found.directions @ found.log_covariance @ found.directions.T
    np.testing.assert_allclose(along, np.diag(found.direction_errors**2), atol=1e-12)
    assert (np.diff(found.eigenvalues) < 0).all()


def test_a_prior_alone_comes_back() -> None:
    widths = {"mobility": 0.3, "metabolic_rate": 0.5, "aspect_ratio": 0.1}
    found = information(np.zeros((6, 3)), SIGMA, free=FREE, prior=widths)
    assert found.log_standard_errors == pytest.approx(widths)
    assert not found.blind.any()


def test_a_prior_adds_its_precision() -> None:
    plain = information(SLOPES, SIGMA, free=FREE)
    found = information(SLOPES, SIGMA, free=FREE, prior={"mobility": 0.02})
    np.testing.assert_allclose(found.matrix - plain.matrix, np.diag([2500.0, 0, 0]), atol=1e-6)


def test_curves_that_never_vary_tell_nothing() -> None:
    slopes, sigma = np.vstack([SLOPES, np.zeros(3)]), np.zeros((7, 7))
    sigma[:6, :6] = SIGMA
    found = information(slopes, sigma, free=FREE)
    np.testing.assert_allclose(found.log_covariance, information(SLOPES, SIGMA, free=FREE).log_covariance)
    slopes[6, 1] = 1.0
    with pytest.raises(InputError, match="mean 6 has no variance but depends on λ"):
        information(slopes, sigma, free=FREE)


# --- the noise of J ---------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("correlated", [False, True])
def test_what_the_noise_of_the_derivatives_adds_is_taken_out(correlated: bool) -> None:
    """Mean of A over 3000 draws within 5 standard errors of JᵀWJ; without the correction it would be far off."""
    rng, weight = np.random.default_rng(2), np.linalg.inv(SIGMA)
    error = 0.3 * (0.5 + rng.random((6, 3)))
    scale = np.sqrt(np.diag(SIGMA))
    correlation = SIGMA / np.outer(scale, scale) if correlated else np.eye(6)
    root = np.linalg.cholesky(correlation)
    draws = [SLOPES + error * (root @ rng.normal(size=(6, 3))) for _ in range(3000)]
    rho = correlation if correlated else None
    found = np.array([information(j, SIGMA, free=FREE, error=error, correlation=rho).data for j in draws])
    truth = SLOPES.T @ weight @ SLOPES
    z = (found.mean(axis=0) - truth) / (found.std(axis=0) / np.sqrt(len(draws)))
    assert np.abs(z).max() < 5
    naive = np.mean([j.T @ weight @ j for j in draws], axis=0)
    assert (np.diag(naive - truth) > 10 * np.diag(found.std(axis=0)) / np.sqrt(len(draws))).all()


def test_derivatives_that_are_all_noise_are_seen_as_such() -> None:
    """The floor is two standard deviations of what noise makes of one direction."""
    rng, error = np.random.default_rng(3), np.full((6, 1), 0.5)
    found = [
        information(error * rng.normal(size=(6, 1)), SIGMA, free=FREE[:1], error=error).blind[0] for _ in range(400)
    ]
    assert np.mean(found) > 0.9
    one = information(error * rng.normal(size=(6, 1)), SIGMA, free=FREE[:1], error=error)
    weight = np.linalg.inv(SIGMA)
    values = [float((j.T @ weight @ j)[0, 0]) for j in (error * rng.normal(size=(20000, 6, 1)))]
    assert one.noise_floor[0] == pytest.approx(2 * np.std(values), rel=0.05)


def test_one_blind_direction_among_noise() -> None:
    """Two parameters as a product, J with errors: that direction is found, the third parameter keeps its error."""
    slopes = np.column_stack([SLOPES[:, 0], SLOPES[:, 0], SLOPES[:, 1]])
    error = np.full((6, 3), 0.05)
    noisy = slopes + error * np.random.default_rng(4).normal(size=slopes.shape)
    found = information(noisy, SIGMA, free=FREE, error=error)
    assert found.undetermined == FREE[:2]
    assert found.eigenvalues[-1] == 0
    assert found.sentences()[0].endswith(
        "(as far as this many runs tell: the noise of the derivatives hides errors above "
        f"{percent(1 / np.sqrt(found.noise_floor[-1]))}): fix one"
    )
    exact = information(np.column_stack([SLOPES[:, 0], SLOPES[:, 1]]), SIGMA, free=("mobility", "aspect_ratio"))
    assert found.log_standard_errors["aspect_ratio"] == pytest.approx(
        exact.log_standard_errors["aspect_ratio"], rel=0.15
    )
    assert np.isnan(found.log_standard_errors["mobility"])


# --- what is refused, in words ----------------------------------------------------------------------------------------


def product(power: float) -> Information:
    """Curves that depend on repulsivity · repulsion_radius^power and on mobility."""
    slopes = np.column_stack([SLOPES[:, 0], power * SLOPES[:, 0], SLOPES[:, 1]])
    return information(slopes, SIGMA, free=("repulsivity", "repulsion_radius", "mobility"))


@pytest.mark.parametrize(
    ("power", "words"),
    [
        (1.4, "repulsivity · repulsion_radius^1.4"),
        (1.0, "repulsivity · repulsion_radius"),
        (0.333, "repulsivity · repulsion_radius^0.33"),
        (-2.0, "repulsivity / repulsion_radius^2"),
    ],
)
def test_two_parameters_that_only_enter_as_a_product(power: float, words: str) -> None:
    found = product(power)
    assert found.sentences()[0] == f"repulsivity and repulsion_radius only enter as {words}: fix one"
    said = "no standard error of repulsivity, repulsion_radius; those of the others hold where this point lies along "
    assert found.sentences()[1].startswith(said)
    assert np.isnan(found.log_covariance[:2]).all()
    two = information(SLOPES[:, :2], SIGMA, free=("repulsivity", "mobility"))
    assert found.log_standard_errors["mobility"] == pytest.approx(two.log_standard_errors["mobility"])


def test_the_parameter_best_fixed_leaves_least_error() -> None:
    """With the power 1.4 the radius is known better by a factor of 1.4, if alone."""
    assert product(1.4).best_fixed == "repulsivity"
    assert product(0.3).best_fixed == "repulsion_radius"
    fixed = product(1.4).without("repulsivity")
    alone = information(SLOPES[:, :2] * [1.4, 1.0], SIGMA, free=("repulsion_radius", "mobility"))
    assert fixed.log_standard_errors == pytest.approx(alone.log_standard_errors)
    assert product(1.4).sentences()[2].startswith("best fixed: repulsivity; then the errors are: repulsion_radius ")


def test_a_parameter_that_nothing_depends_on() -> None:
    slopes = SLOPES.copy()
    slopes[:, 1] = 0.0
    found = information(slopes, SIGMA, free=FREE)
    assert found.sentences()[0] == "the data do not see metabolic_rate: fix it"
    assert found.undetermined == ("metabolic_rate",)
    assert found.best_fixed == "metabolic_rate"
    assert np.isfinite(found.log_covariance[np.ix_([0, 2], [0, 2])]).all()


def test_two_blind_directions_are_told_apart_by_name() -> None:
    slopes = SLOPES.copy()
    slopes[:, :2] = 0.0
    sentences = information(slopes, SIGMA, free=FREE).sentences()
    assert sorted(sentences[:2]) == [
        "the data do not see metabolic_rate: fix it",
        "the data do not see mobility: fix it",
    ]


@pytest.mark.parametrize(("limit", "refused"), [(0.19, True), (0.21, False)])
def test_the_limit_decides_what_is_blind(limit: float, refused: bool) -> None:
    """One curve, σ = 0.2, slope 1: the error of log λ is 0.2."""
    found = information(np.ones((1, 1)), np.array([[0.04]]), free=FREE[:1], limit=limit)
    assert found.blind[0] == refused
    assert found.status is (InformationStatus.PARTLY_BLIND if refused else InformationStatus.DETERMINED)
    assert np.isnan(found.log_standard_errors["mobility"]) == refused
    words = "the data do not see mobility (the rest is known to 20 % only): fix it"
    assert found.sentences() == ([words, "no standard error of mobility"] if refused else [])


def test_three_parameters_in_one_blind_direction() -> None:
    direction = np.array([2.0, 1.0, -1.0]) / np.sqrt(6.0)
    slopes = SLOPES - np.outer(SLOPES @ direction, direction)
    found = information(slopes, SIGMA, free=FREE)
    assert found.sentences()[0] == (
        "the data do not notice when mobility changes, and with it metabolic_rate as mobility^0.5, "
        "aspect_ratio as mobility^-0.5: fix one"
    )


def test_words_for_directions() -> None:
    names = ("a", "b", "c")
    assert power_law(names, [1.0, 0.5, -2.0]) == "a · b^0.5 / c^2"
    assert power_law(names[:2], [-1.0, -0.123]) == "1 / a / b^0.12"
    words, largest = combination(names, np.array([0.6, 0.05, -0.79]))
    assert words == "c / a^0.76"
    assert largest == 0.79
    assert blind_sentence(names, np.array([0.0, 0.05, 1.0])) == "the data do not see c: fix it"
    assert percent(0.032) == "3.2 %"
    assert percent(1.0) == "a factor of 2.7"
    assert percent(np.inf) == "unknown"


def test_a_sparse_basis_spans_the_same() -> None:
    rows = np.linalg.qr(np.random.default_rng(5).normal(size=(5, 2)))[0].T
    basis = sparse_basis(rows)
    np.testing.assert_allclose(rows.T @ rows @ basis.T, basis.T, atol=1e-12)
    assert (np.abs(basis) < 1e-12).sum() == 2


# --- covariances ------------------------------------------------------------------------------------------------------


def test_covariance_of_means_over_fewer_of_the_same_colonies() -> None:
    """Mean of ten, mean of the first four: simulated."""
    scatter = SIGMA[:2, :2]
    colonies = np.random.default_rng(6).multivariate_normal(np.zeros(2), scatter, size=(40000, 10))
    means = np.column_stack([colonies[:, :, 0].mean(axis=1), colonies[:, :4, 1].mean(axis=1)])
    sigma = mean_covariance(scatter, replicates=np.array([10.0, 4.0]))
    np.testing.assert_allclose(sigma, np.cov(means.T), atol=0.03 * sigma.max())


def test_an_estimated_covariance_does_not_tell_too_much() -> None:
    """With 20 degrees of freedom inverses average to the true one; plain ones would to 20/13 of it."""
    rng, root = np.random.default_rng(7), np.linalg.cholesky(SIGMA)
    inverses = []
    for _ in range(4000):
        drawn = rng.normal(size=(20, 6)) @ root.T
        inverses.append(np.linalg.inv(mean_covariance(drawn.T @ drawn / 20, replicates=1, freedom=20)))
    beside = root.T @ np.mean(inverses, axis=0) @ root
    np.testing.assert_allclose(beside, np.eye(6), atol=0.06)


def test_the_error_of_an_ensemble_adds_to_that_of_the_data() -> None:
    both = mean_covariance(SIGMA, replicates=10, members=40)
    np.testing.assert_allclose(both, SIGMA * (0.1 + 0.025))


def test_measurement_error_is_half_common_to_the_times_of_a_statistic() -> None:
    observables = [Observable(name, time) for name in ("radius", "area") for time in (1.0, 2.0)]
    sigma = measurement_covariance(observables, np.array([1.0, 2.0, 10.0, 10.0]), 0.1)
    np.testing.assert_allclose(np.diag(sigma), [0.01, 0.04, 1.0, 1.0])
    np.testing.assert_allclose(sigma[0], [0.01, 0.01, 0.0, 0.0])
    by_name = measurement_covariance(observables, np.array([1.0, 2.0, 10.0, 10.0]), {"radius": 0.1, "area": 0.0})
    np.testing.assert_allclose(np.diag(by_name), [0.01, 0.04, 0.0, 0.0])


# --- from a sensitivity -----------------------------------------------------------------------------------------------


def test_information_of_a_sensitivity_is_that_of_its_curves() -> None:
    found = made_up(("compactness", "area"), [1.0, 2.0, 3.0], FREE)
    chosen = information_of(found, free=["aspect_ratio", "mobility"], statistics=["area"], times=[3, 1], replicates=40)
    rows = [3, 5]
    slopes, sigma = found.jacobian[rows][:, [0, 2]], found.scatter[np.ix_(rows, rows)] / 40
    assert chosen.free == ("mobility", "aspect_ratio")
    np.testing.assert_allclose(
        chosen.log_covariance, np.linalg.inv(slopes.T @ np.linalg.solve(sigma, slopes)), rtol=1e-5
    )
    wider = information_of(found, measurement_error=0.05)
    assert (np.diag(wider.log_covariance) > np.diag(information_of(found).log_covariance)).all()


def test_results_are_kept_and_drawn(tmp_path: Path) -> None:
    whole = information(SLOPES, SIGMA, free=FREE, prior={"mobility": 1.0})
    nothing = information(np.zeros((6, 3)), SIGMA, free=FREE)
    for number, found in enumerate((product(1.4), whole, nothing)):
        found.save(tmp_path / "information.json")
        again = Information.load(tmp_path / "information.json")
        np.testing.assert_array_equal(again.data, found.data)
        assert again.prior == found.prior
        assert again.sentences() == found.sentences()
        assert again.rows() == found.rows()
        for name, figure in (("spectrum", plot.spectrum(found)), ("ellipses", plot.ellipses(found))):
            plot.save(figure, tmp_path / f"{name}_{number}.png")
            assert (tmp_path / f"{name}_{number}.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"jacobian": SLOPES[:5]}, "covariance has shape"),
        ({"free": FREE[:2]}, "jacobian has shape"),
        ({"free": ("mobility",) * 3}, "each once"),
        ({"jacobian": SLOPES * np.nan}, "jacobian holds 18 values that are not finite"),
        ({"covariance": SIGMA + np.triu(np.ones((6, 6)), 1)}, "not symmetric"),
        ({"covariance": np.ones((6, 6))}, "smallest eigenvalue of the correlations of 6 means"),
        ({"error": -np.ones((6, 3))}, "error holds -1"),
        ({"prior": {"speed": 1.0}}, "prior names 'speed'"),
        ({"prior": {"mobility": 0.0}}, "prior of mobility is 0"),
        ({"limit": 0.0}, "limit is 0"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(values: dict, message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        information(**{"jacobian": SLOPES, "covariance": SIGMA, "free": FREE, **values})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"free": ["speed"]}, "free is speed, the sensitivity holds"),
        ({"free": []}, "free is empty"),
        ({"statistics": ["colour"]}, "statistic 'colour' is not in the sensitivity, which holds compactness, area"),
        ({"times": [1.5]}, r"time 1\.5 is not in the sensitivity, which holds 1, 2"),
        ({"replicates": 0}, "replicates is 0"),
        ({"members": 0}, "members is 0"),
        ({"measurement_error": -0.1}, r"measurement_error is -0\.1"),
    ],
    ids=str,
)
def test_bad_choices_from_a_sensitivity_are_named(values: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        information_of(made_up(("compactness", "area"), [1.0, 2.0], FREE), **values)


def test_too_few_runs_for_so_many_curves_are_an_error() -> None:
    with pytest.raises(InputError, match="needs more than 7 degrees of freedom, so more runs, or fewer"):
        mean_covariance(SIGMA, replicates=10, freedom=7)
