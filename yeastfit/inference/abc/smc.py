"""ABC-SMC: populations of weighted λ that close in on the data.

Toni et al. 2009, doi:10.1098/rsif.2008.0172; Beaumont et al. 2009, doi:10.1093/biomet/asp052. In the coordinates x of
the prior π (log λ where its law is one of log λ), with the indicator kernel:

    population 0:  x from the prior (scrambled Sobol'), the first N whose simulation came to something
    population t:  x* = x_j + z, j with probability w_j of those of population t − 1 with d_j ≤ ε_t, z ~ N(0, C_j);
                   simulated once; the first N with d ≤ ε_t, whose weights are w ∝ π(x*) / Σ_j w_j N(x*; x_j, C_j).

Of those with d_j ≤ ε_t there are at least `populations.NEAREST` for each parameter, further ones where need be.
C_j = Σ_k w_k (x_k − x_j)(x_k − x_j)ᵀ, over the same draws, are the local covariances of Filippi et al. 2013,
doi:10.1515/sagmb-2012-0069. To the same ε they take a quarter to a half fewer simulations than twice the covariance of
population t − 1 does, which is wider than where the next one will be.

ε_t is a quantile of the distances of population t − 1 by its weights, and below the largest of them in any case
(distances of counts repeat). It ends at a given ε, when ε falls too slowly or the share of accepted proposals too low,
or when the budget is spent; what was simulated of an unfinished population stays in the store and out of the result.

At the end the draws are moved to where they would be, had the simulation been the observation (`adjustment`).
"""

import time as clock
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import Distance
from yeastfit.inference.abc.pilot import check_problem, first_values, unreached
from yeastfit.inference.abc.population import Mixture, Population, PopulationFile
from yeastfit.inference.abc.regression_adjustment import Accepted
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.samples import Samples, weighted_quantile
from yeastfit.inference.posterior.simulation_store import Recorded, Store
from yeastfit.inference.simulator import Simulator, Stream, seed_of, stream_of
from yeastfit.progress import Progress, silent

PROMISE = 10  # accepted proposals, that the lowest acceptable share promises: with fewer, a population is given up
FEWEST = 25.0  # independent draws, that adjusted ones are to be worth: an error of the mean of a fifth of its sd


