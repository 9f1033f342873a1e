"""Chains of emcee on a posterior whose likelihood is an emulator's.

They walk in the prior's coordinates, log λ where its distribution is one of log λ, and in z where colonies scatter by
τ(z) (`prior.variation`). Given `KERNELS` walkers per parameter, half of the steps propose each half of the walkers from
a kernel density of the other half (`kernel_move`), which moves them along thin trails and between modes at once; the
other steps are differential evolution (ter Braak 2006, doi:10.1007/s11222-006-8769-1), which works in any number of
parameters. On the demo's trail 128 chains then decorrelate in 20 steps, by differential evolution alone in 110. emcee's
snooker update is not used: as of 3.1.6 it does not leave the density invariant (of a normal one in three dimensions it
makes standard deviations of 0.89). Chains start at simulations drawn by their posterior density, and run for a number
of autocorrelation times: `ENOUGH` for a result, and more where R̂ is above `ALIKE`; `ROUGHLY` to see where the next
simulations belong, within a number of steps at most: `BRIEFLY` until the posterior is found, as it may have modes then
that are none, and `LONGER` afterwards.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import emcee
import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from yeastfit.inference.neural_likelihood.emulator import Emulator, in_pieces
from yeastfit.inference.neural_likelihood.kernel_move import KernelMove
from yeastfit.inference.neural_likelihood.single_colonies import likelihood_of_colonies
from yeastfit.inference.posterior.chain_diagnostics import LONG, autocorrelation_time, split_r_hat
from yeastfit.inference.posterior.ensemble import Ensemble
from yeastfit.inference.posterior.problem import Problem
from yeastfit.seeds import Stream, stream_of

ENOUGH = 1.2 * LONG  # autocorrelation times; `diagnose` estimates them again, and asks for LONG
FURTHER = 1.2  # times as long, where it finds them short
ALIKE, LONGEST = 1.01, 4 * LONG  # split R̂ of a result, and autocorrelation times after which it is left at what it is
ROUGHLY = 20.0  # with 128 chains, quantiles are within some 0.03 standard deviations
BRIEFLY = 1000  # steps of chains while the posterior is searched
LONGER = 2000  # steps of chains between rounds once it is found
BURN_IN = 3  # autocorrelation times, after the first `PIECE` steps
PIECE = 500  # steps between looks at the autocorrelation time, at least
GROWTH = 4  # a chain grows by one in so many of its steps between looks, as a look takes as long as the chain is
APART = 0.5  # autocorrelation times between draws that are kept
KERNELS = 10  # walkers per parameter, at least, for a kernel density that is worth drawing from
FARTHEST = 30.0  # |z|, of prior probability 10⁻¹⁹⁷, from where τ(z) is soon infinite in double precision
FEWEST = 50  # draws that are kept of a chain, however correlated; it is then said to be too short

LOG_ROOT_2PI = np.log(np.sqrt(2.0 * np.pi))

LogDensity = Callable[[np.ndarray], np.ndarray]  # of rows
Known = Callable[[np.ndarray], np.ndarray]  # of rows


@dataclass(frozen=True)
class LogPosterior:
    """Log posterior density in the prior's coordinates, and in z, up to a constant, as emcee calls it.

    Attributes:
        emulator: Of the likelihood.
        problem: Data and prior.
        known: Which places the emulator knows, rows of the prior's coordinates; all by default.
        power: To which the likelihood is raised; below 1 it is flatter.
    """

    emulator: Emulator
    problem: Problem
    known: Known | None = None
    power: float = 1.0

    def __call__(self, x: Float[np.ndarray, "walker coordinate"]) -> Float[np.ndarray, " walker"]:
        """−inf outside the prior, and where the emulator knows nothing."""
        prior, x, z = self.problem.prior, *self.parts(x)
        log_prior = self.log_prior(x, z)
        inside = np.isfinite(log_prior) & (np.abs(z) < FARTHEST).all(axis=1)
        if self.known is not None:
            inside &= self.known(x)
        values = np.where(inside[:, None], prior.values(x), self._somewhere)
        likelihood = self._likelihood(values, np.where(inside[:, None], z, 0.0))
        return np.where(inside, log_prior + self.power * likelihood, -np.inf)

    def parts(
        self, x: Float[np.ndarray, "walker coordinate"]
    ) -> tuple[Float[np.ndarray, "walker free"], Float[np.ndarray, "walker varied"]]:
        """The prior's coordinates, and z in a column of its own where colonies scatter."""
        free = len(self.problem.prior.free)
        return x[:, :free], x[:, free:]

    def log_prior(
        self, x: Float[np.ndarray, "walker free"], z: Float[np.ndarray, "walker varied"]
    ) -> Float[np.ndarray, " walker"]:
        """Of λ in the prior's coordinates, and of z."""
        return self.problem.prior.log_density_of_coordinates(x) - (z**2 / 2.0 + LOG_ROOT_2PI).sum(axis=1)

    @cached_property
    def _likelihood(self) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        problem = self.problem
        if problem.variation is None:
            of_means = self.emulator.likelihood(problem.observed, problem.replicates, problem.noise)
            return lambda values, z: of_means(values)
        of_colonies, tau = likelihood_of_colonies(self.emulator, problem), problem.variation.tau
        return lambda values, z: of_colonies(values, tau(z[:, 0]))

    @cached_property
    def _somewhere(self) -> Float[np.ndarray, "1 free"]:
        """λ inside the prior, for walkers that are outside."""
        return self.problem.prior.quantile(np.full((1, len(self.problem.prior.free)), 0.5))


