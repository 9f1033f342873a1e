"""Response surfaces: mean curves as polynomials in log λ, by regression over colonies with different λ.

They need no derivative, so they work for the hard model, whose colonies have none while their mean does; they do not
care about chaos; and one ensemble gives the mean, its derivative and the scatter of single colonies (Box & Wilson 1951,
doi:10.1111/j.2517-6161.1951.tb00067.x). Two uses: `study` of a box around an estimate, and `scout`, which narrows a box
from the whole plausible range.
"""

from collections.abc import Callable
from itertools import combinations_with_replacement
from math import comb
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float
from scipy.stats import qmc

from yeastfit.errors import InputError
from yeastfit.infer.bijection import free_of_log, log_range

SLACK = 16.0  # of χ² above a surface's lowest point: what a scout takes for a fit about as good
APART = 0.3  # of a box's half width, in one parameter at least, between two places where a scout goes on

Points = Float[np.ndarray, "point free"]
LogValues = Float[np.ndarray, " free"]


@runtime_checkable
class Ensemble(Protocol):
    """What is studied: the curves of one colony for each row of z (`Curves`, or a stand-in whose answer is known)."""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free parameters."""

    def members(self, z: Array, keys: Array) -> Any:
        """Curves, one row per member."""


class Surface(eqx.Module):
    """Mean curves over a box in log λ, centre ± reach, as a polynomial in u = (log λ − centre) / reach.

    scatter: covariance of one colony's curves. information: (XᵀX)⁻¹ of the regression.
    """

    centre: LogValues
    reach: LogValues
    degree: int = eqx.field(static=True)
    coefficients: Float[np.ndarray, "feature curve"]
    scatter: Float[np.ndarray, "curve curve"]
    information: Float[np.ndarray, "feature feature"]

    def mean(self, log_values: LogValues) -> Float[np.ndarray, " curve"]:
        """The mean curves at a point."""
        return self._features(log_values) @ self.coefficients

    def mean_error(self, log_values: LogValues) -> float:
        """Variance of that mean, as a share of one colony's."""
        x = self._features(log_values)
        return float(x @ self.information @ x)

    def jacobian(self, log_values: LogValues) -> tuple[Float[np.ndarray, "curve free"], Float[np.ndarray, "free free"]]:
        """The derivative J of the mean in log λ, and G: one row of J has the covariance S_kk G, S the scatter."""
        u = jnp.asarray((log_values - self.centre) / self.reach)
        slopes = np.asarray(_slopes(u, self.degree), dtype=float) / self.reach
        return self.coefficients.T @ slopes, slopes.T @ self.information @ slopes

    def minimise(self, whiten: np.ndarray, target: np.ndarray) -> LogValues:
        """log λ in the box where |whiten (mean − target)|² is least: Levenberg–Marquardt in v, u = tanh v."""
        v = _descend(
            jnp.zeros(len(self.reach)),
            jnp.asarray(self.coefficients @ whiten.T),
            jnp.asarray(whiten @ target),
            self.degree,
        )
        return self.centre + self.reach * np.tanh(np.asarray(v, dtype=float))

    def _features(self, log_values: LogValues) -> Float[np.ndarray, " feature"]:
        return np.asarray(features(((log_values - self.centre) / self.reach)[None], self.degree)[0], dtype=float)


@eqx.filter_jit
def _slopes(u: Float[Array, " free"], degree: int) -> Float[Array, "feature free"]:
    return jax.jacfwd(lambda u: features(u[None], degree)[0])(u)


@eqx.filter_jit
def _descend(
    start: Float[Array, " free"],
    coefficients: Float[Array, "feature curve"],
    target: Float[Array, " curve"],
    degree: int,
) -> Float[Array, " free"]:
    """v near `start` where |polynomial(tanh v) − target|² is least."""

    def residuals(v: Array, _: Any) -> Array:
        return features(jnp.tanh(v)[None], degree)[0] @ coefficients - target

    solver: Any = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4)
    return optx.least_squares(residuals, solver, start, max_steps=200, throw=False).value


def study(curves: Ensemble, log_values: LogValues, keys: Array, half_width: float) -> Surface:
    """The quadratic surface over a box around a point, smaller where the plausible range ends sooner.

    Cubic terms would cost most of the precision of the derivative, with which they are correlated.
    """
    low, high = plausible(curves)
    reach = np.minimum(half_width, 0.9 * np.minimum(log_values - low, high - log_values))
    units, values = _sample(curves, log_values, reach, keys)
    return Surface(log_values, reach, 2, *_regress(units, values, 2))


