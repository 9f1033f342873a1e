"""Simulation-based calibration of any sampler on any simulator, over the prior or near the data observed.

Over the prior, true λ are drawn from it, data are simulated at them, and the truth is ranked among the draws of the
posterior of its data. Near observed data o, true λ are drawn from the posterior p(λ | o), data y are simulated at them,
and the truth is ranked in p(λ | o, y), the posterior of both: posterior simulation-based calibration (Säilynoja,
Schmitt, Bürkner & Vehtari 2025, arXiv:2502.03279), which judges a sampler where it is used. p(λ | o, y) is that of a
simulator of pairs of independent data sets.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.posterior.calibration_ranks import Calibration, ranks_of
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.samplers import chosen_sampler, infer, replicates_of
from yeastfit.inference.simulator import Rows, Seeds, Simulator, Values, Wrapper, check_simulator, seed_of
from yeastfit.inference.store.simulation_store import opened_store
from yeastfit.inference.store.simulations import Simulations
from yeastfit.memory import check_count
from yeastfit.numbers import AT_LEAST_ONE
from yeastfit.observable import Observable
from yeastfit.progress import Progress, progress_or_silent
from yeastfit.seeds import Stream, stream_of


@dataclass(frozen=True)
class PairedDataSets(Wrapper):
    """A simulator of two independent data sets at each λ, beside each other in a row."""

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Those of the simulator inside, and the same again."""
        each = self.simulator.observables
        return (*each, *(Observable(f"second {one.statistic}", one.time) for one in each))

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows of twice the width."""
        both = np.array([seed_of(int(seed), range(2)) for seed in seeds], dtype=np.uint64).ravel()
        return self.simulator(np.repeat(values, 2, axis=0), both).reshape(len(seeds), -1)


def calibrate(
    simulator: Simulator,
    over: Prior | Posterior,
    *,
    data_sets: int = 100,
    draws: int = 99,
    method: str | Sampler = "emulator",
    replicates: int = 1,
    noise: Float[np.ndarray, "statistic statistic"] | None = None,
    seed: int = 0,
    store: Simulations | str | Path | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Calibration:
    """Infer posteriors of simulated data, and rank the true parameters in them.

    Arguments:
        simulator: Simulates one replicate per row of parameters.
        over: The prior, for calibration over all of it; or the posterior of observed data, for calibration near them.
            A posterior brings its own prior, replicates and noise.
        data_sets: How many posteriors are inferred.
        draws: L, how many draws of its posterior a truth is ranked among: not more than they are worth.
        method: As `infer` has it.
        replicates: How many replicates a data set is the mean of.
        noise: Covariance of the errors of measurement of a data set.
        seed: Same seed, same ranks. All posteriors share it, and with it the simulations of their first round.
        store: Where simulations are kept, as `infer` has it; a calibration that was stopped goes on with it.
        progress: Called with what is being done and the share that is done.
        **settings: Of the method.

    Returns:
        Ranks of the data sets that have a posterior; `failed` says why others have none.

    Raises:
        InputError: An argument is wrong.
        SimulationError: No data set has a posterior.
    """
    check_simulator(simulator)
    chosen_sampler(method, settings)  # a wrong setting is no fault of a data set
    progress = progress_or_silent(progress)
    for name, count in (("data_sets", data_sets), ("draws", draws)):
        check_count(name, AT_LEAST_ONE.read_whole(count, name))
    near = over if isinstance(over, Posterior) else None
    prior = near.prior if near is not None else over
    if near is not None:
        replicates, noise = near.replicates, near.noise
        # ABC of this posterior may have compared single replicates with their mean
        settings = {**replicates_of(method, near.settings.get("replicates", 1)), **settings}
    blank = np.zeros(len(simulator.observables)) if near is None else near.observed
    one = Problem.of(simulator, prior, blank, replicates, noise)  # type: ignore[arg-type]
    make, both = one.data_sets(simulator, replicates), simulator if near is None else PairedDataSets(simulator)
    if near is not None and noise is not None:
        noise = block_diag(noise, noise)
    truths, ranks, failed, warned = [], [], list[str](), 0
    with opened_store(store, both) as simulations:
        for k in range(data_sets):
            progress(f"data set {k + 1} of {data_sets}", k / data_sets)
            rng = np.random.default_rng(stream_of(seed, Stream.TRUTH, k))
            truth = near.drawn(1, rng) if near is not None else one.prior.sample(1, rng)
            data = make(truth, rng.integers(2**32, size=1).astype(np.uint64))[0]
            observed = data if near is None else np.concatenate([near.observed, data])
            how: dict[str, Any] = {"replicates": replicates, "noise": noise, "seed": seed, "store": simulations}
            try:
                found = infer(both, one.prior, observed, method=method, **how, **settings)
            except (InputError, SimulationError) as error:
                failed.append(f"data set {k + 1}: {error}")
                continue
            truths.append(truth[0])
            ranks.append(ranks_of(found, truth[0], draws, rng))
            warned += bool(found.sentences())
    if not ranks:
        raise SimulationError(f"none of {data_sets} data sets has a posterior: {failed[0]}")
    each, joint = zip(*ranks, strict=True)
    arrays = np.array(truths), np.array(each), np.array(joint)
    return Calibration(one.prior.free, *arrays, draws, near is not None, warned, tuple(failed))
