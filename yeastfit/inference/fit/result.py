"""Result of a fit: values, errors, status, and all it takes to repeat and to plot it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import Square
from yeastfit.inference.fit.evaluations import Start, Step
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.information.result import Information
from yeastfit.inference.parameter_space import Entry, ParameterSpace, Vector
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.targets import Targets
from yeastfit.storage import read_json, reads_saved, versions, write_json

WORST = 3  # data that a misfit names
MISFIT = 4.0  # standard deviations of χ², √(2 ν), above its mean ν: by chance 1 fit in 10 000 for ν = 20


class FitStatus(StrEnum):
    """How a fit ended; the values are messages."""

    CONVERGED = "converged"
    WITHIN_NOISE = "converged within the noise of the ensemble"
    NOT_CONVERGED = "not converged"


@dataclass(frozen=True, eq=False)
class Condition:
    """One condition's part of a fit.

    Attributes:
        name: Empty where there is one only.
        targets: Its data.
        parameters: All by name, free and fixed.
        fitted: Means at the estimate; nan where nothing was measured.
        covariance: Σ of the measured points.
    """

    name: str
    targets: Targets
    parameters: dict[str, float]
    fitted: Float[np.ndarray, "statistic time"]
    covariance: Square

    @property
    def residuals(self) -> Float[np.ndarray, " observable"]:
        """(target − fitted) / error of the comparison, of the measured points."""
        measured = self.targets.measured
        return (self.targets.values - self.fitted[measured]) / np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of `fit`.

    Attributes:
        conditions: Each with its data and parameters.
        space: Of the free parameters; an entry is a parameter of all conditions or of one.
        theta: log λ of the entries.
        information: Fisher's, of the data and the priors.
        jacobian: Derivatives of all measured means in θ, condition by condition.
        chi_square: At the estimate, priors included.
        status: How it ended.
        detail: More about that, in words; may be empty.
        starts: Where it began.
        history: All evaluations.
        simulations: How many were made.
        seed: Of all random numbers.
        settings: How it was computed.
        prior: Centre and width of θ, by entry.
        resolutions: Coarse and fine, of colonies; None where the fit is of something else.
        seconds: That it took.
        warnings: What is to be doubted, in words.
        rules: Of colonies, by name, where they are not the source's.
    """

    conditions: tuple[Condition, ...]
    space: ParameterSpace
    theta: Vector
    information: Information
    jacobian: Float[np.ndarray, "observable entry"]
    chi_square: float
    status: FitStatus
    detail: str
    starts: tuple[Start, ...]
    history: tuple[Step, ...]
    simulations: int
    seed: int
    settings: FitSettings
    prior: dict[str, tuple[float, float]]
    resolutions: tuple[Resolution, Resolution] | None
    seconds: float
    warnings: tuple[str, ...]
    rules: dict[str, dict[str, Any]] | None = None

    @property
    def converged(self) -> bool:
        """Whether it did."""
        return self.status is not FitStatus.NOT_CONVERGED

    @property
    def message(self) -> str:
        """Status and detail in one."""
        return f"{self.status}: {self.detail}" if self.detail else str(self.status)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the entries."""
        return self.space.names

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters of the only condition by name, free and fixed.

        Raises:
            InputError: There are several conditions.
        """
        return self._only().parameters

    @property
    def targets(self) -> Targets:
        """Of the only condition.

        Raises:
            InputError: There are several conditions.
        """
        return self._only().targets

    @property
    def values(self) -> dict[str, float]:
        """Estimates λ of the free entries."""
        return dict(zip(self.free, np.exp(self.theta).tolist(), strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Of λ, to first order; nan where the data do not determine one."""
        relative = self.log_standard_errors
        return {name: value * relative[name] for name, value in self.values.items()}

    @property
    def log_standard_errors(self) -> dict[str, float]:
        """Of log λ; nan where the data do not determine one."""
        return self.information.log_standard_errors

    @property
    def log_covariance(self) -> Float[np.ndarray, "entry entry"]:
        """Of log λ; nan for entries that the data do not determine."""
        return self.information.log_covariance

    @property
    def degrees_of_freedom(self) -> int:
        """Number of data, and of priors, less that of free entries."""
        data = sum(len(each.targets.values) for each in self.conditions)
        return data + len(self.prior) - len(self.free)

    @property
    def statistics(self) -> dict[str, float]:
        """What a table of runs shows."""
        named = ("chi_square", "degrees_of_freedom", "simulations", "seconds")
        return {name: getattr(self, name) for name in named}

    def misfit(self) -> list[str]:
        """In words, where the model does not reach the data: χ² far above its mean."""
        freedom = max(1, self.degrees_of_freedom)
        if self.chi_square <= freedom + MISFIT * np.sqrt(2 * freedom):
            return []
        off = [
            (float(value), f"{observable}" + (f" of {each.name}" if each.name else ""))
            for each in self.conditions
            for observable, value in zip(each.targets.observables, each.residuals, strict=True)
        ]
        worst = sorted(off, key=lambda one: -abs(one[0]))[:WORST]
        sides = [(abs(x), "above" if x > 0 else "below", where) for x, where in worst]
        named = ", ".join(f"{where} of the data is {x:.1f} errors {side} the model's" for x, side, where in sides)
        return [
            f"the model does not reach the data: chi-square {self.chi_square:.0f} on {freedom} degrees of freedom; "
            + named
        ]

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: a row for each parameter of each condition."""
        table = []
        for each in self.conditions:
            entries = {self.space.entries[k].parameter: self.space.entries[k] for k in self.space.columns(each.name)}
            for name, value in each.parameters.items():
                entry = entries.get(name)
                error = None if entry is None else self.standard_errors[entry.name]
                shared = entry is not None and entry.condition is None and len(self.conditions) > 1
                role = "fixed" if entry is None else "shared" if shared else "free"
                row = {"parameter": name, "value": value, "standard_error": error, "role": role}
                table.append({"condition": each.name, **row} if len(self.conditions) > 1 else row)
        return table

    def asdict(self) -> dict[str, Any]:
        """Plain data, derived values included."""
        conditions = [{**vars(each), "targets": each.targets.asdict()} for each in self.conditions]
        return {
            "parameters": self.rows(),
            "status": str(self.status),
            "detail": self.detail,
            **self.statistics,
            "warnings": self.warnings,
            "seed": self.seed,
            "settings": asdict(self.settings),
            "resolutions": None if self.resolutions is None else [asdict(one) for one in self.resolutions],
            "rules": self.rules,
            "space": [asdict(entry) for entry in self.space.entries],
            "theta": self.theta,
            "log_covariance": {"names": self.free, "matrix": self.log_covariance},
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
    @reads_saved("fit")
    def load(path: str | Path) -> "Fit":
        """Read what `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        data = read_json(path)
        settings: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data["settings"].items()}
        return Fit(
            conditions=tuple(_condition(one) for one in data["conditions"]),
            space=ParameterSpace(tuple(Entry(**{**one, "bounds": tuple(one["bounds"])}) for one in data["space"])),
            theta=_array(data["theta"]),
            information=Information.fromdict(data["information"]),
            jacobian=_array(data["jacobian"]),
            chi_square=data["chi_square"],
            status=FitStatus(data["status"]),
            detail=data["detail"],
            starts=tuple(
                Start(**{**one, "begin": _array(one["begin"]), "end": _array(one["end"])}) for one in data["starts"]
            ),
            history=tuple(Step(**one) for one in data["history"]),
            simulations=data["simulations"],
            seed=data["seed"],
            settings=FitSettings(**settings),
            prior={name: (one[0], one[1]) for name, one in data["prior"].items()},
            resolutions=_resolutions(data["resolutions"]),
            seconds=data["seconds"],
            warnings=tuple(data["warnings"]),
            rules=data["rules"],
        )

    def _only(self) -> Condition:
        if len(self.conditions) != 1:
            names = ", ".join(repr(each.name) for each in self.conditions)
            raise InputError(f"the fit has the conditions {names}: take one of `conditions`")
        return self.conditions[0]


def _condition(data: Mapping[str, Any]) -> Condition:
    arrays = {name: _array(data[name]) for name in ("fitted", "covariance")}
    return Condition(**{**data, **arrays, "targets": Targets.fromdict(data["targets"])})


def _resolutions(data: Any) -> tuple[Resolution, Resolution] | None:
    return None if data is None else (Resolution(**data[0]), Resolution(**data[1]))


def _array(data: Any) -> np.ndarray:
    return np.array(data, dtype=float)
