"""Which dark object of a photograph is the colony."""

from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool
from scipy import ndimage
from skimage import measure, segmentation

from yeastfit.errors import InputError
from yeastfit.measure.outlining.mask_operations import EIGHT, Mask, areas_of


def colony(
    found: Mask, frame: Mask, min_area: int, name: str, seed: tuple[float, float] | None = None
) -> tuple[Mask, list[str]]:
    """The object that is the colony, widened by 3 px but not into others, and doubts.

    The largest one that the border does not hold, or the one at `seed` (x, y). `frame` is left out of the image.
    Raises `InputError` where there is none of `min_area` pixels.
    """
    labels = measure.label(found, connectivity=2)
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
    if seed is None:
        chosen, doubts = _largest(labels, areas, edge, min_area)
    else:
        chosen, doubts = _pointed_at(labels, areas >= min_area, edge, seed, name)
    return ndimage.binary_dilation(chosen, EIGHT, iterations=3) & (chosen | ~found), doubts


def at_point(labels: npt.NDArray[Any], wanted: Bool[np.ndarray, " label"], seed: tuple[float, float], name: str) -> int:
    """The wanted label at a point (x, y), or the nearest one within `seed_reach`; else `InputError`."""
    rows, columns = np.nonzero(wanted[labels])
    distance = np.hypot(columns - seed[0], rows - seed[1])
    limit = seed_reach(labels.shape)
    if not distance.size or distance.min() > limit:
        nearest = f"the nearest is {distance.min():.0f} pixels away" if distance.size else "there is none at all"
        raise InputError(
            f"{name}: no object at seed_point ({seed[0]:g}, {seed[1]:g}) ({nearest}), "
            f"need a point on the colony or within {limit:.0f} pixels of it"
        )
    first = int(distance.argmin())
    return int(labels[rows[first], columns[first]])


def seed_reach(shape: tuple[int, ...]) -> float:
    """How far from its object a seed point may lie: 2 % of the image's longer side, at least 10 px."""
    return max(10.0, 0.02 * max(shape))


def _largest(
    labels: npt.NDArray[Any], areas: npt.NDArray[np.int64], edge: Mask, min_area: int
) -> tuple[Mask, list[str]]:
    held = np.setdiff1d(labels[edge], [0])
    free = areas.copy()
    free[held] = 0
    largest = int(areas.argmax())
    chosen, doubts = labels == largest, []
    if largest in held:
        core = _without_border_object(chosen, edge)
        if core is not None and core.sum() > free.max():
            chosen, doubts = core, ["cut off from an object at the border"]
        elif free.max() >= max(min_area, 0.05 * areas.max()):
            largest = int(free.argmax())
            chosen, doubts = labels == largest, ["an object at the border is left out"]
    free[largest] = 0
    if free.max() > max(0.1 * chosen.sum(), 2 * min_area):  # of blurred dust, `found` holds twice its pixels
        doubts.append("several objects")
    return chosen, doubts


def _pointed_at(
    labels: npt.NDArray[Any], wanted: Bool[np.ndarray, " label"], edge: Mask, seed: tuple[float, float], name: str
) -> tuple[Mask, list[str]]:
    """The object at the seed; where the border holds it, the part of it at the seed if there is a neck between."""
    chosen = labels == at_point(labels, wanted, seed, name)
    core = _without_border_object(chosen, edge) if (chosen & edge).any() else None
    if core is None:
        return chosen, []
    part = at_point(np.where(core, 2, np.where(chosen, 1, 0)), np.array([False, True, True]), seed, name)
    return (core, ["cut off from an object at the border"]) if part == 2 else (chosen, [])


def _without_border_object(joined: Mask, edge: Mask) -> Mask | None:
    """The part of an object around its thickest place away from the border, where a neck parts it from the border.

    Watershed of the distance to the background, on a grid of about 400 points a side, between that thickest place and
    the border. None where the object is thickest at the border, or where it only reaches the border with a tip (less
    than 1 % of it would be cut).
    """
    step = max(1, max(joined.shape) // 400)
    small = measure.block_reduce(joined, (step, step), np.max)
    border = measure.block_reduce(edge & joined, (step, step), np.max)
    inside = ndimage.distance_transform_edt(ndimage.binary_fill_holes(small))
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
