"""The summary statistics of Li et al. 2024, of a mask of theirs, of a photograph or of a simulation: the same numbers.

With (row, column) of pixel centres, A the number of colony pixels, r their distances from the centroid of the largest
8-connected component, r_max the largest, ρ = A / (π r_max²), rings of δ = 4 pixels and n_i the number of pixels with
δ (i − 1) < r ≤ δ i:

    f_i   = n_i / (π ρ δ² (2i − 1)),    i = 1 … round(r_max / δ)
    r_CSR = δ · (first i that minimises |1 − f_i|)
    I_F   = (share of pixels at r' ≥ r_CSR) / 0.65              r' from the pixel that the centroid rounds to
    I_R   = (r_max / r_CSR − 1.1) / 1.7
    I_B   = (ends − 25) / 575

Their program takes the centroid of the first component, column by column. All masks of theirs have only one, so both
rules are one there; in another photograph the first may be a speck at the colony's edge.

Ends are those of the skeleton (`golay_skeleton`) of the pixels at r' ≥ r_CSR in one quadrant, up to the centroid's
pixel in rows and columns. Those that cutting off the core and the other quadrants makes count too.

But for these details, I_F, I_R and r_CSR are `measure`'s filament_area_index, filament_radius_index and csr_radius. The
ends have nothing to do with its branch_count: a mean of four quadrants, without ends at the cuts, of another skeleton.
"""

from dataclasses import dataclass, fields
from functools import partial
from math import floor, nan, pi

import numpy as np
from jaxtyping import Bool, Int

from yeastfit.compiled import array_kernel, kernel
from yeastfit.errors import InputError
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.numbers import Range
from yeastfit.offlattice.statistics.golay_skeleton import count_ends, skeleton

RING = 4


@dataclass(frozen=True)
class Li2024:
    """Lengths and areas in pixels; of a colony that ends within its first ring, all but the first two are nan."""

    area: float
    max_radius: float
    csr_radius: float = nan
    filament_area_index: float = nan
    filament_radius_index: float = nan
    branch_index: float = nan
    ends: float = nan

    def row(self) -> dict[str, float]:
        """By name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def li2024_statistics(mask: Bool[np.ndarray, "row column"]) -> Li2024:
    """Measure a mask as Li et al. 2024 do. Not differentiable.

    Arguments:
        mask: True where the colony is, of a photograph or of a simulation.

    Returns:
        The statistics, in pixels.

    Raises:
        InputError: No pixel is.
    """
    if not mask.any():
        raise InputError(f"mask: none of its {mask.size} pixels is colony, need at least one")
    row, column = centroid(mask)
    area, max_radius, counts = _rings(mask, row, column)
    rings = np.arange(1, floor(max_radius / RING + 0.5) + 1)
    if not rings.size:
        return Li2024(area, max_radius)
    density = area / (pi * max_radius**2)
    csr = RING * (1 + int(np.argmin(np.abs(1 - counts[rings] / (pi * density * RING**2 * (2 * rings - 1))))))
    middle = floor(row + 0.5), floor(column + 0.5)
    beyond = mask.copy()
    cut_core(beyond, *middle, csr)
    share = int(np.count_nonzero(beyond)) / area
    ends = count_ends(skeleton(beyond[: middle[0] + 1, : middle[1] + 1]))
    return Li2024(area, max_radius, csr, share / 0.65, (max_radius / csr - 1.1) / 1.7, branch_index(ends), ends)


def branch_index(ends: int) -> float:
    """I_B of so many ends."""
    return (ends - 25) / 575


@array_kernel
def centroid(mask: Bool[np.ndarray, "row column"]) -> tuple[float, float]:
    """Row and column of the centroid of the largest 8-connected component; of equal ones that which ends first by rows.

    There must be one.
    """
    runs = _runs(mask)
    root = _linked(runs)
    pixels, rows, columns = np.zeros((3, len(runs)), dtype=np.int64)  # of the component whose root is this run
    for k in range(len(runs)):
        row, start, stop = runs[k]
        of = _root(root, k)
        pixels[of] += stop - start
        rows[of] += row * (stop - start)
        columns[of] += (stop - start) * (start + stop - 1) // 2
    largest = np.argmax(pixels)
    return rows[largest] / pixels[largest], columns[largest] / pixels[largest]


@array_kernel
def _runs(mask: Bool[np.ndarray, "row column"]) -> Int[np.ndarray, "run 3"]:
    """Row, first column and the column after the last, of every horizontal run of pixels."""
    count = 0
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            count += mask[row, column] and (column == 0 or not mask[row, column - 1])
    runs = np.empty((count, 3), dtype=np.int64)
    k = 0
    for row in range(mask.shape[0]):
        inside = False
        for column in range(mask.shape[1]):
            if mask[row, column] and not inside:
                runs[k, 0], runs[k, 1] = row, column
            elif inside and not mask[row, column]:
                runs[k, 2] = column
                k += 1
            inside = mask[row, column]
        if inside:
            runs[k, 2] = mask.shape[1]
            k += 1
    return runs


@array_kernel
def _linked(runs: Int[np.ndarray, "run 3"]) -> Int[np.ndarray, " run"]:
    """Each run's way to the root of its component: runs that touch, at a corner too, are of one."""
    root = np.arange(len(runs))
    above = 0
    for k in range(len(runs)):
        row, start, stop = runs[k]
        while runs[above, 0] < row - 1 or (runs[above, 0] == row - 1 and runs[above, 2] < start):
            above += 1
        other = above
        while runs[other, 0] == row - 1 and runs[other, 1] <= stop:
            root[_root(root, other)] = _root(root, k)
            other += 1
    return root


