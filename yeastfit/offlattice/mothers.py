"""Which cell buds: the choice of a mother, anew for every attempt (Li et al. 2024, see `growth`).

A cell is eligible while its counter is below 4. Before the transition the mother is drawn uniformly from all eligible
cells. After it, with u₁, u₂, u₃ uniform on [0, 1), drawn for the attempt:

1. any eligible cell;
2. in place of it, from cell (n* + delay) N on and if u₃ ≥ p_a, an eligible pseudohyphal cell; before that cell and if
   u₃ < p_a, an eligible sated one;
3. in place of that, if it has a pseudohyphal daughter, u₂ > γ and u₁ > p_ps, an eligible cell of either form that has
   none: a filament goes on at its tip, not in its middle, unless it may fork.

u₁ also decides on the daughter's form (see `transition`). The counter starts at 1. Before the transition it counts how
often a cell was tried in place of another whose daughter found no place, whether or not its own did: births at the
first try are free, and the crowded middle of the colony retires. From the transition on it counts daughters.
"""

import numpy as np
from jaxtyping import Shaped

from yeastfit.compiled import kernel
from yeastfit.offlattice.cell_sets import (
    CHILDLESS,
    ELIGIBLE_PSEUDOHYPHAL,
    ELIGIBLE_SATED,
    Sets,
    eligible,
    member,
    remove,
)
from yeastfit.offlattice.fetching import fetch
from yeastfit.offlattice.overlap import SATED
from yeastfit.offlattice.parameters import Rates
from yeastfit.offlattice.random_numbers import Numbers, below, foreseen
from yeastfit.offlattice.status import CODES, Status

RETIRED = 4
NO_MOTHER = -CODES[Status.NO_MOTHER]
NO_SATED = -CODES[Status.NO_SATED_MOTHER]
NO_PSEUDOHYPHAL = -CODES[Status.NO_PSEUDOHYPHAL_MOTHER]
NO_CHILDLESS = -CODES[Status.NO_CHILDLESS_MOTHER]


@kernel
def any_eligible(sets: Sets, numbers: Numbers) -> int:
    """Step 1, by rank (`eligible`), as step 2 most often comes in its place; a negative code where there is none."""
    count = sets.size[ELIGIBLE_SATED] + sets.size[ELIGIBLE_PSEUDOHYPHAL]
    return below(numbers, count) if count > 0 else NO_MOTHER


@kernel
def after_transition(
    cells: Shaped[np.ndarray, " cell"],
    sets: Sets,
    numbers: Numbers,
    rank: int,
    u: tuple[float, float, float],
    delayed: bool,
    rates: Rates,
) -> int:
    """Steps 2 and 3 after step 1 drew `rank`; a negative code where there is none. delayed: before (n* + delay) N."""
    if not delayed and u[2] >= rates.any_mother:
        mother = _one_of(sets, ELIGIBLE_PSEUDOHYPHAL, numbers, NO_PSEUDOHYPHAL)
    elif delayed and u[2] < rates.any_mother:
        mother = _one_of(sets, ELIGIBLE_SATED, numbers, NO_SATED)
    else:
        mother = eligible(sets, rank)
    # the cell, which may have to come from memory, is asked last
    if mother >= 0 and u[1] > rates.fork and u[0] > rates.sated_from_pseudohyphal and cells[mother].bears:
        mother = _one_of(sets, CHILDLESS, numbers, NO_CHILDLESS)
    return mother


@kernel
def fetch_next(cells: Shaped[np.ndarray, " cell"], sets: Sets, numbers: Numbers) -> None:
    """Fetch the cells that the next attempt is likely to draw by steps 2 and 3, where there are lists of members.

    Those are drawn by its fifth and sixth number, after one for step 1 and u₁, u₂, u₃.
    """
    if sets.tree.shape[1] == 0:
        second, third = foreseen(numbers, 4)
        fetch(cells, member(sets, ELIGIBLE_PSEUDOHYPHAL, int(second * sets.size[ELIGIBLE_PSEUDOHYPHAL])))
        fetch(cells, member(sets, CHILDLESS, int(third * sets.size[CHILDLESS])))


@kernel
def count_on(cells: Shaped[np.ndarray, " cell"], sets: Sets, index: int) -> None:
    """Raise the counter of an eligible cell by one; a cell that retires leaves the sets."""
    cell = cells[index]
    cell.count += 1
    if cell.count == RETIRED:
        remove(sets, ELIGIBLE_SATED if cell.form == SATED else ELIGIBLE_PSEUDOHYPHAL, index)
        if not cell.bears:
            remove(sets, CHILDLESS, index)


@kernel
def bear_pseudohyphal(cells: Shaped[np.ndarray, " cell"], sets: Sets, index: int) -> None:
    """The cell has a pseudohyphal daughter."""
    cell = cells[index]
    if not cell.bears and cell.count < RETIRED:
        remove(sets, CHILDLESS, index)
    cell.bears = 1


@kernel
def _one_of(sets: Sets, which: int, numbers: Numbers, nobody: int) -> int:
    return member(sets, which, below(numbers, sets.size[which])) if sets.size[which] > 0 else nobody
