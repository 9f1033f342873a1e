"""Likelihood of single colonies, whose parameters may scatter, by an emulator.

Colony r has λ_r with y(λ_r) = y(λ) + τ ξ_r (`prior.variation`). With m and V the mean and the covariance of colonies
that scatter so, by cubature from those of colonies at places around λ (`Ensemble.moments_around`),

    o_r | λ, τ, e ~ N(m + e, V + M),    e ~ N(0, E),    E = emulator's error + N:

errors e are common to all colonies, M is what each has for itself. Colonies may lack statistics; those with the same
ones form a pattern p of R_p colonies with mean ō_p and sums of squares S_p about it, V_p is the part of V + M that they
have. With Q = Σ R_p V_p⁻¹ (0 where a statistic is missing) and μ = Q⁻¹ Σ R_p V_p⁻¹ ō_p, the integral over e is

    log p = log N(μ; m, Q⁻¹ + E) + ½ log |2π Q⁻¹|
            − ½ Σ_p [R_p log |2π V_p| + tr V_p⁻¹ (S_p + R_p (ō_p − μ)(ō_p − μ)ᵀ)],

plus R times the logarithm of the mean probability of success over λ_r. Of complete colonies that is the likelihood of
their mean times that of their scatter about it, which tells τ; a handful of small matrices, however many colonies there
are.

Where at λ_r the mean is linear in y and the covariance C constant, V = C + τ² J Jᵀ with J = ∂m/∂y, exactly. Where the
mean has squares of y, m is right, too, and so is what the variance of one y² adds to V, where up to three parameters
scatter. Where d of them do, it is taken (d − 1) / 2 times: twice for five.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float
from scipy.stats import chi2

from yeastfit.inference.neural_likelihood.coordinates import Coordinates, Values
from yeastfit.inference.neural_likelihood.densities import ROWS
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.ensemble import Ensemble
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.prior import coordinates_of, values_of
from yeastfit.inference.prior.variation import NAME, ColonyCoordinates, Variation

WIDE = 2.0  # times the prior's width, from where τ is warned of
MUCH, CHANCE = 1.5, 1e-3  # times the expected χ², and probability of it, from where a scatter is told of

Square = Float[np.ndarray, "statistic statistic"]


class Patterns(eqx.Module):
    """Colonies by the statistics that they have, in units of the scatter of each statistic; 0 where one is missing.

    Attributes:
        seen: 1 where there is a statistic.
        count: R_p.
        mean: ō_p.
        squares: S_p.
    """

    seen: Float[Array, "pattern statistic"]
    count: Float[Array, " pattern"]
    mean: Float[Array, "pattern statistic"]
    squares: Float[Array, "pattern statistic statistic"]

    @staticmethod
    def of(rows: Float[np.ndarray, "colony statistic"]) -> "Patterns":
        """Of colonies with nan where a statistic is missing."""
        known = np.isfinite(rows)
        seen = np.unique(known, axis=0)
        groups = [np.where(one, rows[(known == one).all(axis=1)], 0.0) for one in seen]
        means = np.stack([one.mean(axis=0) for one in groups])
        squares = np.stack([(one - mean).T @ (one - mean) for one, mean in zip(groups, means, strict=True)])
        counts = np.array([len(one) for one in groups])
        return Patterns(*(jnp.asarray(one, dtype=float) for one in (seen, counts, means, squares)))


class Errors(eqx.Module):
    """What is added to the emulator's moments, in the same units.

    Attributes:
        root: L, by which the emulator's statistics are multiplied.
        common: N.
        single: M.
    """

    root: Float[Array, "statistic statistic"]
    common: Float[Array, "statistic statistic"]
    single: Float[Array, "statistic statistic"]


def log_likelihood_of_patterns(
    mean: Float[Array, " statistic"],
    spread: Float[Array, "statistic statistic"],
    error: Float[Array, "statistic statistic"],
    data: Patterns,
) -> Float[Array, ""]:
    """log p of the colonies, all of which succeeded, given m, V + M and E."""

    def inverse(seen: Array) -> tuple[Array, Array]:
        """V_p⁻¹ and log |2π V_p|."""
        both = seen[:, None] * seen
        root = jnp.linalg.cholesky(both * spread + jnp.diag(1.0 - seen))
        precision = jax.scipy.linalg.cho_solve((root, True), jnp.eye(len(seen)))
        return both * precision, 2.0 * jnp.sum(jnp.log(jnp.diag(root))) + seen.sum() * jnp.log(2 * jnp.pi)

    precisions, volumes = jax.vmap(inverse)(data.seen)
    whole = jnp.einsum("p,pij->ij", data.count, precisions)
    root = jnp.linalg.cholesky(whole)
    covariance = jax.scipy.linalg.cho_solve((root, True), jnp.eye(len(mean)))
    middle = covariance @ jnp.einsum("p,pij,pj->i", data.count, precisions, data.mean)
    off = data.seen * (data.mean - middle)
    squares = data.squares + data.count[:, None, None] * off[:, :, None] * off[:, None, :]
    scatter = jnp.sum(data.count * volumes) + jnp.einsum("pij,pij->", precisions, squares)
    freed = 0.5 * len(mean) * jnp.log(2 * jnp.pi) - jnp.sum(jnp.log(jnp.diag(root)))
    return _log_normal(middle - mean, 0.5 * (covariance + covariance.T) + error) + freed - 0.5 * scatter


def _log_normal(off: Float[Array, " statistic"], covariance: Float[Array, "statistic statistic"]) -> Array:
    root = jnp.linalg.cholesky(covariance)
    scaled = jax.scipy.linalg.solve_triangular(root, off, lower=True)
    return -0.5 * jnp.sum(scaled**2 + jnp.log(2 * jnp.pi)) - jnp.sum(jnp.log(jnp.diag(root)))


class LikelihoodOfColonies(eqx.Module):
    """Log density of single colonies, none of which failed, for programs that sample.

    Attributes:
        ensemble: The networks.
        coordinates: That they see.
        errors: What is added to their moments.
        data: The colonies.
        bounds: y of λ.
        variation: That λ scatters between colonies.
        volume: log of the units of all statistics that there are, which is taken off.
    """

    ensemble: Ensemble
    coordinates: Coordinates
    errors: Errors
    data: Patterns
    bounds: ColonyCoordinates
    variation: Variation = eqx.field(static=True)
    volume: Float[np.ndarray | Array, ""]

    def __call__(self, rows: Float[Array, "row coordinate"]) -> Float[Array, " row"]:
        """Of rows of the prior's coordinates and z, of which τ is a function."""
        x, tau = rows[:, :-1], _tau(self.variation, rows[:, -1])
        logarithmic = self.coordinates.prior.logarithmic
        around, precision = self.bounds.around(values_of(x, logarithmic), tau), self.data.mean.dtype
        seen = self.coordinates.of_prior(coordinates_of(around.values, logarithmic))
        shares = jnp.asarray(around.shares, precision)
        each = jax.lax.map(lambda one: self._of_places(one, shares), seen.astype(precision), batch_size=ROWS)
        return each - self.volume

    def _of_places(self, places: Float[Array, "place free"], shares: Float[Array, " place"]) -> Float[Array, ""]:
        """In the networks' precision, of places around one λ."""
        errors, data = self.errors, self.data
        mean, scatter, error, success = self.ensemble.moments_around(places, shares)
        spread = errors.root @ scatter @ errors.root.T + errors.single
        error = errors.root @ error @ errors.root.T + errors.common
        found = log_likelihood_of_patterns(errors.root @ mean, spread, error, data) + data.count.sum() * success
        return jnp.where(jnp.isfinite(found), found, -jnp.inf)  # so wide a scatter has no root in single precision


