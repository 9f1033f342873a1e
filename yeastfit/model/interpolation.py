"""The nutrient and its gradient at the nodes: bilinear between grid points.

    c(x) = Σ_corners weight · c,    ∇c(x) = Σ_corners weight · ∇c,

∇c at a grid point by central differences. Differentiable; a node that crosses a line of the grid makes a kink.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from yeastfit.model.colony import Colony
from yeastfit.model.numerics import Numerics


def nutrient_at(colony: Colony, numerics: Numerics) -> Float[Array, " node"]:
    """c at the nodes."""
    i, j, weights = _bilinear(colony.positions, numerics, margin=0)
    return _mean(weights, [colony.nutrient[i + di, j + dj] for di, dj in _CORNERS])


def gradient_at(colony: Colony, numerics: Numerics) -> Float[Array, "node 2"]:
    """∇c at the nodes."""
    c, h = colony.nutrient, numerics.spacing
    i, j, weights = _bilinear(colony.positions, numerics, margin=1)
    along_x = [(c[i + di + 1, j + dj] - c[i + di - 1, j + dj]) / (2 * h) for di, dj in _CORNERS]
    along_y = [(c[i + di, j + dj + 1] - c[i + di, j + dj - 1]) / (2 * h) for di, dj in _CORNERS]
    return jnp.stack([_mean(weights, along_x), _mean(weights, along_y)], axis=-1)


def growth_rate(fed: Float[Array, " node"], weights: Float[Array, " node"]) -> Float[Array, ""]:
    """μ = Σ w_i c(x_i) / Σ w_i, the mean nutrient of nodes (source 2.13); 0 where there is none."""
    total = jnp.sum(weights)
    return jnp.sum(weights * fed) / jnp.where(total > 0, total, 1.0)


_CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))  # of a grid square


def _mean(weights: list[Float[Array, " node"]], values: list[Float[Array, " node"]]) -> Float[Array, " node"]:
    """Of the values at the corners."""
    a, b, c, d = (weight * value for weight, value in zip(weights, values, strict=True))
    return a + b + c + d


def _bilinear(
    positions: Float[Array, "node 2"], numerics: Numerics, margin: int
) -> tuple[Int[Array, " node"], Int[Array, " node"], list[Float[Array, " node"]]]:
    """Lower corner of the grid square around each node, `margin` points off the boundary, and weights of the four."""
    scaled = (positions + 0.5 * numerics.domain) / numerics.spacing
    corner = jnp.clip(jnp.floor(scaled).astype(int), margin, numerics.points - 2 - margin)
    (i, j), (s, t) = jnp.unstack(corner, axis=-1), jnp.unstack(scaled - corner, axis=-1)
    return i, j, [(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t]
