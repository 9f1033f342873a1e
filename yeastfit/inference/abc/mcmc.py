"""ABC-MCMC: chains whose likelihood is a simulation close to the data.

Marjoram et al. 2003, doi:10.1073/pnas.0306899100.
The target is the joint density of λ and one simulated data set s given λ,

    π(λ) p(s | λ) K_ε(d(s, o)),

o observed, d a distance, K_ε a kernel (`distances`). A chain at (λ, s) proposes λ* ~ q(λ* | λ), simulates
s* ~ p(· | λ*), one simulation a proposal, and accepts with probability

    min(1, π(λ*) K_ε(d*) q(λ | λ*) / (π(λ) K_ε(d) q(λ* | λ))).

K_ε(d) of the current point is the stored one, never simulated again: with that the λ of the chain have exactly the
density π(λ) E[K_ε(d) | λ] (pseudo-marginal: Andrieu & Roberts 2009, doi:10.1214/07-AOS574). With the indicator kernel
and a Gaussian q of covariance Σ/3 this is the method of Li et al. 2024.

**Pilot.** Simulations of λ from the prior give what is not given: ε, a quantile of their distances; Σ, the covariance
of the nearest; and where the chains start, drawn from them with weights K_ε. With the indicator kernel that is a draw
from the target, so that no burn-in is needed.

**Chains** are emcee's walkers, in the coordinates of the prior (log λ where its law is one of log λ). With the Gaussian
proposal they are independent; emcee's own `GaussianMove` is not used because with a full covariance it moves all
walkers by one and the same vector. "stretch" and "de" are emcee's moves of ensembles, whose chains are not independent.
λ* outside the prior are not simulated.
"""

import time as clock
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import emcee
import numpy as np
from jaxtyping import Bool, Float

from yeastfit.errors import InputError
from yeastfit.inference.abc.chain_file import ChainFile
from yeastfit.inference.abc.distances import Distance, log_kernel
from yeastfit.inference.abc.mcmc_settings import McmcSettings, move_of
from yeastfit.inference.abc.pilot import Pilot, check_problem, pilot_of
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.posterior.simulation_store import Recorded, Store
from yeastfit.inference.simulator import Simulator, Stream, labels_of, seed_of, stream_of
from yeastfit.progress import Progress, silent

STANDSTILL = 0.25  # of a run, and `STILL` steps: a chain that does not move for longer is warned of
STILL = 50
LARGER = "a larger tolerance epsilon would let it move"  # what to do about it


def abc_mcmc(
    simulator: Simulator,
    prior: Prior,
    distance: Distance,
    settings: McmcSettings | None = None,
    *,
    seed: int = 0,
    path: str | Path | None = None,
    store: Store | None = None,
    progress: Progress | None = None,
) -> Samples:
    """Chains of λ with the density above.

    path: file of the chains, emcee's HDF5; where it exists, they are taken up and go on to the same bits as if nothing
    had happened. store: of simulations. `log_probability` of the result is log π + log K_ε, π the density in the
    prior's coordinates. Raises `InputError`, also where no simulation of the pilot lies within ε.
    """
    began = clock.perf_counter()
    settings = settings or McmcSettings()
    check_problem(simulator, prior, distance)
    settings.check_walkers(len(prior.free))
    say = progress or silent
    recorded = Recorded(simulator, settings.rows, store)
    backend: emcee.backends.Backend | ChainFile = emcee.backends.Backend()
    done, notes = 0, list[str]()
    if path is not None:
        head = {"prior": prior.asdict(), "labels": labels_of(simulator), "seed": seed, "about": recorded.about}
        head |= {f"distance's {name}": one for name, one in distance.asdict().items()}
        backend = ChainFile(path, {**head, **settings.fixed}, lambda: recorded.asked)
        done, notes = backend.take_up(), backend.notes
    say("pilot", 0.0)
    pilot = pilot_of(recorded, prior, distance, settings.pilot, seed)
    epsilon = settings.epsilon if settings.epsilon is not None else pilot.quantile(settings.share)
    covariance = _covariance(settings, pilot, epsilon)
    target = _Target(recorded, prior, distance, settings, epsilon, seed)
    first = target.start(pilot)
    if not done:
        backend.reset(*first.coords.shape)
    sampler = emcee.EnsembleSampler(
        *first.coords.shape,
        target,
        moves=move_of(settings.move, covariance),
        backend=backend,
        vectorize=True,
        blobs_dtype=float,
    )
    sampler.log_prob_fn = target  # emcee's wrapper around it would print what a simulator raises
    if isinstance(backend, ChainFile) and done:
        recorded.asked = backend.simulations(min(done, settings.steps))
    if done < settings.steps:
        _walk(sampler, target, backend.get_last_sample() if done else first, done, say)
    moved, drawn = _drawn(backend, first, prior, settings)
    return Samples(
        free=prior.free,
        labels=labels_of(simulator),
        **drawn,
        simulations=recorded.asked,
        seconds=clock.perf_counter() - began,
        seed=seed,
        method="ABC-MCMC",
        settings={**asdict(settings), "prior": prior.asdict(), **distance.asdict()},  # its covariance, not Σ
        warnings=[*recorded.notes, *notes, *pilot.warnings, *_standstills(moved)],
        diagnostics={"epsilon": float(epsilon), "proposal_covariance": (covariance / 3).tolist()},
    )


