"""Posteriors by an emulator of the likelihood, learnt in rounds where the posterior is.

1. λ of low discrepancy from the prior (scrambled Sobol') are simulated.
2. An emulator learns from all simulations so far (`emulator`); chains sample its likelihood times the prior, for long
   once the rounds are over and briefly before (`posterior_chain`).
3. Unless the posterior has settled, further λ are simulated: draws x + √(w² − 1) ξ, in the prior's coordinates, x from
   the posterior and ξ ~ N(0, its covariance), which has w times its width; of one with a trail, the covariance of most
   of it (`covariance_of_most`). Those outside the prior are drawn again. Then 2. again.

**Settled**: from one round to the next no parameter's law moved by more than `settle` standard deviations, which
`apart` reads off the shares of draws below the median and the two quantiles that hold 68 %; and the emulator's error is
at most settle² of the variance that the data are compared with, so that it moves a mean by some `settle` standard
deviations or less. Else rounds go on until the budget of simulations is spent. Of rare draws far off this says nothing:
how many there are is less certain, and a warning has their share in the last two rounds.

As the likelihood is what is learnt, where the simulations were made has no influence on the posterior but by the
emulator's error (Papamakarios et al. 2019, arXiv:1805.07226): those of other runs, whatever their method, serve as
well. Every step depends on the seed alone: a run that is repeated with the store of simulations of one that was stopped
repeats its training and its chains, simulates only what is missing, and comes to the same result.
"""

import time as clock
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import chi2

from yeastfit.errors import InputError
from yeastfit.inference.abc.pilot import first_values, unreached
from yeastfit.inference.neural_likelihood.emulator import Emulator, Square, train
from yeastfit.inference.neural_likelihood.mcmc import BRIEFLY, ROUGHLY, Chains, Posterior, Walk
from yeastfit.inference.neural_likelihood.settings import EmulatedSettings, Given, all_once, usable
from yeastfit.inference.posterior.diagnostics import diagnose
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.robust_summary import apart, covariance_of_most, far_off
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.posterior.simulation_store import Recorded, Store
from yeastfit.inference.simulator import Simulator, Stream, labels_of, seed_of, stream_of
from yeastfit.progress import Progress, silent

NEAR = 0.99  # of draws w times as wide as the posterior with its trail: where simulations check the emulator
LARGEST_ERROR = 0.3  # of the variance of the data, from which the emulator's error is warned of
FEW = 0.01  # of the draws, from which those far off are warned of
TRIES = 100  # rounds of drawing again what fell outside the prior


def emulated(
    simulator: Simulator,
    prior: Prior,
    observed: Float[np.ndarray, " statistic"],
    settings: EmulatedSettings | None = None,
    *,
    replicates: int = 1,
    noise: Square | None = None,
    seed: int = 0,
    store: Store | None = None,
    given: Given | None = None,
    path: str | Path | None = None,
    progress: Progress | None = None,
) -> Samples:
    """The posterior of λ given the mean statistics of R replicates.

    noise: covariance of errors of that mean which come from measuring, and which replicates do not average out. store:
    of simulations, see above. given: λ and statistics of further ones, to learn from as well; they do not count as
    simulations of this run. path: of an HDF5 file for the last round's chains, burn-in included and in the prior's
    coordinates, as emcee's `HDFBackend` reads it. `statistics` of the result are drawn from the emulator, as means of R
    replicates; `log_probability` is that in the prior's coordinates; the emulator's checks, round by round, are in
    `diagnostics`. Raises `InputError`, also where too many simulations fail.
    """
    began = clock.perf_counter()
    settings = settings or EmulatedSettings()
    known = usable(given, prior, len(labels_of(simulator)))
    settings.check(simulator, prior, observed, replicates, noise, len(known[0]))
    run = _Run(Recorded(simulator, settings.batch, store), prior, observed, replicates, noise, settings, seed, known)
    found, said = run.rounds(progress or silent)
    if path is not None:
        found[-1].walk.save(path)
    return run.samples(found, clock.perf_counter() - began).warned(*said)


@dataclass(frozen=True)
class Round:
    """One round's emulator and chains. walk: what could make these longer.

    mean, covariance: of the prior's coordinates. moved: how far `apart` it is from the round before, of all parameters
    the farthest. error_share: of the emulator's error in the variance that data are compared with, at the mean.
    """

    emulator: Emulator
    walk: Walk
    chains: Chains
    mean: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]
    moved: float
    error_share: float


