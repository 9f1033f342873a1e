"""Laws of one parameter λ, by name and numbers.

A law has a density p(x) in its own coordinate, x = λ or x = log λ; that of λ is p(x) |dx/dλ|:

    uniform       x = λ       low, high
    log-uniform   x = log λ   low, high
    normal        x = λ       mean, sd; cut off at low, high where these are given
    log-normal    x = log λ   median of λ, sd of log λ; likewise
    beta          x = λ       a, b: λ = low + (high − low) u with density ∝ u^(a−1) (1 − u)^(b−1); low 0, high 1
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats

from yeastfit.errors import InputError


@dataclass(frozen=True)
class LawInfo:
    """Numbers that a law needs and those that it has defaults for, its coordinate, and how its density p(x) is made."""

    needs: tuple[str, ...]
    defaults: dict[str, float]
    logarithmic: bool
    density: Callable[[Mapping[str, float]], Any]


def _uniform(n: Mapping[str, float]) -> Any:
    return stats.uniform(n["low"], n["high"] - n["low"])


def _log_uniform(n: Mapping[str, float]) -> Any:
    return stats.uniform(np.log(n["low"]), np.log(n["high"]) - np.log(n["low"]))


def _normal(n: Mapping[str, float]) -> Any:
    return stats.truncnorm((n["low"] - n["mean"]) / n["sd"], (n["high"] - n["mean"]) / n["sd"], n["mean"], n["sd"])


def _log_normal(n: Mapping[str, float]) -> Any:
    low = np.log(n["low"]) if n["low"] > 0 else -np.inf
    return _normal({"mean": np.log(n["median"]), "sd": n["sd"], "low": low, "high": np.log(n["high"])})


def _beta(n: Mapping[str, float]) -> Any:
    return stats.beta(n["a"], n["b"], n["low"], n["high"] - n["low"])


LAWS: dict[str, LawInfo] = {
    "uniform": LawInfo(("low", "high"), {}, False, _uniform),
    "log-uniform": LawInfo(("low", "high"), {}, True, _log_uniform),
    "normal": LawInfo(("mean", "sd"), {"low": -math.inf, "high": math.inf}, False, _normal),
    "log-normal": LawInfo(("median", "sd"), {"low": 0.0, "high": math.inf}, True, _log_normal),
    "beta": LawInfo(("a", "b"), {"low": 0.0, "high": 1.0}, False, _beta),
}


@dataclass(frozen=True)
class Law:
    """Prior of one parameter: a law of `LAWS` and its numbers by name, completed with the law's defaults."""

    law: str
    numbers: Mapping[str, float] = field(hash=False)

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise InputError(f"law is {self.law!r}, expected one of {', '.join(LAWS)}")
        object.__setattr__(self, "numbers", _numbers(self.law, self.numbers))

    @property
    def logarithmic(self) -> bool:
        """Whether its coordinate is log λ."""
        return LAWS[self.law].logarithmic

    @property
    def support(self) -> tuple[float, float]:
        """Of λ."""
        return self.numbers["low"], self.numbers["high"]

    @cached_property
    def density(self) -> Any:
        """p(x), a distribution of scipy."""
        return LAWS[self.law].density(self.numbers)

    @cached_property
    def middle(self) -> float:
        """Median of x."""
        return float(self.density.median())


def _numbers(law: str, given: Mapping[str, Any]) -> dict[str, float]:
    """All numbers of a law as floats, or `InputError`."""
    info = LAWS[law]
    for key in given:
        if key not in info.needs and key not in info.defaults:
            raise InputError(f"{law} has no {key!r}, its numbers are {', '.join((*info.needs, *info.defaults))}")
    for key in info.needs:
        if key not in given:
            raise InputError(f"{law} needs {', '.join(info.needs)}, {key} is missing")
    for key, one in given.items():
        infinite = key in info.defaults and one == info.defaults[key]
        if isinstance(one, bool) or not isinstance(one, int | float) or not (math.isfinite(one) or infinite):
            raise InputError(f"{key} is {one!r}, it must be a finite number")
    numbers = {**info.defaults, **{key: float(one) for key, one in given.items()}}
    for key in ("sd", "a", "b", "median"):
        if key in numbers and numbers[key] <= 0:
            raise InputError(f"{key} is {numbers[key]:g}, it must be above 0")
    low, high = numbers["low"], numbers["high"]
    if low >= high:
        raise InputError(f"low is {low:g} and high {high:g}, low must be below high")
    if (law == "log-uniform" and low <= 0) or (law == "log-normal" and low < 0):
        raise InputError(f"low is {low:g}, {law} is a law of positive values")
    return {key: numbers[key] for key in (*info.needs, *info.defaults)}
