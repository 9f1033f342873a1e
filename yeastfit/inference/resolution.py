"""In what steps colonies are grown that are compared with data.

Defaults for colonies of photographs of real ones follow from docs/convergence-large.md.
"""

import math
from dataclasses import dataclass

from yeastfit.errors import InputError
from yeastfit.inference.targets import Targets
from yeastfit.memory import check_memory
from yeastfit.model.numerics import POINT, STEPS, WIDE, check_capacity, check_substeps
from yeastfit.numbers import POSITIVE

FARTHER = 1.3  # times as far as any colony of the data: simulated ones that reach farther are not measured whole
SMALLEST = 4.0  # L0: no colony's domain is narrower


@dataclass(frozen=True)
class Resolution:
    """Time step in 1/μ*, spacing of the nutrient's grid in L0, most nodes of a colony, and substeps of their motion.

    Births beyond a capacity are cut, which `ColonySimulator.problems` counts; with None, where memory ends.

    Raises:
        InputError: A value is not admissible.
    """

    dt: float = 0.005
    spacing: float = 0.1
    capacity: int | None = None
    substeps: int = 1

    def __post_init__(self) -> None:
        STEPS.read(self.dt, "dt")
        check_substeps(self.substeps)
        side = SMALLEST / POSITIVE.read(self.spacing, "spacing")
        check_memory(POINT * side * side, f"spacing is {self.spacing:g}, which over {SMALLEST:g} L0")
        if self.capacity is not None:
            check_capacity(self.capacity)


COARSE = Resolution(dt=0.01, spacing=0.2)
OF_WIDE_DISHES = Resolution(dt=0.025, spacing=0.4, substeps=4)


def usual_in(width: float, narrow: Resolution) -> Resolution:
    """That of a dish of a width in L0, where a narrow one has another."""
    return OF_WIDE_DISHES if WIDE < width < math.inf else narrow


def seen_width(targets: Targets) -> float:
    """Width in L0 of what is seen of colonies like the data's.

    Raises:
        InputError: The targets do not tell.
    """
    imaging = targets.imaging
    if imaging is None or imaging.extent is None:
        raise InputError("targets have no imaging: colonies need to know how shapes were measured, `Imaging`")
    return 2 * FARTHER * imaging.extent


def usual_resolution(targets: Targets, coarse: bool = False) -> Resolution:
    """That of colonies like the data's; coarse, of those that `fit` makes ensembles of and corrects by finer ones.

    Raises:
        InputError: The targets do not tell how wide colonies are.
    """
    return usual_in(seen_width(targets), COARSE if coarse else Resolution())