@dataclass(frozen=True)
class Chains:
    """Draws that are kept of the walkers.

    Attributes:
        x: In the prior's coordinates.
        log_density: Of each draw.
        acceptance: Share of accepted proposals of each walker.
        times: Autocorrelation times, in steps.
        steps: Of every walker, burn-in included.
    """

    x: Float[np.ndarray, "chain draw free"]
    log_density: Float[np.ndarray, "chain draw"]
    acceptance: Float[np.ndarray, " chain"]
    times: Float[np.ndarray, " free"]
    steps: int

    @property
    def flat(self) -> Float[np.ndarray, "draw free"]:
        """All draws."""
        return self.x.reshape(-1, self.x.shape[-1])


@dataclass
class Walk:
    """Chains under way; `state` is where the walkers are."""

    sampler: Ensemble
    state: emcee.State
    most_steps: int

    @staticmethod
    def start(
        log_density: LogDensity,
        places: Float[np.ndarray, "place free"],
        *,
        walkers: int,
        most_steps: int,
        seed: int,
    ) -> "Walk":
        """Start at places of which some have a high density; same seed, same chains."""
        rng = np.random.default_rng(stream_of(seed, Stream.CHAINS, 0))
        places = places[np.sort(np.unique(places, axis=0, return_index=True)[1])]  # replicates share one
        start, density = _start(log_density, places, walkers, rng)
        sampler = Ensemble(start.shape, lambda x: (log_density(x), None), _moves(*start.shape))
        random = np.random.RandomState(rng.integers(2**32)).get_state()
        return Walk(sampler, emcee.State(start, log_prob=density, random_state=random), most_steps)

    def until(self, enough: float = ENOUGH, most: float = np.inf) -> Chains:
        """Run until chains are `enough` autocorrelation times long, or have `most` steps or `most_steps`."""
        sampler, most = self.sampler, min(most, self.most_steps)
        times, burnt = self._times()
        while sampler.iteration < most and sampler.iteration - burnt < enough * times.max():
            with threadpool_limits(1, user_api="blas"):  # waking further threads takes longer than such small matrices
                piece = max(PIECE, sampler.iteration // GROWTH)
                self.state = sampler.run_mcmc(self.state, int(min(piece, most - sampler.iteration)))
            times, burnt = self._times()
        thin = max(1, int(min(APART * times.max(), (sampler.iteration - burnt) // FEWEST)))
        return Chains(
            sampler.get_chain(discard=burnt, thin=thin).transpose(1, 0, 2),
            sampler.get_log_prob(discard=burnt, thin=thin).T,
            np.asarray(sampler.acceptance_fraction, dtype=float),
            times,
            sampler.iteration,
        )

    def until_long(self, diagnosed: Callable[[np.ndarray], np.ndarray] = np.asarray) -> Chains:
        """Run until the draws kept suffice as `diagnose` finds them, or for `most_steps`.

        They are `LONG` autocorrelation times long then, and chains agree to `ALIKE` or are `LONGEST` of them long.

        Arguments:
            diagnosed: What is diagnosed of draws, one column a parameter: λ, whose times are not those of log λ.
        """
        enough = ENOUGH
        chains = self.until(enough)
        while chains.steps < self.most_steps and not _suffice(diagnosed(chains.flat).reshape(chains.x.shape)):
            enough *= FURTHER
            chains = self.until(enough)
        return chains

    @property
    def backend(self) -> emcee.backends.Backend:
        """All steps so far, burn-in included."""
        return self.sampler.backend

    def _times(self) -> tuple[Float[np.ndarray, " free"], int]:
        """Autocorrelation times, and steps of burn-in."""
        steps = self.sampler.iteration
        if not steps:
            return np.full(self.sampler.ndim, np.inf), 0
        times = autocorrelation_time(self.sampler.get_chain(discard=steps // 2).transpose(1, 0, 2))
        return times, int(min(PIECE / 2 + BURN_IN * times.max(), steps // 2))


def _suffice(x: Float[np.ndarray, "walker draw free"]) -> bool:
    """Whether chains are long enough for a result."""
    lengths = x.shape[1] / autocorrelation_time(x)
    return bool((lengths >= LONG).all() and ((lengths >= LONGEST).all() or (split_r_hat(x) <= ALIKE).all()))


def _moves(walkers: int, free: int) -> list[tuple[emcee.moves.Move, float]]:
    """emcee's moves and their shares."""
    evolution = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DEMove(gamma0=1.0), 0.2)]
    if walkers < KERNELS * free:
        return evolution
    return [(KernelMove(), 1.0), *evolution]


def _start(
    log_density: LogDensity, places: Float[np.ndarray, "place free"], walkers: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "walker free"], Float[np.ndarray, " walker"]]:
    """Different places drawn by their density, without replacement (Gumbel's trick), and log densities."""
    pieces = in_pieces(places, walkers // 2)  # of as many rows as steps have, which are compiled for
    density = np.concatenate([log_density(one) for one in pieces])[: len(places)]
    chosen = np.argsort(-(density + rng.gumbel(size=len(places))))[:walkers]
    return places[chosen], density[chosen]
