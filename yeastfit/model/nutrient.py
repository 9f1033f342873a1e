"""Nutrient: ∂c/∂t = λ1 ∇²c − b c, c = 1 on the boundary (source 2.7, 2.8; docs/model.md, section 3.4).

One Crank–Nicolson step with the five-point Laplacian L/h² and b frozen, written for the increment δ = cⁿ⁺¹ − cⁿ, which
is 0 on the boundary:

    (1 + ½Δt b − ½α L) δ = α L cⁿ − Δt b cⁿ,    α = λ1 Δt / h².

The matrix is symmetric and diagonally dominant. With its diagonal taken out, its eigenvalues lie in [1 − ρ, 1 + ρ],
ρ = 2α / (1 + 2α), so Chebyshev's iteration gains a factor ρ / (1 + √(1 − ρ²)) a sweep whatever b ≥ 0 is (Golub & Varga
1961), and the number of sweeps is known beforehand: 4 to 8 for the α in use.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.model.numerics import Numerics, largest_in_ensemble

TOLERANCE = 1e-6  # relative residual of the solve
LARGEST_ALPHA = 8.0  # in single precision: above, rounding c alone leaves a larger residual of the step than TOLERANCE

FASTEST = 100.0  # diffusivity of other fields, of which steps of the default length are solved to 1e-4


def largest_diffusivity(numerics: Numerics, dtype: DTypeLike) -> float:
    """Largest λ1 of which numbers of this type solve a step to `TOLERANCE`; double precision does for every one."""
    return LARGEST_ALPHA * numerics.spacing**2 / numerics.dt if dtype == jnp.float32 else float("inf")


def check_alpha(diffusivity: Float[Array, "*member"], numerics: Numerics) -> None:
    """Check that the step can be solved to `TOLERANCE` (`largest_diffusivity`).

    Raises:
        InputError: α = λ1 Δt / h² is too large for single precision.
    """
    largest = float(np.asarray(diffusivity).max())
    if largest > largest_diffusivity(numerics, diffusivity.dtype):
        alpha = largest * numerics.dt / numerics.spacing**2
        raise InputError(
            f"diffusivity · dt / spacing² is {alpha:.3g}, single precision solves the nutrient to {TOLERANCE:g} up to "
            f"{LARGEST_ALPHA:g}: lower dt, raise spacing, or set jax_enable_x64"
        )


def nutrient_step(
    nutrient: Float[Array, "x y"], biomass: Float[Array, "x y"], diffusivity: Float[Array, ""], numerics: Numerics
) -> Float[Array, "x y"]:
    """Advance c by one time step. Differentiable both ways, the solve by the implicit function theorem.

    Arguments:
        nutrient: cⁿ; its boundary stays as it is.
        biomass: b, the rate of uptake.
        diffusivity: λ1.
        numerics: Δt and h.

    Returns:
        cⁿ⁺¹.
    """
    alpha = diffusivity * numerics.dt / numerics.spacing**2
    b = numerics.dt * biomass[1:-1, 1:-1]
    diagonal = 1.0 + 2.0 * alpha + 0.5 * b

    def matrix(x: Float[Array, "i j"]) -> Float[Array, "i j"]:
        return diagonal * x - 0.5 * alpha * _open_neighbours(x)

    def solve(_: object, rhs: Float[Array, "i j"]) -> Float[Array, "i j"]:
        return _chebyshev(rhs, 1.0 / diagonal, alpha, _open_neighbours)

    c = nutrient[1:-1, 1:-1]
    rhs = alpha * (_inner_neighbours(nutrient) - 4.0 * c) - b * c
    increment = jax.lax.custom_linear_solve(matrix, rhs, solve, symmetric=True)
    return nutrient.at[1:-1, 1:-1].add(increment)


def closed_step(
    field: Float[Array, "x y"],
    rate: Float[Array, "x y"],
    diffusivity: Float[Array, ""],
    numerics: Numerics,
    source: Float[Array, "x y"] | float = 0.0,
) -> Float[Array, "x y"]:
    """Advance ∂c/∂t = D ∇²c − b c + s by one time step, no flux through the boundary. Differentiable likewise.

    Every grid point stands for a square of side h, those on the boundary, too, whose missing neighbours are themselves:
    the matrix stays symmetric, and without uptake and source the sum of c is conserved.

    Arguments:
        field: cⁿ.
        rate: b.
        diffusivity: D.
        numerics: Δt and h.
        source: s.

    Returns:
        cⁿ⁺¹.
    """
    alpha = diffusivity * numerics.dt / numerics.spacing**2
    b = numerics.dt * rate
    diagonal = 1.0 + 2.0 * alpha + 0.5 * b

    def matrix(x: Float[Array, "x y"]) -> Float[Array, "x y"]:
        return diagonal * x - 0.5 * alpha * _closed_neighbours(x)

    def solve(_: object, rhs: Float[Array, "x y"]) -> Float[Array, "x y"]:
        return _chebyshev(rhs, 1.0 / diagonal, alpha, _closed_neighbours)

    rhs = alpha * (_closed_neighbours(field) - 4.0 * field) - b * field + numerics.dt * source
    return field + jax.lax.custom_linear_solve(matrix, rhs, solve, symmetric=True)


def _inner_neighbours(x: Float[Array, "x y"]) -> Float[Array, "i j"]:
    """Sum of the four neighbours of every interior point."""
    return x[:-2, 1:-1] + x[2:, 1:-1] + x[1:-1, :-2] + x[1:-1, 2:]


def _open_neighbours(x: Float[Array, "i j"]) -> Float[Array, "i j"]:
    """Sum of the four neighbours of every point, 0 beyond the array.

    Shifted arrays are joined, not cut from a padded one, which a CPU fills point by point.
    """
    row, column = jnp.zeros_like(x[:1]), jnp.zeros_like(x[:, :1])
    above, below = jnp.concatenate([row, x[:-1]]), jnp.concatenate([x[1:], row])
    left, right = jnp.hstack([column, x[:, :-1]]), jnp.hstack([x[:, 1:], column])
    return above + below + left + right


def _closed_neighbours(x: Float[Array, "x y"]) -> Float[Array, "x y"]:
    """Likewise, those beyond the array like the point itself: joining rows of its edges takes twice as long."""
    missing = [jnp.where((at == 0) | (at == len(at) - 1), 1, 0).astype(x.dtype) for at in map(jnp.arange, x.shape)]
    return _open_neighbours(x) + (missing[0][:, None] + missing[1]) * x


def sweeps(alpha: Float[Array, ""]) -> tuple[Array, Array]:
    """Number of Chebyshev sweeps for `TOLERANCE`, and ρ, from 2 τᵏ / (1 + τ²ᵏ) ≤ tolerance."""
    rho = 2.0 * alpha / (1.0 + 2.0 * alpha)
    gain = rho / (1.0 + jnp.sqrt(1.0 - rho**2))
    needed = jnp.log(2.0 / TOLERANCE) / -jnp.log(jnp.maximum(gain, 1e-6))
    return jnp.ceil(needed).astype(int), rho


def _chebyshev(
    rhs: Float[Array, "i j"],
    inverse: Float[Array, "i j"],
    alpha: Float[Array, ""],
    neighbours: Callable[[Float[Array, "i j"]], Float[Array, "i j"]],
) -> Float[Array, "i j"]:
    """Chebyshev semi-iteration on the matrix with its diagonal taken out, from δ = 0."""
    alpha = jax.lax.stop_gradient(alpha)
    count, rho = sweeps(alpha)
    scaled = inverse * rhs

    def sweep(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, before, omega = carry
        omega = 1.0 / (1.0 - 0.25 * rho**2 * omega)
        jacobi = scaled + inverse * (0.5 * alpha * neighbours(x))
        # a member that needs fewer sweeps than another in its batch stops here, and so does not depend on the other
        return jnp.where(k < count, omega * (jacobi - before) + before, x), x, omega

    def two(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        return sweep(2 * k + 2, sweep(2 * k + 1, carry))  # after two, x and the one before are where they were

    # the first sweep is plain Jacobi from 0; ω₁ = 2 makes the recursion give ω₂ = 1 / (1 − ρ²/2)
    first = (scaled, jnp.zeros_like(scaled), jnp.full_like(rho, 2.0))
    return jax.lax.fori_loop(0, largest_in_ensemble(count) // 2, two, first)[0]
