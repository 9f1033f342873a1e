"""Statistics of Li et al. 2024, and the skeleton of theirs and of the follow-up, against published numbers."""

from math import floor, pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from offlattice.enlargement import follow_up_mask, follow_up_statistics
from scipy import ndimage
from shapes import disc, masks, wheel

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import read_image
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.offlattice.colony import OfflatticeColony, grow
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.statistics.golay_skeleton import count_ends, skeleton
from yeastfit.offlattice.statistics.li2024_statistics import centroid, li2024_statistics

# area, r_max, r_CSR, I_F, I_R and ends of their masks, where they can be had; computed by their program.
REAL = {
    "awri796_50um_s01": (577753, 561.19, 408, 0.24170, 0.16204, 315),
    "awri796_50um_s02": (584702, 564.31, 416, 0.20310, 0.15089, 225),
    "awri796_50um_s03": (678037, 596.62, 448, 0.20389, 0.13632, 328),
    "awri796_50um_s04": (790587, 707.36, 496, 0.20275, 0.19184, 388),
    "awri796_50um_s05": (632547, 646.90, 452, 0.17288, 0.19482, 185),
    "awri796_50um_s06": (380898, 458.34, 332, 0.26277, 0.16502, 173),
    "awri796_50um_s07": (575648, 569.77, 412, 0.22615, 0.16644, 261),
    "awri796_50um_s08": (731477, 611.13, 472, 0.17072, 0.11457, 329),
    "awri796_50um_s09": (734174, 669.58, 476, 0.17123, 0.18040, 211),
    "awri796_50um_s10": (455229, 492.60, 368, 0.22813, 0.14035, 178),
    "awri796_50um_s11": (435601, 516.48, 360, 0.22871, 0.19687, 170),
    "awri796_50um_s12": (378027, 472.80, 336, 0.23973, 0.18067, 176),
    "awri796_50um_s13": (496848, 541.32, 384, 0.22515, 0.18217, 273),
    "awri796_50um_s14": (583369, 553.76, 416, 0.20002, 0.13597, 233),
    "awri796_500um_s02": (1091579, 746.85, 556, 0.19759, 0.14309, 187),
    "awri796_500um_s03": (969668, 683.57, 516, 0.22728, 0.13220, 158),
    "awri796_500um_s04": (1197183, 750.57, 576, 0.22391, 0.11946, 166),
    "awri796_500um_s05": (1215872, 748.76, 584, 0.20766, 0.10713, 187),
    "awri796_500um_s06": (1503955, 847.44, 660, 0.17826, 0.10824, 196),
    "awri796_500um_s07": (1361241, 814.46, 628, 0.16267, 0.11583, 242),
    "awri796_500um_s08": (1016947, 716.17, 548, 0.19094, 0.12169, 273),
    "awri796_500um_s09": (912125, 674.37, 504, 0.22202, 0.14002, 165),
    "awri796_500um_s10": (1318429, 778.32, 616, 0.16456, 0.09618, 180),
    "awri796_500um_s11": (681771, 563.81, 448, 0.12125, 0.09324, 114),
    "awri796_500um_s12": (891432, 661.56, 504, 0.17747, 0.12507, 100),
    "awri796_500um_s13": (773094, 586.14, 480, 0.11085, 0.07125, 95),
    "awri796_500um_s14": (747232, 582.98, 472, 0.11372, 0.07948, 113),
    "simiwhite_50um_s01": (922472, 691.20, 528, 0.13906, 0.12299, 249),
    "simiwhite_50um_s02": (1145171, 752.88, 580, 0.19589, 0.11651, 260),
    "simiwhite_50um_s03": (1068484, 790.63, 564, 0.21001, 0.17755, 406),
    "simiwhite_50um_s04": (929814, 712.60, 528, 0.19610, 0.14683, 164),
    "simiwhite_50um_s05": (900544, 744.06, 528, 0.18594, 0.18189, 157),
    "simiwhite_50um_s06": (951019, 729.91, 528, 0.21588, 0.16612, 249),
    "simiwhite_50um_s07": (789888, 690.09, 480, 0.22755, 0.19864, 164),
    "simiwhite_50um_s08": (686209, 664.48, 460, 0.21153, 0.20266, 136),
    "simiwhite_50um_s09": (676475, 628.85, 456, 0.15719, 0.16415, 124),
    "simiwhite_50um_s10": (752310, 650.28, 472, 0.21685, 0.16336, 197),
    "simiwhite_50um_s11": (696599, 653.11, 456, 0.19428, 0.19544, 219),
    "simiwhite_50um_s12": (614955, 609.59, 432, 0.21033, 0.18299, 161),
    "simiwhite_50um_s13": (674961, 616.81, 440, 0.24258, 0.17756, 287),
    "simiwhite_50um_s14": (745704, 694.46, 480, 0.18612, 0.20400, 175),
}

