"""Posterior predictive check: data simulated at draws of the posterior, with as many replicates as were observed.

Draws λ_i, i = 1..n, each give statistics s_i, means over R replicates as the data o are; where colonies scatter
(`variation`), each replicate has a λ of its own. The band of a level holds that share of the s_i, statistic by
statistic. Of all statistics together,

    T(y) = Σ_k ((y_k − m_k) / σ_k)²,    m, σ mean and standard deviation of the s_i and o together;
    p = (1 + number of the s_i with T(s_i) ≥ T(o)) / (1 + n),

a posterior predictive p-value (Gelman, Meng & Stern 1996, Statistica Sinica 6, 733), at least 1 / (1 + n). Near 0 the
model with these parameters does not make such data. It is not uniform, as the data were used to find λ. Quantiles are
those between which one more draw would lie with that probability: of n draws in order, the k-th is at k / (n + 1).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.posterior.draws import Draws, check_level
from yeastfit.inference.prior.variation import simulator_of_draws
from yeastfit.inference.simulator import Mismeasured, Replicates, Simulator, check_simulator, labels_of, root_of
from yeastfit.memory import check_count
from yeastfit.seeds import Stream, stream_of
from yeastfit.storage import reads_saved, written_whole
from yeastfit.text import quoted

LEAST_P = 0.025  # below, a warning says that the model does not make such data; 40 draws resolve just that
FEWEST = 10  # draws of a band
ROUNDS = 4  # of draws, until so many have succeeded


@dataclass(frozen=True, eq=False)
class Predictive:
    """Data sets predicted by a posterior, and the one observed.

    Attributes:
        free: Names of the parameters.
        labels: Names of the statistics.
        values: λ of each data set.
        statistics: Means over `replicates`.
        observed: The data.
        replicates: Replicates that a data set is the mean of.
        failed: Further draws whose simulations failed.
    """

    free: tuple[str, ...]
    labels: tuple[str, ...]
    values: Float[np.ndarray, "draw free"]
    statistics: Float[np.ndarray, "draw statistic"]
    observed: Float[np.ndarray, " statistic"]
    replicates: int
    failed: int

    def band(self, level: float) -> Float[np.ndarray, "statistic 2"]:
        """Central interval of each statistic. Raises `InputError` where the level is not in 0..1."""
        check_level(level)
        return self.quantiles([0.5 - 0.5 * level, 0.5 + 0.5 * level]).T

    def quantiles(self, shares: Sequence[float]) -> Float[np.ndarray, "share statistic"]:
        """Quantiles of each statistic."""
        return np.quantile(self.statistics, shares, axis=0, method="weibull")

    def inside(self, level: float) -> Bool[np.ndarray, " statistic"]:
        """Which observations lie in the band."""
        low, high = self.band(level).T
        return (low <= self.observed) & (self.observed <= high)

    @property
    def p_value(self) -> float:
        """Posterior predictive p-value p."""
        every = np.vstack([self.observed, self.statistics])
        mean, sd = every.mean(axis=0), every.std(axis=0)
        apart = np.sum(((every - mean) / np.where(sd > 0, sd, 1.0)) ** 2, axis=1)
        return float(np.mean(apart >= apart[0]))

    def sentences(self) -> list[str]:
        """What is wrong; empty where all is well."""
        sentences = [] if not self.failed else [f"posterior predictive: {self.failed} of the draws failed"]
        if (1 + len(self.values)) * LEAST_P < 1:
            sentences.append(
                f"posterior predictive: {len(self.values)} draws are too few to tell data that the model does not "
                f"make, {round(1 / LEAST_P) - 1} are needed"
            )
        if self.p_value <= LEAST_P:
            away = [label for label, inside in zip(self.labels, self.inside(0.99), strict=True) if not inside]
            where = f", mostly by {', '.join(away)}" if away else ""
            sentences.append(
                f"posterior predictive: p = {self.p_value:.3f}, the model with these parameters hardly makes such "
                f"data{where}: look at their curves, pixel size and times, and at what was held fixed"
            )
        return sentences

    def rows(self) -> list[dict[str, Any]]:
        """One row per statistic: observed value and predicted quantiles."""
        shares = (0.05, 0.25, 0.5, 0.75, 0.95)
        quantiles = self.quantiles(shares).T.tolist()
        names = [f"q{100 * share:02.0f}" for share in shares]
        rows = zip(self.labels, self.observed.tolist(), quantiles, self.inside(0.9).tolist(), strict=True)
        return [
            {"statistic": label, "observed": observed, **dict(zip(names, each, strict=True)), "inside_90": inside}
            for label, observed, each, inside in rows
        ]

    def save(self, path: str | Path) -> None:
        """All of it as one .npz file."""
        with written_whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **vars(self))

    @staticmethod
    @reads_saved("predictive check")
    def load(path: str | Path) -> "Predictive":
        """What `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            read = {name: file[name] for name in Predictive.__dataclass_fields__}
        plain = {name: tuple(read[name].tolist()) for name in ("free", "labels")}
        plain |= {name: read[name].item() for name in ("replicates", "failed")}
        return Predictive(**{**read, **plain})


def predict(
    draws_of: Draws, simulator: Simulator, *, draws: int = 40, seed: int = 0, prior: bool = False
) -> Predictive:
    """Simulate data like those observed at draws of a posterior.

    Arguments:
        draws_of: The posterior, with its data.
        simulator: Of one replicate.
        draws: How many data sets.
        seed: Same seed, same draws and simulations.
        prior: Whether λ is drawn from the prior instead.

    Raises:
        InputError: There are fewer than `FEWEST` draws, or the simulator has other parameters or statistics.
        SimulationError: Fewer than `FEWEST` draws succeeded.
    """
    check_simulator(simulator)
    if not isinstance(draws, int | np.integer) or draws < FEWEST:
        raise InputError(f"draws is {quoted(draws)}, a predictive check needs a whole number of at least {FEWEST}")
    check_count("draws", draws)
    labels, observed = labels_of(simulator), draws_of.observed
    if labels != tuple(draws_of.labels):
        raise InputError(f"simulator is of {', '.join(labels)}, the data of {', '.join(draws_of.labels)}")
    simulator = simulator_of_draws(simulator, draws_of.free, draws_of.varying)
    drawn, simulated = (2, 3) if prior else (0, 1)  # numbers of the streams of draws and of their simulations
    rng = np.random.default_rng(stream_of(seed, Stream.PREDICTIVE, drawn))
    means: Simulator = Replicates(simulator, draws_of.replicates)
    if draws_of.noise is not None:
        means = Mismeasured(means, root_of(draws_of.noise))
    values, statistics = np.zeros((0, len(draws_of.free))), np.zeros((0, len(labels)))
    whole = np.zeros(0, dtype=bool)
    for again in range(ROUNDS):
        more = draws_of.prior.sample(draws, rng) if prior else draws_of.drawn(draws, rng)
        streams = (stream_of(seed, Stream.PREDICTIVE, simulated, again * draws + k) for k in range(draws))
        seeds = np.array([stream.generate_state(1)[0] for stream in streams], dtype=np.uint64)
        values, statistics = np.concatenate([values, more]), np.concatenate([statistics, means(more, seeds)])
        whole = np.asarray(np.isfinite(statistics).all(axis=1))
        if whole.sum() >= FEWEST:
            break
    else:
        raise SimulationError(f"{whole.sum()} of {len(whole)} draws succeeded, a predictive check needs {FEWEST}")
    failed = int((~whole).sum())
    return Predictive(draws_of.free, labels, values[whole], statistics[whole], observed, draws_of.replicates, failed)
