"""Springs, contacts and chemotaxis: closed forms, symmetries, and the neighbour search against all pairs."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, grid, pair, random_tree
from jaxtyping import Array

from yeastfit.model.colony import Colony
from yeastfit.model.interpolation import gradient_at, nutrient_at
from yeastfit.model.laws.contact import NodeContact, contact, contact_law
from yeastfit.model.laws.forces import springs, velocity
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation

SMALL = Numerics(domain=8.0, spacing=0.2, capacity=4)
CROWDED = Numerics(domain=8.0, spacing=0.2, capacity=320)
LAWS = pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["hard", "ramp"])
CONFIGURATIONS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "one heap": lambda rng: rng.normal(0.0, 0.15, (300, 2)),
    "clusters": lambda rng: rng.uniform(-3, 3, (12, 2))[rng.integers(12, size=300)] + rng.normal(0, 0.2, (300, 2)),
    "spread": lambda rng: rng.uniform(-20.0, 20.0, (300, 2)) * [1.0, 0.05],
    "on the bins' edges": lambda rng: 0.5 * rng.integers(-4, 5, (300, 2)) + rng.choice([0.0, 1e-9], (300, 2)),
    "a row": lambda rng: np.stack([np.full(300, 0.1), np.linspace(-9.0, 9.0, 300)], axis=1),
}

touch, pulled = eqx.filter_jit(contact), eqx.filter_jit(springs)
nutrient_there, gradient_there = eqx.filter_jit(nutrient_at), eqx.filter_jit(gradient_at)


def crowd(positions: np.ndarray, seed: int = 0) -> Colony:
    """A random tree over these nodes, with random weights and slots to spare."""
    rng = np.random.default_rng(seed)
    nodes = len(positions)
    return colony_of(positions, random_tree(rng, nodes), rng.uniform(0.1, 1.0, nodes), numerics=CROWDED)


def all_pairs(colony: Colony, radius: float, relaxation: Relaxation) -> np.ndarray:
    """Σ_j w_j H(λ4 − r) e over every pair."""
    x, w = np.asarray(colony.positions), np.asarray(colony.weights)
    apart = x[:, None] - x[None, :]
    r = np.linalg.norm(apart, axis=-1)
    if relaxation.contact is None:
        law = (r < radius).astype(float)
    else:
        law = np.clip((radius - r) / float(relaxation.contact), 0.0, 1.0)
    share = np.divide(law * w, r, out=np.zeros_like(r), where=r > 0)
    force = np.einsum("ij,ijk->ik", share, apart)
    return np.where(np.asarray(colony.alive)[:, None], force, 0.0)


@pytest.mark.parametrize("distance", [0.01, 0.7, 1.0, 1.8])
def test_spring_of_one_cell(distance: float, double: None) -> None:
    """(1 − r) e on either end, times the weight of the other."""
    e = np.array([np.cos(0.3), np.sin(0.3)])
    force = pulled(colony_of(pair(distance), weights=[1.0, 0.4], numerics=SMALL))
    np.testing.assert_allclose(force, (1 - distance) * np.array([0.4 * e, -e, 0 * e, 0 * e]), atol=1e-14)


@pytest.mark.parametrize(
    ("distance", "hard", "ramp"),
    [(0.2, 1.0, 1.0), (0.3, 1.0, 1.0), (0.375, 1.0, 0.25), (0.4, 0.0, 0.0), (0.45, 0.0, 0.0)],
)
def test_contact_of_one_pair(distance: float, hard: float, ramp: float, double: None) -> None:
    """H(λ4 − r) e, or the ramp of width 0.1 inside λ4 = 0.4, times the weight of the other; nothing at λ4 itself."""
    e, radius = np.array([1.0, 0.0]), jnp.asarray(0.4)
    colony = colony_of([[distance, 0.0], [0.0, 0.0]], weights=[1.0, 0.4], numerics=SMALL)
    for strength, relaxation in ((hard, HARD), (ramp, Relaxation(contact=0.1))):
        expected = np.outer([0.4 * strength, -strength, 0.0, 0.0], e)
        np.testing.assert_allclose(touch(colony, radius, relaxation), expected, atol=1e-7)  # the width's last bit


def test_the_ramp_becomes_the_step() -> None:
    """They differ between λ4 − w and λ4 only, and there the ramp is weaker."""
    r, radius, law = np.linspace(0.01, 0.6, 500), jnp.asarray(0.5), eqx.filter_jit(contact_law)
    step = np.asarray(law(jnp.asarray(r), radius, HARD))
    for w in (0.2, 0.02, 0.002):
        ramp = np.asarray(law(jnp.asarray(r), radius, Relaxation(contact=w)))
        assert (ramp <= step).all()
        same = (r < 0.5 - w - 1e-6) | (r >= 0.5)
        np.testing.assert_array_equal(ramp[same], step[same])


@LAWS
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_neighbour_search_finds_what_all_pairs_find(name: str, relaxation: Relaxation, double: None) -> None:
    for seed in range(3):
        colony = crowd(CONFIGURATIONS[name](np.random.default_rng(seed)), seed)
        for radius in (0.5, 0.23):
            found = touch(colony, jnp.asarray(radius), relaxation)
            np.testing.assert_allclose(found, all_pairs(colony, radius, relaxation), atol=1e-10)


@LAWS
def test_no_net_force_between_nodes_of_full_weight(relaxation: Relaxation, double: None) -> None:
    rng = np.random.default_rng(5)
    colony = colony_of(CONFIGURATIONS["clusters"](rng), random_tree(rng, 300), numerics=CROWDED)
    for force in (pulled(colony), touch(colony, jnp.asarray(0.5), relaxation)):
        assert np.abs(force).max() > 1.0
        np.testing.assert_allclose(np.sum(force, axis=0), 0.0, atol=1e-10)


@LAWS
def test_forces_turn_and_move_with_the_colony(relaxation: Relaxation, double: None) -> None:
    colony = crowd(CONFIGURATIONS["clusters"](np.random.default_rng(6)))
    turn = np.array([[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]])
    there = np.asarray(colony.positions) @ turn.T + np.array([0.37, -11.3])
    moved = eqx.tree_at(lambda c: c.positions, colony, jnp.asarray(there))
    np.testing.assert_allclose(pulled(moved), np.asarray(pulled(colony)) @ turn.T, atol=1e-10)
    pushed, pushed_there = (np.asarray(touch(c, jnp.asarray(0.5), relaxation)) for c in (colony, moved))
    np.testing.assert_allclose(pushed_there, pushed @ turn.T, atol=1e-10)


@LAWS
def test_coincident_nodes_do_not_push_and_have_finite_derivatives(relaxation: Relaxation) -> None:
    """Three nodes in one place, joined in a chain, and a fourth apart."""
    at = jnp.array([[0.2, 0.1]] * 3 + [[0.4, 0.1]])

    @jax.jit
    def forces(positions: Array, radius: Array) -> tuple[Array, Array]:
        colony = colony_of(positions, numerics=SMALL)
        return springs(colony), contact(colony, radius, relaxation)

    direction = jnp.asarray(np.random.default_rng(0).normal(size=(4, 2)))
    value, slope = jax.jvp(forces, (at, jnp.asarray(0.5)), (direction, jnp.asarray(1.0)))
    np.testing.assert_allclose(value[0], np.outer([0.0, 0.0, -0.8, 0.8], [1, 0]), atol=1e-6)
    np.testing.assert_allclose(value[1], np.outer([-1, -1, -1, 3], [1, 0]), atol=1e-6)
    assert all(np.isfinite(s).all() for s in slope)


def test_derivative_of_the_ramp(double: None) -> None:
    """With respect to positions, weights and λ4, against central differences; no pair is near a kink's 1e-6."""
    rng = np.random.default_rng(8)
    at = (jnp.asarray(rng.normal(0, 0.3, (40, 2))), jnp.asarray(rng.uniform(0.1, 1, 40)), jnp.asarray(0.45))
    numerics = Numerics(domain=8.0, spacing=0.2, capacity=40)

    @jax.jit
    def force(positions: Array, weights: Array, radius: Array) -> Array:
        return contact(colony_of(positions, None, weights, numerics=numerics), radius, Relaxation())

    direction = tuple(jnp.asarray(rng.normal(size=a.shape)) for a in at)
    slope = jax.jvp(force, at, direction)[1]
    moves = [[np.asarray(a) + e * np.asarray(d) for a, d in zip(at, direction, strict=True)] for e in (1e-7, -1e-7)]
    up, down = (np.asarray(force(*there)) for there in moves)
    np.testing.assert_allclose(slope, (up - down) / 2e-7, rtol=1e-5, atol=1e-5)


