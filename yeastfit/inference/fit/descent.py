"""One start of a fit on its way to a minimum, and whether two places are the same."""

from dataclasses import dataclass, field

import numpy as np

from yeastfit.inference.fit.ensemble import Correction, JointModel
from yeastfit.inference.parameter_space import Vector

APART = 0.3  # of log λ, in one entry at least, between two places that are not the same: three spreads of the pairs


@dataclass
class Descent:
    """One start on its way.

    Attributes:
        number: Of the start.
        theta: Its best point.
        cost: χ² there.
        ended: How its stage ended, in words; empty as long as it goes on.
        model: At its best point in this stage.
        seen: All models of this stage.
        failed: Whether the optimiser failed.
        correction: By the fine simulators.
    """

    number: int
    theta: Vector
    cost: float = np.inf
    ended: str = ""
    model: JointModel | None = None
    seen: list[JointModel] = field(default_factory=list)
    failed: bool = False
    correction: Correction | None = None


def are_different(first: Vector, second: Vector) -> bool:
    """Whether two points are not the same place."""
    return bool((np.abs(first - second) > APART).any())
