"""Posteriors by an emulator of the likelihood, trained in rounds where the posterior is.

1. λ of low discrepancy from the prior (scrambled Sobol') are simulated.
   Where too few of them are like the data to learn from, more are made where such are (`search`).
2. An emulator is trained on all simulations so far (`emulator`); chains sample its likelihood times the prior, briefly
   between rounds and at length after the last (`mcmc`).
3. Unless the posterior has settled, further λ are simulated: draws x + √(w² − 1) ξ in the prior's coordinates, x from
   the posterior and ξ ~ N(0, its covariance), which are w times as wide; the covariance is that of the bulk
   (`covariance_of_most`), as posteriors may have thin trails. Draws outside the prior are repeated. Then step 2 again.

**Settled**: from one round to the next no parameter's distribution moved by more than `settle` standard deviations, as
`apart` measures it by the median and the two quantiles around 68 % of the draws; and the emulator's share of error is
at most settle² (`error_share`, which says why both agree). Otherwise rounds go on until the simulations are spent. This
criterion is insensitive to rare outlying draws; a warning reports their fraction in the last two rounds.

**Elsewhere.** A posterior may have modes that the first rounds knew nothing of, and rounds that stay at one of them
settle. What has settled is therefore looked at from further away: half a round is simulated, colonies of the
posterior whose likelihood is raised to the power 1/R, which is that of a single colony of R (1/4 at most). For this,
and for what is seen then, the emulator is trained on all simulations. Where more than 5 % of the posterior lie far from
where it had settled, rounds go on from there; otherwise nothing changes. AWRI 796 at 500 µM settled at n* = 0.91 after
6144 simulations, none of them near n* = 0.4, where 99 % of the posterior turned out to be.

**Search, then refinement.** The first rounds train on all simulations. The posterior is found as soon as nearly all of
it lies where the last proposals are, or it moves less than a standard deviation; from then on rounds train on the
simulations in its neighbourhood alone, an ellipsoid of 1.6 w times its width, and their chains stay there. Few of a
prior's simulations of five parameters are near a posterior, and what they teach networks about the rest of the prior is
an error near it: of 6264 simulations of AWRI 796, 50 µM, 4369 are near; trained on these the emulator's error is 2.4 %
of the variance of the data, trained on all of them 9 %, and held-out colonies there have a higher density. A posterior
that leaves the proposals, and so may press against the edge of its neighbourhood, is searched anew.

As the likelihood is what is emulated, where the simulations were made does not influence the posterior other than
through the emulator's error (Papamakarios et al. 2019, arXiv:1805.07226): simulations of other runs, whatever their
method, are trained on as well (`Simulations.reused`). Where colonies may scatter (`prior.variation`), chains have
one coordinate more; as the emulator must know where single colonies are, x of a proposal is one colony of a draw, and
neighbourhoods are as wide. The prior is the condition's: its colonies may lie beyond it, and are simulated there. Every
step depends on the seed alone: a run that is repeated with the store of one that was stopped repeats its training and
its chains, simulates only what is missing, and ends with the same result.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.neural_likelihood import search
from yeastfit.inference.neural_likelihood.coordinates import Values
from yeastfit.inference.neural_likelihood.learner import Learner, Statistics
from yeastfit.inference.neural_likelihood.log_posterior import LogPosterior
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.posterior_of_rounds import posterior_of
from yeastfit.inference.neural_likelihood.training import fewest
from yeastfit.inference.neural_likelihood.training_rounds import STRAY, Round, proposed
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.settings import Setting, check_at_least
from yeastfit.inference.simulator import seed_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulations import Simulations
from yeastfit.memory import check_memory
from yeastfit.numbers import POSITIVE, Range
from yeastfit.progress import Progress
from yeastfit.seeds import Stream, stream_of

CHAIN = 32  # bytes of a step of a chain, at least
WIDEST = 1000.0  # proposals, in standard deviations of the posterior
WALKERS = 128  # chains, or fewer where there are fewer simulations
FIRST = 512  # simulations of the first round, where many are allowed
UNLOOKED = (
    "whether parameters far from these explain the data as well was not looked for: the simulations were spent, allow "
    "more"
)

More = tuple[Float[np.ndarray, "more free"], Float[np.ndarray, "more statistic"]]


@dataclass(frozen=True)
class SequentialEmulator:
    """An emulator of the likelihood, trained in rounds where the posterior is (module `neural_likelihood.sequential`).

    Attributes:
        simulations: At most.
        walkers: Chains, at most as many as simulations so far, at some of which they start.
        first: Simulations from the prior, a power of two; by default 512, or fewer where few are allowed.
        each: Simulations of every further round; by default as many as `first`.
        widen: w.
        settle: See above.
        most_steps: Of each chain.
        batch: Rows of every call of the simulator.
        training: Of the networks.
    """

    simulations: Annotated[int, Setting("Simulations at most, those of a resumed run included.", extends=True)] = 12_288
    walkers: Annotated[int, Setting("Number of chains, at most as many as simulations so far.")] = WALKERS
    first: Annotated[int | None, Setting("Simulations of the first round, a power of two; at most 512 by default.")] = (
        None
    )
    each: Annotated[int | None, Setting("Simulations of every further round; as the first by default.")] = None
    widen: Annotated[float, Setting("Width of the proposals of a round relative to the posterior's.")] = 2.5
    settle: Annotated[
        float, Setting("Largest change of the posterior, in standard deviations, that counts as settled.")
    ] = 0.2
    most_steps: Annotated[int, Setting("Steps of each chain at most.", extends=True)] = 20_000
    batch: Annotated[int, Setting("Simulations that run together.")] = 32
    training: TrainingSettings = field(default_factory=TrainingSettings)
    learns: ClassVar[bool] = True
    varies: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_at_least(self, simulations=2, first=2, each=1, walkers=4, most_steps=500, batch=1)
        what = f"most_steps · walkers is {self.most_steps} · {self.walkers}, which"
        check_memory(CHAIN * self.most_steps * self.walkers, what)
        if self.first is not None and self.first & (self.first - 1):
            raise InputError(f"first is {self.first}, it must be a power of two: Sobol' points are balanced then")
        if self.first is not None and self.simulations < self.first:
            raise InputError(
                f"simulations is {self.simulations}, it must be at least those of the first round, {self.first}"
            )
        Range(1.0, WIDEST).read(self.widen, "widen")
        POSITIVE.read(self.settle, "settle")

    @property
    def simulations_at_most(self) -> int:
        """Single simulations of a run, at most."""
        return self.simulations

    def resolved(self, free: int) -> "SequentialEmulator":
        """With `first`, `each` and steps of training for so many free parameters."""
        first, each = self.round_sizes(free)
        return replace(self, first=first, each=each, training=self.training.resolved(free))

    def round_sizes(self, free: int) -> tuple[int, int]:
        """`first` and `each` for so many free parameters.

        Where few simulations are allowed, `first` is half of them, or more where a quadratic needs more.
        """
        most = 2 ** int(np.log2(max(self.simulations, 4)))  # powers of two, all of them
        needed = 2 ** int(np.ceil(np.log2(2 * fewest(free, 0, self.training))))
        first = self.first or min(FIRST, max(most // 2, min(most, needed)))
        return first, self.each or first

    def run(self, problem: Problem, store: Simulations, seed: int, progress: Progress) -> Posterior:
        """Sample the posterior of a problem; see `Sampler`.

        `statistics` of the result are drawn from the emulator as means of the problem's replicates, `log_probability`
        is that in the prior's coordinates (and z), and `backend` holds the last round's chains.

        Raises:
            InputError: The settings do not suit the problem, or too many simulations fail.
        """
        first, each = self.round_sizes(len(problem.prior.free))
        values, statistics = store.reused
        inside = problem.admits(values)
        reused = int(inside.sum())
        self.check(len(problem.prior.free), len(problem.inferred_prior.free), len(problem.labels), reused)
        simulator = CachedSimulator(problem.simulator, self.batch, store)
        learner = Learner(
            problem,
            seed,
            self.training,
            self.widen,
            walkers=self.walkers,
            most_steps=self.most_steps,
            least=max(first, self.walkers),
            most=self.simulations,
            reused=(values[inside], statistics[inside]),
        )
        rounds, looks, warnings = _Rounds(simulator, problem, self, seed, first, each, learner).all(progress)
        found = posterior_of(
            rounds, looks, problem, simulator, seed, reused=reused, settle=self.settle, most_steps=self.most_steps
        )
        return found.warned(*warnings)

    def check(self, free: int, inferred: int, statistics: int, reused: int = 0) -> None:
        """See `Sampler`; with so many simulations of another run."""
        simulations, least = self.round_sizes(free)[0] + reused, fewest(free, statistics, self.training)
        if simulations < least:
            said = f"simulations is {self.simulations}" if self.first is None else f"first is {self.first}"
            raise InputError(
                f"{said}: the first round has {simulations} simulations, an emulator of {free} parameters and "
                f"{statistics} statistics needs at least {least}"
            )
        if self.walkers < 2 * inferred:
            raise InputError(f"walkers is {self.walkers}, {inferred} parameters need at least {2 * inferred}")
        if self.walkers > max(WALKERS, self.simulations + reused):
            raise InputError(
                f"walkers is {self.walkers}, and each starts at another simulation, of which there are "
                f"{self.simulations + reused} at most: give fewer chains, or more simulations"
            )


@dataclass(frozen=True)
class _Rounds:
    """A run under way."""

    simulator: CachedSimulator
    problem: Problem
    settings: SequentialEmulator
    seed: int
    first: int
    each: int
    learner: Learner

    def all(self, progress: Progress) -> tuple[list[Round], list[float], list[str]]:
        """Rounds until settled, or until the simulations are spent; what looks elsewhere found; and warnings."""
        most = self.settings.simulations
        values = self.problem.prior_values(self.first, self.seed)
        statistics = self._simulated(values, 0)
        whole = np.isfinite(statistics).all(axis=1)
        warnings = self.problem.unreached(statistics[whole]) if whole.any() else []
        while len(values) < most and (near := self._nearest(values, statistics)) is not None:
            progress("search", len(values) / most)
            rng = np.random.default_rng(stream_of(self.seed, Stream.SEARCH, len(values)))
            values, statistics = self._with_more(values, statistics, near, near, search.WIDEN, rng)
        rounds, looks = [self.learner.round(values, statistics, None)], list[float]()
        while True:
            while not rounds[-1].settled(self.settings.settle) and len(values) < most:
                progress(f"round {len(rounds)}", len(values) / most)
                rng = np.random.default_rng(stream_of(self.seed, Stream.PROPOSALS, len(rounds)))
                last, widen = rounds[-1], self.settings.widen
                values, statistics = self._with_more(values, statistics, last.draws, last.colonies, widen, rng)
                rounds.append(self.learner.round(values, statistics, rounds[-1]))
            if not rounds[-1].settled(self.settings.settle):
                break
            if len(values) + self.look > most:
                warnings.append(UNLOOKED)
                break
            progress("look elsewhere", len(values) / most)
            values, statistics = self._with_further_away(values, statistics)
            anew = self.learner.round(values, statistics, None)
            looks.append(1.0 - float(rounds[-1].neighbourhood.holds(anew.draws, self.settings.widen).mean()))
            if looks[-1] <= STRAY:
                break
            rounds.append(anew)
        density = LogPosterior(rounds[-1].emulator, self.problem)
        chains = rounds[-1].walk.until_long(lambda x: self.problem.inferred_values(*density.parts(x)))
        rounds[-1] = replace(rounds[-1], chains=chains)
        progress("done", 1.0)
        return rounds, looks, warnings

    @property
    def look(self) -> int:
        """Simulations of a look elsewhere: half of a round's."""
        return -(-self.each // 2)

    def _simulated(self, values: Values, start: int) -> Statistics:
        return self.simulator(values, seed_of(self.seed, range(start, start + len(values))))

    def _nearest(self, values: Values, statistics: Statistics) -> Float[np.ndarray, "near free"] | None:
        """Where to look for simulations like the data; None once there are enough of them (`search`)."""
        values, statistics = self.learner.with_reused(values, statistics)
        inside = self.problem.prior.contains(values)
        values, statistics = values[inside], statistics[inside]
        least = fewest(values.shape[1], statistics.shape[1], self.settings.training)
        return search.nearest(self.problem.prior.coordinates(values), statistics, self.problem.limits, least)

    def _with_further_away(self, values: Values, statistics: Statistics) -> More:
        """With draws of the posterior of a flatter likelihood, half as many as a round has."""
        x = self.learner.further_away(values, statistics)
        rng = np.random.default_rng(stream_of(self.seed, Stream.SEARCH, len(values)))
        return self._with(values, statistics, x[rng.choice(len(x), size=self.look)])

    def _with_more(
        self,
        values: Values,
        statistics: Statistics,
        draws: Float[np.ndarray, "draw free"],
        colonies: Float[np.ndarray, "draw free"],
        widen: float,
        rng: np.random.Generator,
    ) -> More:
        """With the first of a whole round's proposals, so that a longer run uses each of them."""
        x = proposed(draws, colonies, self.each, widen, self.problem.prior, self.problem.admits, rng)
        return self._with(values, statistics, x)

    def _with(self, values: Values, statistics: Statistics, x: Float[np.ndarray, "new free"]) -> More:
        """With as many simulations at the first of these places as are allowed."""
        new = self.problem.prior.values(x[: self.settings.simulations - len(values)])
        more = self._simulated(new, len(values))
        return np.concatenate([values, new]), np.concatenate([statistics, more])
