"""The part of the grid where anything happens.

Away from the colony nothing eats, and the nutrient is 1 to the last bit. A step therefore works on the smallest of a
few squares around the origin, each `GROWTH` times the next smaller one, that holds every cell and all nutrient that
differs from 1; what it leaves out would not have changed. The squares are static, which one is taken is data.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from yeastfit.model.cells import Cells
from yeastfit.model.numerics import largest_in_ensemble

SMALLEST = 49  # grid points along the smallest square: below, a smaller one saves nothing
GROWTH = 1.6
MOST = 5  # squares; each is traced and compiled, which takes a short run longer than what more of them would save
MARGIN = 3  # grid points of nutrient 1 along the inside of a square: its edge does not change while there are any


def windows(points: int) -> tuple[int, ...]:
    """Grid points along each square, rising to all of them; all odd or all even, so that they share their centre."""
    sizes = [points]
    while len(sizes) < MOST and sizes[0] / GROWTH >= SMALLEST:
        smaller = int(sizes[0] / GROWTH)
        sizes.insert(0, smaller - (points - smaller) % 2)
    return tuple(sizes)


def extent_of_cells(cells: Cells, reach: Float[Array, ""] | float) -> Float[Array, ""]:
    """At least the largest |coordinate| of any point with r² ≤ reach of any cell."""
    ends = jnp.max(jnp.abs(cells.centres), axis=-1) + jnp.sqrt(jnp.asarray(reach)) * cells.radii
    return jnp.max(jnp.where(cells.weights > 0, ends, 0.0))


def extent_of_change(change: Float[Array, "x y"], spacing: float) -> Float[Array, ""]:
    """Largest |coordinate| of any grid point where fields are not at rest, and `MARGIN` spacings more.

    Arguments:
        change: How far they are from rest, of either sign.
        spacing: Of the grid.
    """
    change = jnp.abs(change)
    changed = jnp.maximum(jnp.max(change, axis=0), jnp.max(change, axis=1)) > jnp.finfo(change.dtype).eps
    steps = jnp.abs(jnp.arange(change.shape[0]) - 0.5 * (change.shape[0] - 1))
    return spacing * (jnp.max(jnp.where(changed, steps, 0.0)) + MARGIN)


def on_window(
    law: Callable[..., PyTree], extent: Float[Array, ""], spacing: float, points: int, *args: PyTree
) -> PyTree:
    """Apply a law on the smallest square that is large enough.

    Arguments:
        law: Called as `law(n, *args)` with the number of points along the square's side, which is static.
        extent: Half the side that is needed.
        spacing: Of the grid.
        points: Of the whole grid, along its side.
        *args: Arrays for the law.

    Returns:
        What the law returns for the smallest of `windows(points)` that reaches `extent` on all sides.
    """
    sizes = windows(points)
    halves = spacing * 0.5 * (jnp.asarray(sizes) - 1)
    index: Int[Array, ""] = largest_in_ensemble(jnp.sum(halves[:-1] < jax.lax.stop_gradient(extent)))
    return jax.lax.switch(index, [lambda *args, n=n: law(n, *args) for n in sizes], *args)


def middle_of(grid: int, points: int) -> slice:
    """Where a square of so many points lies along either axis of the grid."""
    first = (grid - points) // 2
    return slice(first, first + points)


def with_window(field: Float[Array, "x y"], window: slice, values: Float[Array, "w w"]) -> Float[Array, "x y"]:
    """A field with other values on a window.

    All of it is no window: JAX would make a scatter without indices of that, on whose empty constant XLA of jaxlib
    0.11.2 ends the process where members are shared out over devices.
    """
    return values if values.shape == field.shape else field.at[window, window].set(values)
