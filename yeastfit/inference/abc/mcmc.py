"""ABC-MCMC: chains whose likelihood is a simulation close to the data.

Marjoram et al. 2003, doi:10.1073/pnas.0306899100. The target is the joint density of λ and one simulated data set s,

    π(λ) p(s | λ) K_ε(d(s, o)),

o observed, d a distance, K_ε a kernel (`distances`). A chain at (λ, s) proposes λ* ~ q(λ* | λ), simulates
s* ~ p(· | λ*), one data set per proposal, and accepts with probability

    min(1, π(λ*) K_ε(d*) q(λ | λ*) / (π(λ) K_ε(d) q(λ* | λ))).

K_ε(d) of the current point is never simulated again: the λ of the chain then have exactly the density
π(λ) E[K_ε(d) | λ] (pseudo-marginal: Andrieu & Roberts 2009, doi:10.1214/07-AOS574). With the indicator kernel and a
Gaussian q of covariance Σ/3 this is the method of Li et al. 2024.

**Pilot.** Simulations of λ from the prior give what is not given: ε, a quantile of their distances; Σ, the covariance
of the nearest; and the starting points, drawn from them with weights K_ε. With the indicator kernel these are draws
from the target, so that no burn-in is needed. Where all three are given, chains leave the given points as if these had
been accepted, close to the data or not, and take time to forget them; beforehand nothing is simulated but the pilot of
a distance that is estimated.

**Chains** are emcee's walkers, in the coordinates of the prior (log λ where its distribution is one of log λ). With the
Gaussian proposal they are independent. "stretch" and "de" are emcee's ensemble moves, whose chains are not. λ* outside
the prior are not simulated. Every step has random numbers of its own, so that a run that is repeated with the same
store repeats its chains bit by bit.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import emcee
import numpy as np
from emcee.backends import Backend
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import KERNELS, Distance, KernelName, log_kernel
from yeastfit.inference.abc.ensemble import Ensemble
from yeastfit.inference.abc.pilot import (
    DISTANCES,
    DistanceName,
    Pilot,
    check_pilot,
    distance_of,
    is_estimated,
    no_pilot,
    pilot_of,
)
from yeastfit.inference.abc.proposals import MOVES, Move, move_of
from yeastfit.inference.abc.standstills import standstills
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.settings import Setting, check_at_least, check_choice
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.simulator import Simulator, seed_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulations import Simulations
from yeastfit.memory import check_memory
from yeastfit.progress import Progress
from yeastfit.seeds import Stream, stream_of

CHAIN = 32  # bytes of a step of a chain, at least
PILOT_QUANTILE = 0.02
STARTS = 1.25  # simulations of the pilot for each walker that starts at one of its own: some fail


@dataclass(frozen=True)
class McmcDiagnostics(Diagnostics):
    """What a run of ABC-MCMC reports.

    Attributes:
        tolerance: ε.
        distance: From the data.
        proposal_covariance: Σ/3 of the Gaussian proposal.
    """

    caption = "Draws are simulations within the tolerance; the distance is measured from the data."

    tolerance: float
    distance: Distance
    proposal_covariance: Float[np.ndarray, "free free"]

    def facts(self) -> list[tuple[str, str]]:
        """Tolerance and distance."""
        return [("tolerance", f"{self.tolerance:.4g}"), ("distance", type(self.distance).__name__)]


@dataclass(frozen=True)
class AbcMcmc:
    """ABC-MCMC (module `abc.mcmc`): chains that accept simulations within a tolerance of the data.

    Attributes:
        steps: Of each chain in all; a run that is resumed with more goes on.
        walkers: Chains.
        distance: From the data, a name or an object.
        tolerance: ε; by default the quantile `pilot_quantile` of the pilot's distances.
        pilot_quantile: By default 0.02, or as much as starts of all walkers need.
        pilot: Simulations from the prior before the chains.
        kernel: Weight of a distance.
        move: Proposal.
        replicates: Replicates that a simulated data set is the mean of.
        covariance: Σ of the Gaussian proposal in the prior's coordinates; by default the pilot's.
        start: λ at which each chain starts; by default draws from the pilot.
        discard: Steps at the beginning that are left out.
        batch: Rows of every call of the simulator; by default all that one step asks for.
    """

    steps: Annotated[int, Setting("Steps of each chain in all, those of a resumed run included.", extends=True)] = 1000
    walkers: Annotated[int, Setting("Number of chains.")] = 32
    distance: Annotated[DistanceName | Distance, Setting("How simulated data are compared with the data.")] = (
        "mahalanobis"
    )
    tolerance: Annotated[float | None, Setting("Largest distance that is accepted.")] = None
    pilot_quantile: Annotated[
        float | None, Setting("Or: the tolerance as this quantile of the pilot's distances; 0.02.")
    ] = None
    pilot: Annotated[int, Setting("Simulations from the prior before sampling starts.")] = 500
    kernel: Annotated[KernelName, Setting("Weight of a distance: all within the tolerance alike, or Gaussian.")] = (
        "indicator"
    )
    move: Annotated[Move, Setting("How chains propose: Gaussian steps, or emcee's stretch and de moves.")] = "gaussian"
    replicates: Annotated[
        int,
        Setting("Simulations whose mean is compared with the data; more narrow the posterior.", aliases=("colonies",)),
    ] = 1
    covariance: tuple[tuple[float, ...], ...] | None = None
    start: tuple[tuple[float, ...], ...] | None = None
    discard: Annotated[int, Setting("Steps at the beginning of each chain that are left out.")] = 0
    batch: Annotated[int | None, Setting("Simulations that run together; all of a step by default.")] = None

    def __post_init__(self) -> None:
        check_at_least(self, steps=1, walkers=1, pilot=2, discard=0, batch=1, replicates=1)
        check_memory(CHAIN * self.steps * self.walkers, f"steps · walkers is {self.steps} · {self.walkers}, which")
        if self.discard >= self.steps:
            raise InputError(f"discard is {self.discard}, it must be below the number of steps, {self.steps}")
        if self.tolerance is not None and self.pilot_quantile is not None:
            raise InputError("tolerance and pilot_quantile are given, need one of the two")
        if self.tolerance is not None and not self.tolerance > 0:
            raise InputError(f"tolerance is {self.tolerance}, it must be above 0")
        if self.pilot_quantile is not None and not 0 < self.pilot_quantile <= 1:
            raise InputError(f"pilot_quantile is {self.pilot_quantile}, it must lie in 0..1 and above 0")
        check_choice(self, "move", MOVES)
        check_choice(self, "kernel", KERNELS)
        if isinstance(self.distance, str):
            check_choice(self, "distance", DISTANCES)

    @property
    def simulations_at_most(self) -> int:
        """Single simulations of a run, at most."""
        return self._made(self.steps * self.walkers)

    def _made(self, asked: int) -> int:
        """Single simulations for so many data sets of the chains, with those of the pilot."""
        return self.replicates * (self.pilot * (self.asks_pilot or is_estimated(self.distance)) + asked)

    @property
    def asks_pilot(self) -> bool:
        """Whether anything is left for the pilot to give."""
        return self.tolerance is None or self.covariance is None or self.start is None

    @property
    def asked_at_once(self) -> int:
        """Data sets that the chains ask for at once; ensemble moves move half of the walkers at a time."""
        return self.walkers if self.move == "gaussian" else (self.walkers + 1) // 2

    def check(self, free: int, inferred: int, statistics: int) -> None:
        """See `Sampler`."""
        least = max(4, 2 * free)
        if self.move != "gaussian" and self.walkers < least:
            raise InputError(f"walkers is {self.walkers}, {self.move} with {free} parameters needs at least {least}")
        check_pilot(self.distance, self.pilot, free, statistics)
        near = int(np.ceil(self._quantile * (self.pilot - 1))) + 1  # of the pilot, within the tolerance
        if self.move != "gaussian" and self.kernel == "indicator" and self.tolerance is None and near < self.walkers:
            raise InputError(
                f"walkers is {self.walkers}, {self.move} starts each at another simulation of the pilot, of which "
                f"{near} of {self.pilot} are within the tolerance: give fewer, a larger pilot or pilot-quantile"
            )

    @property
    def _quantile(self) -> float:
        """Of the pilot's distances, that ε is; by default enough for moves that start walkers at different places."""
        if self.pilot_quantile is not None:
            return self.pilot_quantile
        starts = 0.0 if self.move == "gaussian" else STARTS * self.walkers / self.pilot
        return min(1.0, max(PILOT_QUANTILE, starts))

    def run(self, problem: Problem, store: Simulations, seed: int, progress: Progress) -> Posterior:
        """Sample the posterior of a problem; see `Sampler`.

        `log_probability` of the result is log π + log K_ε, with π the density in the prior's coordinates.
        """
        self.check(len(problem.prior.free), len(problem.inferred_prior.free), len(problem.labels))
        self._check_start(problem.prior)
        batch = self.batch or self.replicates * self.asked_at_once
        data_sets = problem.data_sets(CachedSimulator(problem.simulator, batch, store), self.replicates)
        progress("pilot", 0.0)
        distance = self.distance
        if isinstance(distance, str):
            distance = distance_of(distance, problem, data_sets, self.pilot, seed)
        pilot = pilot_of(problem, data_sets, distance, self.pilot, seed) if self.asks_pilot else no_pilot(problem)
        tolerance = self.tolerance
        if tolerance is None:
            tolerance = pilot.quantile(self._quantile)
        covariance = self._covariance(pilot, tolerance)
        target = _Target(data_sets, problem, distance, self, tolerance, seed)
        start = target.start(pilot)
        backend = _walk(target, start, covariance, progress)
        moved = np.any(np.diff(np.concatenate([start.coords[None], backend.get_chain()]), axis=0) != 0, axis=2)
        x = np.swapaxes(backend.get_chain(), 0, 1)[:, self.discard :]
        return Posterior.of(
            problem,
            problem.prior.values(x.reshape(-1, x.shape[2])).reshape(x.shape),
            log_probability=backend.get_log_prob()[self.discard :].T,
            statistics=np.swapaxes(backend.get_blobs()[self.discard :, :, 1:], 0, 1),
            simulations=self._made(target.asked),
            acceptance=moved.mean(axis=0),
            warnings=[*store.notes, *pilot.warnings, *standstills(moved)],
            diagnostics=McmcDiagnostics(float(tolerance), distance, covariance / 3),
            backend=backend,
        )

    def _covariance(self, pilot: Pilot, tolerance: float) -> Float[np.ndarray, "free free"]:
        """Σ, as given or of the pilot."""
        free = pilot.x.shape[1]
        if self.covariance is None:
            return pilot.covariance(tolerance)
        covariance = np.array(self.covariance, dtype=float)
        symmetric = covariance.shape == (free, free) and np.allclose(covariance, covariance.T)
        if not symmetric or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise InputError(
                f"covariance is {covariance.tolist()}, it must be symmetric and positive definite, {free} by {free}"
            )
        return covariance

    def _check_start(self, prior: Prior) -> None:
        if self.start is not None:
            start, shape = np.array(self.start, dtype=float), (self.walkers, len(prior.free))
            if start.shape != shape or not prior.contains(start).all():
                raise InputError(f"start is {start.tolist()}, it must be {shape[0]} points inside the prior")


