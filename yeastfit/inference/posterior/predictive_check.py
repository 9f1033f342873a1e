"""What a posterior says of data like those observed: simulated again at draws of λ, with as many replicates.

Of draws λ_i, i = 1..n, each gives statistics s_i, means over R colonies as the data o are. The band of a level holds
that share of the s_i, statistic by statistic. How far a data set is from them, all statistics together:

    T(y) = Σ_k ((y_k − m_k) / σ_k)²,    m, σ mean and standard deviation of the s_i and o together;
    p = (1 + number of the s_i with T(s_i) ≥ T(o)) / (1 + n),

a posterior predictive p-value (Gelman, Meng & Stern 1996, Statistica Sinica 6, 733), no less than 1 / (1 + n): near 0
the model with these parameters does not make such data; uniform it is not, as the data were used to find λ. Quantiles
are those between which one more draw would lie with that probability: of n draws in order, the k-th is at k / (n + 1).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.parameter_space import ALONE
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.simulator import Mismeasured, Simulator, Wrapper, root_of, seed_of, stream_of
from yeastfit.inference.targets import Targets
from yeastfit.measure.statistics.model_as_mask import mask_of
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.parameters import NAMES, Parameters
from yeastfit.model.relaxation import HARD
from yeastfit.simulation.simulate import member_keys, simulate
from yeastfit.storage import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST_P = 0.025  # from where it is said that the model does not make such data; the least that 40 draws can tell
FEWEST = 10  # draws, for a band to be one
FINE = 0.05  # L0, pixels of silhouettes


@dataclass(frozen=True)
class Replicates(Wrapper):
    """A simulator whose data sets are means over `count` data sets of another; nan where one of them is."""

    count: int

    def __post_init__(self) -> None:
        if self.count < 1:
            raise InputError(f"count is {self.count}, a mean needs at least 1")

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        """Replicate k of a data set has the k-th seed of the data set's own."""
        each = np.array([seed_of(int(seed), range(self.count)) for seed in seeds], dtype=np.int64).ravel()
        found = self.simulator(np.repeat(values, self.count, axis=0), each)
        return found.reshape(len(seeds), self.count, -1).mean(axis=1)


