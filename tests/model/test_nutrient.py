"""The Crank–Nicolson step: eigenmodes, convergence, steady state, bounds, residual, derivatives."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import grid
from jax.test_util import check_grads
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy import sparse

from yeastfit.errors import InputError
from yeastfit.model import nutrient as nutrient_module
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import check_alpha, nutrient_step, sweeps

SMALL = Numerics(domain=6.0, spacing=0.2, dt=0.05)


@pytest.fixture
def tight(double: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Double precision, and a solve that leaves no error to speak of."""
    monkeypatch.setattr(nutrient_module, "TOLERANCE", 1e-14)


def stepper(numerics: Numerics) -> Callable[[ArrayLike, ArrayLike, ArrayLike], Array]:
    """The step, compiled anew so that it sees the tolerance in force."""
    compiled = jax.jit(lambda c, b, diffusivity: nutrient_step(c, b, diffusivity, numerics))
    return lambda c, b, diffusivity: compiled(jnp.asarray(c), jnp.asarray(b), jnp.asarray(diffusivity, dtype=float))


def mode(numerics: Numerics, m: int, n: int) -> np.ndarray:
    """An eigenmode of the five-point Laplacian, 0 on the boundary."""
    x, y = grid(numerics)
    return np.sin(np.pi * m * (x / numerics.domain + 0.5)) * np.sin(np.pi * n * (y / numerics.domain + 0.5))


def laplacian(points: int) -> sparse.csr_array:
    """The five-point stencil, unit spacing, on all grid points, rows of the boundary included."""
    line = sparse.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(points, points))
    eye = sparse.eye_array(points)
    return (sparse.kron(line, eye) + sparse.kron(eye, line)).tocsr()


@pytest.mark.parametrize("uptake", [0.0, 1.7])
def test_eigenmode_decays_by_the_crank_nicolson_factor(uptake: float, tight: None) -> None:
    """The difference of two solutions is 0 on the boundary: the mode, times (1 − x) / (1 + x), and nothing else."""
    step = stepper(SMALL)
    b = np.full((SMALL.points,) * 2, uptake)
    flat, bent = step(np.ones_like(b), b, 0.37), step(1.0 - 0.3 * mode(SMALL, 2, 5), b, 0.37)
    stencil = sum(4.0 / 0.2**2 * np.sin(np.pi * k * 0.2 / 12.0) ** 2 for k in (2, 5))
    x = 0.5 * 0.05 * (0.37 * stencil + uptake)
    np.testing.assert_allclose(
        np.asarray(flat) - np.asarray(bent), 0.3 * mode(SMALL, 2, 5) * (1 - x) / (1 + x), atol=1e-13
    )


def test_second_order_in_step_and_spacing_together(tight: None) -> None:
    """1 − c decays as exp(−2 λ1 (π/L)² t); halving dt and h divides the error by 4."""
    errors = []
    for n in (1, 2, 4):
        numerics = Numerics(domain=4.0, spacing=0.4 / n, dt=0.1 / n)
        step = stepper(numerics)
        c, b = jnp.asarray(1.0 - mode(numerics, 1, 1)), np.zeros((numerics.points,) * 2)
        for _ in range(10 * n):
            c = step(c, b, 0.5)
        exact = mode(numerics, 1, 1) * np.exp(-2 * 0.5 * (np.pi / 4.0) ** 2 * 1.0)
        errors.append(np.abs(1.0 - np.asarray(c) - exact).max())
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 4.0, rtol=0.02)


def test_nothing_eaten_nothing_changes() -> None:
    ones = np.ones((SMALL.points,) * 2)
    assert np.array_equal(stepper(SMALL)(ones, np.zeros_like(ones), 5.0), ones)


@pytest.mark.thorough
def test_steady_state_solves_the_stationary_equation(tight: None) -> None:
    numerics = Numerics(domain=2.0, spacing=0.2, dt=0.5)
    step = stepper(numerics)
    b = np.random.default_rng(3).uniform(0.0, 2.0, (numerics.points,) * 2)
    c = np.ones_like(b)
    for _ in range(300):
        c = np.asarray(step(c, b, 0.5))
    spread = 0.5 * (laplacian(numerics.points) @ c.ravel()).reshape(b.shape) / 0.2**2
    np.testing.assert_allclose(spread[1:-1, 1:-1], (b * c)[1:-1, 1:-1], atol=1e-11)
    assert (c[[0, -1]] == 1.0).all()
    assert (c[:, [0, -1]] == 1.0).all()


@pytest.mark.parametrize("seed", range(5))
def test_maximum_principle(seed: int) -> None:
    """0 ≤ c ≤ 1 for any b ≥ 0 while 2α + ½Δt b ≤ 1, up to the solve's 1e-6 of an increment that is below 1."""
    rng = np.random.default_rng(seed)
    step = stepper(Numerics(domain=6.0, spacing=0.1, dt=0.02))
    shape = (61, 61)
    diffusivity = rng.uniform(0.0, 0.2)  # α up to 0.4
    b = rng.choice([0.0, 20.0], shape) * rng.uniform(0.0, 1.0, shape)
    c = np.pad(rng.choice([0.0, 1.0], (59, 59)), 1, constant_values=1.0)
    for _ in range(40):
        c = np.asarray(step(c, b, diffusivity))
        assert c.min() >= -1e-6
        assert c.max() <= 1.0 + 1e-6
    assert 0.0 < c.min() < c.max() <= 1.0


