"""What only the state of a simulated colony tells. With w_i the weight of node i and x_i its position:

    cells = Σ_k w_k,    d̄ = Σ w_i |x_i| / Σ w_i,    μ the growth rate of the step

(table 3.1 of "A Novel Algebraic Agent Based Model for Pseudohyphal Baker's Yeast Colony Morphology"). A whole node has
the weight 1, an empty slot 0. All three can be differentiated.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.measure.statistics.indicator import norm
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.model.cell_overlap import overlap_area
from yeastfit.model.cells import weights_of_cells
from yeastfit.model.simulate import Snapshot


def growth_rate(snapshot: Snapshot) -> Float[Array, ""]:
    """μ in μ*."""
    return snapshot.growth_rate


def mean_radius(snapshot: Snapshot) -> Float[Array, ""]:
    """d̄, the mean distance of nodes from the origin, in L0."""
    weights = snapshot.colony.weights
    return jnp.sum(weights * norm(*snapshot.colony.positions.T)) / jnp.sum(weights)


def cell_count(snapshot: Snapshot) -> Float[Array, ""]:
    """Number of cells: one less than nodes, as long as they all hang together and nobody is dying."""
    weights, parents = snapshot.colony.weights, snapshot.colony.parents
    without_cell = jnp.where(parents < 0, weights, 0.0)
    unjoined = weights[1:] - weights_of_cells(weights, parents) - without_cell[1:]
    return jnp.sum(weights) - jnp.sum(without_cell) - jnp.sum(unjoined)


def dead_share(snapshot: Snapshot) -> Float[Array, ""]:
    """Share of nodes that are dead and still there."""
    colony = snapshot.colony
    vitality = colony.node_state.get("vitality", jnp.ones_like(colony.weights))
    return 1.0 - jnp.sum(colony.weights * vitality) / jnp.sum(colony.weights)


def networks(snapshot: Snapshot) -> Float[Array, ""]:
    """Number of trees of nodes that hang together."""
    return jnp.sum(jnp.where(snapshot.colony.parents < 0, snapshot.colony.weights, 0.0))


ENTRIES = (
    Statistic("growth_rate", 0, "growth rate μ over μ*", "growth rate μ", nodes=growth_rate, comparable=False),
    Statistic(
        "mean_radius",
        1,
        "mean distance of nodes from where the colony began",
        "mean radius of nodes d̄",
        nodes=mean_radius,
        reach=3.0,
    ),
    Statistic("cell_count", 0, "number of cells", "cells", nodes=cell_count),
    Statistic("dead_share", 0, "share of nodes that are dead and in the way", nodes=dead_share, may_vanish=True),
    Statistic("networks", 0, "number of networks of cells that hang together", nodes=networks),
    Statistic(
        "overlap_area",
        2,
        "area in which cells overlap, summed over pairs of cells",
        nodes=lambda s: overlap_area(s.cells, s.relaxation.union, s.relaxation.boundary),
        comparable=False,
    ),
)
