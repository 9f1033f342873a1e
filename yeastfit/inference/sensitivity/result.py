"""What `sensitivity` returns."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from yeastfit.model.parameters import Parameters
from yeastfit.storage import read_json, write_json

Method = Literal["combined", "regression", "pathwise"]
Table = Float[np.ndarray, "statistic time free"]


@dataclass(frozen=True)
class Estimate:
    """J and its standard errors by one estimator, [statistic, time, free]."""

    jacobian: Table
    error: Table


@dataclass(frozen=True)
class Sensitivity:
    """Mean curves of an ensemble and their derivatives in log λ.

    mean, mean_error: [statistic, time], of the model at λ itself. jacobian, error: [statistic, time, free], by
    `method`. pathwise_share: w, [statistic, time]. parts: the estimators that went into it, by name; NaN where a path
    was not grown. tails: by how much outliers among pathwise derivatives would have raised their scatter, [statistic,
    time], 1 where there were none. scatter: covariance of one colony's curves over statistics and times.
    correlation: of the errors of a column of J over them, by the regression; without one, that of the colonies.
    runs: colonies grown, by what for. seconds: likewise.
    """

    parameters: Parameters
    free: tuple[str, ...]
    statistics: tuple[str, ...]
    times: Float[np.ndarray, " time"]
    method: Method
    mean: Float[np.ndarray, "statistic time"]
    mean_error: Float[np.ndarray, "statistic time"]
    jacobian: Table
    error: Table
    pathwise_share: Float[np.ndarray, "statistic time"]
    parts: dict[str, Estimate]
    tails: Float[np.ndarray, "statistic time"]
    scatter: Float[np.ndarray, "curve curve"]
    correlation: Float[np.ndarray, "curve curve"]
    runs: dict[str, int]
    seconds: dict[str, float]
    seed: int
    spread: float
    warnings: list[str]

    def carried_by(self) -> np.ndarray:
        """The estimator with the larger weight in each entry of [statistic, time]."""
        return np.where(self.pathwise_share > 0.5, "pathwise", "regression")

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per statistic, time and parameter."""
        carried = self.carried_by()
        return [
            {
                "statistic": statistic,
                "time": float(time),
                "parameter": name,
                "mean": float(self.mean[s, t]),
                "mean_error": float(self.mean_error[s, t]),
                "derivative": float(self.jacobian[s, t, k]),
                "error": float(self.error[s, t, k]),
                "carried_by": str(carried[s, t]),
                "pathwise_share": float(self.pathwise_share[s, t]),
            }
            for s, statistic in enumerate(self.statistics)
            for t, time in enumerate(self.times)
            for k, name in enumerate(self.free)
        ]

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        return {**asdict(self), "parameters": self.parameters.asdict()}

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    def load(path: str | Path) -> "Sensitivity":
        """What `save` wrote."""
        data = read_json(path)

        def array(values: Any) -> np.ndarray:
            return np.array(values, dtype=float)

        parts = {name: Estimate(**{k: array(v) for k, v in part.items()}) for name, part in data["parts"].items()}
        arrays = ("times", "mean", "mean_error", "jacobian", "error", "pathwise_share", "tails", "scatter")
        changed = {
            "parameters": Parameters(**data["parameters"]),
            "parts": parts,
            **{name: array(data[name]) for name in (*arrays, "correlation")},
            **{name: tuple(data[name]) for name in ("free", "statistics")},
        }
        return Sensitivity(**{**data, **changed})
