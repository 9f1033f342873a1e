"""Free parameters as a vector without bounds.

A parameter λ with the plausible range [a, b] is searched as z in ℝ, log λ = log a + log(b/a) · 1/(1 + e^−z): smooth,
one to one, scale-free in the middle of the range, and never outside it.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.model.parameters import NAMES, PARAMETERS, Parameters


def check_free(free: Sequence[str]) -> tuple[str, ...]:
    """The names of free parameters in the model's order, or `InputError`."""
    for name in free:
        if name not in NAMES:
            raise InputError(f"free parameter {name!r} is unknown, expected some of {', '.join(NAMES)}")
    if not free:
        raise InputError("no parameter is free, a fit needs at least one")
    return tuple(name for name in NAMES if name in free)


def to_free(parameters: Parameters, free: tuple[str, ...]) -> Float[Array, " free"]:
    """z of the free parameters; each must lie inside its plausible range."""
    values = []
    for name in free:
        low, high = PARAMETERS[name].plausible
        value = float(getattr(parameters, name))
        if not low < value < high:
            raise InputError(f"{name} is {value:g}, a free parameter starts inside ({low:g}, {high:g})")
        share = jnp.log(value / low) / jnp.log(high / low)
        values.append(jnp.log(share) - jnp.log1p(-share))
    return jnp.stack(values)


def from_free(z: Float[Array, " free"], free: tuple[str, ...], fixed: Parameters) -> Parameters:
    """λ with the free ones taken from z. Differentiable."""
    log_values = log_of_free(z, free)
    return fixed.replace(**{name: jnp.exp(log_values[i]) for i, name in enumerate(free)})


def log_of_free(z: Float[Array, " free"], free: tuple[str, ...]) -> Float[Array, " free"]:
    """log λ of the free parameters. Differentiable."""
    low, high = (jnp.log(jnp.array([PARAMETERS[name].plausible[end] for name in free])) for end in (0, 1))
    return low + (high - low) * jax.nn.sigmoid(z)
