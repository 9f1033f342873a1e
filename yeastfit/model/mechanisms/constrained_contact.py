"""Cells that may not overlap: constrained dynamics (source A.2); `cell_contact` has the equations.

The multipliers solve a problem of complementarity. Its matrix J Jᵀ is never formed: an accelerated projected iteration
(Nesterov 1983; Beck & Teboulle 2009, doi:10.1137/080716542) takes `SWEEPS` steps, each of the size that the sums of
absolute values of the matrix's rows allow.
"""

from functools import partial
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from yeastfit.errors import InputError
from yeastfit.model.differentiable_sum import sum_of_terms
from yeastfit.model.mechanisms.cell_contact import (
    RELEASE_RATE,
    SWEEPS,
    Pairs,
    _BetweenCells,
    chunk_of,
    weights_of_ends,
)
from yeastfit.model.mechanisms.pair_overlap import overlap_and_slope
from yeastfit.model.numerics import largest_in_ensemble
from yeastfit.model.rules import Context
from yeastfit.parameter_set import Parameter
from yeastfit.text import quoted

ROOMS = (512, 2048, 8192)  # pairs that are solved together; as many as there is room for if more meet
FAINT = 0.1  # of the tolerated overlap: what is smaller is no constraint


class ConstrainedContact(_BetweenCells):
    """Overlaps above a tolerated one shrink as e^(−αt). Differentiable but for which pairs are in contact.

    Attributes:
        tolerated: C_0, the overlap of a pair that is no contact, in L0².
    """

    name: ClassVar[str] = "constraint"
    parameters: ClassVar[tuple[Parameter, ...]] = (RELEASE_RATE,)
    tolerated: float = eqx.field(static=True, default=0.005)

    def __check_init__(self) -> None:
        if not self.tolerated >= 0:
            raise InputError(f"contact: tolerated is {quoted(self.tolerated)}, an area at least 0 is expected")

    def velocity(self, context: Context, motion: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """−Jᵀ μ."""
        colony, parameters, pairs = context.colony, context.parameters, self.meeting(context)
        cells = weights_of_ends(context)
        args = (colony.positions, cells, parameters.aspect_ratio, pairs)
        zero = jnp.zeros((*pairs.ends.shape, 3), colony.positions.dtype)
        areas, slopes = jnp.split(sum_of_terms(self._slopes_of_chunk, pairs.trips, zero, args), [1], axis=-1)
        given = areas[:, 0, 0], slopes, pairs, jnp.prod(cells[pairs.cells], axis=-1)

        def push(most: int) -> Float[Array, "node 2"]:
            area, slopes, some, weight = jax.tree.map(lambda one: one[:most] if one.ndim else one, given)
            return self._push(area, slopes, some, weight, motion, parameters["release_rate"])

        rooms = [most for most in ROOMS if most < pairs.ends.shape[0]] + [pairs.ends.shape[0]]
        index = largest_in_ensemble(jnp.sum(jnp.asarray(rooms[:-1]) < pairs.found))
        return jax.lax.switch(index, [partial(push, most) for most in rooms]) * pairs.complete

    def _push(
        self,
        area: Float[Array, " pair"],
        slopes: Float[Array, "pair 4 2"],
        pairs: Pairs,
        weight: Float[Array, " pair"],
        motion: Float[Array, "node 2"],
        release_rate: Float[Array, ""],
    ) -> Float[Array, "node 2"]:
        """−Jᵀ μ of pairs with these C and ∂C, which weigh so much."""
        slopes = jnp.where((area > FAINT * self.tolerated)[:, None, None], slopes, 0.0)

        def along(velocity: Array) -> Array:
            return jnp.sum(slopes * velocity[pairs.ends], axis=(1, 2))

        def back(multipliers: Array) -> Array:
            return jnp.zeros_like(motion).at[pairs.ends].add(multipliers[:, None, None] * slopes)

        wanted = along(motion) + release_rate * (area - self.tolerated)
        size = jax.lax.stop_gradient(_row_sums(slopes, pairs.ends, motion))
        multipliers = nonnegative(lambda m: along(back(weight * m)), wanted, size)
        return -back(weight * multipliers)

    def _slopes_of_chunk(self, total: Array, i: Int[Array, ""], args: tuple[Any, ...]) -> Array:
        """Sets C and ∂C/∂x of the next CHUNK pairs: of each node [pair, 4] its C and its two slopes."""
        positions, _, ratio, pairs = args
        ends, _, real = chunk_of(pairs, i)
        areas, slopes = overlap_and_slope(positions[ends], ratio, self.union, self.boundary)
        both = jnp.concatenate([jnp.broadcast_to(areas[:, None, None], (*ends.shape, 1)), slopes], axis=-1)
        there = jax.lax.dynamic_slice_in_dim(total, i * both.shape[0], both.shape[0])
        return jax.lax.dynamic_update_slice_in_dim(
            total, there + jnp.where(real[:, None, None], both, 0.0), i * both.shape[0], 0
        )


def nonnegative(
    matrix: Any, wanted: Float[Array, " pair"], size: Float[Array, " pair"], sweeps: int = SWEEPS
) -> Float[Array, " pair"]:
    """μ ≥ 0 with matrix(μ) ≥ wanted where μ = 0 and equal elsewhere, by accelerated projected steps.

    Arguments:
        matrix: Of which the sums of absolute values along rows are at most `size`.
        wanted: Right-hand side.
        size: 0 for rows without entries, whose multiplier stays 0.
        sweeps: Steps.
    """
    step = jnp.where(size > 0, 1.0 / jnp.where(size > 0, size, 1.0), 0.0)

    def sweep(carry: tuple[Array, Array], k: Float[Array, ""]) -> tuple[tuple[Array, Array], None]:
        before, ahead = carry
        found = jnp.maximum(ahead + step * (wanted - matrix(ahead)), 0.0)
        return (found, found + k / (k + 3.0) * (found - before)), None

    start = jnp.zeros_like(wanted)
    return jax.lax.scan(sweep, (start, start), jnp.arange(sweeps).astype(wanted.dtype))[0][0]


def _row_sums(slopes: Array, ends: Array, positions: Array) -> Array:
    """Σ_j |J|_i |J|_jᵀ of each pair i: at least the absolute row sum of J Jᵀ."""
    columns = jnp.zeros_like(positions).at[ends].add(jnp.abs(slopes))
    return jnp.sum(jnp.abs(slopes) * columns[ends], axis=(1, 2))
