"""What experiments would tell about λ: which observables of how many replicates are measured.

Between a `Sensitivity`, which knows every observable there could be, and `information`, which wants J and Σ of some.
"""

from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import Square, mean_covariance, measurement_covariance
from yeastfit.inference.information.fisher import information
from yeastfit.inference.information.result import Information
from yeastfit.inference.sensitivity.estimator import members_for
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.kinds import check_kind, check_list
from yeastfit.numbers import array_of


def information_of(
    sensitivity: Sensitivity,
    *,
    free: Sequence[str] | None = None,
    statistics: Sequence[str] | None = None,
    times: Sequence[float] | np.ndarray | None = None,
    replicates: float = 10,
    measurement_error: float | Mapping[str, float] = 0.0,
    members: float = np.inf,
    prior: Mapping[str, float] | None = None,
    limit: float = 1.0,
) -> Information:
    """Fisher information of log λ in means over replicates.

    Arguments:
        sensitivity: From `yeastfit.sensitivity`.
        free: Which of its parameters are free, by default all; what is not free is known.
        statistics: Which are measured, by default all.
        times: Likewise, in the simulator's unit.
        replicates: Behind each mean.
        measurement_error: Relative, beside the scatter of replicates: one number, or one for each statistic.
        members: Of the ensemble that the data are compared with.
        prior: Standard deviation of log λ, by name.
        limit: Error of log λ beyond which a direction is blind.

    Returns:
        What such data determine, direction by direction.

    Raises:
        InputError: As `information`; and names and times that `sensitivity` does not hold.
    """
    check_kind("sensitivity", sensitivity, Sensitivity, "the result of yeastfit.sensitivity(…)")
    names = chosen_free(sensitivity, free)
    rows = chosen_observables(sensitivity, statistics, times)
    square = np.ix_(rows, rows)
    freedom = scatter_freedom(sensitivity)
    sigma = mean_covariance(sensitivity.scatter[square], replicates=replicates, members=members, freedom=freedom)
    sigma = sigma + measurement_covariance(sensitivity.observables, sensitivity.mean, measurement_error)[square]
    return information_in(sensitivity, names, rows, sigma, prior=prior, limit=limit)


def information_in(
    sensitivity: Sensitivity, free: tuple[str, ...], rows: np.ndarray, sigma: Square, **more: Any
) -> Information:
    """Information in observables of these numbers, of which some may be repeated, with covariance Σ."""
    table = np.ix_(rows, np.array([sensitivity.free.index(name) for name in free]))
    errors = {"error": sensitivity.error[table], "correlation": sensitivity.correlation[np.ix_(rows, rows)]}
    return information(sensitivity.jacobian[table], sigma, free=free, **errors, **more)


def chosen_free(sensitivity: Sensitivity, free: Sequence[str] | None) -> tuple[str, ...]:
    """Names of free parameters, all of a sensitivity's by default, in its order."""
    wanted = sensitivity.free if free is None else free
    check_list("free", wanted)
    unknown = [name for name in wanted if name not in sensitivity.free]
    if unknown or not wanted:
        raise InputError(f"free is {', '.join(wanted) or 'empty'}, the sensitivity holds {', '.join(sensitivity.free)}")
    return tuple(name for name in sensitivity.free if name in wanted)


def chosen_observables(
    sensitivity: Sensitivity, statistics: Sequence[str] | None, times: Sequence[float] | np.ndarray | None
) -> np.ndarray:
    """Numbers of the observables of some statistics at some times, all by default, in their order."""
    check_list("statistics", statistics)
    for name in statistics or ():
        if name not in sensitivity.statistics:
            raise InputError(
                f"statistic {name!r} is not in the sensitivity, which holds {', '.join(sensitivity.statistics)}"
            )
    wanted = sensitivity.times if times is None else times_among(sensitivity.times, times)
    return np.array(
        [
            row
            for row, one in enumerate(sensitivity.observables)
            if (statistics is None or one.statistic in statistics) and (times is None or one.time in wanted)
        ],
        dtype=int,
    )


def scatter_freedom(sensitivity: Sensitivity) -> float:
    """ν of a sensitivity's scatter: members − 1, and of the pairs 2 pairs − 1 − p."""
    freedom = sensitivity.runs["mean"] - 1
    return float(
        freedom + sensitivity.runs["regression"] - 1 - len(sensitivity.free)
        if "regression" in sensitivity.runs
        else freedom
    )


def freedom_of_runs(runs: int, free: int) -> int:
    """`scatter_freedom` of a sensitivity that is yet to be made by regression along so many parameters."""
    return members_for(runs) - 1 + runs - 1 - free


def runs_for(means: int, free: int) -> int:
    """The fewest runs that tell the covariance of so many means."""
    return next(runs for runs in count(16, 16) if freedom_of_runs(runs, free) > means + 1)


def times_among(present: np.ndarray, times: Sequence[float] | np.ndarray) -> np.ndarray:
    """Those of the present times that equal these but for rounding. Raises `InputError` where one is not there."""
    wanted = array_of(times, "times").reshape(-1, 1)
    near = np.isclose(present, wanted, rtol=1e-6, atol=1e-6)
    for time, found in zip(wanted[:, 0], near, strict=True):
        if not found.any():
            raise InputError(
                f"time {time:g} is not in the sensitivity, which holds {', '.join(f'{t:g}' for t in present)}"
            )
    return present[near.argmax(axis=1)]
