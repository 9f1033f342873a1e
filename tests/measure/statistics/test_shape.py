"""Hard statistics against closed forms and symmetries."""

from collections.abc import Mapping
from math import pi

import numpy as np
import pytest
from helpers import colony_of, pair
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt
from scipy.spatial import ConvexHull, Delaunay
from scipy.special import ellipe
from shapes import disc, masks, star, star_radius
from skimage.measure import perimeter as chain_perimeter
from skimage.measure import perimeter_crofton

from yeastfit.errors import InputError
from yeastfit.measure.statistics import shape as shapes_of_masks
from yeastfit.measure.statistics.filaments import SKELETON
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import HardStatistics, mask_of
from yeastfit.measure.statistics.registry import STATISTICS, names_with, recorded
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD

CENTROID = ("centroid_x", "centroid_y")
NOT_NEGATIVE = (
    *("csr_radius", "branch_count", "branch_length", "filament_width"),
    *("radial_index", "angular_index", "wave_number"),
)


def ellipse(major, ratio=1.0, angle=0.0, offset=(0.0, 0.0), side=None):
    side = side or 2 * int(major) + 9
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    x, y = x - offset[0], y - offset[1]
    u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    return (u / major) ** 2 + (v / (ratio * major)) ** 2 <= 1


def bias_of_perimeter(major, ratio, estimator, count=40):
    rng = np.random.default_rng(0)
    exact = 4 * major * ellipe(1 - ratio**2)
    masks = (ellipse(major, ratio, rng.uniform(0, pi), rng.uniform(-0.5, 0.5, 2)) for _ in range(count))
    return np.mean([estimator(mask) / exact - 1 for mask in masks])


@pytest.mark.parametrize("radius", [5, 15, 60])
def test_disc(radius):
    """One disc off the lattice's symmetries: the boundary pixels decide, so relative errors fall as 1 / R."""
    shape = measure_mask(ellipse(radius, offset=(0.2, 0.3), side=2 * radius + 21))
    tolerance = 0.3 / radius
    assert shape.area == pytest.approx(pi * radius**2, rel=tolerance)
    assert shape.perimeter == pytest.approx(2 * pi * radius, rel=tolerance)
    assert shape.compactness == pytest.approx(1, abs=2 * tolerance)
    assert shape.radius == pytest.approx(2 / 3 * radius, rel=tolerance)
    assert shape.max_radius == pytest.approx(radius, abs=1)
    assert shape.inscribed_radius == pytest.approx(radius, abs=1)
    assert shape.outer_perimeter == shape.perimeter
    assert shape.outer_compactness == shape.compactness
    assert (shape.object_count, shape.hole_count) == (1, 0)
    assert shape.centroid == pytest.approx((radius + 10.2, radius + 10.3), abs=0.1)


@pytest.mark.parametrize("ratio", [1.0, 0.7, 0.4])
@pytest.mark.parametrize("major", [5, 15, 60])
def test_perimeter_is_the_less_biased_estimator(major, ratio):
    """The table in the module: means over 40 shapes; their standard error is 0.5 % at 5 px and below 0.2 % beyond."""
    crofton = bias_of_perimeter(major, ratio, lambda mask: measure_mask(mask).perimeter)
    chain = bias_of_perimeter(major, ratio, chain_perimeter)
    assert abs(crofton) < (0.015 if major == 5 else 0.005)
    assert abs(crofton) < abs(chain)


@settings(max_examples=60, deadline=None)
@given(masks)
def test_perimeter_is_scikit_images(mask):
    expected = perimeter_crofton(np.pad(mask, 1), directions=4)
    assert measure_mask(mask).perimeter == pytest.approx(expected, rel=1e-12)


def test_straight_edges_are_the_worst_case():
    """The stated bounds: -5.2 % along an axis, where four directions see cos 0 + √2 cos 45° + cos 90° instead of 2."""
    square = measure_mask(np.ones((400, 400), dtype=bool))
    assert square.perimeter == pytest.approx(1600 * (1 - 0.052), rel=0.003)


