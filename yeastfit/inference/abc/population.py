"""Populations of ABC-SMC, and the proposals that are made from them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from yeastfit.errors import InputError

NEAREST = 10  # draws per parameter, at least, that proposals are made from


@dataclass(frozen=True)
class Population:
    """Weighted draws within ε.

    Attributes:
        x: In the prior's coordinates.
        weights: Sum to 1.
        log_prior: Density in the prior's coordinates.
        statistics: Simulated.
        distances: From the data.
        epsilon: The tolerance ε.
        acceptance: Share of the proposals within ε.
        simulated: Data sets for this population and all before it.
    """

    x: Float[np.ndarray, "draw free"]
    weights: Float[np.ndarray, " draw"]
    log_prior: Float[np.ndarray, " draw"]
    statistics: Float[np.ndarray, "draw statistic"]
    distances: Float[np.ndarray, " draw"]
    epsilon: float
    acceptance: float
    simulated: int


@dataclass(frozen=True)
class Mixture:
    """Proposals Σ_j w_j N(x_j, C_j) around draws x_j near the data, C_j = Σ_k w_k (x_k − x_j)(x_k − x_j)ᵀ.

    C_j = C + (x_j − m)(x_j − m)ᵀ with their mean m and covariance C.

    Attributes:
        x: Draws.
        weights: Sum to 1.
        roots: Cholesky factors of C_j.
    """

    x: Float[np.ndarray, "near free"]
    weights: Float[np.ndarray, " near"]
    roots: Float[np.ndarray, "near free free"]

    @staticmethod
    def of(population: Population, epsilon: float) -> "Mixture":
        """Around the draws within ε, at least `NEAREST` of them per parameter.

        Raises:
            InputError: They do not span the space.
        """
        free = population.x.shape[1]
        count = max(int(np.sum(population.distances <= epsilon)), NEAREST * free)
        near = np.argsort(population.distances, kind="stable")[:count]
        x, weights = population.x[near], population.weights[near] / population.weights[near].sum()
        off = x - weights @ x
        covariance = off.T @ (weights[:, None] * off)
        if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise InputError(f"population is {len(population.x)}, its draws have no covariance: take a larger one")
        return Mixture(x, weights, np.linalg.cholesky(covariance + off[:, :, None] * off[:, None, :]))

    def draw(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "proposal free"]:
        """Independent proposals."""
        chosen = rng.choice(len(self.x), size=count, p=self.weights)
        steps = rng.standard_normal((count, self.x.shape[1]))
        return self.x[chosen] + np.einsum("pab,pb->pa", self.roots[chosen], steps)

    def log_density(self, x: Float[np.ndarray, "proposal free"]) -> Float[np.ndarray, " proposal"]:
        """Log density up to a constant."""
        exponents = np.empty((len(x), len(self.x)))
        for j, (centre, inverse) in enumerate(zip(self.x, np.linalg.inv(self.roots), strict=True)):
            exponents[:, j] = -0.5 * np.sum(((x - centre) @ inverse.T) ** 2, axis=1)
        volumes = np.diagonal(self.roots, axis1=1, axis2=2).prod(axis=1)
        return logsumexp(exponents, b=self.weights / volumes, axis=1)
