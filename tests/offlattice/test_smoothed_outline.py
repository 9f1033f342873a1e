"""Statistics of smoothed outlines: by their definition, wherever the colony lies, and with bumps at its edge."""

from math import isnan

import numpy as np
import pytest
from scipy import ndimage
from shapes import with_bumps

pytest.importorskip("numba")

from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.offlattice import Ellipses, grow
from yeastfit.offlattice.simulator import statistics_of
from yeastfit.offlattice.statistics.smoothed_outline import REACH, TEXTURE, WEIGHTS, WIDTH, smoothed

LAMBDA = {"transition": 0.6, "sated_from_pseudohyphal": 0.6, "pseudohyphal_from_sated": 0.2, "fork": 0.15}
PLAIN = {entry.name: entry.name.removeprefix("smoothed_") for entry in TEXTURE}


def mask_of(seed: int, cells: int = 6000) -> np.ndarray:
    """A colony with filaments, drawn as ellipses."""
    return Ellipses.of(grow(LAMBDA, cells=cells, seed=seed)).mask(cells)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_by_their_definition(seed: int) -> None:
    mask = mask_of(seed)
    expected = measure_mask(ndimage.gaussian_filter(mask.astype(float), WIDTH) > 0.5, 1.5)
    found = statistics_of(mask, 1.5, list(PLAIN))
    assert found == pytest.approx({name: expected[plain] for name, plain in PLAIN.items()}, rel=1e-12)
    moved = np.pad(mask, ((300, 0), (0, 150)))  # where the colony lies in the image is of no account
    assert statistics_of(moved, 1.5, list(PLAIN)) == found


def test_bumps_of_a_pixel_hardly_change_them() -> None:
    """Of outlines as they are there are 1.7 times as many ends, and compactness is 1.3 times as large; of six."""
    masks = [mask_of(seed) for seed in range(6)]
    bumpy = [with_bumps(mask, np.random.default_rng(seed)) for seed, mask in enumerate(masks)]

    def grown(names: list[str]) -> np.ndarray:
        """By what factor the bumps change the means."""
        before, after = (
            np.mean([[*statistics_of(one, 1.0, names).values()] for one in some], axis=0) for some in (masks, bumpy)
        )
        return after / before

    compactness, ends, length, width = grown(list(PLAIN.values()))
    assert compactness > 1.2
    assert ends > 1.5
    assert length > 1.1
    assert width < 0.9
    np.testing.assert_allclose(grown(list(PLAIN)), 1.0, atol=0.03)


@pytest.mark.parametrize(("width", "left"), [(1, False), (2, False), (3, True), (4, True)])
def test_filaments_thinner_than_2_7_pixels_are_lost(width: int, left: bool) -> None:
    image = np.zeros((60, 40), dtype=bool)
    image[20 : 20 + width] = True
    assert smoothed(image.view(np.uint8), WEIGHTS, *image.shape)[:, 20].any() == left


@pytest.mark.parametrize("side", [1, 2])
def test_nothing_is_left_of_a_few_pixels(side: int) -> None:
    found = statistics_of(np.ones((side, side), dtype=bool), 1.0, list(PLAIN))
    assert all(map(isnan, found.values()))


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (41, 5), (60, 70)])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_smoothing_is_scipys_of_an_image_that_is_0_outside(shape: tuple[int, int], share: float) -> None:
    rng = np.random.default_rng(int(100 * share))
    for _ in range(10):
        image = rng.random(shape) < share
        expected = ndimage.gaussian_filter(image.astype(float), WIDTH, mode="constant", radius=REACH) > 0.5
        height, width = (int(rng.integers(1, side + 1)) for side in shape)
        found = smoothed(image.view(np.uint8), WEIGHTS, height, width)
        np.testing.assert_array_equal(found, expected[:height, :width])
