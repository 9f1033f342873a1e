"""Priors: independent distributions of named parameters, read from and written to TOML.

    π(λ) = Π_k p_k(x_k) |dx_k/dλ_k|,    x_k = λ_k or log λ_k as the distribution says (`distributions`)

Samplers walk in the coordinates x. A prior must not reach beyond what is admissible for its parameters: distributions
have truncations for that. A file has one table per parameter; `template` writes a prior as such a file.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from jaxtyping import Array, Bool, Float

from yeastfit.errors import InputError
from yeastfit.inference.prior.distributions import FAMILIES, MIXED, Distribution
from yeastfit.kinds import check_kind
from yeastfit.numbers import Range
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.text import quoted
from yeastfit.text_files import read_toml

WIDE_BETA = {"a": 2.0, "b": 2.0}  # the widest of the beta priors of Li et al. 2024

Table = TypeVar("Table", np.ndarray, Array)  # of NumPy or JAX
Values = Float[np.ndarray, "draw free"]
Bounded = Literal["log-uniform", "beta"]


@dataclass(frozen=True)
class Prior:
    """Independent distributions of named parameters.

    Its methods take rows of values, one for each draw, and columns in the order of `free`: [draw, free].

    Attributes:
        distributions: By parameter name, in the order of the columns.

    Raises:
        InputError: There is no parameter; or, in methods, values have another shape.
    """

    distributions: Mapping[str, Distribution] = field(hash=False)

    def __post_init__(self) -> None:
        if not self.distributions:
            raise InputError("the prior is empty, it needs at least one parameter")

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the columns."""
        return tuple(self.distributions)

    @cached_property
    def support(self) -> Float[np.ndarray, "free 2"]:
        """Smallest and largest λ."""
        return np.array([one.support for one in self.distributions.values()], dtype=float)

    def log_density(self, values: Values) -> Float[np.ndarray, " draw"]:
        """Log density of λ; −inf outside the support."""
        inside, x = self._inside(values)
        density = self._log_density(x) - x[:, self.logarithmic].sum(axis=1)
        return np.where(inside, density, -np.inf)

    def contains(self, values: Values) -> Bool[np.ndarray, " draw"]:
        """Whether λ has a density, one above 0."""
        return np.isfinite(self.log_density(values))

    def log_densities(self, values: Values) -> Values:
        """Log density of each λ by itself, which add up to `log_density`; −inf outside its support."""
        low, high = self.support.T
        inside = (self._rows(values) >= low) & (values <= high) & ((values > 0) | ~self.logarithmic)
        x = self.coordinates(np.where(inside, values, self._medians))
        columns = zip(self.distributions.values(), x.T, strict=True)
        density = np.stack([one.log_density(column) for one, column in columns], axis=1)
        return np.where(inside, density - np.where(self.logarithmic, x, 0.0), -np.inf)

    def log_density_of_coordinates(self, x: Values) -> Float[np.ndarray, " draw"]:
        """Log density of the coordinates x; −inf outside the support."""
        inside, x = self._inside(self.values(x))
        return np.where(inside, self._log_density(x), -np.inf)

    def coordinates(self, values: Values) -> Values:
        """x of λ."""
        return coordinates_of(self._rows(values), self.logarithmic)

    def values(self, x: Values) -> Values:
        """λ of x, the inverse of `coordinates`; inf, which is outside every support, where exp overflows."""
        return values_of(self._rows(x), self.logarithmic)

    def quantile(self, unit: Values) -> Values:
        """λ at points of the unit cube, one cumulative probability per parameter.

        Raises:
            InputError: A point lies outside the cube.
        """
        if not ((self._rows(unit) >= 0) & (unit <= 1)).all():
            raise InputError(f"unit holds values from {unit.min():g} to {unit.max():g}, they must lie in 0..1")
        columns = zip(self.distributions.values(), unit.T, strict=True)
        values = self.values(np.stack([one.density.ppf(share) for one, share in columns], axis=1))
        return np.clip(values, *self.support.T)  # exp(log high) may exceed high by its last bit

    def shares(self, values: Values) -> Values:
        """Cumulative probabilities of λ, the inverse of `quantile`; 0 or 1 outside the support."""
        columns = zip(
            self.distributions.values(), self.coordinates(np.clip(self._rows(values), *self.support.T)).T, strict=True
        )
        return np.stack([one.density.cdf(x) for one, x in columns], axis=1)

    def sample(self, count: int, rng: np.random.Generator) -> Values:
        """Independent draws of λ.

        Arguments:
            count: How many.
            rng: Draws them.

        Returns:
            Values, one row a draw.

        Raises:
            InputError: The count is no whole number from 0 on, or `rng` no generator.
        """
        check_kind("rng", rng, np.random.Generator, "a generator, such as numpy.random.default_rng(0)")
        count = Range(0).read_whole(count, "count")
        return self.quantile(rng.random((count, len(self.distributions))))

    def check(self, parameters: ParameterSet) -> None:
        """Raise `InputError` where a distribution reaches values that are not admissible for its parameter."""
        for name, one in self.distributions.items():
            if one.family in MIXED:
                raise InputError(f"prior of {name} is {one.family}, which only the variation between colonies may have")
            if name in parameters:
                _check_admissible(parameters[name], one)

    def asdict(self) -> dict[str, dict[str, Any]]:
        """Plain tables, one per parameter; infinite truncations are left out."""
        return {
            name: {
                "distribution": one.family,
                **{key: value for key, value in one.numbers.items() if math.isfinite(value)},
            }
            for name, one in self.distributions.items()
        }

    def toml(self, parameters: ParameterSet | None = None) -> str:
        """`asdict` as TOML, with symbol and meaning of each parameter as a comment where `parameters` are given."""
        tables = []
        for name, table in self.asdict().items():
            known = parameters[name] if parameters is not None and name in parameters else None
            lines = [f"# {known.symbol}: {known.meaning}"] if known else []
            key = name if name.isascii() else json.dumps(name, ensure_ascii=False)
            lines += [f"[{key}]", f'distribution = "{table.pop("distribution")}"']
            tables.append("\n".join([*lines, *(f"{key} = {value!r}" for key, value in table.items())]))
        return "\n\n".join(tables) + "\n"

    @staticmethod
    def of(tables: Mapping[str, Any]) -> "Prior":
        """From a table per parameter, such as `{"rate": {"distribution": "uniform", "low": 0.0, "high": 1.0}}`.

        Raises:
            InputError: A table has no distribution, or its numbers are wrong.
        """
        distributions = {}
        for name, table in tables.items():
            if not (isinstance(table, Mapping) and isinstance(table.get("distribution"), str)):
                raise InputError(
                    f'prior of {name} is {quoted(table)}, it must be a table with distribution = "..." and its numbers'
                )
            numbers = {key: value for key, value in table.items() if key != "distribution"}
            try:
                distributions[name] = Distribution(table["distribution"], numbers)
            except InputError as error:
                raise InputError(f"prior of {name}: {error}") from None
        return Prior(distributions)

    @staticmethod
    def default(parameters: ParameterSet, *, bounded: Bounded = "log-uniform") -> "Prior":
        """Log-uniform over each parameter's plausible range where that is above 0, uniform otherwise.

        Arguments:
            parameters: The free ones, as `simulator.parameters`.
            bounded: Distribution of those that have a largest admissible value; "beta" is Beta(2, 2) on the plausible
                range.

        Raises:
            InputError: An argument is of another class, or the distribution none of the two.
        """
        check_kind("parameters", parameters, ParameterSet, "a yeastfit.ParameterSet, such as simulator.parameters")
        if bounded not in get_args(Bounded):
            raise InputError(f"bounded is {quoted(bounded)}, it must be one of {', '.join(get_args(Bounded))}")
        distributions = {}
        for name, one in parameters.items():
            low, high = one.plausible
            family = "log-uniform" if low > 0 else "uniform"
            if math.isfinite(one.largest) and bounded == "beta":
                family = bounded
            numbers = {"low": low, "high": high, **(WIDE_BETA if family == "beta" else {})}
            distributions[name] = Distribution(family, numbers)
        return Prior(distributions)

    @staticmethod
    def read(path: str | Path, parameters: ParameterSet) -> "Prior":
        """From a TOML file with a table for each parameter.

        Arguments:
            path: The file.
            parameters: Whose prior it is; the prior is in their order.

        Raises:
            InputError: The file cannot be read, lacks a parameter or has an unknown one, or a table is wrong.
        """
        try:
            tables = read_toml(path)
        except InputError as error:
            raise InputError(f"{path}: no prior can be read{str(error).removeprefix(str(path))}") from None
        for name in tables:
            if name not in parameters:
                raise InputError(f"{path}: unknown parameter {quoted(name)}, expected {', '.join(parameters.names)}")
        try:
            prior = Prior.of({name: tables[name] for name in parameters if name in tables})
            prior.check(parameters)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        missing = [name for name in parameters if name not in tables]
        if missing:
            what = ", ".join(missing)
            raise InputError(f"{path}: no prior of {what}: add a table for it, or leave it out of the free parameters")
        return prior

    def _rows(self, values: Values) -> Values:
        """The same values, once they are seen to have a row for each draw and a column for each parameter."""
        check_kind("values", values, np.ndarray, f"an array of numpy, [draws, {len(self.free)}]")
        if values.ndim != 2 or values.shape[1] != len(self.free):
            raise InputError(f"values have the shape {values.shape}, they must have [draws, {len(self.free)}]")
        return values

    def _inside(self, values: Values) -> tuple[np.ndarray, Values]:
        """Which draws lie in the support, and coordinates, with medians for those that do not."""
        low, high = self.support.T
        each = (self._rows(values) >= low) & (values <= high) & ((values > 0) | ~self.logarithmic)
        inside = each.all(axis=1)
        return inside, self.coordinates(np.where(inside[:, None], values, self._medians))

    @cached_property
    def logarithmic(self) -> Bool[np.ndarray, " free"]:
        """Whether the coordinate is log λ."""
        return np.array([one.logarithmic for one in self.distributions.values()])

    @cached_property
    def _medians(self) -> Float[np.ndarray, "1 free"]:
        return self.values(np.array([[one.median for one in self.distributions.values()]]))

    def _log_density(self, x: Values) -> Float[np.ndarray, " draw"]:
        columns = zip(self.distributions.values(), x.T, strict=True)
        return np.sum([one.log_density(column) for one, column in columns], axis=0)


