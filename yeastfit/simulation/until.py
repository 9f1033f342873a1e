"""How far a colony grows whose age is not known: until one of its statistics comes to a value."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, PyTree

from yeastfit.errors import InputError
from yeastfit.model.colony import Colony
from yeastfit.model.numerics import Numerics
from yeastfit.simulation.large_ensemble import member_of

COUNTS = {"nodes": 0, "cells": -1}  # what is counted without being observed, and its difference from the nodes


@dataclass(frozen=True)
class Until:
    """Growth ends at the first step at which a statistic is at least `value`.

    Attributes:
        name: Of a statistic that is observed, or "nodes" or "cells", the numbers of them.
        value: In L0.
        observe: What is observed (`Observer`).
    """

    name: str
    value: float
    observe: Any

    @staticmethod
    def of(until: Mapping[str, float], observe: Any) -> "Until":
        """From `{"area": 24500.0}`.

        Raises:
            InputError: It is no name with a number above 0.
        """
        if not isinstance(until, Mapping) or len(until) != 1:
            raise InputError(f'until is {until!r}, it must be one name and its value, as in {{"area": 24500.0}}')
        ((name, value),) = until.items()
        if isinstance(value, bool) or not isinstance(value, int | float) or not (isfinite(value) and value > 0):
            raise InputError(f"until: {name} is {value!r}, it must be a number above 0")
        return Until(name, float(value), observe)

    def passed(self, colony: Colony, found: PyTree) -> bool:
        """Whether a colony, with what was observed of it, has come so far."""
        if self.name in COUNTS:
            return int(colony.count) + COUNTS[self.name] >= self.value
        seen = self.observe.finish(jax.tree.map(lambda leaf: np.asarray(leaf)[None], found))
        if self.name not in seen:
            raise InputError(f"until is of {self.name!r}, expected one of {', '.join([*COUNTS, *seen])}")
        return bool(seen[self.name][0] >= self.value)

    def times_reached(self, colony: Colony, observed: PyTree, numerics: Numerics) -> Float[np.ndarray, " member"]:
        """When each member of an ensemble came so far; nan where it had not at the end."""
        found = [self.passed(*member_of((colony, observed), member)) for member in range(colony.step.shape[0])]
        return np.where(found, np.asarray(colony.step) * numerics.dt, np.nan)

    def __str__(self) -> str:
        return f"{self.name} = {self.value:g}"
