"""The implicit step that is tried beside substeps: it must be what it says, or its being no good tells nothing."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of

from benchmarks.implicit_step import ImplicitMotion, conjugate_residuals
from yeastfit.model.laws.contact import contact
from yeastfit.model.laws.forces import springs
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context

PLACES = np.array([[0.0, 0.0], [0.9, 0.1], [0.48, 0.1], [1.6, 0.7], [1.0, 0.52]])


def test_conjugate_residuals_solve_a_symmetric_system(double: None) -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(8, 8))
    matrix, right = np.eye(8) + root @ root.T, rng.normal(size=(4, 2))
    found = conjugate_residuals(lambda v: (matrix @ v.ravel()).reshape(v.shape), jnp.asarray(right), 8)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right.ravel()).reshape(4, 2), rtol=1e-9)


@pytest.mark.thorough
def test_nodes_move_as_a_dense_solution_has_it(double: None) -> None:
    """With the matrix of derivatives of springs and contact, written out."""
    numerics = Numerics(domain=10.0, spacing=0.5, dt=0.05, capacity=len(PLACES))
    colony = colony_of(PLACES, np.array([-1, 0, 1, 1, 3]), numerics=numerics, step=1)
    parameters, relaxation = Parameters(), Relaxation()
    context = Context.of(colony, parameters, relaxation, numerics, Model().death)

    def pushed(x: jax.Array) -> jax.Array:
        here = replace(colony, positions=x)
        push = contact(here, parameters.repulsion_radius, relaxation)
        return parameters.elasticity * springs(here) + parameters.repulsivity * push

    velocity, size = pushed(colony.positions), colony.positions.size
    matrix = np.eye(size) - numerics.dt * jax.jacobian(pushed)(colony.positions).reshape(size, size)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9)
    expected = PLACES.ravel() + numerics.dt * np.linalg.solve(matrix, np.asarray(velocity).ravel())
    moved = ImplicitMotion(size).moved(context, velocity)
    np.testing.assert_allclose(np.asarray(moved).ravel(), expected, atol=1e-8)
