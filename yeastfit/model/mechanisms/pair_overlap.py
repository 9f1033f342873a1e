"""The area in which two cells overlap, and its derivatives by the places of their four nodes, for `cell_contact`.

In the frame of the first cell, whose centre is the origin and whose axis is u, both level functions are quadratic,

    f_1 = A_1 u² + B_1 v² − 1,    f_2 = A_2 x² + 2 D_2 x y + B_2 y² − 1,    (x, y) = (u, v) − (X, Y),

and with their smooth maximum f of width k (`cell_overlap`)

    C = Σ h dA,    h = ½ + ½ tanh(−f / K),    ∂C/∂q = −(2/K) Σ h (1 − h) (p_1 ∂f_1/∂q + p_2 ∂f_2/∂q) dA,

p_j = exp(f_j / k) / Σ_i exp(f_i / k). So the derivatives by A_1, B_1, X, Y, A_2, D_2, B_2 are first and second moments
of h (1 − h) p_j, which are summed together with C, and those by the nodes follow by the chain rule. The sum is over
`POINTS`² points of the box that holds both cells as far as they count. The box is constant under differentiation, as
the integrand vanishes at its edge.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.cell_overlap import box_of_pair
from yeastfit.model.cells import Cells

POINTS = 14  # along each side of the box of a pair
REACHED = 2.5  # f/K up to which a cell counts; forces are within 1.2 % (rms) of finer ones
MOST = 40.0  # of 2f/K: where it is larger, nothing is inside
SHORTEST = 2e-3  # L0: a cell shorter than this pushes nobody

Quadratics = tuple[Float[Array, " pair"], ...]  # A_1, B_1, X, Y, A_2, D_2, B_2


def overlap_and_slope(
    ends: Float[Array, "pair 4 2"], ratio: Float[Array, ""], union: float, boundary: float
) -> tuple[Float[Array, " pair"], Float[Array, "pair 4 2"]]:
    """C of pairs of cells, and its derivatives by their nodes. Differentiable once more, both ways.

    Arguments:
        ends: Of each pair: the two nodes of the first cell, then those of the second.
        ratio: λ7, width over length.
        union: k.
        boundary: K.

    Returns:
        C in L0², and ∂C/∂x in L0.
    """
    quadratics, chain, pair = jax.vjp(lambda ends: _quadratics(ends, ratio), ends, has_aux=True)
    fixed = jax.lax.stop_gradient(pair)
    low, high = box_of_pair(*fixed, jnp.asarray(1.0 + REACHED * boundary, ends.dtype))
    area, slopes = _sums(quadratics, low, high, union, boundary)
    return area, chain(slopes)[0]


def _quadratics(ends: Float[Array, "pair 4 2"], ratio: Float[Array, ""]) -> tuple[Quadratics, tuple[Cells, Cells]]:
    """The numbers of each pair's level functions, and its cells in the frame of the first."""
    edges, middles = ends[:, ::2] - ends[:, 1::2], 0.5 * (ends[:, ::2] + ends[:, 1::2])
    lengths = jnp.sqrt(jnp.maximum(jnp.sum(edges**2, axis=-1), SHORTEST**2))
    (cosine, sine), (apart, axis) = (edges[:, 0] / lengths[:, :1]).T, (middles[:, 1] - middles[:, 0], edges[:, 1])

    def turned(vector: Float[Array, "pair 2"]) -> Float[Array, "pair 2"]:
        x, y = vector.T
        return jnp.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1)

    centre, direction = turned(apart), turned(axis / lengths[:, 1:])
    halves = 0.5 * lengths.T, 0.5 * ratio * lengths.T
    (along, across), (c, s) = (halves[0] ** -2, halves[1] ** -2), direction.T
    own = along[0], across[0]
    other = c**2 * along[1] + s**2 * across[1], c * s * (along[1] - across[1]), s**2 * along[1] + c**2 * across[1]
    weights, straight = jnp.ones_like(c), jnp.broadcast_to(jnp.array([1.0, 0.0], c.dtype), centre.shape)
    pair = (
        Cells(jnp.zeros_like(centre), straight, halves[0][0], halves[1][0], weights),
        Cells(centre, direction, halves[0][1], halves[1][1], weights),
    )
    return (*own, *centre.T, *other), pair


def _sums(
    quadratics: Quadratics, low: Float[Array, "pair 2"], high: Float[Array, "pair 2"], union: float, boundary: float
) -> tuple[Float[Array, " pair"], Quadratics]:
    """C, and its derivatives by the quadratics, by the midpoint rule."""
    own_u, own_v, centre_x, centre_y, xx, xy, yy = quadratics
    u, v = jnp.moveaxis(low[..., None] + (high - low)[..., None] * (jnp.arange(POINTS) + 0.5) / POINTS, 1, 0)
    x, y = u - centre_x[:, None], v - centre_y[:, None]
    element = jnp.prod(high - low, axis=-1) / POINTS**2

    first = (own_u[:, None] * u**2 - 1.0)[:, :, None] + (own_v[:, None] * v**2)[:, None, :]
    second = (xx[:, None] * x**2 - 1.0)[:, :, None] + (yy[:, None] * y**2)[:, None, :]
    second += (2.0 * xy[:, None] * x)[:, :, None] * y[:, None, :]
    lower = jnp.exp(-jnp.abs(first - second) / union)  # over the higher level: f = max + k log(1 + lower)
    outside = jnp.exp(jnp.minimum(2.0 / boundary * jnp.maximum(first, second), MOST))
    outside *= (1.0 + lower) ** (2.0 * union / boundary)  # exp(2f / K)
    inside = 1.0 / (1.0 + outside)
    change = outside * inside**2
    higher = change / (1.0 + lower)
    by_first = jnp.where(first > second, higher, change - higher)
    by_second = change - by_first

    # moments: sums along v first
    of_x, of_y = jnp.sum(by_second, axis=2), jnp.sum(by_second, axis=1)
    of_xy = jnp.sum(by_second * y[:, None, :], axis=2)
    mean_x, mean_y = jnp.sum(of_x * x, axis=1), jnp.sum(of_xy, axis=1)
    moments = (
        jnp.sum(jnp.sum(by_first, axis=2) * u**2, axis=1),
        jnp.sum(jnp.sum(by_first, axis=1) * v**2, axis=1),
        -2.0 * (xx * mean_x + xy * mean_y),
        -2.0 * (xy * mean_x + yy * mean_y),
        jnp.sum(of_x * x**2, axis=1),
        2.0 * jnp.sum(of_xy * x, axis=1),
        jnp.sum(of_y * y**2, axis=1),
    )
    return element * jnp.sum(inside, axis=(1, 2)), tuple(-2.0 / boundary * element * moment for moment in moments)
