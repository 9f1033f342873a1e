"""Closed-form checks of the plain reading in `reference.colony`, so that it can be trusted as a yardstick."""

from __future__ import annotations

import math

import numpy as np
import pytest

from reference.colony import (
    Colony,
    Floats,
    Ints,
    Numerics,
    Parameters,
    biomass,
    birth_count,
    choose_parents,
    level_set,
    nutrient_step,
    run,
    sample,
    sample_gradient,
    start,
    statistics,
    step,
    velocity,
)

SMALL = Numerics(domain=8.0, spacing=0.2)


def pair(distance: float, angle: float = 0.3) -> tuple[Floats, Ints]:
    """Two joined nodes about the origin."""
    half = np.array([0.5 * distance * math.cos(angle), 0.5 * distance * math.sin(angle)])
    return np.stack([half, -half]), np.array([-1, 0])


def fixed_angles(event: int, parents: Ints) -> Floats:
    return np.asarray(0.7 * event + 1.9 * parents, dtype=np.float64)


# --- nutrient ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("uptake", [0.0, 1.7])
def test_eigenmode_decays_by_the_crank_nicolson_factor(uptake: float) -> None:
    numerics = Numerics(domain=6.0, spacing=0.2, dt=0.05)
    parameters = Parameters(diffusivity=0.37)
    across = (numerics.grid + 3.0) / 6.0
    modes = (2, 5)
    mode = np.outer(np.sin(math.pi * modes[0] * across), np.sin(math.pi * modes[1] * across))
    b = np.full_like(mode, uptake)
    flat, _ = nutrient_step(np.ones_like(mode), b, parameters, numerics)
    bent, residual = nutrient_step(1.0 + 0.3 * mode, b, parameters, numerics)

    stencil = sum(4.0 / 0.2**2 * math.sin(math.pi * k * 0.2 / 12.0) ** 2 for k in modes)
    decay = 0.5 * 0.05 * (0.37 * stencil + uptake)
    assert residual < 1e-11
    # The difference of two solutions vanishes on the boundary, so it is the mode and nothing else.
    np.testing.assert_allclose(bent - flat, 0.3 * mode * (1.0 - decay) / (1.0 + decay), atol=1e-11)


def test_nutrient_without_uptake_stays_at_one_and_with_uptake_within_bounds() -> None:
    ones = np.ones((SMALL.size, SMALL.size))
    rested, _ = nutrient_step(ones, np.zeros_like(ones), Parameters(), SMALL)
    np.testing.assert_allclose(rested, 1.0, atol=1e-12)
    c = ones
    for _ in range(30):
        c, _ = nutrient_step(c, 3.0 * ones, Parameters(), SMALL)
    assert c[0].tolist() == c[:, -1].tolist() == [1.0] * SMALL.size
    assert 0.0 < c.min() < 0.2
    assert c.max() <= 1.0
    np.testing.assert_allclose(c, c.T, atol=1e-11)
    np.testing.assert_allclose(c, c[::-1], atol=1e-11)


def test_nutrient_steady_state_solves_the_stationary_equation() -> None:
    # An uneven b, so that a slip in the ordering of the unknowns or in the boundary's share shows.
    numerics = Numerics(domain=2.0, spacing=0.2, dt=0.5)
    parameters = Parameters(diffusivity=0.5)
    rng = np.random.default_rng(3)
    b = rng.uniform(0.0, 2.0, (numerics.size, numerics.size))
    c = np.ones_like(b)
    for _ in range(400):
        c, _ = nutrient_step(c, b, parameters, numerics)
    around = c[2:, 1:-1] + c[:-2, 1:-1] + c[1:-1, 2:] + c[1:-1, :-2]
    left = 0.5 * (around - 4.0 * c[1:-1, 1:-1]) / 0.2**2
    np.testing.assert_allclose(left, b[1:-1, 1:-1] * c[1:-1, 1:-1], atol=1e-8)


