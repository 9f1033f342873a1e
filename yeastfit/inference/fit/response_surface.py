"""Response surfaces: mean curves around an estimate as quadratic functions of θ, by regression over colonies.

One ensemble, spread over a box, gives the mean everywhere in it, and its error (Box & Wilson 1951,
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
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.inference.paired_regression import CurveSquare, Scatter
from yeastfit.inference.parameter_space import Vector
from yeastfit.inference.polynomial import PolynomialRegression, monomials, sobol_points

Grow = Callable[[Float[np.ndarray, "point entry"]], Float[np.ndarray, "point curve"]]
"""One colony's curves, or one of each condition, at each point."""


@dataclass(frozen=True)
class Surface:
    """Mean curves over the box centre ± reach, as a polynomial in u = (θ − centre) / reach.

    scatter: covariance of one colony's curves. inverse: (XᵀX)⁻¹ of the regression.
    """

    centre: Vector
    reach: Vector
    coefficients: Float[np.ndarray, "feature curve"]
    scatter: Scatter
    inverse: Float[np.ndarray, "feature feature"]

    def mean(self, theta: Vector) -> Float[np.ndarray, " curve"]:
        """The mean curves at a point."""
        return self._features(theta) @ self.coefficients

    def mean_covariance(self, theta: Vector) -> CurveSquare:
        """Of that mean's errors."""
        x = self._features(theta)
        return float(x @ self.inverse @ x) * self.scatter.covariance

    def minimise(
        self,
        factor: CurveSquare,
        values: Float[np.ndarray, "fit curve"],
        *,
        centre: Vector | None = None,
        pull: Vector | None = None,
        held: tuple[int, Float[np.ndarray, " fit"]] | None = None,
    ) -> tuple[Float[np.ndarray, "fit entry"], Float[np.ndarray, " fit"]]:
        """θ in the box where χ² is least, and χ² there, for many sets of values at once.

        factor: L of Σ = L Lᵀ. centre, pull: of Gaussian priors, μ and 1/τ. held: an entry, and where it is held in each
        fit. Levenberg–Marquardt in v, u = sin v, from the middle of the box.
        """
        count, size = len(values), len(self.reach)
        whiten = np.linalg.inv(factor)
        units = np.zeros((count, size))
        moving = np.ones(size)
        if held is not None:
            moving[held[0]] = 0.0
            units[:, held[0]] = (held[1] - self.centre[held[0]]) / self.reach[held[0]]
        none = np.zeros(size)
        aim = none if centre is None else (centre - self.centre) / self.reach
        weight = none if pull is None else pull * self.reach
        rest = (jnp.asarray(x) for x in (self.coefficients @ whiten.T, moving, aim, weight))
        found, squares = _descend(jnp.asarray(units), jnp.asarray(values @ whiten.T), *rest)
        return self.centre + self.reach * np.asarray(found, dtype=float), np.asarray(squares, dtype=float)

    def _features(self, theta: Vector) -> Float[np.ndarray, " feature"]:
        return np.asarray(monomials(((theta - self.centre) / self.reach)[None])[0], dtype=float)


@eqx.filter_jit
def _descend(
    units: Float[Array, "fit entry"],
    values: Float[Array, "fit curve"],
    coefficients: Float[Array, "feature curve"],
    moving: Float[Array, " entry"],
    aim: Float[Array, " entry"],
    weight: Float[Array, " entry"],
) -> tuple[Float[Array, "fit entry"], Float[Array, " fit"]]:
    """u of the lowest χ² in the box for each set of values; an entry of `moving` 0 stays where it is."""

    def one(unit: Array, value: Array) -> tuple[Array, Array]:
        def place(v: Array) -> Array:
            return unit + moving * jnp.sin(v)

        def residuals(v: Array, _: Any) -> Array:
            return jnp.concatenate([monomials(place(v)[None])[0] @ coefficients - value, weight * (place(v) - aim)])

        solver: Any = optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5)
        v = optx.least_squares(residuals, solver, jnp.zeros(unit.size), max_steps=100, throw=False).value
        return place(v), jnp.sum(residuals(v, None) ** 2)

    return jax.vmap(one)(units, values)


def study(grow: Grow, centre: Vector, reach: Vector, runs: int, seed: int) -> Surface:
    """The surface over a box, from colonies at low-discrepancy points of it, one each.

    Raises `InputError` where there are too few, and where most of them came to nothing.
    """
    size = len(centre)
    needed = 2 * (1 + size) * (2 + size) // 2
    if runs < needed:
        raise InputError(f"runs is {runs}: a quadratic surface in {size} parameters needs at least {needed} colonies")
    units = 2.0 * sobol_points(runs, size, seed) - 1.0
    values = grow(centre + reach * units)
    good = np.isfinite(values).all(axis=1)
    if good.sum() < max(0.5 * runs, needed):
        raise InputError(f"{runs - good.sum()} of {runs} colonies around the estimate came to nothing: lower dt")
    terms = np.asarray(monomials(units[good]))
    found = PolynomialRegression.of(terms, values[good])
    scatter = Scatter(found.covariance, found.freedom)
    return Surface(centre, reach, found.coefficients, scatter, np.linalg.inv(terms.T @ terms))
