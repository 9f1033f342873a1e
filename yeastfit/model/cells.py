"""Elliptical cells, and their union as a level set (source 2.15 - 2.20; docs/model.md, sections 3.1 and 3.2).

A cell is the edge between a node and its parent: p = ½|x_child − x_parent|, q = λ7 p, and in its own frame
f = (u/p)² + (v/q)² − 1 = r² − 1, dimensionless. Hard union: g = min_k f_k. Relaxed, with weights w_k in [0, 1]:

    g = −s log Σ_k w_k exp(−f_k / s),    f = r² − 1,

a sum of anisotropic Gaussians, hence local: only r² ≤ `reach` is ever evaluated. Each cell covers its
bounding box with square patches of grid points; the patches of all cells form one list that is worked off in
chunks, so the work follows the area of the cells, and no cell is cut however stretched it is.

Cells with exponents n are superellipses, r² = (|u/p|^n + |v/q|^n)^(2/n), of which n = 2 is the ellipse.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from yeastfit.model.colony import Colony
from yeastfit.model.differentiable_sum import sum_of_terms
from yeastfit.model.numerics import largest_in_ensemble

PATCH = 8  # grid points along a patch on fine grids: one cell is 2 to 3 patches wide at the source's spacing
COARSE = 0.3  # spacing from which half as many do: 4 points of 0.4 L0 hold most cells of a crowded colony
CHUNK = 512  # patches of PATCH² points that are worked off together, at most: their numbers stay in a CPU's cache
CHUNK_ON_GPU = 16_384  # a kernel takes about as long to start as it takes to run over so many
FAR = 1e3  # g where no cell reaches: outside for every width
LARGEST = 80.0  # |f|/s that enters: beyond, exp leaves single precision. s of at least 1/LARGEST keeps f = −1 exact

Scalar = Float[Array, ""] | float


class Cells(eqx.Module):
    """Ellipses of all slots but the first; slots without a cell have weight 0."""

    centres: Float[Array, "cell 2"]
    directions: Float[Array, "cell 2"]
    half_lengths: Float[Array, " cell"]
    half_widths: Float[Array, " cell"]
    weights: Float[Array, " cell"]
    exponents: Float[Array, " cell"] | None = None

    @property
    def radii(self) -> Float[Array, " cell"]:
        """How far cells reach from their centres at r² = 1, at most: a superellipse into the corner of its box."""
        if self.exponents is None:
            return jnp.maximum(self.half_lengths, self.half_widths)
        return jnp.hypot(self.half_lengths, self.half_widths)


def cells_of(colony: Colony, aspect_ratio: Float[Array, ""], shortest: float = 1e-3) -> Cells:
    """The cells of a colony. Differentiable.

    Arguments:
        colony: Its state.
        aspect_ratio: λ7.
        shortest: Half length, in L0, to which shorter ones are raised. A newborn cell of length δ = 0.01 is longer;
            only the cell of coincident nodes is not, and it has no direction.

    Returns:
        One cell for each node but the first.
    """
    child = colony.positions[1:]
    parent = colony.positions[jnp.maximum(colony.parents[1:], 0)]
    edge = child - parent
    squared = jnp.sum(edge**2, axis=-1)
    exists = (colony.weights[1:] > 0) & (squared > (2 * shortest) ** 2)
    length = jnp.sqrt(jnp.where(exists, squared, 1.0))
    half_length = jnp.where(exists, 0.5 * length, shortest)
    return Cells(
        centres=0.5 * (child + parent),
        directions=jnp.where(exists[:, None], edge / length[:, None], jnp.array([1.0, 0.0], edge.dtype)),
        half_lengths=half_length,
        half_widths=aspect_ratio * half_length,
        weights=weights_of_cells(colony.weights, colony.parents),
    )


def weights_of_cells(weights: Float[Array, " node"], parents: Int[Array, " node"]) -> Float[Array, " cell"]:
    """A cell has the weight of its lighter node: the child's, unless the parent is dying."""
    child, parent = weights[1:], weights[jnp.maximum(parents[1:], 0)]
    return jnp.where(parents[1:] >= 0, jnp.where(parent < child, parent, child), 0.0)


