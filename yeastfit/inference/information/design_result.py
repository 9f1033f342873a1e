"""Results of `design`: candidates for the next measurement, by what they tell about λ, and the best sequence."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.information.result import Information
from yeastfit.storage import read_json, write_json

Criterion = Literal["mean", "volume"]


@dataclass(frozen=True)
class Choice:
    """One measurement: some statistics at one time, the errors of log λ after it, and by what share it lowers them.

    reduction: of the criterion, compared with before. errors: by parameter. typical: the criterion.
    """

    statistics: tuple[str, ...]
    time: float
    reduction: float
    typical: float
    errors: dict[str, float]

    def row(self) -> dict[str, Any]:
        """For a table; errors in percent."""
        what = {"statistics": " ".join(self.statistics), "time": self.time}
        numbers = {"reduction_percent": 100 * self.reduction, "typical_error_percent": 100 * self.typical}
        return {**what, **numbers, **{f"{name}_error_percent": 100 * e for name, e in self.errors.items()}}


@dataclass(frozen=True)
class Design:
    """Result of `design`.

    before: information in what is measured, without the plausible range as a prior. typical, errors: at the start,
    with it. images, curves: every candidate as the next measurement, a whole image or a single statistic; sequence: the
    best ones, one after the other. added: colonies in each.
    """

    free: tuple[str, ...]
    statistics: tuple[str, ...]
    times: Float[np.ndarray, " time"]
    criterion: Criterion
    added: float
    new_colonies: bool
    before: Information
    typical: float
    errors: dict[str, float]
    images: tuple[Choice, ...]
    curves: tuple[Choice, ...]
    sequence: tuple[Choice, ...]

    def table(self) -> Float[np.ndarray, "statistic time"]:
        """Reduction by each single statistic at each time; nan where it is none of the candidates."""
        found = np.full((len(self.statistics), len(self.times)), np.nan)
        for choice in self.curves:
            found[self.statistics.index(choice.statistics[0]), np.argmin(np.abs(self.times - choice.time))] = (
                choice.reduction
            )
        return found

    def sentences(self) -> list[str]:
        """The sequence in words."""
        said, states = list[str](), [(self.typical, self.errors), *((c.typical, c.errors) for c in self.sequence)]
        who = f"{self.added:g} further colonies" if self.new_colonies else "the same colonies"
        for choice, ((typical, errors), (less, fewer)) in zip(self.sequence, pairwise(states), strict=True):
            each = ", ".join(f"{name} {percent(errors[name])} → {percent(fewer[name])}" for name in self.free)
            said.append(
                f"measure {', '.join(choice.statistics)} at {choice.time:g} in {who}: "
                f"the typical error falls from {percent(typical)} to {percent(less)} ({each})"
            )
        return said

    def rows(self) -> list[dict[str, Any]]:
        """Every candidate as the next measurement, the best first."""
        return [choice.row() for choice in sorted((*self.images, *self.curves), key=lambda choice: -choice.reduction)]

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        named = ("free", "statistics", "times", "criterion", "added", "new_colonies", "typical", "errors")
        choices = {name: [vars(choice) for choice in getattr(self, name)] for name in ("images", "curves", "sequence")}
        return {
            **{name: getattr(self, name) for name in named},
            **choices,
            "before": self.before.asdict(),
            "sentences": self.sentences(),
        }

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    def load(path: str | Path) -> "Design":
        """What `save` wrote."""
        data = read_json(path)

        def choices(name: str) -> tuple[Choice, ...]:
            return tuple(Choice(**{**choice, "statistics": tuple(choice["statistics"])}) for choice in data[name])

        changed: dict[str, Any] = {
            **{name: tuple(data[name]) for name in ("free", "statistics")},
            **{name: choices(name) for name in ("images", "curves", "sequence")},
            "times": np.array(data["times"], dtype=float),
            "before": Information.fromdict(data["before"]),
        }
        return Design(**{name: changed.get(name, data[name]) for name in Design.__dataclass_fields__})