@dataclass
class _Target:
    """log π + log K_ε of proposals, with distance and statistics as emcee's blobs."""

    data_sets: Simulator
    problem: Problem
    distance: Distance
    settings: AbcMcmc
    tolerance: float
    seed: int
    next: int = 0
    asked: int = 0

    def start(self, pilot: Pilot) -> emcee.State:
        """Starting points of the chains: simulations of the pilot, or given ones, of which nothing was simulated."""
        settings = self.settings
        if settings.start is not None:
            x = self.problem.prior.coordinates(np.array(settings.start, dtype=float))
            blobs = np.full((len(x), 1 + len(self.problem.labels)), np.nan)
            return emcee.State(x, log_prob=self.problem.prior.log_density_of_coordinates(x), blobs=blobs)
        weights = pilot.weights(settings.kernel, self.tolerance)
        within = int(np.count_nonzero(weights))
        if within < settings.walkers and settings.move != "gaussian":
            raise InputError(
                f"tolerance is {self.tolerance:g}, only {within} of {len(weights)} pilot simulations come that close; "
                f"{settings.move} starts {settings.walkers} walkers at different ones: give a larger pilot or tolerance"
            )
        rng = np.random.default_rng(stream_of(self.seed, Stream.STARTS, 0))
        at = rng.choice(len(weights), size=settings.walkers, replace=within < settings.walkers, p=weights)
        log_probability, blobs = self._judged(pilot.log_prior[at], pilot.statistics[at])
        return emcee.State(pilot.x[at], log_prob=log_probability, blobs=blobs)

    def begin(self, step: int) -> Any:
        """Number simulations by step and place in the step, whatever was simulated before; random state of the step."""
        self.next = self.settings.pilot + step * self.settings.walkers
        return np.random.MT19937(stream_of(self.seed, Stream.PROPOSALS, step)).state

    def __call__(self, x: Float[np.ndarray, "proposal free"]) -> tuple[np.ndarray, np.ndarray]:
        """Log-probability and blobs of proposals, each simulated once."""
        numbers = np.arange(self.next, self.next + len(x))
        self.next += len(x)
        log_prior = self.problem.prior.log_density_of_coordinates(x)
        inside = np.isfinite(log_prior)
        self.asked += int(inside.sum())
        statistics = np.full((len(x), len(self.problem.labels)), np.nan)
        if inside.any():
            values, seeds = self.problem.prior.values(x[inside]), seed_of(self.seed, numbers[inside])
            statistics[inside] = self.data_sets(values, seeds)
        return self._judged(log_prior, statistics)

    def _judged(self, log_prior: np.ndarray, statistics: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log-probability, and distance and statistics side by side."""
        distances = self.distance(statistics)
        log_probability = log_prior + log_kernel(self.settings.kernel, distances, self.tolerance)
        return log_probability, np.column_stack([distances, statistics])


def _walk(
    target: _Target, start: emcee.State, covariance: Float[np.ndarray, "free free"], progress: Progress
) -> Backend:
    """All steps of the chains, each with random numbers of its own."""
    steps = target.settings.steps
    sampler = Ensemble(start.coords.shape, target, move_of(target.settings.move, covariance))
    start.random_state = target.begin(0)
    for step, _ in enumerate(sampler.sample(start, iterations=steps, skip_initial_state_check=True), start=1):
        progress("chains", step / steps)
        sampler.random_state = target.begin(step)
    return sampler.backend
