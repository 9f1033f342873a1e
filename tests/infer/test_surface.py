"""Response surfaces and the errors of an estimate, on curves whose answer is known."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import pytest

from yeastfit.errors import InputError
from yeastfit.infer.bijection import check_free, free_of_log, from_free, log_of_free, to_free
from yeastfit.infer.curves import robust_mean
from yeastfit.infer.fit import _covariance_of_estimate
from yeastfit.infer.surface import scout, study
from yeastfit.model.parameters import Parameters
from yeastfit.simulation import member_keys

FREE = ("mobility", "aspect_ratio")
CENTRE = np.log([1.0, 0.6])
SLOPES = np.array([[1.0, 0.2], [0.5, -1.0], [0.3, 0.8], [-0.2, 0.4]])
NOISE = np.array([0.2, 0.1, 0.1, 0.3])


@dataclass(frozen=True)
class Toy:
    """Curves 5 + SLOPES (log λ − CENTRE) with a little curvature, plus independent Gaussian noise."""

    curvature: float
    noise: float
    free: tuple[str, ...] = FREE

    def exact(self, log_values: np.ndarray) -> np.ndarray:
        d = log_values - CENTRE
        return 5 + d @ SLOPES.T + self.curvature * np.sum(d**2, axis=-1, keepdims=True)

    def members(self, z: jnp.ndarray, keys: jnp.ndarray) -> np.ndarray:
        log_values = np.asarray(log_of_free(z, self.free), dtype=float)
        rng = np.random.default_rng([*keys.shape, int(np.abs(log_values.sum()) * 1e6)])
        return self.exact(log_values) + self.noise * NOISE * rng.standard_normal((len(log_values), 4))


def test_a_quadratic_surface_is_recovered_exactly() -> None:
    surface = study(Toy(0.3, 0.0), CENTRE + 0.1, member_keys(0, 128), 0.3)
    point = CENTRE + np.array([0.2, -0.05])
    np.testing.assert_allclose(surface.mean(point), Toy(0.3, 0.0).exact(point), rtol=1e-5)
    expected = SLOPES + 0.6 * (point - CENTRE)
    np.testing.assert_allclose(surface.jacobian(point)[0], expected, atol=1e-4)
    assert np.abs(surface.scatter).max() < 1e-9


def test_the_minimum_of_a_surface_is_found_inside_its_box() -> None:
    surface = study(Toy(0.3, 0.0), CENTRE, member_keys(0, 128), 0.4)
    truth = CENTRE + np.array([0.25, -0.1])
    np.testing.assert_allclose(surface.minimise(np.eye(4), Toy(0.3, 0.0).exact(truth)), truth, atol=1e-3)
    far = Toy(0.0, 0.0).exact(CENTRE + np.array([3.0, 0.0]))
    assert (np.abs(surface.minimise(np.eye(4), far) - CENTRE) <= surface.reach).all()


def test_standard_errors_cover_the_truth() -> None:
    """400 noisy data sets, each with its own study: 95 % of estimates within 2 standard errors, and no bias."""
    rng = np.random.default_rng(1)
    toy, replicates, inside, scaled = Toy(0.1, 1.0), 10, [], []
    for _ in range(400):
        truth = CENTRE + rng.uniform(-0.1, 0.1, 2)
        start = truth + rng.normal(0, 0.05, 2)
        surface = study(toy, start, member_keys(0, 128), 0.4)
        target = toy.exact(truth) + NOISE / np.sqrt(replicates) * rng.standard_normal(4)
        sigma = surface.scatter * (1 / replicates + surface.mean_error(start))
        weight = np.linalg.inv(sigma)
        estimate = surface.minimise(np.linalg.cholesky(weight).T, target)
        covariance = _covariance_of_estimate(surface, estimate, weight, sigma)
        z = (estimate - truth) / np.sqrt(np.diag(covariance))
        inside.append(np.abs(z) < 2)
        scaled.append(z)
    # 800 draws at 95.4 %: a deviation of 0.7 %
    assert 0.92 < np.mean(inside) < 0.98
    assert np.abs(np.mean(scaled, axis=0)).max() < 4 / np.sqrt(400)


def test_a_direction_that_no_data_see_has_no_standard_error() -> None:
    toy = Toy(0.0, 1.0)
    surface = study(toy, CENTRE, member_keys(0, 64), 0.3)
    blind = np.diag([1.0, 0.0, 0.0, 0.0])  # one curve for two parameters
    assert np.isnan(_covariance_of_estimate(surface, CENTRE, blind, surface.scatter)).all()


def test_the_scout_comes_near_from_the_whole_plausible_range() -> None:
    toy = Toy(0.0, 0.3)
    for truth in (CENTRE, CENTRE + np.array([1.5, 0.2]), CENTRE + np.array([-1.0, -0.3])):
        target = np.exp(0.1 * toy.exact(truth))

        @dataclass(frozen=True)
        class Positive(Toy):
            def members(self, z: jnp.ndarray, keys: jnp.ndarray) -> np.ndarray:
                return np.exp(0.1 * super().members(z, keys))

        found = scout(
            Positive(0.0, 0.3), target, np.full(4, 0.02), np.full(4, 10.0), member_keys(0, 256), lambda number: None
        )
        assert len(found) == 1
        assert np.abs(found[0] - truth).max() < 0.15


def test_a_scout_with_several_starts_finds_both_ends_of_a_valley() -> None:
    """Curves that are even in the distance from CENTRE fit as well on either side of it."""

    @dataclass(frozen=True)
    class Even(Toy):
        def members(self, z: jnp.ndarray, keys: jnp.ndarray) -> np.ndarray:
            x, y = (np.asarray(log_of_free(z, FREE), dtype=float) - CENTRE).T
            noise = 0.01 * np.random.default_rng(0).standard_normal((len(keys), 4))
            return np.exp(np.stack([x**2, y, x**2 + y, x**2 - y], axis=1) + noise)

    x, y = 1.2, 0.1
    target = np.exp(np.array([x**2, y, x**2 + y, x**2 - y]))
    found = scout(
        Even(0.0, 0.0),
        target,
        np.full(4, 0.02),
        np.full(4, 10.0),
        member_keys(0, 256),
        lambda number: None,
        starts=3,
    )
    assert len(found) <= 3
    for end in (np.array([-x, y]), np.array([x, y])):
        assert min(np.abs(place - CENTRE - end).max() for place in found) < 0.1


def test_colonies_that_came_to_nothing_are_reported() -> None:
    @dataclass(frozen=True)
    class Broken(Toy):
        def members(self, z: jnp.ndarray, keys: jnp.ndarray) -> np.ndarray:
            return np.full((len(keys), 4), np.nan)

    with pytest.raises(InputError, match=r"64 of 64 colonies around mobility 1, aspect_ratio 0\.6 came to nothing"):
        study(Broken(0.0, 0.0), CENTRE, member_keys(0, 64), 0.3)


def test_bijection_is_one_to_one() -> None:
    parameters = Parameters(mobility=2.5, aspect_ratio=0.95)
    z = to_free(parameters, FREE)
    back = from_free(z, FREE, Parameters())
    assert float(back.mobility) == pytest.approx(2.5, rel=1e-5)
    assert float(back.aspect_ratio) == pytest.approx(0.95, rel=1e-5)
    np.testing.assert_allclose(free_of_log(log_of_free(z, FREE), FREE), z, rtol=1e-4)


def test_free_names_are_checked() -> None:
    assert check_free(["aspect_ratio", "mobility"]) == FREE
    with pytest.raises(InputError, match="'speed' is unknown"):
        check_free(["speed"])
    with pytest.raises(InputError, match="no parameter is free"):
        check_free([])
    with pytest.raises(InputError, match="mobility is 500"):
        to_free(Parameters(mobility=500.0), FREE)


def test_robust_mean_cuts_outliers_and_only_those() -> None:
    rng = np.random.default_rng(0)
    tangents = rng.normal(2.0, 1.0, (64, 1, 3))
    plain = robust_mean(jnp.asarray(tangents))
    np.testing.assert_allclose(plain.mean, tangents.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(plain.error, tangents.std(axis=0, ddof=1) / 8, rtol=1e-5)
    np.testing.assert_allclose(plain.spread, 1.0, rtol=1e-5)
    assert (plain.cut == 0).all()
    tangents[3] = 1e9
    tangents[4] = np.nan
    robust = robust_mean(jnp.asarray(tangents))
    assert np.abs(robust.mean - 2).max() < 0.6
    np.testing.assert_allclose(robust.cut, 2 / 64)
    assert (np.asarray(robust.spread) > 100).all() or np.isnan(robust.spread).all()


def test_robust_mean_keeps_what_only_some_members_have() -> None:
    """Births that every fifth colony has: the median is 0, and the mean is not."""
    tangents = np.where(np.arange(40) % 5 == 0, -3.0, 0.0)[:, None]
    np.testing.assert_allclose(robust_mean(jnp.asarray(tangents)).mean, -0.6, rtol=1e-5)