def test_annulus_counts_its_hole():
    outer, inner = ellipse(40, offset=(0.2, 0.3), side=101), ellipse(20, offset=(0.2, 0.3), side=101)
    shape = measure_mask(outer & ~inner)
    assert shape.area == outer.sum() - inner.sum()
    assert shape.perimeter == pytest.approx(2 * pi * 60, rel=0.01)
    assert shape.outer_perimeter == pytest.approx(2 * pi * 40, rel=0.01)
    assert shape.outer_compactness == pytest.approx(1, abs=0.02)
    assert shape.compactness == pytest.approx(60**2 / (40**2 - 20**2), rel=0.02)
    assert (shape.object_count, shape.hole_count) == (1, 1)


def test_the_largest_circle_inside_ends_at_holes_and_at_the_narrowest_side():
    outer, inner = ellipse(90, offset=(0.2, 0.3), side=201), ellipse(20, offset=(0.2, 0.3), side=201)
    assert measure_mask(outer & ~inner).inscribed_radius == pytest.approx(35, abs=1)
    assert measure_mask(ellipse(90, 0.4, 0.3)).inscribed_radius == pytest.approx(36, abs=1)
    assert measure_mask(ellipse(90, 0.4, 0.3), 1.5).inscribed_radius == pytest.approx(54, abs=1.5)
    assert measure_mask(np.ones((41, 300))).inscribed_radius == 20.5
    assert measure_mask(np.ones((40, 300))).inscribed_radius == 19.5  # half a pixel less where no pixel is the middle
    assert measure_mask(np.ones((1, 300))).inscribed_radius == 0.5


@pytest.mark.parametrize("lattice", [2, 16])
@settings(max_examples=60, deadline=None)
@given(mask=masks, grown=st.integers(1, 7))
def test_the_largest_circle_inside_is_that_of_all_pixels(lattice, mask, grown):
    """By the distance transform of the whole mask, of colonies thinner than the lattice and thicker ones."""
    mask = np.kron(mask, np.ones((grown, grown), dtype=bool))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shapes_of_masks, "_LATTICE", lattice)
        found = measure_mask(mask, statistics=("inscribed_radius",)).inscribed_radius
    assert found == distance_transform_edt(np.pad(mask, 1)).max() - 0.5


def test_the_largest_circle_inside_a_filamentous_colony():
    mask = star(150, 0.35, 12)
    mask[200:206, 170:175] = False
    for one in (mask, mask[3:, 5:], np.rot90(mask)):
        found = measure_mask(one, statistics=("inscribed_radius",)).inscribed_radius
        assert found == distance_transform_edt(np.pad(mask, 1)).max() - 0.5


def test_objects_are_eight_connected_and_holes_four_connected():
    diagonal_ring = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], dtype=bool)
    shape = measure_mask(diagonal_ring)
    assert (shape.object_count, shape.hole_count) == (1, 1)
    apart = np.zeros((9, 9), dtype=bool)
    apart[1:3, 1:3] = apart[5:8, 5:8] = True
    assert measure_mask(apart).object_count == 2


def test_one_pixel():
    shape = measure_mask(np.ones((1, 1), dtype=bool), 2.0)
    assert (shape.area, shape.radius, shape.max_radius, shape.centroid) == (4.0, 0.0, 0.0, (0.0, 0.0))
    assert shape.perimeter > 0


def test_the_border_of_the_array_is_boundary():
    mask = np.ones((20, 30), dtype=bool)
    np.testing.assert_equal(dict(measure_mask(mask)), dict(measure_mask(mask.astype(np.uint8) * 255)))
    padded = measure_mask(np.pad(mask, 4))
    assert measure_mask(mask).perimeter == pytest.approx(padded.perimeter)


def assert_same(one: Mapping[str, float], other: Mapping[str, float], scale: float = 1.0) -> None:
    """Equal up to rounding: every statistic is a sum of the same terms in another order."""
    expected = {name: value * scale ** STATISTICS[name].unit_power for name, value in one.items()}
    assert {n: v for n, v in other.items() if n not in CENTROID} == pytest.approx(
        {n: v for n, v in expected.items() if n not in CENTROID}, rel=1e-9, abs=1e-9 * scale, nan_ok=True
    )


