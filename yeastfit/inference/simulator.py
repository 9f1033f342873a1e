"""What every sampler asks for: statistics of simulated data, one data set per row of parameters.

Anything with these two names and this call is one; nothing has to inherit from it. Chains, populations and emulators
call it with batches of one size, so that a compiled simulator is compiled once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from yeastfit.errors import InputError

BITS = 32  # of a run's seed and of every simulation's


@runtime_checkable
class Simulator(Protocol):
    """λ of the free parameters, not their logarithms, and a seed each → statistics of one simulated data set each."""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the columns."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the statistics, one per column of the result."""

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        """A row of nan where a simulation came to nothing. Same row and seed, same result, whatever the batch."""


@dataclass(frozen=True)
class Wrapper:
    """A simulator around another one, of the same λ and statistics."""

    simulator: Simulator

    @property
    def free(self) -> tuple[str, ...]:
        """Names of λ."""
        return self.simulator.free

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the statistics."""
        return self.simulator.labels


@dataclass(frozen=True)
class Mismeasured(Wrapper):
    """A simulator whose statistics have errors of measurement, of the covariance root rootᵀ.

    ABC with ever smaller ε then comes to the posterior under these errors (Wilkinson 2013,
    doi:10.1515/sagmb-2013-0010).
    """

    root: Float[np.ndarray, "statistic statistic"]

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        """Errors depend on a row's seed alone."""
        streams = [np.random.default_rng(stream_of(int(seed), 5, 0)) for seed in seeds]
        normal = np.array([stream.standard_normal(len(self.root)) for stream in streams])
        return self.simulator(values, seeds) + normal.reshape(len(seeds), -1) @ self.root.T


def root_of(covariance: Float[np.ndarray, "statistic statistic"]) -> Float[np.ndarray, "statistic statistic"]:
    """A matrix A with A Aᵀ the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def seed_of(seed: int, numbers: Sequence[int] | np.ndarray) -> Int[np.ndarray, " number"]:
    """Seeds, 0 ≤ seed < 2³², of the simulations of these numbers in a run.

    Row by row the first word of `np.random.SeedSequence(seed, spawn_key=(number,))`: it depends on the run's seed and
    on the number alone, so a run that is taken up again draws what it would have drawn. Two of n numbers share a seed
    with probability n² / 2³³, which does no harm: their parameters differ.
    """
    _check_seed(seed)
    words = [np.random.SeedSequence(seed, spawn_key=(int(n),)).generate_state(1)[0] for n in np.ravel(numbers)]
    return np.array(words, dtype=np.int64)


def stream_of(seed: int, *key: int) -> np.random.SeedSequence:
    """Where a run's other random numbers come from, such as proposals; two or more numbers say which they are."""
    if len(key) < 2:
        raise InputError(f"key is {key}, it needs at least two numbers: those of one are simulations'")
    _check_seed(seed)
    return np.random.SeedSequence(seed, spawn_key=key)


def _check_seed(seed: int) -> None:
    if not 0 <= seed < 2**BITS:
        raise InputError(f"seed is {seed}, it must be at least 0 and below 2^{BITS}")