@dataclass(frozen=True)
class SmcSettings:
    """How populations are made.

    population: N. quantile: of the distances, that the next ε is. epsilon: the last ε, by default as far as it goes.
    populations, simulations: at most. acceptance: share of proposals, below which no further population is begun.
    gain: of ε, likewise, relative. batch: rows of every call of the simulator. adjust: whether the last population is
    adjusted by regression.
    """

    population: int = 500
    quantile: float = 0.5
    epsilon: float | None = None
    populations: int = 20
    simulations: int = 100_000
    acceptance: float = 0.01
    gain: float = 0.01
    batch: int = 64
    adjust: bool = True

    def __post_init__(self) -> None:
        for name, least in (("population", 2), ("populations", 1), ("simulations", 1), ("batch", 1)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least {least}")
        for name in ("quantile", "acceptance", "gain"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least 0 and below 1")
        if self.epsilon is not None and not self.epsilon >= 0:
            raise InputError(f"epsilon is {self.epsilon}, it must be at least 0")


def abc_smc(
    simulator: Simulator,
    prior: Prior,
    distance: Distance,
    settings: SmcSettings | None = None,
    *,
    seed: int = 0,
    path: str | Path | None = None,
    store: Store | None = None,
    progress: Progress | None = None,
) -> Samples:
    """A weighted sample of λ, one chain of N draws.

    path: file of the populations; where it exists, they are taken up and go on to the same bits as if nothing had
    happened. store: of simulations, from which an unfinished population is taken up. `log_probability` of the result is
    log π in the prior's coordinates, before adjustment; `acceptance` that of each population, `diagnostics` their ε and
    why it ended. Raises `InputError`, also where no simulation comes to anything.
    """
    began = clock.perf_counter()
    settings = settings or SmcSettings()
    check_problem(simulator, prior, distance)
    say = progress or silent
    recorded = Recorded(simulator, settings.batch, store)
    problem = _Problem(recorded, prior, distance, settings, seed)
    file = None if path is None else PopulationFile(path, problem.head())
    earlier = [] if file is None else file.read()
    populations = list[Population]()
    while True:
        end, epsilon = _next(populations, settings)
        if end:
            break
        say(f"population {len(populations)}", len(populations) / settings.populations)
        held = earlier[len(populations) :][:1]
        if held and held[0].simulated <= settings.simulations:
            recorded.asked = held[0].simulated
            populations += held
            continue
        end, found = problem.population(populations, epsilon)
        if found is None:
            break
        populations.append(found)
        if file is not None:
            file.write(populations)
    return problem.samples(populations, end, clock.perf_counter() - began)


def _vague(name: str, size: float) -> str:
    return (
        f"{name}: once adjusted, all draws are worth {size:.0f} independent ones, its mean is known to "
        f"{size**-0.5:.2f} of its standard deviation: allow more simulations, or take a larger population"
    )


def _next(populations: list[Population], settings: SmcSettings) -> tuple[str, float]:
    """Why no further population is to be made, or nothing, and ε of the next one."""
    if not populations:
        return "", np.inf
    last, target = populations[-1], 0.0 if settings.epsilon is None else settings.epsilon
    if last.epsilon <= target:
        return f"epsilon {target:g} was reached", last.epsilon
    if len(populations) >= settings.populations:
        return f"all {settings.populations} populations were made", last.epsilon
    if last.acceptance < settings.acceptance:
        return f"the share of accepted proposals fell to {last.acceptance:.2g}", last.epsilon
    epsilon = weighted_quantile(last.distances, last.weights, settings.quantile)
    if epsilon >= last.distances.max():
        epsilon = float(np.max(last.distances, where=last.distances < epsilon, initial=-1.0))
    epsilon = max(epsilon, target) if epsilon >= 0 else epsilon
    if epsilon < 0 or (np.isfinite(last.epsilon) and last.epsilon - epsilon < settings.gain * last.epsilon):
        return f"epsilon falls no further than {last.epsilon:.4g}", last.epsilon
    return "", epsilon


@dataclass(frozen=True)
class _Problem:
    """What populations are made of."""

    recorded: Recorded
    prior: Prior
    distance: Distance
    settings: SmcSettings
    seed: int

    def head(self) -> dict[str, Any]:
        """What makes populations what they are, however many there get to be."""
        named = ("population", "quantile", "epsilon", "acceptance", "batch")
        settings = {name: getattr(self.settings, name) for name in named}
        data = {"prior": self.prior.asdict(), **self.distance.asdict(), "labels": list(self.recorded.labels)}
        data["proposals"] = "local"
        return {**data, **settings, "seed": self.seed, "about": self.recorded.about}

    def population(self, populations: list[Population], epsilon: float) -> tuple[str, Population | None]:
        """The next one, or why there is none."""
        settings, before = self.settings, self.recorded.asked
        mixture = Mixture.of(populations[-1], epsilon) if populations else None
        rng = np.random.default_rng(stream_of(self.seed, Stream.DRAWS, len(populations)))
        parts: list[tuple[np.ndarray, ...]] = []
        accepted = 0
        while accepted < settings.population:
            proposed = self.recorded.asked - before
            if self.recorded.asked + settings.batch > settings.simulations:
                return f"the budget of {settings.simulations} simulations allows for no further population", None
            if proposed * settings.acceptance >= PROMISE > accepted and mixture is not None:
                return f"{accepted} of {proposed} proposals came within epsilon {epsilon:.4g}", None
            x = self._proposals(mixture, rng)
            numbers = np.arange(self.recorded.asked, self.recorded.asked + len(x))
            statistics = self.recorded(self.prior.values(x), seed_of(self.seed, numbers))
            distances = self.distance(statistics)
            near = np.flatnonzero(np.isfinite(distances) & (distances <= epsilon))
            parts.append((x[near], statistics[near], distances[near]))
            accepted += len(near)
        x, statistics, distances = (np.concatenate(one)[: settings.population] for one in zip(*parts, strict=True))
        log_prior = self.prior.log_density_of_coordinates(x)
        log_weights = np.zeros(len(x)) if mixture is None else log_prior - mixture.log_density(x)
        weights = np.exp(log_weights - logsumexp(log_weights))
        share, asked = accepted / (self.recorded.asked - before), self.recorded.asked
        return "", Population(x, weights / weights.sum(), log_prior, statistics, distances, epsilon, share, asked)

    def samples(self, populations: list[Population], end: str, seconds: float) -> Samples:
        """Of the last population."""
        if not populations:
            raise InputError(
                f"population is {self.settings.population}, fewer of {self.recorded.asked} simulations from the prior "
                "came to anything that has a distance from the data (Li's has none where area is too far off): look at "
                "the simulator or the prior, or allow more simulations"
            )
        settings, last, first = self.settings, populations[-1], populations[0]
        said = unreached(first.statistics, self.distance.observed, self.recorded.labels)
        if settings.epsilon is not None and last.epsilon > settings.epsilon:
            said.append(f"epsilon {settings.epsilon:g} was not reached, it ended at {last.epsilon:.4g}: {end}")
        elif not np.isfinite(last.epsilon):
            said.append(f"the sample is one of the prior, nearer ones did not come: {end}")
        diagnostics: dict[str, Any] = {"epsilon": [one.epsilon for one in populations], "end": end}
        values, weights = self.prior.values(last.x), last.weights
        if settings.adjust:
            accepted = Accepted(values, weights, last.statistics, last.distances, self.distance.observed, self.prior)
            values, weights, why = accepted.adjusted()
            diagnostics["effective_size"] = sizes = accepted.worth().tolist()
            said += why or [_vague(*one) for one in zip(self.prior.free, sizes, strict=True) if one[1] < FEWEST]
        return Samples(
            free=self.prior.free,
            values=values[None],
            weights=weights[None],
            log_probability=last.log_prior[None],
            acceptance=np.array([one.acceptance for one in populations]),
            labels=self.recorded.labels,
            statistics=last.statistics[None],
            simulations=self.recorded.asked,
            seconds=seconds,
            seed=self.seed,
            method="ABC-SMC",
            settings={**asdict(settings), "prior": self.prior.asdict(), **self.distance.asdict()},
            warnings=[*self.recorded.notes, *said],
            diagnostics=diagnostics,
        )

    def _proposals(self, mixture: Mixture | None, rng: np.random.Generator) -> Float[np.ndarray, "proposal free"]:
        """A batch inside the prior's support; which the mixture's density leaves out by a constant factor."""
        if mixture is None:
            start, stop = self.recorded.asked, self.recorded.asked + self.settings.batch
            return self.prior.coordinates(first_values(self.prior, stop, self.seed)[start:])
        found = np.empty((0, len(self.prior.free)))
        while len(found) < self.settings.batch:
            x = mixture.draw(self.settings.batch, rng)
            found = np.concatenate([found, x[np.isfinite(self.prior.log_density_of_coordinates(x))]])
        return found[: self.settings.batch]
