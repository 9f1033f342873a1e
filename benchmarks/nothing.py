"""A simulator that computes nothing, so that only its distribution takes time; workers import it from here."""

from typing import Any

import numpy as np

from yeastfit.observable import Observable
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.specification import Specification, path_of

PARAMETERS = ParameterSet(tuple(Parameter(name, name, name, (0.1, 1.0), 0.5) for name in "abc"))


class Nothing:
    """Rows of zeros: three parameters and twenty statistics, as fits of curves have."""

    parameters = PARAMETERS
    observables = tuple(Observable("radius", float(time)) for time in range(20))

    @property
    def specification(self) -> Specification:
        """Without arguments."""
        return Specification(path_of(Nothing))

    def __call__(self, values: Any, seeds: Any) -> np.ndarray:
        """At once."""
        return np.zeros((len(seeds), len(self.observables)))
