"""Populations of ABC-SMC and the file that they are taken up from."""

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from yeastfit.errors import InputError
from yeastfit.storage import as_json, from_json, written_whole

NEAREST = 10  # draws for each parameter, at least, that proposals are made from


@dataclass(frozen=True)
class Population:
    """Weighted draws within ε.

    x: in the prior's coordinates, log_prior: density in them. acceptance: share of the proposals within ε. simulated:
    data sets for it and all before it.
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
    """Proposals Σ_j w_j N(x_j, C_j) around draws x_j that are near the data, C_j = Σ_k w_k (x_k − x_j)(x_k − x_j)ᵀ.

    That is C + (x_j − m)(x_j − m)ᵀ with their mean m and covariance C. roots: Cholesky factors of C_j.
    """

    x: Float[np.ndarray, "near free"]
    weights: Float[np.ndarray, " near"]
    roots: Float[np.ndarray, "near free free"]

    @staticmethod
    def of(population: Population, epsilon: float) -> "Mixture":
        """Around the draws within ε, at least `NEAREST` of them for each parameter.

        Raises `InputError` where they do not span the space.
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
        """Up to a constant."""
        found = np.empty((len(x), len(self.x)))
        for j, (centre, inverse) in enumerate(zip(self.x, np.linalg.inv(self.roots), strict=True)):
            found[:, j] = -0.5 * np.sum(((x - centre) @ inverse.T) ** 2, axis=1)
        volumes = np.diagonal(self.roots, axis1=1, axis2=2).prod(axis=1)
        return logsumexp(found, b=self.weights / volumes, axis=1)


class PopulationFile:
    """Populations in one .npz file, written whole; head: what they are of, plain data, which must be the same.

    Raises `InputError` for a file that is none of these.
    """

    def __init__(self, path: str | Path, head: Mapping[str, Any]) -> None:
        self.path, self.head = Path(path), from_json(as_json(head))

    def read(self) -> list[Population]:
        """None where there is no file."""
        if not self.path.exists():
            return []
        try:
            with self.path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                head, count = from_json(str(file["head"])), int(file["count"])
                found = [_population({name: file[f"{name}_{k}"] for name in FIELDS}) for k in range(count)]
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(
                f"{self.path}: no populations can be read, remove it and they are made anew from stored simulations: "
                f"{error}"
            ) from error
        different = [key for key in self.head if head.get(key) != self.head[key]]
        if different:
            said = "; ".join(f"{key} was {head.get(key)}, now it is {self.head[key]}" for key in different)
            raise InputError(
                f"{self.path} holds other populations: {said}; remove it and they are made anew from stored simulations"
            )
        return found

    def write(self, populations: Sequence[Population]) -> None:
        """All of them."""
        arrays = {f"{name}_{k}": value for k, one in enumerate(populations) for name, value in asdict(one).items()}
        with written_whole(self.path) as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, head=as_json(self.head), count=len(populations), **arrays)


FIELDS = tuple(Population.__dataclass_fields__)


def _population(data: Mapping[str, np.ndarray]) -> Population:
    """Of arrays, numbers among them."""
    plain: dict[str, Any] = {name: value if value.ndim else value.item() for name, value in data.items()}
    return Population(**plain)
