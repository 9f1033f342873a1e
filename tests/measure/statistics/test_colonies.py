"""Statistics of images that show several colonies."""

import numpy as np
import pytest
from shapes import disc

from yeastfit.errors import InputError
from yeastfit.measure import measure_mask
from yeastfit.measure.outlining.segmentation import segment
from yeastfit.measure.statistics.registry import STATISTICS

NAMES = ("object_count", "largest_share", "largest_area", "largest_compactness", "largest_radius")


def test_the_largest_of_several_objects_is_measured_by_itself() -> None:
    """A disc beside a square, a bar and a pixel: as the disc alone; and all of them together differ."""
    alone = np.asarray(disc(20), dtype=bool)
    beside = np.pad(alone, ((5, 40), (30, 60)))
    beside[-30:-10, -30:-10] = True
    beside[-5:-2, 3:30] = True
    beside[2, 2] = True
    both = measure_mask(beside, 0.5)
    own = measure_mask(alone, 0.5)
    assert both.object_count == 4
    assert both.largest_share == pytest.approx(alone.sum() / beside.sum())
    assert (both.largest_area, both.largest_radius) == pytest.approx((own.area, own.radius))
    assert both.largest_compactness == pytest.approx(own.compactness)
    assert both.compactness > 1.5 * own.compactness
    # of one object the largest is all
    assert [own[name] for name in NAMES] == [1, 1.0, own.area, own.compactness, own.radius]


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 2), (1, 4), (2, 3), (3, 3)], ids=str)
def test_statistics_of_tiny_objects_can_be_read_back(shape: tuple[int, int]) -> None:
    """Cells beside each other are a colony of many objects, of a few pixels each."""
    mask = np.zeros((30, 30), dtype=bool)
    for corner in range(0, 30, 5):
        mask[corner : corner + shape[0], corner : corner + shape[1]] = True
    found = measure_mask(mask, 0.5)
    assert found.largest_area == pytest.approx(0.25 * shape[0] * shape[1])
    for name, entry in STATISTICS.items():
        if entry.mask is not None and np.isfinite(found[name]):
            assert found[name] in entry.admissible, name


def test_of_several_largest_objects_the_same_is_taken_however_the_image_is_turned() -> None:
    """A square and a bar of as many pixels; and a checkerboard's hundred thousand single pixels, in a moment."""
    mask = np.zeros((40, 40), dtype=bool)
    mask[2:6, 2:6] = mask[20, 10:26] = True
    for turns in range(4):
        assert measure_mask(np.rot90(mask, turns)).largest_radius == pytest.approx(4.0)
    apart = np.zeros((600, 600), dtype=bool)
    apart[::2, ::2] = True
    assert measure_mask(apart).largest_area == 1.0


def photograph() -> np.ndarray:
    """Two dark discs, a speck, and one disc cut by the border, on a bright background with noise."""
    y, x = np.mgrid[:160, :200]
    image = np.random.default_rng(0).normal(180, 1.5, (160, 200))
    for row, column, radius in ((60, 60, 25), (110, 130, 16), (20, 150, 2.5), (159, 20, 12)):
        image[np.hypot(y - row, x - column) <= radius] -= 60
    return np.asarray(np.clip(image, 0, 255), dtype=np.uint8)


def test_all_colonies_of_a_photograph_are_outlined_if_asked_for() -> None:
    """One by default; all but dust and what the border cuts; a seed point means one."""
    image = photograph()
    one, both = segment(image), segment(image, colonies="all")
    areas = [np.pi * radius**2 for radius in (25, 16)]
    assert measure_mask(one.mask).object_count == 1
    found = measure_mask(both.mask)
    assert found.object_count == 2
    assert found.area == pytest.approx(sum(areas), rel=0.05)
    assert found.largest_area == pytest.approx(areas[0], rel=0.05)
    assert "an object at the border is left out" in both.warnings
    np.testing.assert_array_equal(segment(image, colonies="one").mask, one.mask)
    mask = np.where(both.mask, 255, 0).astype(np.uint8)
    assert measure_mask(segment(mask).mask).object_count == 2
    assert measure_mask(segment(mask, colonies="one").mask).object_count == 1
    with pytest.raises(InputError, match=r"'all' and .* means one: leave out either"):
        segment(image, colonies="all", seed_point=(60, 60))
    with pytest.raises(InputError, match="colonies is 'some', it must be one or all"):
        segment(image, colonies="some")
