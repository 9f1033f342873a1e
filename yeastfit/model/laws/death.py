"""What becomes of nodes. In the source's model none dies (docs/model.md, section 8).

A rule of death takes weight from nodes. A node of weight 0 has no cell, pulls and pushes no other node and counts in no
mean.
"""

from typing import ClassVar

from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.rules import Context, DeathRule


class NoDeath(DeathRule):
    """No node dies, as in the original model."""

    name: ClassVar[str] = "none"

    def living(self, colony: Colony) -> Float[Array, " node"]:
        """All of them."""
        return colony.weights

    def deaths(self, context: Context) -> Colony:
        """The same colony."""
        return context.colony
