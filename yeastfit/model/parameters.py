"""Values of the model's parameters, and the scales that give them units.

The seven dimensionless parameters λ1 … λ7 are those of the source's table 2.3 (docs/model.md, section 1). A rule that a
model is composed from may bring further ones (`yeastfit.model.rules`); their values travel in the same object.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import GetAttrKey
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.numbers import CELL_LENGTHS, GROWTH_RATES
from yeastfit.parameter_set import Parameter, ParameterSet

Time = TypeVar("Time", float, np.ndarray)


PARAMETERS = ParameterSet(
    (
        Parameter("diffusivity", "λ1", "nutrient diffusion, D / (μ* L0²)", (0.01, 10.0), 0.1, powers=(2, 1)),
        Parameter("elasticity", "λ2", "spring stiffness of a cell, K / (η μ*)", (0.5, 50.0), 5.0, powers=(0, 1)),
        Parameter("repulsivity", "λ3", "contact force, F / (η μ* L0)", (0.02, 50.0), 5.0, powers=(1, 1)),
        Parameter(
            "repulsion_radius",
            "λ4",
            "contact radius, R / L0",
            (0.1, 0.5),
            0.5,
            largest=0.5,
            positive=True,
            powers=(1, 0),
            exceeded=True,
        ),
        Parameter(
            "mobility", "λ5", "drift along the nutrient gradient, γ c0 / (η μ* L0²)", (0.02, 20.0), 1.0, powers=(2, 1)
        ),
        Parameter("metabolic_rate", "λ6", "nutrient uptake, r / μ*", (0.05, 20.0), 1.0, powers=(0, 1)),
        Parameter(
            "aspect_ratio",
            "λ7",
            "minor over major axis of a cell",
            (0.2, 1.0),
            0.73,
            largest=1.0,
            positive=True,
            exceeded=True,
        ),
    )
)
"""What every model has. Plausible ranges hold the source's values (docs/model.md, section 1) with about a decade of
room on either side, less where the admissible range ends: real colonies may lie beyond what the source tried."""
Value = float | Array | np.ndarray | np.generic


def _as_float(value: Value) -> Array:
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float | int) or isinstance(value, bool):
        raise InputError(f"a parameter must be a number or an array of numbers, got {value!r}")
    if isinstance(value, jax.Array):
        return jnp.asarray(value, dtype=jnp.result_type(float))
    with np.errstate(over="ignore"):  # infinity is not admissible, which the check says
        return jax.device_put(np.array(value, dtype=jnp.result_type(float)))  # which compiles nothing, as asarray would


@jax.tree_util.register_pytree_with_keys_class
@dataclass(frozen=True, init=False, eq=False, repr=False)
class Parameters:
    """Values of parameters by name, dimensionless, each a scalar or one value per ensemble member.

    `parameters.mobility` and `parameters["mobility"]` are the same. λ1 … λ7 are always there; what a rule of the model
    brings is there once it is given, or once `Model.complete` has filled in its default. A pytree with one leaf per
    parameter, differentiable in each.

    Attributes:
        values: By name.
        known: Those whose values were checked.

    Raises:
        InputError: A value is no number, or one of λ1 … λ7 is concrete and not admissible.
    """

    values: Mapping[str, Float[Array, "..."]]
    known: ParameterSet

    def __init__(self, **values: Value) -> None:
        self._set({name: _as_float(value) for name, value in {**PARAMETERS.defaults, **values}.items()}, PARAMETERS)
        self._check(PARAMETERS)

    @staticmethod
    def from_array(names: Sequence[str], values: Float[Array, "*member parameter"]) -> "Parameters":
        """Parameters of an array. Differentiable.

        Arguments:
            names: Of the parameters along the last axis.
            values: One set, or one for each member of an ensemble.

        Returns:
            The parameters; those of λ1 … λ7 that are not named have their defaults.
        """
        return Parameters(**dict(zip(names, jnp.unstack(values, axis=-1), strict=True)))

    def to_array(self, names: Sequence[str]) -> Float[Array, "*member parameter"]:
        """Values in the order of `names`, along a new last axis. Differentiable."""
        return jnp.stack(jnp.broadcast_arrays(*(self[name] for name in names)), axis=-1)

    def within(self, known: ParameterSet) -> "Parameters":
        """With exactly the parameters of a set, in its order, checked; the default of what is missing.

        Raises:
            InputError: A value belongs to no parameter of the set, or is concrete and not admissible.
        """
        if self.known == known and tuple(self.values) == known.names:
            return self
        for name in self.values:
            if name not in known:
                raise InputError(f"unknown parameter {name!r}, expected one of {', '.join(known.names)}")
        values = {one.name: _as_float(self.values.get(one.name, one.default)) for one in known.parameters}
        found = object.__new__(Parameters)._set(values, known)
        found._check(known)
        return found

    def replace(self, **values: Value) -> "Parameters":
        """A copy with some values changed.

        Raises:
            InputError: A name is not among the parameters that have a value, or a value is not admissible.
        """
        for name in values:
            if name not in self.values:
                raise InputError(f"unknown parameter {name!r}, expected one of {', '.join(self.values)}")
        found = Parameters(**{**self.values, **values})
        return found if self.known == PARAMETERS else found.within(self.known)

    def asdict(self) -> dict[str, float | list[float]]:
        """Plain numbers by name, for tables and JSON."""
        return {name: np.asarray(value, dtype=float).tolist() for name, value in self.values.items()}

    def __getitem__(self, name: str) -> Array:
        if name not in self.values:
            raise KeyError(f"no value of a parameter {name!r}, there are {', '.join(self.values)}")
        return self.values[name]

    def __getattr__(self, name: str) -> Array:
        values = self.__dict__.get("values", {})  # empty while a copy is being made
        if name not in values:
            raise AttributeError(f"no value of a parameter {name!r}, there are {', '.join(values)}")
        return values[name]

    def __repr__(self) -> str:
        return f"Parameters({', '.join(f'{name}={value}' for name, value in self.values.items())})"

    def tree_flatten_with_keys(self) -> tuple[list[tuple[GetAttrKey, Any]], Hashable]:
        """For jax: values in order, under their names."""
        return [(GetAttrKey(name), value) for name, value in self.values.items()], (tuple(self.values), self.known)

    @classmethod
    def tree_unflatten(cls, names_and_known: tuple[tuple[str, ...], ParameterSet], leaves: Iterable) -> "Parameters":
        """For jax: what `tree_flatten_with_keys` took apart; not checked.

        Arguments:
            names_and_known: Names of the values, and the parameters that were checked.
            leaves: The values.

        Returns:
            The parameters.
        """
        names, known = names_and_known
        return object.__new__(cls)._set(dict(zip(names, leaves, strict=True)), known)

    def _set(self, values: dict[str, Any], known: ParameterSet) -> "Parameters":
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "known", known)
        return self

    def _check(self, known: ParameterSet) -> None:
        """Raises `InputError` where a concrete value is not admissible."""
        for name, one in known.items():
            if not isinstance(self.values[name], jax.core.Tracer):
                one.check(np.asarray(self.values[name]))


@dataclass(frozen=True)
class Scales:
    """Units of the model, data and not constants: another species has others (source section 2.6).

    Attributes:
        length: L0, mean length of a cell, in µm.
        rate: μ*, largest growth rate of cells, per hour; the unit of time is 1/μ*.

    Raises:
        InputError: A value is beyond what cells have.
    """

    length: float = 7.5
    rate: float = 0.46

    def __post_init__(self) -> None:
        for name in ("length", "rate"):
            value = getattr(self, name)
            (CELL_LENGTHS if name == "length" else GROWTH_RATES).check(value, f"scale {name}")

    def unit(self, powers: tuple[int, int]) -> tuple[float, str]:
        """L0 and μ* to these powers, the factor that gives a parameter units, and the unit; 1 and "" for none."""
        length, rate = powers
        above = [_power(name, power) for name, power in (("µm", length), ("h", -rate)) if power > 0]
        below = [_power(name, power) for name, power in (("µm", -length), ("h", rate)) if power > 0]
        unit = " ".join(above) or ("1" if below else "")
        return self.length**length * self.rate**rate, "/".join([unit, *below])

    def hours(self, time: Time) -> Time:
        """Model time, or times, to hours."""
        return time / self.rate

    def time(self, hours: Time) -> Time:
        """Hours, one or many, to model time."""
        return hours * self.rate


def _power(unit: str, power: int) -> str:
    return unit + (str(power).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")) if power > 1 else "")
