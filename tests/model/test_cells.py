"""Ellipses and their union against direct evaluation everywhere, their limits, and their derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, grid, pair, random_tree
from jaxtyping import Array

from yeastfit.model.cells import FAR, LARGEST, Cells, cells_of, level_set, squared_support
from yeastfit.model.laws.uptake import biomass
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import HARD, Relaxation

NUMERICS = Numerics(domain=8.0, spacing=0.1, capacity=25)


cells_from = eqx.filter_jit(cells_of)


def joined(cells: Cells, relaxation: Relaxation, numerics: Numerics = NUMERICS) -> Array:
    """g on the nutrient's grid."""
    origin = -0.5 * numerics.domain
    return level_set(cells, relaxation.union, relaxation.reach, origin, numerics.spacing, numerics.points)


union = eqx.filter_jit(joined)


def squared_radii(cells: Cells, numerics: Numerics = NUMERICS) -> np.ndarray:
    """r² = (u/p)² + (v/q)² of every cell at every grid point, by rotation in the complex plane."""
    x, y = grid(numerics)
    parts = (cells.centres, cells.directions, cells.half_lengths, cells.half_widths)
    radii = []
    for centre, direction, half_length, half_width in zip(*map(np.asarray, parts), strict=True):
        frame = (x - centre[0] + 1j * (y - centre[1])) * complex(direction[0], -direction[1])
        radii.append((frame.real / half_length) ** 2 + (frame.imag / half_width) ** 2)
    return np.array(radii)


