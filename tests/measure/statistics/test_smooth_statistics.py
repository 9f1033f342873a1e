"""Differentiable statistics against closed forms, convergence in spacing, invariances, and derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, pair
from jax.test_util import check_grads
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.special import ellipe
from scipy.stats import ncx2

from yeastfit.measure.statistics.indicator import gaussian_blur
from yeastfit.measure.statistics.smooth_statistics import (
    SmoothStatistics,
    indicator,
    node_statistics,
    smooth_shape,
)
from yeastfit.model.cells import cells_of
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.snapshot import Snapshot

SMALL = Numerics(domain=4.0, spacing=0.2, capacity=3)
cells_from, indicated = jax.jit(cells_of), eqx.filter_jit(indicator)
P, Q = 0.9, 0.5  # half axes of the ellipse all closed forms are of


def snapshot_of(
    positions: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    relaxation: Relaxation | None = None,
    aspect: float = Q / P,
) -> Snapshot:
    """What a step shows of a colony that has not moved since."""
    parameters = Parameters(aspect_ratio=aspect)
    colony = colony_of(positions, None, weights, numerics=SMALL)
    cells = cells_from(colony, parameters.aspect_ratio)
    return Snapshot(cells, jnp.asarray(0.75), colony, parameters, relaxation or Relaxation())


def indicator_of_ellipse(spacing: float, width: float, angle: float = 0.4) -> Array:
    """½ + ½ tanh(−f/K), off the grid's symmetries."""
    axis = spacing * np.arange(-round(2 / spacing), round(2 / spacing) + 1)
    frame = (axis[:, None] - 0.03 + 1j * (axis[None, :] + 0.07)) * np.exp(-1j * angle)
    f = (frame.real / P) ** 2 + (frame.imag / Q) ** 2 - 1.0
    return jnp.asarray(0.5 - 0.5 * np.tanh(f / width))


def disc(radius: float, spacing: float, side: float = 4.0) -> np.ndarray:
    axis = spacing * np.arange(-round(side / 2 / spacing), round(side / 2 / spacing) + 1)
    return (np.hypot(axis[:, None], axis[None, :]) <= radius).astype(float)


def shape(phi: ArrayLike, spacing: float, smoothing: float = 0.0) -> dict[str, Array]:
    """`smooth_shape`, compiled."""
    return _smooth_shape(jnp.asarray(phi), spacing, smoothing)


_smooth_shape = jax.jit(smooth_shape, static_argnums=(1, 2))


def exact_of_ellipse(width: float) -> dict[str, float]:
    """Every level line f is the ellipse scaled by √(1 + f), and A = πpq ∫ (½ − ½ tanh(f/K)) df from −1."""
    slope = lambda f: 0.5 / width / np.cosh(f / width) ** 2  # noqa: E731
    circumference = 4 * P * ellipe(1 - (Q / P) ** 2)
    return {
        "area": np.pi * P * Q * 0.5 * width * np.log1p(np.exp(2 / width)),
        "perimeter": circumference * quad(lambda f: np.sqrt(1 + f) * slope(f), -1, 20 * width, epsabs=1e-12)[0],
    }


@pytest.mark.parametrize("width", [0.2, 0.5])
def test_ellipse_converges_to_the_closed_form_in_second_order(width: float, double: None) -> None:
    """The area at once, as a trapezoidal sum of a smooth function does; the perimeter by 4 a halving."""
    exact = exact_of_ellipse(width)
    found = [shape(indicator_of_ellipse(h, width), h) for h in (0.025, 0.0125, 0.00625)]
    errors = {name: np.array([float(f[name]) / exact[name] - 1 for f in found]) for name in exact}
    assert abs(errors["area"][-1]) < 1e-6
    np.testing.assert_allclose(errors["perimeter"][:-1] / errors["perimeter"][1:], 4.0, rtol=0.1)
    assert abs(errors["perimeter"][-1]) < 0.002