def proposed(
    draws: Float[np.ndarray, "draw free"], count: int, widen: float, prior: Prior, rng: np.random.Generator
) -> Float[np.ndarray, "count free"]:
    """Where simulations are made: around draws of the posterior, w times as wide as most of it, in x of the prior."""
    root = np.sqrt(widen**2 - 1.0) * np.linalg.cholesky(covariance_of_most(draws))
    found = np.zeros((0, draws.shape[1]))
    for _ in range(TRIES):
        x = draws[rng.integers(len(draws), size=count)]
        x = x + rng.standard_normal(x.shape) @ root.T
        found = np.concatenate([found, x[np.isfinite(prior.log_density_of_coordinates(x))]])
        if len(found) >= count:
            return found[:count]
    raise InputError(f"widen is {widen:g}: with it hardly a draw lies in the prior, lower it")


def far_draws(
    draws: Float[np.ndarray, "draw free"], before: Float[np.ndarray, "draw2 free"] | None, prior: Prior
) -> list[str]:
    """In words, how many draws of the last round, and of the one before, are far off, and where. In x of the prior."""
    far = far_off(draws, draws)
    if far.mean() < FEW:
        return []
    low, high = prior.values(np.quantile(draws[far], [0.05, 0.95], axis=0)).tolist()
    where = ", ".join(f"{one} {a:.3g} to {b:.3g}" for one, a, b in zip(prior.free, low, high, strict=True))
    then = "" if before is None else f", {100 * far_off(before, draws).mean():.1f} % did in the round before"
    return [
        f"{100 * far.mean():.1f} % of the draws lie far from the others ({where}){then}: how many do is the least "
        "certain part of a posterior, and so are quantiles that reach there"
    ]


