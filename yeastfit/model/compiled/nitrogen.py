"""Both nutrients by the operations of one, for large colonies on a CPU.

The same numbers as those of `nitrogen_medium`; the last bits differ. They have no derivative. Carbon in a dish is left
to that rule, and so is nitrogen in a dish once its wall is felt.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.active_window import extent_of_cells, extent_of_change
from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.compiled.interpolation import compiled_gradient_at, compiled_nutrient_at
from yeastfit.model.compiled.medium import compiled_carbon, compiled_step
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.mechanisms.nitrogen_medium import NitrogenMedium, eaten_nitrogen, scarcer, with_nitrogen_alone
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context, UptakeRule

WALL = 8  # grid points that a step carries nothing across that could be seen


class CompiledNitrogenMedium(NitrogenMedium):
    """The same rule by functions that numba has compiled, where cells eat a reservoir's carbon by the source's rule."""

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """Both nutrients one step later; nitrogen that is nowhere eaten is as it was. Not differentiable."""
        if type(uptake) is not BiomassUptake or self.carbon_boundary != "reservoir":
            return super().stepped(context, cells, uptake)
        colony = context.colony
        medium = {**colony.medium, "nitrogen": self._nitrogen(context, cells)}
        return dataclasses.replace(colony, nutrient=compiled_carbon(context, cells), medium=medium)

    def _nitrogen(self, context: Context, cells: Cells) -> Float[Array, "x y"]:
        """`nitrogen_left`: as it was where nobody has eaten, and by the step of a reservoir where that is the same."""
        field, parameters, numerics = context.colony.medium["nitrogen"], context.parameters, context.numerics
        rest = jnp.where(parameters["nitrogen_per_birth"] > 0, field[0, 0], 1.0)
        change = eaten_nitrogen(context)
        eaten = (parameters["nitrogen_uptake"] > 0) | jnp.any(change != 0)
        cells_reach = extent_of_cells(cells, context.relaxation.union_reach)
        reached = jnp.maximum(cells_reach, extent_of_change(change, numerics.spacing))
        walled = (self.boundary == "dish") & (reached + WALL * numerics.spacing > 0.5 * numerics.domain)
        laws = parameters["nitrogen_diffusivity"], parameters["nitrogen_uptake"], rest
        ways = (
            lambda: field,
            lambda: compiled_step(context, cells, field, *laws),
            lambda: self.nitrogen_left(context, cells),
        )
        return jax.lax.switch(jnp.where(eaten, 1 + walled, 0), ways)

    def supply(
        self, colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics
    ) -> Float[Array, " node"]:
        """The scarcer one. Not differentiable."""
        carbon = compiled_nutrient_at(colony, numerics)
        nitrogen = compiled_nutrient_at(with_nitrogen_alone(colony), numerics)
        return scarcer(carbon, parameters["nitrogen"] * nitrogen, relaxation)

    def drift(self, context: Context) -> Float[Array, "node 2"]:
        """λ5 ∇c + γ_N ∇n. Not differentiable."""
        colony, parameters, numerics = context.colony, context.parameters, context.numerics
        strength = parameters["nitrogen_mobility"] * parameters["nitrogen"]
        along = compiled_gradient_at(with_nitrogen_alone(colony), numerics)
        return parameters.mobility * compiled_gradient_at(colony, numerics) + strength * along