@settings(max_examples=120, deadline=None)
@given(masks, st.integers(0, 3), st.booleans())
def test_rotation_by_quarter_turns_and_reflection(mask, turns, mirrored):
    """All statistics, those of the skeleton too, though thinning itself depends on orientation."""
    turned = np.rot90(mask[:, ::-1] if mirrored else mask, turns)
    assert_same(measure_mask(mask), measure_mask(turned))


@settings(max_examples=60, deadline=None)
@given(masks, st.integers(0, 5), st.integers(0, 5))
def test_translation_moves_the_centroid_only(mask, down, right):
    one, other = measure_mask(mask), measure_mask(np.pad(mask, ((down, 1), (right, 2))))
    assert_same(one, other)
    assert other.centroid == pytest.approx((one.centroid[0] + right, one.centroid[1] + down))


@settings(max_examples=60, deadline=None)
@given(masks, st.floats(1e-3, 1e3))
def test_scaling_with_the_pixel_size(mask, pixel_size):
    one, other = measure_mask(mask), measure_mask(mask, pixel_size)
    assert_same(one, other, pixel_size)
    assert other.centroid == pytest.approx([each * pixel_size for each in one.centroid])


@settings(max_examples=60, deadline=None)
@given(masks)
def test_bounds(mask):
    row = measure_mask(mask)
    assert 0 < row["solidity"] <= 1 + 1e-12
    assert row["radius"] <= row["max_radius"]
    assert row["filament_area"] < row["area"]
    assert row["object_count"] >= 1
    assert all(np.isnan(row[name]) or row[name] >= 0 for name in NOT_NEGATIVE)
    assert np.isnan(row["angular_index"]) or row["angular_index"] <= 1 + 1e-12
    assert np.isnan(row["wave_number"]) or 1 <= row["wave_number"] <= pi * row["csr_radius"] / 4
    assert np.isnan(row["filament_area_index"]) or row["filament_area_index"] * 0.65 <= 1 + 1e-12
    assert np.isnan(row["fractal_dimension"]) or 0 <= row["fractal_dimension"] <= 2


STARS = [(150, 0.3, 8), (150, 0.35, 12), (200, 0.2, 20)]


@pytest.mark.parametrize(("radius", "amplitude", "arms"), STARS)
def test_star(radius, amplitude, arms):
    """Closed forms and quadrature of r = R (1 + a cos mθ), to a pixel of the radius or the estimator's 0.5 %."""
    angle = np.linspace(0, 2 * pi, 20_001)[:-1]
    r = star_radius(angle, radius, amplitude, arms)
    slope = -radius * amplitude * arms * np.sin(arms * angle)
    area, length = pi * radius**2 * (1 + amplitude**2 / 2), float(np.hypot(r, slope).mean() * 2 * pi)
    shape = measure_mask(star(radius, amplitude, arms))
    assert shape.area == pytest.approx(area, rel=0.002)
    assert shape.perimeter == pytest.approx(length, rel=0.01)
    assert shape.compactness == pytest.approx(length**2 / (4 * pi * area), rel=0.02)
    assert shape.radius == pytest.approx(float((r**3).mean() * 2 * pi / 3 / area), rel=0.002)
    assert shape.max_radius == pytest.approx(radius * (1 + amplitude), abs=1)
    hull = ConvexHull(np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)).volume
    assert shape.solidity == pytest.approx(area / hull, rel=0.01)
    assert (shape.object_count, shape.hole_count) == (1, 0)
    assert shape.wave_number == arms
    assert shape.branch_count == arms / 4


