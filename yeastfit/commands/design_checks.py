"""What `yeastfit design` refuses before a colony grows: what has been measured already, and too few runs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from yeastfit.commands.generated.options import flag_of
from yeastfit.errors import InputError
from yeastfit.inference.information.design import most_means
from yeastfit.inference.information.experiment import freedom_of_runs, runs_for, scatter_freedom, times_among
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.model.parameters import PARAMETERS


def check_effective(given: Mapping[str, Any], nothing: bool, same: bool) -> None:
    """Raise `InputError` where an option has no effect with the others.

    Arguments:
        given: Values of replicates, added and measured_statistics; None where an option is left out.
        nothing: Whether nothing has been measured.
        same: Whether the same colonies are measured again.
    """
    if same and given["added"] is not None:
        raise InputError("--added is given beside --same-colonies, which adds none: leave out one of the two")
    if nothing and given["measured_statistics"] is not None:
        raise InputError("--measured-statistics is given beside --measured-times none: leave out one of the two")
    if nothing and not same and given["replicates"] is not None:
        raise InputError(
            "--replicates is given beside --measured-times none, so that no colony has been measured: leave it out, or "
            "give --same-colonies"
        )


def check_measured(
    known: Mapping[str, Any], statistics: Sequence[str], times: Sequence[float] | np.ndarray, of: str = "--times"
) -> None:
    """Raise `InputError` where what has been measured is none of what will be there, or all of it.

    Arguments:
        known: Arguments of a design.
        statistics: Names of those that are there.
        times: Times that are there, nan where there is none.
        of: What holds the times.
    """
    present = np.asarray(times, dtype=float)
    for name in known["measured_statistics"] or ():
        if name not in statistics:
            raise InputError(f"--measured-statistics: {name!r} is not among {', '.join(statistics)}")
    if known["measured_times"]:
        said = f"--measured-times is {','.join(f'{time:g}' for time in known['measured_times'])}"
        if np.isnan(present).all():
            raise InputError(f"{said}, but these colonies have no times: give none, or leave it out")
        try:
            times_among(present, known["measured_times"])
        except InputError:
            raise InputError(f"{said}, need some of {of}, {', '.join(f'{time:g}' for time in present)}") from None
    if not known["new_replicates"] and _measured(known, statistics, present) == len(statistics) * len(present):
        raise InputError(
            "--same-colonies: everything counts as measured, so that nothing is left to measure: say what has been "
            "measured by --measured-times or --measured-statistics"
        )


def check_runs(
    known: Mapping[str, Any], statistics: Sequence[str], times: Sequence[float] | np.ndarray, runs: int, free: int
) -> None:
    """Raise `InputError` where so many runs do not tell the covariance of what is measured.

    Arguments:
        known: Arguments of a design.
        statistics: Names of those that are there.
        times: Times that are there.
        runs: Number of colonies to simulate.
        free: Number of parameters that are varied.
    """
    means = _most(known, statistics, times)
    if runs >= 16 and runs % 16 == 0 and freedom_of_runs(runs, free) <= means + 1:
        raise InputError(
            f"--runs is {runs}, which is too few for the covariance of {means} means (statistics at times): give "
            f"--runs {runs_for(means, free)} or more, or fewer statistics or times"
        )


def check_freedom(known: Mapping[str, Any], found: Sensitivity, name: str) -> None:
    """Raise `InputError` where the runs behind a sensitivity are too few likewise; what the message calls it."""
    means = _most(known, found.statistics, found.times)
    if scatter_freedom(found) <= means + 1:
        needed = runs_for(means, len(found.free))
        raise InputError(
            f"{name} too few for the covariance of {means} means (statistics at times): need --runs {needed} or more, "
            "or fewer statistics or times"
        )


def check_logarithms(free: Sequence[str], at: Mapping[str, float]) -> None:
    """Raise `InputError` for a free parameter whose value has no logarithm."""
    for name in free:
        if not at[name] > 0:
            advice = "" if name in PARAMETERS else ", or leave it out of --free"
            raise InputError(
                f"{flag_of(name)} is {at[name]:g}, and errors are of its logarithm: give a value above 0{advice}"
            )


def _measured(known: Mapping[str, Any], statistics: Sequence[str], times: np.ndarray) -> int:
    """How many means have been measured already."""
    names, moments = known["measured_statistics"], known["measured_times"]
    return (len(statistics) if names is None else len(set(names))) * (len(times) if moments is None else len(moments))


def _most(known: Mapping[str, Any], statistics: Sequence[str], times: Sequence[float] | np.ndarray) -> int:
    """Of how many means the largest covariance is."""
    measured = _measured(known, statistics, np.asarray(times))
    return most_means(measured, len(statistics), len(times), known["steps"], known["by"], not known["new_replicates"])
