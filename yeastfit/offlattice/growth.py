"""Growth of a colony, cell by cell.

Source: Li, Green, Tronnolone, Tam, Black, Gardner, Sundstrom, Jiranek & Binder 2024, "An off-lattice discrete model to
characterise filamentous yeast colony morphology", PLoS Comput. Biol. 20, bioRxiv doi:10.1101/2024.07.14.603473, and its
program github.com/kaili2019/Li2024-off-lattice, file ABC-MCMC/simulate_colony.m.

A cell is an ellipse that neither moves nor grows nor dies: sated (the yeast form) or pseudohyphal. The first is sated,
at the origin, along x. Cells 2 … N are born one by one. Each birth repeats attempts until one is accepted: a mother is
chosen (`mothers`), the daughter's form follows from hers (`transition`), one of four budding angles is drawn and the
daughter put (`placing`), and it stays if its centre lies in no cell (`overlap`). There is no time, nutrient or force:
the clock is the number of cells. Uniform numbers are used in the program's order: the mother; after the transition u₁,
u₂, u₃, and another mother by each of steps 2 and 3 that asks for one; the angle.

A mother has six places for daughters. One in which a daughter's centre would lie in a cell stays taken for good, which
a bit of the mother's tells: a third of all attempts end there, and half of those in a colony of a million cells.
Otherwise, before the place is tested, the next attempt is drawn, while the cells around it come from memory. Where the
place is free those numbers are drawn again for the next birth.
"""

import numpy as np
from jaxtyping import Shaped

from yeastfit.compiled import inlined_kernel, kernel
from yeastfit.offlattice.cell_sets import CHILDLESS, ELIGIBLE_PSEUDOHYPHAL, ELIGIBLE_SATED, Sets, add, eligible
from yeastfit.offlattice.mothers import after_transition, any_eligible, bear_pseudohyphal, count_on, fetch_next
from yeastfit.offlattice.overlap import PSEUDOHYPHAL, SATED, bins_around, free, insert
from yeastfit.offlattice.parameters import Rates
from yeastfit.offlattice.placing import BUDDING, DISPLACEMENTS, PLACES
from yeastfit.offlattice.random_numbers import Numbers, below, place, return_to, uniform
from yeastfit.offlattice.status import CODES, Status
from yeastfit.offlattice.transition import daughters_form

NOBODY = -1
GROWN, ENDLESS, STREAM_ENDED = (CODES[s] for s in (Status.GROWN, Status.ENDLESS, Status.STREAM_ENDED))


@kernel
def grow_cells(
    rates: Rates,
    sated: int,
    late: float,
    most_attempts: int,
    numbers: Numbers,
    cells: Shaped[np.ndarray, " cell"],
    sets: Sets,
    bins: Shaped[np.ndarray, "row column"],
) -> tuple[int, int, int, int]:
    """Fill `cells`; how it ended (one of `CODES`), cells born, attempts, and attempts up to cell number `sated`.

    sated: t, the number of the last cell before the transition. late: (n* + delay) N. sets, bins: empty ones.
    """
    _bear(cells, sets, bins, 0, NOBODY, SATED, 0.0, 0.0, 0)
    attempts = sated_attempts = 0
    for index in range(1, cells.size):
        number, tried = index + 1, 1
        mother, form, angle, x, y = _attempt(cells, sets, numbers, number, sated, late, rates)
        while True:
            if mother < 0:
                return -mother, index, attempts + tried, sated_attempts
            if number < sated and tried > 1:
                count_on(cells, sets, mother)
            if numbers.drawn[0] > numbers.stream.size > 0:
                return STREAM_ENDED, index, attempts + tried, sated_attempts
            if cells[mother].taken & PLACES[form, angle]:
                if tried == most_attempts:
                    return ENDLESS, index, attempts + tried, sated_attempts
                mother, form, angle, x, y = _attempt(cells, sets, numbers, number, sated, late, rates)
                tried += 1
                continue
            cells[mother].taken |= PLACES[form, angle]  # by a cell that is there, or by the daughter
            around, here = bins_around(x, y, bins), place(numbers)
            following = _attempt(cells, sets, numbers, number, sated, late, rates)
            if free(x, y, cells, bins, around):
                return_to(here, numbers)
                break
            if tried == most_attempts:
                return_to(here, numbers)
                return ENDLESS, index, attempts + tried, sated_attempts
            mother, form, angle, x, y = following
            tried += 1
        attempts += tried
        if number <= sated:
            sated_attempts = attempts
        _bear(cells, sets, bins, index, mother, form, x, y, cells[mother].direction + BUDDING[form, angle])
        if number >= sated:
            count_on(cells, sets, mother)
        if form == PSEUDOHYPHAL:
            bear_pseudohyphal(cells, sets, mother)
    return GROWN, cells.size, attempts, sated_attempts


@inlined_kernel
def _attempt(
    cells: Shaped[np.ndarray, " cell"],
    sets: Sets,
    numbers: Numbers,
    number: int,
    sated: int,
    late: float,
    rates: Rates,
) -> tuple[int, int, int, float, float]:
    """Draw a mother, and her daughter's form, angle and place; the mother is a negative code where there is none."""
    rank = any_eligible(sets, numbers)
    if rank < 0:
        return rank, SATED, 0, 0.0, 0.0
    if number <= sated:
        mother, form = eligible(sets, rank), SATED
    else:
        u = uniform(numbers), uniform(numbers), uniform(numbers)
        mother = after_transition(cells, sets, numbers, rank, u, number < late, rates)
        if mother < 0:
            return mother, SATED, 0, 0.0, 0.0
        form = daughters_form(cells[mother].form, cells[mother].bears, u[0], rates)
    angle = below(numbers, 4)
    if number >= late:
        fetch_next(cells, sets, numbers)
    step = DISPLACEMENTS[cells[mother].form, form, angle, cells[mother].direction & 31]
    return mother, form, angle, cells[mother].x + step[0], cells[mother].y + step[1]


@kernel
def _bear(
    cells: Shaped[np.ndarray, " cell"],
    sets: Sets,
    bins: Shaped[np.ndarray, "row column"],
    index: int,
    mother: int,
    form: int,
    x: float,
    y: float,
    direction: int,
) -> None:
    """A new cell, which can bud at once."""
    cell = cells[index]
    cell.x, cell.y, cell.direction = x, y, direction
    cell.mother, cell.form, cell.count, cell.bears, cell.taken = mother, form, 1, 0, 0
    insert(index, cells, bins)
    add(sets, ELIGIBLE_SATED if form == SATED else ELIGIBLE_PSEUDOHYPHAL, index)
    add(sets, CHILDLESS, index)
