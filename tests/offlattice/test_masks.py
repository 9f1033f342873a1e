"""Masks of the first n cells: Li et al.'s against published numbers and by hand, ours against every pixel."""

from math import floor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from offlattice.enlargement import enlarged_in_8_bits
from scipy import ndimage
from shapes import masks

from reference import offlattice as reference
from yeastfit.errors import InputError
from yeastfit.offlattice.colony import OfflatticeColony, grow
from yeastfit.offlattice.masks.area_matching import Match, match_exactly, search_from_below
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.masks.li2024_mask import FRAME, BinnedOutlines, enlarged, fill_holes
from yeastfit.offlattice.placing import PIXELS_PER_UM, SEMI_AXES


@pytest.fixture(scope="module")
def small() -> OfflatticeColony:
    """The small colony whose masks are known."""
    stream = np.random.RandomState(1).random_sample(60_000)
    return grow((0.5, 0.5, 0.3, 0.3, 0.3), cells=5000, stream=stream)


def test_known_masks(small: OfflatticeColony) -> None:
    binned = BinnedOutlines.of(small)
    assert [(int((binned.first <= n).sum()), int(binned.mask(n).sum())) for n in (1000, 5000)] == [
        (887, 14_188),
        (5701, 91_342),
    ]
    assert binned.mask(5000).shape == (1400, 1800)
    assert binned.dropped == 0