def _tau(variation: Variation, z: Float[Array, " row"]) -> Float[Array, " row"]:
    """`Variation.tau`."""
    above = jnp.minimum(ndtr(-z) / (1.0 - variation.zero), 1.0)
    return jnp.maximum(-variation.sd * ndtri(0.5 * above), 0.0)


def likelihood_of_colonies(emulator: Emulator, problem: Problem) -> LikelihoodOfColonies:
    """That of a problem's single colonies, which scatter."""
    assert problem.colonies is not None
    assert problem.variation is not None
    scale = np.linalg.norm(emulator.root, axis=1)
    data = Patterns.of((problem.colonies - emulator.center) / scale)
    units, zero = np.outer(scale, scale), np.zeros((len(scale), len(scale)))
    common, single = (zero if one is None else one / units for one in (problem.noise, problem.colony_noise))
    errors = Errors(*(jnp.asarray(one) for one in (emulator.root / scale[:, None], common, single)))
    volume = np.asarray(np.isfinite(problem.colonies).sum(axis=0) @ np.log(scale))
    return LikelihoodOfColonies(
        emulator.ensemble, emulator.coordinates, errors, data, problem.colony_coordinates, problem.variation, volume
    )


def excess_scatter(emulator: Emulator, problem: Problem, values: Values) -> list[str]:
    """Say so where single colonies scatter more than the emulator's do at one λ, given as a row.

    Σ_r (o_r − ō)ᵀ (C + M)⁻¹ (o_r − ō) of R complete colonies is χ² with (R − 1) n degrees of freedom for n statistics.
    """
    rows = np.zeros((0, 0)) if problem.colonies is None else problem.colonies
    rows = rows[np.isfinite(rows).all(axis=1)]
    freedom = (len(rows) - 1) * rows.shape[1]
    if freedom < 1:
        return []
    scatter = emulator.moments(values)[1][0] + (0.0 if problem.colony_noise is None else problem.colony_noise)
    off = rows - rows.mean(axis=0)
    square = float(np.einsum("ri,ir->", off, np.linalg.solve(scatter, off.T)))
    if square < MUCH * freedom or chi2.sf(square, freedom) > CHANCE:
        return []
    return [
        f"the {len(rows)} replicates scatter {np.sqrt(square / freedom):.2g} times as much as simulations of one "
        "parameter set: their parameters may differ, which a posterior with variation allows for; without it "
        "intervals may be too narrow"
    ]


def wide_scatter(variation: Variation, tau: float) -> list[str]:
    """Say so where τ is much wider than its prior has it."""
    if tau < WIDE * variation.sd:
        return []
    return [
        f"{NAME} is {tau:.2g}, its prior has a width of {variation.sd:g}: no one set of parameters may explain the "
        "data; compare the colonies simulated from the posterior with the data"
    ]