@pytest.mark.parametrize("factor", [2, 3])
def test_the_same_shape_in_finer_pixels(factor):
    """To what pixels and rings of 4 of them leave open: r_CSR to a ring, most else to 1 or 2 %."""
    coarse = measure_mask(star(150, 0.35, 12))
    fine = measure_mask(star(150 * factor, 0.35, 12), 1 / factor)
    assert (fine.object_count, fine.hole_count) == (coarse.object_count, coarse.hole_count)
    assert (fine.wave_number, fine.branch_count) == (coarse.wave_number, coarse.branch_count)
    assert fine.csr_radius == pytest.approx(coarse.csr_radius, abs=4)
    assert fine.filament_area_index == pytest.approx(coarse.filament_area_index, rel=0.1)
    assert fine.filament_radius_index == pytest.approx(coarse.filament_radius_index, abs=0.03)
    assert fine.branch_length == pytest.approx(coarse.branch_length, rel=0.06)
    assert fine.filament_width == pytest.approx(coarse.filament_width, abs=1.5)
    assert fine.area == pytest.approx(coarse.area, rel=0.002)
    for name in ("radius", "max_radius", "inscribed_radius", "perimeter_radius", "perimeter", "solidity"):
        assert getattr(fine, name) == pytest.approx(getattr(coarse, name), rel=0.01)
    for name in ("filament_area", "angular_index", "radial_index", "compactness"):
        assert getattr(fine, name) == pytest.approx(getattr(coarse, name), rel=0.02)


@pytest.mark.parametrize("factor", [2, 3])
def test_every_pixel_as_a_block_of_pixels(factor):
    """Exact sums stay, the staircase stays: only the skeleton, which grows spurs on it, is no longer the same."""
    mask = star(150, 0.35, 12)
    coarse, fine = measure_mask(mask), measure_mask(np.kron(mask, np.ones((factor, factor))), 1 / factor)
    assert fine.area == coarse.area
    assert fine.solidity == pytest.approx(coarse.solidity, rel=1e-12)
    assert (fine.object_count, fine.hole_count, fine.wave_number) == (1, 0, 12)
    assert fine.radius == pytest.approx(coarse.radius, rel=1e-4)
    assert fine.max_radius == pytest.approx(coarse.max_radius, abs=1)
    assert fine.angular_index == pytest.approx(coarse.angular_index, abs=0.01)


def test_a_convex_shape_is_solid():
    assert measure_mask(np.ones((30, 50))).solidity == pytest.approx(1)
    assert measure_mask(disc(150)).solidity == pytest.approx(1, abs=0.01)


def test_every_convex_shape_has_the_same_share_in_the_outer_tenth_of_its_hull():
    """1 − 0.9² = 0.19; of pixels less, as the hull of their squares reaches half a pixel beyond a curve."""
    assert measure_mask(np.ones((60, 80))).outer_hull_share == pytest.approx(0.19, rel=1e-12)
    for radius in (20, 40, 80, 160):
        for mask in (disc(radius), ellipse(2 * radius, 0.5, 0.4)):
            share = measure_mask(mask, statistics=("outer_hull_share",)).outer_hull_share
            assert 0.19 - 1.0 / radius < share < 0.19


def test_filaments_fill_little_of_the_outer_tenth_of_the_hull():
    """Of the star r = R (1 + a cos 12θ), by quadrature over points beyond the shrunk hull of its curve."""
    angle, part = np.linspace(0, 2 * pi, 4_801)[:-1], (np.arange(500) + 0.5) / 500
    reach, directions = star_radius(angle, 200, 0.35, 12), np.stack([np.cos(angle), np.sin(angle)], axis=1)
    hull = ConvexHull(reach[:, None] * directions)  # its centroid is the star's middle
    points = (reach * np.sqrt(part)[:, None])[..., None] * directions
    outer = Delaunay(0.9 * hull.points[hull.vertices]).find_simplex(points) < 0
    exact = float((outer * reach**2).sum() / (500 * (reach**2).sum()))
    assert measure_mask(star(200, 0.35, 12)).outer_hull_share == pytest.approx(exact, abs=0.002)


NAN = {
    "csr_radius",
    "filament_area_index",
    "filament_radius_index",
    "branch_count",
    "branch_length",
    "filament_width",
    "angular_index",
    "wave_number",
}


