"""Prior distributions of one parameter λ, by name and numbers.

A distribution has a density p(x) in its own coordinate, x = λ or x = log λ; the density of λ is p(x) |dx/dλ|:

    uniform       x = λ       low, high
    log-uniform   x = log λ   low, high
    normal        x = λ       mean, sd; truncated at low and high where these are given
    log-normal    x = log λ   median of λ, sd of log λ; truncated likewise
    beta          x = λ       a, b: λ = low + (high − low) u with density ∝ u^(a−1) (1 − u)^(b−1); low 0, high 1
    spike-half-normal  x = λ  0 with probability zero, otherwise |N(0, sd²)|: for the variation between colonies alone
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.numbers import number_of
from yeastfit.text import quoted

Numbers = Mapping[str, float]
LogDensity = Callable[[Float[np.ndarray, "*any"]], Float[np.ndarray, "*any"]]


@dataclass(frozen=True)
class Family:
    """A family of distributions.

    Attributes:
        required: Names of the numbers that must be given.
        defaults: Numbers that may be left out.
        logarithmic: Whether the coordinate is log λ.
        density: Makes p(x), a frozen distribution of scipy, from the numbers.
        log_density: Makes log p(x) for x in the support; by default scipy's, whose checks take 0.2 ms a call.
    """

    required: tuple[str, ...]
    defaults: dict[str, float]
    logarithmic: bool
    density: Callable[[Numbers], Any]
    log_density: Callable[[Numbers], LogDensity] | None = None


def _uniform(n: Numbers) -> Any:
    return scipy.stats.uniform(n["low"], n["high"] - n["low"])


def _log_uniform(n: Numbers) -> Any:
    return scipy.stats.uniform(np.log(n["low"]), np.log(n["high"]) - np.log(n["low"]))


def _normal(n: Numbers) -> Any:
    low, high = ((n[end] - n["mean"]) / n["sd"] for end in ("low", "high"))
    return scipy.stats.truncnorm(low, high, n["mean"], n["sd"])


def _log_normal(n: Numbers) -> Any:
    low = np.log(n["low"]) if n["low"] > 0 else -np.inf
    return _normal({"mean": np.log(n["median"]), "sd": n["sd"], "low": low, "high": np.log(n["high"])})


def _beta(n: Numbers) -> Any:
    return scipy.stats.beta(n["a"], n["b"], n["low"], n["high"] - n["low"])


def _log_of_uniform(low: float, high: float) -> LogDensity:
    log_width = np.log(high - low)
    return lambda x: np.full(x.shape, -log_width)


def _log_of_beta(n: Numbers) -> LogDensity:
    low, width, a, b = n["low"], n["high"] - n["low"], n["a"], n["b"]
    log_whole, log_width = scipy.special.betaln(a, b), np.log(width)

    def log_density(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        u = (x - low) / width
        return scipy.special.xlog1py(b - 1.0, -u) + scipy.special.xlogy(a - 1.0, u) - log_whole - log_width

    return log_density


@dataclass(frozen=True)
class SpikeHalfNormal:
    """0 with probability `zero`, otherwise |N(0, sd²)|; the part of scipy's interface that priors need.

    `pdf` is the density of the values above 0, and `logpdf` the log probability of 0 where x = 0.
    """

    zero: float
    sd: float

    def isf(self, share: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Value that is exceeded with this probability."""
        above = np.minimum(np.asarray(share, dtype=float) / (1.0 - self.zero), 1.0)
        return np.asarray(self.sd * np.sqrt(2.0) * scipy.special.erfcinv(above) + 0.0)  # −0 becomes 0

    def ppf(self, share: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Quantiles."""
        return self.isf(np.asarray(1.0 - np.asarray(share, dtype=float)))

    def cdf(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Cumulative probability, that of 0 included from 0 on."""
        x = np.asarray(x, dtype=float)
        above = scipy.special.erf(np.maximum(x, 0.0) / (self.sd * np.sqrt(2.0)))
        return np.where(x < 0, 0.0, self.zero + (1.0 - self.zero) * above)

    def pdf(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Density of the values above 0."""
        x = np.asarray(x, dtype=float)
        half = np.sqrt(2.0 / np.pi) / self.sd * np.exp(-0.5 * (x / self.sd) ** 2)
        return np.where(x < 0, 0.0, (1.0 - self.zero) * half)

    def logpdf(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Log density above 0, log probability of 0 there."""
        x = np.asarray(x, dtype=float)
        with np.errstate(divide="ignore"):
            return np.where(x == 0, np.log(self.zero), np.log(self.pdf(x)))

    def median(self) -> float:
        """Median."""
        return float(self.ppf(np.array(0.5)))

    def std(self) -> float:
        """Standard deviation."""
        mean = (1.0 - self.zero) * self.sd * math.sqrt(2.0 / math.pi)
        return math.sqrt((1.0 - self.zero) * self.sd**2 - mean**2)


def _spike_half_normal(n: Numbers) -> Any:
    return SpikeHalfNormal(n["zero"], n["sd"])


FAMILIES: dict[str, Family] = {
    "uniform": Family(("low", "high"), {}, False, _uniform, lambda n: _log_of_uniform(n["low"], n["high"])),
    "log-uniform": Family(
        ("low", "high"), {}, True, _log_uniform, lambda n: _log_of_uniform(np.log(n["low"]), np.log(n["high"]))
    ),
    "normal": Family(("mean", "sd"), {"low": -math.inf, "high": math.inf}, False, _normal),
    "log-normal": Family(("median", "sd"), {"low": 0.0, "high": math.inf}, True, _log_normal),
    "beta": Family(("a", "b"), {"low": 0.0, "high": 1.0}, False, _beta, _log_of_beta),
}
MIXED = {"spike-half-normal": Family(("zero", "sd"), {}, False, _spike_half_normal)}
"""Those in which a single value has a probability of its own, which chains in x cannot sample; no parameter has one."""
KNOWN = FAMILIES | MIXED
LEAST = 0.05  # a and b of a beta distribution
MIDDLE = (0.05, 0.95)
NARROWEST = 1e-6  # relative width of the middle 90 % of a distribution


@dataclass(frozen=True)
class Distribution:
    """Distribution of one parameter.

    Attributes:
        family: One of `FAMILIES`, or of `MIXED`.
        numbers: By name; the family's defaults are filled in.

    Raises:
        InputError: The family is unknown, or a number is missing, unknown or out of range.
    """

    family: str
    numbers: Numbers = field(hash=False)

    def __post_init__(self) -> None:
        if self.family not in KNOWN:
            raise InputError(f"distribution is {self.family!r}, expected one of {', '.join(FAMILIES)}")
        object.__setattr__(self, "numbers", _completed(self.family, self.numbers))
        if self.family in FAMILIES:
            self._check_width()

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: not the densities, which are made when they are asked for."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def _check_width(self) -> None:
        """Raise `InputError` where what is left to infer is so narrow that rounding hides it."""
        with np.errstate(all="ignore"):
            low, high = (float(end) for end in self.density.ppf(MIDDLE))
        scale = 1.0 if self.logarithmic else max(abs(low), abs(high))
        if not high - low > NARROWEST * scale:
            numbers = ", ".join(f"{name} {value:g}" for name, value in self.numbers.items())
            room = self.numbers.get("high", np.inf) - self.numbers.get("low", -np.inf)
            if self.numbers.get("sd", 0.0) * NARROWEST > room:
                raise InputError(f"{self.family} of {numbers} is flat between low and high: give a uniform one instead")
            raise InputError(
                f"{self.family} of {numbers} is too narrow: 90 % of it lies between values that differ by less than "
                f"{NARROWEST:g} of their size; hold the parameter at a value instead"
            )

    @property
    def logarithmic(self) -> bool:
        """Whether the coordinate is log λ."""
        return KNOWN[self.family].logarithmic

    @property
    def is_share(self) -> bool:
        """Whether λ is a share of what lies between two bounds."""
        return self.family == "beta"

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest λ."""
        return self.numbers.get("low", 0.0), self.numbers.get("high", math.inf)

    @cached_property
    def density(self) -> Any:
        """p(x), a frozen distribution of scipy."""
        return KNOWN[self.family].density(self.numbers)

    @cached_property
    def log_density(self) -> LogDensity:
        """log p(x), of x in the support."""
        own = KNOWN[self.family].log_density
        return self.density.logpdf if own is None else own(self.numbers)

    @cached_property
    def median(self) -> float:
        """Median of the coordinate x."""
        return float(self.density.median())


def _completed(name: str, numbers: Mapping[str, Any]) -> dict[str, float]:
    """All numbers of a distribution as floats, checked."""
    family = KNOWN[name]
    for key in numbers:
        if key not in family.required and key not in family.defaults:
            raise InputError(
                f"{name} has no {key!r}, its numbers are {', '.join((*family.required, *family.defaults))}"
            )
    for key in family.required:
        if key not in numbers:
            raise InputError(f"{name} needs {', '.join(family.required)}, {key} is missing")
    for key, value in numbers.items():
        infinite = key in family.defaults and value == family.defaults[key]
        if isinstance(value, str) or not (math.isfinite(number_of(value)) or infinite):
            raise InputError(f"{key} is {quoted(value)}, it must be a finite number")
    completed = {**family.defaults, **{key: float(value) for key, value in numbers.items()}}
    for key in ("sd", "a", "b", "median"):
        if key in completed and completed[key] <= 0:
            raise InputError(f"{key} is {completed[key]:g}, it must be above 0")
    for key in ("a", "b"):
        if completed.get(key, LEAST) < LEAST:
            raise InputError(f"{key} is {completed[key]:g}, it must be at least {LEAST:g}: below, all lies at the ends")
    if not 0 <= completed.get("zero", 0.0) < 1:
        raise InputError(f"zero is {completed['zero']:g}, a probability from 0 to below 1 is expected")
    low, high = completed.get("low", 0.0), completed.get("high", math.inf)
    if low >= high:
        raise InputError(f"low is {low:g} and high {high:g}, low must be below high")
    if (name == "log-uniform" and low <= 0) or (name == "log-normal" and low < 0):
        raise InputError(f"low is {low:g}, {name} is a distribution of positive values")
    return {key: completed[key] for key in (*family.required, *family.defaults)}
