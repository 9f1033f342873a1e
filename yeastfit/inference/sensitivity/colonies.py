"""Colonies whose sensitivity is asked for: hard or relaxed ones, seen by smooth statistics."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.colony_curves import ColonyCurves
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.measure.statistics.registry import check_names
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters
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
    model: Model | None = None,
) -> ColonySimulator:
    """Colonies of a relaxed or hard model, seen by smooth statistics.

    Arguments:
        parameters: λ, of which those that are not free are held.
        free: Names of the free ones, in the order of columns; by default all, but for those that a rule brings and that
            are 0.
        recorded: Statistics, which `observe` measures.
        times: Of all of them.
        numerics: Of the model.
        relaxation: Of the model.
        observe: Grid and blur.
        model: The rules; by default the source's.

    Raises:
        InputError: A name is unknown, or a λ is not a single number, above 0 where it is free.
    """
    check_names(recorded, "smooth", "nodes")
    model = model or Model()
    known, complete = model.parameters, model.complete(parameters)
    values = {name: np.asarray(value, dtype=float) for name, value in complete.values.items()}
    usual = [name for name in known if name in PARAMETERS or (values[name] > 0).all()]
    names: Sequence[str] = usual if free is None else free
    known.subset(names)
    for name, value in values.items():
        if value.shape != () or not (value > 0 or (name not in names and value == 0)):
            raise InputError(f"{name} is {value}, derivatives in log λ need one number above 0")
    chosen = ParameterSet(tuple(known[name] for name in names))
    held = {name: float(value) for name, value in values.items() if name not in names}
    observables = tuple(Observable(name, float(time)) for name in recorded for time in times)
    observe = replace(observe, statistics=recorded)
    curves = ColonyCurves(recorded, numerics, observe, relaxation, schedule_of(times, numerics))
    curves = replace(curves, model=model)
    return ColonySimulator(chosen, held, observables, curves, np.ones(len(observables), dtype=bool))


def hard_but_smoothly_measured() -> Relaxation:
    """The hard model, its outline seen as that of the relaxed one, so that the two have the same statistics."""
    return Relaxation(union=None, contact=None, births="whole")


def tame() -> Relaxation:
    """The model that is differentiated: a contact to both sides of its radius, whose direction is half held fixed.

    Of those tried, its derivatives lie closest to the hard model's at little variance (docs/gradients.md).
    """
    return Relaxation(contact=0.1, overhang=0.25, turning=0.5)


def path_numerics_for(numerics: Numerics, parameters: Parameters) -> Numerics:
    """Numerics of the model that is differentiated.

    Δt is 0.01 at most, and such that no step throws two nodes across half the ramp of `tame`.
    """
    stiffest = max(float(parameters.elasticity), float(parameters.repulsivity))
    return replace(numerics, dt=min(0.01, 0.05 / stiffest))
