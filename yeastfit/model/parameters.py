"""The seven dimensionless parameters λ1..λ7 (source table 2.3) and the scales that give them units."""

import math
from dataclasses import dataclass
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.parameter_set import Parameter, ParameterSet

Time = TypeVar("Time", float, np.ndarray)


PARAMETERS = ParameterSet(
    (
        Parameter("diffusivity", "λ1", "nutrient diffusion, D / (μ* L0²)", (0.01, 10.0), 0.1),
        Parameter("elasticity", "λ2", "spring stiffness of a cell, K / (η μ*)", (0.5, 50.0), 5.0),
        Parameter("repulsivity", "λ3", "contact force, F / (η μ* L0)", (0.02, 50.0), 5.0),
        Parameter("repulsion_radius", "λ4", "contact radius, R / L0", (0.1, 0.5), 0.5, largest=0.5, positive=True),
        Parameter("mobility", "λ5", "drift along the nutrient gradient, γ c0 / (η μ* L0²)", (0.02, 20.0), 1.0),
        Parameter("metabolic_rate", "λ6", "nutrient uptake, r / μ*", (0.05, 20.0), 1.0),
        Parameter(
            "aspect_ratio", "λ7", "minor over major axis of a cell", (0.2, 1.0), 0.73, largest=1.0, positive=True
        ),
    )
)
NAMES = PARAMETERS.names
Value = float | Array | np.ndarray | np.generic


def _as_float(value: Value) -> Array:
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float | int) or isinstance(value, bool):
        raise InputError(f"a parameter must be a number or an array of numbers, got {value!r}")
    return jnp.asarray(value, dtype=jnp.result_type(float))


class Parameters(eqx.Module):
    """λ1..λ7, dimensionless, each a scalar or one value per ensemble member.

    Defaults are the source's values. Admissible: finite, not negative; `repulsion_radius` at most 0.5,
    `aspect_ratio` in (0, 1]. `PARAMETERS` gives symbol, meaning and plausible range of each.
    Differentiable in every field. Raises `InputError` where a concrete value is not admissible.
    """

    diffusivity: Float[Array, "*member"]
    elasticity: Float[Array, "*member"]
    repulsivity: Float[Array, "*member"]
    repulsion_radius: Float[Array, "*member"]
    mobility: Float[Array, "*member"]
    metabolic_rate: Float[Array, "*member"]
    aspect_ratio: Float[Array, "*member"]

    def __init__(
        self,
        diffusivity: Value = 0.1,
        elasticity: Value = 5.0,
        repulsivity: Value = 5.0,
        repulsion_radius: Value = 0.5,
        mobility: Value = 1.0,
        metabolic_rate: Value = 1.0,
        aspect_ratio: Value = 0.73,
    ) -> None:
        self.diffusivity = _as_float(diffusivity)
        self.elasticity = _as_float(elasticity)
        self.repulsivity = _as_float(repulsivity)
        self.repulsion_radius = _as_float(repulsion_radius)
        self.mobility = _as_float(mobility)
        self.metabolic_rate = _as_float(metabolic_rate)
        self.aspect_ratio = _as_float(aspect_ratio)

    def __check_init__(self) -> None:
        for name, info in PARAMETERS.items():
            value = getattr(self, name)
            if isinstance(value, jax.core.Tracer):
                continue
            info.check(np.asarray(value))

    def asdict(self) -> dict[str, float | list[float]]:
        """Plain numbers by name, for tables and JSON."""
        return {name: np.asarray(getattr(self, name), dtype=float).tolist() for name in NAMES}

    def replace(self, **values: Value) -> "Parameters":
        """A copy with some fields changed."""
        unknown = sorted(set(values) - set(NAMES))
        if unknown:
            raise InputError(f"unknown parameter {unknown[0]!r}, expected one of {', '.join(NAMES)}")
        return Parameters(**{name: values.get(name, getattr(self, name)) for name in NAMES})


@dataclass(frozen=True)
class Scales:
    """Units of the model, data and not constants: another species has others (source section 2.6).

    length: L0, mean cell length in µm. rate: μ*, maximal growth rate per hour; one time unit is 1/μ* hours.
    """

    length: float = 7.5
    rate: float = 0.46

    def __post_init__(self) -> None:
        for name in ("length", "rate"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
                raise InputError(f"scale {name} is {value!r}, it must be a number above 0")

    def hours(self, time: Time) -> Time:
        """Model time, or times, to hours."""
        return time / self.rate

    def time(self, hours: Time) -> Time:
        """Hours, one or many, to model time."""
        return hours * self.rate
