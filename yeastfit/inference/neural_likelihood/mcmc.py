"""Chains of emcee on a posterior whose likelihood is an emulator's.

They walk in the prior's coordinates, log λ where its law is one of log λ. Half of the steps, where there are `KERNELS`
walkers for each parameter, propose each half of the walkers from a kernel density of the other half, which takes them
along thin trails and from mode to mode at once; in the others they move by differential evolution (ter Braak 2006,
doi:10.1007/s11222-006-8769-1), which does not mind how many parameters there are. On the demo's trail 128 chains so
forget in 20 steps, by differential evolution alone in 110. emcee's snooker update is not used: as of 3.1.6 it does not
leave the density as it is (of a normal one in three dimensions it makes standard deviations of 0.89). Chains start at
simulations drawn by their posterior density, and run until they are so many autocorrelation times long: `ENOUGH` for a
result, `ROUGHLY` to see where the next simulations belong, for which `BRIEFLY` is the most where little is known yet.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import emcee
import numpy as np
from emcee.backends import HDFBackend
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from yeastfit.inference.neural_likelihood.emulator import Emulator, Square, in_pieces
from yeastfit.inference.posterior.diagnostics import LONG, autocorrelation_time
from yeastfit.inference.posterior.prior import Prior
from yeastfit.storage import hdf5_written_whole

ENOUGH = 1.2 * LONG  # autocorrelation times; `diagnose` has its own estimate of them, and asks for LONG
ROUGHLY = 20.0  # with 128 chains, quantiles are within some 0.03 standard deviations
BRIEFLY = 1000  # steps of chains on what the first simulations say
BURN_IN = 3  # autocorrelation times, after the first `PIECE` steps
PIECE = 500  # steps between looks at the autocorrelation time
APART = 0.5  # autocorrelation times between draws that are kept
KERNELS = 10  # walkers for each parameter, at least: so many make a density that is worth drawing from
FEWEST = 50  # that are kept of a chain, however long they hang together: it is then said to be too short

LogDensity = Callable[[np.ndarray], np.ndarray]  # of rows


@dataclass(frozen=True)
class Posterior:
    """log posterior density in the prior's coordinates, up to a constant, as emcee calls it."""

    emulator: Emulator
    prior: Prior
    observed: Float[np.ndarray, " statistic"]
    replicates: int
    noise: Square | None = None

    def __call__(self, x: Float[np.ndarray, "walker free"]) -> Float[np.ndarray, " walker"]:
        """−inf outside the prior."""
        before = self.prior.log_density_of_coordinates(x)
        inside = np.isfinite(before)
        values = np.where(inside[:, None], self.prior.values(x), self.prior.values(self._somewhere))
        return np.where(inside, before + self._likelihood(values), -np.inf)

    @cached_property
    def _likelihood(self) -> LogDensity:
        return self.emulator.likelihood(self.observed, self.replicates, self.noise)

    @property
    def _somewhere(self) -> Float[np.ndarray, "1 free"]:
        """A place inside the prior, for walkers that are outside."""
        return self.emulator.coordinates.shift[None]


@dataclass(frozen=True)
class Chains:
    """x: coordinates of the draws kept. steps: of every walker, burn-in included; acceptance: of every walker."""

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
    """Chains under way. state: where the walkers are."""

    sampler: emcee.EnsembleSampler
    state: emcee.State
    most_steps: int

    @staticmethod
    def start(
        posterior: LogDensity,
        places: Float[np.ndarray, "place free"],
        *,
        walkers: int,
        most_steps: int,
        seed: int,
    ) -> "Walk":
        """From places of which some have a high density, the same for the same seed."""
        rng = np.random.default_rng(seed)
        places = places[np.sort(np.unique(places, axis=0, return_index=True)[1])]  # replicates share one
        start, density = _start(posterior, places, walkers, rng)
        sampler = emcee.EnsembleSampler(*start.shape, posterior, moves=_moves(*start.shape), vectorize=True)
        random = np.random.RandomState(rng.integers(2**32)).get_state()
        return Walk(sampler, emcee.State(start, log_prob=density, random_state=random), most_steps)

    def until(self, enough: float = ENOUGH, most: float = np.inf) -> Chains:
        """Goes on until chains are so many autocorrelation times long, or of that many steps, `most_steps` at most."""
        sampler, most = self.sampler, min(most, self.most_steps)
        times, burnt = self._times()
        while sampler.iteration < most and sampler.iteration - burnt < enough * times.max():
            with threadpool_limits(1, user_api="blas"):  # waking further threads takes longer than such small matrices
                self.state = sampler.run_mcmc(self.state, int(min(PIECE, most - sampler.iteration)))
            times, burnt = self._times()
        thin = max(1, int(min(APART * times.max(), (sampler.iteration - burnt) // FEWEST)))
        return Chains(
            sampler.get_chain(discard=burnt, thin=thin).transpose(1, 0, 2),
            sampler.get_log_prob(discard=burnt, thin=thin).T,
            np.asarray(sampler.acceptance_fraction, dtype=float),
            times,
            sampler.iteration,
        )

    def save(self, path: str | Path) -> None:
        """All steps so far, burn-in included, into a file of emcee's `HDFBackend`."""
        backend = self.sampler.backend
        with hdf5_written_whole(path) as image:
            kept = HDFBackend(image)
            kept.reset(*backend.shape)
            kept.grow(backend.iteration, None)
            with kept.open("a") as file:
                group = file[kept.name]
                group["chain"][...], group["log_prob"][...] = backend.get_chain(), backend.get_log_prob()
                group["accepted"][...] = backend.accepted
                group.attrs["iteration"] = backend.iteration
                for k, part in enumerate(self.state.random_state):
                    group.attrs[f"random_state_{k}"] = part

    def _times(self) -> tuple[Float[np.ndarray, " free"], int]:
        """Autocorrelation times, and steps of burn-in."""
        steps = self.sampler.iteration
        if not steps:
            return np.full(self.sampler.ndim, np.inf), 0
        times = autocorrelation_time(self.sampler.get_chain(discard=steps // 2).transpose(1, 0, 2))
        return times, int(min(PIECE / 2 + BURN_IN * times.max(), steps // 2))


def _moves(walkers: int, free: int) -> list[tuple[emcee.moves.Move, float]]:
    """And their shares."""
    evolution = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DEMove(gamma0=1.0), 0.2)]
    if walkers < KERNELS * free:
        return evolution
    return [(emcee.moves.KDEMove(), 1.0), *evolution]


def _start(
    posterior: LogDensity, places: Float[np.ndarray, "place free"], walkers: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "walker free"], Float[np.ndarray, " walker"]]:
    """Different places, drawn without replacement by their density (Gumbel's trick), and its logarithm."""
    pieces = in_pieces(places, walkers // 2)  # of as many rows as steps have, which are compiled for
    density = np.concatenate([posterior(one) for one in pieces])[: len(places)]
    chosen = np.argsort(-(density + rng.gumbel(size=len(places))))[:walkers]
    return places[chosen], density[chosen]