def scout(
    curves: Ensemble,
    target: Float[np.ndarray, " curve"],
    relative_error: Float[np.ndarray, " curve"],
    replicates: Float[np.ndarray, " curve"],
    keys: Array,
    progress: Callable[[int], None],
    widths: tuple[float, ...] = (0.4, 0.16, 0.064),
    starts: int = 1,
) -> list[LogValues]:
    """log λ near the best fits, by response surfaces of the logarithms of the curves over boxes that narrow.

    widths: half widths of the boxes, as shares of the plausible range. starts: how many places the first box may be
    left for, spread over all that fits about as well there: along a valley a few hundred colonies do not tell which
    end is lower. Places that meet again become one. A surface's residual covariance, which holds the scatter of
    colonies and the surface's own misfit, and the data's relative error weigh the distance to the target.
    """
    low, high = plausible(curves)

    def lowest(centre: LogValues, reach: LogValues, count: int) -> list[LogValues]:
        centre = np.clip(centre, low + reach, high - reach)
        units, values = _sample(curves, centre, reach, keys, positive=True)
        degree = 3 if 4 * comb(len(reach) + 3, 3) <= len(units) else 2  # four colonies or more to a coefficient
        coefficients, scatter, _ = _regress(units, np.log(values), degree)
        sigma = scatter / np.sqrt(np.outer(replicates, replicates)) + np.diag(relative_error**2)
        tries = 2.0 * qmc.Sobol(len(reach), rng=0).random(4096) - 1.0
        distance = features(tries, degree) @ coefficients - np.log(target)
        cost = np.sum(distance * np.linalg.solve(sigma, distance.T).T, axis=1)
        best = tries[np.argmin(cost)]
        return [centre + reach * unit for unit in _spread(best, tries[cost < cost.min() + SLACK], count)]

    places = [0.5 * (low + high)]
    for number, width in enumerate(widths):
        reach, found = width * (high - low), list[LogValues]()
        for place in places:
            progress(number)
            for new in lowest(place, reach, 1 if number else starts):
                if all((np.abs(new - old) > 0.2 * reach).any() for old in found):
                    found.append(new)
        places = found
    return places


def _spread(first: LogValues, others: Points, count: int) -> list[LogValues]:
    """`first` and up to count − 1 of the others, each the farthest from all before, while any is as far as `APART`."""
    chosen = [first]
    while len(chosen) < count:
        gap = np.min([np.abs(others - place).max(axis=1) for place in chosen], axis=0)
        if gap.max() < APART:
            break
        chosen.append(others[np.argmax(gap)])
    return chosen


def features(units: Any, degree: int) -> Any:
    """Monomials [point, feature] up to a degree: 1, the variables, their products. Of NumPy's or JAX's arrays."""
    columns = [units[:, 0] * 0.0 + 1.0]
    for order in range(1, degree + 1):
        for chosen in combinations_with_replacement(range(units.shape[1]), order):
            columns.append(units[:, np.array(chosen)].prod(axis=1))
    return (jnp if isinstance(units, jax.Array) else np).stack(columns, axis=1)


def plausible(curves: Ensemble) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, " free"]]:
    """Ends of the free parameters' plausible ranges, in log λ."""
    low, high = log_range(curves.free)
    return np.asarray(low, dtype=float), np.asarray(high, dtype=float)


def _sample(
    curves: Ensemble, centre: np.ndarray, reach: np.ndarray, keys: Array, positive: bool = False
) -> tuple[Points, Float[np.ndarray, "point curve"]]:
    """Points of a low-discrepancy set in the unit box with one colony's curves each; what is not finite is left out."""
    units = 2.0 * qmc.Sobol(len(reach), rng=0).random(len(keys)) - 1.0
    z = free_of_log(jnp.asarray(centre + reach * units), curves.free)
    values = np.asarray(curves.members(z, keys), dtype=float)
    good = np.isfinite(values).all(axis=1) & (not positive or (values > 0).all(axis=1))
    if good.sum() < 0.5 * len(keys):
        raise InputError(
            f"{len(keys) - good.sum()} of {len(keys)} colonies around "
            + ", ".join(f"{name} {value:.3g}" for name, value in zip(curves.free, np.exp(centre), strict=True))
            + " came to nothing (not finite): lower dt, or fix parameters elsewhere"
        )
    return units[good], values[good]


def _regress(units: Points, values: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients, residual covariance and (XᵀX)⁻¹ of a polynomial regression."""
    design = features(units, degree)
    coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
    rest = values - design @ coefficients
    return coefficients, rest.T @ rest / max(1, len(units) - design.shape[1]), np.linalg.inv(design.T @ design)
