"""The off-lattice model of Li et al. 2024 in plain NumPy: every attempt scans all cells, as the original program does.

Written from the description of the rules, for clarity, with angles in radians and polygons by their vertices; it shares
no code with the package. Uniform numbers are consumed in the order of the MATLAB program, cells listed by birth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PX_PER_UM = 323 / 500
SEMI_MAJOR = (4.2 * PX_PER_UM, 6.7 * PX_PER_UM)  # sated, pseudohyphal
SEMI_MINOR = (3.0 * PX_PER_UM, 1.9 * PX_PER_UM)
BETA_SATED, BETA_PSEUDO = 7 * math.pi / 16, math.pi / 16


class CameToNothing(Exception):
    """A choice among no cells."""


@dataclass
class Colony:
    """Cells in order of birth, and what it took."""

    x: Floats
    y: Floats
    theta: Floats
    pseudo: NDArray[np.bool_]
    mother: NDArray[np.int64]
    tries: NDArray[np.int64]  # the counter that starts at 1; a parent while below 4
    pseudo_daughters: NDArray[np.int64]
    attempts: int


def grow(
    parameters: tuple[float, float, float, float, float], cells: int, rand: Callable[[], float], delay: float = 0.02
) -> Colony:
    """A colony; `rand` gives the uniform numbers one by one."""
    n_star, p_ps, p_sp, gamma, p_a = parameters
    t = math.floor(n_star * cells + 0.5)
    x, y, theta = np.zeros(cells), np.zeros(cells), np.zeros(cells)
    pseudo = np.zeros(cells, dtype=bool)
    mother = np.full(cells, -1)
    c, k = np.ones(cells, dtype=int), np.zeros(cells, dtype=int)
    attempts = 0

    for i in range(2, cells + 1):  # the number of the cell that is being born
        there = np.arange(i - 1)
        first = True
        while True:
            attempts += 1
            parents = there[c[: i - 1] < 4]
            m = pick(parents, rand)
            is_pseudo = False
            if i > t:
                u1, u2, u3 = rand(), rand(), rand()
                if i >= (n_star + delay) * cells and u3 >= p_a:
                    m = pick(parents[pseudo[parents]], rand)
                if i < (n_star + delay) * cells and u3 < p_a:
                    m = pick(parents[~pseudo[parents]], rand)
                if u2 > gamma and k[m] != 0 and u1 > p_ps:
                    m = pick(parents[k[parents] == 0], rand)
                if not pseudo[m]:
                    is_pseudo = u1 < p_sp
                elif k[m] == 0:
                    is_pseudo = True
                else:
                    is_pseudo = not u1 < p_ps
            elif i < t and not first:
                c[m] += 1
            first = False
            if is_pseudo:
                beta = (BETA_PSEUDO, -BETA_PSEUDO, BETA_PSEUDO, -BETA_PSEUDO)[math.floor(4 * rand())]
            else:
                beta = (BETA_SATED, -BETA_SATED, math.pi + BETA_SATED, math.pi - BETA_SATED)[math.floor(4 * rand())]
            new_x, new_y = place(x[m], y[m], theta[m], pseudo[m], beta, is_pseudo)
            if not covered(new_x, new_y, x[: i - 1], y[: i - 1], theta[: i - 1], pseudo[: i - 1]):
                break
        x[i - 1], y[i - 1], theta[i - 1] = new_x, new_y, theta[m] + beta
        pseudo[i - 1], mother[i - 1] = is_pseudo, m
        if i >= t:
            c[m] += 1
        if is_pseudo:
            k[m] += 1
    return Colony(x, y, theta, pseudo, mother, c, k, attempts)


def pick(choices: NDArray[np.int64], rand: Callable[[], float]) -> int:
    """One of them, each as likely."""
    if not choices.size:
        raise CameToNothing
    return int(choices[math.floor(choices.size * rand())])


def place(
    x: float, y: float, theta: float, mother_pseudo: bool, beta: float, daughter_pseudo: bool
) -> tuple[float, float]:
    """The daughter's centre: its near pole touches the mother's outline at the parametric angle φ."""
    a_m, b_m = SEMI_MAJOR[int(mother_pseudo)], SEMI_MINOR[int(mother_pseudo)]
    a = SEMI_MAJOR[int(daughter_pseudo)]
    phi = beta + math.atan((a_m - b_m) * math.tan(beta)) / (b_m + a_m * math.tan(beta) ** 2)
    touch_x = x + a_m * math.cos(phi) * math.cos(theta) - b_m * math.sin(phi) * math.sin(theta)
    touch_y = y + a_m * math.cos(phi) * math.sin(theta) + b_m * math.sin(phi) * math.cos(theta)
    return touch_x + a * math.cos(beta + theta), touch_y + a * math.sin(beta + theta)


def vertices(x: Floats, y: Floats, theta: Floats, pseudo: NDArray[np.bool_]) -> Floats:
    """The 12-gons [cell, vertex, 2], counter-clockwise."""
    phi = np.arange(12) * np.pi / 6
    along = np.where(pseudo, SEMI_MAJOR[1], SEMI_MAJOR[0])[:, None] * np.cos(phi)
    across = np.where(pseudo, SEMI_MINOR[1], SEMI_MINOR[0])[:, None] * np.sin(phi)
    cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
    return np.stack([x[:, None] + along * cos - across * sin, y[:, None] + along * sin + across * cos], axis=2)


def covered(px: float, py: float, x: Floats, y: Floats, theta: Floats, pseudo: NDArray[np.bool_]) -> bool:
    """Whether the point lies in a 12-gon: on the left of all its edges, or on one."""
    near = np.hypot(x - px, y - py) <= 3 * SEMI_MAJOR[0]  # as the program: the others are too far to hold it
    corners = vertices(x[near], y[near], theta[near], pseudo[near])
    edges = np.roll(corners, -1, axis=1) - corners
    to_point = np.array([px, py]) - corners
    left = edges[..., 0] * to_point[..., 1] - edges[..., 1] * to_point[..., 0]
    return bool((left >= -1e-12).all(axis=1).any())
