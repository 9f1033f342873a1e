"""What `yeastfit design` does: a sensitivity, run or read, the design that follows from it, and the files of both."""

from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from yeastfit import plot
from yeastfit.errors import InputError
from yeastfit.inference.information.design_result import Design
from yeastfit.inference.sensitivity.estimate import sensitivity
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.progress import Progress
from yeastfit.storage import write_table

RESULTS = ("design.csv", "design.json", "information.json", "design.png", "spectrum.png", "ellipses.png")


def numbers(option: str, text: str) -> list[float]:
    """Numbers with commas; none where the text is "none"."""
    try:
        return [] if text.strip() == "none" else [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} is {text!r}, it must be numbers with commas, such as 2.5,4.5,6.5") from None


def names(text: str) -> tuple[str, ...]:
    """Names with commas, a minus for an underscore allowed."""
    return tuple(part.strip().replace("-", "_") for part in text.split(","))


@dataclass(frozen=True)
class Run:
    """Options of the colonies to be grown, as they are given; λ by name where it is not the default."""

    changed: dict[str, float] = field(default_factory=dict)
    times: str = "2,3,4,5,6"
    statistics: str = "compactness,radius,area"
    runs: int = 256
    dt: float = 0.005
    seed: int = 0

    def sensitivity(self, progress: Progress) -> Sensitivity:
        """By regression in all seven parameters, which costs as much as in one: any of them may be free later."""
        times = numbers("--times", self.times)
        if not times or not np.isfinite(times).all() or min(times) <= 0:
            raise InputError(f"--times is {self.times!r}, it must hold numbers above 0")
        # every node may bud once in a unit of time
        numerics = Numerics(dt=self.dt, capacity=2 ** (int(np.floor(max(times) + 1e-6)) + 1))
        return sensitivity(
            Parameters(**self.changed),
            times=times,
            statistics=names(self.statistics),
            method="regression",
            runs=self.runs,
            seed=self.seed,
            numerics=numerics,
            progress=progress,
        )

    def refuse_beside(self, path: Path) -> None:
        """Raises `InputError` where an option asks for other colonies than those that were grown."""
        given = [*self.changed, *(one.name for one in fields(self)[1:] if getattr(self, one.name) != one.default)]
        if given:
            option = "--" + given[0].replace("_", "-")
            raise InputError(f"{option} is given beside --sensitivity, but {path} says it: leave out one of the two")


def read_sensitivity(path: Path) -> Sensitivity:
    """What a `Run` left."""
    try:
        return Sensitivity.load(path)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"--sensitivity: {path} cannot be read as one ({type(error).__name__}: {error}), "
            "need the sensitivity.json of an earlier run"
        ) from error


def write_design(folder: Path, found: Design) -> None:
    """Tables, JSON and pictures."""
    write_table(folder / "design.csv", found.rows())
    found.save(folder / "design.json")
    found.before.save(folder / "information.json")
    plot.save(plot.design(found), folder / "design.png")
    plot.save(plot.spectrum(found.before), folder / "spectrum.png")
    plot.save(plot.ellipses(found.before), folder / "ellipses.png")
