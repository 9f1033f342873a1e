"""What outline a cell has (source 2.16 - 2.20; docs/model.md, section 3.1)."""

from typing import ClassVar

from yeastfit.model.cells import Cells, cells_of
from yeastfit.model.colony import Colony
from yeastfit.model.parameters import Parameters
from yeastfit.model.rules import ShapeRule


class EllipticalCells(ShapeRule):
    """Ellipses (u/p)² + (v/q)² = 1, q = λ7 p, as in the original model."""

    name: ClassVar[str] = "ellipse"

    def cells(self, colony: Colony, parameters: Parameters) -> Cells:
        """Of aspect ratio λ7. Differentiable."""
        return cells_of(colony, parameters.aspect_ratio)
