"""What is held of λ before the data: independent priors by name, read from and written to TOML.

Samplers walk in the coordinates of the laws (`laws`): log λ where the law is one of log λ, else λ. Parameters of the
model must have their whole prior where they are admissible: the cut-offs of the laws serve for that. A file has a table
per parameter; `template` makes the default, log-uniform over each parameter's plausible range.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from yeastfit.errors import InputError
from yeastfit.inference.posterior.distributions import LAWS, Law
from yeastfit.model.parameters import NAMES, PARAMETERS

UNINFORMED = {"a": 2.0, "b": 2.0}  # of beta

Values = Float[np.ndarray, "draw free"]


@dataclass(frozen=True)
class Prior:
    """Independent laws of named parameters; the names are any, those of the model are checked."""

    laws: Mapping[str, Law] = field(hash=False)

    def __post_init__(self) -> None:
        if not self.laws:
            raise InputError("the prior is empty, it needs at least one parameter")
        for name, law in self.laws.items():
            _check_admissible(name, law)

    @property
    def free(self) -> tuple[str, ...]:
        """Names, in the order of the columns."""
        return tuple(self.laws)

    @cached_property
    def support(self) -> Float[np.ndarray, "free 2"]:
        """Smallest and largest λ."""
        return np.array([law.support for law in self.laws.values()], dtype=float)

    def log_density(self, values: Values) -> Float[np.ndarray, " draw"]:
        """Of λ; −inf outside the support."""
        inside, x = self._inside(values)
        found = self._log_density(x) - x[:, self._logarithmic].sum(axis=1)
        return np.where(inside, found, -np.inf)

    def log_density_of_coordinates(self, x: Values) -> Float[np.ndarray, " draw"]:
        """Of the coordinates; −inf outside the support."""
        inside, x = self._inside(self.values(x))
        return np.where(inside, self._log_density(x), -np.inf)

    def coordinates(self, values: Values) -> Values:
        """λ or log λ, whichever the law of the parameter is of."""
        found = np.array(values, dtype=float)
        found[:, self._logarithmic] = np.log(values[:, self._logarithmic])
        return found

    def values(self, x: Values) -> Values:
        """λ of coordinates. The inverse of `coordinates`; what would overflow is inf, outside every support."""
        found = np.array(x, dtype=float)
        with np.errstate(over="ignore"):
            found[:, self._logarithmic] = np.exp(x[:, self._logarithmic])
        return found

    def quantile(self, unit: Values) -> Values:
        """Points of the unit cube → λ, for draws of low discrepancy."""
        if not ((unit >= 0) & (unit <= 1)).all():
            raise InputError(f"unit holds values from {unit.min():g} to {unit.max():g}, they must lie in 0..1")
        columns = zip(self.laws.values(), unit.T, strict=True)
        values = self.values(np.stack([law.density.ppf(one) for law, one in columns], axis=1))
        return np.clip(values, *self.support.T)  # exp(log high) may exceed high by its last bit

    def sample(self, count: int, rng: np.random.Generator) -> Values:
        """Independent draws."""
        return self.quantile(rng.random((count, len(self.laws))))

    def asdict(self) -> dict[str, dict[str, Any]]:
        """Plain tables, one per parameter; cut-offs that are not there are left out."""
        return {
            name: {"law": law.law, **{key: one for key, one in law.numbers.items() if math.isfinite(one)}}
            for name, law in self.laws.items()
        }

    def toml(self) -> str:
        """`asdict` as TOML with a comment on each parameter of the model."""
        tables = []
        for name, table in self.asdict().items():
            lines = [f"# {PARAMETERS[name].symbol}: {PARAMETERS[name].meaning}"] if name in PARAMETERS else []
            lines += [f"[{name}]", f'law = "{table.pop("law")}"', *(f"{key} = {one!r}" for key, one in table.items())]
            tables.append("\n".join(lines))
        return "\n\n".join(tables) + "\n"

    @staticmethod
    def of(tables: Mapping[str, Any]) -> "Prior":
        """What `asdict` gave: a table with `law` and its numbers for each parameter. Raises `InputError`."""
        laws = {}
        for name, table in tables.items():
            if not (isinstance(table, Mapping) and isinstance(table.get("law"), str)):
                raise InputError(f'prior of {name} is {table!r}, it must be a table with law = "..." and its numbers')
            try:
                laws[name] = Law(table["law"], {key: one for key, one in table.items() if key != "law"})
            except InputError as error:
                raise InputError(f"prior of {name}: {error}") from None
        return Prior(laws)

    @staticmethod
    def read(path: str | Path, free: Sequence[str] | None = None) -> "Prior":
        """Of a TOML file, whose parameters must be the model's, or those of `free` and then all of them."""
        try:
            tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise InputError(f"{path}: no prior can be read: {error}") from error
        known = NAMES if free is None else tuple(free)
        for name in tables:
            if name not in known:
                raise InputError(f"{path}: unknown parameter {name!r}, expected {', '.join(known)}")
        missing = [name for name in free or () if name not in tables]
        if missing:
            raise InputError(f"{path}: no prior of {', '.join(missing)}")
        try:
            return Prior.of({name: tables[name] for name in known if name in tables})
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def _inside(self, values: Values) -> tuple[np.ndarray, Values]:
        """Which draws lie in the support, and coordinates in which those that do not are replaced by medians."""
        low, high = self.support.T
        each = (values >= low) & (values <= high) & ((values > 0) | ~self._logarithmic)
        inside = each.all(axis=1)
        return inside, self.coordinates(np.where(inside[:, None], values, self._medians))

    @cached_property
    def _logarithmic(self) -> Bool[np.ndarray, " free"]:
        return np.array([law.logarithmic for law in self.laws.values()])

    @cached_property
    def _medians(self) -> Float[np.ndarray, "1 free"]:
        return self.values(np.array([[law.middle for law in self.laws.values()]]))

    def _log_density(self, x: Values) -> Float[np.ndarray, " draw"]:
        return np.sum([law.density.logpdf(one) for law, one in zip(self.laws.values(), x.T, strict=True)], axis=0)


