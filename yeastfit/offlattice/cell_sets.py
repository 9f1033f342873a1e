"""Sets of cells out of which one is drawn, in a time that does not depend on their size.

There are two ways to number the members of a set. As a list: a new member comes last, and the last one takes the place
of one that leaves. By order of birth: a Fenwick tree (Fenwick 1994, "A new data structure for cumulative frequency
tables", Softw. Pract. Exp. 24:327, doi:10.1002/spe.4380240306), whose node k counts the members among the lowest-bit(k)
cells up to the k-th, so that the r-th is found in log₂ N steps. Drawing a rank uniformly draws a member uniformly in
both; the tree is for comparing colonies with another program's number by number.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from yeastfit.compiled import kernel

ELIGIBLE_SATED, ELIGIBLE_PSEUDOHYPHAL, CHILDLESS = 0, 1, 2
"""Cells that can bud, by form (SATED and PSEUDOHYPHAL), and those of both that have no pseudohyphal daughter."""


class Sets(NamedTuple):
    """The three sets; `member` and `place` are empty where there is a tree, and the tree where there are lists."""

    size: Int[np.ndarray, " set"]
    member: Int[np.ndarray, "set cell"]
    place: Int[np.ndarray, "set cell"]
    tree: Int[np.ndarray, "set node"]


def empty_sets(cells: int, by_birth: bool) -> Sets:
    """For so many cells."""
    lists, nodes = (0, 1 << (cells - 1).bit_length()) if by_birth else (cells, 0)
    member, place = (np.zeros((3, lists), dtype=np.int32) for _ in range(2))
    return Sets(np.zeros(3, dtype=np.int64), member, place, np.zeros((3, nodes), dtype=np.int32))


@kernel
def add(sets: Sets, which: int, cell: int) -> None:
    """A new member."""
    size = sets.size[which]
    sets.size[which] = size + 1
    if sets.tree.shape[1] > 0:
        _change(sets.tree[which], cell, 1)
    else:
        sets.member[which, size] = cell
        sets.place[which, cell] = size


@kernel
def remove(sets: Sets, which: int, cell: int) -> None:
    """A member leaves."""
    last = sets.size[which] - 1
    sets.size[which] = last
    if sets.tree.shape[1] > 0:
        _change(sets.tree[which], cell, -1)
    else:
        place = sets.place[which, cell]
        mover = sets.member[which, last]
        sets.member[which, place] = mover
        sets.place[which, mover] = place


@kernel
def member(sets: Sets, which: int, rank: int) -> int:
    """The member of this rank, from 0."""
    if sets.tree.shape[1] == 0:
        return sets.member[which, rank]
    tree = sets.tree[which]
    cell, step = 0, tree.size // 2
    while step > 0:
        if tree[cell + step - 1] <= rank:
            rank -= tree[cell + step - 1]
            cell += step
        step //= 2
    return cell


@kernel
def eligible(sets: Sets, rank: int) -> int:
    """The cell of this rank, from 0, among all that can bud: the union of the first two sets."""
    sated = sets.size[ELIGIBLE_SATED]
    if sets.tree.shape[1] == 0:
        return sets.member[0, rank] if rank < sated else sets.member[1, rank - sated]
    cell, step = 0, sets.tree.shape[1] // 2
    while step > 0:
        held = sets.tree[0, cell + step - 1] + sets.tree[1, cell + step - 1]
        if held <= rank:
            rank -= held
            cell += step
        step //= 2
    return cell


@kernel
def _change(tree: Int[np.ndarray, " node"], cell: int, change: int) -> None:
    node = cell + 1
    while node <= tree.size:
        tree[node - 1] += change
        node += node & -node