@dataclass
class _Target:
    """log π + log K_ε of proposals, with distance and statistics as emcee's blobs."""

    recorded: Recorded
    prior: Prior
    distance: Distance
    settings: McmcSettings
    epsilon: float
    seed: int
    next: int = 0

    def start(self, pilot: Pilot) -> emcee.State:
        """Where the chains start, at simulations of the pilot."""
        settings = self.settings
        weights = pilot.weights(settings.kernel, self.epsilon)
        within = int(np.count_nonzero(weights))
        if within < settings.walkers and settings.move != "gaussian":
            raise InputError(
                f"epsilon is {self.epsilon:g}, only {within} of {len(weights)} pilot simulations come that close; "
                f"{settings.move} starts {settings.walkers} walkers at different ones: give a larger pilot or epsilon"
            )
        rng = np.random.default_rng(stream_of(self.seed, Stream.STARTS, 0))
        at = rng.choice(len(weights), size=settings.walkers, replace=within < settings.walkers, p=weights)
        columns = self._columns(pilot.log_prior[at], pilot.statistics[at])
        return emcee.State(pilot.x[at], log_prob=columns[:, 0], blobs=columns[:, 1:])

    def begin(self, step: int) -> None:
        """Simulations have numbers by step and place in the step, whatever was simulated before."""
        self.next = self.settings.pilot + step * self.settings.walkers

    def __call__(self, x: Float[np.ndarray, "proposal free"]) -> Float[np.ndarray, "proposal column"]:
        numbers = np.arange(self.next, self.next + len(x))
        self.next += len(x)
        log_prior = self.prior.log_density_of_coordinates(x)
        inside = np.isfinite(log_prior)
        statistics = np.full((len(x), len(self.recorded.labels)), np.nan)
        statistics[inside] = self.recorded(self.prior.values(x[inside]), seed_of(self.seed, numbers[inside]))
        return self._columns(log_prior, statistics)

    def _columns(self, log_prior: np.ndarray, statistics: np.ndarray) -> Float[np.ndarray, "proposal column"]:
        """Log-probability, distance and statistics side by side."""
        distances = self.distance(statistics)
        return np.column_stack(
            [log_prior + log_kernel(self.settings.kernel, distances, self.epsilon), distances, statistics]
        )


def _walk(sampler: emcee.EnsembleSampler, target: _Target, state: emcee.State, done: int, say: Progress) -> None:
    """Steps done + 1 to the last, each with random numbers of its own."""
    steps = target.settings.steps

    def begin(step: int) -> Any:
        target.begin(step)
        return np.random.MT19937(stream_of(target.seed, Stream.PROPOSALS, step)).state

    state.random_state = begin(done)
    states = sampler.sample(state, iterations=steps - done, skip_initial_state_check=True)
    for step, _ in enumerate(states, start=done + 1):
        say("chains", step / steps)
        sampler.random_state = begin(step)


def _drawn(
    backend: emcee.backends.Backend, first: emcee.State, prior: Prior, settings: McmcSettings
) -> tuple[Bool[np.ndarray, "draw chain"], dict[str, np.ndarray]]:
    """Which proposals were accepted, and the arrays of `Samples`."""
    chain, log_probability, blobs = (
        one[: settings.steps] for one in (backend.get_chain(), backend.get_log_prob(), backend.get_blobs())
    )
    moved = np.any(np.diff(np.concatenate([first.coords[None], chain]), axis=0) != 0, axis=2)
    kept = np.swapaxes(chain, 0, 1)[:, settings.discard :]
    return moved, {
        "values": prior.values(kept.reshape(-1, kept.shape[2])).reshape(kept.shape),
        "weights": np.full(kept.shape[:2], 1.0 / (kept.shape[0] * kept.shape[1])),
        "log_probability": log_probability[settings.discard :].T,
        "acceptance": moved.mean(axis=0),
        "statistics": np.swapaxes(blobs[settings.discard :, :, 1:], 0, 1),
    }


def _covariance(settings: McmcSettings, pilot: Pilot, epsilon: float) -> Float[np.ndarray, "free free"]:
    """Σ, as given or of the pilot."""
    free = pilot.x.shape[1]
    if settings.covariance is None:
        return pilot.covariance(epsilon)
    given = np.array(settings.covariance, dtype=float)
    if given.shape != (free, free) or not np.allclose(given, given.T) or np.linalg.eigvalsh(given)[0] <= 0:
        raise InputError(
            f"covariance is {given.tolist()}, it must be symmetric and positive definite, {free} by {free}"
        )
    return given


def _standstills(moved: Bool[np.ndarray, "draw chain"]) -> list[str]:
    """What is to be said of chains that stood still for long."""
    said, steps = [], len(moved)
    for chain, each in enumerate(moved.T):
        ends = np.flatnonzero(np.concatenate([[True], each, [True]]))
        longest = int(np.diff(ends).max()) - 1
        if longest == steps:
            said.append(f"chain {chain} accepted none of {steps} proposals: {LARGER}, or smaller proposals")
        elif longest >= max(STILL, STANDSTILL * steps):
            said.append(f"chain {chain} stood still for {longest} of {steps} steps: {LARGER}")
    return said