@pytest.mark.parametrize("alpha", [1e-3, 0.2, 1.0, 10.0, 300.0])
def test_relative_residual(alpha: float, double: None) -> None:
    """At most 1e-6 of the increment's right-hand side, which is far less of the whole system's."""
    numerics = Numerics(domain=8.0, spacing=0.2, dt=0.02)
    diffusivity = alpha * numerics.spacing**2 / numerics.dt
    rng = np.random.default_rng(1)
    shape = (numerics.points,) * 2
    b = rng.uniform(0.0, 20.0, shape) * (rng.uniform(size=shape) < 0.3)
    c = np.pad(rng.uniform(size=(numerics.points - 2,) * 2), 1, constant_values=1.0)
    new = np.asarray(stepper(numerics)(c, b, diffusivity))

    operator = diffusivity / numerics.spacing**2 * laplacian(numerics.points) - sparse.diags_array(b.ravel())
    inside = np.pad(np.ones((numerics.points - 2,) * 2, bool), 1).ravel()
    right = (c.ravel() + 0.5 * numerics.dt * operator @ c.ravel())[inside]
    residual = (new.ravel() - 0.5 * numerics.dt * operator @ new.ravel())[inside] - right
    increment = (numerics.dt * operator @ c.ravel())[inside]
    assert np.linalg.norm(residual) <= 1e-6 * np.linalg.norm(increment)
    assert np.linalg.norm(residual) > 1e-10 * np.linalg.norm(increment)  # an honest measurement, not a vacuous one


@pytest.mark.parametrize("alpha", [1e-3, 0.2, 2.0, nutrient_module.LARGEST_ALPHA])
def test_single_precision_holds_the_residual_up_to_the_alpha_it_is_admitted_for(alpha: float) -> None:
    """Of the whole system, from nutrient that a disc has eaten from; twice that α does not, and is refused."""
    numerics = Numerics(domain=10.0, spacing=0.1, dt=0.02)
    x, y = grid(numerics)
    b = np.where(x**2 + y**2 < 4.0, np.random.default_rng(0).uniform(size=x.shape), 0.0).astype(np.float32)

    def worst(alpha: float) -> float:
        diffusivity = np.float32(alpha * numerics.spacing**2 / numerics.dt)
        operator = float(diffusivity) / numerics.spacing**2 * laplacian(numerics.points) - sparse.diags_array(b.ravel())
        inside = np.pad(np.ones((numerics.points - 2,) * 2, bool), 1).ravel()
        advance, c, residuals = stepper(numerics), np.ones_like(b), []
        for _ in range(20):
            old, c = c, np.asarray(advance(c, b, diffusivity))
            right = (old.ravel() + 0.5 * numerics.dt * operator @ old.ravel().astype(float))[inside]
            left = (c.ravel() - 0.5 * numerics.dt * operator @ c.ravel().astype(float))[inside]
            residuals.append(np.linalg.norm(left - right) / np.linalg.norm(right))
        return float(max(residuals))

    assert worst(alpha) <= 1e-6
    if alpha == nutrient_module.LARGEST_ALPHA:
        assert worst(2 * alpha) > 1e-6
        with pytest.raises(InputError, match="single precision"):
            check_alpha(jnp.asarray(2 * alpha * numerics.spacing**2 / numerics.dt), numerics)
    check_alpha(jnp.asarray(alpha * numerics.spacing**2 / numerics.dt), numerics)


def test_number_of_sweeps() -> None:
    """4 to 8 for the α in use, as documented, and bounded where there is no diffusion."""
    number = jax.jit(lambda alpha: sweeps(alpha)[0])
    counts = {alpha: int(number(jnp.asarray(alpha))) for alpha in (0.0, 0.02, 0.2, 0.4, 10.0)}
    assert counts[0.0] <= 2
    assert counts[0.02] == 4
    assert counts[0.2] == 8
    assert sorted(counts.values()) == list(counts.values())


def test_derivatives_both_ways(tight: None) -> None:
    """With respect to nutrient, biomass and λ1, forward and reverse, against central differences."""
    numerics = Numerics(domain=2.0, spacing=0.2, dt=0.05)
    rng = np.random.default_rng(2)
    c, b = jnp.asarray(rng.uniform(0.2, 1.0, (11, 11))), jnp.asarray(rng.uniform(0.0, 5.0, (11, 11)))
    check_grads(stepper(numerics), (c, b, jnp.asarray(0.6)), order=1, atol=1e-8, rtol=1e-8, eps=1e-5)
