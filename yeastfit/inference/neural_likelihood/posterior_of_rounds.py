"""The posterior that the last round of a sequential emulator has, with what the rounds say of it."""

import numpy as np

from yeastfit.inference.neural_likelihood.log_posterior import LogPosterior
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics, RoundDiagnostics
from yeastfit.inference.neural_likelihood.single_colonies import excess_scatter, wide_scatter
from yeastfit.inference.neural_likelihood.training_rounds import Round, far_draws, unsettled
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.seeds import Stream, stream_of


def posterior_of(
    rounds: list[Round],
    looks: list[float],
    problem: Problem,
    simulator: CachedSimulator,
    seed: int,
    *,
    reused: int,
    settle: float,
    most_steps: int,
) -> Posterior:
    """The last round's chains as a posterior.

    Arguments:
        rounds: All of them; the chains of the last are long.
        looks: What looks elsewhere found.
        problem: Data and prior.
        simulator: That the rounds have asked.
        seed: Of the run.
        reused: How many simulations of other runs there are.
        settle: Largest change that counts as settled.
        most_steps: Of each chain.
    """
    last, before = rounds[-1], rounds[-2].draws if len(rounds) > 1 else None
    chains, settled = last.chains, last.settled(settle)
    shape = chains.x.shape[:2]
    density = LogPosterior(last.emulator, problem)
    x, z = density.parts(chains.flat)
    rng, noise = np.random.default_rng(stream_of(seed, Stream.DRAWS, 0)), (problem.noise, problem.single_noise)
    statistics = last.emulator.draw(problem.places(problem.prior.values(x), z), rng, problem.replicates, *noise)
    values = problem.inferred_values(x, z)
    posterior = Posterior.of(
        problem,
        values.reshape(*shape, -1),
        simulations=simulator.asked,
        log_probability=chains.log_density,
        log_likelihood=chains.log_density - density.log_prior(x, z).reshape(shape),
        acceptance=chains.acceptance,
        statistics=statistics.reshape(*shape, -1),
        status=None if settled else Status.STILL_MOVING,
        warnings=[
            *simulator.store.notes,
            *unsettled(last, settle, simulator.asked, settled),
            *far_draws(x, before, problem.prior),
            *(
                wide_scatter(problem.variation, float(values[:, -1].mean()))
                if problem.variation
                else excess_scatter(last.emulator, problem, problem.prior.values(last.draws.mean(axis=0)[None]))
            ),
        ],
        diagnostics=EmulatorDiagnostics(
            tuple(_reported(one, settle) for one in rounds),
            chains.steps,
            reused,
            tuple(looks),
        ),
        backend=last.walk.backend,
    )
    if posterior.status is Status.CHAINS_TOO_SHORT and chains.steps >= most_steps:
        ended = (
            f"chains ended after {chains.steps} steps, which is all that --most-steps (most_steps) allows: allow more"
        )
        return posterior.warned(ended)
    return posterior


def _reported(one: Round, settle: float) -> RoundDiagnostics:
    emulator, settled = one.emulator, one.settled(settle)
    return RoundDiagnostics(
        one.simulations, emulator.failed, one.moved, one.error_share, settled, emulator.cross_validation
    )
