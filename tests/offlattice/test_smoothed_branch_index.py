"""The branch index of smoothed outlines: by its definition, wherever the colony lies, and with bumps at its edge."""

from math import floor, isnan

import numpy as np
import pytest
from scipy import ndimage
from shapes import with_bumps

pytest.importorskip("numba")

from yeastfit.offlattice import BinnedOutlines, grow
from yeastfit.offlattice.simulator import known_statistics
from yeastfit.offlattice.statistics.golay_skeleton import count_ends, skeleton
from yeastfit.offlattice.statistics.li2024_statistics import Li2024, centroid, li2024_statistics
from yeastfit.offlattice.statistics.smoothed_branch_index import smoothed_branch_index
from yeastfit.offlattice.statistics.smoothed_outline import WIDTH

LAMBDA = {"transition": 0.6, "sated_from_pseudohyphal": 0.6, "pseudohyphal_from_sated": 0.2, "fork": 0.15}


def mask_of(seed: int, cells: int = 6000) -> np.ndarray:
    """A colony with filaments, with a margin."""
    mask = BinnedOutlines.of(grow(LAMBDA, cells=cells, seed=seed)).mask(cells)
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return np.pad(mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], 20)


def plain(mask: np.ndarray) -> float:
    """By the definition, on the whole image, distances in one array."""
    row, column = (floor(place + 0.5) for place in centroid(mask))
    smooth = ndimage.gaussian_filter(mask.astype(float), WIDTH) > 0.5
    rows, columns = np.indices(mask.shape)
    beyond = smooth & ((rows - row) ** 2 + (columns - column) ** 2 >= li2024_statistics(mask).csr_radius ** 2)
    return (count_ends(skeleton(beyond[: row + 1, : column + 1])) - 25) / 575


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_by_its_definition(seed: int) -> None:
    mask = mask_of(seed)
    found = smoothed_branch_index(mask, li2024_statistics(mask))
    assert found == pytest.approx(plain(mask), abs=1e-12)
    moved = np.pad(mask, ((300, 0), (0, 150)))  # where the colony lies in the image is of no account
    assert smoothed_branch_index(moved, li2024_statistics(moved)) == found


def test_bumps_of_a_pixel_hardly_change_it() -> None:
    """There are half as many ends again, and of smoothed outlines 2 % more; means over six colonies."""
    masks = [mask_of(seed) for seed in range(6)]
    bumpy = [with_bumps(mask, np.random.default_rng(seed)) for seed, mask in enumerate(masks)]
    ends = [np.mean([li2024_statistics(one).ends for one in some]) for some in (masks, bumpy)]
    assert ends[1] > 1.4 * ends[0]
    smooth = [
        np.mean([575 * smoothed_branch_index(one, li2024_statistics(one)) + 25 for one in some])
        for some in (masks, bumpy)
    ]
    assert smooth[1] == pytest.approx(smooth[0], rel=0.05)


def test_as_a_statistic_of_masks() -> None:
    from yeastfit.measure.statistics.pixels import Pixels

    mask, entry = mask_of(3), known_statistics()["smoothed_branch_index"]
    assert entry.mask is not None
    assert entry.mask(Pixels.of(mask)) == smoothed_branch_index(mask, li2024_statistics(mask))
    assert isnan(smoothed_branch_index(np.ones((1, 1), dtype=bool), Li2024(1, 0.0)))
