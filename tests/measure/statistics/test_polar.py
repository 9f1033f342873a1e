"""Smooth largest radius, radial profile and angular spectrum: closed forms, masks, gradients."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, pair
from jax.test_util import check_grads
from jaxtyping import Array
from shapes import disc, star, star_radius, wheel

from yeastfit.errors import InputError
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.polar import Polar, polar_statistics
from yeastfit.measure.statistics.smooth_statistics import (
    SmoothStatistics,
    gaussian_blur,
    indicator,
    smooth_polar,
    smooth_shape,
)
from yeastfit.measure.statistics.spatial_indices import angular_spectrum, radial_profile
from yeastfit.model.cells import cells_of
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.snapshot import Snapshot

POLAR = Polar(ring=4.0, rings=60, waves=18)
SMOOTH = ("area", "perimeter", "compactness", "radius")
SIDE = 254  # pixels along every picture, so that each program is compiled once for all of them


def framed(mask: np.ndarray) -> np.ndarray:
    """In the middle of `SIDE`² pixels."""
    return np.pad(mask, [((SIDE - n) // 2, (SIDE - n + 1) // 2) for n in mask.shape])


SHAPES = {
    name: framed(mask)
    for name, mask in (("disc", disc(80.0)), ("star", star(90.0, 0.3, 6)), ("wheel", wheel(50, 9, 110, 7)))
}

_polar = jax.jit(polar_statistics, static_argnums=(1, 2))
_shape = jax.jit(smooth_shape, static_argnums=(1, 2))


def polar_of(mask: np.ndarray, polar: Polar = POLAR, spacing: float = 1.0) -> dict[str, np.ndarray]:
    """Rows of a mask run down; x of the smooth statistics is the first axis."""
    return {k: np.asarray(v) for k, v in _polar(jnp.asarray(mask, dtype=float), spacing, polar).items()}


@pytest.mark.parametrize(("name", "off"), [("disc", 0.005), ("star", 0.01), ("wheel", 0.05)])
def test_hard_and_smooth_size_and_form(name: str, off: float, double: None) -> None:
    """A mask blurred by 1.5 pixels: sums to rounding, the perimeter to what Crofton's and the blurred one differ by.

    Most for straight filaments of 7 pixels, whose ends and bases the blur rounds off.
    """
    hard = measure_mask(SHAPES[name])
    smooth = _shape(jnp.asarray(SHAPES[name], dtype=float), 1.0, 1.5)
    assert float(smooth["area"]) == pytest.approx(hard.area, rel=1e-12)
    assert float(smooth["radius"]) == pytest.approx(hard.radius, rel=0.002)
    assert float(smooth["perimeter"]) == pytest.approx(hard.perimeter, rel=off)
    assert float(smooth["compactness"]) == pytest.approx(hard.compactness, rel=2 * off)


@pytest.mark.parametrize("name", SHAPES)
def test_the_profile_is_the_mask_s(name: str, double: None) -> None:
    mask = SHAPES[name]
    exact = radial_profile(Pixels.of(mask).distance, POLAR.ring, POLAR.rings)
    np.testing.assert_allclose(polar_of(mask)["radial_profile"], exact, atol=1e-10)


@pytest.mark.parametrize("name", SHAPES)
def test_the_profile_holds_the_area(name: str, double: None) -> None:
    found = polar_of(SHAPES[name])["radial_profile"]
    ring = 2 * np.pi * POLAR.ring**2 * np.arange(POLAR.rings)
    ring[0] = np.pi * POLAR.ring**2 / 3
    assert (found * ring).sum() == pytest.approx(SHAPES[name].sum(), rel=1e-12)


@pytest.mark.parametrize(("name", "short"), [("disc", 0.01), ("star", 0.02), ("wheel", 0.02)])
def test_the_largest_radius_is_the_furthest_pixel_s(name: str, short: float, double: None) -> None:
    found, exact = float(polar_of(SHAPES[name])["max_radius"]), measure_mask(SHAPES[name]).max_radius
    assert (1 - short) * exact < found < exact + 1


def test_the_largest_radius_of_a_point_of_a_filament(double: None) -> None:
    """A triangle, seen from its centroid: no more than the stated 3 % short."""
    rows, columns = np.mgrid[:61, :241]
    mask = np.abs(rows - 30) < 30 * (1 - columns / 240)
    exact = measure_mask(mask).max_radius
    assert 0.97 * exact - 1 < float(polar_of(framed(mask))["max_radius"]) < exact


def test_blur_shortens_the_largest_radius_by_less_than_its_width(double: None) -> None:
    blurred = jax.jit(gaussian_blur, static_argnums=1)(jnp.asarray(SHAPES["disc"], dtype=float), 3.0)
    found = float(_polar(blurred, 1.0, POLAR)["max_radius"])
    assert 80 - 3 < found < 80


def test_the_spectrum_of_a_star_by_quadrature(double: None) -> None:
    """Of the density ∫ v r dr up to r(θ)."""
    radius, amplitude, arms = 90.0, 0.3, 6
    angle = np.linspace(0, 2 * np.pi, 3601)[:-1]
    edge = star_radius(angle, radius, amplitude, arms)
    inner = radius * np.sqrt(1 + amplitude**2 / 2)
    r = np.linspace(0, edge.max(), 4001)
    held = np.cumsum(0.5 * (1 + np.tanh((r - inner) / POLAR.ring)) * r)
    density = np.interp(edge, r, held)
    power = polar_of(SHAPES["star"])["angular_spectrum"]
    for k in (6, 12, 18):
        exact = ((density * np.cos(k * angle)).sum() / density.sum()) ** 2
        assert power[k - 1] == pytest.approx(exact, rel=0.02, abs=1e-4)
    assert np.delete(power, [5, 11, 17]).max() < 1e-3


@pytest.mark.parametrize("name", ["star", "wheel"])
def test_the_spectrum_is_the_mask_s_beyond_the_same_circle(name: str, double: None) -> None:
    """With a narrow step: to what pixels on the circle and a step of half a pixel make of it."""
    pixels = Pixels.of(SHAPES[name])
    hard = angular_spectrum(pixels.angle[pixels.distance >= np.sqrt(pixels.area / np.pi)])
    smooth = polar_of(SHAPES[name], Polar(0.5, 1, 18))["angular_spectrum"]
    np.testing.assert_allclose(smooth, hard[1:19], atol=0.01)
    assert np.argmax(smooth) + 1 == np.argmax(hard[1:19]) + 1


@pytest.mark.parametrize("name", SHAPES)
def test_turning_and_scaling(name: str, double: None) -> None:
    here = polar_of(SHAPES[name])
    there = polar_of(np.roll(np.rot90(SHAPES[name]), (3, -5), axis=(0, 1)))
    large = polar_of(SHAPES[name], Polar(40.0, 60, 18), 10.0)
    for key, value in here.items():
        np.testing.assert_allclose(there[key], value, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(large[key], value * (10 if key == "max_radius" else 1), rtol=1e-9, atol=1e-12)


def test_single_precision_is_enough() -> None:
    found = polar_of(np.pad(SHAPES["wheel"], 300))
    assert float(found["max_radius"]) == pytest.approx(110, rel=0.02)
    assert all(np.isfinite(value).all() for value in found.values())


def test_derivatives_by_the_picture(double: None) -> None:
    """Forward and reverse against central differences; finite where the picture is flat, and at a pixel at r = 0."""
    polar = Polar(0.2, 4, 3)
    rng = np.random.default_rng(0)
    phi = jnp.asarray(np.pad(rng.uniform(0.1, 0.45, (7, 9)) + 0.5 * rng.integers(0, 2, (7, 9)), 1))
    of = jax.jit(lambda x: polar_statistics(x, 0.1, polar))
    check_grads(of, (phi,), order=1, atol=1e-5, rtol=1e-5, eps=1e-6)
    flat = jnp.asarray(disc(6.0, (0.0, 0.0)), dtype=float)
    slopes = jax.jit(jax.jacrev(lambda x: polar_statistics(x, 0.1, polar)))(flat)
    assert all(np.isfinite(slope).all() for slope in slopes.values())


def test_derivatives_by_the_shape(double: None) -> None:
    """By the amplitude of a soft star, where a user's gradients come from."""
    x = np.linspace(-2, 2, 81)
    r, angle = np.hypot(x[:, None], x[None, :] + 1e-3), np.arctan2(x[None, :] + 1e-3, x[:, None])

    @jax.jit
    def of(amplitude: Array) -> dict[str, Array]:
        phi = 0.5 + 0.5 * jnp.tanh((1 + amplitude * jnp.cos(5 * angle) - r) / 0.1)
        return polar_statistics(phi, 0.05, Polar(0.1, 16, 6))

    amplitude = jnp.asarray(0.31)
    check_grads(of, (amplitude,), order=1, atol=1e-5, rtol=1e-5, eps=1e-6)
    slope = jax.jit(jax.jacfwd(of))(amplitude)
    assert float(slope["max_radius"]) == pytest.approx(1, abs=0.15)
    assert int(np.argmax(np.abs(slope["angular_spectrum"]))) + 1 == 5


