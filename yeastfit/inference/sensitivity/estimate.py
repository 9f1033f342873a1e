"""How the mean of an ensemble of colonies, or of any other simulator, answers to its parameters."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.sensitivity.colonies import (
    colonies_at,
    hard_but_smoothly_measured,
    path_numerics_for,
    tame,
)
from yeastfit.inference.sensitivity.estimator import Estimator
from yeastfit.inference.sensitivity.pathwise import COUNT, ColonyPaths
from yeastfit.inference.sensitivity.result import EstimatorName, Sensitivity
from yeastfit.inference.simulator import Simulator, check_simulator
from yeastfit.kinds import check_kind
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.observable import Observable
from yeastfit.progress import Progress, progress_or_silent

STATISTICS = ("compactness", "mean_radius", "radius", "area", "cell_count")


def sensitivity(
    parameters: Parameters | None = None,
    *,
    simulator: Simulator | None = None,
    at: Mapping[str, float] | None = None,
    times: Sequence[float] | np.ndarray | None = None,
    statistics: Sequence[str] | None = None,
    free: Sequence[str] | None = None,
    method: EstimatorName | None = None,
    runs: int = 256,
    paths: int = 8,
    spread: float = 0.1,
    seed: int = 0,
    model: Model | None = None,
    numerics: Numerics | None = None,
    relaxation: Relaxation | None = None,
    path_numerics: Numerics | None = None,
    path_relaxation: Relaxation | None = None,
    observe: SmoothStatistics | None = None,
    progress: Progress | None = None,
    elsewhere: Callable[[Simulator], Simulator] | None = None,
) -> Sensitivity:
    """Mean of an ensemble and its derivative in log λ, with standard errors. Same seed, same result.

    Either of colonies at `parameters`, or of a simulator at given values: `sensitivity(simulator=…, at={…})`. Asking
    for several statistics costs no more than for one.

    Arguments:
        parameters: λ of colonies.
        simulator: Of anything else. `times` to `free`, and what follows `seed`, are of colonies.
        at: Values of its free parameters, by name; defaults else.
        times: Of the curves.
        statistics: Of `SmoothStatistics`; by default compactness, mean radius, radius, area and number of cells.
        free: With respect to which parameters; by default all.
        method: "combined", "regression" or "pathwise" (see `estimator`); what is not asked for is not run. By default
            "combined" for colonies and "regression" for other simulators, which have nothing else.
        runs: Simulations for the regression, a multiple of 16; a quarter as many are made at λ itself.
        paths: Colonies that are differentiated; each costs six to seven plain runs of its model. "combined" takes them
            up to `PATH_NODES` nodes, "pathwise" to the end.
        spread: Of log λ in the regression, whose bias grows as spread² and whose variance falls as 1/spread². Close
            to the largest value of a parameter pairs go only as far as that; an aspect ratio goes a little beyond 1.
        seed: Of all random numbers.
        model: Rules of the colonies; by default the source's.
        numerics: Of the model that is meant, by default at Δt = 0.005.
        relaxation: Likewise, by default `hard_but_smoothly_measured`.
        path_numerics: Of the model that is differentiated, by default at Δt = 0.01.
        path_relaxation: Likewise, by default `tame`.
        observe: Grid and blur of the statistics.
        progress: Called with what is being done and the share that is done.
        elsewhere: Has workers simulate (`Workers.spread`); colonies that are differentiated stay in this process.

    Returns:
        Means and their derivatives, with standard errors, the scatter of one simulation, and warnings.

    Raises:
        InputError: Arguments that make no sense, and parameters that are not above 0.
        SimulationError: Most simulations failed.
    """
    settings: dict[str, Any] = {"runs": runs, "paths": paths, "spread": spread, "seed": seed}
    settings["progress"] = progress_or_silent(progress)
    of_colonies: dict[str, Any] = {"parameters": parameters, "times": times, "statistics": statistics, "free": free}
    of_colonies |= {"model": model, "numerics": numerics, "relaxation": relaxation, "path_numerics": path_numerics}
    of_colonies |= {"path_relaxation": path_relaxation, "observe": observe}
    if simulator is not None:
        check_simulator(simulator)
        for name, value in of_colonies.items():
            if value is not None:
                raise InputError(f"{name} is of colonies, the simulator that is given has its own: leave it out")
        check_kind("at", {} if at is None else at, Mapping, "values by the names of parameters")
        values = _values_at(simulator, at or {})
        simulator = simulator if elsewhere is None else elsewhere(simulator)
        return Estimator(simulator, values, simulator.observables, method or "regression", **settings).run()
    if at is not None or times is None:
        missing = "times are missing" if at is None else "at is given without simulator"
        raise InputError(f"{missing}: a sensitivity is of colonies at `parameters` and `times`, or of a simulator")
    colonies, values, asked, derivatives = _colonies(**of_colonies)
    chosen: Simulator = colonies if elsewhere is None else elsewhere(colonies)
    return Estimator(chosen, values, asked, method or "combined", **settings, pathwise=derivatives).run()


def _colonies(
    *,
    parameters: Parameters | None,
    times: Sequence[float] | np.ndarray,
    statistics: Sequence[str] | None,
    free: Sequence[str] | None,
    model: Model | None,
    numerics: Numerics | None,
    relaxation: Relaxation | None,
    path_numerics: Numerics | None,
    path_relaxation: Relaxation | None,
    observe: SmoothStatistics | None,
) -> tuple[ColonySimulator, np.ndarray, tuple[Observable, ...], ColonyPaths]:
    """Colonies, λ of their free parameters, which observables are asked for, and derivatives of single colonies."""
    parameters, numerics = parameters or Parameters(), numerics or Numerics(dt=0.005)
    names = STATISTICS if statistics is None else tuple(statistics)
    sampled = np.atleast_1d(np.asarray(times, dtype=float))
    colonies = colonies_at(
        parameters,
        free,
        (*names, *(() if COUNT in names else (COUNT,))),
        sampled,
        numerics,
        hard_but_smoothly_measured() if relaxation is None else relaxation,
        observe or SmoothStatistics(numerics.domain),
        model,
    )
    path_relaxation = tame() if path_relaxation is None else path_relaxation
    path_numerics = path_numerics or path_numerics_for(numerics, parameters)
    derivatives = ColonyPaths(colonies, sampled, len(names), path_numerics, path_relaxation)
    asked = tuple(one for one in colonies.observables if one.statistic in names)
    complete = colonies.curves.model.complete(parameters)
    return colonies, np.array([float(complete[name]) for name in colonies.parameters]), asked, derivatives


def _values_at(simulator: Simulator, at: Mapping[str, float]) -> np.ndarray:
    """λ of a simulator's parameters. Raise `InputError` for a name that is none, or an inadmissible value."""
    simulator.parameters.check(at)
    return np.array([float(at.get(name, one.default)) for name, one in simulator.parameters.items()])
