"""Random fluctuations of the nutrient. The source's model has none (docs/model.md, section 8)."""

from typing import ClassVar

from jaxtyping import Array, Float

from yeastfit.model.rules import Context, FluctuationRule


class NoFluctuation(FluctuationRule):
    """The nutrient diffuses and is eaten, no more, as in the original model."""

    name: ClassVar[str] = "none"

    def shaken(self, context: Context) -> Float[Array, "x y"]:
        """The same nutrient."""
        return context.colony.nutrient
