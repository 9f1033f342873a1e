"""Where a fit began, and every point that it evaluated."""

from dataclasses import dataclass

from yeastfit.inference.parameter_space import Vector


@dataclass(frozen=True)
class Start:
    """One start of a fit.

    Attributes:
        number: From 1.
        begin: θ where it began.
        end: θ where its first stage ended.
        cost: χ² there, with the screening covariance; infinite where simulations failed.
        ended: Why, in words.
        carried: Whether it went on.
    """

    number: int
    begin: Vector
    end: Vector
    cost: float
    ended: str
    carried: bool


@dataclass(frozen=True)
class Step:
    """One evaluation.

    Attributes:
        stage: Its name.
        start: Number of the start.
        members: Of each ensemble there.
        simulations: Made so far.
        cost: χ².
        taken: Whether the step was taken.
        values: Free parameters by entry.
    """

    stage: str
    start: int
    members: int
    simulations: int
    cost: float
    taken: bool
    values: dict[str, float]
