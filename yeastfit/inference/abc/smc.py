"""ABC-SMC: populations of weighted λ that close in on the data.

Toni et al. 2009, doi:10.1098/rsif.2008.0172; Beaumont et al. 2009, doi:10.1093/biomet/asp052. In the coordinates x of
the prior π (log λ where its distribution is one of log λ), with the indicator kernel:

    population 0:  x from the prior (scrambled Sobol'), the first N whose simulation succeeded
    population t:  x* = x_j + z, j with probability w_j among those of population t − 1 with d_j ≤ ε_t, z ~ N(0, C_j);
                   simulated once; the first N with d ≤ ε_t, with weights w ∝ π(x*) / Σ_j w_j N(x*; x_j, C_j).

At least `population.NEAREST` draws per parameter are proposed from, beyond ε_t where need be.
C_j = Σ_k w_k (x_k − x_j)(x_k − x_j)ᵀ, over the same draws, are the local covariances of Filippi et al. 2013,
doi:10.1515/sagmb-2012-0069. To reach the same ε they take a quarter to a half fewer simulations than twice the
covariance of population t − 1, which is wider than the next population.

ε_t is a quantile of the weighted distances of population t − 1, and below the largest of them in any case (distances of
counts repeat). The run ends at a given ε, when ε falls too slowly or the share of accepted proposals too low, or when
the budget is spent; an unfinished population stays in the store and out of the result.

At the end regression moves the draws to where they would be, had the simulation been the observation
(`regression_adjustment`). A run that is repeated with the same store repeats its populations bit by bit.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import Distance
from yeastfit.inference.abc.pilot import DISTANCES, DistanceName, check_pilot, distance_of, is_estimated
from yeastfit.inference.abc.population import Mixture, Population
from yeastfit.inference.abc.regression_adjustment import Accepted
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.draws import weighted_quantile
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.settings import Setting, check_at_least, check_choice
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.simulator import Simulator, seed_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulations import Simulations
from yeastfit.progress import Progress
from yeastfit.seeds import Stream, stream_of

PILOT = 500  # simulations that scale a distance
PROMISE = 10  # accepted proposals that the lowest acceptable share promises: with fewer, a population is given up
FEWEST = 25.0  # independent draws that the result must be worth: an error of the mean of a fifth of its sd


@dataclass(frozen=True)
class SmcDiagnostics(Diagnostics):
    """What a run of ABC-SMC reports.

    Attributes:
        tolerances: ε of each population.
        acceptance: Share of accepted proposals of each population.
        simulations: Data sets simulated for each population and all before it.
        end: Why the run ended.
        distance: From the data.
    """

    caption = "Each population keeps simulations within its tolerance of the data and is proposed from the one before."

    tolerances: tuple[float, ...]
    acceptance: tuple[float, ...]
    simulations: tuple[int, ...]
    end: str
    distance: Distance

    def facts(self) -> list[tuple[str, str]]:
        """Why the run ended, and the distance."""
        return [("ended", self.end), ("distance", type(self.distance).__name__)]

    def rows(self) -> list[dict[str, Any]]:
        """One row per population."""
        each = zip(self.tolerances, self.acceptance, self.simulations, strict=True)
        return [
            {"population": k, "tolerance": tolerance, "accepted_%": 100 * share, "simulations": count}
            for k, (tolerance, share, count) in enumerate(each)
        ]


@dataclass(frozen=True)
class AbcSmc:
    """ABC-SMC (module `abc.smc`): populations of weighted draws that close in on the data.

    Attributes:
        population: N, draws of a population.
        simulations: Data sets at most.
        distance: From the data, a name or an object.
        tolerance: The last ε; by default as far as it falls.
        quantile: Of the distances, that the next ε is.
        populations: At most.
        acceptance: Share of accepted proposals below which no further population is begun.
        gain: Relative decrease of ε below which no further population is begun.
        pilot: Simulations from the prior that a distance is estimated from, where it is; by default `PILOT`.
        replicates: Replicates that a simulated data set is the mean of.
        batch: Data sets that are proposed together.
        adjust: Whether the last population is adjusted by regression.
    """

    population: Annotated[int, Setting("Draws of a population.")] = 500
    simulations: Annotated[
        int, Setting("Simulated data sets at most, those of a resumed run included.", extends=True)
    ] = 20_000
    distance: Annotated[DistanceName | Distance, Setting("How simulated data are compared with the data.")] = (
        "mahalanobis"
    )
    tolerance: Annotated[float | None, Setting("Largest distance that is accepted in the end.")] = None
    quantile: Annotated[float, Setting("The next tolerance, as a quantile of the distances.")] = 0.5
    populations: Annotated[int, Setting("Populations at most.")] = 20
    acceptance: Annotated[float, Setting("Share of accepted proposals below which sampling ends.")] = 0.01
    gain: Annotated[float, Setting("Relative decrease of the tolerance below which sampling ends.")] = 0.01
    pilot: Annotated[
        int | None, Setting(f"Simulations from the prior that the distance is estimated from; {PILOT}.")
    ] = None
    replicates: Annotated[
        int,
        Setting("Simulations whose mean is compared with the data; more narrow the posterior.", aliases=("colonies",)),
    ] = 1
    batch: Annotated[int, Setting("Data sets that are proposed and simulated together.")] = 32
    adjust: Annotated[bool, Setting("Whether draws are adjusted by regression at the end.")] = True

    def __post_init__(self) -> None:
        check_at_least(self, population=2, populations=1, simulations=1, batch=1, pilot=2, replicates=1)
        if self.simulations < (first := -(-self.population // self.batch) * self.batch):
            what = f"{first}, a population of {self.population} in batches of {self.batch}"
            raise InputError(f"simulations is {self.simulations}, it must be at least {what}")
        for name in ("quantile", "acceptance", "gain"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least 0 and below 1")
        if self.tolerance is not None and not self.tolerance >= 0:
            raise InputError(f"tolerance is {self.tolerance}, it must be at least 0")
        if isinstance(self.distance, str):
            check_choice(self, "distance", DISTANCES)
        if self.pilot is not None and not is_estimated(self.distance):
            raise InputError(
                f"pilot is {self.pilot}, and this distance is not estimated from simulations: leave it out"
            )

    @property
    def simulations_at_most(self) -> int:
        """Single simulations of a run, at most."""
        return self.made(self.simulations)

    def made(self, asked: int) -> int:
        """Single simulations for so many data sets of the populations, with those of the pilot."""
        return self.replicates * (is_estimated(self.distance) * self._pilot + asked)

    @property
    def _pilot(self) -> int:
        """Simulations of a pilot."""
        return PILOT if self.pilot is None else self.pilot

    def check(self, free: int, inferred: int, statistics: int) -> None:
        """See `Sampler`."""
        if self.population <= free:
            few = f"it must be larger than the number of free parameters, {free}"
            raise InputError(f"population is {self.population}, {few}")
        check_pilot(self.distance, self._pilot, free, statistics)

    def run(self, problem: Problem, store: Simulations, seed: int, progress: Progress) -> Posterior:
        """Sample the posterior of a problem; see `Sampler`.

        The result is one chain of N weighted draws, `log_probability` log π in the prior's coordinates before the
        adjustment, `acceptance` that of each population.

        Raises:
            InputError: The settings do not suit the problem, or no simulation succeeds.
        """
        self.check(len(problem.prior.free), len(problem.inferred_prior.free), len(problem.labels))
        data_sets = problem.data_sets(CachedSimulator(problem.simulator, self.batch, store), self.replicates)
        distance = self.distance
        if isinstance(distance, str):
            progress("pilot", 0.0)
            distance = distance_of(distance, problem, data_sets, self._pilot, seed)
        sequence = _Sequence(data_sets, problem, distance, self, seed)
        populations = list[Population]()
        while True:
            end, tolerance = self._next(populations)
            if end:
                break
            progress(f"population {len(populations)}", len(populations) / self.populations)
            end, population = sequence.population(populations, tolerance)
            if population is None:
                break
            populations.append(population)
        return sequence.posterior(populations, end, store.notes)

    def _next(self, populations: list[Population]) -> tuple[str, float]:
        """Why there is no further population, or an empty string, and ε of the next one."""
        if not populations:
            return "", np.inf
        last, target = populations[-1], 0.0 if self.tolerance is None else self.tolerance
        if last.epsilon <= target:
            return f"tolerance {target:g} was reached", last.epsilon
        if len(populations) >= self.populations:
            return f"all {self.populations} populations were made", last.epsilon
        if last.acceptance < self.acceptance:
            return f"the share of accepted proposals fell to {last.acceptance:.2g}", last.epsilon
        epsilon = weighted_quantile(last.distances, last.weights, self.quantile)
        if epsilon >= last.distances.max():
            epsilon = float(np.max(last.distances, where=last.distances < epsilon, initial=-1.0))
        epsilon = max(epsilon, target) if epsilon >= 0 else epsilon
        if epsilon < 0 or (np.isfinite(last.epsilon) and last.epsilon - epsilon < self.gain * last.epsilon):
            return f"the tolerance falls no further than {last.epsilon:.4g}", last.epsilon
        return "", epsilon


@dataclass
class _Sequence:
    """Populations under way.

    Attributes:
        asked: Data sets so far; they are numbered, and each has the seed of its number.
    """

    data_sets: Simulator
    problem: Problem
    distance: Distance
    settings: AbcSmc
    seed: int
    asked: int = 0

    def population(self, populations: list[Population], epsilon: float) -> tuple[str, Population | None]:
        """The next one, or why there is none."""
        settings, before = self.settings, self.asked
        mixture = Mixture.of(populations[-1], epsilon) if populations else None
        rng = np.random.default_rng(stream_of(self.seed, Stream.DRAWS, len(populations)))
        parts: list[tuple[np.ndarray, ...]] = []
        accepted = 0
        while accepted < settings.population:
            proposed = self.asked - before
            if self.asked + settings.batch > settings.simulations:
                return f"the budget of {settings.simulations} simulations allows for no further population", None
            if proposed * settings.acceptance >= PROMISE > accepted and mixture is not None:
                return f"{accepted} of {proposed} proposals came within the tolerance {epsilon:.4g}", None
            x = self._proposals(mixture, rng)
            seeds = seed_of(self.seed, np.arange(self.asked, self.asked + len(x)))
            statistics = self.data_sets(self.problem.prior.values(x), seeds)
            self.asked += len(x)
            distances = self.distance(statistics)
            near = np.flatnonzero(np.isfinite(distances) & (distances <= epsilon))
            parts.append((x[near], statistics[near], distances[near]))
            accepted += len(near)
        x, statistics, distances = (np.concatenate(one)[: settings.population] for one in zip(*parts, strict=True))
        log_prior = self.problem.prior.log_density_of_coordinates(x)
        log_weights = np.zeros(len(x)) if mixture is None else log_prior - mixture.log_density(x)
        weights = np.exp(log_weights - logsumexp(log_weights))
        share = accepted / (self.asked - before)
        return "", Population(x, weights / weights.sum(), log_prior, statistics, distances, epsilon, share, self.asked)

    def posterior(self, populations: list[Population], end: str, notes: list[str]) -> Posterior:
        """The last population, adjusted."""
        if not populations:
            raise InputError(
                f"population is {self.settings.population}, fewer of {self.asked} simulations from the prior "
                "have a distance from the data (Li's has none where area is too far off): look at "
                "the simulator or the prior, or allow more simulations"
            )
        last, prior = populations[-1], self.problem.prior
        status, warnings = self._judged(populations, end)
        values, weights, why, worth = prior.values(last.x), last.weights, list[str](), None
        sizes = np.full(len(prior.free), 1 / np.sum(weights**2))
        if self.settings.adjust:
            accepted = Accepted(values, weights, last.statistics, last.distances, self.problem.observed, prior)
            values, weights, why = accepted.adjusted()
            sizes = worth = accepted.worth()
            warnings += why or [_vague(*one) for one in zip(prior.free, sizes.tolist(), strict=True) if one[1] < FEWEST]
        if status is Status.SETTLED and (why or (sizes < FEWEST).any()):
            status = Status.TOO_FEW_DRAWS
        return Posterior.of(
            self.problem,
            values[None],
            weights=weights[None],
            log_probability=last.log_prior[None],
            acceptance=np.array([one.acceptance for one in populations]),
            statistics=last.statistics[None],
            worth=worth,
            simulations=self.settings.made(self.asked),
            warnings=[*notes, *warnings],
            status=status,
            diagnostics=SmcDiagnostics(
                tuple(one.epsilon for one in populations),
                tuple(one.acceptance for one in populations),
                tuple(one.simulated for one in populations),
                end,
                self.distance,
            ),
        )

    def _judged(self, populations: list[Population], end: str) -> tuple[Status, list[str]]:
        """How the run ended, by its tolerances, and warnings."""
        tolerance, last = self.settings.tolerance, populations[-1].epsilon
        warnings = self.problem.unreached(populations[0].statistics)
        if tolerance is not None and last > tolerance:
            warnings.append(f"tolerance {tolerance:g} was not reached, it ended at {last:.4g}: {end}")
            return Status.TOLERANCE_NOT_REACHED, warnings
        if not np.isfinite(last):
            warnings.append(f"the sample is one of the prior, nearer ones did not come: {end}")
            return Status.STILL_THE_PRIOR, warnings
        return Status.SETTLED, warnings

    def _proposals(self, mixture: Mixture | None, rng: np.random.Generator) -> Float[np.ndarray, "proposal free"]:
        """A batch inside the prior's support; which the mixture's density leaves out by a constant factor."""
        prior, count = self.problem.prior, self.settings.batch
        if mixture is None:
            return prior.coordinates(self.problem.prior_values(self.asked + count, self.seed)[self.asked :])
        proposals = np.empty((0, len(prior.free)))
        while len(proposals) < count:
            x = mixture.draw(count, rng)
            proposals = np.concatenate([proposals, x[np.isfinite(prior.log_density_of_coordinates(x))]])
        return proposals[:count]


def _vague(name: str, size: float) -> str:
    return (
        f"{name}: once adjusted, all draws are worth {size:.0f} independent ones, its mean is known to "
        f"{size**-0.5:.2f} of its standard deviation: allow more simulations, or take a larger population"
    )
