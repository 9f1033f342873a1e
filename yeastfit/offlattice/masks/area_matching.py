"""How many of a colony's first cells cover a given area: by Li et al.'s search from below, or exactly.

Their search (2024, run_off_lattice), with A* the area given and A_N that of all N cells: if A_N ≤ A*, keep all. Else

    g = A*/A_N − 0.1
    repeat  n = round(g N), the mask of the first n cells
            stop if 0.95 A* < area < 1.05 A*
            g ← g + 0.025
    until   g ≥ 1.

It comes from below, so areas kept are 0.95 to 0.98 of A*, on average 0.975. No colony is rejected: one that misses both
bounds is kept as the last mask shows it. As more cells cover more, masks of fewer than one that is too small need not
be looked at: most often the fourth and one beside it are, and no others.

Exactly, n is between two numbers of cells whose areas are below A* and not, and is looked for where a straight line
between both areas crosses A*, the end that stays for long counting half (the Illinois method: Dowell & Jarratt 1971,
doi:10.1007/BF01934364). Of 40 000 cells that takes 5 to 11 masks; bisection takes 17.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import ceil, floor, isfinite

import numpy as np
from jaxtyping import Bool

from yeastfit.errors import InputError

TOLERANCE = 0.05
START, STEP = 0.1, 0.025
LIKELY = 3  # steps after which most colonies match

MaskOf = Callable[[int], Bool[np.ndarray, "row column"]]


class Match(Enum):
    """How the search ended; the value is what a reader is told."""

    MATCHED = "the area is matched"
    UNREACHED = "all cells together cover no more than the area: all are kept"
    MISSED = "the search ended more than 5 % off the area"


@dataclass(frozen=True, eq=False)
class MatchedMask:
    """The first `cells` cells, their mask, its area in pixels, and how the search ended."""

    cells: int
    mask: Bool[np.ndarray, "row column"]
    area: int
    match: Match


def search_from_below(mask_of: MaskOf, cells: int, area: float) -> MatchedMask:
    """Match an area as Li et al. do.

    Arguments:
        mask_of: The mask of so many first cells, which must not cover less the more they are.
        cells: How many there are.
        area: A*, pixels.

    Returns:
        The cells kept and their mask; its `match` tells an area that all cells do not reach, and one that was missed.

    Raises:
        InputError: The area is not a finite number above 0.
    """
    _check(area)
    mask = mask_of(cells)
    covered = int(np.count_nonzero(mask))
    if covered <= area:
        return MatchedMask(cells, mask, covered, Match.UNREACHED)
    shares = [area / covered - START]
    while shares[-1] + STEP < 1:
        shares.append(shares[-1] + STEP)

    def looked_at(step: int) -> MatchedMask:
        kept = max(0, floor(shares[step] * cells + 0.5))
        mask = mask_of(kept)
        covered = int(np.count_nonzero(mask))
        matched = (1 - TOLERANCE) * area < covered < (1 + TOLERANCE) * area
        return MatchedMask(kept, mask, covered, Match.MATCHED if matched else Match.MISSED)

    least, step = (1 - TOLERANCE) * area, min(LIKELY, len(shares) - 1)
    found = looked_at(step)
    if found.area > least:
        while step > 0 and (below := looked_at(step - 1)).area > least:
            found, step = below, step - 1
    while found.area <= least and step < len(shares) - 1:
        step += 1
        found = looked_at(step)
    return found if found.match is Match.MATCHED or step == len(shares) - 1 else looked_at(len(shares) - 1)


def match_exactly(mask_of: MaskOf, cells: int, area: float) -> MatchedMask:
    """Keep the first cells with which the area reaches A*: it is off by less than the last cell adds, gaps included.

    Arguments:
        mask_of: The mask of so many first cells.
        cells: How many there are.
        area: A*, pixels.

    Returns:
        The cells kept and their mask; its `match` tells an area that all cells do not reach.

    Raises:
        InputError: The area is not a finite number above 0.
    """
    _check(area)
    mask = mask_of(cells)
    covered = int(np.count_nonzero(mask))
    if covered < area:
        return MatchedMask(cells, mask, covered, Match.UNREACHED)
    too_few, enough = 0, cells
    missing, over, side = area, covered - area, 0
    while enough - too_few > 1:
        share = missing / (missing + over) if over > 0 else 0.5
        kept = min(max(too_few + ceil(share * (enough - too_few)), too_few + 1), enough - 1)
        tried = mask_of(kept)
        more = np.count_nonzero(tried) - area
        if more >= 0:
            missing, over = missing / 2 if side > 0 else missing, more
            enough, mask, side = kept, tried, 1
        else:
            missing, over = -more, over / 2 if side < 0 else over
            too_few, side = kept, -1
    return MatchedMask(enough, mask, int(np.count_nonzero(mask)), Match.MATCHED)


def _check(area: float) -> None:
    if not isfinite(area) or area <= 0:
        raise InputError(f"area is {area}, it must be a finite number of pixels above 0")
