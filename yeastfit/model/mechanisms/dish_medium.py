"""The nutrient of a dish, which runs out of it: the source's, without the reservoir at the boundary (source 5.1.2).

    ∂c/∂t = λ1 ∇²c − b c,    no flux through the dish's wall, c = 1 at the start

What is eaten is gone: ∫c dx + eaten is constant. c0 is the concentration at the start. In a dish that is wide beside
√(λ1 t) the colony is the source's.
"""

import dataclasses
from typing import ClassVar

from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.laws.medium import STEPS, eaten
from yeastfit.model.rules import Context, MediumRule, UptakeRule


class DishMedium(MediumRule):
    """One nutrient, of which a dish holds so much and no more. Differentiable."""

    name: ClassVar[str] = "dish"

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """With the nutrient one step later."""
        return dataclasses.replace(context.colony, nutrient=eaten(context, cells, uptake, STEPS["dish"]))
