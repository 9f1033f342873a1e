"""What simulations say of a posterior: an emulator trained on them, and chains on what it thinks of the likelihood."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.neural_likelihood.coordinates import Values
from yeastfit.inference.neural_likelihood.error_share import error_share
from yeastfit.inference.neural_likelihood.log_posterior import LogPosterior
from yeastfit.inference.neural_likelihood.mcmc import BRIEFLY, LONGER, ROUGHLY, Walk
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.training import fewest, train
from yeastfit.inference.neural_likelihood.training_rounds import FOUND, Neighbourhood, Round, Simulated, together
from yeastfit.inference.posterior.limits import BEYOND
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.robust_summary import apart
from yeastfit.seeds import Stream, stream_of

FLATTER = 4  # times as flat is a log-likelihood at least by which other places are looked for

Statistics = Float[np.ndarray, "row statistic"]


@dataclass(frozen=True)
class Learner:
    """Makes posteriors of simulations.

    Attributes:
        problem: Data and prior.
        seed: Of the run.
        training: Of the networks.
        widen: w, how much wider than the posterior proposals are.
        walkers: Chains.
        most_steps: Of each chain.
        least: Simulations that an emulator must have to be restricted to a neighbourhood.
        most: Simulations of this run at most.
        reused: λ and statistics of other runs.
    """

    problem: Problem
    seed: int
    training: TrainingSettings
    widen: float
    walkers: int
    most_steps: int
    least: int
    most: int
    reused: Simulated

    def round(self, values: Values, statistics: Statistics, before: Round | None) -> Round:
        """Train on all simulations, or those around the round before, and sample the posterior, roughly.

        Arguments:
            values: λ of this run's simulations.
            statistics: Of these.
            before: The round before; None to begin anew.
        """
        values, statistics = self.with_reused(values, statistics)
        density, walk = self._learnt(values, statistics, before)
        chains = walk.until(ROUGHLY, LONGER if before is not None and before.found else BRIEFLY)
        drawn, z = density.parts(chains.flat)
        colonies = self._colonies(drawn, z, len(values))
        moved = np.inf if before is None else float(apart(chains.flat, before.chains.flat).max())
        middle = self.problem.prior.values(drawn.mean(axis=0)[None])
        share = error_share(density.emulator, self.problem, self.problem.places(middle, z.mean(axis=0)[None]))
        inside = before is not None and before.neighbourhood.surrounds(drawn, self.widen)
        where = Neighbourhood.of(drawn, colonies, self.widen)
        found = moved <= FOUND or inside
        return Round(density.emulator, walk, chains, drawn, colonies, where, moved, share, len(values), found)

    def further_away(self, values: Values, statistics: Statistics) -> Float[np.ndarray, "draw free"]:
        """Colonies of a flatter likelihood's posterior, wherever the emulator of all simulations thinks it may be."""
        power = 1.0 / max(self.problem.replicates, FLATTER)
        density, walk = self._learnt(*self.with_reused(values, statistics), None, power)
        return self._colonies(*density.parts(walk.until(ROUGHLY, BRIEFLY).flat), len(values))

    def _colonies(
        self, x: Float[np.ndarray, "draw free"], z: Float[np.ndarray, "draw varied"], number: int
    ) -> Float[np.ndarray, "draw free"]:
        """One colony of each draw, in the prior's coordinates; number: of simulations so far."""
        variation, rng = self.problem.variation, np.random.default_rng(stream_of(self.seed, Stream.COLONIES, number))
        return x if variation is None else self.problem.scattered(x, variation.tau(z), rng)

    def _learnt(
        self, values: Values, statistics: Statistics, before: Round | None, power: float = 1.0
    ) -> tuple[LogPosterior, Walk]:
        """The posterior by an emulator of all simulations, or of those around the round before, and chains to walk."""
        statistics, x = self.problem.of_their_kind(statistics), self.problem.prior.coordinates(values)
        known = None
        if before is not None and before.found:
            known = before.neighbourhood.kept_to(before.draws, x, self.widen, self.least)
        chosen = np.ones(len(x), dtype=bool) if known is None else known(x)
        self._check_like_data(statistics[chosen])
        emulator = train(
            values[chosen],
            statistics[chosen],
            prior=self.problem.prior,
            labels=self.problem.labels,
            seed=self.seed,
            settings=self.training,
            near=None if before is None else before.neighbourhood.holds(x[chosen], self.widen),
            room=self.most + len(self.reused[0]),
        )
        whole = chosen & np.isfinite(statistics).all(axis=1) & self.problem.prior.contains(values)
        density = LogPosterior(emulator, self.problem, known, power)
        walk = Walk.start(
            density.program,
            self._with_z(x[whole]),
            walkers=self.walkers,
            most_steps=self.most_steps,
            seed=self.seed,
        )
        return density, walk

    def _check_like_data(self, statistics: Statistics) -> None:
        """Raise `InputError` where too few simulations lie within the limits around the data to learn from."""
        if self.problem.limits is None:
            return
        came, free = int(np.isfinite(statistics).all(axis=1).sum()), len(self.problem.prior.free)
        least = fewest(free, len(self.problem.labels), self.training)
        if came < least:
            raise InputError(
                f"{came} of {len(statistics)} simulations succeeded and are like the data, within {BEYOND:g} times "
                f"their range of them; an emulator of {free} parameters and {len(self.problem.labels)} statistics "
                f"needs at least {least}: allow more simulations, or give more colonies, whose range is surer"
            )

    def with_reused(self, values: Values, statistics: Statistics) -> Simulated:
        """This run's simulations and those of others, each once."""
        return together((values, statistics), self.reused)

    def _with_z(self, x: Float[np.ndarray, "place free"]) -> Float[np.ndarray, "place coordinate"]:
        """Places where chains may start, with z from its prior where colonies scatter."""
        if self.problem.variation is None:
            return x
        rng = np.random.default_rng(stream_of(self.seed, Stream.COLONIES, 0))
        return np.column_stack([x, rng.standard_normal(len(x))])
