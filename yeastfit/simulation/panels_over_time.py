"""Pictures of one colony as it grows."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Array

from yeastfit.model.parameters import Parameters
from yeastfit.model.snapshot import Snapshot
from yeastfit.panel import Panel
from yeastfit.simulation.simulate import simulate


def panels_over_time(
    parameters: Parameters, keys: Array, *, times: Sequence[float] | np.ndarray, **how: Any
) -> Iterator[list[Panel]]:
    """Cells and nutrient of one colony at several times; each picture goes on from the one before.

    Arguments:
        parameters: Values of all the model's parameters.
        keys: One.
        times: Rising, in 1/μ*.
        **how: What else `simulate` takes.

    Yields:
        Panels of one time, all as wide as those of the last.
    """
    how |= {"observe": Unmeasured()}
    seen = [simulate(parameters, keys, times=times[:1], **how)]
    for time in times[1:]:
        seen.append(simulate(parameters, times=[time], start=seen[-1].colony, **how))
    width = 2 * seen[-1].panels(0)[0].half_width / seen[-1].scales.length
    for one in seen:
        yield one.panels(0, width)


class Unmeasured:
    """Records nothing, for pictures that need the states only."""

    def __call__(self, snapshot: Snapshot) -> dict[str, Any]:
        """Nothing."""
        return {}

    def finish(self, observed: dict[str, Any]) -> dict[str, Any]:
        """Nothing."""
        return observed

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unmeasured)

    def __hash__(self) -> int:
        return 0
