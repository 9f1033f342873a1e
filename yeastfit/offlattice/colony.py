"""Colonies of the off-lattice model: `grow` one, `grow_many` on several threads."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import isfinite
from numbers import Integral
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from yeastfit.errors import InputError
from yeastfit.numbers import AT_LEAST_ONE
from yeastfit.offlattice.cell_sets import empty_sets
from yeastfit.offlattice.growth import grow_cells
from yeastfit.offlattice.mothers import RETIRED
from yeastfit.offlattice.overlap import PSEUDOHYPHAL, empty_bins, empty_cells
from yeastfit.offlattice.parameters import Rates, in_range, rates_of
from yeastfit.offlattice.random_numbers import seeded, streamed
from yeastfit.offlattice.status import Status
from yeastfit.offlattice.transition import last_sated
from yeastfit.processors import available_processors
from yeastfit.seeds import check_seeds
from yeastfit.text import quoted

DELAY = 0.02
"""Share of all cells born between the transition and a preference for pseudohyphal mothers; 0.01 in their pictures."""

MOST_ATTEMPTS = 1_000_000
"""For one birth; on average it takes 3 to 13, and a colony whose cells are all walled in would try for ever."""

LARGEST = 2**31 - 1  # cells are numbered with 32 bits
NO_CELL = LARGEST  # the first cell of a pixel that none covers
BYTES_PER_CELL = 221  # at most: 32 of the cell, 24 of the sets, 37 of the result, 128 of the bins, mostly 60
LITTLE = 2**28  # bytes that are not asked for

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class OfflatticeColony:
    """A colony, its cells in order of birth; lengths in pixels of 1.548 µm (`placing.PIXELS_PER_UM`).

    Attributes:
        rates: The five parameters.
        cells: N, how many cells were asked for; all were born where `status` is GROWN.
        status: How growth ended.
        x: Centres.
        y: Centres.
        direction: Of the major axis, in multiples of π/16, not wrapped: the mother's plus the budding angle.
        pseudohyphal: The form of each cell; the others are sated.
        mother: Index of the mother, −1 for the first cell.
        can_bud: Whether it could still bud when growth ended.
        sated: Number t of the last cell before the transition.
        attempts: To place a daughter, in all.
        sated_attempts: Those for the cells up to number t.
        numbers_drawn: Uniform random numbers.
    """

    rates: Rates
    cells: int
    status: Status
    x: Float[np.ndarray, " cell"]
    y: Float[np.ndarray, " cell"]
    direction: Int[np.ndarray, " cell"]
    pseudohyphal: Bool[np.ndarray, " cell"]
    mother: Int[np.ndarray, " cell"]
    can_bud: Bool[np.ndarray, " cell"]
    sated: int
    attempts: int
    sated_attempts: int
    numbers_drawn: int

    @property
    def theta(self) -> Float[np.ndarray, " cell"]:
        """Directions in radians, not wrapped."""
        return np.pi / 16 * self.direction

    @property
    def message(self) -> str:
        """How growth ended, for a reader."""
        if self.status in (Status.GROWN, Status.OUTSIDE, Status.SINGLE, Status.TOO_LARGE):
            return self.status.value
        return f"after {self.x.size} of {self.cells} cells, {self.status.value}"


def grow(
    parameters: Mapping[str, float] | Sequence[float] | Float[np.ndarray, " parameter"],
    *,
    cells: int,
    seed: int = 0,
    delay: float = DELAY,
    most_attempts: int = MOST_ATTEMPTS,
    stream: Float[np.ndarray, " number"] | None = None,
) -> OfflatticeColony:
    """Grow one colony of N cells: the same one from the same arguments, in any batch and on any number of threads.

    Arguments:
        parameters: By name (see `parameters.PARAMETERS`), the rest at their defaults; or all five in order.
        cells: N.
        seed: 0 ≤ seed < 2⁶⁴.
        delay: Share of N by which pseudohyphal mothers come to be preferred later than the transition.
        most_attempts: For one birth.
        stream: Uniform numbers to use in place of the generator's; cells are then drawn in order of birth, as by the
            original program.

    Returns:
        The colony, with fewer cells than N where its `status` is not GROWN: a parameter outside [0, 1], N = 1, N beyond
        memory, a choice among no cells, too many attempts, and the end of the stream are told there.

    Raises:
        InputError: An unknown name, not five values, N below 1, a seed that is not a whole number of 64 bits, a
            negative delay, an empty stream; or numba is missing.
    """
    rates = rates_of(parameters)
    for name, count in (("cells", cells), ("most_attempts", most_attempts)):
        AT_LEAST_ONE.check_whole(count, name)
    if not isfinite(delay) or delay < 0:
        raise InputError(f"delay is {delay}, it must be a share of all cells of at least 0")
    numbers = seeded(seed) if stream is None else streamed(stream)
    if not in_range(rates):
        return _colony(rates, cells, Status.OUTSIDE, empty_cells(0))
    memory = cells * BYTES_PER_CELL
    if cells > LARGEST or (memory > LITTLE and memory > _free_memory()):
        return _colony(rates, cells, Status.TOO_LARGE, empty_cells(0))
    held, sated = empty_cells(cells), last_sated(rates.transition, cells)
    code, born, attempts, sated_attempts = grow_cells(
        rates,
        sated,
        (rates.transition + delay) * cells,
        most_attempts,
        numbers,
        held,
        empty_sets(cells, stream is not None),
        empty_bins(cells),
    )
    status = Status.SINGLE if cells == 1 else tuple(Status)[code]
    return _colony(rates, cells, status, held[:born], sated, attempts, sated_attempts, int(numbers.drawn[0]))


def grow_many(
    values: Float[np.ndarray, "row parameter"],
    seeds: Sequence[int] | Integer[np.ndarray, " row"],
    *,
    cells: int,
    delay: float = DELAY,
    most_attempts: int = MOST_ATTEMPTS,
    threads: int | None = None,
) -> list[OfflatticeColony]:
    """Grow a colony for each row of five values and seed, on several threads.

    Arguments:
        values: The five parameters in order, one row a colony.
        seeds: One a colony.
        cells: N of all colonies.
        delay: See `grow`.
        most_attempts: See `grow`.
        threads: How many colonies grow at a time; None for as many as there are processors to use.

    Returns:
        What `grow` gives for each row, in order, whatever the number of threads.

    Raises:
        InputError: As `grow`; or there are not as many seeds as rows.
    """
    each = check_seeds(seeds)
    if len(values) != len(each):
        raise InputError(f"got {len(values)} rows of values and {len(each)} seeds, need a seed for each row")

    def one(row: int) -> OfflatticeColony:
        return grow(values[row], cells=cells, seed=each[row], delay=delay, most_attempts=most_attempts)

    return in_threads(one, range(len(values)), threads)


def in_threads(function: Callable[[Item], Result], items: Iterable[Item], threads: int | None) -> list[Result]:
    """Call a function with each item; results in order. Kernels release the interpreter's lock: threads run at once."""
    if threads is not None and not (isinstance(threads, Integral) and threads >= 1):
        raise InputError(f"threads is {quoted(threads)}, it must be a whole number of at least 1, or None")
    with ThreadPoolExecutor(int(threads or available_processors())) as pool:
        return list(pool.map(function, items))


def _colony(
    rates: Rates,
    asked: int,
    status: Status,
    cells: np.ndarray,
    sated: int = 0,
    attempts: int = 0,
    sated_attempts: int = 0,
    numbers_drawn: int = 0,
) -> OfflatticeColony:
    """From the kernel's records of its cells."""
    columns = {name: cells[name].copy() for name in ("x", "y", "direction", "mother")}
    columns |= {"pseudohyphal": cells["form"] == PSEUDOHYPHAL, "can_bud": cells["count"] < RETIRED}
    for column in columns.values():
        column.flags.writeable = False
    return OfflatticeColony(
        rates=rates,
        cells=asked,
        status=status,
        sated=sated,
        attempts=attempts,
        sated_attempts=sated_attempts,
        numbers_drawn=numbers_drawn,
        **columns,
    )


def _free_memory() -> int:
    """Bytes that can be had without swapping, as Linux estimates them; elsewhere all that the machine has."""
    status = Path("/proc/meminfo")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
