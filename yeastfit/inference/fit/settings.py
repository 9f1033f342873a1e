"""How a fit is computed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from yeastfit.errors import InputError
from yeastfit.kinds import check_kind
from yeastfit.memory import check_count
from yeastfit.numbers import AT_LEAST_ONE, POSITIVE, Range

OptimiserName = Literal["levenberg-marquardt", "dogleg", "bfgs"]


@dataclass(frozen=True)
class FitSettings:
    """How a fit is computed. Defaults suit colonies of up to some hundred cells on two cores.

    Attributes:
        method: The optimiser, of optimistix.
        screened: Points of the box that are looked at, with one simulation each.
        starts: The best of them, from which the fit begins.
        members: Simulations of an ensemble, stage by stage. The last stage takes more where there are many data, four
            for each.
        spreads: Of log λ in an ensemble, stage by stage.
        refined: Fine simulations that correct the last stage's ensembles; 0 for none.
        tolerance: Of χ². The last stage ends where another step is not expected to lower χ² by more; the others at 1,
            which is one standard error in one direction.
        max_steps: Evaluations in a stage, at most.
        patience: Rejected steps in a row that end a stage, as the mean of a finite ensemble is rough on the scale of
            its Monte-Carlo error.
        measurement_error: Relative error of a measured mean that replicates do not average out, half of its variance
            common to all times: one number, or by statistic. Statistics not given have their own
            (`Targets.measurement_errors`).

    Raises:
        InputError: A value makes no sense.
    """

    method: OptimiserName = "levenberg-marquardt"
    screened: int = 64
    starts: int = 3
    members: tuple[int, ...] = (16, 64, 256)
    spreads: tuple[float, ...] = (0.2, 0.15, 0.1)
    refined: int = 96
    tolerance: float = 0.3
    max_steps: int = 8
    patience: int = 2
    measurement_error: float | Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if self.method not in get_args(OptimiserName):
            raise InputError(f"method is {self.method!r}, it must be one of {', '.join(get_args(OptimiserName))}")
        for name in ("screened", "starts", "max_steps", "patience"):
            check_count(name, AT_LEAST_ONE.read_whole(getattr(self, name), name))
        if self.starts > self.screened:
            raise InputError(f"starts is {self.starts}, it must be at most the points looked at, {self.screened}")
        if 0 < Range(0).read_whole(self.refined, "refined") < 16:
            raise InputError(f"refined is {self.refined}, it must be 0 or at least 16")
        check_count("refined", self.refined)
        POSITIVE.check(self.tolerance, "tolerance")
        for name in ("members", "spreads"):
            check_kind(name, getattr(self, name), Sequence, "a row with a number for each stage, such as (16, 64)")
        if not self.members or len(self.members) != len(self.spreads):
            raise InputError(
                f"members {self.members} and spreads {self.spreads}: each stage has one of both, and there is one"
            )
        for count in self.members:
            check_count("members", AT_LEAST_ONE.read_whole(count, "members"))
        errors = self.measurement_error
        for what, error in errors.items() if isinstance(errors, Mapping) else [("", errors)]:
            if error is not None:
                Range(0.0, 1.0).check(error, f"measurement_error{' of ' * bool(what)}{what}")
        for members, spread in zip(self.members, self.spreads, strict=True):
            if members < 8 or members % 2 or not 0 < spread < 1:
                raise InputError(
                    f"a stage has members {members} and spread {spread}: need an even number of at least 8, and a "
                    "number between 0 and 1"
                )
