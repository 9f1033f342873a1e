"""The posterior's density by an emulator's likelihood, in the coordinates that chains walk in.

They are the prior's, log λ where its distribution is one of log λ, and z where colonies scatter by τ(z)
(`prior.variation`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from yeastfit.inference.neural_likelihood.densities import LogDensity, densities
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.single_colonies import likelihood_of_colonies
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.prior import Prior, Table

FARTHEST = 30.0  # |z|, of prior probability 10⁻¹⁹⁷, from where τ(z) is soon infinite in double precision
LOG_ROOT_2PI = np.log(np.sqrt(2.0 * np.pi))


class Ellipsoid(eqx.Module):
    """Where |(x − middle) whitening|² ≤ square, by NumPy or JAX."""

    middle: Float[np.ndarray | Array, " free"]
    whitening: Float[np.ndarray | Array, "free free"]
    square: Float[np.ndarray | Array, ""]

    @staticmethod
    def everywhere(size: int) -> "Ellipsoid":
        """One that holds all rows of so many coordinates."""
        return Ellipsoid(np.zeros(size), np.zeros((size, size)), np.zeros(()))

    def __call__(self, x: Float[Table, "row free"]) -> Bool[Table, " row"]:
        """Which rows lie there."""
        return (((x - self.middle) @ self.whitening) ** 2).sum(axis=1) <= self.square


@dataclass(frozen=True)
class LogPosterior:
    """Log posterior density in the prior's coordinates, and in z, up to a constant.

    Attributes:
        emulator: Of the likelihood.
        problem: Data and prior.
        known: Which places the emulator knows, in the prior's coordinates; all by default.
        power: To which the likelihood is raised; below 1 it is flatter.
    """

    emulator: Emulator
    problem: Problem
    known: Ellipsoid | None = None
    power: float = 1.0

    def __call__(self, x: Float[np.ndarray, "row coordinate"]) -> Float[np.ndarray, " row"]:
        """−inf outside the prior, and where the emulator knows nothing."""
        return densities(self.program, x)

    @cached_property
    def program(self) -> "Program":
        """The same, for programs that sample."""
        problem = self.problem
        if problem.variation is None:
            likelihood: LogDensity = self.emulator.likelihood(problem.observed, problem.replicates, problem.noise)
        else:
            likelihood = likelihood_of_colonies(self.emulator, problem)
        known = self.known or Ellipsoid.everywhere(len(problem.prior.free))
        return Program(problem.prior, likelihood, known, np.asarray(self.power))

    def parts(
        self, x: Float[np.ndarray, "row coordinate"]
    ) -> tuple[Float[np.ndarray, "row free"], Float[np.ndarray, "row varied"]]:
        """The prior's coordinates, and z in a column of its own where colonies scatter."""
        free = len(self.problem.prior.free)
        return x[:, :free], x[:, free:]

    def log_prior(
        self, x: Float[np.ndarray, "row free"], z: Float[np.ndarray, "row varied"]
    ) -> Float[np.ndarray, " row"]:
        """Of λ in the prior's coordinates, and of z."""
        return self.problem.prior.log_density_of_coordinates(x) - (z**2 / 2.0 + LOG_ROOT_2PI).sum(axis=1)


class Program(eqx.Module):
    """A log posterior density as a program.

    Attributes:
        prior: Of λ.
        likelihood: Its logarithm, of rows of all coordinates.
        known: Where it is known.
        power: Of it.
    """

    prior: Prior = eqx.field(static=True)
    likelihood: LogDensity
    known: Ellipsoid
    power: Float[np.ndarray | Array, ""]

    def __call__(self, rows: Float[Array, "row coordinate"]) -> Float[Array, " row"]:
        """Of rows; −inf, too, where networks in single precision have no density."""
        distributions = self.prior.distributions.values()
        free = len(distributions)
        x, z = rows[:, :free], rows[:, free:]
        columns = (_log_density(one.density, x[:, k]) for k, one in enumerate(distributions))
        log_prior = sum(columns) - (z**2 / 2.0 + LOG_ROOT_2PI).sum(axis=1)
        inside = jnp.isfinite(log_prior) & (jnp.abs(z) < FARTHEST).all(axis=1) & self.known(x)
        somewhere = np.array([*(one.median for one in distributions), *np.zeros(z.shape[1])])
        found = log_prior + self.power * self.likelihood(jnp.where(inside[:, None], rows, somewhere))
        return jnp.where(inside & ~jnp.isnan(found), found, -jnp.inf)


def _log_density(density: Any, x: Float[Array, " row"]) -> Float[Array, " row"]:
    """log p(x) of a frozen distribution of scipy, by that of the same name and arguments in `jax.scipy.stats`."""
    return getattr(jax.scipy.stats, density.dist.name).logpdf(x, *density.args)
