"""MATLAB's `imresize` by 4 in plain NumPy, and masks and statistics of the follow-up, Li et al. 2025, made with it."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from reference import offlattice as reference
from yeastfit.offlattice.colony import OfflatticeColony
from yeastfit.offlattice.statistics.golay_skeleton import skeleton


def keys(distance: float) -> float:
    """The cubic of Keys with a = −1/2."""
    t = abs(distance)
    return 1.5 * t**3 - 2.5 * t**2 + 1 if t <= 1 else -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2 if t <= 2 else 0.0


def weights(size: int) -> np.ndarray:
    """Of `size` values, for 4 `size` values between them; mirrored at the border."""
    found = np.zeros((4 * size, size))
    for k in range(4 * size):
        centre = (k + 0.5) / 4 - 0.5
        for near in range(int(np.floor(centre)) - 1, int(np.floor(centre)) + 3):
            index = near % (2 * size)
            found[k, min(index, 2 * size - 1 - index)] += keys(centre - near)
    return found


def enlarged_in_8_bits(image: np.ndarray) -> np.ndarray:
    """One dimension after the other, rounded half up."""
    values = 255.0 * image
    for _ in range(2):
        values = np.clip(np.floor(weights(len(values)) @ values + 0.5), 0, 255).T
    return values > 128


def follow_up_mask(colony: OfflatticeColony, cells: int) -> np.ndarray:
    """Vertices are counted, and the counts enlarged; 1600 × 2000 pixels."""
    corners = reference.vertices(
        colony.x[:cells], colony.y[:cells], colony.theta[:cells], colony.pseudohyphal[:cells]
    ).reshape(-1, 2)
    counts, _, _ = np.histogram2d(
        corners[:, 0], corners[:, 1], bins=[np.arange(-800.0, 801, 4), np.arange(-1000.0, 1001, 4)]
    )
    mask = weights(400) @ counts @ weights(500).T > 0.5
    labels, _ = ndimage.label(~mask, np.ones((3, 3)))
    return mask | (np.bincount(labels.ravel())[labels] < 10)


@dataclass
class FollowUp:
    """What the follow-up measures, in pixels."""

    area: int
    outer_area: int
    perimeter: int
    max_radius: float
    mean_radius: float
    skeleton: int


def follow_up_statistics(mask: np.ndarray) -> FollowUp:
    """Of a colony of one large component; perimeter: pixels with one of four neighbours outside."""
    labels, _ = ndimage.label(mask, np.ones((3, 3)))
    largest = labels == 1 + np.bincount(labels.ravel())[1:].argmax()
    centre = np.argwhere(largest).mean(axis=0)
    perimeter = np.argwhere(mask & ~ndimage.binary_erosion(mask))
    mean_radius = np.hypot(*(perimeter - centre).T).mean()
    middle = np.floor(centre + 0.5).astype(int)
    rows, columns = np.ogrid[: mask.shape[0], : mask.shape[1]]
    beyond = mask & (np.hypot(rows - middle[0], columns - middle[1]) > mean_radius)
    return FollowUp(
        int(mask.sum()),
        int(beyond.sum()),
        len(perimeter),
        float(np.hypot(*(np.argwhere(mask) - centre).T).max()),
        float(mean_radius),
        int(skeleton(beyond[: middle[0] + 1, : middle[1] + 1]).sum()),
    )
