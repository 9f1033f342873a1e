"""Result of a fit: values, errors, status, and all it takes to repeat and to plot it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.information.result import Information
from yeastfit.inference.paired_regression import CurveSquare
from yeastfit.inference.parameter_space import Entry, Space, Vector
from yeastfit.inference.targets import Targets
from yeastfit.model.parameters import NAMES, Parameters
from yeastfit.storage import read_json, versions, write_json

WORST = 3  # curves that a misfit names


@dataclass(frozen=True)
class Condition:
    """One condition's part: its targets, λ, the model's mean curves at the estimate, and Σ of its measured points."""

    name: str
    targets: Targets
    parameters: Parameters
    fitted: Float[np.ndarray, "statistic time"]
    covariance: CurveSquare

    @property
    def residuals(self) -> Float[np.ndarray, " curve"]:
        """(target − fitted) / error of the comparison, of the measured points."""
        measured = self.targets.measured
        return (self.targets.values - self.fitted[measured]) / np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Start:
    """Where a start began and ended its first stage, in θ; cost: its rough χ² there; carried: whether it went on."""

    number: int
    begin: Vector
    end: Vector
    cost: float
    ended: str
    carried: bool


@dataclass(frozen=True)
class Step:
    """One evaluation. members: of each ensemble there; simulations: colonies grown so far; values: λ by entry."""

    stage: str
    start: int
    members: int
    simulations: int
    cost: float
    taken: bool
    values: dict[str, float]


@dataclass(frozen=True)
class Fit:
    """Result of `fit`.

    theta: log λ of the entries of `space`. information: Fisher's, of the data and the priors. jacobian: of all measured
    points, condition by condition. chi_square: priors included. prior: centre and width in log λ by entry. status: how
    it ended, in words.
    """

    conditions: tuple[Condition, ...]
    space: Space
    theta: Vector
    information: Information
    jacobian: Float[np.ndarray, "curve entry"]
    chi_square: float
    converged: bool
    status: str
    starts: tuple[Start, ...]
    history: tuple[Step, ...]
    simulations: int
    seed: int
    settings: FitSettings
    prior: dict[str, tuple[float, float]]
    seconds: float
    warnings: tuple[str, ...]

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the entries."""
        return self.space.names

    @property
    def parameters(self) -> Parameters:
        """λ of the only condition; raises `InputError` where there are several."""
        return self._only().parameters

    @property
    def targets(self) -> Targets:
        """Of the only condition; raises `InputError` where there are several."""
        return self._only().targets

    @property
    def values(self) -> dict[str, float]:
        """λ of the free entries."""
        return dict(zip(self.free, np.exp(self.theta).tolist(), strict=True))

    @property
    def covariance(self) -> Float[np.ndarray, "entry entry"]:
        """Of log λ; nan for entries that the data do not determine."""
        return self.information.covariance

    @property
    def standard_errors(self) -> dict[str, float]:
        """Of λ, to first order; nan where the data do not determine one."""
        relative = self.information.standard_errors
        return {name: value * relative[name] for name, value in self.values.items()}

    @property
    def degrees_of_freedom(self) -> int:
        """Number of target values, and of priors, less that of free entries."""
        data = sum(len(each.targets.values) for each in self.conditions)
        return data + len(self.prior) - len(self.free)

    def misfit(self) -> list[str]:
        """In words, where the model does not reach the data: χ² more than four deviations above its mean."""
        freedom = max(1, self.degrees_of_freedom)
        if self.chi_square <= freedom + 4 * np.sqrt(2 * freedom):
            return []
        off = [
            (float(value), each.targets.label(k) + (f" of {each.name}" if each.name else ""))
            for each in self.conditions
            for k, value in enumerate(each.residuals)
        ]
        worst = sorted(off, key=lambda one: -abs(one[0]))[:WORST]
        named = ", ".join(f"{where} is {abs(x):.1f} errors {'above' if x > 0 else 'below'} it" for x, where in worst)
        return [
            f"the model does not reach the data: chi-square {self.chi_square:.0f} on {freedom} degrees of freedom; "
            + named
        ]

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: a row for each parameter of each condition."""
        table = []
        for each in self.conditions:
            values = each.parameters.asdict()
            columns = {self.space.entries[k].parameter: k for k in self.space.columns(each.name)}
            for name in NAMES:
                entry = self.free[columns[name]] if name in columns else None
                error = None if entry is None else self.standard_errors[entry]
                shared = entry is not None and self.space.entries[columns[name]].condition is None
                role = "fixed" if entry is None else "shared" if shared and len(self.conditions) > 1 else "free"
                row = {"parameter": name, "value": values[name], "standard_error": error, "role": role}
                table.append({"condition": each.name, **row} if len(self.conditions) > 1 else row)
        return table

    def with_warnings(self, warnings: Sequence[str]) -> "Fit":
        """The same with warnings."""
        return replace(self, warnings=tuple(warnings))

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        conditions = [
            {
                "name": each.name,
                "parameters": each.parameters.asdict(),
                "targets": each.targets.asdict(),
                "fitted": each.fitted,
                "covariance": each.covariance,
            }
            for each in self.conditions
        ]
        fixed = {name: held.asdict() for name, held in self.space.fixed.items()}
        return {
            "parameters": self.rows(),
            "status": self.status,
            "converged": self.converged,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees_of_freedom,
            "warnings": self.warnings,
            "simulations": self.simulations,
            "seconds": self.seconds,
            "seed": self.seed,
            "settings": asdict(self.settings),
            "space": {"entries": [asdict(entry) for entry in self.space.entries], "fixed": fixed},
            "theta": self.theta,
            "covariance_of_logarithms": {"names": self.free, "matrix": self.covariance},
            "information": self.information.asdict(),
            "jacobian": self.jacobian,
            "prior": self.prior,
            "starts": [asdict(start) for start in self.starts],
            "history": [asdict(step) for step in self.history],
            "conditions": conditions,
            "versions": versions(),
        }

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    def load(path: str | Path) -> "Fit":
        """What `save` wrote."""
        data = read_json(path)
        space = Space(
            tuple(Entry(one["parameter"], one["condition"], tuple(one["bounds"])) for one in data["space"]["entries"]),
            {name: Parameters(**held) for name, held in data["space"]["fixed"].items()},
        )
        conditions = tuple(
            Condition(
                one["name"],
                Targets.fromdict(one["targets"]),
                Parameters(**one["parameters"]),
                np.array(one["fitted"], dtype=float),
                np.array(one["covariance"], dtype=float),
            )
            for one in data["conditions"]
        )
        vectors = ("begin", "end")
        starts = [{**one, **{name: np.array(one[name], dtype=float) for name in vectors}} for one in data["starts"]]
        settings: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data["settings"].items()}
        plain = ("chi_square", "converged", "status", "simulations", "seed", "seconds")
        return Fit(
            conditions=conditions,
            space=space,
            theta=np.array(data["theta"], dtype=float),
            information=Information.fromdict(data["information"]),
            jacobian=np.array(data["jacobian"], dtype=float),
            starts=tuple(Start(**one) for one in starts),
            history=tuple(Step(**one) for one in data["history"]),
            settings=FitSettings(**settings),
            prior={name: (one[0], one[1]) for name, one in data["prior"].items()},
            warnings=tuple(data["warnings"]),
            **{name: data[name] for name in plain},
        )

    def _only(self) -> Condition:
        if len(self.conditions) != 1:
            names = ", ".join(repr(each.name) for each in self.conditions)
            raise InputError(f"the fit has the conditions {names}: take one of `conditions`")
        return self.conditions[0]