def test_turning_scales_a_derivative_and_never_changes_a_value(double: None) -> None:
    """Moved across, a pair at r feels (strength / r) of the motion, of which `turning` is kept; moved along, all."""
    colony = crowd(CONFIGURATIONS["one heap"](np.random.default_rng(1)))
    values = [touch(colony, jnp.asarray(0.5), Relaxation(turning=t)) for t in (None, 0.0, 0.3, 1.0)]
    assert all(np.array_equal(value, values[0]) for value in values)

    @eqx.filter_jit
    def slopes_of(relaxation: Relaxation) -> Array:
        def force(x: Array) -> Array:
            return contact(colony_of(jnp.stack([x, jnp.zeros(2)]), numerics=SMALL), jnp.asarray(0.5), relaxation)[0]

        return jax.jacfwd(force)(jnp.array([0.4, 0.0]))

    for turning in (None, 0.0, 0.3, 1.0):
        slopes = slopes_of(Relaxation(contact=0.2, turning=turning))
        np.testing.assert_allclose(
            slopes, [[-1 / 0.2, 0.0], [0.0, (1.0 if turning is None else turning) * 0.5 / 0.4]], atol=1e-12
        )


def test_chemotaxis_is_exact_for_quadratic_and_sampling_for_bilinear_fields(double: None) -> None:
    """Central differences are exact for squares, and bilinear interpolation for their slopes; up to the edges."""
    x, y = grid(SMALL)
    points = np.random.default_rng(1).uniform(-3.8, 3.8, (4, 2))
    points[0] = (3.8, -3.8)
    px, py = points.T
    linear = colony_of(points, nutrient=0.3 + 0.5 * x - 0.2 * y + 0.1 * x * y, numerics=SMALL)
    np.testing.assert_allclose(nutrient_there(linear, SMALL), 0.3 + 0.5 * px - 0.2 * py + 0.1 * px * py, atol=1e-13)
    square = colony_of(points, nutrient=0.3 * x - y + 0.5 * x**2 - 0.2 * y**2 + 0.1 * x * y, numerics=SMALL)
    slope = np.stack([0.3 + px + 0.1 * py, -1 - 0.4 * py + 0.1 * px], axis=1)
    np.testing.assert_allclose(gradient_there(square, SMALL), slope, atol=1e-12)


