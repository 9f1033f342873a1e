"""Whether cells let go of each other. In the source's model they never do (docs/model.md, section 8)."""

from collections.abc import Mapping
from typing import ClassVar

from jaxtyping import Array

from yeastfit.model.colony import Colony
from yeastfit.model.rules import Context, DetachmentRule


class NoDetachment(DetachmentRule):
    """The network stays in one piece, as in the original model."""

    name: ClassVar[str] = "none"

    def detached(self, context: Context, newborn: Mapping[str, float | Array]) -> Colony:
        """The same colony."""
        return context.colony
