"""Colonies whose sensitivity is asked for: hard or relaxed ones, seen by smooth statistics."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.colony_curves import ColonyCurves
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.measure.statistics.registry import check_names
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import NAMES, PARAMETERS, Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.observable import Observable
from yeastfit.parameter_set import ParameterSet
from yeastfit.simulation.simulate import schedule_of


def colonies_at(
    parameters: Parameters,
    free: Sequence[str] | None,
    recorded: tuple[str, ...],
    times: np.ndarray,
    numerics: Numerics,
    relaxation: Relaxation,
    observe: SmoothStatistics,
) -> ColonySimulator:
    """Colonies of a relaxed or hard model, seen by smooth statistics.

    Arguments:
        parameters: λ, of which those that are not free are held.
        free: Names of the free ones, in the order of columns; by default all.
        recorded: Statistics, which `observe` measures.
        times: Of all of them.
        numerics: Of the model.
        relaxation: Of the model.
        observe: Grid and blur.

    Raises:
        InputError: A name is unknown, or one λ is not a single number above 0.
    """
    check_names(recorded, "smooth", "nodes")
    for name in NAMES:
        value = getattr(parameters, name)
        if value.shape != () or not value > 0:
            raise InputError(f"{name} is {value}, derivatives in log λ need one number above 0")
    names = NAMES if free is None else tuple(free)
    PARAMETERS.subset(names)
    chosen = ParameterSet(tuple(PARAMETERS[name] for name in names))
    held = {name: float(getattr(parameters, name)) for name in NAMES if name not in names}
    observables = tuple(Observable(name, float(time)) for name in recorded for time in times)
    observe = replace(observe, statistics=recorded)
    curves = ColonyCurves(recorded, numerics, observe, relaxation, schedule_of(times, numerics))
    return ColonySimulator(chosen, held, observables, curves, np.ones(len(observables), dtype=bool))


def hard_but_smoothly_measured() -> Relaxation:
    """The hard model, its outline seen as that of the relaxed one, so that the two have the same statistics."""
    return Relaxation(union=None, contact=None, boundary=0.2, births="whole")


def tame() -> Relaxation:
    """The model that is differentiated: a contact to both sides of its radius, whose direction is half held fixed."""
    return Relaxation(contact=0.1, overhang=0.25, turning=0.5)


def path_numerics_for(numerics: Numerics, parameters: Parameters) -> Numerics:
    """Numerics of the model that is differentiated.

    Δt is 0.01 at most, and such that no step throws two nodes across half the ramp of `tame`.
    """
    stiffest = max(float(parameters.elasticity), float(parameters.repulsivity))
    return replace(numerics, dt=min(0.01, 0.05 / stiffest))
