"""Chains on a posterior whose likelihood is an emulator's (`log_posterior`).

Given enough walkers per parameter, half of their steps propose each half of the walkers from a kernel density of the
other half, which moves them along thin trails and between modes at once; the other steps are differential evolution,
which works in any number of parameters (`moves`). On the demo's trail 128 chains then decorrelate in 20 steps, by
differential evolution alone in 110. emcee's snooker update is not used: as of 3.1.6 it does not leave the density
invariant (of a normal one in three dimensions it makes standard deviations of 0.89). Chains start at simulations drawn
by their posterior density, and run for a number of autocorrelation times: `ENOUGH` for a result, and more where R̂ is
above `ALIKE`; `ROUGHLY` to see where the next simulations belong, within a number of steps at most: `BRIEFLY` until the
posterior is found, as it may have modes then that are none, and `LONGER` afterwards.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from emcee.backends import Backend
from jaxtyping import Bool, Float

from yeastfit.inference.neural_likelihood.densities import LogDensity, densities
from yeastfit.inference.neural_likelihood.moves import Chance, stepped
from yeastfit.inference.posterior.chain_diagnostics import LONG, autocorrelation_time, split_r_hat
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
BLOCK = 100  # steps of a program, which is compiled for as many
FEWEST = 50  # draws that are kept of a chain, however correlated; it is then said to be too short


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
    """Chains under way.

    Attributes:
        log_density: That is sampled, up to a constant.
        rng: Where the randomness of further steps comes from.
        places: Where walkers are after each step so far, in blocks of steps; the first is their start.
        densities: Its logarithm there.
        moved: Which walkers moved in each step.
        most_steps: Of each chain.
        steps: How many of them count; some more may have been made.
    """

    log_density: LogDensity
    rng: np.random.Generator
    places: list[Float[np.ndarray, "step walker coordinate"]]
    densities: list[Float[np.ndarray, "step walker"]]
    moved: list[Bool[np.ndarray, "step walker"]]
    most_steps: int
    steps: int = 0

    @staticmethod
    def start(
        log_density: LogDensity,
        places: Float[np.ndarray, "place coordinate"],
        *,
        walkers: int,
        most_steps: int,
        seed: int,
    ) -> "Walk":
        """Start at places of which some have a high density; same seed, same chains."""
        rng = np.random.default_rng(stream_of(seed, Stream.CHAINS, 0))
        places = places[np.sort(np.unique(places, axis=0, return_index=True)[1])]  # replicates share one
        start, density = _start(log_density, places, walkers, rng)
        return Walk(log_density, rng, [start[None]], [density[None]], [np.zeros((1, len(start)), bool)], most_steps)

    def until(self, enough: float = ENOUGH, most: float = np.inf) -> Chains:
        """Run until chains are `enough` autocorrelation times long, or have `most` steps or `most_steps`."""
        most = min(most, self.most_steps)
        times, burnt = self._times()
        while self.steps < most and self.steps - burnt < enough * times.max():
            self._go_to(int(min(self.steps + max(PIECE, self.steps // GROWTH), most)))
            times, burnt = self._times()
        thin = max(1, int(min(APART * times.max(), (self.steps - burnt) // FEWEST)))
        kept = slice(burnt + thin - 1, None, thin)
        return Chains(
            self.chain[kept].transpose(1, 0, 2),
            self._so_far(self.densities)[kept].T,
            self._so_far(self.moved).mean(axis=0),
            times,
            self.steps,
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
    def chain(self) -> Float[np.ndarray, "step walker coordinate"]:
        """All steps so far, burn-in included."""
        return self._so_far(self.places)

    @property
    def backend(self) -> Backend:
        """The same as emcee keeps chains."""
        backend, chain = Backend(), self.chain
        backend.reset(*chain.shape[1:])
        backend.chain, backend.log_prob = chain, self._so_far(self.densities)
        backend.accepted = self._so_far(self.moved).sum(axis=0).astype(float)
        backend.iteration = self.steps
        backend.random_state = np.random.RandomState(0).get_state()  # for emcee to go on with
        return backend

    def _go_to(self, steps: int) -> None:
        """Make as many steps, in whole blocks."""
        _, walkers, size = self.places[0].shape
        while sum(map(len, self.moved)) - 1 < steps:
            chance = Chance.of_steps(BLOCK, walkers, size, self.rng)
            found = stepped(self.log_density, self.places[-1][-1], self.densities[-1][-1], chance)
            for kept, new in zip((self.places, self.densities, self.moved), found, strict=True):
                kept.append(new)
        self.steps = steps

    def _so_far(self, blocks: list[np.ndarray]) -> np.ndarray:
        """What there is of every step, without the start."""
        return np.concatenate(blocks)[1 : self.steps + 1]

    def _times(self) -> tuple[Float[np.ndarray, " coordinate"], int]:
        """Autocorrelation times, and steps of burn-in."""
        if not self.steps:
            return np.full(self.places[0].shape[-1], np.inf), 0
        times = autocorrelation_time(self.chain[self.steps // 2 :].transpose(1, 0, 2))
        return times, int(min(PIECE / 2 + BURN_IN * times.max(), self.steps // 2))


def _suffice(x: Float[np.ndarray, "walker draw free"]) -> bool:
    """Whether chains are long enough for a result."""
    lengths = x.shape[1] / autocorrelation_time(x)
    return bool((lengths >= LONG).all() and ((lengths >= LONGEST).all() or (split_r_hat(x) <= ALIKE).all()))


def _start(
    log_density: LogDensity, places: Float[np.ndarray, "place free"], walkers: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "walker free"], Float[np.ndarray, " walker"]]:
    """Different places drawn by their density, without replacement (Gumbel's trick), and log densities."""
    density = densities(log_density, places)
    chosen = np.argsort(-(density + rng.gumbel(size=len(places))))[:walkers]
    return places[chosen], density[chosen]