def test_an_empty_picture_has_none() -> None:
    found = polar_of(np.zeros((9, 9)))
    assert all(np.isnan(value).all() for name, value in found.items() if name != "radial_profile")


def test_the_observer_adds_them_when_asked() -> None:
    numerics = Numerics(domain=4.0, spacing=0.2, capacity=3)
    parameters, relaxation = Parameters(aspect_ratio=0.5), Relaxation()
    colony = colony_of(pair(1.0), numerics=numerics)
    cells = jax.jit(cells_of)(colony, parameters.aspect_ratio)
    snapshot = Snapshot(cells, jnp.asarray(0.75), colony, parameters, relaxation)
    polar = Polar(0.25, 5, 4)
    plain = eqx.filter_eval_shape(SmoothStatistics(3.0, 0.1, 0.2), snapshot)
    found = eqx.filter_jit(SmoothStatistics(3.0, 0.1, 0.2, polar=polar))(snapshot)
    expected = eqx.filter_jit(lambda s: smooth_polar(indicator(s, 31, 0.1), 0.1, 0.2, polar))(snapshot)
    assert set(found) - set(plain) == set(expected)
    assert set(plain) == {*SMOOTH, "growth_rate", "mean_radius", "cell_count"}
    assert [n for n in expected if "profile" in n] == [f"radial_profile_{j}" for j in range(5)]
    assert [n for n in expected if "spectrum" in n] == [f"angular_spectrum_{k}" for k in (1, 2, 3, 4)]
    for name, value in expected.items():
        assert float(found[name]) == pytest.approx(float(value), rel=1e-3, abs=1e-5)


@pytest.mark.parametrize(
    ("polar", "words"),
    [((0.0, 1, 1), "ring: got 0.0"), ((1.0, -1, 1), "rings: got -1"), ((1.0, 1, -2), "waves: got -2")],
)
def test_bad_rings_are_named(polar: tuple[float, int, int], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Polar(*polar)
