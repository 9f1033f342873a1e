"""Blocky cells, as plants have: superellipses (source 5.1.1).

    |u/p|^n + |v/q|^n = 1,    q = λ7 p,    n = `shape_exponent`,    f = (|u/p|^n + |v/q|^n)^(2/n) − 1

u and v are coordinates along and across a cell, p half its length. n = 2 is the ellipse, a larger n comes closer to a
rectangle. f is of degree 2 in lengths as the ellipse's is: −1 at the centre, 0 on the outline. A cell has the area
4 p q Γ(1 + 1/n)² / Γ(1 + 2/n).
"""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp

from yeastfit.model.cells import Cells, cells_of
from yeastfit.model.colony import Colony
from yeastfit.model.parameters import Parameters
from yeastfit.model.rules import ShapeRule
from yeastfit.parameter_set import Parameter

SHAPE_EXPONENT = Parameter(
    "shape_exponent",
    "n",
    "exponent of a cell's outline: 2 an ellipse, more is blockier",
    (2.0, 8.0),
    2.0,
    "",
    2.0,
    50.0,
)


class SuperellipticalCells(ShapeRule):
    """Blockier than ellipses, |u/p|ⁿ + |v/q|ⁿ = 1.

    `shape_exponent` 2 is the source, to rounding. Differentiable in n.
    """

    name: ClassVar[str] = "superellipse"
    parameters: ClassVar[tuple[Parameter, ...]] = (SHAPE_EXPONENT,)

    def cells(self, colony: Colony, parameters: Parameters) -> Cells:
        """Of aspect ratio λ7 and exponent n."""
        cells = cells_of(colony, parameters.aspect_ratio)
        return dataclasses.replace(cells, exponents=jnp.broadcast_to(parameters["shape_exponent"], cells.weights.shape))
