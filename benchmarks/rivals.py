"""pyABC's ABC-SMC (Schälte et al. 2022, doi:10.21105/joss.04304) on a `Simulator`, with a sampler that is fair to it.

pyABC asks a model for one simulation at a time; our simulators run many at once in little more time. So pyABC's own
function draws a block of proposals, which are simulated together, and pyABC's own function judges them one by one, as
its single-core sampler would. The unused rest of the last block of a population is discarded and not counted.

Transitions, weights and stopping are pyABC's defaults. ε is the median of the previous distances, as in our ABC-SMC,
and not below the final value asked for. The first population accepts every simulation that did not fail. pyABC draws
from NumPy's global generator, which is seeded for the run and restored afterwards.
"""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyabc
from jaxtyping import Float
from pyabc.inference_util import evaluate_proposal, generate_valid_proposal

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import Distance
from yeastfit.inference.abc.population import Population
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.simulator import Simulator, seed_of

logging.getLogger("ABC").setLevel(logging.WARNING)  # its reports of every population would interfere with ours
EVERYTHING = float(np.finfo(float).max)  # an ε above all distances but infinite ones
FLAT = ("uniform", "log-uniform")
PROPOSING = ("t", "m", "p", "model_prior", "parameter_priors", "model_perturbation_kernel", "transitions")
JUDGING = ("t", "models", "summary_statistics", "distance_function", "eps", "acceptor", "x_0", "weight_function")


def pyabc_smc(
    simulator: Simulator,
    prior: Prior,
    distance: Distance,
    *,
    population: int,
    epsilon: float,
    most: int,
    block: int,
    seed: int,
) -> tuple[list[Population], list[float]]:
    """Populations down to ε, or until `most` simulations were used, and the seconds until each was finished.

    Raises `InputError` for a prior that is not flat in its coordinates.
    """
    Problem(simulator, prior, distance.observed)  # which checks that they belong together
    for name, one in prior.distributions.items():
        if one.family not in FLAT:
            raise InputError(f"prior of {name} is {one.family}, for pyABC it must be one of {', '.join(FLAT)}")
    ends = zip(prior.free, *prior.coordinates(prior.support.T), strict=True)
    flat = pyabc.Distribution(**{name: pyabc.RV("uniform", low, high - low) for name, low, high in ends})
    sampler = Blocks(simulator, prior, distance, most, block, seed)
    with global_numbers(seed):
        run = pyabc.ABCSMC(sampler.model, flat, _told, population, eps=Falling(epsilon), sampler=sampler)
        run.new("sqlite://", {"distance": 0.0}).stores_sum_stats = False
        run.run(minimum_epsilon=epsilon)
    return sampler.populations, sampler.seconds


class Handed(pyabc.Model):
    """Stands in for the model and returns the block's simulation of the proposal."""

    def __init__(self) -> None:
        super().__init__("simulator")
        self.result: dict[str, Any] = {}

    def sample(self, pars: pyabc.Parameter) -> dict[str, Any]:
        """The simulation of the proposal that is being judged."""
        return self.result


class Falling(pyabc.QuantileEpsilon):
    """Medians of the previous distances, but not below the last ε."""

    def __init__(self, last: float) -> None:
        super().__init__(initial_epsilon=EVERYTHING, alpha=0.5)
        self.last = last

    def __call__(self, t: int) -> float:
        """ε of population t."""
        return max(float(super().__call__(t)), self.last)


class Blocks(pyabc.sampler.Sampler):
    """The sampler described above. used: simulations judged; seconds: since the start, one per population."""

    def __init__(
        self, simulator: Simulator, prior: Prior, distance: Distance, most: int, block: int, seed: int
    ) -> None:
        super().__init__()
        self.simulator, self.prior, self.distance = simulator, prior, distance
        self.most, self.block, self.seed = most, block, seed
        self.model = Handed()
        self.simulated = self.used = 0
        self.populations, self.seconds = list[Population](), list[float]()
        self.began = time.perf_counter()

    def sample_until_n_accepted(
        self,
        n: int,
        simulate_one: Any,
        t: int,
        *,
        max_eval: float = np.inf,
        all_accepted: bool = False,
        ana_vars: Any = None,
    ) -> pyabc.Sample:
        """A population of n, as pyABC asks for it; not ok if the simulations do not suffice."""
        how, before = simulate_one.keywords, self.used
        judging = {name: how[name] for name in JUDGING} | {"proposal_id": 0}
        sample = self._create_empty_sample()
        while sample.n_accepted < n and self.used < self.most:
            for proposal, result in self._simulated({name: how[name] for name in PROPOSING}):
                self.model.result = result
                sample.append(evaluate_proposal(*proposal, **judging))
                self.used += 1
                if sample.n_accepted == n or self.used == self.most:
                    break
        self.nr_evaluations_ = self.used - before
        sample.ok = sample.n_accepted == n
        if sample.ok:
            self.populations.append(self._population(sample.accepted_particles, float(how["eps"](t))))
            self.seconds.append(time.perf_counter() - self.began)
        return sample

    def _simulated(self, proposing: dict[str, Any]) -> Iterator[tuple[Any, dict[str, Any]]]:
        """A block of pyABC's proposals, each with its distance and statistics."""
        proposals = [generate_valid_proposal(**proposing) for _ in range(self.block)]
        values = self.prior.values(self._coordinates([parameter for _, parameter in proposals]))
        seeds = seed_of(self.seed, range(self.simulated, self.simulated + self.block))
        statistics = self.simulator(values, seeds)
        self.simulated += self.block
        for proposal, distance, row in zip(proposals, self.distance(statistics).tolist(), statistics, strict=True):
            yield proposal, {"distance": distance, "statistics": row}

    def _population(self, particles: list[Any], epsilon: float) -> Population:
        x = self._coordinates([one.parameter for one in particles])
        weights = np.array([one.weight for one in particles], dtype=float)
        return Population(
            x,
            weights / weights.sum(),
            self.prior.log_density_of_coordinates(x),
            np.stack([one.sum_stat["statistics"] for one in particles]),
            np.array([one.distance for one in particles], dtype=float),
            epsilon,
            len(particles) / self.nr_evaluations_,
            self.used,
        )

    def _coordinates(self, parameters: list[Any]) -> Float[np.ndarray, "draw free"]:
        return np.array([[one[name] for name in self.prior.free] for one in parameters], dtype=float)


@contextmanager
def global_numbers(seed: int) -> Iterator[None]:
    """Seed NumPy's global generator, and restore it afterwards."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def _told(simulated: dict[str, Any], observed: dict[str, Any]) -> float:
    """The distance computed with the simulation, for a whole block at once."""
    return simulated["distance"]