def test_sampling_is_exact_for_bilinear_fields_and_their_slopes() -> None:
    x, y = np.meshgrid(SMALL.grid, SMALL.grid, indexing="ij")
    field = 0.3 + 0.5 * x - 0.2 * y + 0.1 * x * y
    points = np.random.default_rng(1).uniform(-4.0, 4.0, (50, 2))
    points[0] = (4.0, -4.0)
    px, py = points.T
    np.testing.assert_allclose(sample(field, points, SMALL), 0.3 + 0.5 * px - 0.2 * py + 0.1 * px * py, atol=1e-13)
    slope = np.stack([0.5 + 0.1 * py, -0.2 + 0.1 * px], axis=1)
    np.testing.assert_allclose(sample_gradient(field, points, SMALL), slope, atol=1e-12)


# --- level set and statistics --------------------------------------------------------------------------------------


def test_level_set_of_a_disc() -> None:
    numerics = Numerics(domain=4.0, spacing=0.02)
    positions, parents = pair(1.0)
    g = level_set(positions + np.array([0.4, -0.3]), parents, Parameters(aspect_ratio=1.0), numerics)
    x, y = np.meshgrid(numerics.grid - 0.4, numerics.grid + 0.3, indexing="ij")
    exact = (x**2 + y**2) / 0.25 - 1.0
    seen = np.isfinite(g)
    np.testing.assert_allclose(g[seen], exact[seen], atol=1e-12)
    assert np.all(exact[~seen] > 0.0)
    assert not seen.all()
    b = biomass(g, Parameters(metabolic_rate=2.0))
    np.testing.assert_allclose(b, 2.0 * np.clip(-exact, 0.0, None), atol=1e-12)

    found = statistics(Colony(positions, parents, np.ones_like(g)), g, numerics)
    assert found["growth_rate"] == pytest.approx(1.0)
    assert found["mean_radius"] == pytest.approx(0.5)
    assert found["cell_count"] == 1
    assert found["area"] == pytest.approx(math.pi / 4, rel=0.01)
    assert found["perimeter"] == pytest.approx(math.pi, rel=0.06)
    assert found["radius"] == pytest.approx(1.0 / 3.0, rel=0.01)
    assert found["compactness"] == pytest.approx(1.0, abs=0.1)


def test_windows_hold_every_stretched_and_turned_cell() -> None:
    rng = np.random.default_rng(5)
    numerics = Numerics(domain=8.0, spacing=0.1)
    parameters = Parameters(aspect_ratio=0.4)
    positions = rng.uniform(-4.0, 4.0, (25, 2))
    positions[1] = positions[0] + [0.004, 0.003]
    parents = np.array([-1] + [int(rng.integers(k)) for k in range(1, 25)])
    parents[1] = 0
    everywhere = np.full((numerics.size, numerics.size), np.inf)
    x, y = np.meshgrid(numerics.grid, numerics.grid, indexing="ij")
    for child in range(1, 25):
        a, z = positions[child], positions[parents[child]]
        p = 0.5 * math.dist(a, z)
        theta = math.atan2(*(a - z)[::-1])
        turned = (x - (a + z)[0] / 2 + 1j * (y - (a + z)[1] / 2)) * np.exp(-1j * theta)
        everywhere = np.minimum(everywhere, (turned.real / p) ** 2 + (turned.imag / (0.4 * p)) ** 2 - 1.0)
    g = level_set(positions, parents, parameters, numerics)
    inside = everywhere <= 0.0
    assert np.array_equal(g <= 0.0, inside)
    np.testing.assert_allclose(g[inside], everywhere[inside], atol=1e-10)
    assert np.all(g >= everywhere - 1e-10 * np.abs(everywhere))


def test_perimeter_counts_holes() -> None:
    numerics = Numerics(domain=4.0, spacing=0.1)
    colony = start(numerics, 0.0)
    g = np.ones((numerics.size, numerics.size))
    g[5:26, 5:26] = -1.0
    solid = statistics(colony, g, numerics)
    g[10:15, 10:15] = 1.0
    holed = statistics(colony, g, numerics)
    assert solid["area"] == pytest.approx(441 * 0.01)
    assert solid["perimeter"] == pytest.approx(80 * 0.1)
    assert holed["area"] == pytest.approx(416 * 0.01)
    assert holed["perimeter"] > solid["perimeter"] + 1.9