@pytest.mark.parametrize(
    ("mask", "undefined"),
    [
        (np.ones((1, 1)), {*NAN, "radial_index", "fractal_dimension"}),
        (np.ones((3, 3)), {*NAN, "fractal_dimension"}),
        (np.ones((1, 200)), set()),
        (np.eye(50), set()),
        (np.ones((60, 80)), set()),
        (disc(40) & ~np.pad(disc(30), 10), set()),
        (np.kron(np.array([[1, 0, 1], [0, 0, 0], [1, 0, 0]]), np.ones((20, 20))), set()),
    ],
    ids=["pixel", "square", "line", "diagonal", "full", "ring", "objects"],
)
def test_what_is_not_a_number_is_the_documented(mask, undefined):
    row = measure_mask(mask)
    assert {name for name, value in row.items() if not np.isfinite(value)} == undefined


def test_rows_have_units_and_meanings():
    row = measure_mask(np.ones((40, 50)), 2.0)
    assert list(row) == [name for name, entry in STATISTICS.items() if entry.mask]
    assert {entry.unit() for entry in STATISTICS.values()} == {"", "µm", "µm²"}
    assert all(entry.meaning for entry in STATISTICS.values())
    assert row["centroid_x"] == 49.0
    assert row["centroid_y"] == 39.0
    assert isinstance(row["object_count"], int)
    assert SKELETON in STATISTICS["branch_count"].meaning
    assert SKELETON in STATISTICS["branch_length"].meaning


def test_only_what_is_asked_for_is_computed(monkeypatch):
    mask = star(60, 0.3, 6)
    whole = measure_mask(mask, 2.0)
    monkeypatch.setattr("yeastfit.measure.statistics.filaments._branches", None)
    assert measure_mask(mask, 2.0, ("radius", "csr_radius")) == {n: whole[n] for n in ("radius", "csr_radius")}
    with pytest.raises(TypeError):
        measure_mask(mask, 2.0, ("branch_count",))
    with pytest.raises(InputError, match=r"statistics: got 'size', need some of area, perimeter"):
        measure_mask(mask, 2.0, ("size",))


@pytest.mark.parametrize("angle", [0.3, 1.9])
def test_the_mask_of_one_cell_is_its_ellipse(angle):
    """Two nodes 1.6 apart, in a square of 4, on both sides of the lattice's middle."""
    colony = colony_of(pair(1.6, angle, (0.2, -0.1)), [-1, 0], numerics=Numerics(4.0, 0.2, capacity=4))
    found = mask_of(colony, Parameters(aspect_ratio=0.6), HARD, 4.0, 201)
    np.testing.assert_array_equal(found.T, ellipse(40, 0.6, angle, (10, -5), 201))


def test_a_simulated_colony_has_the_same_statistics():
    seen = np.stack([star(40, 0.3, 6), star(40, 0.3, 9)])[None]
    assert set(HardStatistics(4.0).finish({"mask": seen})) == set(recorded("mask")) - set(names_with("nodes"))
    found = HardStatistics(4.0, 0.1, names_with("mask")).finish({"mask": seen, "cell_count": np.ones((1, 2))})
    assert found.pop("cell_count").shape == (1, 2)
    row = measure_mask(seen[0, 1], 0.1)
    assert {name: values[0, 1] for name, values in found.items()} == pytest.approx(dict(row))
    with pytest.raises(InputError, match="statistics: got 'mass'"):
        HardStatistics(4.0, 0.1, ("area", "mass"))


@pytest.mark.parametrize(
    ("mask", "pixel_size", "words"),
    [
        (np.zeros((5, 5), dtype=bool), 1.0, "none of its 25 pixels"),
        (np.zeros((0, 5), dtype=bool), 1.0, "none of its 0 pixels"),
        (np.ones((2, 2, 3), dtype=bool), 1.0, r"shape \(2, 2, 3\)"),
        (np.full((4, 4), np.nan), 1.0, "NaN"),
        (np.ones((4, 4), dtype=bool), 0.0, "pixel_size: got 0.0"),
        (np.ones((4, 4), dtype=bool), -1.5, "pixel_size: got -1.5"),
        (np.ones((4, 4), dtype=bool), float("inf"), "pixel_size: got inf"),
        (np.ones((4, 4), dtype=bool), float("nan"), "pixel_size: got nan"),
    ],
)
def test_bad_input_is_named(mask, pixel_size, words):
    with pytest.raises(InputError, match=words) as caught:
        measure_mask(mask, pixel_size)
    assert "\n" not in str(caught.value)
