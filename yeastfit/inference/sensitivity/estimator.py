"""How the mean of a stochastic simulator answers to its parameters, and how far that answer can be trusted.

What a fit needs is J = ∂E[y] / ∂log λ, the derivative of the mean. Single simulations may be chaotic: what one does
when λ changes a little says nothing about another. Two estimators:

**Regression** (`paired_regression`) simulates away from λ, in pairs at log λ ± spread · ε, and needs no derivative, so
any simulator will do. Its bias, of order spread², is two or three standard errors of 256 colonies at spread 0.2 and a
fraction of one at 0.1. Were all simulations independent, n of them would tell p parameters with 1/p of the variance of
n simulations of central differences; common seeds help those more.

**Pathwise** (`pathwise`) differentiates single simulations, where the simulator can: colonies, by forward mode.

**Combined** shrinks the first towards the second, the more the quieter the second is and the better they agree
(`shrinkage`).

**Scatter**, the covariance S of one simulation, comes of the same runs: of the pairs, and of those at λ itself
(`paired_regression.pooled_covariance`).
"""

import time as clock
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import get_args

import jax
import numpy as np

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.paired_regression import (
    LocalModel,
    Scatter,
    beyond_range,
    hadamard_design,
    hadamard_order,
    paired_points,
    pooled_covariance,
    reaches,
    regress,
    sample_scatter,
)
from yeastfit.inference.sensitivity.pathwise import EXPLODED, Pathwise
from yeastfit.inference.sensitivity.result import Estimate, EstimatorName, Sensitivity
from yeastfit.inference.sensitivity.shrinkage import combine
from yeastfit.inference.simulator import Rows, Seeds, Simulator, member_seeds, named_values, problems_of, rows_of
from yeastfit.memory import check_count
from yeastfit.numbers import AT_LEAST_ONE, Range
from yeastfit.observable import Observable
from yeastfit.progress import Progress
from yeastfit.seeds import key_of


class Part(IntEnum):
    """What simulations are for: each part has seeds of its own."""

    REGRESSION = 0
    MEAN = 1
    PATHS = 2