def test_an_empty_image_has_no_shape() -> None:
    found = statistics(start(SMALL, 0.0), np.full((SMALL.size, SMALL.size), np.inf), SMALL, growth_rate=0.25)
    assert found["growth_rate"] == 0.25
    assert found["area"] == found["perimeter"] == 0.0
    assert math.isnan(found["compactness"])
    assert math.isnan(found["radius"])


# --- motion --------------------------------------------------------------------------------------------------------


def test_a_stretched_spring_relaxes_geometrically() -> None:
    positions, parents = pair(1.6)
    colony = Colony(positions, parents, np.ones((SMALL.size, SMALL.size)))
    parameters = Parameters(elasticity=4.0, mobility=0.0, metabolic_rate=0.0)
    for _ in range(20):
        colony, _ = step(colony, parameters, SMALL, fixed_angles)
    expected = 1.0 + 0.6 * (1.0 - 2.0 * 4.0 * SMALL.dt) ** 20
    assert math.dist(*colony.positions) == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(colony.positions.sum(axis=0), 0.0, atol=1e-12)
    assert colony.step == 20
    assert colony.births == []


def test_contact_throws_a_close_pair_apart_until_it_leaves_the_radius() -> None:
    positions, parents = pair(0.15)
    colony = Colony(positions, parents, np.ones((SMALL.size, SMALL.size)))
    parameters = Parameters(elasticity=0.0, repulsivity=3.0, repulsion_radius=0.4, mobility=0.0, metabolic_rate=0.0)
    distances = []
    for _ in range(5):
        colony, _ = step(colony, parameters, SMALL, fixed_angles)
        distances.append(math.dist(*colony.positions))
    assert distances == pytest.approx([0.27, 0.39, 0.51, 0.51, 0.51], abs=1e-12)


def test_velocity_of_a_small_tree_by_hand() -> None:
    positions = np.array([[0.0, 0.0], [1.5, 0.0], [0.0, 0.3], [0.4, 0.3]])
    parents = np.array([-1, 0, 0, 1])
    x, y = np.meshgrid(SMALL.grid, SMALL.grid, indexing="ij")
    parameters = Parameters(elasticity=2.0, repulsivity=3.0, repulsion_radius=0.45, mobility=0.5)
    found = velocity(positions, parents, 0.2 * x - 0.1 * y, parameters, SMALL)

    away = np.array([1.1, -0.3]) / math.hypot(1.1, 0.3)  # from node 3 to node 1
    far = 1.0 - math.hypot(1.1, 0.3)
    spring = np.array([[0.5, -0.7], [-0.5, 0.0], [0.0, 0.7], [0.0, 0.0]])
    spring[1] += far * away
    spring[3] -= far * away
    # Overlaps: 0 and 2 (joined, 0.3 apart), 2 and 3 (not joined, 0.4 apart); 0 and 3 are 0.5 apart.
    contact = np.array([[0.0, -1.0], [0.0, 0.0], [-1.0, 1.0], [1.0, 0.0]])
    np.testing.assert_allclose(found, 2.0 * spring + 3.0 * contact + 0.5 * np.array([0.2, -0.1]), atol=1e-12)


def test_coincident_nodes_do_not_push() -> None:
    positions, parents = np.zeros((2, 2)), np.array([-1, 0])
    ones = np.ones((SMALL.size, SMALL.size))
    assert np.array_equal(velocity(positions, parents, ones, Parameters(), SMALL), np.zeros((2, 2)))
    assert not np.isfinite(level_set(positions, parents, Parameters(), SMALL)).any()


def test_a_node_outside_the_domain_is_an_error() -> None:
    positions, parents = pair(1.0)
    colony = Colony(positions + np.array([3.9, 0.0]), parents, np.ones((SMALL.size, SMALL.size)))
    with pytest.raises(ValueError, match="node 0 left the domain"):
        step(colony, Parameters(), SMALL, fixed_angles)
    with pytest.raises(ValueError, match="left the domain"):
        sample(colony.nutrient, np.array([[math.nan, 0.0]]), SMALL)


# --- mitosis -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dt", "interval"), [(0.02, 50), (0.01, 100), (0.005, 200), (0.00125, 800), (0.03, 34)])
def test_event_interval(dt: float, interval: int) -> None:
    assert Numerics(dt=dt).event_interval == interval


