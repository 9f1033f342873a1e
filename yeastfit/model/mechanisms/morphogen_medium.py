"""A morphogen beside the nutrient, which cells secrete and flee from (source 5.1.2).

    ∂m/∂t = D_m ∇²m − k_m m + s 1_colony,    no flux through the dish's wall, m = 0 at the start,

and nodes drift along λ5 ∇c − χ ∇m: χ = `morphogen_repulsion` above 0 spreads a colony, below 0 gathers it. 1_colony is
the indicator of the colony, hard or smooth. With s = 0 or χ = 0 the colony is the source's. The boundary of the
nutrient is the source's `reservoir`, or a `dish`, through which nothing passes, so that what is eaten is gone.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.active_window import extent_of_change, middle_of, on_window, with_window
from yeastfit.model.cell_overlap import smooth_step
from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.interpolation import gradient_at
from yeastfit.model.laws.medium import STEPS, Boundary, check_boundary, nutrient_of_step, where_cells_are
from yeastfit.model.nutrient import FASTEST, closed_step
from yeastfit.model.rules import Context, MediumRule, UptakeRule
from yeastfit.parameter_set import Parameter

DIFFUSIVITY = Parameter(
    "morphogen_diffusivity", "D_m", "diffusion of the morphogen, over μ* L0²", (0.01, 10.0), 0.5, largest=FASTEST
)
DECAY = Parameter("morphogen_decay", "k_m", "decay of the morphogen, over μ*", (0.05, 10.0), 0.5)
SECRETION = Parameter("morphogen_secretion", "s", "secretion of the morphogen, over μ* c0", (0.05, 10.0), 0.0)
REPULSION = Parameter("morphogen_repulsion", "χ", "drift away from the morphogen", (0.05, 20.0), 0.0, smallest=-100.0)


class MorphogenMedium(MediumRule):
    """The original nutrient and one morphogen, which cells secrete and flee. Differentiable in all parameters.

    Attributes:
        nutrient_boundary: What is at the edge for the nutrient: a "reservoir" that never runs out, or the wall of a
            "dish".

    Raises:
        InputError: The boundary is neither of the two.
    """

    name: ClassVar[str] = "morphogen"
    parameters: ClassVar[tuple[Parameter, ...]] = (DIFFUSIVITY, DECAY, SECRETION, REPULSION)
    nutrient_boundary: Boundary = eqx.field(static=True, default="reservoir")

    def __check_init__(self) -> None:
        check_boundary("nutrient_boundary", self.nutrient_boundary)

    def fields(self) -> dict[str, float]:
        """The morphogen."""
        return {"morphogen": 0.0}

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """Both fields one step later."""
        colony, parameters, numerics = context.colony, context.parameters, context.numerics

        def eaten(window: slice, g: Array, nutrient: Array) -> tuple[Array, Array]:
            fed = nutrient_of_step(context, uptake, g, nutrient[window, window], STEPS[self.nutrient_boundary])
            inside = smooth_step(g, context.relaxation.boundary)
            return with_window(nutrient, window, fed), with_window(jnp.zeros_like(nutrient), window, inside)

        def secreted(points: int, morphogen: Array, inside: Array) -> Array:
            window = middle_of(numerics.points, points)
            here, made = morphogen[window, window], parameters["morphogen_secretion"] * inside[window, window]
            decay = jnp.broadcast_to(parameters["morphogen_decay"], here.shape)
            left = closed_step(here, decay, parameters["morphogen_diffusivity"], numerics, made)
            return with_window(morphogen, window, left)

        nutrient, morphogen = colony.nutrient, colony.medium["morphogen"]
        extent = extent_of_change(1.0 - nutrient, numerics.spacing)
        nutrient, inside = where_cells_are(context, cells, extent, eaten, nutrient)
        extent = extent_of_change(jnp.maximum(jnp.abs(morphogen), inside), numerics.spacing)  # it reaches farther
        morphogen = on_window(secreted, extent, numerics.spacing, numerics.points, morphogen, inside)
        return dataclasses.replace(colony, nutrient=nutrient, medium={**colony.medium, "morphogen": morphogen})

    def drift(self, context: Context) -> Float[Array, "node 2"]:
        """λ5 ∇c − χ ∇m."""
        parameters, colony = context.parameters, context.colony
        uphill = gradient_at(dataclasses.replace(colony, nutrient=colony.medium["morphogen"]), context.numerics)
        return parameters.mobility * context.local_gradient() - parameters["morphogen_repulsion"] * uphill
