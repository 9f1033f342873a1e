"""How a fit is computed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from yeastfit.errors import InputError
from yeastfit.measure.statistics.registry import STATISTICS, measurement_errors
from yeastfit.measure.statistics.statistic import Statistic

Method = Literal["levenberg-marquardt", "dogleg", "bfgs"]


@dataclass(frozen=True)
class FitSettings:
    """How a fit is computed. Defaults suit colonies of up to some hundred cells on two cores.

    method: of optimistix. screened: points of the box that are looked at, one colony each; starts: the best of them,
    from which the fit begins. members: colonies of an ensemble, stage by stage; the last stage takes more where there
    are many curves, four for each. spreads: of log λ among them, likewise. dt, spacing: of their model, spacing of the
    nutrient's grid in L0. refined: colonies that tell what fine_dt and fine_spacing change, those of the model that is
    meant; 0 for none. capacity: most nodes of a colony; by default as many as could be born, at most 4096.

    tolerance: of χ². The last stage ends where another step is not expected to lower χ² by more; the others at 1, which
    is one standard error in one direction. max_steps: evaluations in a stage, at most. patience: refused steps in a row
    that end a stage, as a finite ensemble's mean is rough on the scale of its Monte-Carlo error.

    measurement_error: relative error of a measured mean that replicates do not average out, half of its variance common
    to all times; one number, or by statistic, the registry's for those not named. On 8 synthetic sets means of outlines
    were off those of the colonies put in by 0.5 to 1.9 % in compactness (standard deviation), and by 0.4 % at most in
    radius.
    """

    method: Method = "levenberg-marquardt"
    screened: int = 64
    starts: int = 3
    members: tuple[int, ...] = (16, 64, 256)
    spreads: tuple[float, ...] = (0.2, 0.15, 0.1)
    dt: float = 0.01
    spacing: float = 0.2
    refined: int = 96
    fine_dt: float = 0.005
    fine_spacing: float = 0.1
    capacity: int | None = None
    tolerance: float = 0.3
    max_steps: int = 8
    patience: int = 2
    measurement_error: float | Mapping[str, float] = field(default_factory=measurement_errors)

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise InputError(f"method is {self.method!r}, it must be one of {', '.join(get_args(Method))}")
        for name in ("screened", "starts", "max_steps", "patience"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least 1")
        if self.refined < 0 or 0 < self.refined < 16:
            raise InputError(f"refined is {self.refined}, it must be 0 or at least 16")
        for name in ("dt", "spacing", "fine_dt", "fine_spacing", "tolerance"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} is {getattr(self, name)}, it must be above 0")
        if not self.members or len(self.members) != len(self.spreads):
            raise InputError(
                f"members {self.members} and spreads {self.spreads}: each stage has one of both, and there is one"
            )
        for members, spread in zip(self.members, self.spreads, strict=True):
            if members < 8 or members % 2 or not 0 < spread < 1:
                raise InputError(
                    f"a stage has members {members} and spread {spread}: need an even number of at least 8, and a "
                    "number between 0 and 1"
                )

    def error_of(self, statistic: str) -> float:
        """The relative measurement error of one statistic, the registry's where none is given for it."""
        given = self.measurement_error
        if not isinstance(given, Mapping):
            return float(given)
        usual = STATISTICS[statistic].measurement_error if statistic in STATISTICS else Statistic.measurement_error
        return float(given.get(statistic, usual))