@dataclass(frozen=True)
class Predictive:
    """Result of `predict`. values: λ; statistics: of each, means over `replicates`, without those that failed."""

    free: tuple[str, ...]
    labels: tuple[str, ...]
    values: Float[np.ndarray, "draw free"]
    statistics: Float[np.ndarray, "draw statistic"]
    observed: Float[np.ndarray, " statistic"]
    replicates: int
    failed: int

    def band(self, level: float) -> Float[np.ndarray, "statistic 2"]:
        """Central interval of each statistic."""
        return self.quantiles([0.5 - 0.5 * level, 0.5 + 0.5 * level]).T

    def quantiles(self, shares: Sequence[float]) -> Float[np.ndarray, "share statistic"]:
        """Of each statistic."""
        return np.quantile(self.statistics, shares, axis=0, method="weibull")

    def inside(self, level: float) -> Bool[np.ndarray, " statistic"]:
        """Which observations lie in the band."""
        low, high = self.band(level).T
        return (low <= self.observed) & (self.observed <= high)

    @property
    def p_value(self) -> float:
        """p, see above."""
        every = np.vstack([self.observed, self.statistics])
        mean, sd = every.mean(axis=0), every.std(axis=0)
        apart = np.sum(((every - mean) / np.where(sd > 0, sd, 1.0)) ** 2, axis=1)
        return float(np.mean(apart >= apart[0]))

    def sentences(self) -> list[str]:
        """What is wrong; empty where all is well."""
        said = [] if not self.failed else [f"posterior predictive: {self.failed} draws came to nothing"]
        if (1 + len(self.values)) * LEAST_P < 1:
            said.append(
                f"posterior predictive: {len(self.values)} draws are too few to tell data that the model does not "
                f"make, {round(1 / LEAST_P) - 1} are needed"
            )
        if self.p_value <= LEAST_P:
            away = [label for label, one in zip(self.labels, self.inside(0.99), strict=True) if not one]
            where = f", mostly by {', '.join(away)}" if away else ""
            said.append(
                f"posterior predictive: p = {self.p_value:.3f}, the model with these parameters hardly makes such "
                f"data{where}: look at their curves, pixel size and times, and at what was held fixed"
            )
        return said

    def rows(self) -> list[dict[str, Any]]:
        """A row for each statistic: observed, and what was predicted."""
        shares = (0.05, 0.25, 0.5, 0.75, 0.95)
        quantiles = self.quantiles(shares).T.tolist()
        names = [f"q{100 * share:02.0f}" for share in shares]
        rows = zip(self.labels, self.observed.tolist(), quantiles, self.inside(0.9).tolist(), strict=True)
        return [
            {"statistic": label, "observed": seen, **dict(zip(names, each, strict=True)), "inside_90": within}
            for label, seen, each, within in rows
        ]

    def save(self, path: str | Path) -> None:
        """All of it as one .npz file."""
        with written_whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **vars(self))

    @staticmethod
    def load(path: str | Path) -> "Predictive":
        """What `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            read = {name: file[name] for name in Predictive.__dataclass_fields__}
        plain = {name: tuple(read[name].tolist()) for name in ("free", "labels")}
        plain |= {name: read[name].item() for name in ("replicates", "failed")}
        return Predictive(**{**read, **plain})

    def plot(self, targets: Targets) -> "Figure":
        """Bands over the data. targets: those whose values `observed` are."""
        from yeastfit.plot.posterior import predictive

        return predictive(self, targets)


def predict(
    samples: Samples,
    simulator: Simulator,
    observed: Float[np.ndarray, " statistic"],
    *,
    replicates: int = 1,
    noise: Float[np.ndarray, "statistic statistic"] | None = None,
    draws: int = 40,
    seed: int = 0,
) -> Predictive:
    """Simulates at `draws` draws of the samples, `replicates` data sets each, the same ones for the same seed.

    simulator: of one data set. noise: covariance of the mean's errors of measurement. Raises `InputError` for
    fewer than `FEWEST` draws, or where fewer came to something.
    """
    if draws < FEWEST:
        raise InputError(f"draws is {draws}, a predictive check needs at least {FEWEST}")
    if simulator.free != samples.free or len(simulator.labels) != len(observed):
        raise InputError(
            f"simulator is of {simulator.free} and {len(simulator.labels)} statistics, the samples of {samples.free} "
            f"and the data of {len(observed)}"
        )
    values = samples.drawn(draws, np.random.default_rng(stream_of(seed, 4, 0)))
    seeds = np.array([stream_of(seed, 4, 1, k).generate_state(1)[0] for k in range(draws)], dtype=np.int64)
    means: Simulator = Replicates(simulator, replicates)
    if noise is not None:
        means = Mismeasured(means, root_of(noise))
    statistics = means(values, seeds)
    came = np.isfinite(statistics).all(axis=1)
    if came.sum() < FEWEST:
        raise InputError(f"draws: {came.sum()} of {draws} came to something, a predictive check needs {FEWEST}")
    return Predictive(
        samples.free,
        simulator.labels,
        values[came],
        statistics[came],
        observed,
        replicates,
        int(draws - came.sum()),
    )


def silhouettes(
    values: Float[np.ndarray, "draw free"], simulator: ColonySimulator, time: float, seed: int = 0
) -> list[Bool[np.ndarray, "x y"]]:
    """One colony at each row of λ, grown to `time`: where its cells are, on pixels of `FINE`, centred on its start."""
    numerics = simulator.colonies.curves.numerics
    logs = simulator.space.log_parameters(ALONE, np.log(values))
    parameters = Parameters(**{name: jnp.exp(jnp.asarray(logs[:, k])) for k, name in enumerate(NAMES)})
    observe = SmoothStatistics(extent=numerics.domain, spacing=numerics.spacing)
    keys = member_keys(seed, len(values))
    grown = simulate(
        parameters, keys, times=[time], numerics=numerics, relaxation=HARD, observe=observe, throw=False
    ).colony
    places = np.abs(np.asarray(grown.positions)[np.asarray(grown.alive)])
    farthest = places.max(where=np.isfinite(places), initial=0.0)  # what is not finite is not in the picture
    reach = float(farthest) + 1.5
    points = 2 * int(np.ceil(reach / FINE)) + 1
    each = (jax.tree.map(itemgetter(k), (grown, parameters.aspect_ratio)) for k in range(len(values)))
    return [mask_of(colony, ratio, HARD, FINE * (points - 1), points) for colony, ratio in each]
