"""Select the colony among the dark objects of a photograph."""

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy
from jaxtyping import Bool
from skimage import measure, segmentation

from yeastfit.errors import InputError
from yeastfit.measure.outlining.mask_operations import NEIGHBOURS, Mask, areas_of

DUST = 0.01  # of the largest object's pixels: smaller ones are dust where all colonies are wanted


def select_colony(
    dark: Mask, frame: Mask, min_area: int, name: str, seed: tuple[float, float] | None = None, every: bool = False
) -> tuple[Mask, list[str]]:
    """Select the largest object that the border does not hold, the one at a seed point, or all that are no dust.

    Arguments:
        dark: Pixels of all objects.
        frame: Pixels that are left out of the image.
        min_area: The fewest pixels of a colony.
        name: What messages begin with.
        seed: x and y.
        every: Whether all of them are wanted.

    Returns:
        The object or objects, widened by 3 px but not into others, and doubts by name.

    Raises:
        InputError: There is no object of `min_area` pixels.
    """
    labels = measure.label(dark, connectivity=2)
    areas = areas_of(labels)
    if areas.max() < min_area:
        what = (
            f"the largest object has {areas.max()} pixels" if areas.max() else "nothing is darker than the background"
        )
        raise InputError(
            f"{name}: no colony ({what}), need a dark object of {min_area} pixels or more, background around it"
        )
    edge = frame.copy()
    edge[[0, -1], :] = edge[:, [0, -1]] = True
    if every:
        chosen, doubts = _all_objects(labels, areas, edge, min_area)
    elif seed is None:
        chosen, doubts = _largest(labels, areas, edge, min_area)
    else:
        chosen, doubts = _object_at_seed(labels, areas >= min_area, edge, seed, name)
    return scipy.ndimage.binary_dilation(chosen, NEIGHBOURS, iterations=3) & (chosen | ~dark), doubts


def object_at(
    labels: npt.NDArray[Any], wanted: Bool[np.ndarray, " label"], seed: tuple[float, float], name: str
) -> int:
    """The wanted label at a point (x, y), or the nearest one within `seed_tolerance`; raises `InputError` for none."""
    rows, columns = np.nonzero(wanted[labels])
    distance = np.hypot(columns - seed[0], rows - seed[1])
    limit = seed_tolerance(labels.shape)
    if not distance.size or distance.min() > limit:
        nearest = f"the nearest is {distance.min():.0f} pixels away" if distance.size else "there is none at all"
        raise InputError(
            f"{name}: no object at seed_point ({seed[0]:g}, {seed[1]:g}) ({nearest}), "
            f"need a point on the colony or within {limit:.0f} pixels of it"
        )
    first = int(distance.argmin())
    return int(labels[rows[first], columns[first]])


def seed_tolerance(shape: tuple[int, ...]) -> float:
    """How far from its object a seed point may lie: 2 % of the image's longer side, at least 10 px."""
    return max(10.0, 0.02 * max(shape))


def _largest(
    labels: npt.NDArray[Any], areas: npt.NDArray[np.int64], edge: Mask, min_area: int
) -> tuple[Mask, list[str]]:
    at_border = np.setdiff1d(labels[edge], [0])
    free = areas.copy()
    free[at_border] = 0
    largest = int(areas.argmax())
    chosen, doubts = labels == largest, []
    if largest in at_border:
        core = _cut_off_from_border(chosen, edge)
        if core is not None and core.sum() > free.max():
            chosen, doubts = core, ["cut off from an object at the border"]
        elif free.max() >= max(min_area, 0.05 * areas.max()):
            largest = int(free.argmax())
            chosen, doubts = labels == largest, ["an object at the border is left out"]
    free[largest] = 0
    if free.max() > max(0.1 * chosen.sum(), 2 * min_area):  # of blurred dust, `dark` holds twice its pixels
        doubts.append("several objects")
    return chosen, doubts


def _all_objects(
    labels: npt.NDArray[Any], areas: npt.NDArray[np.int64], edge: Mask, min_area: int
) -> tuple[Mask, list[str]]:
    """All objects that the border does not hold and that are no dust; where it holds all of them, the largest."""
    large = areas >= max(2 * min_area, DUST * areas.max())
    free = large.copy()
    free[labels[edge]] = False
    if not free.any():
        return _largest(labels, areas, edge, min_area)
    return free[labels], ["an object at the border is left out"] if (large & ~free).any() else []


def _object_at_seed(
    labels: npt.NDArray[Any], wanted: Bool[np.ndarray, " label"], edge: Mask, seed: tuple[float, float], name: str
) -> tuple[Mask, list[str]]:
    """The object at the seed; where it reaches the border, the part at the seed if a neck lies between."""
    chosen = labels == object_at(labels, wanted, seed, name)
    core = _cut_off_from_border(chosen, edge) if (chosen & edge).any() else None
    if core is None:
        return chosen, []
    part = object_at(np.where(core, 2, np.where(chosen, 1, 0)), np.array([False, True, True]), seed, name)
    return (core, ["cut off from an object at the border"]) if part == 2 else (chosen, [])


def _cut_off_from_border(joined: Mask, edge: Mask) -> Mask | None:
    """Cut an object at the border in two at a neck, and return the part around its thickest place.

    By a watershed of the distance to the background, on a grid of about 400 points a side, between that place and the
    border. None where the object is thickest at the border, or reaches it only with a tip (less than 1 % of it would be
    cut).
    """
    step = max(1, max(joined.shape) // 400)
    small = measure.block_reduce(joined, (step, step), np.max)
    border = measure.block_reduce(edge & joined, (step, step), np.max)
    inside = scipy.ndimage.distance_transform_edt(scipy.ndimage.binary_fill_holes(small))
    for share in (0.5, 0.25):
        cores = measure.label(inside > share * inside.max(), connectivity=2)
        areas = areas_of(cores)
        areas[cores[border]] = 0
        if areas.max():
            break
    else:
        return None
    seeds = np.where(border, 1, np.where(cores == areas.argmax(), 2, 0))
    parts = segmentation.watershed(-inside, seeds, mask=small, connectivity=2)
    if (parts == 1).sum() < 0.01 * small.sum():
        return None
    core = np.kron(parts == 2, np.ones((step, step), dtype=bool))[: joined.shape[0], : joined.shape[1]]
    labels = measure.label(core & joined, connectivity=2)
    part: Mask = labels == areas_of(labels).argmax()
    return part
