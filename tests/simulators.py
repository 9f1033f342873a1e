"""What simulators of the tests say about themselves."""

from collections.abc import Sequence

from yeastfit.observable import Observable
from yeastfit.parameter_set import Parameter, ParameterSet


def parameters_named(names: Sequence[str]) -> ParameterSet:
    """Parameters of any value."""
    inf = float("inf")
    return ParameterSet(tuple(Parameter(name, name, name, (1e-3, 1e3), 1.0, smallest=-inf) for name in names))


def observables_named(labels: Sequence[str]) -> tuple[Observable, ...]:
    """Statistics without a time."""
    return tuple(map(Observable, labels))