def test_a_frame_that_holds_the_colony_shows_the_same(small: OfflatticeColony) -> None:
    """With another margin; of a colony that theirs cuts off, it shows the rest, too."""
    for frame in (FRAME, (60, 80)):
        binned, whole = BinnedOutlines.of(small, frame), BinnedOutlines.whole(small)
        assert whole.dropped == 0
        mask, other = binned.mask(5000), whole.mask(5000)
        assert not other[[0, -1]].any()
        assert not other[:, [0, -1]].any()
        margins = [abs(a - b) // 2 for a, b in zip(mask.shape, other.shape, strict=True)]
        inside = tuple(slice(one, -one or None) for one in margins)
        if frame == FRAME:
            np.testing.assert_array_equal(mask[inside], other)
            assert mask.sum() == other.sum()
        else:
            deep = np.s_[8:-8, 8:-8]  # a bin's pixels depend on two bins beside it
            np.testing.assert_array_equal(other[inside][deep], mask[deep])
            assert other.sum() > mask.sum() + 1000


def test_bins_hold_vertices(small: OfflatticeColony) -> None:
    """Every n from one look is what the first n cells alone give; x runs along the rows."""
    binned = BinnedOutlines.of(small, frame=(60, 80))
    for n in (1, 7, 800, 5000):
        corners = reference.vertices(small.x[:n], small.y[:n], small.theta[:n], small.pseudohyphal[:n]).reshape(-1, 2)
        held, _, _ = np.histogram2d(
            corners[:, 0], corners[:, 1], bins=[np.arange(-120.0, 121, 4), np.arange(-160.0, 161, 4)]
        )
        np.testing.assert_array_equal(binned.first <= n, held > 0)
    assert binned.dropped == 12 * 5000 - held.sum() > 0


def test_of_a_colony_that_ended_early_all_cells_are_seen() -> None:
    """And not the whole image, which is what more cells than there are would cover."""
    ended = next(one for seed in range(99) if (one := grow({}, cells=100, seed=seed)).x.size < 100)
    for picture in (Ellipses.of(ended), BinnedOutlines.whole(ended)):
        every = picture.mask(ended.x.size)
        np.testing.assert_array_equal(picture.mask(ended.cells), every)
        assert not every.all()
        for match in (match_exactly, search_from_below):
            assert match(picture.mask, ended.cells, 2.0 * every.sum()).match is Match.UNREACHED


@settings(max_examples=40, deadline=None)
@given(masks.filter(lambda mask: min(mask.shape) > 1))
def test_enlarging_is_cubic_convolution(mask: np.ndarray) -> None:
    np.testing.assert_array_equal(enlarged(mask)[0], enlarged_in_8_bits(mask))


@settings(max_examples=60, deadline=None)
@given(masks)
def test_small_holes_are_filled(mask: np.ndarray) -> None:
    mask = np.pad(mask, [(0, -side % 4) for side in mask.shape], constant_values=True)
    filled = mask.copy()
    fill_holes(filled, 10, np.argwhere(np.ones((len(mask) // 4, mask.shape[1] // 4), dtype=bool)).astype(np.int32))
    np.testing.assert_array_equal(filled, with_small_holes_filled(mask))


@settings(max_examples=40, deadline=None)
@given(masks.filter(lambda mask: min(mask.shape) > 1))
def test_bins_in_which_holes_begin_are_known(occupied: np.ndarray) -> None:
    occupied = ndimage.binary_dilation(occupied)  # with bins in the middle of occupied ones
    image, mixed = enlarged(occupied)
    expected = with_small_holes_filled(image)
    fill_holes(image, 10, mixed)
    np.testing.assert_array_equal(image, expected)


def with_small_holes_filled(mask: np.ndarray) -> np.ndarray:
    labels, count = ndimage.label(~mask, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    return mask | (sizes[labels] < 10)


@pytest.mark.parametrize("frame", [(0, 10), (11, 10)])
def test_a_frame_has_even_sides(frame: tuple[int, int], small: OfflatticeColony) -> None:
    with pytest.raises(InputError, match="two even numbers"):
        BinnedOutlines.of(small, frame)


@pytest.mark.parametrize("pixel_size", [1.55008, 0.9])
def test_ellipses_pixel_by_pixel(pixel_size: float) -> None:
    colony = grow((0.3, 0.5, 0.5, 0.5, 0.3), cells=120, seed=4)
    drawn = Ellipses.of(colony, pixel_size, gap=0)
    half = len(drawn.first) // 2
    centres = (np.arange(2 * half) + 0.5 - half) * pixel_size * PIXELS_PER_UM
    x, y = centres[None, :, None], -centres[:, None, None]
    for n in (1, 60, 120):
        a, b = SEMI_AXES[colony.pseudohyphal[:n].astype(int)].T
        dx, dy = x - colony.x[:n], y - colony.y[:n]
        u = dx * np.cos(colony.theta[:n]) + dy * np.sin(colony.theta[:n])
        v = dy * np.cos(colony.theta[:n]) - dx * np.sin(colony.theta[:n])
        inside = ((u / a) ** 2 + (v / b) ** 2 <= 1).any(axis=2)
        np.testing.assert_array_equal(drawn.mask(n), inside)
    edge = np.ones_like(inside)
    edge[1:-1, 1:-1] = False
    assert not drawn.mask(120)[edge].any()


def test_an_ellipse_has_its_area() -> None:
    drawn = Ellipses.of(grow((0.5, 0.5, 0.5, 0.5, 0.5), cells=1), 0.05, gap=0)
    assert drawn.mask(1).sum() * 0.05**2 == pytest.approx(np.pi * 4.2 * 3.0, rel=1e-3)


@pytest.mark.parametrize("gap", [4.0, 6.0, 10.0, 12.0, 25.0])
def test_closing_all_masks_at_once_closes_each(gap: float, small: OfflatticeColony) -> None:
    open_, closed = Ellipses.of(small, gap=0), Ellipses.of(small, gap=gap)
    margin = (len(closed.first) - len(open_.first)) // 2
    reach = np.arange(-floor(gap / 3.10016), floor(gap / 3.10016) + 1)
    disc = reach[:, None] ** 2 + reach**2 <= (gap / 3.10016) ** 2
    for n in (40, 1234, 5000):
        mask = np.pad(open_.mask(n), margin)
        np.testing.assert_array_equal(closed.mask(n), ndimage.binary_closing(mask, disc))
    share = 0.05 if gap >= 10 else 0.5
    assert ndimage.label(~closed.mask(5000))[1] < share * ndimage.label(~open_.mask(5000))[1]


@pytest.mark.parametrize(("gap", "margin"), [(0.0, 3.1), (6.0, 2.0), (12.0, 6.0)])
def test_a_margin_lies_around_all_masks(gap: float, margin: float, small: OfflatticeColony) -> None:
    """Dilated by a disc of half the gap and the margin, eroded by one of half the gap."""
    cells, drawn = Ellipses.of(small, gap=0), Ellipses.of(small, gap=gap, margin=margin)
    frame = (len(drawn.first) - len(cells.first)) // 2

    def disc(radius: float) -> np.ndarray:
        reach = np.arange(-floor(radius), floor(radius) + 1)
        return reach[:, None] ** 2 + reach**2 <= radius**2

    inner = gap / 3.10016
    for n in (40, 1234, 5000):
        wide = ndimage.binary_dilation(np.pad(cells.mask(n), frame), disc(inner + margin / 1.55008))
        expected = ndimage.binary_erosion(wide, disc(inner))
        np.testing.assert_array_equal(drawn.mask(n), expected)
        assert expected.any(axis=1)[[0, -1]].sum() == 0


@pytest.mark.parametrize(
    ("pixel_size", "gap", "margin", "words"),
    [
        (0.0, 6.0, 0.0, "size above 0"),
        (1.5, -1.0, 0.0, "gap is -1.0 µm, it must be at least 0"),
        (1.5, 6.0, -0.5, "margin is -0.5 µm, it must be at least 0"),
        (1e-4, 0.0, 0.0, "larger"),
    ],
)
def test_wrong_sizes(pixel_size: float, gap: float, margin: float, words: str, small: OfflatticeColony) -> None:
    with pytest.raises(InputError, match=words):
        Ellipses.of(small, pixel_size, gap, margin)


def test_a_colony_without_cells_is_not_drawn() -> None:
    with pytest.raises(InputError, match=r"outside \[0, 1\]"):
        Ellipses.of(grow((2.0, 0.5, 0.5, 0.5, 0.5), cells=10))


@pytest.mark.parametrize(
    ("target", "steps"), [(91_000.0, 2), (86_000.0, 3), (70_000.0, 4), (60_000.0, 5), (30_000.0, 9)]
)
def test_search_from_below_by_hand(target: float, steps: int, small: OfflatticeColony) -> None:
    """Mask after mask, of matches after more steps and after fewer."""
    binned = BinnedOutlines.of(small)
    found = search_from_below(binned.mask, 5000, target)
    share, kept = target / 91_342 - 0.1, []
    while True:
        kept.append(round(share * 5000))
        area = binned.mask(kept[-1]).sum()
        if 0.95 * target < area < 1.05 * target:
            break
        share += 0.025
    assert (found.cells, found.area, found.match) == (kept[-1], area, Match.MATCHED)
    assert len(kept) == steps + 1
    np.testing.assert_array_equal(found.mask, binned.mask(found.cells))


def test_an_area_out_of_reach_keeps_all_cells(small: OfflatticeColony) -> None:
    binned = BinnedOutlines.of(small)
    for match in (search_from_below, match_exactly):
        found = match(binned.mask, 5000, 91_343.0)
        assert (found.cells, found.area, found.match) == (5000, 91_342, Match.UNREACHED)
        assert "all are kept" in found.match.value


def test_a_search_that_misses(small: OfflatticeColony) -> None:
    """Areas that jump over the target; the mask last made is kept."""
    missed = search_from_below(BinnedOutlines.of(small).mask, 5000, 12_000.0)
    last = round((12_000 / 91_342 - 0.1 + 38 * 0.025) * 5000)
    assert (missed.cells, missed.area, missed.match) == (last, 89_417, Match.MISSED)
    found = search_from_below(lambda n: np.arange(1000)[None] < (100 if n < 900 else 1000), 1000, 500.0)
    assert (found.cells, found.area, found.match) == (975, 1000, Match.MISSED)


@pytest.mark.parametrize("area", [20_000.0, 77_777.0, 91_342.0])
def test_areas_are_matched_exactly(area: float, small: OfflatticeColony) -> None:
    binned = BinnedOutlines.of(small)
    found = match_exactly(binned.mask, 5000, area)
    assert found.match is Match.MATCHED
    assert area <= found.area < area + 60
    assert binned.mask(found.cells - 1).sum() < area
    assert found.area == binned.mask(found.cells).sum()


@given(st.lists(st.integers(0, 40), min_size=1, max_size=300), st.floats(0.01, 1.0))
def test_the_fewest_cells_that_cover_an_area_are_found(added: list[int], share: float) -> None:
    """Whatever number of pixels cells add, none among them."""
    areas = np.concatenate([[0], np.cumsum(added)])
    area = max(share * float(areas[-1]), 0.5)
    found = match_exactly(lambda n: np.arange(areas[-1])[None] < areas[n], len(added), area)
    expected = np.flatnonzero(areas >= area)
    assert (found.match is Match.MATCHED) == bool(expected.size)
    assert found.cells == (expected[0] if expected.size else len(added))


def test_few_masks_are_drawn_to_match_an_area(small: OfflatticeColony) -> None:
    binned, drawn = BinnedOutlines.of(small), list[int]()

    def mask_of(cells: int) -> np.ndarray:
        drawn.append(cells)
        return binned.mask(cells)

    for area in (20_000.0, 50_000.0, 77_777.0, 90_000.0):
        match_exactly(mask_of, 5000, area)
    assert len(drawn) <= 4 * 11  # bisection takes 13 each


def test_an_area_that_jumps_takes_few_masks_too() -> None:
    drawn = list[int]()

    def mask_of(cells: int) -> np.ndarray:
        drawn.append(cells)
        return np.arange(1000)[None] < (100 if cells < 900 else 1000)

    found = match_exactly(mask_of, 1_000_000, 500.0)
    assert (found.cells, found.area, found.match) == (900, 1000, Match.MATCHED)
    assert len(drawn) < 60


@pytest.mark.parametrize("match", [search_from_below, match_exactly])
def test_an_area_is_a_number_above_nothing(match, small: OfflatticeColony) -> None:
    with pytest.raises(InputError, match="area is nan"):
        match(BinnedOutlines.of(small).mask, 5000, np.nan)
