"""Results of `design`: candidates for the next measurement, by what they tell about λ, and the best sequence."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.information.result import Information, InformationStatus
from yeastfit.storage import read_json, reads_saved, write_json

Criterion = Literal["mean", "volume"]
MORE = 0.02  # of the typical error, by which one statistic may seem to tell more than the image that it is of


@dataclass(frozen=True)
class Candidate:
    """One measurement that could be made.

    Attributes:
        statistics: That it measures.
        time: When.
        reduction: Share by which it lowers the criterion.
        typical_error: The criterion after it.
        log_standard_errors: Of log λ after it, by name.
    """

    statistics: tuple[str, ...]
    time: float
    reduction: float
    typical_error: float
    log_standard_errors: dict[str, float]

    def row(self) -> dict[str, Any]:
        """For a table; errors in percent."""
        what = {"statistics": " ".join(self.statistics), "time": self.time}
        numbers = {"reduction_percent": 100 * self.reduction, "typical_error_percent": 100 * self.typical_error}
        errors = {f"{name}_error_percent": 100 * error for name, error in self.log_standard_errors.items()}
        return {**what, **numbers, **errors}


@dataclass(frozen=True, eq=False)
class Design:
    """Result of `design`.

    Attributes:
        free: Names of the parameters.
        statistics: That could be measured.
        times: When.
        criterion: What is minimised.
        added: Replicates of each measurement.
        new_replicates: Whether these are further ones.
        before: Information in what is measured, without the plausible range as a prior.
        typical_error: The criterion before, with the plausible range.
        log_standard_errors: Of log λ before, likewise.
        images: Every candidate of all statistics at a time, as the next measurement.
        singles: Every candidate of a single statistic, likewise.
        sequence: The best measurements, one after the other.
    """

    free: tuple[str, ...]
    statistics: tuple[str, ...]
    times: Float[np.ndarray, " time"]
    criterion: Criterion
    added: float
    new_replicates: bool
    before: Information
    typical_error: float
    log_standard_errors: dict[str, float]
    images: tuple[Candidate, ...]
    singles: tuple[Candidate, ...]
    sequence: tuple[Candidate, ...]

    @property
    def status(self) -> InformationStatus:
        """Whether what is measured so far determines all parameters."""
        return self.before.status

    def table(self) -> Float[np.ndarray, "statistic time"]:
        """Reduction by each single statistic at each time; nan where it is none of the candidates."""
        found = np.full((len(self.statistics), len(self.times)), np.nan)
        for one in self.singles:
            found[self.statistics.index(one.statistics[0]), self.column(one)] = one.reduction
        return found

    def column(self, candidate: Candidate) -> int:
        """Number of a candidate's time."""
        return int(np.searchsorted(self.times, candidate.time))

    def sentences(self) -> list[str]:
        """The sequence in words."""
        said, before, errors = list[str](), self.typical_error, self.log_standard_errors
        who = f"{self.added:g} further replicates" if self.new_replicates else "the same replicates"
        for one in self.sequence:
            after, fewer = one.typical_error, one.log_standard_errors
            each = ", ".join(f"{name} {percent(errors[name])} → {percent(fewer[name])}" for name in self.free)
            when = "" if np.isnan(one.time) else f" at {one.time:g}"
            gain = f"falls from {percent(before)} to {percent(after)}"
            if percent(before) == percent(after):
                gain = f"stays at {percent(after)}: nothing is gained"
            said.append(f"measure {', '.join(one.statistics)}{when} in {who}: the typical error {gain} ({each})")
            before, errors = after, fewer
        return said

    def doubts(self) -> list[str]:
        """What is to be doubted about the candidates: a statistic that tells more than the image that it is of."""
        said = list[str]()
        for image in self.images:
            own = [one for one in self.singles if self.column(one) == self.column(image)]
            best = max(own, key=lambda one: one.reduction, default=image)
            if best.reduction > image.reduction + MORE:
                when = "" if np.isnan(image.time) else f" at {image.time:g}"
                said.append(
                    f"{best.statistics[0]} alone{when} seems to lower the typical error by "
                    f"{100 * best.reduction:.0f} %, all statistics of the image by {100 * image.reduction:.0f} %, "
                    "which cannot be: the noise of the derivatives decides between candidates, take more runs"
                )
        return said

    def rows(self) -> list[dict[str, Any]]:
        """Every candidate as the next measurement, the best first."""
        return [one.row() for one in sorted((*self.images, *self.singles), key=lambda one: -one.reduction)]

    def asdict(self) -> dict[str, Any]:
        """Plain data, derived values included."""
        candidates = {name: [vars(one) for one in getattr(self, name)] for name in ("images", "singles", "sequence")}
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {
            **plain,
            **candidates,
            "before": self.before.asdict(),
            "status": self.status,
            "sentences": self.sentences(),
        }

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    @reads_saved("design")
    def load(path: str | Path) -> "Design":
        """Read what `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        data = read_json(path)

        def candidates(name: str) -> tuple[Candidate, ...]:
            return tuple(Candidate(**{**one, "statistics": tuple(one["statistics"])}) for one in data[name])

        changed: dict[str, Any] = {
            **{name: tuple(data[name]) for name in ("free", "statistics")},
            **{name: candidates(name) for name in ("images", "singles", "sequence")},
            "times": np.array(data["times"], dtype=float),
            "before": Information.fromdict(data["before"]),
        }
        return Design(**{name: changed.get(name, data[name]) for name in Design.__dataclass_fields__})
