"""What moves a node: springs, contact and drift along the nutrient gradient (source 2.10; docs/model.md, section 3.7).

    dx_i/dt = λ2 Σ_j A_ij w_j (1 − r_ij) e_ij + contact_i + λ5 ∇c(x_i)

r_ij = |x_i − x_j|, e_ij = (x_i − x_j) / r_ij, w_j the weight of node j (1 in the hard model). Coincident nodes have no
direction and no force between them. Forward Euler is stable while Δt λ2 (degree + 1) < 2.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.model.colony import Colony
from yeastfit.model.laws.medium import OneNutrient
from yeastfit.model.rules import ContactRule, Context, MediumRule, SpringRule


class TreeSprings(SpringRule):
    """Each cell is a spring between a node and its parent, as in the original model."""

    name: ClassVar[str] = "tree"

    def pull(self, colony: Colony) -> Float[Array, "node 2"]:
        """Along the edges of the tree."""
        return springs(colony)

    def stiffness(self, colony: Colony) -> Float[Array, ""]:
        """The largest degree, and 1."""
        return stiffness(colony)


ONE_NUTRIENT, TREE = OneNutrient(), TreeSprings()


def velocity(
    context: Context, contact: ContactRule, medium: MediumRule = ONE_NUTRIENT, springs: SpringRule = TREE
) -> Float[Array, "node 2"]:
    """dx/dt of every node; 0 in empty slots. Differentiable where the rules are."""
    colony, parameters = context.colony, context.parameters
    pull = parameters.elasticity * springs.answered(springs.pull(colony), colony.positions.shape)
    drift = medium.answered(medium.drift(context), colony.positions.shape)
    motion = pull + contact.answered(contact.velocity(context, pull + drift), colony.positions.shape) + drift
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


def _apart(difference: Float[Array, "*pair 2"], valid: Array) -> tuple[Float[Array, "*pair"], Float[Array, "*pair 2"]]:
    """r and e, with r = 1 and e = 0 for pairs that are not valid or coincide; finite derivatives everywhere."""
    squared = jnp.sum(difference**2, axis=-1)
    valid = valid & (squared > 0)
    distance = jnp.sqrt(jnp.where(valid, squared, 1.0))
    return distance, jnp.where(valid[..., None], difference, 0.0) / distance[..., None]