def default_prior(free: Sequence[str], *, bounded: str = "log-uniform") -> Prior:
    """Log-uniform over the plausible range of each parameter of the model.

    bounded: law of those that have a largest admissible value; "beta" is Beta(2, 2), the widest of those that Li et al.
    2024 have for theirs, all of which lie between 0 and 1.
    """
    for name in free:
        if name not in PARAMETERS:
            raise InputError(f"free parameter {name!r} is unknown, expected some of {', '.join(NAMES)}")
    laws = {}
    for name in (name for name in NAMES if name in free):
        low, high = PARAMETERS[name].plausible
        law = "log-uniform" if math.isinf(PARAMETERS[name].largest) else bounded
        laws[name] = Law(law, {"low": low, "high": high, **(UNINFORMED if law == "beta" else {})})
    return Prior(laws)


def template(free: Sequence[str] = NAMES, *, bounded: str = "log-uniform") -> str:
    """A file of `default_prior` to start from, with every law in its comments."""
    numbers = {name: [*info.needs, *(f"{key} (optional)" for key in info.defaults)] for name, info in LAWS.items()}
    laws = [f"#   {name}: {', '.join(each)}" for name, each in numbers.items()]
    head = ["# Priors of the free parameters, one table each. Laws and their numbers:", *laws]
    head += ["# The median of a log-normal law is that of λ, its sd that of log λ."]
    return "\n".join(head) + "\n\n" + default_prior(free, bounded=bounded).toml()


def _check_admissible(name: str, law: Law) -> None:
    """A prior must not reach where the model has no meaning."""
    if name not in PARAMETERS:
        return
    low, high = law.support
    largest = PARAMETERS[name].largest
    if low < 0 or high > largest:
        limit = f"0..{largest:g}" if math.isfinite(largest) else "0 and above"
        raise InputError(f"prior of {name}: {law.law} reaches from {low:g} to {high:g}, admissible is {limit}")
