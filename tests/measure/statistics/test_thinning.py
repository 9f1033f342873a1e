"""Fast thinning beside scikit-image's: the same pixels."""

import numpy as np
import pytest
from shapes import star
from skimage.morphology import skeletonize

from yeastfit.measure.statistics import thinning


@pytest.fixture(autouse=True)
def at_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thinning, "LARGE", 0)


def test_noise_of_any_density_and_size() -> None:
    """Noise has all 256 neighbourhoods; images of one row, of odd layout in memory and of nothing are among them."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        image = rng.random(rng.integers(1, 40, size=2)) < rng.uniform(0.2, 1.0)
        np.testing.assert_array_equal(thinning.skeleton(image), skeletonize(image))
        np.testing.assert_array_equal(thinning.skeleton(np.rot90(image)), skeletonize(np.rot90(image).copy()))


def test_a_colony() -> None:
    image = star(60, 0.4, 9)
    before = image.copy()
    np.testing.assert_array_equal(thinning.skeleton(image), skeletonize(image))
    np.testing.assert_array_equal(image, before)


def test_without_numba_it_is_scikit_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thinning, "_numba_is_installed", lambda: False)
    monkeypatch.setattr(thinning, "removes", None)
    np.testing.assert_array_equal(thinning.skeleton(star(30, 0.4, 5)), skeletonize(star(30, 0.4, 5)))
