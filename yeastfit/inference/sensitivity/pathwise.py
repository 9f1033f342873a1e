"""Pathwise derivatives of a mean: forward mode through single colonies of a relaxed model.

Exact derivatives of single colonies explode with the number of contacts; taming them (`Relaxation.turning`) makes them
quiet and biased, and none sees how λ changes the order of parents. No number of members tells by how much. So they are
taken of a model close to the hard one, half tamed, and only up to `PATH_NODES` nodes, where they cost little and a few
of them are as quiet as hundreds of runs. Their mean is one that outliers cannot carry away (`robust_mean`).
"""

from collections import Counter
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.sensitivity.result import Estimate, Means
from yeastfit.inference.simulator import Seeds
from yeastfit.model.colony import PROBLEMS
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import Relaxation
from yeastfit.seeds import keys_of
from yeastfit.simulation.simulate import schedule_of

COUNT = "cell_count"
PATH_NODES = 64  # of the mean colony, up to which pathwise derivatives are of use
EXPLODED = 3.0  # times the scatter of the members left as they are: the tails would decide a plain mean
OUTLIER = 5.0  # times its scale a derivative may be off the median


@dataclass(frozen=True)
class Paths:
    """Pathwise derivatives.

    Attributes:
        estimate: Of the mean's derivatives; nan where simulations were not differentiated.
        tails: How much outliers would have raised their scatter; 1 where there were none.
        problems: What simulations ran into.
    """

    estimate: Estimate
    tails: Means
    problems: Counter[str]


@runtime_checkable
class Pathwise(Protocol):
    """Derivatives of single simulations."""

    def __call__(
        self,
        values: Float[np.ndarray, " parameter"],
        seeds: Seeds,
        rows: Float[np.ndarray, "member statistic"],
        whole: bool,
    ) -> Paths | None:
        """Differentiate simulations.

        Arguments:
            values: λ.
            seeds: Of the simulations.
            rows: Of others at the same λ, which tell where derivatives are of use.
            whole: Whether to take them where they are of none, too.

        Returns:
            Nothing where they are of use nowhere.
        """


@dataclass(frozen=True)
class ColonyPaths:
    """Pathwise derivatives of colonies.

    Attributes:
        simulator: Of the model that is meant; it records all of `times`, and the number of cells.
        times: Of the curves.
        statistics: How many of the recorded ones are asked for.
        numerics: Of the model that is differentiated.
        relaxation: Likewise.
    """

    simulator: ColonySimulator
    times: Float[np.ndarray, " time"]
    statistics: int
    numerics: Numerics
    relaxation: Relaxation

    def __call__(
        self,
        values: Float[np.ndarray, " parameter"],
        seeds: Seeds,
        rows: Float[np.ndarray, "member statistic"],
        whole: bool,
    ) -> Paths | None:
        """Differentiate colonies, up to the last time at which they have `PATH_NODES` nodes, or whole."""
        curves = self.simulator.curves
        recorded = len(curves.names)
        counts = rows.reshape(len(rows), recorded, -1)[:, curves.names.index(COUNT)]
        nodes = counts[np.isfinite(counts).all(axis=1)].mean(axis=0) + 1
        sampled = len(self.times) if whole else int(np.sum(nodes <= PATH_NODES))
        if not sampled:
            return None
        schedule = schedule_of(self.times[:sampled], self.numerics)
        relaxed = replace(curves, numerics=self.numerics, relaxation=self.relaxation, schedule=schedule)
        z = jnp.asarray(self.simulator.logarithms(values[None])[0], jnp.result_type(float))
        grown, tangents = relaxed.members_with_tangents(z, keys_of(seeds))
        met = np.asarray(grown)[:, -len(PROBLEMS) :].sum(axis=0).astype(int).tolist()
        by_curve = np.asarray(tangents)[..., : recorded * sampled].reshape(*tangents.shape[:2], recorded, sampled)
        names = curves.model.parameters.names
        chosen = [names.index(name) for name in self.simulator.parameters]
        robust = robust_mean(jnp.moveaxis(jnp.asarray(by_curve[:, chosen, : self.statistics]), 1, -1))
        return Paths(
            Estimate(self._at_all_times(robust.mean, np.nan), self._at_all_times(robust.error, np.nan)),
            self._at_all_times(jnp.nan_to_num(robust.spread, nan=jnp.inf).max(axis=-1), 1.0),
            Counter({PROBLEMS[name]: count for name, count in zip(PROBLEMS, met, strict=True) if count}),
        )

    def _at_all_times(self, values: Float[Array, "statistic sampled *free"], rest: float) -> np.ndarray:
        """Over all observables, with `rest` where colonies were not differentiated."""
        beyond = len(self.times) - values.shape[1]
        padded = np.pad(np.asarray(values, float), ((0, 0), (0, beyond), (0, 0))[: values.ndim], constant_values=rest)
        return padded.reshape(-1, *values.shape[2:])


class RobustMean(eqx.Module):
    """A mean over members that a few of them cannot carry away.

    Attributes:
        mean: The mean.
        error: Its standard error.
        cut: Share of the members that were cut.
        spread: Standard deviation of all members over that of those left as they are; far above 1, a plain mean would
            mean nothing.
    """

    mean: Float[Array, "*entry"]
    error: Float[Array, "*entry"]
    cut: Float[Array, "*entry"]
    spread: Float[Array, "*entry"]


def robust_mean(values: Float[Array, "member *entry"]) -> RobustMean:
    """Mean of all members, each cut at `OUTLIER` times the scale of the nearest 95 % around the median.

    A single colony's derivative may grow without bound along a chaotic path while the ensemble's does not.

    Arguments:
        values: Of each member.

    Returns:
        The mean with its standard error, and what was cut.
    """
    finite = jnp.isfinite(values)
    middle = jnp.nanmedian(jnp.where(finite, values, jnp.nan), axis=0)
    middle = jnp.where(jnp.isfinite(middle), middle, 0.0)
    apart = jnp.where(finite, values - middle, jnp.inf)
    left = len(values) - max(1, round(0.05 * len(values)))
    near = jnp.sort(jnp.abs(apart), axis=0)[: max(left, 1)]
    scale = jnp.sqrt(jnp.mean(near**2, axis=0))
    kept = jnp.clip(apart, -OUTLIER * scale, OUTLIER * scale)
    kept = jnp.where(finite, kept, 0.0)
    inside = jnp.std(kept, axis=0)
    return RobustMean(
        mean=middle + jnp.mean(kept, axis=0),
        error=inside / np.sqrt(max(1, len(values) - 1)),
        cut=jnp.mean(kept != apart, axis=0),
        spread=jnp.where(inside > 0, jnp.std(apart, axis=0) / jnp.where(inside > 0, inside, 1.0), 1.0),
    )
