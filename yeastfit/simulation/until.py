"""How far a colony grows whose age is not known: until one of its statistics comes to a value."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, PyTree

from yeastfit.errors import InputError
from yeastfit.model.colony import Colony
from yeastfit.model.numerics import Numerics
from yeastfit.numbers import POSITIVE
from yeastfit.simulation.large_ensemble import member_of

COUNTS = {"nodes": 0, "cells": -1}  # what is counted without being observed, and its difference from the nodes


@dataclass(frozen=True)
class Until:
    """Growth ends at the first step at which one of some statistics is at least its value.

    Attributes:
        values: By the name of a statistic that is observed, or "nodes" or "cells", the numbers of them; in L0.
        observe: What is observed (`Observer`).
    """

    values: Mapping[str, float]
    observe: Any

    @staticmethod
    def of(until: Mapping[str, float], observe: Any) -> "Until":
        """From `{"area": 24500.0}`.

        Raises:
            InputError: It is not names with numbers above 0.
        """
        if not isinstance(until, Mapping) or not until:
            raise InputError(f'until is {until!r}, it must be a name and its value, as in {{"area": 24500.0}}')
        return Until({name: POSITIVE.check(value, f"until: {name}") for name, value in until.items()}, observe)

    def passed(self, colony: Colony, found: PyTree) -> bool:
        """Whether a colony, with what was observed of it, has come so far."""
        seen = {}
        if not self.values.keys() <= COUNTS.keys():
            seen = self.observe.finish(jax.tree.map(lambda leaf: np.asarray(leaf)[None], found))
        numbers = {name: values[0] for name, values in seen.items()}
        numbers |= {name: int(colony.count) + more for name, more in COUNTS.items()}
        for name in self.values:
            if name not in numbers:
                raise InputError(f"until is of {name!r}, expected one of {', '.join([*COUNTS, *seen])}")
        return any(bool(numbers[name] >= value) for name, value in self.values.items())

    def times_reached(self, colony: Colony, observed: PyTree, numerics: Numerics) -> Float[np.ndarray, " member"]:
        """When each member of an ensemble came so far; nan where it had not at the end."""
        found = [self.passed(*member_of((colony, observed), member)) for member in range(colony.step.shape[0])]
        return np.where(found, np.asarray(colony.step) * numerics.dt, np.nan)

    def __str__(self) -> str:
        return " or ".join(f"{name} = {value:g}" for name, value in self.values.items())
