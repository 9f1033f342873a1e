"""Carbon by the operations of one nutrient, and nitrogen where cells eat it, for large colonies on a CPU.

The same numbers as those of `nitrogen_medium`; the last bits differ. They have no derivative. Carbon in a dish is left
to that rule.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.compiled.interpolation import compiled_gradient_at, compiled_nutrient_at
from yeastfit.model.compiled.medium import compiled_step
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.mechanisms.nitrogen_medium import NitrogenMedium, eaten_nitrogen, scarcer, with_nitrogen_alone
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context, UptakeRule


class CompiledNitrogenMedium(NitrogenMedium):
    """The same rule, carbon of a reservoir by what numba has compiled, where cells eat by the source's rule."""

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """Both nutrients one step later; nitrogen that is nowhere eaten is as it was. Not differentiable."""
        if type(uptake) is not BiomassUptake or self.carbon_boundary != "reservoir":
            return super().stepped(context, cells, uptake)
        colony = context.colony
        eaten = (context.parameters["nitrogen_uptake"] > 0) | jnp.any(eaten_nitrogen(context) != 0)
        nitrogen = jax.lax.cond(
            eaten, lambda: self.nitrogen_left(context, cells), lambda: context.colony.medium["nitrogen"]
        )
        medium = {**colony.medium, "nitrogen": nitrogen}
        return dataclasses.replace(colony, nutrient=compiled_step(context, cells), medium=medium)

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