def test_a_narrow_width_gives_the_shape_itself(double: None) -> None:
    """Area, perimeter, compactness and radius of a disc and of an ellipse, to the square of the width."""
    narrow, exact = 0.05, exact_of_ellipse(0.05)
    assert exact["area"] == pytest.approx(np.pi * P * Q, rel=1e-15)
    assert exact["perimeter"] == pytest.approx(4 * P * ellipe(1 - (Q / P) ** 2), rel=narrow**2)
    h = 0.005
    axis = h * np.arange(-200, 201)
    f = (axis[:, None] ** 2 + axis[None, :] ** 2) / 0.8**2 - 1
    found = shape(0.5 - 0.5 * np.tanh(f / narrow), h)
    assert float(found["area"]) == pytest.approx(np.pi * 0.8**2, rel=1e-6)
    assert float(found["perimeter"]) == pytest.approx(2 * np.pi * 0.8, rel=0.003)
    assert float(found["compactness"]) == pytest.approx(1.0, abs=0.006)
    assert float(found["radius"]) == pytest.approx(2 / 3 * 0.8, rel=0.003)


@pytest.mark.parametrize("smoothing", [0.1, 0.2])
def test_a_blurred_mask_of_a_disc(smoothing: float, double: None) -> None:
    """Its profile is a noncentral χ²: φ(r) = P(|r + σZ| < R), so P = ∫ 2πr |φ'| dr = 2π ∫ φ dr."""
    radius, h = 0.8, 0.02
    found = shape(disc(radius, h), h, smoothing)
    profile = quad(lambda r: ncx2.cdf((radius / smoothing) ** 2, 2, (r / smoothing) ** 2), 0, 4, limit=200)[0]
    assert float(found["perimeter"]) == pytest.approx(2 * np.pi * profile, rel=0.002)
    assert float(found["area"]) == pytest.approx(np.pi * radius**2, rel=0.002)  # what the mask itself is off by


def test_blurring_conserves_mass_and_adds_variances(double: None) -> None:
    """Also of what touches the array's edge, and with the cut at 4σ."""
    phi, blur = np.zeros((9, 9)), jax.jit(gaussian_blur, static_argnums=1)
    phi[0, 4] = 1.0
    blurred = np.asarray(blur(jnp.asarray(phi), 1.7))
    half = (blurred.shape[0] - 9) // 2
    assert float(blurred.sum()) == pytest.approx(1.0, abs=1e-14)
    assert np.unravel_index(np.argmax(blurred), blurred.shape) == (half, half + 4)
    offsets = np.arange(blurred.shape[0]) - half
    assert float((blurred.sum(axis=1) * offsets**2).sum()) == pytest.approx(1.7**2, rel=0.002)
    np.testing.assert_array_equal(blur(jnp.asarray(phi), 0.0), phi)


def test_all_boundaries_count_and_separate_shapes_add(double: None) -> None:
    h = 0.05
    one, small, two = disc(1.0, h, 2.4), disc(0.5, h, 2.4), np.concatenate([disc(1.0, h, 2.4), disc(0.5, h, 2.4)])
    outer, inner, ring, both = (
        {name: float(value) for name, value in shape(phi, h, h).items()} for phi in (one, small, one - small, two)
    )
    assert ring["perimeter"] == pytest.approx(outer["perimeter"] + inner["perimeter"], rel=1e-4)
    assert ring["area"] == pytest.approx(outer["area"] - inner["area"], rel=1e-12)
    for name in ("area", "perimeter"):
        assert both[name] == pytest.approx(outer[name] + inner[name], rel=1e-4)
    assert ring["compactness"] == pytest.approx(ring["perimeter"] ** 2 / (4 * np.pi * ring["area"]))


@pytest.mark.parametrize("smoothing", [0.0, 0.15])
def test_statistics_do_not_depend_on_place_turn_or_unit(smoothing: float, double: None) -> None:
    phi = np.asarray(indicator_of_ellipse(0.05, 0.2))
    here = shape(phi, 0.05, smoothing)
    for other in (np.rot90(phi), phi.T, np.pad(phi, ((30, 0), (0, 11)))):
        there = shape(other, 0.05, smoothing)
        assert {n: float(v) for n, v in there.items()} == pytest.approx({n: float(v) for n, v in here.items()})
    scaled = shape(phi, 0.05 * 7.5, smoothing * 7.5)
    for name, power in (("area", 2), ("perimeter", 1), ("radius", 1), ("compactness", 0)):
        assert float(scaled[name]) == pytest.approx(7.5**power * float(here[name]))


