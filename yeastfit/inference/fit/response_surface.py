"""Response surfaces: means around an estimate as quadratic functions of θ, by regression over simulations.

One set of simulations, spread over a box, gives the mean everywhere in it, and its error (Box & Wilson 1951,
doi:10.1111/j.2517-6161.1951.tb00067.x). On it a fit costs nothing, so thousands can be made: of resampled data, or with
one parameter held (`bootstrap_profile`). Cubic terms would cost most of the precision of the slopes, with which they
are correlated.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.curve_covariance import Square, whitened
from yeastfit.inference.paired_regression import Scatter
from yeastfit.inference.parameter_space import Points, Vector
from yeastfit.inference.polynomial import PolynomialRegression, monomials, sobol_points

MOST_STEPS = 100  # of Levenberg–Marquardt on a quadratic, which takes about ten

Simulate = Callable[[Points], Float[np.ndarray, "point observable"]]
"""One simulation of each condition at each point."""


@dataclass(frozen=True)
class Minima:
    """Minima of χ² on a surface, one for each set of values.

    Attributes:
        theta: Where.
        chi_square: How much.
        converged: False where the optimiser ran into its limit of steps.
    """

    theta: Float[np.ndarray, "fit entry"]
    chi_square: Float[np.ndarray, " fit"]
    converged: Bool[np.ndarray, " fit"]


@dataclass(frozen=True)
class ResponseSurface:
    """Means over the box centre ± reach, as a polynomial in u = (θ − centre) / reach.

    Attributes:
        centre: Of the box.
        reach: Half its width.
        coefficients: Of the polynomial.
        scatter: Of one simulation.
        inverse: (TᵀT)⁻¹ of the regression's terms.
    """

    centre: Vector
    reach: Vector
    coefficients: Float[np.ndarray, "term observable"]
    scatter: Scatter
    inverse: Float[np.ndarray, "term term"]

    def mean(self, theta: Vector) -> Float[np.ndarray, " observable"]:
        """The means at a point."""
        return self._terms(theta) @ self.coefficients

    def mean_covariance(self, theta: Vector) -> Square:
        """Of the errors of `mean`."""
        t = self._terms(theta)
        return float(t @ self.inverse @ t) * self.scatter.covariance

    def minimise(
        self,
        root: Square,
        values: Float[np.ndarray, "fit observable"],
        *,
        centre: Vector | None = None,
        pull: Vector | None = None,
        held: tuple[int, Float[np.ndarray, " fit"]] | None = None,
        max_steps: int = MOST_STEPS,
    ) -> Minima:
        """Minimise χ² in the box for many sets of values at once.

        Levenberg–Marquardt in v, u = sin v, from the middle of the box.

        Arguments:
            root: L of Σ = L Lᵀ.
            values: Data.
            centre: μ of Gaussian priors.
            pull: Their 1/τ.
            held: An entry, and where it is held in each fit.
            max_steps: Of the optimiser.
        """
        count, size = len(values), len(self.reach)
        units = np.zeros((count, size))
        moving = np.ones(size)
        if held is not None:
            moving[held[0]] = 0.0
            units[:, held[0]] = (held[1] - self.centre[held[0]]) / self.reach[held[0]]
        none = np.zeros(size)
        aim = none if centre is None else (centre - self.centre) / self.reach
        weight = none if pull is None else pull * self.reach
        data, coefficients = whitened(root, values.T).T, whitened(root, self.coefficients.T).T
        arrays = [jnp.asarray(each) for each in (units, data, coefficients, moving, aim, weight)]
        u, squares, converged = (np.asarray(each) for each in _minimise(max_steps, *arrays))
        return Minima(self.centre + self.reach * u.astype(float), squares.astype(float), converged)

    def _terms(self, theta: Vector) -> Float[np.ndarray, " term"]:
        return np.asarray(monomials(((theta - self.centre) / self.reach)[None])[0], dtype=float)


@eqx.filter_jit
def _minimise(
    max_steps: int,
    units: Float[Array, "fit entry"],
    values: Float[Array, "fit observable"],
    coefficients: Float[Array, "term observable"],
    moving: Float[Array, " entry"],
    aim: Float[Array, " entry"],
    weight: Float[Array, " entry"],
) -> tuple[Float[Array, "fit entry"], Float[Array, " fit"], Bool[Array, " fit"]]:
    """u of the lowest χ² in the box for each set of values; an entry of `moving` 0 stays where it is."""

    def one(unit: Array, value: Array) -> tuple[Array, Array, Array]:
        def place(v: Array) -> Array:
            return unit + moving * jnp.sin(v)

        def residuals(v: Array, _: Any) -> Array:
            return jnp.concatenate([monomials(place(v)[None])[0] @ coefficients - value, weight * (place(v) - aim)])

        solver: Any = optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5)
        found: Any = optx.least_squares(residuals, solver, jnp.zeros(unit.size), max_steps=max_steps, throw=False)
        v = found.value
        return place(v), jnp.sum(residuals(v, None) ** 2), found.result == optx.RESULTS.successful

    return jax.vmap(one)(units, values)


def fewest_runs(size: int) -> int:
    """Simulations that a surface in so many parameters needs: two for each of its terms."""
    return (1 + size) * (2 + size)


def response_surface(
    simulate: Simulate, centre: Vector, reach: Vector, runs: int, seed: int | np.random.SeedSequence
) -> ResponseSurface:
    """Learn a surface from simulations at low-discrepancy points of a box, one each.

    Arguments:
        simulate: Gives a row for each point.
        centre: Of the box.
        reach: Half its width.
        runs: Simulations.
        seed: Of the points.

    Raises:
        InputError: There are too few simulations.
        SimulationError: Most of them failed.
    """
    size = len(centre)
    needed = fewest_runs(size)
    if runs < needed:
        raise InputError(
            f"runs is {runs}: a quadratic surface in {size} parameters needs at least {needed} simulations"
        )
    units = 2.0 * sobol_points(runs, size, seed) - 1.0
    values = simulate(centre + reach * units)
    good = np.isfinite(values).all(axis=1)
    if good.sum() < max(0.5 * runs, needed):
        raise SimulationError(f"{runs - good.sum()} of {runs} simulations around the estimate failed (not finite)")
    terms = np.asarray(monomials(units[good]))
    found = PolynomialRegression.of(terms, values[good])
    scatter = Scatter(found.covariance, found.freedom)
    return ResponseSurface(centre, reach, found.coefficients, scatter, np.linalg.inv(terms.T @ terms))
