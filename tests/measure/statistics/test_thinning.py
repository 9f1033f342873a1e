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


@pytest.mark.parametrize("numba", [False, True])
def test_a_turn_is_thinned_as_the_turned_image_would_be(numba: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """All eight, which differ; turning back undoes each."""
    monkeypatch.setattr(thinning, "_numba_is_installed", lambda: numba)
    rng = np.random.default_rng(1)
    image = rng.random((37, 23)) < 0.7
    found = []
    for turn in range(8):
        seen = thinning.turned(image, turn)
        np.testing.assert_array_equal(thinning.turned_back(seen, turn), image)
        found.append(thinning.skeleton(image, turn))
        np.testing.assert_array_equal(thinning.turned(found[-1], turn), skeletonize(np.ascontiguousarray(seen)))
    assert len({skeleton.tobytes() for skeleton in found}) == 8