def crowd(seed: int) -> Cells:
    """24 cells, stretched up to the whole domain, some across its edge and one newborn."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-5.0, 5.0, (25, 2))
    positions[1] = positions[0] + [0.006, -0.008]
    parents = random_tree(rng, 25)
    return cells_from(colony_of(positions, parents, rng.uniform(0, 1, 25), numerics=NUMERICS), jnp.asarray(0.4))


def test_a_cell_is_the_edge_to_its_parent(double: None) -> None:
    positions, aspect = np.array([[1.0, 0.0], [1.0, 3.0], [-1.0, 0.0]]), jnp.asarray(0.5)
    cells = cells_from(colony_of(positions, [-1, 0, 0], [1.0, 0.3, 0.6], numerics=Numerics(capacity=4)), aspect)
    np.testing.assert_allclose(np.asarray(cells.centres)[:2], [[1.0, 1.5], [0.0, 0.0]])
    np.testing.assert_allclose(np.asarray(cells.directions)[:2], [[0.0, 1.0], [-1.0, 0.0]])
    np.testing.assert_allclose(np.asarray(cells.half_lengths)[:2], [1.5, 1.0])
    np.testing.assert_allclose(np.asarray(cells.half_widths)[:2], [0.75, 0.5])
    np.testing.assert_allclose(cells.weights, [0.3, 0.6, 0.0])


@pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["hard", "relaxed"])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.5707963, 2.9])
def test_level_set_of_one_cell_is_f(relaxation: Relaxation, angle: float, double: None) -> None:
    cells = cells_from(colony_of(pair(1.7, angle, (0.3, -0.8)), numerics=NUMERICS), jnp.asarray(0.6))
    g, f = np.asarray(union(cells, relaxation)), squared_radii(cells)[0] - 1.0
    near = f <= float(relaxation.reach) - 1.0
    assert near.sum() > 100
    np.testing.assert_allclose(g[near], f[near], atol=1e-12)
    assert (g[~near] >= np.minimum(f[~near], float(relaxation.reach) - 1.0)).all()


@pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["hard", "relaxed"])
def test_level_set_is_the_same_in_the_chunks_of_a_gpu(
    relaxation: Relaxation, double: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = crowd(0)
    here = np.asarray(union(cells, relaxation))
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    there = np.asarray(eqx.filter_jit(lambda one: joined(one, relaxation))(cells))
    np.testing.assert_allclose(there, here, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("relaxation", [HARD, Relaxation(), Relaxation(union=0.5, boundary=1.0)], ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_no_cell_is_cut(seed: int, relaxation: Relaxation, double: None) -> None:
    """Against all cells on the whole grid: what is left out is no more than what lies beyond `reach`."""
    cells = crowd(seed)
    g, r2 = np.asarray(union(cells, relaxation)), squared_radii(cells)
    assert r2.min(axis=(1, 2)).max() > 1.0  # some cell misses the domain altogether
    if relaxation.union is None:
        exact = r2[np.asarray(cells.weights) > 0].min(axis=0) - 1.0
        inside = exact <= 0.0
        np.testing.assert_allclose(g[inside], exact[inside], atol=1e-11)
        assert (g[~inside] > 0.0).all()
        return
    s = float(relaxation.union)
    exact = np.einsum("k,kxy->xy", cells.weights, np.exp((1.0 - r2) / s))
    left_out = exact - np.exp(-g / s)
    rounding = 1e-12 * exact + 24 * np.exp(-LARGEST)
    assert (left_out <= 24 * np.exp((1.0 - float(relaxation.reach)) / s) + rounding).all()
    assert (left_out >= -rounding).all()


@pytest.mark.parametrize("exponent", [None, 2.0, 4.0, 7.0])
def test_support_is_the_farthest_point_of_the_outline(exponent: float | None, double: None) -> None:
    """Among 100 000 of it, in directions of any length."""
    rng = np.random.default_rng(5)
    angle, turn = rng.uniform(0, 2 * np.pi, 8), np.linspace(0, 2 * np.pi, 100_001)
    long, wide, vectors = rng.uniform(0.3, 2, 8), rng.uniform(0.1, 2, 8), rng.normal(size=(8, 2))
    power = 1.0 if exponent is None else 2.0 / exponent
    u, v = (np.sign(f(turn)) * np.abs(f(turn)) ** power for f in (np.cos, np.sin))
    x, y = long[:, None] * u, wide[:, None] * v
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    farthest = ((cosine * x - sine * y) * vectors[:, :1] + (sine * x + cosine * y) * vectors[:, 1:]).max(axis=1)
    directions, exponents = np.hstack([cosine, sine]), None if exponent is None else np.full(8, exponent)
    arrays = (rng.normal(size=(8, 2)), directions, long, wide, np.ones(8), exponents)
    cells = Cells(*jax.tree.map(jnp.asarray, arrays))
    np.testing.assert_allclose(squared_support(cells, jnp.asarray(vectors)), farthest**2, rtol=1e-7)


@pytest.mark.parametrize("relaxation", [HARD, Relaxation()], ids=["hard", "relaxed"])
def test_one_cell_across_the_whole_domain_and_out_of_it(relaxation: Relaxation, double: None) -> None:
    """Patches number dozens, all for one cell, which is whole; seen from single points the rest stays far."""
    cells = cells_from(colony_of([[-6.0, -3.1], [6.5, 3.3]], numerics=NUMERICS), jnp.asarray(0.9))
    g, f = np.asarray(union(cells, relaxation)), squared_radii(cells)[0] - 1.0
    assert (f <= 0).mean() > 0.9
    near = f <= float(relaxation.reach) - 1.0
    np.testing.assert_allclose(g[near], f[near], atol=1e-12)


def test_far_from_every_cell() -> None:
    cells = cells_from(colony_of(pair(1.0), numerics=NUMERICS), jnp.asarray(0.7))
    assert np.asarray(union(cells, HARD))[0, 0] == np.asarray(union(cells, Relaxation()))[0, 0] == FAR


@pytest.mark.parametrize("s", [0.4, 0.2, 0.1, 0.05, 0.025, 0.0125])
def test_relaxed_union_of_n_cells_lies_within_s_log_n_below_the_hard_one(s: float, double: None) -> None:
    cells = eqx.tree_at(lambda c: c.weights, crowd(1), jnp.ones(24))
    hard, relaxed = squared_radii(cells).min(axis=0) - 1.0, np.asarray(union(cells, Relaxation(union=s)))
    near = hard <= 0.5
    assert (relaxed - hard)[near].max() <= 1e-5  # e⁻¹² · s · n is left out at reach
    assert (relaxed - hard)[near].min() >= -s * np.log(24)
    assert (relaxed - hard)[near].min() < -0.1 * s  # and cells do meet


@pytest.mark.parametrize("s", [0.0125, 0.05])
def test_one_cell_has_the_same_colony_at_every_width_in_single_precision(s: float) -> None:
    """Down to the smallest width: the cell's centre keeps g = −1, and where it does not reach is outside."""
    cells = cells_from(colony_of(pair(1.0), numerics=NUMERICS), jnp.asarray(0.7))
    hard, relaxed = np.asarray(union(cells, HARD)), np.asarray(union(cells, Relaxation(union=s)))
    assert ((hard <= 0) == (relaxed <= 0)).all()
    assert relaxed.min() == hard.min() == -1.0


@pytest.mark.parametrize(
    ("s", "boundary"),
    [
        (0.05, 0.2),
        (None, 0.2),
        (0.02, 0.2),
        (0.05, 1.0),
        (None, 1.0),
    ],
)
def test_far_from_every_cell_the_smoothed_indicator_vanishes(s: float | None, boundary: float) -> None:
    """The background's area on the source's domain is less than a hundredth of one cell's."""
    cells = cells_from(colony_of(pair(1.0), numerics=NUMERICS), jnp.asarray(0.7))
    g = np.asarray(union(cells, Relaxation(union=s, boundary=boundary)))[0, 0]
    assert (0.5 - 0.5 * np.tanh(g / boundary)) * 40.0**2 < 0.01 * np.pi / 4 * 0.7


def test_weight_shifts_a_lone_cell_and_zero_removes_it(double: None) -> None:
    """g = f − s log w."""
    cells = cells_from(colony_of(pair(1.0), numerics=NUMERICS), jnp.asarray(0.7))
    f = squared_radii(cells)[0] - 1.0
    near, relaxation = f <= 0.5, Relaxation(union=0.05)
    for w in (1.0, 0.5, 1e-3):
        weights = jnp.asarray(np.append(w, np.asarray(cells.weights)[1:]))
        g = np.asarray(union(eqx.tree_at(lambda c: c.weights, cells, weights), relaxation))
        np.testing.assert_allclose(g[near], f[near] - 0.05 * np.log(w), atol=1e-12)
    for relaxation in (HARD, Relaxation()):
        g = np.asarray(union(eqx.tree_at(lambda c: c.weights, cells, jnp.zeros(24)), relaxation))
        assert (g == g[0, 0]).all()
        assert g[0, 0] > 0


