"""The nutrient and its gradient at the nodes: bilinear between grid points.

    c(x) = Σ_corners weight · c,    ∇c(x) = Σ_corners weight · ∇c,

∇c at a grid point by central differences. Differentiable; a node that crosses a line of the grid makes a kink.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from yeastfit.model.colony import Colony
from yeastfit.model.numerics import FIRST_ROOM, Numerics

At = Callable[[Int[Array, "*place"], Int[Array, "*place"]], Float[Array, "..."]]


NEXT_TO_NONE = 1e-12  # weight whose square single precision still holds, as derivatives of a quotient need it


def nutrient_at(colony: Colony, numerics: Numerics) -> Float[Array, " node"]:
    """c at the nodes."""
    corner, weights = _bilinear(colony.positions, numerics, margin=0)
    return _mean(lambda i, j: colony.nutrient[i, j], corner, weights)


def gradient_at(colony: Colony, numerics: Numerics) -> Float[Array, "node 2"]:
    """∇c at the nodes."""
    c, h = colony.nutrient, numerics.spacing

    def gradient(i: Int[Array, "*place"], j: Int[Array, "*place"]) -> Float[Array, "*place 2"]:
        return jnp.stack([c[i + 1, j] - c[i - 1, j], c[i, j + 1] - c[i, j - 1]], axis=-1) / (2 * h)

    corner, weights = _bilinear(colony.positions, numerics, margin=1)
    return _mean(gradient, corner, weights[..., None])


def growth_rate(fed: Float[Array, " node"], weights: Float[Array, " node"]) -> Float[Array, ""]:
    """μ = Σ w_i c(x_i) / Σ w_i, the mean nutrient of nodes (source 2.13); 0 where there is next to none."""
    total = jnp.sum(weights)
    some = total > NEXT_TO_NONE
    return jnp.where(some, jnp.sum(weights * fed), 0.0) / jnp.where(some, total, 1.0)


# corners of a grid square; 32 bits, or jax would keep NumPy's 64 in single precision
_DI, _DJ = np.array([0, 0, 1, 1], np.int32), np.array([0, 1, 0, 1], np.int32)


def _mean(at: At, corner: Int[Array, "node 2"], weights: Float[Array, "node 4 ..."]) -> Float[Array, "node ..."]:
    """Of what is at the four corners around each node.

    With room for more than `FIRST_ROOM` nodes corner by corner: the same sum, three times as fast, other last bits.
    With less room they stay those that the data sets were made with.
    """
    if len(corner) <= FIRST_ROOM:
        return jnp.sum(weights * at(corner[:, 0, None] + _DI, corner[:, 1, None] + _DJ), axis=1)
    a, b, c, d = (weights[:, k] * at(corner[:, 0] + _DI[k], corner[:, 1] + _DJ[k]) for k in range(4))
    return a + b + c + d


def _bilinear(
    positions: Float[Array, "node 2"], numerics: Numerics, margin: int
) -> tuple[Int[Array, "node 2"], Float[Array, "node 4"]]:
    """Lower corner and the four weights of the grid square around each node, `margin` points off the boundary."""
    scaled = (positions + 0.5 * numerics.domain) / numerics.spacing
    corner = jnp.clip(jnp.floor(scaled).astype(int), margin, numerics.points - 2 - margin)
    s, t = jnp.unstack(scaled - corner, axis=-1)
    return corner, jnp.stack([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t], axis=-1)