@dataclass(frozen=True)
class _Run:
    recorded: Recorded
    prior: Prior
    observed: Float[np.ndarray, " statistic"]
    replicates: int
    noise: Square | None
    settings: EmulatedSettings
    seed: int
    given: Given

    def rounds(self, say: Progress) -> tuple[list[Round], list[str]]:
        """Until settled, or the budget is spent; also what of the data the prior does not reach, in words."""
        most = self.settings.most
        values = first_values(self.prior, self.settings.first, self.seed)
        statistics = self._simulated(values, 0)
        came = np.isfinite(statistics).all(axis=1)
        said = unreached(statistics[came], self.observed, self.recorded.labels) if came.any() else []
        done = [self._round(values, statistics, None)]
        while not self._settled(done[-1]) and len(values) < most:
            say(f"round {len(done)}", len(values) / most)
            new = self._proposals(done[-1], min(self.settings.each, most - len(values)), len(done))
            statistics = np.concatenate([statistics, self._simulated(new, len(values))])
            values = np.concatenate([values, new])
            done.append(self._round(values, statistics, done[-1]))
        done[-1] = replace(done[-1], chains=done[-1].walk.until())
        say("done", 1.0)
        return done, said

    def _simulated(self, values: Float[np.ndarray, "row free"], start: int) -> Float[np.ndarray, "row statistic"]:
        return self.recorded(values, seed_of(self.seed, range(start, start + len(values))))

    def _round(
        self,
        values: Float[np.ndarray, "row free"],
        statistics: Float[np.ndarray, "row statistic"],
        before: Round | None,
    ) -> Round:
        values, statistics = all_once(values, statistics, self.given)
        near = None if before is None else self._near(values, before)
        emulator = train(
            values,
            statistics,
            prior=self.prior,
            labels=self.recorded.labels,
            seed=self.seed,
            settings=self.settings.emulator,
            near=near,
            room=self.settings.most + len(self.given[0]),
        )
        came = np.isfinite(statistics).all(axis=1)
        walk = Walk.start(
            Posterior(emulator, self.prior, self.observed, self.replicates, self.noise),
            self.prior.coordinates(values[came]),
            walkers=self.settings.walkers,
            most_steps=self.settings.most_steps,
            seed=self.seed,
        )
        chains = walk.until(ROUGHLY, BRIEFLY if before is None else np.inf)
        mean, covariance = chains.flat.mean(axis=0), np.atleast_2d(np.cov(chains.flat, rowvar=False))
        moved = np.inf if before is None else float(apart(chains.flat, before.chains.flat).max())
        return Round(emulator, walk, chains, mean, covariance, moved, self._error_share(emulator, mean))

    def _settled(self, one: Round) -> bool:
        return one.moved <= self.settings.settle and one.error_share <= self.settings.settle**2

    def _near(self, values: Float[np.ndarray, "row free"], last: Round) -> Bool[np.ndarray, " row"]:
        off = self.prior.coordinates(values) - last.mean
        distance = np.einsum("rf,rf->r", off, np.linalg.solve(last.covariance, off.T).T)
        return distance <= self.settings.widen**2 * chi2.ppf(NEAR, len(last.mean))

    def _proposals(self, last: Round, count: int, number: int) -> Float[np.ndarray, "row free"]:
        """As many of a whole round's, the same whatever the count is: a longer run has use for each of them."""
        rng = np.random.default_rng(stream_of(self.seed, Stream.PROPOSALS, number))
        whole = proposed(last.chains.flat, max(count, self.settings.each), self.settings.widen, self.prior, rng)
        return self.prior.values(whole[:count])

    def samples(self, rounds: list[Round], seconds: float) -> Samples:
        """The last round's chains."""
        last = rounds[-1]
        chains, draws, free = last.chains.x.shape
        values = self.prior.values(last.chains.flat)
        rng = np.random.default_rng(stream_of(self.seed, Stream.DRAWS, 0))
        found = Samples(
            free=self.prior.free,
            values=values.reshape(chains, draws, free),
            weights=np.full((chains, draws), 1.0 / (chains * draws)),
            log_probability=last.chains.log_density,
            acceptance=last.chains.acceptance,
            labels=self.recorded.labels,
            statistics=last.emulator.draw(values, rng, self.replicates, self.noise).reshape(chains, draws, -1),
            simulations=self.recorded.asked,
            seconds=seconds,
            seed=self.seed,
            method="emulator",
            settings={
                **asdict(self.settings),
                "prior": self.prior.asdict(),
                "observed": self.observed.tolist(),
                "replicates": self.replicates,
                "given": len(self.given[0]),
                "noise": None if self.noise is None else self.noise.tolist(),
            },
            diagnostics={
                "rounds": [self._said(one) for one in rounds],
                "steps": last.chains.steps,
                "autocorrelation_time": last.chains.times.tolist(),
                "chains": diagnose(last.chains.x, free=self.prior.free, acceptance=last.chains.acceptance).asdict(),
            },
        )
        before = rounds[-2].chains.flat if len(rounds) > 1 else None
        far = far_draws(last.chains.flat, before, self.prior)
        return found.warned(*self._warnings(last), *far)

    def _said(self, one: Round) -> dict[str, Any]:
        """What is kept of a round."""
        held_out = one.emulator.held_out
        return {
            "simulations": one.emulator.simulations,
            "failed": one.emulator.failed,
            "moved": one.moved,
            "error_share": one.error_share,
            "settled": self._settled(one),
            "held_out": {**asdict(held_out), "sentences": held_out.sentences()},
        }

    def _error_share(self, emulator: Emulator, mean: Float[np.ndarray, " free"]) -> float:
        _, scatter, error, _ = emulator.moments(self.prior.values(mean[None]))
        total = scatter[0] / self.replicates + error[0] + (0.0 if self.noise is None else self.noise)
        return float(np.trace(np.linalg.solve(total, error[0])) / len(total))

    def _warnings(self, last: Round) -> list[str]:
        said = [*self.recorded.notes, *last.emulator.held_out.sentences()]
        settle, share = self.settings.settle, last.error_share
        if not self._settled(last):
            moved = f"it moved by {last.moved:.2f} standard deviations in the last round, {settle:g} is wanted"
            if np.isinf(last.moved):
                moved = "whether one round more would move it is not known"
            said.append(
                f"the posterior has not settled: {moved}, the emulator's error is {100 * share:.1f} % of the variance "
                f"of the data, {100 * settle**2:g} % is wanted; {self.recorded.asked} simulations were allowed: allow "
                "more"
            )
        if share > LARGEST_ERROR:
            said.append(
                f"the emulator's error is {100 * share:.0f} % of the variance of the data and widens the posterior: "
                "more simulations narrow it"
            )
        found = diagnose(last.chains.x, free=self.prior.free, acceptance=last.chains.acceptance)
        return said + found.sentences()