@kernel
def _root(root: Int[np.ndarray, " run"], run: int) -> int:
    while root[run] != run:
        root[run] = root[root[run]]
        run = root[run]
    return run


@array_kernel
def _rings(mask: Bool[np.ndarray, "row column"], row: float, column: float) -> tuple[int, float, Int[np.ndarray, " i"]]:
    """Number of pixels, largest distance from the centroid, and pixels of each ring; the centre's is in ring 0."""
    rows, columns = mask.shape
    counts = np.zeros(int(np.hypot(rows, columns)) // RING + 2, dtype=np.int64)
    area, largest2 = 0, 0.0
    for i in range(rows):
        for j in range(columns):
            if mask[i, j]:
                distance2 = (i - row) ** 2 + (j - column) ** 2
                largest2 = max(largest2, distance2)
                counts[int(np.ceil(np.sqrt(distance2) / RING))] += 1
                area += 1
    return area, np.sqrt(largest2), counts


@kernel
def cut_core(mask: Bool[np.ndarray, "row column"], row: int, column: int, radius: int) -> None:
    """Turn off, in place, all pixels nearer than `radius` to the one at (row, column)."""
    for i in range(max(row - radius + 1, 0), min(row + radius, mask.shape[0])):
        reach = int(np.ceil(np.sqrt(radius**2 - (i - row) ** 2)))
        for j in range(max(column - reach + 1, 0), min(column + reach, mask.shape[1])):
            mask[i, j] = False


def _value(name: str, pixels: Pixels) -> float:
    return float(getattr(pixels.derived(measured), name))


def measured(pixels: Pixels) -> Li2024:
    """The statistics of a mask, measured once for all."""
    return li2024_statistics(pixels.colony)


def _entry(name: str, power: int, meaning: str, label: str, possible: Range | None = None) -> Statistic:
    """Registered as li2024_…, as `measure` has statistics of the same names."""
    value = partial(_value, name)
    return Statistic(f"li2024_{name}", power, meaning, label, mask=value, may_vanish=power == 0, possible=possible)


I_F, I_R, I_B = Range(0.0, 1 / 0.65), Range(-1.1 / 1.7), Range(-25 / 575)
"""What indices can be: of no area or all of it beyond the core, of r_max 0, and of no ends."""


ENTRIES = (
    _entry("csr_radius", 1, "radius of the core as Li et al. 2024 find it", "CSR radius"),
    _entry("filament_area_index", 0, "I_F of Li et al. 2024: share of area beyond the core, over 0.65", "I_F", I_F),
    _entry("filament_radius_index", 0, "I_R of Li et al. 2024: (r_max / r_CSR − 1.1) / 1.7", "I_R", I_R),
    _entry("branch_index", 0, "I_B of Li et al. 2024: (ends of a quadrant's skeleton − 25) / 575", "I_B", I_B),
)
"""As entries for the registry of statistics: with `register_statistic`, `measure` has them in its tables."""

PUBLISHED = ("li2024_filament_area_index", "li2024_filament_radius_index", "li2024_branch_index")
"""I_F, I_R and I_B, which Li et al. compare colonies in."""
