"""How fast cells take up nutrient (source 2.14; docs/model.md, section 3.3).

b = λ6 max(−g, 0),    g the level set of the colony, −1 at the centre of a cell and 0 on its outline.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.rules import Context, UptakeRule


class BiomassUptake(UptakeRule):
    """In proportion to the biomass max(−g, 0), as in the original model."""

    name: ClassVar[str] = "biomass"

    def rate(
        self, context: Context, level_set: Float[Array, "x y"], nutrient: Float[Array, "x y"]
    ) -> Float[Array, "x y"]:
        """Biomass b, with λ6 = `metabolic_rate`."""
        return biomass(level_set, context.parameters.metabolic_rate)


def biomass(level_set: Float[Array, "x y"], metabolic_rate: Float[Array, ""]) -> Float[Array, "x y"]:
    """Biomass b = λ6 max(−g, 0).

    Arguments:
        level_set: g.
        metabolic_rate: λ6.

    Returns:
        b, at the points of g.
    """
    return metabolic_rate * jnp.maximum(-level_set, 0.0)