def coordinates_of(
    values: Float[Table, "*row free"], logarithmic: Bool[np.ndarray, " free"]
) -> Float[Table, "*row free"]:
    """x of λ, log λ where the coordinate is one, by NumPy or JAX, whichever λ is an array of."""
    library = values.__array_namespace__()
    return library.where(logarithmic, library.log(library.where(logarithmic, values, 1.0)), values)


def values_of(x: Float[Table, "*row free"], logarithmic: Bool[np.ndarray, " free"]) -> Float[Table, "*row free"]:
    """λ of x, the inverse of `coordinates_of`; inf where exp overflows."""
    library = x.__array_namespace__()
    with np.errstate(over="ignore"):
        return library.where(logarithmic, library.exp(library.where(logarithmic, x, 0.0)), x)


def template(prior: Prior, parameters: ParameterSet) -> str:
    """A file of a prior to start from; comments list every distribution and its numbers."""
    numbers = {name: [*one.required, *(f"{key} (optional)" for key in one.defaults)] for name, one in FAMILIES.items()}
    head = ["# Priors of the free parameters, one table each. Distributions and their numbers:"]
    head += [f"#   {name}: {', '.join(each)}" for name, each in numbers.items()]
    head += ["# The median of a log-normal distribution is that of λ, its sd that of log λ."]
    return "\n".join(head) + "\n\n" + prior.toml(parameters)


def _check_admissible(parameter: Parameter, distribution: Distribution) -> None:
    low, high = distribution.support
    if low < parameter.smallest or high > parameter.largest:
        raise InputError(
            f"prior of {parameter.name}: {distribution.family} reaches from {low:g} to {high:g}, "
            f"{parameter.name} must be {parameter.limits}"
        )
