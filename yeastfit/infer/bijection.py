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
    for name in free:
        low, high = PARAMETERS[name].plausible
        value = float(getattr(parameters, name))
        if not low < value < high:
            raise InputError(f"{name} is {value:g}, a free parameter starts inside ({low:g}, {high:g})")
    return free_of_log(jnp.log(jnp.stack([getattr(parameters, name) for name in free])), free)


def from_free(z: Float[Array, " free"], free: tuple[str, ...], fixed: Parameters) -> Parameters:
    """λ with the free ones taken from z. Differentiable."""
    log_values = log_of_free(z, free)
    return fixed.replace(**{name: jnp.exp(log_values[i]) for i, name in enumerate(free)})


def log_of_free(z: Float[Array, "... free"], free: tuple[str, ...]) -> Float[Array, "... free"]:
    """log λ of the free parameters. Differentiable."""
    low, high = log_range(free)
    return low + (high - low) * jax.nn.sigmoid(z)


def free_of_log(log_values: Float[Array, "... free"], free: tuple[str, ...]) -> Float[Array, "... free"]:
    """z of log λ, the inverse of `log_of_free`; infinite at the ends of the range."""
    low, high = log_range(free)
    return jnp.log(log_values - low) - jnp.log(high - log_values)


def log_range(free: tuple[str, ...]) -> tuple[Float[Array, " free"], Float[Array, " free"]]:
    """log a and log b of the free parameters' plausible ranges."""
    low, high = (jnp.log(jnp.array([PARAMETERS[name].plausible[end] for name in free])) for end in (0, 1))
    return low, high
