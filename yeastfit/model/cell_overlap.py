"""Area in which cells overlap; differentiable.

Where cells with level functions f_j = r_j² − 1 lie on top of each other, the smooth maximum f of the f_j is negative:

    f = k log Σ_j exp(f_j / k),    C = ∬ ½ + ½ tanh(−f / K) dx dy

(C as in "A Novel Algebraic Agent Based Model for Pseudohyphal Baker's Yeast Colony Morphology", appendix A.2, equation
8). k and K are widths, dimensionless as f is; for K → 0 and k → 0, C is the area that lies in all the cells. With
T = tanh(−f / K),

    ∂C/∂q_a = −1/(2K) ∬ (1 − T²) f_a,    ∂²C/∂q_a∂q_b = −1/(2K²) ∬ (1 − T²) (2T f_a f_b + K f_ab).

The first is equations 9 and 10 there. Equation 12 is printed with 1/(4K²) and T in place of 1/(2K²) and 2T, which
finite differences contradict; the second formula above follows from equation 11. The tests compare automatic
differentiation with both.

The overlap of a colony is the sum of C over its pairs of cells, so an area that lies in three cells counts three times.
Only pairs that may meet are integrated, each on a small grid of its own: the work grows with their number.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from yeastfit.model.cells import Cells, squared_norm, squared_support, turned
from yeastfit.model.differentiable_sum import sum_of_terms
from yeastfit.model.numerics import largest_in_ensemble

POINTS = 24  # grid points along each side of the box of a pair
SATURATED = 4.5  # f/K up to which a cell counts: tanh is saturated to e⁻⁹, as in `Relaxation.reach`
MOST = 32  # pairs per slot there is room for: colonies of 500 cells have 4 to 8 at the default widths
CHUNK = 128  # pairs integrated together
CANDIDATES = 1024  # pairs near each other that are looked at together


def overlap_area(
    cells: Cells, union: Float[Array, ""] | float | None, boundary: Float[Array, ""] | float | None
) -> Float[Array, ""]:
    """Sum the overlap of a colony's pairs of cells, Σ_{i<j} w_i w_j C_ij.

    Differentiable in cells and widths, by jvp, vjp and hessian; almost everywhere without k, in the weights alone
    without K. The grid is constant under differentiation, as the domain of equation 9 is. The value for a colony of 500
    cells is within 10⁻⁵ at k = 0.025 and K = 0.2, and within 0.4 % by hard rules; the gradient is within 0.2 %. Second
    derivatives within 1 % need k = 0.3 and K = 0.5.

    Arguments:
        cells: Of the colony; empty slots have weight 0 and take no part.
        union: k; None is the hard maximum.
        boundary: K; None is the hard step, which counts grid points.

    Returns:
        The overlap in L0²; nan, as are its derivatives, if more than `MOST` pairs a slot meet.
    """
    k, K = (None if width is None else jnp.asarray(width, cells.centres.dtype) for width in (union, boundary))
    room = -(-MOST * cells.weights.shape[0] // CHUNK) * CHUNK
    reach = jnp.ones_like(cells.weights[0]) if K is None else 1.0 + SATURATED * K
    pairs, found = meeting_pairs(*jax.lax.stop_gradient((cells, reach)), room)
    trips = largest_in_ensemble((jnp.minimum(found, room) + CHUNK - 1) // CHUNK)
    total = sum_of_terms(_add_chunk, trips, jnp.zeros_like(cells.weights[0]), (cells, pairs, found, reach, k, K))
    return total * jnp.where(found > room, jnp.nan, 1.0)


def intersection(
    cells: Cells, union: Float[Array, ""] | float | None, x: Float[Array, "*grid"], y: Float[Array, "*grid"]
) -> Float[Array, "*grid"]:
    """f at points (x, y), of all the cells, whatever their weights; max_j f_j without k."""

    def level(cell: Cells) -> Array:
        (dx, dy), (cosine, sine) = (x - cell.centres[0], y - cell.centres[1]), cell.directions
        u = (cosine * dx + sine * dy) / cell.half_lengths
        v = (cosine * dy - sine * dx) / cell.half_widths
        return (u**2 + v**2 if cell.exponents is None else squared_norm(u, v, cell.exponents)) - 1.0

    f = jax.vmap(level)(cells)
    return functools.reduce(jnp.maximum, f) if union is None else union * jax.nn.logsumexp(f / union, axis=0)


def smooth_step(f: Float[Array, "*grid"], boundary: Float[Array, ""] | float | None) -> Float[Array, "*grid"]:
    """½ + ½ tanh(−f / K): 1 where f is negative, 0 where it is positive; the hard step without K."""
    return (f <= 0).astype(f.dtype) if boundary is None else 0.5 + 0.5 * jnp.tanh(-f / boundary)


def smooth_area(
    f: Float[Array, "*grid"], boundary: Float[Array, ""] | float | None, element: Float[Array, ""] | float
) -> Float[Array, ""]:
    """C = ∬ ½ + ½ tanh(−f / K), f on grid points of which each stands for an area `element`."""
    return element * jnp.sum(smooth_step(f, boundary))


def _add_chunk(total: Float[Array, ""], i: Int[Array, ""], args: tuple) -> Float[Array, ""]:
    """Adds w_i w_j C_ij of the next CHUNK pairs."""
    cells, pairs, found, *rules = args
    both = cells_at(cells, jax.lax.dynamic_slice_in_dim(pairs, i * CHUNK, CHUNK))
    areas = jax.vmap(lambda pair: _area_of_pair(pair, *rules))(both)
    real = i * CHUNK + jnp.arange(CHUNK) < found
    return total + jnp.sum(jnp.where(real, both.weights[:, 0] * both.weights[:, 1] * areas, 0.0))


def _area_of_pair(
    pair: Cells, reach: Float[Array, ""], union: Float[Array, ""] | None, boundary: Float[Array, ""] | None
) -> Float[Array, ""]:
    """C of two cells by the midpoint rule, on POINTS² rectangles of `box_of_pair` along the axes of the first cell.

    The integrand vanishes at the box's edge, so that the error falls faster than any power of the spacing once k and K
    are resolved. Coordinates are relative to the first cell, so that single precision is enough for a newborn one.
    """
    fixed, reach = jax.lax.stop_gradient((pair, reach))
    low, high = box_of_pair(cells_at(fixed, 0), cells_at(fixed, 1), reach)
    middles = (jnp.arange(POINTS) + 0.5) / POINTS
    u, v = low[:, None] + (high - low)[:, None] * middles
    u, v = u[:, None], v[None, :]
    centre, (cosine, sine) = fixed.centres[0], fixed.directions[0]
    moved = eqx.tree_at(lambda cells: cells.centres, pair, pair.centres - centre)
    f = intersection(moved, union, cosine * u - sine * v, sine * u + cosine * v)
    return smooth_area(f, boundary, jnp.prod(high - low) / POINTS**2)


def box_of_pair(
    first: Cells, second: Cells, reach: Float[Array, ""]
) -> tuple[Float[Array, "*pair 2"], Float[Array, "*pair 2"]]:
    """Lower and upper corner, from the first cell's centre along its axes, of the box that holds r² ≤ reach of both.

    It is the first cell's bounding box cut with the second's, and empty where they do not meet.
    """
    own = jnp.stack([first.half_lengths, first.half_widths], axis=-1)
    along, (x, y) = first.directions, jnp.unstack(first.directions, axis=-1)
    across = jnp.stack([-y, x], axis=-1)
    other = jnp.stack([squared_support(second, direction) for direction in (along, across)], axis=-1)
    apart = turned(second.centres - first.centres, along)
    own, other = jnp.sqrt(reach) * own, jnp.sqrt(reach * other)
    low, high = jnp.maximum(-own, apart - other), jnp.minimum(own, apart + other)
    return low, jnp.maximum(low, high)


def cells_at(cells: Cells, index: Int[Array, "..."] | int) -> Cells:
    """The cells of these slots."""
    return jax.tree.map(lambda leaf: leaf[index], cells)


def meeting_pairs(cells: Cells, reach: Float[Array, ""], room: int) -> tuple[Int[Array, "pair 2"], Int[Array, ""]]:
    """Slots of the pairs of cells that may meet, the shorter cell first, and how many there are; not differentiable.

    Cells are sorted into square bins as wide as the longest cell reaches, so that those a cell can meet are near by in
    the sorted order: in the rest of its own column's run of bins, or in the three bins of the next column. Of these
    candidates, which are worked off in one list, the pairs are those whose shadows meet (`shadows_meet`).
    """
    alive = cells.weights > 0
    bins = jnp.floor(cells.centres / (2 * jnp.sqrt(reach) * jnp.max(cells.radii))).astype(int)
    bins = bins - jnp.min(jnp.where(alive[:, None], bins, jnp.iinfo(bins.dtype).max), axis=0) + 1
    rows = jnp.max(jnp.where(alive, bins[:, 1], 0)) + 2
    key = jnp.where(alive, bins[:, 0] * rows + bins[:, 1], jnp.iinfo(bins.dtype).max)
    order = jnp.argsort(key)
    ranked, ordered = key[order], cells_at(cells, order)
    first = jnp.concatenate([jnp.arange(1, order.shape[0] + 1), jnp.searchsorted(ranked, ranked + rows - 1)])
    last = jnp.concatenate([jnp.searchsorted(ranked, ranked + n, side="right") for n in (1, rows + 1)])
    runs = jnp.where(jnp.tile(alive[order], 2), last - first, 0)
    begins, candidates = jnp.cumsum(runs) - runs, jnp.sum(runs)

    def add_chunk(i: Int[Array, ""], state: tuple[Array, Array]) -> tuple[Array, Array]:
        pairs, found = state
        item = i * CANDIDATES + jnp.arange(CANDIDATES)
        run = jnp.searchsorted(begins, item, side="right") - 1
        both = jnp.stack([run, first[run] + item - begins[run]], axis=-1) % order.shape[0]
        one, other = (cells_at(ordered, rank) for rank in both.T)
        meet = (item < candidates) & shadows_meet(one, other, reach)
        pair = order[jnp.where((one.half_lengths <= other.half_lengths)[:, None], both, both[:, ::-1])]
        slot = jnp.where(meet, found + jnp.cumsum(meet) - 1, room)
        return pairs.at[slot].set(pair, mode="drop"), found + jnp.sum(meet)

    trips = largest_in_ensemble((candidates + CANDIDATES - 1) // CANDIDATES)
    nothing = jnp.zeros((room, 2), order.dtype), jnp.zeros((), order.dtype)
    return jax.lax.fori_loop(0, trips, add_chunk, nothing)


def shadows_meet(one: Cells, other: Cells, reach: Float[Array, ""]) -> Bool[Array, "*pair"]:
    """Whether the shadows of {r² ≤ reach} of two cells on the line through their centres meet; touching cells' do."""
    apart = other.centres - one.centres
    shadows = (jnp.sqrt(reach * squared_support(cells, apart)) for cells in (one, other))
    return sum(shadows) >= jnp.sum(apart**2, axis=-1)
