"""What statistics share of a mask's pixels."""

import gc
import weakref
from collections.abc import Iterator

import numpy as np
import pytest
from shapes import wheel

from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.offlattice.simulator import known_statistics


@pytest.fixture
def _without_collector() -> Iterator[None]:
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("objects", [1, 2])
@pytest.mark.usefixtures("_without_collector")
def test_no_statistic_keeps_the_pixels(objects: int) -> None:
    """Memory of thousands of masks in a row would run out before Python looks for cycles."""
    mask = wheel(60, 7, 150, 9)
    if objects == 2:
        mask = np.pad(mask, ((0, 0), (0, 9)))
        mask[3:6, -4:-1] = True
    pixels = Pixels.of(mask)
    for entry in known_statistics().values():
        assert entry.mask is not None
        entry.mask(pixels)
    gone = weakref.ref(pixels)
    del pixels
    assert gone() is None
