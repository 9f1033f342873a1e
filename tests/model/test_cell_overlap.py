"""Overlap of cells: derivatives against the source's formulas (A.2), areas against closed forms and brute force."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.integrate import quad

from yeastfit.measure.statistics.registry import recorded
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.cell_overlap import MOST, intersection, overlap_area, smooth_area, smooth_step
from yeastfit.model.cells import Cells, cells_of
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.snapshot import Snapshot

Real = Array | np.ndarray
SIDE = np.linspace(-2.6, 2.6, 53)
WIDTHS = [(0.3, 0.5), (0.1, 0.2)]  # k and K
CROWDED = 2 * MOST + 16  # slots: if all have a cell in the same place, there is no room for their pairs


# The source's formulas in plain NumPy; the state of a cell is q = (x, y, θ, b, R)


def ellipse(q: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f = U²/b² + V²/(Rb)² − 1, its Jacobian [5, ...] and its Hessian [5, 5, ...] in q, by hand."""
    c, s, b, ratio = np.cos(q[2]), np.sin(q[2]), q[3], q[4]
    u, v = c * (x - q[0]) + s * (y - q[1]), c * (y - q[1]) - s * (x - q[0])
    one, zero = np.ones_like(u), np.zeros_like(u)
    du, dv = [-c * one, -s * one, v], [s * one, -c * one, -u]
    ddu = [[zero, zero, s * one], [zero, zero, -c * one], [s * one, -c * one, -u]]
    ddv = [[zero, zero, c * one], [zero, zero, s * one], [c * one, s * one, -v]]
    p, r = b**-2, (ratio * b) ** -2
    jacobian, hessian = np.zeros((5, *u.shape)), np.zeros((5, 5, *u.shape))
    for i in range(3):
        jacobian[i] = 2 * p * u * du[i] + 2 * r * v * dv[i]
        hessian[i, 3] = hessian[3, i] = -2 / b * jacobian[i]
        hessian[i, 4] = hessian[4, i] = -2 / ratio * 2 * r * v * dv[i]
        for j in range(3):
            hessian[i, j] = 2 * p * (du[i] * du[j] + u * ddu[i][j]) + 2 * r * (dv[i] * dv[j] + v * ddv[i][j])
    f = p * u**2 + r * v**2 - 1
    jacobian[3], jacobian[4] = -2 / b * (f + 1), -2 / ratio * r * v**2
    hessian[3, 3], hessian[4, 4] = 6 / b**2 * (f + 1), 6 / ratio**2 * r * v**2
    hessian[3, 4] = hessian[4, 3] = 4 / (b * ratio) * r * v**2
    return f, jacobian, hessian


