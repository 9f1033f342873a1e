"""Angles about 0 with the density of a von Mises and a uniform distribution mixed, as functions of a uniform one.

    f(φ) = q e^(κ (cos φ − 1)) / ∫ e^(κ (cos t − 1)) dt + (1 − q) / 2π,    F(φ) = u,    φ in [−π, π]

φ is differentiable in κ, q and u by the implicit function theorem, ∂φ/∂κ = −(∂F/∂κ) / f, though it is found by a
search. F is integrated numerically, Gauss's rule on each of `INTERVALS` intervals, which resolve κ up to `SHARPEST`.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

INTERVALS = 256  # of [0, π]
SHARPEST = 1000.0  # κ whose standard deviation, 1/√κ, is still 2.6 intervals wide
NEWTON_STEPS = 3  # from linear interpolation in an interval, to the last bit of double precision
_NODES, _WEIGHTS = (array / 2 for array in np.polynomial.legendre.leggauss(6))  # on [−½, ½]


def angle_of(
    uniform: Float[Array, " node"], concentration: Float[Array, ""], share: Float[Array, ""] | float = 1.0
) -> Float[Array, " node"]:
    """φ with F(φ) = u; (2u − 1) π for κ = 0 or q = 0.

    Arguments:
        uniform: u in [0, 1].
        concentration: κ in [0, `SHARPEST`].
        share: q in [0, 1].
    """
    # by symmetry: the share of |φ| in [0, π] that lies below is |2u − 1|
    knots = jnp.linspace(0.0, jnp.pi, INTERVALS + 1, dtype=uniform.dtype)
    masses = _peak(knots[:-1], knots[1:], concentration)
    below = jnp.cumsum(masses) - masses
    total = jnp.sum(masses)

    def distribution(interval: Array, phi: Array) -> Array:
        peaked = (below[interval] + _peak(knots[interval], phi, concentration)) / total
        return share * peaked + (1.0 - share) * phi / jnp.pi

    def density(phi: Array) -> Array:
        return share * jnp.exp(concentration * (jnp.cos(phi) - 1.0)) / total + (1.0 - share) / jnp.pi

    wanted = jnp.where(uniform < 0.5, 1.0 - 2.0 * uniform, 2.0 * uniform - 1.0)
    target = jax.lax.stop_gradient(wanted)
    table = jax.lax.stop_gradient(share * below / total + (1.0 - share) * knots[:-1] / jnp.pi)
    interval = jnp.clip(jnp.searchsorted(table, target, side="right") - 1, 0, INTERVALS - 1)
    low, high = knots[interval], knots[interval + 1]
    tiny = jnp.finfo(uniform.dtype).tiny
    phi = 0.5 * (low + high)
    for _ in range(NEWTON_STEPS):
        phi = jnp.clip(phi - (distribution(interval, phi) - target) / jnp.maximum(density(phi), tiny), low, high)
    phi = jax.lax.stop_gradient(phi)
    slope = jax.lax.stop_gradient(jnp.maximum(density(phi), tiny))
    # one more Newton step, whose derivative is that of the exact solution
    found = phi - (distribution(interval, phi) - wanted) / slope
    found += jax.lax.stop_gradient(jnp.clip(found, 0.0, jnp.pi) - found)
    return jnp.where(uniform < 0.5, -found, found)


def _peak(low: Float[Array, "*n"], high: Float[Array, "*n"], concentration: Float[Array, ""]) -> Float[Array, "*n"]:
    """∫ e^(κ (cos t − 1)) dt from `low` to `high`, which are an interval apart or less."""
    width = high - low
    nodes, weights = jnp.asarray(_NODES + 0.5, low.dtype), jnp.asarray(_WEIGHTS, low.dtype)
    t = low[:, None] + width[:, None] * nodes
    return width * jnp.sum(weights * jnp.exp(concentration * (jnp.cos(t) - 1.0)), axis=1)