# Rows of the follow-up's table: cells kept, area, area beyond r_mean, perimeter, r_max, r_mean, skeleton pixels.
FOLLOW_UP = {
    0: [
        (45625, 519591, 19431, 3676, 456.53316, 405.68632, 334),
        (74227, 912246, 35724, 11989, 608.64808, 535.53729, 686),
    ],
    1: [
        (45478, 519557, 14717, 3607, 439.21427, 405.62143, 492),
        (72173, 912298, 50792, 16591, 640.07882, 539.12203, 1625),
    ],
    5: [
        (45506, 519251, 18213, 3802, 455.13932, 405.68965, 168),
        (80953, 911969, 27126, 5018, 599.84037, 538.07772, 369),
    ],
}


def test_real_masks_to_the_last_digit(real_data: Path) -> None:
    paths = sorted((real_data / "masks").glob("*.tif"))
    assert len(paths) >= 20
    for path in paths:
        found = li2024_statistics(read_image(path) < 128)
        area, max_radius, csr_radius, area_index, radius_index, ends = REAL[path.stem]
        assert (found.area, found.csr_radius, found.ends) == (area, csr_radius, ends), path.stem
        assert found.max_radius == pytest.approx(max_radius, abs=0.0051)
        assert found.filament_area_index == pytest.approx(area_index, abs=0.51e-5)
        assert found.filament_radius_index == pytest.approx(radius_index, abs=0.51e-5)
        assert found.branch_index == (ends - 25) / 575


def test_published_means_are_those_of_the_masks() -> None:
    """All 41: what they fit."""
    means = {"awri796_50um": (0.212637, 0.164169, 0.384472), "awri796_500um": (0.176782, 0.111761, 0.247625)}
    means["simiwhite_50um"] = (0.199236, 0.171478, 0.322733)
    for name, expected in means.items():
        rows = np.array([row[3:] for stem, row in REAL.items() if stem.rpartition("_")[0] == name])
        rows[:, 2] = (rows[:, 2] - 25) / 575
        np.testing.assert_allclose(rows.mean(axis=0), expected, atol=1e-5)


def check_follow_up(row: int, colony: OfflatticeColony) -> None:
    for cells, *expected in FOLLOW_UP[row]:
        found = follow_up_statistics(follow_up_mask(colony, cells))
        area, outer_area, perimeter, max_radius, mean_radius, pixels = expected
        assert (found.area, found.perimeter, found.skeleton) == (area, perimeter, pixels)
        assert found.outer_area == outer_area
        assert (found.max_radius, found.mean_radius) == pytest.approx((max_radius, mean_radius), abs=0.51e-5)


def test_the_follow_ups_skeletons() -> None:
    """The first of its simulations, grown from its stream."""
    stream = np.random.RandomState(18).random_sample(1_575_089)
    check_follow_up(0, grow(stream[:5], cells=100_000, stream=stream[5:]))


@pytest.mark.slow
@pytest.mark.parametrize("row", [1, 5])
def test_more_of_the_follow_ups_skeletons(row: int) -> None:
    start = {1: 1_575_089, 5: 11_280_982}[row]
    stream = np.random.RandomState(18).random_sample(start + 4_000_000)[start:]
    check_follow_up(row, grow(stream[:5], cells=100_000, stream=stream[5:]))


def test_a_known_simulation() -> None:
    stream = np.random.RandomState(1).random_sample(51_034)
    colony = grow((0.5, 0.5, 0.3, 0.3, 0.3), cells=5000, stream=stream)
    found = li2024_statistics(BinnedOutlines.of(colony).mask(5000))
    assert (found.area, found.ends) == (91_342, 50)
    assert found.filament_area_index == pytest.approx(0.212153, abs=0.51e-6)
    assert found.filament_radius_index == pytest.approx(0.250733, abs=0.51e-6)


def largest_centroid(mask: np.ndarray) -> tuple[float, float]:
    """Of equal components, that of the one whose last pixel comes first, row by row."""
    labels, number = ndimage.label(mask, np.ones((3, 3)))
    pixels = [np.argwhere(labels == k + 1) for k in range(number)]
    row, column = min(pixels, key=lambda own: (-len(own), own[-1].tolist())).mean(axis=0)
    return row, column