def test_union_is_continuous_where_a_weight_vanishes(double: None) -> None:
    cells = crowd(2)
    without, with_little = (
        np.asarray(
            union(
                eqx.tree_at(lambda c: c.weights, cells, jnp.asarray(np.where(np.arange(24) == 5, w, 1.0))), Relaxation()
            )
        )
        for w in (0.0, 1e-12)
    )
    inside = without < 0.5
    assert np.abs(without - with_little)[inside].max() < 1e-6


def test_biomass_is_eaten_inside_only() -> None:
    g = jnp.array([[-1.0, -0.25], [0.0, 3.0]])
    np.testing.assert_array_equal(biomass(g, jnp.asarray(2.0)), [[2.0, 0.5], [0.0, 0.0]])


def test_derivatives_of_the_union(double: None) -> None:
    """Biomass by positions, weights and aspect ratio, forward against central differences."""
    rng = np.random.default_rng(4)
    positions = np.cumsum(rng.normal(0.0, 0.6, (6, 2)), axis=0)
    numerics = Numerics(domain=8.0, spacing=0.2, capacity=6)

    @jax.jit
    def eaten(positions: Array, weights: Array, aspect: Array) -> Array:
        cells = cells_from(colony_of(positions, None, weights, numerics=numerics), aspect)
        return jnp.sum(biomass(union(cells, Relaxation(), numerics), jnp.asarray(1.0)) ** 2)

    slope_of = jax.jit(lambda at, tangent: jax.jvp(eaten, at, tangent)[1])
    at = (positions, rng.uniform(0.2, 1.0, 6), np.asarray(0.6))
    for i, leaf in enumerate(at):
        direction = rng.normal(size=leaf.shape)
        tangent = tuple(np.asarray(direction) if j == i else np.zeros_like(other) for j, other in enumerate(at))
        slope = float(slope_of(at, tangent))
        up, down = (eaten(*(a + e * d for a, d in zip(at, tangent, strict=True))) for e in (1e-5, -1e-5))
        assert slope == pytest.approx(float(up - down) / 2e-5, rel=1e-7)
        assert abs(slope) > 1e-3


@eqx.filter_jit
def moved_node(base: Array, along: Array, relaxation: Relaxation, numerics: Numerics) -> tuple[Array, Array]:
    """g of three nodes, and its derivative along a move of the third and in the aspect ratio."""

    def g(shift: Array, aspect: Array) -> Array:
        colony = colony_of(base + jnp.zeros((3, 2)).at[2].set(shift), numerics=numerics)
        return union(cells_of(colony, aspect), relaxation, numerics)

    return jax.jvp(g, (jnp.zeros(2), jnp.asarray(0.7)), (along, jnp.asarray(1.0)))


@pytest.mark.parametrize("distance", [0.0, 1e-4, 0.01])
def test_value_and_derivative_are_finite_for_coincident_and_newborn_nodes(distance: float) -> None:
    """Also where a grid point lies on the newborn cell, and in single precision."""
    numerics = Numerics(domain=4.0, spacing=0.2, capacity=3)
    base = jnp.array([[0.5, 0.0], [-0.5, 0.0], [-0.5 + distance, 0.0]])

    for relaxation in (HARD, Relaxation()):
        for direction in ([1.0, 0.0], [0.3, -0.8]):
            value, slope = moved_node(base, jnp.array(direction), relaxation, numerics)
            assert np.isfinite(value).all()
            assert np.isfinite(slope).all()


@pytest.mark.thorough
def test_second_derivatives_are_finite_in_single_precision() -> None:
    """Also where the sum of all cells is so small that its square is 0."""
    colony = colony_of(np.array([[-0.5, 0.0], [0.5, 0.1]]), np.array([-1, 0]), np.ones(2), numerics=NUMERICS)

    def area(aspect_ratio: Array) -> Array:
        g = joined(cells_of(colony, aspect_ratio), Relaxation())
        return jnp.sum(0.5 - 0.5 * jnp.tanh(g / 0.2))

    at, h = 0.6, 1e-4
    found = [jax.jit(jax.jacfwd(of(area)))(at) for of in (jax.jacfwd, jax.jacrev)]
    with jax.enable_x64(True):
        colony = jax.tree.map(lambda leaf: leaf.astype(float) if leaf.dtype == jnp.float32 else leaf, colony)
        slope = jax.jit(jax.grad(area))
        difference = float((slope(at + h) - slope(at - h)) / (2 * h))
    assert abs(difference) > 1.0
    np.testing.assert_allclose(found, difference, rtol=3e-3)  # single precision rounds them by 1e-3
