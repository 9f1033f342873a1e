"""Leave colonies out of a posterior and predict them, from the simulations that the posterior was made of.

Colonies are dealt into K groups in the order of their names. For each group the posterior of all others is sampled, and
the group's colonies are predicted (`left_out`). An emulator of the likelihood is the same whatever the data are: it is
trained once, on all simulations there are, only the chains are run anew, and nothing is simulated. So every posterior
with enough simulations is checked in one way, whichever method has sampled it. Where λ may scatter between colonies,
chains sample its scatter too, and a colony is predicted at a λ of its own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from yeastfit.errors import InputError
from yeastfit.inference.comparison.left_out import SHARES, LeftOut, scale_of
from yeastfit.inference.comparison.predictive_mixture import PredictiveMixture
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.log_posterior import Ellipsoid, LogPosterior
from yeastfit.inference.neural_likelihood.mcmc import ROUGHLY, Walk
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.neural_likelihood.training import Statistics, Values, train
from yeastfit.inference.neural_likelihood.training_rounds import Neighbourhood
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.kinds import check_kind
from yeastfit.progress import Progress, progress_or_silent, silent
from yeastfit.seeds import Stream, stream_of
from yeastfit.text import natural_order

GROUPS = 5
MOST_DRAWS = 4000  # of each posterior that colonies are predicted from

Colonies = Float[np.ndarray, "colony statistic"]


def cross_validate(
    posterior: Posterior,
    problem: Problem,
    colonies: Colonies,
    simulations: tuple[Values, Statistics],
    *,
    groups: int = GROUPS,
    names: Sequence[str] = (),
    labels: Sequence[str] = (),
    settings: Sampler | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> LeftOut:
    """Predict every colony from the others.

    Arguments:
        posterior: Of all colonies; it says where the emulator must be right.
        problem: Whose posterior it is.
        colonies: Statistics of the single colonies, of which `problem.observed` is the mean; nan where one is missing.
        simulations: λ and statistics of single colonies, a row each, of nan for failures.
        groups: K, at most as many as there are colonies.
        names: Of the colonies; numbers where there are not as many names.
        labels: Of the statistics; by default the simulator's.
        settings: A sequential emulator, whose walkers, steps and training are taken; those by default for any other.
        seed: Same seed, same result.
        progress: Called with what is being done and the share that is done.

    Returns:
        Densities and ranks of the colonies.

    Raises:
        InputError: There are fewer than two colonies, groups are too few or too many, simulations are too few, or a
            statistic is of the colonies of one group alone.
    """
    check_kind("posterior", posterior, Posterior, "a yeastfit.Posterior")
    check_kind("problem", problem, Problem, "a yeastfit.Problem, which the posterior is of")
    check_kind("colonies", colonies, np.ndarray, "an array of numpy, [colony, statistic]")
    progress, count = progress_or_silent(progress), len(colonies)
    if count < 2:
        raise InputError(f"colonies: {count} is known by itself, one can be left out of at least two")
    if not 2 <= groups <= count:
        raise InputError(f"groups is {groups}, {count} colonies can be dealt into 2 to {count}")
    how = settings if isinstance(settings, SequentialEmulator) else SequentialEmulator()
    neighbourhood = _neighbourhood(posterior, problem, how.widen, seed)
    known = _known(posterior, problem, simulations[0], how, neighbourhood)
    emulator = _emulator(problem, simulations, how, seed, known, neighbourhood)
    called = tuple(names) if len(names) == count else tuple(str(r + 1) for r in range(count))
    group, doubts = dealt(called, groups), list[str]()
    starts = problem.prior.coordinates(simulations[0][_usable(problem, simulations)])
    if problem.variation is not None:
        rng = np.random.default_rng(stream_of(seed, Stream.COLONIES, 0))
        starts = np.column_stack([starts, rng.standard_normal(len(starts))])
    density, below = np.full(count, np.nan), np.full(colonies.shape, np.nan)
    quantiles = np.full((count, len(SHARES), colonies.shape[1]), np.nan)
    for k in range(groups):
        progress("leaving colonies out", k / groups)
        kept = without(problem, colonies[group != k])
        posterior_of_kept = LogPosterior(emulator, kept, known)
        walk = Walk.start(posterior_of_kept.program, starts, walkers=how.walkers, most_steps=how.most_steps, seed=seed)
        chains = walk.until(ROUGHLY)
        if chains.steps < ROUGHLY * chains.times.max():
            doubts.append(f"colonies left out: chains without group {k + 1} are too short, raise --most-steps")
        x, z = posterior_of_kept.parts(chains.flat[:: -(-len(chains.flat) // MOST_DRAWS)])
        places = problem.places(problem.prior.values(x), z)
        mixture = PredictiveMixture.of(emulator, places, problem.noise, single=problem.single_noise)
        for r in np.flatnonzero(group == k):
            seen = np.isfinite(colonies[r])
            density[r] = mixture.log_density(colonies[r]) if seen.all() else np.nan
            below[r] = np.where(seen, mixture.below(np.where(seen, colonies[r], 0.0)), np.nan)
            quantiles[r] = mixture.quantiles(np.array(SHARES))
    progress("leaving colonies out", 1.0)
    partly = [called[r] for r in range(count) if not np.isfinite(colonies[r]).all()]
    if partly:
        doubts.append(
            f"some statistics are missing of these colonies, whose density is not counted: {', '.join(partly)}"
        )
    unitless = density + np.log(scale_of(colonies)).sum()
    return LeftOut(tuple(labels) or problem.labels, called, colonies, group, unitless, below, quantiles, tuple(doubts))


def dealt(names: Sequence[str], groups: int) -> Int[np.ndarray, " colony"]:
    """The group of each colony: they are dealt in the order of their names."""
    in_order = sorted(range(len(names)), key=lambda r: (natural_order(names[r]), r))
    return np.argsort(in_order) % groups


def without(problem: Problem, kept: Colonies) -> Problem:
    """The problem whose data are these colonies alone.

    Raises:
        InputError: None of them has one of the statistics.
    """
    counts = np.isfinite(kept).sum(axis=0)
    if not counts.all():
        label = problem.labels[int(np.argmin(counts))]
        raise InputError(f"groups: {label} is of colonies of one group alone, give another number of groups")
    colonies = None if problem.colonies is None else kept[np.isfinite(kept).any(axis=1)]
    return replace(problem, observed=np.nanmean(kept, axis=0), replicates=int(counts.min()), colonies=colonies)


def _usable(problem: Problem, simulations: tuple[Values, Statistics]) -> np.ndarray:
    """Which simulations succeeded, of values that the prior allows."""
    values, statistics = simulations[0], problem.of_their_kind(simulations[1])
    return problem.prior.contains(values) & np.isfinite(statistics).all(axis=1)


def _emulator(
    problem: Problem,
    simulations: tuple[Values, Statistics],
    settings: SequentialEmulator,
    seed: int,
    known: Ellipsoid | None,
    neighbourhood: Neighbourhood,
) -> Emulator:
    """Trained on the simulations at places that are known, and checked in the neighbourhood."""
    values, statistics = simulations[0], problem.of_their_kind(simulations[1])
    chosen = problem.admits(values)
    if known is not None:
        chosen &= known(problem.prior.coordinates(values))
    return train(
        values[chosen],
        statistics[chosen],
        prior=problem.prior,
        labels=problem.labels,
        seed=seed,
        settings=settings.training,
        near=neighbourhood.holds(problem.prior.coordinates(values[chosen]), settings.widen),
    )


def _known(
    posterior: Posterior, problem: Problem, values: Values, settings: SequentialEmulator, neighbourhood: Neighbourhood
) -> Ellipsoid | None:
    """The neighbourhood that an emulator is restricted to, as in the last round of a posterior that has settled."""
    x = problem.prior.coordinates(values)
    least = max(settings.round_sizes(len(problem.prior.free))[0], settings.walkers)
    draws = problem.prior.coordinates(posterior.flat[:, : len(problem.prior.free)])
    return neighbourhood.kept_to(draws, x, settings.widen, least) if posterior.settled else None


def _neighbourhood(posterior: Posterior, problem: Problem, widen: float, seed: int) -> Neighbourhood:
    """Where colonies of the posterior's draws are."""
    free = len(problem.prior.free)
    x, tau = problem.prior.coordinates(posterior.flat[:, :free]), posterior.flat[:, free:]
    rng = np.random.default_rng(stream_of(seed, Stream.COLONIES, 1))
    return Neighbourhood.of(x, problem.scattered(x, tau, rng), widen, posterior.weights.ravel())
