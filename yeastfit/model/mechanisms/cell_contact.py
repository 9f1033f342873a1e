"""Contact between cells instead of nodes (source 5.1.2, A.2).

    C_ij = ∬ ½ + ½ tanh(−f / K),    f = k log(exp(f_i / k) + exp(f_j / k))

is the area in which cells i and j overlap (`pair_overlap`), a function of the places of their four nodes: centre, angle
and length of an ellipse are those of the edge between its two. Either the overlap pushes,

    cells         dx_n/dt = … − κ_c Σ_ij w_j C_ij ∂C_ij/∂x_n,    κ_c = `overlap_stiffness`,

or it is a constraint of overdamped motion, with multipliers that push and never pull,

    constraint    dx/dt = v − Jᵀ μ,    0 ≤ μ ⊥ J Jᵀ μ − J v − α (C − C_0) ≥ 0,    J = ∂C/∂x,    α = `release_rate`:

v is the velocity by springs and drift, so that an overlap above C_0 shrinks at least as e^(−αt) and a smaller one grows
no faster than it would take to reach C_0. A light cell pushes as little as it weighs. Only pairs whose boxes meet are
looked at: the work grows with their number. Coordinates are those of the first cell of a pair, so forces and torques of
a pair add up to nothing, to rounding.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from yeastfit.errors import InputError
from yeastfit.model.cell_overlap import CHUNK, MOST, meeting_pairs
from yeastfit.model.cells import cells_of
from yeastfit.model.differentiable_sum import sum_of_terms
from yeastfit.model.mechanisms.pair_overlap import REACHED, SHORTEST, overlap_and_slope
from yeastfit.model.numerics import largest_in_ensemble
from yeastfit.model.rules import ContactRule, Context, Rule
from yeastfit.parameter_set import Parameter
from yeastfit.text import quoted

WIDEST = 20  # k / K
SWEEPS = 40  # of the projected iteration for multipliers

OVERLAP_STIFFNESS = Parameter(
    "overlap_stiffness", "κ_c", "force of overlapping cells, over η μ* / L0²", (1.0, 60.0), 20.0
)
RELEASE_RATE = Parameter("release_rate", "α", "rate at which overlaps shrink, over μ*", (0.5, 25.0), 5.0)


class _BetweenCells(ContactRule):
    """What both rules share.

    Attributes:
        union: k, over what width the overlap of two cells is smoothed where one begins to cover the other.
        boundary: K, over what width the outline of a cell is smoothed.
    """

    idle: ClassVar[tuple[str, ...]] = ("repulsivity", "repulsion_radius")
    union: float = eqx.field(static=True, default=0.1)
    boundary: float = eqx.field(static=True, default=0.2)

    def __check_init__(self) -> None:
        for name in ("union", "boundary"):
            if not getattr(self, name) > 0:
                raise InputError(f"contact: {name} is {quoted(getattr(self, name))}, it must be above 0")
        if self.union > WIDEST * self.boundary:  # beyond, exp(2f / K) has no place in single precision
            raise InputError(
                f"contact: union is {quoted(self.union)}, it must be at most {WIDEST} times boundary, {self.boundary:g}"
            )

    def objection(self, rules: Mapping[str, Rule]) -> str | None:
        """Cells are ellipses."""
        shape = rules["shape"].name
        return None if shape == "ellipse" else f"pushes ellipses apart, not shape {shape!r}: choose one of the two"

    def meeting(self, context: Context) -> "Pairs":
        """The pairs of cells that may overlap."""
        colony, ratio = context.colony, context.parameters.aspect_ratio
        cells = jax.lax.stop_gradient(cells_of(colony, ratio))
        real = cells.half_lengths > 0.5 * SHORTEST
        cells = eqx.tree_at(lambda c: c.weights, cells, jnp.where(real, cells.weights, 0.0))
        reach = jnp.asarray(1.0 + REACHED * self.boundary, cells.centres.dtype)
        room = -(-MOST * cells.weights.shape[0] // CHUNK) * CHUNK
        pairs, found = meeting_pairs(cells, reach, room)
        ends = jnp.stack([pairs + 1, jnp.maximum(colony.parents[pairs + 1], 0)], axis=-1).reshape(room, 4)
        trips = largest_in_ensemble((jnp.minimum(found, room) + CHUNK - 1) // CHUNK)
        return Pairs(ends, pairs, found, trips, jnp.asarray(room))


class Pairs(eqx.Module):
    """Pairs of cells: the slots of their nodes (child and parent of the first, then of the second) and of the cells.

    Attributes:
        ends: Of nodes.
        cells: Of cells.
        found: How many there are; more than `room` have no place.
        trips: Chunks that hold them.
        room: Places.
    """

    ends: Int[Array, "pair 4"]
    cells: Int[Array, "pair 2"]
    found: Int[Array, ""]
    trips: Int[Array, ""]
    room: Int[Array, ""]

    @property
    def complete(self) -> Float[Array, ""]:
        """1, or nan where some pairs have no place: such a colony is reported as not finite."""
        return jnp.where(self.found > self.room, jnp.nan, 1.0)


class CellContact(_BetweenCells):
    """Overlapping cells push each other, the more the more they overlap. Differentiable."""

    name: ClassVar[str] = "cells"
    parameters: ClassVar[tuple[Parameter, ...]] = (OVERLAP_STIFFNESS,)

    def velocity(self, context: Context, motion: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """−κ_c Σ w_j C ∂C/∂x over all pairs."""
        colony, parameters, pairs = context.colony, context.parameters, self.meeting(context)
        args = (colony.positions, weights_of_ends(context), parameters.aspect_ratio, pairs)
        push = sum_of_terms(self._push_of_chunk, pairs.trips, jnp.zeros_like(colony.positions), args)
        return parameters["overlap_stiffness"] * push * pairs.complete

    def _push_of_chunk(
        self, push: Float[Array, "node 2"], i: Int[Array, ""], args: tuple[Any, ...]
    ) -> Float[Array, "node 2"]:
        """Adds −w C ∂C/∂x of the next CHUNK pairs, w that of the other cell."""
        positions, weights, ratio, pairs = args
        ends, cells, real = chunk_of(pairs, i)
        areas, slopes = overlap_and_slope(positions[ends], ratio, self.union, self.boundary)
        other = jnp.repeat(weights[cells[:, ::-1]], 2, axis=1)
        force = jnp.where(real[:, None, None], -(areas[:, None] * other)[..., None] * slopes, 0.0)
        return push.at[ends].add(force)


def weights_of_ends(context: Context) -> Float[Array, " cell"]:
    """Weights of cells."""
    return cells_of(context.colony, context.parameters.aspect_ratio).weights


def chunk_of(pairs: Pairs, i: Int[Array, ""]) -> tuple[Array, Array, Array]:
    """Slots of nodes and of cells of the next CHUNK pairs, and which of these exist."""
    ends, cells = (jax.lax.dynamic_slice_in_dim(slots, i * CHUNK, CHUNK) for slots in (pairs.ends, pairs.cells))
    return ends, cells, i * CHUNK + jnp.arange(CHUNK) < pairs.found