def test_event_interval_of_every_whole_fraction() -> None:
    assert all(Numerics(dt=1.0 / n).event_interval == n for n in range(1, 3000))


@pytest.mark.parametrize(
    ("mu", "nodes", "capacity", "expected"),
    [
        (1.0, 2, 500, (2, False)),
        (0.5, 10, 500, (7, False)),
        (0.01, 10, 500, (1, False)),
        (0.0, 10, 500, (0, False)),
        (0.5, 10, 17, (7, False)),
        (0.5, 10, 16, (6, True)),
        (0.5, 10, 10, (0, True)),
    ],
)
def test_birth_count(mu: float, nodes: int, capacity: int, expected: tuple[int, bool]) -> None:
    assert birth_count(mu, nodes, capacity) == expected


def test_parents_come_by_nutrient_then_index() -> None:
    nutrients = np.array([0.5, 0.9, 0.5 + 1e-13, 0.7, 0.9])
    assert choose_parents(nutrients, 5).tolist() == [1, 4, 3, 0, 2]
    assert choose_parents(nutrients, 5, tie_tolerance=0.0).tolist() == [1, 4, 3, 2, 0]
    assert choose_parents(nutrients, 2).tolist() == [1, 4]
    assert choose_parents(nutrients, 0).tolist() == []


def test_events_double_the_colony_and_place_the_children() -> None:
    seen: list[tuple[int, list[int]]] = []

    def angles(event: int, parents: Ints) -> Floats:
        seen.append((event, parents.tolist()))
        return fixed_angles(event, parents)

    # Nothing is eaten and nothing moves, so mu stays 1 and the children stay where they appeared.
    parameters = Parameters(elasticity=0.0, repulsivity=0.0, mobility=0.0, metabolic_rate=0.0)
    colony = start(SMALL, 0.4)
    counts = []
    for _ in range(100):
        colony, diagnostics = step(colony, parameters, SMALL, angles)
        counts.append(len(colony.positions))
        assert diagnostics["growth_rate"] == pytest.approx(1.0, abs=1e-12)
        assert not diagnostics["capacity_reached"]
    assert counts == [2] * 49 + [4] * 50 + [8]
    assert seen == [(1, [0, 1]), (2, [0, 1, 2, 3])]
    assert [list(chosen) for chosen in colony.births] == [[0, 1], [0, 1, 2, 3]]
    assert colony.parents.tolist() == [-1, 0, 0, 1, 0, 1, 2, 3]
    for child in range(2, 8):
        parent = colony.parents[child]
        phi = 0.7 * (1 if child < 4 else 2) + 1.9 * parent
        offset = 0.01 * np.array([math.cos(phi), math.sin(phi)])
        np.testing.assert_allclose(colony.positions[child] - colony.positions[parent], offset, atol=1e-14)


def test_step_leaves_the_colony_it_was_given() -> None:
    before = start(SMALL, 0.4)
    after, _ = step(before, Parameters(), SMALL, fixed_angles)
    fresh = start(SMALL, 0.4)
    assert np.array_equal(before.positions, fresh.positions)
    assert np.array_equal(before.nutrient, fresh.nutrient)
    assert (before.step, after.step) == (0, 1)
    assert after.nutrient.min() < 1.0


def test_run_records_the_asked_times_and_reports_capacity() -> None:
    numerics = Numerics(domain=10.0, spacing=0.25, capacity=7)
    records = run(Parameters(), numerics, 3.0, np.random.default_rng(8), [2.0, 0.0, 1.0, 0.98, 3.0])
    assert [entry["step"] for entry in records] == [0, 49, 50, 100, 150]
    assert [entry["cell_count"] for entry in records] == [1, 1, 3, 6, 6]
    assert [entry["capacity_reached"] for entry in records] == [False, False, False, True, True]
    assert records[0]["growth_rate"] == 1.0
    assert 0.0 < records[-1]["growth_rate"] < records[1]["growth_rate"] < 1.0
    again = run(Parameters(), numerics, 3.0, np.random.default_rng(8), [3.0])
    np.testing.assert_equal(again, records[-1:])
    with pytest.raises(ValueError, match="sample times"):
        run(Parameters(), numerics, 1.0, np.random.default_rng(8), [1.1])