def level_set(
    cells: Cells,
    union: Float[Array, ""] | None,
    reach: Scalar,
    origin: Scalar,
    spacing: Scalar,
    points: int,
) -> Float[Array, "x y"]:
    """g on a square grid. Differentiable in the cells; the hard union almost everywhere.

    Arguments:
        cells: Ellipses with weights.
        union: s, or None for the hard union.
        reach: r² = f + 1 up to which a cell counts.
        origin: Coordinate of the first grid point along either axis.
        spacing: Of the grid.
        points: Along its side.

    Returns:
        g, negative inside the colony; `FAR` where no cell reaches.
    """
    s, patch = union, patch_of(spacing)
    first, counts = _patches(cells, reach, origin, spacing, points, patch)
    ends = jnp.cumsum(counts[:, 0] * counts[:, 1])
    chunk = _chunk(patch, cells.weights.shape[0])
    margin = patch  # a patch may stick out by less than this

    def add_chunk(grid: Float[Array, "x y"], i: Int[Array, ""], args: tuple) -> Float[Array, "x y"]:
        cells, s, first, counts, ends = args
        item = i * chunk + jnp.arange(chunk)
        cell = jnp.minimum(jnp.searchsorted(ends, item, side="right"), ends.shape[0] - 1)
        local = item - (ends[cell] - counts[cell, 0] * counts[cell, 1])
        corner = first[cell] + patch * jnp.stack([local // counts[cell, 1], local % counts[cell, 1]], axis=-1)
        f = -1.0 + _squared_radius(jax.tree.map(lambda leaf: leaf[cell], cells), corner, origin, spacing, patch)
        beyond = (item >= ends[-1])[:, None]  # scatter drops what starts outside the padded grid
        corner = jnp.where(beyond, points + 2 * margin, corner + margin)
        if s is None:
            return jax.lax.scatter_min(grid, corner, f, _WINDOWS, mode=_DROP)
        near = f < LARGEST * s
        blob = jnp.where(near, cells.weights[cell][:, None, None] * jnp.exp(-jnp.where(near, f, 0.0) / s), 0.0)
        return jax.lax.scatter_add(grid, corner, blob, _WINDOWS, mode=_DROP)

    trips = largest_in_ensemble((ends[-1] + chunk - 1) // chunk)
    args = cells, s, first, counts, ends
    # what is accumulated: Σ w exp(−f/s) from 0, or, hard, min f from FAR
    grid = jnp.full((points + 2 * margin,) * 2, FAR if s is None else 0.0, cells.centres.dtype)
    if s is None:
        grid = jax.lax.fori_loop(0, trips, lambda i, grid: add_chunk(grid, i, args), grid)
        return grid[margin:-margin, margin:-margin]
    total = sum_of_terms(add_chunk, trips, grid, args)[margin:-margin, margin:-margin]
    reached = total > 0
    return jnp.where(reached, -s * _logarithm(jnp.where(reached, total, 1.0)), FAR)


@jax.custom_jvp
def _logarithm(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """log x, with finite second derivatives down to the smallest x, whose square is 0."""
    return jnp.log(x)


@_logarithm.defjvp
def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return _logarithm(*primals), tangents[0] * _reciprocal(*primals)


@jax.custom_jvp
def _reciprocal(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """1 / x. Its slope 1 / x² may overflow; times a slope of x it does not."""
    return 1.0 / x


@_reciprocal.defjvp
def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    inverse = _reciprocal(*primals)
    return inverse, -inverse * (tangents[0] * inverse)


def patch_of(spacing: Scalar) -> int:
    """Grid points along a patch."""
    coarse = isinstance(spacing, int | float) and spacing >= COARSE  # a traced one is taken for a fine one
    return PATCH // 2 if coarse else PATCH


def _chunk(patch: int, cells: int) -> int:
    """How many patches are worked off together: not many more than there are."""
    most, of_one = (CHUNK_ON_GPU, 4) if jax.default_backend() == "gpu" else (CHUNK, 1)
    return min(most * (PATCH // patch) ** 2, max(64, of_one * cells))


_WINDOWS = jax.lax.ScatterDimensionNumbers(
    update_window_dims=(1, 2), inserted_window_dims=(), scatter_dims_to_operand_dims=(0, 1)
)
_DROP = jax.lax.GatherScatterMode.FILL_OR_DROP


def _patches(
    cells: Cells, reach: Scalar, origin: Scalar, spacing: Scalar, points: int, patch: int
) -> tuple[Int[Array, "cell 2"], Int[Array, "cell 2"]]:
    """First grid index and number of patches, per axis, that cover {r² ≤ reach} of each cell.

    Cells of weight 0 and parts beyond the grid get none.
    """
    cells = jax.lax.stop_gradient(cells)
    axes = jnp.eye(2, dtype=cells.centres.dtype)
    supports = jnp.stack([squared_support(cells, axis) for axis in axes], axis=-1)
    extent = jnp.sqrt(jax.lax.stop_gradient(jnp.asarray(reach)) * supports)
    first = jnp.ceil(jnp.clip((cells.centres - extent - origin) / spacing, 0, points)).astype(int)
    last = jnp.floor(jnp.clip((cells.centres + extent - origin) / spacing, -1, points - 1)).astype(int)
    counts = jnp.where(cells.weights[:, None] > 0, (jnp.maximum(last - first + 1, 0) + patch - 1) // patch, 0)
    return first, counts


def squared_support(cells: Cells, vectors: Float[Array, "*#cell 2"]) -> Float[Array, "*cell"]:
    """The support function of cells about their centres, squared: (max d·x over r² ≤ 1)² for vectors d.

    It is (p d·a)² + (q d·b)² for an ellipse with axes a and b. A superellipse's is the norm of (p d·a, q d·b) with the
    dual exponent n / (n − 1).
    """
    along, across = jnp.unstack(turned(vectors, cells.directions), axis=-1)
    along, across = cells.half_lengths * along, cells.half_widths * across
    if cells.exponents is None:
        return along**2 + across**2
    return squared_norm(along, across, cells.exponents / (cells.exponents - 1.0))


def turned(vectors: Float[Array, "*#cell 2"], directions: Float[Array, "*cell 2"]) -> Float[Array, "*cell 2"]:
    """Vectors in the frames whose first axes are `directions`."""
    (x, y), (cosine, sine) = jnp.unstack(vectors, axis=-1), jnp.unstack(directions, axis=-1)
    return jnp.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1)


def _squared_radius(
    cells: Cells, corner: Int[Array, "patch 2"], origin: Scalar, spacing: Scalar, patch: int
) -> Float[Array, "patch a b"]:
    """r² = (u/p)² + (v/q)² on the grid points of one patch per cell."""
    # r² = ((cos θ dx + sin θ dy) / p)² + ((cos θ dy − sin θ dx) / q)², multiplied out: rows, columns, one product
    offsets = jnp.arange(patch)
    dx = origin + spacing * (corner[:, :1] + offsets) - cells.centres[:, :1]
    dy = origin + spacing * (corner[:, 1:] + offsets) - cells.centres[:, 1:]
    cos, sin = cells.directions[:, :1], cells.directions[:, 1:]
    if cells.exponents is not None:
        p, q, n = (leaf[:, None, None] for leaf in (cells.half_lengths, cells.half_widths, cells.exponents))
        x, y, cos, sin = dx[:, :, None], dy[:, None, :], cos[:, :, None], sin[:, :, None]
        return squared_norm((cos * x + sin * y) / p, (cos * y - sin * x) / q, n)
    along, across = cells.half_lengths[:, None] ** -2, cells.half_widths[:, None] ** -2
    xx, yy = cos**2 * along + sin**2 * across, sin**2 * along + cos**2 * across
    xy = 2.0 * cos * sin * (along - across)
    return (xx * dx**2)[:, :, None] + (yy * dy**2)[:, None, :] + (xy * dx)[:, :, None] * dy[:, None, :]


def squared_norm(
    u: Float[Array, "*shape"], v: Float[Array, "*shape"], n: Float[Array, "*#shape"]
) -> Float[Array, "*shape"]:
    """(|u|ⁿ + |v|ⁿ)^(2/n) = m (1 + (l / m)^(n/2))^(2/n), m and l the larger and the smaller one of u² and v².

    0 at the origin; for n ≥ 2 differentiable in all three. Powers are written as exponentials of logarithms, which XLA
    computes many at a time on a CPU.
    """
    larger, smaller = jnp.maximum(u**2, v**2), jnp.minimum(u**2, v**2)
    little = jnp.finfo(larger.dtype).eps ** 2  # changes the result by less than this, and no quotient is 0 / 0
    ratio = (smaller + little) / (larger + little)
    return larger * jnp.exp(2.0 / n * jnp.log(1.0 + jnp.exp(0.5 * n * jnp.log(ratio))))
