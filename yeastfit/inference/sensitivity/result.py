"""What `sensitivity` returns."""

from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from yeastfit.inference.curve_covariance import Square
from yeastfit.numbers import POSITIVE, SEEDS, Range
from yeastfit.observable import Observable
from yeastfit.storage import read_json, reads_saved, write_json
from yeastfit.text import short

EstimatorName = Literal["combined", "regression", "pathwise"]
Jacobian = Float[np.ndarray, "observable free"]
Means = Float[np.ndarray, " observable"]


LARGEST = 1e30  # of what an estimate can hold; squares of it are of double precision
ROUNDING = 1e-5


class SensitivityStatus(StrEnum):
    """Whether an estimate is to be doubted; the values are messages."""

    ESTIMATED = "means and derivatives are estimated"
    DOUBTFUL = "means and derivatives are estimated, with doubts that the warnings name"


@dataclass(frozen=True, eq=False)
class Estimate:
    """J by one estimator, and its standard errors."""

    jacobian: Jacobian
    error: Jacobian


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Means of a simulator's rows and their derivatives in log λ.

    Attributes:
        at: λ, all parameters by name, free and fixed.
        free: Names of those with respect to which.
        plausible: Their plausible ranges.
        observables: What the rows of all tables are.
        method: The estimator.
        mean: At λ itself.
        mean_error: Its standard errors.
        jacobian: J.
        error: Its standard errors.
        pathwise_share: w, the weight of pathwise derivatives in J.
        parts: The estimators that went into it, by name; nan where paths were not simulated.
        tails: How much outliers among pathwise derivatives would have raised their scatter; 1 where there were none.
        scatter: Covariance of one simulation.
        correlation: Of the errors of a column of J, by the regression; without one, that of the simulations.
        runs: Simulations, by what for.
        seconds: Likewise.
        seed: Of all random numbers.
        spread: Of log λ in the regression.
        warnings: What is to be doubted, in words.
    """

    at: dict[str, float]
    free: tuple[str, ...]
    plausible: dict[str, tuple[float, float]]
    observables: tuple[Observable, ...]
    method: EstimatorName
    mean: Means
    mean_error: Means
    jacobian: Jacobian
    error: Jacobian
    pathwise_share: Means
    parts: dict[str, Estimate]
    tails: Means
    scatter: Square
    correlation: Square
    runs: dict[str, int]
    seconds: dict[str, float]
    seed: int
    spread: float
    warnings: tuple[str, ...]

    @property
    def status(self) -> SensitivityStatus:
        """Whether there are warnings."""
        return SensitivityStatus.DOUBTFUL if self.warnings else SensitivityStatus.ESTIMATED

    @property
    def statistics(self) -> tuple[str, ...]:
        """Names of the statistics, in order."""
        return tuple(dict.fromkeys(one.statistic for one in self.observables))

    @property
    def times(self) -> Float[np.ndarray, " time"]:
        """Times of the observables, rising; nan where they have none."""
        return np.unique([one.time for one in self.observables])

    def on_grid(self, values: Float[np.ndarray, "observable *more"]) -> Float[np.ndarray, "statistic time *more"]:
        """A table over statistics and times, from one over observables; nan where there is no such observable."""
        statistics, times = self.statistics, self.times
        found = np.full((len(statistics), len(times), *values.shape[1:]), np.nan)
        for one, value in zip(self.observables, values, strict=True):
            found[statistics.index(one.statistic), np.searchsorted(times, one.time)] = value
        return found

    @property
    def carried_by(self) -> tuple[str, ...]:
        """The estimator with the larger weight, of each observable."""
        return tuple("pathwise" if share > 0.5 else "regression" for share in self.pathwise_share)

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per statistic, time and parameter."""
        return [
            {
                "statistic": one.statistic,
                "time": one.time,
                "parameter": name,
                "mean": float(self.mean[row]),
                "mean_error": float(self.mean_error[row]),
                "derivative": float(self.jacobian[row, k]),
                "error": float(self.error[row, k]),
                "carried_by": self.carried_by[row],
                "pathwise_share": float(self.pathwise_share[row]),
            }
            for row, one in enumerate(self.observables)
            for k, name in enumerate(self.free)
        ]

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        return {**asdict(self), "status": self.status}

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    @reads_saved("sensitivity")
    def load(path: str | Path) -> "Sensitivity":
        """Read what `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        data = read_json(path)
        arrays = ("mean", "mean_error", "jacobian", "error", "pathwise_share", "tails", "scatter", "correlation")
        read = {name: np.array(data[name], dtype=float) for name in arrays}
        if broken := [name for name, values in read.items() if np.isnan(values).any()]:
            raise ValueError(f"{broken[0]} holds NaN")
        if data["method"] not in get_args(EstimatorName):
            raise ValueError(
                f"method is {short(data['method'])}, it must be one of {', '.join(get_args(EstimatorName))}"
            )
        _check_parts(data, read)
        changed = {
            "free": tuple(data["free"]),
            "plausible": {name: tuple(ends) for name, ends in data["plausible"].items()},
            "observables": tuple(Observable(**one) for one in data["observables"]),
            "parts": {
                name: Estimate(**{key: np.array(values, dtype=float) for key, values in part.items()})
                for name, part in data["parts"].items()
            },
            "warnings": tuple(data["warnings"]),
            **read,
        }
        found = Sensitivity(**{one.name: changed.get(one.name, data[one.name]) for one in fields(Sensitivity)})
        if data.get("status", found.status) != found.status:
            raise ValueError(f"status is {short(data['status'])}, with these warnings it is {str(found.status)!r}")
        return found


def _check_parts(data: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Raise `ValueError` where the parts of a file are none, or do not fit each other."""
    for name, kind in {"at": dict, "plausible": dict, "runs": dict, "free": list, "observables": list}.items():
        if not isinstance(data[name], kind) or not data[name]:
            raise ValueError(f"{name} is {short(data[name])}")
    rows, columns = len(data["observables"]), len(data["free"])
    square, table = {"scatter", "correlation"}, {"jacobian", "error"}
    for name, values in arrays.items():
        shape = (rows, rows) if name in square else (rows, columns) if name in table else (rows,)
        if values.shape != shape:
            raise ValueError(f"{name} has the shape {values.shape} instead of {shape}")
    largest = {"correlation": 1.0 + ROUNDING, "pathwise_share": 1.0 + ROUNDING}
    for name, values in arrays.items():
        most = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        if most > largest.get(name, LARGEST):
            raise ValueError(f"{name} holds {most:g}, it can be at most {largest.get(name, LARGEST):g}")
    for known in ("at", "plausible"):
        if strange := [name for name in data["free"] if name not in data[known]]:
            raise ValueError(f"free names {short(strange[0])}, of which {known} says nothing")
    if not all(isinstance(value, int | float) for value in data["at"].values()):
        raise ValueError(f"at is {short(data['at'])}")
    for name, ends in data["plausible"].items():
        numbers = isinstance(ends, list | tuple) and all(isinstance(end, int | float) for end in ends)
        if not numbers or len(ends) != 2 or not ends[0] < ends[1]:
            raise ValueError(f"plausible {short(name)} is {short(ends)}, it must be two numbers that rise")
    for one in data["observables"]:
        if not isinstance(one["statistic"], str) or not isinstance(one.get("time", 0.0), int | float):
            raise ValueError(f"an observable is {short(one)}")
    for name in ("mean_error", "error"):
        if (arrays[name] < 0).any():
            raise ValueError(f"{name} holds {arrays[name].min():g}, it must be at least 0")
    SEEDS.check(data["seed"], "seed")
    POSITIVE.check(data["spread"], "spread")
    for name in ("runs", "seconds"):
        for key, value in data[name].items():
            Range(0.0).check(value, f"{name}, {short(key)},")
    if not all(isinstance(one, str) for one in data["warnings"]):
        raise ValueError(f"warnings are {short(data['warnings'])}")