def test_an_empty_picture() -> None:
    found = shape(jnp.zeros((8, 8)), 0.1, 0.1)
    assert (float(found["area"]), float(found["perimeter"])) == (0.0, 0.0)
    assert np.isnan(float(found["compactness"]))
    assert np.isnan(float(found["radius"]))


@pytest.mark.parametrize("smoothing", [0.0, 0.1])
def test_derivatives_by_the_picture(smoothing: float, double: None) -> None:
    """Forward and reverse against central differences, and finite where the picture is flat."""
    phi = jnp.asarray(np.random.default_rng(0).uniform(0.1, 0.9, (7, 9)))
    check_grads(lambda x: shape(x, 0.1, smoothing), (phi,), order=1, atol=1e-6, rtol=1e-6, eps=1e-6)
    flat = jnp.asarray(disc(0.5, 0.1, 2.0))
    slopes = jax.jit(jax.jacrev(lambda x: shape(x, 0.1, smoothing)))(flat)
    assert all(np.isfinite(slope).all() for slope in slopes.values())


def test_node_statistics_are_weighted_means(double: None) -> None:
    snapshot = snapshot_of([[3.0, 4.0], [0.0, 0.0], [0.0, -2.0]], [1.0, 1.0, 0.5])
    found = {name: float(value) for name, value in eqx.filter_jit(node_statistics)(snapshot).items()}
    assert found == pytest.approx({"growth_rate": 0.75, "mean_radius": (5 + 0 + 1) / 2.5, "cell_count": 1.5})


def test_mean_radius_has_a_finite_derivative_at_the_origin() -> None:
    def mean_radius(x: Array) -> Array:
        return node_statistics(snapshot_of(x))["mean_radius"]

    slope = jax.jit(jax.grad(mean_radius))(jnp.array([[0.0, 0.0], [0.0, 2.0]]))
    np.testing.assert_allclose(slope, [[0.0, 0.0], [0.0, 0.5]])


def test_statistics_of_one_cell(double: None) -> None:
    """The whole chain, from nodes to numbers, gives the ellipse's closed form; on any grid that covers it."""
    snapshot = snapshot_of(pair(2 * P), relaxation=Relaxation(boundary=0.3))
    exact = exact_of_ellipse(0.3)
    for extent, spacing in ((4.0, 0.02), (5.0, 0.025)):
        found = eqx.filter_jit(SmoothStatistics(extent, spacing))(snapshot)
        assert float(found["area"]) == pytest.approx(exact["area"], rel=1e-4)  # `reach` leaves out e⁻⁹ of the edge
        assert float(found["perimeter"]) == pytest.approx(exact["perimeter"], rel=1e-3)


def test_without_a_boundary_width_the_indicator_is_the_mask() -> None:
    snapshot = snapshot_of(pair(2 * P), relaxation=HARD)
    phi = np.asarray(indicated(snapshot, 41, 0.1))
    assert set(np.unique(phi)) == {0.0, 1.0}
    assert phi.shape == (41, 41)
    assert float(phi.sum()) * 0.01 == pytest.approx(np.pi * P * Q, rel=0.03)  # a mask of 140 pixels


def test_the_observer_measures_what_it_indicates(double: None) -> None:
    snapshot = snapshot_of(pair(1.0))
    observer = SmoothStatistics(extent=3.0, spacing=0.1, smoothing=0.2)
    expected = shape(indicated(snapshot, 31, 0.1), 0.1, 0.2)
    found = eqx.filter_jit(observer)(snapshot)
    assert set(found) == {*expected, "growth_rate", "mean_radius", "cell_count"}
    assert {name: float(found[name]) for name in expected} == pytest.approx({n: float(v) for n, v in expected.items()})
    assert observer.finish({"area": np.ones(2)})["area"].tolist() == [1.0, 1.0]
