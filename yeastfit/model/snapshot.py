"""What statistics of a step are taken from, and what only the state of a simulated colony tells.

With w_i the weight of node i and x_i its position:

    cells = Σ_k w_k,    d̄ = Σ w_i |x_i| / Σ w_i,    μ the growth rate of the step

(table 3.1 of "A Novel Algebraic Agent Based Model for Pseudohyphal Baker's Yeast Colony Morphology"). A whole node has
the weight 1, an empty slot 0. All can be differentiated.
"""

from collections.abc import Mapping
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.cell_overlap import overlap_area
from yeastfit.model.cells import Cells, Scalar, level_set, weights_of_cells
from yeastfit.model.colony import Colony, lengthened, widened
from yeastfit.model.norm import norm
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation


class Snapshot(eqx.Module):
    """What statistics of a step are taken from.

    Attributes:
        cells: Of the step, before births and motion.
        growth_rate: μ of the step, in μ*.
        colony: After the motion.
        parameters: Values of the model's parameters.
        relaxation: Smoothing widths.
    """

    cells: Cells
    growth_rate: Float[Array, ""]
    colony: Colony
    parameters: Parameters
    relaxation: Relaxation

    def widened(self, room: int, newborn: Mapping[str, float]) -> "Snapshot":
        """With room for more nodes, of which nothing is seen; not traced.

        Arguments:
            room: Slots, those in use included.
            newborn: Initial values of the state of nodes, by name.
        """
        more = room - self.colony.parents.shape[0]
        if more <= 0:
            return self

        cells = jax.tree.map(lambda values: lengthened(values, more, values[-1]), self.cells)
        cells = replace(cells, weights=lengthened(self.cells.weights, more, 0.0))
        return replace(self, cells=cells, colony=widened(self.colony, room, newborn))

    def level_set(self, reach: Scalar, origin: float, spacing: float, points: int) -> Float[Array, "x y"]:
        """g of the cells on a square grid around the origin, negative inside the colony.

        Arguments:
            reach: r² = f + 1 up to which a cell counts.
            origin: Coordinate of the first grid point along either axis, in L0.
            spacing: Of the grid, in L0.
            points: Along its side.

        Returns:
            g, dimensionless; large where no cell reaches.
        """
        return level_set(self.cells, self.relaxation.union, reach, origin, spacing, points)

    @property
    def mean_radius(self) -> Float[Array, ""]:
        """d̄, the mean distance of nodes from the origin, in L0."""
        weights = self.colony.weights
        return jnp.sum(weights * norm(*self.colony.positions.T)) / jnp.sum(weights)

    @property
    def cell_count(self) -> Float[Array, ""]:
        """Number of cells, one less than nodes as long as they all hang together and nobody is dying."""
        weights, parents = self.colony.weights, self.colony.parents
        without_cell = jnp.where(parents < 0, weights, 0.0)
        unjoined = weights[1:] - weights_of_cells(weights, parents) - without_cell[1:]
        return jnp.sum(weights) - jnp.sum(without_cell) - jnp.sum(unjoined)

    @property
    def dead_share(self) -> Float[Array, ""]:
        """Share of nodes that are dead and still there."""
        weights = self.colony.weights
        vitality = self.colony.node_state.get("vitality", jnp.ones_like(weights))
        return 1.0 - jnp.sum(weights * vitality) / jnp.sum(weights)

    @property
    def networks(self) -> Float[Array, ""]:
        """Number of trees of nodes that hang together."""
        return jnp.sum(jnp.where(self.colony.parents < 0, self.colony.weights, 0.0))

    @property
    def overlap_area(self) -> Float[Array, ""]:
        """Area in which cells overlap, summed over pairs of cells, in L0²."""
        return overlap_area(self.cells, self.relaxation.union, self.relaxation.boundary)
