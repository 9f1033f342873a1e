"""One nutrient as an operation that numba has compiled, for large colonies on a CPU.

The same step as that of `medium`, on the tiles of the grid where there is anything to do (`eating`); the last bits
differ. It has no derivative.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.cells import Cells, patch_of, weights_of_cells
from yeastfit.model.colony import Colony
from yeastfit.model.compiled.interpolation import compiled_gradient_at, compiled_nutrient_at
from yeastfit.model.compiled.operations import operation, shapes_of
from yeastfit.model.laws.medium import OneNutrient
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import sweeps
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context, UptakeRule


class CompiledOneNutrient(OneNutrient):
    """The same rule, by a function that numba has compiled, where cells eat by the source's rule."""

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """With the nutrient one step later. Not differentiable."""
        if type(uptake) is not BiomassUptake:
            return super().stepped(context, cells, uptake)
        return dataclasses.replace(context.colony, nutrient=compiled_carbon(context, cells))

    def supply(
        self, colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics
    ) -> Float[Array, " node"]:
        """The nutrient where nodes are. Not differentiable."""
        return compiled_nutrient_at(colony, numerics)

    def drift(self, context: Context) -> Float[Array, "node 2"]:
        """λ5 ∇c. Not differentiable."""
        return context.parameters.mobility * compiled_gradient_at(context.colony, context.numerics)


def compiled_carbon(context: Context, cells: Cells) -> Float[Array, "x y"]:
    """`eaten` of one colony."""
    diffusivity, rate = context.parameters.diffusivity, context.parameters.metabolic_rate
    return compiled_step(context, cells, context.colony.nutrient, diffusivity, rate)


def compiled_step(
    context: Context,
    cells: Cells,
    field: Float[Array, "x y"],
    diffusivity: Float[Array, ""],
    rate: Float[Array, ""],
    rest: Float[Array, ""] | float = 1.0,
) -> Float[Array, "x y"]:
    """∂c/∂t = D ∇²c − r max(−g, 0) c one step later, what is on the boundary being as it was.

    Arguments:
        context: The colony before the step.
        cells: Of its living and its dead.
        field: c.
        diffusivity: D.
        rate: r.
        rest: c where nothing has eaten.
    """
    colony, numerics, relaxation = context.colony, context.numerics, context.relaxation
    dtype = field.dtype
    alpha = diffusivity * numerics.dt / numerics.spacing**2
    count, rho = sweeps(alpha)
    union = 0.0 if relaxation.union is None else relaxation.union, relaxation.union_reach
    numbers = -0.5 * numerics.domain, numerics.spacing, *union, rate * numerics.dt, alpha, rho, rest
    shapes, counts = shapes_of(cells)
    sizes = numerics.points, *counts, patch_of(numerics.spacing), count
    name = operation("eating", np.dtype(dtype))
    return jax.ffi.ffi_call(name, jax.ShapeDtypeStruct(field.shape, dtype), input_output_aliases={0: 0})(
        field,
        cells.centres,
        cells.directions,
        *shapes,
        weights_of_cells(context.eating, colony.parents),
        jnp.stack([jnp.asarray(number, dtype) for number in numbers]),
        jnp.stack([jnp.asarray(size, jnp.int32) for size in sizes]),
    )
