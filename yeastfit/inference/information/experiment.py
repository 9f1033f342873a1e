"""Experiments: which curves of how many colonies are measured, and what they would tell about λ.

Between a `Sensitivity`, which knows every curve there could be, and `information`, which wants J and Σ of some.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.information.fisher import information
from yeastfit.inference.information.result import Information
from yeastfit.inference.paired_regression import CurveSquare
from yeastfit.inference.sensitivity.result import Sensitivity


def information_of(
    found: Sensitivity,
    *,
    free: Sequence[str] | None = None,
    statistics: Sequence[str] | None = None,
    times: Sequence[float] | np.ndarray | None = None,
    replicates: float = 10,
    measurement_error: float = 0.0,
    members: float = np.inf,
    prior: Mapping[str, float] | None = None,
    limit: float = 1.0,
) -> Information:
    """Fisher information of log λ in curves of a number of replicate colonies, from `yeastfit.sensitivity`.

    free, statistics, times: which of those of `found` are free and measured, by default all; what is not free is known.
    Times are model time. The rest as in `information` and `curve_covariance`. Raises `InputError`, also for names and
    times that `found` does not hold.
    """
    names = chosen_free(found, free)
    entries = chosen_curves(found, statistics, times)
    square = np.ix_(entries, entries)
    curves = Curves.of(found, names)
    sigma = curve_covariance(
        curves.scatter[square], replicates=replicates, members=members, freedom=scatter_freedom(found)
    )
    sigma = sigma + systematic(found.mean, measurement_error)[square]
    return curves.information(entries, sigma, prior=prior, limit=limit)


@dataclass(frozen=True)
class Curves:
    """What a sensitivity knows of its curves, statistic by statistic: J with its errors, and one colony's scatter."""

    free: tuple[str, ...]
    jacobian: Float[np.ndarray, "curve free"]
    error: Float[np.ndarray, "curve free"]
    correlation: CurveSquare
    scatter: CurveSquare

    @staticmethod
    def of(found: Sensitivity, free: tuple[str, ...]) -> "Curves":
        """Columns of the free parameters."""
        columns = [found.free.index(name) for name in free]
        table = (-1, len(found.free))
        jacobian, error = (values.reshape(table)[:, columns] for values in (found.jacobian, found.error))
        return Curves(free, jacobian, error, found.correlation, found.scatter)

    def information(self, entries: np.ndarray, sigma: CurveSquare, **more: Any) -> Information:
        """In the curves of these numbers, of which some may be repeated."""
        rows = {"error": self.error[entries], "correlation": self.correlation[np.ix_(entries, entries)]}
        return information(self.jacobian[entries], sigma, free=self.free, **rows, **more)


def chosen_free(found: Sensitivity, free: Sequence[str] | None) -> tuple[str, ...]:
    """Names of free parameters, all of a sensitivity's by default, in its order."""
    wanted = found.free if free is None else free
    unknown = [name for name in wanted if name not in found.free]
    if unknown or not wanted:
        raise InputError(f"free is {', '.join(wanted) or 'empty'}, the sensitivity holds {', '.join(found.free)}")
    return tuple(name for name in found.free if name in wanted)


def chosen_curves(
    found: Sensitivity, statistics: Sequence[str] | None, times: Sequence[float] | np.ndarray | None
) -> np.ndarray:
    """Numbers of the curves of some statistics at some times, all by default, statistic by statistic."""
    rows = range(len(found.statistics)) if statistics is None else [_statistic(found, name) for name in statistics]
    columns = range(len(found.times)) if times is None else [_time(found, float(time)) for time in times]
    numbers = sorted({row * len(found.times) + column for row in rows for column in columns})
    return np.array(numbers, dtype=int)


def scatter_freedom(found: Sensitivity) -> float:
    """ν of a sensitivity's scatter: members − 1, and of the pairs 2 pairs − 1 − p."""
    freedom = found.runs["mean"] - 1
    return float(freedom + found.runs["regression"] - 1 - len(found.free) if "regression" in found.runs else freedom)


def _statistic(found: Sensitivity, name: str) -> int:
    if name not in found.statistics:
        raise InputError(f"statistic {name!r} is not in the sensitivity, which holds {', '.join(found.statistics)}")
    return found.statistics.index(name)


def _time(found: Sensitivity, time: float) -> int:
    near = np.flatnonzero(np.abs(found.times - time) < 1e-6 * (1 + abs(time)))
    if not near.size:
        raise InputError(
            f"time {time:g} is not in the sensitivity, which holds {', '.join(f'{t:g}' for t in found.times)}"
        )
    return int(near[0])


def curve_covariance(
    scatter: CurveSquare,
    *,
    replicates: float | Float[np.ndarray, " curve"],
    members: float = np.inf,
    freedom: float = np.inf,
) -> CurveSquare:
    """Σ of mean curves over replicates, compared with an ensemble's.

        Σ_kl = S_kl h (1 / max(R_k, R_l) + 1 / members),    h = ν / (ν − n − 1)

    scatter: S, of one colony's n curves. replicates: R, colonies behind each mean, one number or one for each curve;
    the colonies behind one with fewer are among those behind one with more. members: of the ensemble that the data are
    compared with. freedom: ν, degrees of freedom that S was estimated from; its inverse is too large by h on average
    (Hartlap et al. 2007, doi:10.1051/0004-6361:20066170). Raises `InputError` where R or members is not above 0, and
    where there are too few degrees of freedom.
    """
    count = len(scatter)
    colonies = np.broadcast_to(np.asarray(replicates, dtype=float), count)
    if not (colonies > 0).all():
        raise InputError(f"replicates is {replicates}, every curve needs more than 0 colonies")
    if not members > 0:
        raise InputError(f"members is {members}, it must be above 0")
    if freedom <= count + 1:
        raise InputError(
            f"freedom is {freedom:g}: the covariance of {count} curves needs more than {count + 1} degrees of freedom, "
            "so more runs, or fewer statistics and times"
        )
    inflation = 1.0 if np.isinf(freedom) else freedom / (freedom - count - 1)
    return inflation * scatter * (1.0 / np.maximum(colonies[:, None], colonies) + 1.0 / members)


def systematic(
    mean: Float[np.ndarray, "statistic time"], relative: float | Float[np.ndarray, "statistic 1"]
) -> CurveSquare:
    """Covariance of a relative error of every mean, half of its variance common to all times of a statistic."""
    if not (np.asarray(relative) >= 0).all():
        raise InputError(f"measurement_error is {relative}, it must be at least 0")
    error = (relative * mean).ravel()
    same = np.kron(np.eye(len(mean)), np.ones((mean.shape[1], mean.shape[1])))
    return 0.5 * same * np.outer(error, error) + 0.5 * np.diag(error**2)