@dataclass
class Estimator:
    """One estimate of a sensitivity.

    Attributes:
        simulator: Of the model that is meant.
        values: λ of its parameters.
        observables: Its first columns, which are asked for; others serve the pathwise part.
        method: What to estimate J by.
        runs: Simulations for the regression.
        paths: Simulations that are differentiated.
        spread: Of log λ in the regression.
        seed: Of all random numbers.
        progress: Called with what is being done and the share that is done.
        pathwise: Derivatives of single simulations, where the simulator has them.
    """

    simulator: Simulator
    values: np.ndarray
    observables: tuple[Observable, ...]
    method: EstimatorName
    runs: int
    paths: int
    spread: float
    seed: int
    progress: Progress
    pathwise: Pathwise | None = None
    spent: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.method not in get_args(EstimatorName):
            raise InputError(f"method is {self.method!r}, it must be one of {', '.join(get_args(EstimatorName))}")
        if self.pathwise is None and self.method != "regression":
            raise InputError(f"method is {self.method!r}, the simulator has no derivatives of its own: use regression")
        for name in ("runs", "paths"):
            AT_LEAST_ONE.read_whole(getattr(self, name), name)
        Range(0.0, 1.0).check(self.spread, "spread")
        if self.runs < 16 or self.runs % 16:
            raise InputError(f"runs is {self.runs}, it must be a multiple of 16")
        needed = 2 * hadamard_order(len(self.values))
        if self.method != "pathwise" and self.runs < needed:
            raise InputError(f"runs is {self.runs}, {len(self.values)} parameters need at least {needed}")
        check_count("runs", self.runs)
        if self.paths < 4:
            raise InputError(f"paths is {self.paths}, it must be at least 4")
        if not 0 < self.spread < 1:
            raise InputError(f"spread is {self.spread}, it must lie between 0 and 1")
        for name, value in zip(self.simulator.parameters, self.values, strict=True):
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} is {value}, derivatives in log λ need one number above 0")

    def run(self) -> Sensitivity:
        """All parts, and what they say together."""
        met = problems_of(self.simulator).copy()
        rows = self._mean()
        centre = rows[:, : len(self.observables)]
        independent = sample_scatter(centre)
        local = None if self.method == "pathwise" else self._regression()
        self._say("regression and mean", problems_of(self.simulator) - met)
        parts = {} if local is None else {"regression": Estimate(local.jacobian, local.error)}
        tails = np.ones(len(self.observables))
        if self.pathwise is not None and self.method != "regression":
            tails = self._paths(self.pathwise, rows, parts)
        jacobian, error, share = self._combined(parts)
        scatter, correlation = _scatter(independent, local)
        good = centre[np.isfinite(centre).all(axis=1)]
        if lost := len(centre) - len(good) + (0 if local is None else self.runs - 2 * local.pairs):
            self.warnings.append(
                f"{lost} simulations failed (not finite), or their partners in the regression did, and were left out: "
                "means are those of the others"
            )
        parameters = self.simulator.parameters
        return Sensitivity(
            at=named_values(self.simulator, self.values),
            free=parameters.names,
            plausible={name: one.plausible for name, one in parameters.items()},
            observables=self.observables,
            method=self.method,
            mean=good.mean(axis=0),
            mean_error=good.std(axis=0, ddof=1) / np.sqrt(len(good)),
            jacobian=jacobian,
            error=error,
            pathwise_share=share,
            parts=parts,
            tails=tails,
            scatter=scatter,
            correlation=correlation,
            runs=self.spent,
            seconds=self.seconds,
            seed=self.seed,
            spread=self.spread,
            warnings=tuple(self.warnings),
        )

    def _mean(self) -> Rows:
        """Rows at λ itself."""
        self.progress("the mean", 0.0)
        began = clock.perf_counter()
        before = problems_of(self.simulator).copy()
        self.spent["mean"] = members_for(self.runs)
        seeds = self._seeds(Part.MEAN, self.spent["mean"])
        rows = rows_of(self.simulator, np.tile(self.values, (len(seeds), 1)), seeds)
        if np.isfinite(rows).all(axis=1).sum() < 2:
            met = problems_of(self.simulator) - before
            why = "; ".join(f"{problem} ({count} of them)" for problem, count in met.items()) or "not finite"
            raise SimulationError(f"{len(rows)} simulations at {self._where()} failed: {why}")
        self.seconds["mean"] = clock.perf_counter() - began
        return rows

    def _regression(self) -> LocalModel:
        """Mean and derivative from pairs around λ."""
        self.progress("regression", 0.1)
        began = clock.perf_counter()
        seeds = self._seeds(Part.REGRESSION, self.runs // 2)
        units = hadamard_design(len(seeds), len(self.values), np.random.default_rng(self.seed))
        reach = reaches(self.simulator.parameters, self.values, self.spread)
        points = paired_points(np.log(self.values), units, reach)
        rows = rows_of(self.simulator, np.exp(points), np.concatenate([seeds, seeds]))
        try:
            local = regress(rows[:, : len(self.observables)], units, reach)
        except SimulationError as error:
            beyond = beyond_range(self.simulator.parameters, self.values, self.spread)
            raise SimulationError(f"{error}{beyond}") from None
        self.spent["regression"], self.seconds["regression"] = self.runs, clock.perf_counter() - began
        return local

    def _paths(self, pathwise: Pathwise, rows: Rows, parts: dict[str, Estimate]) -> np.ndarray:
        """Add the pathwise part, where there is use for one; how much outliers weigh in it."""
        self.progress("pathwise", 0.7)
        began = clock.perf_counter()
        found = pathwise(self.values, self._seeds(Part.PATHS, self.paths), rows, whole=self.method == "pathwise")
        if found is None:
            return np.ones(len(self.observables))
        parts["pathwise"] = found.estimate
        self.spent["pathwise"], self.seconds["pathwise"] = self.paths, clock.perf_counter() - began
        self.warnings += doubts(found.tails, self.observables, self.method)
        self._say("pathwise", found.problems)
        return found.tails

    def _combined(self, parts: Mapping[str, Estimate]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """J, its errors, and the weight of the pathwise part."""
        if self.method == "combined" and "pathwise" in parts:
            return combine(parts["regression"], parts["pathwise"])
        name = "regression" if self.method == "combined" else self.method
        share = np.full(len(self.observables), float(name == "pathwise"))
        return parts[name].jacobian, parts[name].error, share

    def _seeds(self, part: Part, count: int) -> Seeds:
        return member_seeds(jax.random.fold_in(key_of(self.seed), int(part)), count)

    def _say(self, part: str, met: Counter[str]) -> None:
        self.warnings += [f"{part}: {count} simulations: {problem}" for problem, count in met.items()]

    def _where(self) -> str:
        values = zip(self.simulator.parameters, self.values, strict=True)
        return ", ".join(f"{name} {value:.3g}" for name, value in values)


def members_for(runs: int) -> int:
    """How many simulations are made at λ itself, beside those of the regression."""
    return max(8, runs // 4)


def doubts(tails: np.ndarray, observables: Sequence[Observable], method: str) -> list[str]:
    """Where outliers would have carried the mean of the pathwise derivatives away, in words."""
    first = dict[str, float]()
    for one, tail in zip(observables, tails, strict=True):
        if tail > EXPLODED:
            first.setdefault(one.statistic, one.time)
    advice = "; the regression carries these entries" if method == "combined" else ": use the regression"
    return [
        f"{name} from t = {time:g}: a few simulations' derivatives are larger than all the others together, their mean "
        f"without outliers is biased by an unknown amount{advice}"
        for name, time in first.items()
    ]


def _scatter(independent: Scatter, local: LocalModel | None) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of one simulation, and correlation of the errors of J."""
    if local is None:
        return independent.covariance, independent.correlation
    return pooled_covariance(independent, local.scatter), local.within_pairs.correlation