def test_chemotaxis_continues_a_linear_field_beyond_the_last_differences(double: None) -> None:
    """At the edge, and outside the domain, so that a node that leaves does not fail."""
    x, y = grid(SMALL)
    colony = colony_of([[4.0, -4.0], [3.9, 3.9], [-4.3, 0.1], [0.0, 5.0]], nutrient=0.5 * x - 0.2 * y, numerics=SMALL)
    np.testing.assert_allclose(gradient_there(colony, SMALL), np.broadcast_to([0.5, -0.2], (4, 2)), atol=1e-13)


@LAWS
def test_velocity_is_the_weighted_sum_and_empty_slots_rest(relaxation: Relaxation, double: None) -> None:
    x, _ = grid(CROWDED)
    colony = eqx.tree_at(
        lambda c: c.nutrient, crowd(CONFIGURATIONS["clusters"](np.random.default_rng(9))), jnp.asarray(0.1 * x)
    )
    values = {"elasticity": 3.0, "repulsivity": 0.7, "repulsion_radius": 0.4, "mobility": 1.9}
    context = context_of(colony, CROWDED, relaxation, Parameters(**values))
    motion = np.asarray(eqx.filter_jit(velocity)(context, NodeContact()))
    expected = 3.0 * np.asarray(pulled(colony)) + 0.7 * all_pairs(colony, 0.4, relaxation) + np.array([1.9 * 0.1, 0.0])
    np.testing.assert_allclose(motion[:300], expected[:300], atol=1e-10)
    assert (motion[300:] == 0).all()
