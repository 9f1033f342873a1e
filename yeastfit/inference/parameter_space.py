"""Free parameters of one or several conditions as one vector, with and without bounds.

An entry θ of the vector is log λ of one parameter, in all conditions or in one of them. Between its bounds log a and
log b it is searched as z in ℝ,

    θ = log a + log(b/a) / (1 + e^−z),    dθ/dz = (θ − log a)(log b − θ) / log(b/a):

smooth, one to one, scale-free in the middle of the range, and never outside it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from yeastfit.errors import InputError
from yeastfit.inference.polynomial import sobol_points
from yeastfit.model.parameters import NAMES, PARAMETERS, Parameters

ALONE = ""  # the name of the only condition
Bounds = Mapping[str, tuple[float, float]]
Vector = Float[np.ndarray, " entry"]


@dataclass(frozen=True)
class Entry:
    """One free parameter; condition is None where all conditions share it."""

    parameter: str
    condition: str | None
    bounds: tuple[float, float]

    @property
    def name(self) -> str:
        """What it is called in tables."""
        return self.parameter if self.condition is None else f"{self.parameter} of {self.condition}"


@dataclass(frozen=True)
class Space:
    """Which parameters are free, and where the others are held. fixed: by condition, in the order of the conditions."""

    entries: tuple[Entry, ...]
    fixed: dict[str, Parameters]

    @staticmethod
    def of(
        free: Sequence[str],
        fixed: Mapping[str, Parameters],
        own: Sequence[str] = (),
        bounds: Bounds | None = None,
    ) -> "Space":
        """From names of λ, of which those in `own` differ from condition to condition.

        bounds: of λ, instead of the plausible ranges. Raises `InputError`.
        """
        free, given = check_free(free), dict(bounds or {})
        for what, names in (("own", own), ("bounds", given)):
            for name in names:
                if name not in free:
                    raise InputError(f"{what} names {name!r}, which is not free: {', '.join(free)} are")
        if own and len(fixed) < 2:
            raise InputError(f"own names {', '.join(own)}, but there is one condition only")
        for name, (low, high) in given.items():
            if not 0 < low < high <= PARAMETERS[name].largest:
                raise InputError(
                    f"bounds of {name} are {low:g}, {high:g}: they must rise, from above 0 to at most "
                    f"{PARAMETERS[name].largest:g}"
                )
        entries = [
            Entry(name, condition, given.get(name, PARAMETERS[name].plausible))
            for name in free
            for condition in (fixed if name in own else (None,))
        ]
        return Space(tuple(entries), dict(fixed))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the entries."""
        return tuple(entry.name for entry in self.entries)

    @property
    def low(self) -> Vector:
        """log a."""
        return np.log([entry.bounds[0] for entry in self.entries])

    @property
    def high(self) -> Vector:
        """log b."""
        return np.log([entry.bounds[1] for entry in self.entries])

    def of_z(self, z: Vector) -> Vector:
        """θ."""
        return self.low + (self.high - self.low) * expit(np.asarray(z, dtype=float))

    def to_z(self, theta: Vector) -> Vector:
        """z; θ at or beyond a bound is taken for a thousandth of the range inside it."""
        margin = 1e-3 * (self.high - self.low)
        inside = np.clip(theta, self.low + margin, self.high - margin)
        return np.log(inside - self.low) - np.log(self.high - inside)

    def slope(self, theta: Vector) -> Vector:
        """dθ/dz."""
        return (theta - self.low) * (self.high - theta) / (self.high - self.low)

    def theta(self, parameters: Mapping[str, Parameters]) -> Vector:
        """θ of λ by condition; shared entries take the first condition's. Raises `InputError` outside the bounds."""
        first = next(iter(self.fixed))
        values = np.array([float(getattr(parameters[e.condition or first], e.parameter)) for e in self.entries])
        for entry, value in zip(self.entries, values, strict=True):
            low, high = entry.bounds
            if not low < value < high:
                raise InputError(
                    f"start: {entry.name} is {value:g}, a free parameter starts inside ({low:g}, {high:g})"
                )
        return np.log(values)

    def scattered(self, count: int, seed: int) -> Float[np.ndarray, "point entry"]:
        """Low-discrepancy points in the box (scrambled Sobol')."""
        return self.low + (self.high - self.low) * sobol_points(count, len(self.entries), seed)

    def columns(self, condition: str) -> list[int]:
        """Numbers of the entries that a condition depends on."""
        return [k for k, entry in enumerate(self.entries) if entry.condition in (None, condition)]

    def log_parameters(self, condition: str, theta: Float[np.ndarray, "point entry"]) -> Float[np.ndarray, "point 7"]:
        """log λ1 … log λ7 of a condition at some θ."""
        fixed = self.fixed[condition]
        with np.errstate(divide="ignore"):
            logs = np.log([float(getattr(fixed, name)) for name in NAMES])
        found = np.tile(logs, (len(theta), 1))
        for k in self.columns(condition):
            found[:, NAMES.index(self.entries[k].parameter)] = theta[:, k]
        return found

    def parameters(self, theta: Vector) -> dict[str, Parameters]:
        """λ by condition."""
        found = {}
        for condition, fixed in self.fixed.items():
            values = {self.entries[k].parameter: float(np.exp(theta[k])) for k in self.columns(condition)}
            found[condition] = fixed.replace(**values)
        return found

    def at_a_bound(self, theta: Vector, share: float = 0.01) -> list[Entry]:
        """Entries within a share of their range of its end."""
        near = np.minimum(theta - self.low, self.high - theta) < share * (self.high - self.low)
        return [entry for entry, one in zip(self.entries, near, strict=True) if one]


def check_free(free: Sequence[str]) -> tuple[str, ...]:
    """The names of free parameters in the model's order, or `InputError`."""
    for name in free:
        if name not in NAMES:
            raise InputError(f"free parameter {name!r} is unknown, expected some of {', '.join(NAMES)}")
    if not free or len(set(free)) != len(free):
        raise InputError(f"free is {list(free)}, a fit needs at least one parameter, each once")
    return tuple(name for name in NAMES if name in free)
