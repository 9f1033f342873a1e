"""Response surfaces: mean curves as polynomials in log λ, by regression over colonies with different λ.

They need no derivative, so they work for the hard model, whose colonies have none while their mean does; they do not
care about chaos; and one ensemble gives the mean at its centre, its derivative and the scatter of single colonies
(Box & Wilson 1951). Two uses: `local_study` around an estimate, and `scout`, which narrows a box from the whole
plausible range.
"""

from collections.abc import Callable
from itertools import combinations_with_replacement
from math import comb

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from yeastfit.errors import InputError
from yeastfit.infer.bijection import free_of_log, log_range
from yeastfit.infer.curves import Curves

Points = Float[np.ndarray, "point free"]


class Local(eqx.Module):
    """What an ensemble spread around a point says of the curves there.

    halves: the derivatives from two independent halves of the ensemble. scatter: covariance of one colony's curves.
    mean_error: variance of the mean, as a share of that.
    """

    mean: Float[np.ndarray, " curve"]
    jacobian: Float[np.ndarray, "curve free"]
    halves: Float[np.ndarray, "2 curve free"]
    scatter: Float[np.ndarray, "curve curve"]
    mean_error: float


def local_study(curves: Curves, log_values: Float[np.ndarray, " free"], keys: Array, half_width: float) -> Local:
    """Mean curves and their derivative in log λ at a point, from members spread over a box around it.

    half_width: of the box, less where the plausible range ends sooner. A quadratic is fitted, so that the mean has no
    bias from curvature.
    """
    low, high = plausible(curves)
    reach = np.minimum(half_width, 0.9 * np.minimum(log_values - low, high - log_values))
    units, values = _sample(curves, log_values, reach, keys)
    coefficients, scatter, information = _regress(units, values, 2)
    derivative = slice(1, 1 + len(reach))
    halves = [_regress(units[k::2], values[k::2], 2)[0][derivative].T / reach for k in (0, 1)]
    return Local(
        mean=coefficients[0],
        jacobian=coefficients[derivative].T / reach,
        halves=np.stack(halves),
        scatter=scatter,
        mean_error=float(information[0, 0]),
    )


def scout(
    curves: Curves,
    target: Float[np.ndarray, " curve"],
    relative_error: Float[np.ndarray, " curve"],
    replicates: Float[np.ndarray, " curve"],
    keys: Array,
    progress: Callable[[int], None],
    widths: tuple[float, ...] = (0.4, 0.16, 0.064),
) -> Float[np.ndarray, " free"]:
    """log λ near the best fit, by response surfaces of the logarithms of the curves over boxes that narrow.

    widths: half widths of the boxes, as shares of the plausible range. A surface's residual covariance, which holds the
    scatter of colonies and the surface's own misfit, and the data's relative error weigh the distance to the target.
    """
    low, high = plausible(curves)
    centre = 0.5 * (low + high)
    for number, width in enumerate(widths):
        progress(number)
        reach = width * (high - low)
        centre = np.clip(centre, low + reach, high - reach)
        units, values = _sample(curves, centre, reach, keys, positive=True)
        degree = 3 if 4 * comb(len(reach) + 3, 3) <= len(units) else 2
        coefficients, scatter, _ = _regress(units, np.log(values), degree)
        sigma = scatter / np.sqrt(np.outer(replicates, replicates)) + np.diag(relative_error**2)
        tries = 2.0 * qmc.Sobol(len(reach), rng=number).random(4096) - 1.0
        distance = features(tries, degree) @ coefficients - np.log(target)
        cost = np.sum(distance * np.linalg.solve(sigma, distance.T).T, axis=1)
        centre = centre + reach * tries[np.argmin(cost)]
    return centre


def features(units: Points, degree: int) -> Float[np.ndarray, "point feature"]:
    """Monomials up to a degree: 1, then the variables, then their products."""
    columns = [np.ones(len(units))]
    for order in range(1, degree + 1):
        for chosen in combinations_with_replacement(range(units.shape[1]), order):
            columns.append(np.prod(units[:, chosen], axis=1))
    return np.column_stack(columns)


def plausible(curves: Curves) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, " free"]]:
    """Ends of the free parameters' plausible ranges, in log λ."""
    low, high = log_range(curves.free)
    return np.asarray(low, dtype=float), np.asarray(high, dtype=float)


def _sample(
    curves: Curves, centre: np.ndarray, reach: np.ndarray, keys: Array, positive: bool = False
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
