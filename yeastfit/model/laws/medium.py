"""What cells live on: one nutrient that diffuses and is eaten (source 2.7, 2.8; docs/model.md, section 3.4)."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar, Literal, get_args

import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from yeastfit.errors import InputError
from yeastfit.model.active_window import extent_of_cells, extent_of_change, middle_of, on_window, with_window
from yeastfit.model.cells import Cells, level_set, weights_of_cells
from yeastfit.model.colony import Colony
from yeastfit.model.nutrient import closed_step, nutrient_step
from yeastfit.model.rules import Context, MediumRule, UptakeRule
from yeastfit.text import quoted

FieldStep = Callable[..., Float[Array, "x y"]]  # of (c, b, λ1, numerics)
Boundary = Literal["reservoir", "dish"]
STEPS: dict[Boundary, FieldStep] = {"reservoir": nutrient_step, "dish": closed_step}
"""A step of a field by what is at its edge: a reservoir that never runs out, or the wall of a dish."""


class OneNutrient(MediumRule):
    """One nutrient, which diffuses and is eaten, as in the original model.

    ∂c/∂t = λ1 ∇²c − b c, c = 1 on the boundary; nodes drift along λ5 ∇c and grow by c.
    """

    name: ClassVar[str] = "nutrient"

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """With the nutrient one step later. Differentiable."""
        return dataclasses.replace(context.colony, nutrient=eaten(context, cells, uptake))


def check_boundary(name: str, value: Any) -> None:
    """Raise `InputError` where a setting of this name is no boundary."""
    if value not in get_args(Boundary):
        raise InputError(f"medium: {name} is {quoted(value)}, it must be 'dish' or 'reservoir'")


def eaten(context: Context, cells: Cells, uptake: UptakeRule, step: FieldStep = nutrient_step) -> Float[Array, "x y"]:
    """The nutrient one step later: union of the living cells, uptake and diffusion, where there is anything to do.

    Arguments:
        context: The colony before the step.
        cells: Of its living and its dead.
        uptake: How fast they eat.
        step: Of the diffusion: with c = 1 on the boundary, or without flux through it (`closed_step`).
    """

    def law(window: slice, g: Float[Array, "w w"], nutrient: Float[Array, "x y"]) -> Float[Array, "x y"]:
        return with_window(nutrient, window, nutrient_of_step(context, uptake, g, nutrient[window, window], step))

    nutrient = context.colony.nutrient
    return where_cells_are(context, cells, extent_of_change(1.0 - nutrient, context.numerics.spacing), law, nutrient)


def nutrient_of_step(
    context: Context,
    uptake: UptakeRule,
    g: Float[Array, "x y"],
    nutrient: Float[Array, "x y"],
    step: FieldStep = nutrient_step,
) -> Float[Array, "x y"]:
    """c on a window one step later, given the level set there."""
    rate = uptake.answered(uptake.rate(context, g, nutrient), nutrient.shape)
    return step(nutrient, rate, context.parameters.diffusivity, context.numerics)


def where_cells_are(
    context: Context, cells: Cells, extent: Float[Array, ""], law: Callable[..., PyTree], *fields: Float[Array, "x y"]
) -> PyTree:
    """Apply a law on the smallest window that holds all living cells and `extent`.

    Arguments:
        context: The colony before the step.
        cells: Of its living and its dead.
        extent: Half the side that the fields need.
        law: Called as `law(window, g, *fields)`: where the window lies along either axis, the level set of the living
            cells on it, and the fields on the whole grid.
        *fields: On the grid.

    Returns:
        What the law returns.
    """
    relaxation, numerics = context.relaxation, context.numerics
    reach = relaxation.union_reach

    def on(points: int, cells: Cells, *fields: Float[Array, "x y"]) -> PyTree:
        window = middle_of(numerics.points, points)
        origin = -0.5 * numerics.domain + window.start * numerics.spacing
        g = level_set(cells, relaxation.union, reach, origin, numerics.spacing, points)
        return law(window, g, *fields)

    cells = dataclasses.replace(cells, weights=weights_of_cells(context.eating, context.colony.parents))
    extent = jnp.maximum(extent_of_cells(cells, reach), extent)
    return on_window(on, extent, numerics.spacing, numerics.points, cells, *fields)