def by_hand(mask: np.ndarray) -> tuple[float, ...]:
    """The definitions read aloud: area, r_max, r_CSR, I_F, I_R and the pixels that are thinned."""
    row, column = largest_centroid(mask)
    rows, columns = np.nonzero(mask)
    r = np.hypot(rows - row, columns - column)
    density = mask.sum() / (pi * r.max() ** 2)
    excess = [
        abs(1 - ((r > 4 * i - 4) & (r <= 4 * i)).sum() / (pi * density * 16 * (2 * i - 1)))
        for i in range(1, floor(r.max() / 4 + 0.5) + 1)
    ]
    csr = 4 * (1 + int(np.argmin(excess)))
    up, left = floor(row + 0.5), floor(column + 0.5)
    beyond = np.hypot(rows - up, columns - left) >= csr
    quadrant = (beyond & (rows <= up) & (columns <= left)).sum()
    return mask.sum(), r.max(), csr, beyond.mean() / 0.65, (r.max() / csr - 1.1) / 1.7, quadrant


@settings(max_examples=60, deadline=None)
@given(masks)
def test_statistics_by_hand(mask: np.ndarray) -> None:
    found = li2024_statistics(mask)
    if found.max_radius < 2:
        assert np.isnan(list(found.row().values())[2:]).all()
        return
    area, max_radius, csr, area_index, radius_index, quadrant = by_hand(mask)
    assert (found.area, found.csr_radius) == (area, csr)
    assert found.max_radius == pytest.approx(max_radius, rel=1e-12)
    assert found.filament_area_index == pytest.approx(area_index, rel=1e-12)
    assert found.filament_radius_index == pytest.approx(radius_index, rel=1e-12, abs=1e-12)
    assert found.ends <= quadrant  # and none where what is there shrinks to a point or a ring


@settings(max_examples=60, deadline=None)
@given(masks)
def test_the_centroid_is_of_the_largest_component(mask: np.ndarray) -> None:
    assert centroid(mask) == pytest.approx(largest_centroid(mask), rel=1e-12)


def test_a_speck_moves_no_index() -> None:
    """Left of the colony, so that it is the first component by columns, and nearer to the centre than the tips."""
    mask = wheel(60, 7, 150, 9)
    middle = mask.shape[0] // 2
    speck = mask.copy()
    left = np.flatnonzero(mask[middle + 20])[0]
    speck[middle + 18 : middle + 21, left - 8 : left - 5] = True
    assert ndimage.label(speck, np.ones((3, 3)))[1] == 2
    without, found = li2024_statistics(mask), li2024_statistics(speck)
    assert (found.max_radius, found.csr_radius) == (without.max_radius, without.csr_radius)
    assert found.filament_area_index == pytest.approx(without.filament_area_index, rel=0.01)
    assert abs(found.ends - without.ends) <= 1


def test_they_agree_with_ours_where_they_mean_the_same() -> None:
    mask = wheel(60, 7, 150, 9)
    found, ours = li2024_statistics(mask), measure_mask(mask)
    assert found.csr_radius == ours.csr_radius
    assert found.filament_radius_index == pytest.approx(ours.filament_radius_index, rel=1e-9)
    assert found.filament_area_index == pytest.approx(ours.filament_area_index, rel=0.02)


def test_a_mask_without_colony_or_filaments() -> None:
    with pytest.raises(InputError, match="none of its 12 pixels"):
        li2024_statistics(np.zeros((3, 4), dtype=bool))
    one = np.zeros((5, 5), dtype=bool)
    one[2, 3] = True
    found = li2024_statistics(one)
    assert (found.area, found.max_radius) == (1, 0)
    assert np.isnan(found.csr_radius)
    assert np.isnan(found.ends)


def test_skeletons_by_hand() -> None:
    """A line stays and has two ends; a cross has four; a pixel one; a closed curve none."""
    line = np.zeros((5, 12), dtype=bool)
    line[2, 1:11] = True
    np.testing.assert_array_equal(skeleton(line), line)
    assert count_ends(line) == 2
    cross = np.zeros((11, 11), dtype=bool)
    cross[5, 1:10] = cross[1:10, 5] = True
    assert count_ends(skeleton(cross)) == 4
    assert count_ends(np.pad(np.ones((1, 1), dtype=bool), 2)) == 1
    ring = disc(12) & ~np.pad(disc(8), 4)
    thin = skeleton(ring)
    assert count_ends(thin) == 0
    assert ndimage.label(~thin)[1] == 2


@settings(max_examples=40, deadline=None)
@given(masks)
def test_thinning_keeps_components_and_holes(mask: np.ndarray) -> None:
    thin = skeleton(mask)
    assert not (thin & ~mask).any()
    assert ndimage.label(thin, np.ones((3, 3)))[1] == ndimage.label(mask, np.ones((3, 3)))[1]
    assert (
        ndimage.label(np.pad(~thin, 1, constant_values=True))[1]
        == ndimage.label(np.pad(~mask, 1, constant_values=True))[1]
    )
    np.testing.assert_array_equal(skeleton(thin), thin)
