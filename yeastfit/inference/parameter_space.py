"""Free parameters of one or several conditions as one vector, with and without bounds.

An entry θ of the vector is log λ of one parameter λ, in all conditions or in one of them. Between its bounds log a and
log b it is searched as z in ℝ,

    θ = log a + log(b/a) / (1 + e^−z),    dθ/dz = (θ − log a)(log b − θ) / log(b/a):

smooth, one to one, scale-free in the middle of the range, and never outside it. What a condition holds fixed is its
simulator's business.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from yeastfit.errors import InputError
from yeastfit.inference.polynomial import sobol_points
from yeastfit.inference.simulator import Values
from yeastfit.kinds import check_kind, check_list
from yeastfit.numbers import Range, pair_of
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.text import natural_order

ONLY = ""  # the name of the only condition
MARGIN = 1e-3  # of the range: how far inside its bounds a point is taken to be
Bounds = Mapping[str, tuple[float, float]]
Vector = Float[np.ndarray, " entry"]
Points = Float[np.ndarray, "point entry"]


@dataclass(frozen=True)
class Entry:
    """One free parameter.

    Attributes:
        parameter: Its name.
        condition: None where all conditions share it.
        bounds: Of the parameter itself.
    """

    parameter: str
    condition: str | None
    bounds: tuple[float, float]

    @property
    def name(self) -> str:
        """What it is called in tables."""
        return self.parameter if self.condition is None else f"{self.parameter} of {self.condition}"


@dataclass(frozen=True)
class ParameterSpace:
    """The box of the free parameters of all conditions."""

    entries: tuple[Entry, ...]

    @staticmethod
    def of(
        parameters: ParameterSet,
        conditions: Sequence[str] = (ONLY,),
        own: Sequence[str] = (),
        bounds: Bounds | None = None,
    ) -> "ParameterSpace":
        """The space of a simulator's parameters, or of one simulator for each condition.

        Arguments:
            parameters: The free ones.
            conditions: Names.
            own: Parameters that each condition has one of; the others are shared.
            bounds: By parameter, instead of its plausible range.

        Raises:
            InputError: A name is not free, bounds do not rise or are not admissible, a range reaches 0, where log λ
                ends, or there are own parameters of a single condition.
        """
        given = dict(bounds or {})
        check_list("own", own)
        for what, names in (("own", own), ("bounds", given)):
            for name in names:
                if name not in parameters:
                    raise InputError(f"{what} names {name!r}, which is not free: {', '.join(parameters)} are")
        if own and len(conditions) < 2:
            raise InputError(f"own names {', '.join(own)}, but there is one condition only")
        ranges = {name: _range(one, given.get(name)) for name, one in parameters.items()}
        entries = [
            Entry(name, condition, ranges[name])
            for name in parameters
            for condition in (conditions if name in own else (None,))
        ]
        return ParameterSpace(tuple(entries))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the entries."""
        return tuple(entry.name for entry in self.entries)

    @property
    def low(self) -> Vector:
        """Log a."""
        return np.log([entry.bounds[0] for entry in self.entries])

    @property
    def high(self) -> Vector:
        """Log b."""
        return np.log([entry.bounds[1] for entry in self.entries])

    def theta_of(self, z: Vector) -> Vector:
        """θ."""
        return self.low + (self.high - self.low) * expit(np.asarray(z, dtype=float))

    def z_of(self, theta: Vector) -> Vector:
        """z; θ at or beyond a bound is taken to be `MARGIN` inside it."""
        margin = MARGIN * (self.high - self.low)
        inside = np.clip(theta, self.low + margin, self.high - margin)
        return np.log(inside - self.low) - np.log(self.high - inside)

    def slope(self, theta: Vector) -> Vector:
        """dθ/dz."""
        return (theta - self.low) * (self.high - theta) / (self.high - self.low)

    def start(self, values: Mapping[str, float], parameters: ParameterSet) -> Vector:
        """θ of given values.

        Arguments:
            values: By entry ("mobility of poor") or parameter.
            parameters: The free ones, whose defaults those not given have.

        Raises:
            InputError: A name is unknown, or a value lies outside its bounds.
        """
        self.check_names("start", values)
        found = []
        for entry in self.entries:
            value = values.get(entry.name, values.get(entry.parameter, parameters[entry.parameter].default))
            value, (low, high) = Range().check(value, f"start: {entry.name}"), entry.bounds
            if not low < value < high:
                raise InputError(
                    f"start: {entry.name} is {value:g}, a free parameter starts inside ({low:g}, {high:g})"
                )
            found.append(value)
        return np.log(found)

    def check_names(self, what: str, names: Mapping[str, object]) -> None:
        """Raise `InputError` for a name that is neither an entry nor a parameter of one."""
        check_kind(what, names, Mapping, "values by the names of parameters")
        known = {entry.parameter for entry in self.entries} | set(self.names)
        for name in names:
            if name not in known:
                raise InputError(f"{what} names {name!r}, which is not free: {', '.join(self.names)} are")

    def sobol_points(self, count: int, seed: int | np.random.SeedSequence) -> Points:
        """Low-discrepancy points in the box; the order in which conditions are given makes no difference."""
        parameters = [entry.parameter for entry in self.entries]
        order = sorted(
            range(len(parameters)),
            key=lambda k: (parameters.index(parameters[k]), natural_order(self.entries[k].condition or "")),
        )
        unit = sobol_points(count, len(order), seed)[:, np.argsort(order)]
        return self.low + (self.high - self.low) * unit

    def columns(self, condition: str) -> list[int]:
        """Numbers of the entries that a condition depends on, in the order of its simulator's parameters."""
        return [k for k, entry in enumerate(self.entries) if entry.condition in (None, condition)]

    def values(self, condition: str, theta: Points) -> Values:
        """Rows for the simulator of a condition."""
        return np.exp(theta[:, self.columns(condition)])

    def described(self, theta: Vector) -> str:
        """A point in words."""
        return ", ".join(f"{name} {value:.3g}" for name, value in zip(self.names, np.exp(theta), strict=True))

    def at_a_bound(self, theta: Vector, share: float = 0.01) -> list[Entry]:
        """Entries within a share of their range of its end."""
        near = np.minimum(theta - self.low, self.high - theta) < share * (self.high - self.low)
        return [entry for entry, one in zip(self.entries, near, strict=True) if one]


def _range(parameter: Parameter, bounds: tuple[float, float] | None) -> tuple[float, float]:
    """Bounds or the plausible range. Raise `InputError` where they are not ones for log λ."""
    name, least, most = parameter.name, parameter.smallest, parameter.largest
    if bounds is None:
        low, high = parameter.plausible
        if not (low > 0 and np.isfinite(high)):
            raise InputError(
                f"{name} is plausible from {low:g} to {high:g}: a fit works with its logarithm, give bounds above 0"
            )
        return low, high
    low, high = pair_of(bounds, f"bounds of {name}")
    if not (0 < low < high <= most and low >= least and np.isfinite(high)):
        below = f"at least {least:g}" if least > 0 else "above 0"
        above = f" to at most {most:g}" if most < np.inf else ""
        raise InputError(f"bounds of {name} are {low:g}, {high:g}: they must rise, from {below}{above}")
    try:
        parameter.check(np.array(bounds))
    except InputError as error:
        raise InputError(f"bounds of {name} are {low:g}, {high:g}: {error}") from None
    return float(low), float(high)