def formulas(
    q: np.ndarray, k: float, width: float, side: np.ndarray = SIDE
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """C (8), its Jacobian (9, 10), its Hessian (12) corrected and as printed, on the grid of these coordinates."""
    x, y = np.meshgrid(side, side, indexing="ij")
    element = float(side[1] - side[0]) ** 2
    f, jacobians, hessians = zip(*(ellipse(cell, x, y) for cell in q), strict=True)
    f, size = np.array(f), 5 * len(q)
    top = f.max(axis=0)
    shares = np.exp((f - top) / k)
    union = top + k * np.log(shares.sum(axis=0))
    shares /= shares.sum(axis=0)  # E_j / Σ E_j
    slope = np.concatenate([share * jacobian for share, jacobian in zip(shares, jacobians, strict=True)])
    bend = -slope[:, None] * slope[None, :] / k
    for j, (share, jacobian, hessian) in enumerate(zip(shares, jacobians, hessians, strict=True)):
        own = slice(5 * j, 5 * j + 5)
        bend[own, own] += share * (hessian + jacobian[:, None] * jacobian[None, :] / k)
    t = np.tanh(-union / width)
    fall, product = 1 - t**2, slope[:, None] * slope[None, :]
    assert bend.shape == (size, size, *x.shape)
    return (
        float((0.5 + 0.5 * t).sum() * element),
        -1 / (2 * width) * (fall * slope).sum(axis=(1, 2)) * element,
        -1 / (2 * width**2) * (fall * (2 * t * product + width * bend)).sum(axis=(2, 3)) * element,
        -1 / (4 * width**2) * (fall * (t * product + width * bend)).sum(axis=(2, 3)) * element,
    )


def states(cells: int, seed: int) -> np.ndarray:
    """So many cells that overlap around the origin."""
    rng = np.random.default_rng(seed)
    low, high = [-0.4, -0.4, 0.0, 0.6, 0.4], [0.4, 0.4, np.pi, 1.1, 1.0]
    return rng.uniform(low, high, (cells, 5))


def cells_at(q: Real) -> Cells:
    """Cells of full weight from their states."""
    x, y, angle, length, ratio = jnp.asarray(q).T
    directions = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    return Cells(jnp.stack([x, y], axis=-1), directions, length, ratio * length, jnp.ones_like(x))


def common(q: Real, k: Array | float, width: Array | float, side: np.ndarray = SIDE) -> Array:
    """C of the smooth maximum of all cells, on the grid with these coordinates either way."""
    x, y = jnp.meshgrid(jnp.asarray(side), jnp.asarray(side), indexing="ij")
    return smooth_area(intersection(cells_at(q.reshape(-1, 5)), k, x, y), width, (side[1] - side[0]) ** 2)


@jax.jit
def derivatives(q: Real, k: Array | float, width: Array | float) -> tuple[Array, Array, Array]:
    """JAX's own, forwards, in reverse, and twice."""

    def slope(q: Array) -> tuple[Array, Array]:
        found = jax.jacrev(common)(q, k, width)
        return found, found

    second, reverse = jax.jacfwd(slope, has_aux=True)(q)
    return jax.jacfwd(common)(q, k, width), reverse, second


def pairwise(q: Real, weights: Real, k: Array | float | None, width: Array | float | None) -> Array:
    """The statistic."""
    return overlap_area(eqx.tree_at(lambda c: c.weights, cells_at(q.reshape(-1, 5)), weights), k, width)


area_of = jax.jit(pairwise)
slopes_of = jax.jit(jax.value_and_grad(pairwise, argnums=(0, 1, 2, 3)))


@jax.jit
def bend_of(q: Real, move: Real, k: Array | float, width: Array | float) -> Array:
    """The pairwise statistic's Hessian in q times a direction; full weights."""
    return jax.jvp(jax.grad(lambda q: pairwise(q, jnp.ones(2), k, width)), (q,), (move,))[1]


def among_empty(q: ArrayLike, slots: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """States and weights of these cells and of slots without one; so many for all tests, and they compile once."""
    q = np.asarray(q)
    empty = np.tile([0.3, 0.1, 0.0, 1e-3, 0.5], slots - len(q))
    return np.concatenate([q.ravel(), empty]), 1.0 * (np.arange(slots) < len(q))


def differences(function, q: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Central differences by each entry of q, stacked along the last axis."""
    moves = step * np.eye(q.size)
    return np.stack([(np.asarray(function(q + d)) - np.asarray(function(q - d))) / (2 * step) for d in moves], axis=-1)


def assert_same(found: Real, expected: np.ndarray, tolerance: float) -> None:
    """Relative to the largest entry."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.thorough
@pytest.mark.parametrize("cells", [2, 4])
def test_derivatives_are_the_formulas(cells: int, double: None) -> None:
    """Equations 8, 9, 10 and, corrected, 12; all configurations do overlap."""
    for seed, (k, width) in [(seed, widths) for seed in range(3) for widths in WIDTHS]:
        q = states(cells, seed)
        area, jacobian, hessian, _ = formulas(q, k, width)
        assert area > 0.03
        assert float(common(q.ravel(), k, width)) == pytest.approx(area, rel=1e-12)
        forward, reverse, second = derivatives(q.ravel(), k, width)
        assert_same(forward, jacobian, 1e-8)
        assert_same(reverse, jacobian, 1e-8)
        assert_same(second, hessian, 1e-8)


@pytest.mark.parametrize("cells", [2, 3])
def test_equation_12_as_printed_is_not_the_hessian(cells: int) -> None:
    """Finite differences, without JAX, confirm 9 and the corrected 12; the printed one is off whatever its factor."""
    for seed, (k, width) in enumerate(WIDTHS[: 4 - cells]):
        q = states(cells, seed)
        _, jacobian, hessian, printed = formulas(q, k, width)
        assert_same(jacobian, differences(lambda p, k=k, w=width: formulas(p.reshape(-1, 5), k, w)[0], q.ravel()), 1e-7)
        slopes = differences(lambda p, k=k, w=width: formulas(p.reshape(-1, 5), k, w)[1], q.ravel())
        assert_same(hessian, slopes, 1e-7)
        best = (printed * slopes).sum() / (printed**2).sum()
        for factor in (1.0, 2.0, best):
            assert np.abs(factor * printed - slopes).max() > 0.3 * np.abs(slopes).max()


@pytest.mark.thorough
def test_the_pairwise_statistic_has_the_formulas_derivatives(double: None) -> None:
    """Of two cells it is C on a grid of its own; both grids resolve these widths. Empty slots change nothing."""
    k, width = WIDTHS[0]
    for seed in range(3):
        area, jacobian, hessian, _ = formulas(states(2, seed), k, width, np.linspace(-2.6, 2.6, 105))
        found, slopes = slopes_of(*among_empty(states(2, seed)), k, width)
        assert float(found) == pytest.approx(area, rel=1e-4)
        assert_same(slopes[0][:10], jacobian, 1e-3)
        np.testing.assert_array_equal(slopes[0][10:], 0.0)
        for move in np.eye(10):
            bend = hessian @ move
            np.testing.assert_allclose(bend_of(states(2, seed).ravel(), move, k, width), bend, 0, 0.01 * hessian.max())


@pytest.mark.parametrize("second", [[0.1, 0.2, 0.3, 0.6, 0.7], [0.1, 0.2, 0.0, 0.005, 0.6], [9.0, 0.0, 0.0, 1e-3, 0.6]])
def test_second_derivatives_are_finite(second: list[float], double: None) -> None:
    """By a cell in the same place, a newborn one in it, and one that is far away."""
    q = np.array([[0.1, 0.2, 0.3, 0.6, 0.7], second])
    bend = np.array([bend_of(q.ravel(), move, 0.025, 0.2) for move in np.eye(10)])
    assert np.isfinite(bend).all()
    assert (np.abs(bend).max() > 0.1) == (second[0] < 1.0)


def test_derivatives_against_differences(double: None) -> None:
    """By cells, weights and widths, up to what moving the grid changes."""
    q, weights = states(5, 7).ravel(), np.linspace(0.2, 1.0, 5)
    empty_q, empty_weights = (part[n:] for part, n in zip(among_empty(states(5, 7)), (25, 5), strict=True))

    def split(values: np.ndarray) -> tuple:
        return np.append(values[:25], empty_q), np.append(values[25:30], empty_weights), *values[30:].tolist()

    values = np.concatenate([q, weights, WIDTHS[0]])
    area, slopes = slopes_of(*split(values))
    slope = np.concatenate([slopes[0][:25], slopes[1][:5], slopes[2:]])
    assert_same(slope, differences(lambda v: area_of(*split(v)), values, 1e-3), 2e-3)
    assert float(slopes[1][:5] @ weights) == pytest.approx(2 * float(area), rel=1e-12)


def test_batches_and_forward_derivatives(double: None) -> None:
    """Each colony of a batch has its own value, and forwards the derivative that it has alone and in reverse."""
    q, weights = map(np.stack, zip(*(among_empty(states(3 + seed, seed)) for seed in range(3)), strict=True))
    rng = np.random.default_rng(0)
    moves = rng.normal(size=q.shape), rng.normal(size=weights.shape)

    @jax.jit
    @jax.vmap
    def forward(q: Array, weights: Array, *moves: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda q, weights: pairwise(q, weights, 0.1, 0.2), (q, weights), moves)

    for i, (value, along) in enumerate(zip(*forward(q, weights, *moves), strict=True)):
        expected, slopes = slopes_of(q[i], weights[i], 0.1, 0.2)
        assert float(value) == pytest.approx(float(expected), rel=1e-12)
        assert float(along) == pytest.approx(float(slopes[0] @ moves[0][i] + slopes[1] @ moves[1][i]), rel=1e-12)


def lens(radius: float, distance: float) -> float:
    """Area that two discs share."""
    half = distance / 2
    return 2 * radius**2 * np.arccos(half / radius) - 2 * half * np.sqrt(radius**2 - half**2)


def two_discs(distance: float, radius: float = 0.8) -> np.ndarray:
    """Off the axes and off the origin."""
    half = 0.5 * distance * np.array([np.cos(0.4), np.sin(0.4)])
    return np.array([[*(sign * half + [0.1, -0.2]), 1.1, radius, 1.0] for sign in (1, -1)])


finely = jax.jit(partial(common, side=np.linspace(-1.6, 1.6, 401)))


@pytest.mark.parametrize("distance", [0.3, 0.8, 1.3])
def test_narrow_widths_give_the_lens_of_two_discs(distance: float, double: None) -> None:
    """With the square of the widths: a fourth for half of them, or less. A pair's own grid misses the narrowest."""
    q, exact = two_discs(distance), lens(0.8, distance)
    errors = [float(finely(q.ravel(), k, k)) / exact - 1 for k in (0.16, 0.08, 0.04)]
    assert (np.divide(errors[:-1], errors[1:]) > 3.5).all()
    assert abs(errors[-1]) < 2e-3
    assert float(area_of(*among_empty(q), 0.04, 0.04)) == pytest.approx(exact, rel=0.02)
    assert float(area_of(*among_empty(q), None, None)) == pytest.approx(exact, rel=0.03)


@pytest.mark.parametrize(("k", "width"), [(0.025, 0.2), (0.3, 0.3), (0.0125, 0.1)])
def test_identical_cells_share_the_cell(k: float, width: float, double: None) -> None:
    """f = f_1 + k log 2, so C = πpq ∫ ½ − ½ tanh((t + k log 2)/K) dt from −1 on; three cells share it three times."""
    q = np.tile([3.0, -1.0, 0.7, 0.6, 0.5], (3, 1))
    own = np.pi * 0.6**2 * 0.5
    exact = own * width / 2 * np.log1p(np.exp(2 * (1 - k * np.log(2)) / width))
    two = float(area_of(*among_empty(q[:2]), k, width))
    assert two == pytest.approx(exact, rel=2e-4 if width > 0.1 else 2e-3)
    assert float(area_of(*among_empty(q), k, width)) == pytest.approx(3 * two)
    assert float(area_of(*among_empty(q[:2]), None, None)) == pytest.approx(own, rel=0.01)


@pytest.mark.parametrize("cells", [0, 1, 3])
def test_cells_apart_share_nothing(cells: int, double: None) -> None:
    q = np.array([[0.0, 0.0, 0.0, 0.5, 0.6], [5.0, 1.0, 0.3, 0.6, 0.6], [-1.5, 0.2, 1.0, 0.4, 0.6]])[:cells]
    value, slopes = slopes_of(*among_empty(q), 0.025, 0.2)
    assert float(value) == 0.0
    assert all((np.asarray(slope) == 0.0).all() for slope in slopes)


def crowd(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """States and weights of 15 cells of all sizes, many of which overlap, one of weight 0."""
    rng = np.random.default_rng(seed)
    q = rng.uniform([-1.5, -1.5, 0.0, 0.2, 0.4], [1.5, 1.5, 2 * np.pi, 0.9, 1.0], (15, 5))
    weights = rng.uniform(0.1, 1.0, 15)
    weights[7] = 0.0
    return q, weights


def all_pairs(q: np.ndarray, weights: np.ndarray, k: float | None, width: float | None, side: np.ndarray) -> float:
    """Σ_{i<j} w_i w_j C_ij on one grid for all."""
    x, y = np.meshgrid(side, side, indexing="ij")
    f, total = [ellipse(cell, x, y)[0] for cell in q], 0.0
    for i in range(len(q)):
        for j in range(i):
            if np.hypot(*(q[i, :2] - q[j, :2])) < 2.0 * (q[i, 3] + q[j, 3]):
                both = np.maximum(f[i], f[j]) if k is None else k * np.logaddexp(f[i] / k, f[j] / k)
                phi = both <= 0 if width is None else 0.5 - 0.5 * np.tanh(both / width)
                total += weights[i] * weights[j] * phi.sum() * (side[1] - side[0]) ** 2
    return total


@pytest.mark.parametrize(("k", "width"), [(0.025, 0.2), (0.1, 0.4), (None, None)], ids=str)
def test_a_crowd_against_all_pairs_on_one_fine_grid(k: float | None, width: float | None, double: None) -> None:
    q, weights = crowd(3)
    total = all_pairs(q, weights, k, width, np.linspace(-3.0, 3.0, 301))
    assert total > 1.0
    assert float(area_of(q.ravel(), weights, k, width)) == pytest.approx(total, rel=0.01 if width is None else 1e-4)


@pytest.mark.thorough
def test_no_pair_of_a_wide_colony_is_missed() -> None:
    """Many cells apart, in many bins, in single precision."""
    rng = np.random.default_rng(8)
    q = rng.uniform([-3, -3, 0, 0.2, 0.5], [3, 3, np.pi, 0.4, 0.9], (CROWDED, 5)) + np.array([5, -9, 0, 0, 0])
    weights = rng.uniform(0.5, 1.0, CROWDED)
    total = all_pairs(q - np.array([5, -9, 0, 0, 0]), weights, 0.1, 0.2, np.linspace(-3.6, 3.6, 181))
    assert total > 1.0
    assert float(slopes_of(q.ravel(), weights, 0.1, 0.2)[0]) == pytest.approx(total, rel=1e-3)


def test_superellipses_that_touch_with_their_corners_meet(double: None) -> None:
    """Farther apart than two long halves, in the place where a grid of such bins would part them."""
    turn = np.full(2, np.sqrt(0.5))
    centres, directions = np.array([[-0.1, 0.3], [1.15, 0.3]]), np.stack([turn, turn])
    half, weights, exponents = np.full(2, 0.5), np.ones(2), np.full(2, 8.0)
    cells = Cells(*map(jnp.asarray, (centres, directions, half, half, weights, exponents)))
    x, y = np.meshgrid(np.linspace(0.4, 0.7, 601), np.linspace(0.1, 0.5, 801), indexing="ij")
    inside = np.ones_like(x, bool)
    for centre in centres:
        u, v = (x + y - centre.sum()) / np.sqrt(2), (y - x + centre[0] - centre[1]) / np.sqrt(2)
        inside &= (np.abs(u) ** 8 + np.abs(v) ** 8) ** 0.25 <= 0.25
    assert inside.sum() > 500
    found = float(overlap_area(cells, 0.002, 0.004))
    assert found == pytest.approx(inside.sum() * 0.0005**2, rel=0.05)


def test_place_turn_and_order_do_not_matter(double: None) -> None:
    """What does is the weight, of two cells each time."""
    q, weights = crowd(5)
    here = float(area_of(q.ravel(), weights, 0.025, 0.2))
    moved, order = q.copy(), np.random.default_rng(0).permutation(15)
    place = (q[:, 0] + 1j * q[:, 1]) * np.exp(0.7j) + 11 - 3j
    moved[:, :3] = np.stack([place.real, place.imag, q[:, 2] + 0.7], axis=-1)
    for other in (moved, q + np.array([0, 0, np.pi, 0, 0])):
        assert float(area_of(other.ravel(), weights, 0.025, 0.2)) == pytest.approx(here, rel=1e-12)
    assert float(area_of(q[order].ravel(), weights[order], 0.025, 0.2)) == pytest.approx(here, rel=1e-12)
    assert float(area_of(q.ravel(), 0.5 * weights, 0.025, 0.2)) == pytest.approx(0.25 * here)


@pytest.mark.parametrize("far", [0.0, 15.0])
def test_a_newborn_cell_lies_in_its_parent(far: float) -> None:
    """In single precision, anywhere. f of the parent is −1 there, so C = πpq ∫ φ(k log(exp(t/k) + exp(−1/k))) dt."""
    k, width, small, ratio = 0.5, 0.2, 0.005, 0.6
    q = np.array([[far, -far, 0.3, 0.6, ratio], [far, -far, 1.9, small, ratio]])
    step = lambda t: 0.5 - 0.5 * np.tanh(k * np.logaddexp(t / k, -1 / k) / width)  # noqa: E731
    exact = np.pi * small**2 * ratio * quad(step, -1, 4, epsabs=1e-12)[0]
    value, (slope, *_) = slopes_of(*among_empty(q, CROWDED), k, width)
    assert value.dtype == jnp.float32
    assert float(value) == pytest.approx(exact, rel=1e-3)
    assert float(slope[8]) == pytest.approx(2 * exact / small, rel=2e-3)


def test_derivatives_are_finite_in_every_slot() -> None:
    """By nodes: newborn cells, coincident nodes, coincident cells and empty slots, in single precision."""
    numerics = Numerics(domain=4.0, spacing=0.2, capacity=12)

    def area(positions: Array, aspect: Array, weights: Array) -> Array:
        colony = colony_of(positions, [-1, 0, 1, 1, 0, 0, 1], weights, numerics=numerics)
        return overlap_area(cells_of(colony, aspect), 0.025, 0.2)

    nodes = jnp.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.01], [1.0, 0.0], [1.0, 0.0], [0.3, 0.8], [20.0, 20.0]])
    value, slopes = jax.jit(jax.value_and_grad(area, argnums=(0, 1, 2)))(nodes, jnp.asarray(0.6), jnp.ones(7))
    assert 0.2 < float(value) < 2.0
    for slope in slopes:
        assert np.isfinite(slope).all()
        assert float(np.abs(slope).max()) > 0.1


def test_more_pairs_than_there_is_room_for_are_not_left_out_silently() -> None:
    """So many cells in one place that all slots but ten are too few for their pairs, or just enough."""
    cell = np.array([0.0, 0.0, 0.0, 0.5, 0.5])
    one, few, many = (
        slopes_of(*among_empty(np.tile(cell, (cells, 1)), CROWDED), 0.3, 0.3) for cells in (2, CROWDED - 10, CROWDED)
    )
    pairs = (CROWDED - 10) * (CROWDED - 11) // 2
    assert pairs <= MOST * CROWDED < CROWDED * (CROWDED - 1) // 2
    assert float(few[0]) == pytest.approx(pairs * float(one[0]), rel=1e-4)
    assert all(np.isfinite(slope).all() for slope in few[1])
    assert np.isnan(many[0])
    assert np.isnan(many[1][1]).all()


def test_the_step_is_hard_without_a_width(double: None) -> None:
    f = jnp.array([-1.0, 0.0, 0.5])
    np.testing.assert_array_equal(smooth_step(f, None), [1.0, 1.0, 0.0])
    np.testing.assert_allclose(smooth_step(f, 0.5), 1 / (1 + np.exp(2 * f / 0.5)))


def test_the_statistic() -> None:
    """It is there when asked for, beside the others, and has the relaxation's widths."""
    colony = colony_of([[0.0, 0.0], [1.0, 0.0], [0.5, 0.6]], numerics=Numerics(domain=4.0, spacing=0.2, capacity=6))
    parameters, relaxation = Parameters(aspect_ratio=0.6), Relaxation(union=0.1, boundary=0.3)
    cells = cells_of(colony, parameters.aspect_ratio)
    snapshot = Snapshot(cells, jnp.asarray(0.5), colony, parameters, relaxation)
    found = eqx.filter_jit(SmoothStatistics(4.0, 0.4, statistics=(*recorded("smooth"), "overlap_area")))(snapshot)
    assert {"overlap_area", "area", "cell_count"} < set(found)
    q = np.array([[0.5, 0.0, 0.0, 0.5, 0.6], [0.75, 0.3, np.arctan2(0.6, -0.5), 0.5 * np.hypot(0.6, 0.5), 0.6]])
    expected = formulas(q, 0.1, 0.3, np.linspace(-1.0, 2.0, 201))[0]
    assert float(found["overlap_area"]) == pytest.approx(expected, rel=1e-3)
