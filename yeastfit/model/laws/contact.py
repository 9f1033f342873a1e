"""How nodes push each other apart (source 2.10; docs/model.md, section 3.7).

    contact_i = λ3 Σ_{j≠i} w_j H(λ4 − r_ij) e_ij

over all pairs, joined ones included; relaxed, H is a ramp inside the radius. r_ij = |x_i − x_j|,
e_ij = (x_i − x_j) / r_ij, w_j the weight of node j. Coincident nodes do not push each other.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from yeastfit.model.colony import Colony
from yeastfit.model.differentiable_sum import sum_of_terms
from yeastfit.model.numerics import largest_in_ensemble
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import ContactRule, Context

SMALLEST = 0.1  # side of the bins contacts are searched in, at least: only a smaller radius would do with less
LANES = 4  # candidates of one row of bins looked at together


class NodeContact(ContactRule):
    """Nodes closer than λ4 push each other apart, as in the original model. Hard, it has no derivative in λ4."""

    name: ClassVar[str] = "nodes"

    def velocity(self, context: Context, motion: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        """The sum over all pairs."""
        parameters = context.parameters
        return parameters.repulsivity * contact(context.colony, parameters.repulsion_radius, context.relaxation)


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
