"""What moves a node: springs, contact and chemotaxis (source 2.10; MODEL.md section 3.7).

    dx_i/dt = λ2 Σ_j A_ij w_j (1 − r_ij) e_ij + λ3 Σ_{j≠i} w_j H(λ4 − r_ij) e_ij + λ5 ∇c(x_i)

r_ij = |x_i − x_j|, e_ij = (x_i − x_j) / r_ij, w_j the weight of node j (1 in the hard model). Coincident nodes have no
direction and no force between them. Forward Euler is stable while Δt λ2 (degree + 1) < 2.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from yeastfit.model.colony import Colony
from yeastfit.model.differentiable_sum import sum_of_terms
from yeastfit.model.numerics import Numerics, largest_in_ensemble
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation

SMALLEST = 0.1  # side of the bins contacts are searched in, at least: only a smaller radius would do with less
LANES = 4  # candidates of one row of bins looked at together


def velocity(
    colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics
) -> Float[Array, "node 2"]:
    """dx/dt of every node; 0 in empty slots. Differentiable; hard contact has no derivative with respect to λ4."""
    motion = (
        parameters.elasticity * springs(colony)
        + parameters.repulsivity * contact(colony, parameters.repulsion_radius, relaxation)
        + parameters.mobility * chemotaxis(colony, numerics)
    )
    return jnp.where(colony.alive[:, None], motion, 0.0)


def springs(colony: Colony) -> Float[Array, "node 2"]:
    """Σ_j A_ij w_j (1 − r_ij) e_ij: a cell shorter than L0 pushes its ends apart, a longer one pulls."""
    joined = (colony.parents >= 0) & colony.alive
    parent = jnp.maximum(colony.parents, 0)
    distance, direction = _apart(colony.positions - colony.positions[parent], joined)
    push = jnp.where(joined, 1.0 - distance, 0.0)[:, None] * direction
    on_child = colony.weights[parent][:, None] * push
    return on_child.at[parent].add(-colony.weights[:, None] * push)


def stiffness(colony: Colony) -> Float[Array, ""]:
    """Largest w_i + Σ_j A_ij w_j of any node, its degree + 1 in the hard model: Euler needs Δt λ2 times it below 2."""
    joined = (colony.parents >= 0) & colony.alive
    parent = jnp.maximum(colony.parents, 0)
    pulled_by = colony.weights + jnp.where(joined, colony.weights[parent], 0.0)
    return jnp.max(pulled_by.at[parent].add(jnp.where(joined, colony.weights, 0.0)))


def contact(colony: Colony, radius: Float[Array, ""], relaxation: Relaxation) -> Float[Array, "node 2"]:
    """Σ_{j≠i} w_j H(λ4 − r_ij) e_ij over all pairs, joined ones included; relaxed, a ramp inside the radius.

    Nodes are sorted into square bins, column by column; the three bins that can touch a node's own in one column are
    consecutive, so each node meets three runs of the sorted order, LANES candidates at a time. A node meets itself too,
    at distance 0, where there is no force.
    """
    order, first, runs = _neighbour_runs(colony, relaxation.contact_reach(radius))
    x, y = jnp.unstack(colony.positions, axis=-1)
    args = (x, y, x[order], y[order], colony.weights[order], radius, relaxation, first, runs)
    trips = largest_in_ensemble((jnp.max(runs) + LANES - 1) // LANES)
    return jnp.stack(sum_of_terms(_push_of_lane, trips, (jnp.zeros_like(x), jnp.zeros_like(y)), args), axis=-1)


def _push_of_lane(force: tuple[Array, Array], i: Int[Array, ""], args: tuple) -> tuple[Array, Array]:
    """Adds the push of the next LANES candidates of every run."""
    x, y, x_other, y_other, weights, radius, relaxation, first, runs = args
    lane = i * LANES + jnp.arange(LANES)
    other = jnp.minimum(first[:, :, None] + lane, x.shape[0] - 1)
    dx, dy = x[:, None, None] - x_other[other], y[:, None, None] - y_other[other]
    squared = dx**2 + dy**2
    apart = (lane < runs[:, :, None]) & (squared > 0)
    distance = jnp.sqrt(jnp.where(apart, squared, 1.0))
    strength = jnp.where(apart, weights[other] * contact_law(distance, radius, relaxation), 0.0)
    push_x, push_y = (strength * _turned(d / distance, relaxation) for d in (dx, dy))
    return force[0] + jnp.sum(push_x, axis=(1, 2)), force[1] + jnp.sum(push_y, axis=(1, 2))


def contact_law(
    distance: Float[Array, "*pair"], radius: Float[Array, ""], relaxation: Relaxation
) -> Float[Array, "*pair"]:
    """The law of contact: H(λ4 − r), or the ramp (λ4 + o w − r)/w in [0, 1], o the share of it outside the radius."""
    if relaxation.contact is None:
        return jnp.heaviside(radius - distance, jnp.asarray(0.0, distance.dtype))
    return jnp.clip((relaxation.contact_reach(radius) - distance) / relaxation.contact, 0.0, 1.0)


def _turned(direction: Float[Array, "*pair"], relaxation: Relaxation) -> Float[Array, "*pair"]:
    """The direction of a contact, of whose derivative only the share `turning` is kept."""
    if relaxation.turning is None:
        return direction
    fixed = jax.lax.stop_gradient(direction)
    return fixed + relaxation.turning * (direction - fixed)


def chemotaxis(colony: Colony, numerics: Numerics) -> Float[Array, "node 2"]:
    """∇c at the nodes: central differences at the grid points, bilinear in between."""
    c, h = colony.nutrient, numerics.spacing
    corner, weights = _bilinear(colony.positions, numerics, margin=1)
    i, j = corner[:, 0, None] + _DI, corner[:, 1, None] + _DJ
    gradient = jnp.stack([c[i + 1, j] - c[i - 1, j], c[i, j + 1] - c[i, j - 1]], axis=-1) / (2 * h)
    return jnp.sum(weights[..., None] * gradient, axis=1)


def nutrient_at(colony: Colony, numerics: Numerics) -> Float[Array, " node"]:
    """c at the nodes, bilinear."""
    corner, weights = _bilinear(colony.positions, numerics, margin=0)
    return jnp.sum(weights * colony.nutrient[corner[:, 0, None] + _DI, corner[:, 1, None] + _DJ], axis=1)


# corners of a grid square; 32 bits, or jax would keep NumPy's 64 in single precision
_DI, _DJ = np.array([0, 0, 1, 1], np.int32), np.array([0, 1, 0, 1], np.int32)


def _bilinear(
    positions: Float[Array, "node 2"], numerics: Numerics, margin: int
) -> tuple[Int[Array, "node 2"], Float[Array, "node 4"]]:
    """Lower corner and the four weights of the grid square around each node, `margin` points off the boundary."""
    scaled = (positions + 0.5 * numerics.domain) / numerics.spacing
    corner = jnp.clip(jnp.floor(scaled).astype(int), margin, numerics.points - 2 - margin)
    s, t = jnp.unstack(scaled - corner, axis=-1)
    return corner, jnp.stack([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t], axis=-1)


def _apart(difference: Float[Array, "*pair 2"], valid: Array) -> tuple[Float[Array, "*pair"], Float[Array, "*pair 2"]]:
    """r and e, with r = 1 and e = 0 for pairs that are not valid or coincide; finite derivatives everywhere."""
    squared = jnp.sum(difference**2, axis=-1)
    valid = valid & (squared > 0)
    distance = jnp.sqrt(jnp.where(valid, squared, 1.0))
    return distance, jnp.where(valid[..., None], difference, 0.0) / distance[..., None]


def _neighbour_runs(
    colony: Colony, reach: Float[Array, ""]
) -> tuple[Int[Array, " node"], Int[Array, "node 3"], Int[Array, "node 3"]]:
    """The nodes in bin order, and for each node the start and the length of three runs that hold all within `reach`."""
    positions, reach = jax.lax.stop_gradient((colony.positions, reach))
    bins = jnp.floor(positions / jnp.maximum(reach, SMALLEST)).astype(int)
    low = jnp.min(jnp.where(colony.alive[:, None], bins, jnp.iinfo(bins.dtype).max), axis=0)
    bins = bins - low + 1
    rows = jnp.max(jnp.where(colony.alive, bins[:, 1], 0)) + 2
    key = jnp.where(colony.alive, bins[:, 0] * rows + bins[:, 1], jnp.iinfo(bins.dtype).max)
    order = jnp.argsort(key)
    ranked = key[order]
    middle = (bins[:, 0, None] + jnp.arange(-1, 2)) * rows + bins[:, 1, None]
    first = jnp.searchsorted(ranked, middle - 1, side="left")
    last = jnp.searchsorted(ranked, middle + 1, side="right")
    return order, first, jnp.where(colony.alive[:, None], last - first, 0)
