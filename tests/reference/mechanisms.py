"""The further mechanisms in plain NumPy and SciPy, from their equations; what is random is given."""

# mypy: disable-error-code="import-untyped"

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, optimize, sparse, special

from reference.colony import Floats, Ints

# --- budding -------------------------------------------------------------------------------------------------------


def mixed_angle(uniform: float, axis: float, concentration: float, share: float = 1.0) -> float:
    """The angle that a uniform one becomes when a share of all is drawn to an axis: equal shares of the circle below.

    Shares are counted from the point opposite to the axis, counterclockwise.
    """

    def density(t: float) -> float:
        peak = math.exp(concentration * (math.cos(t) - 1)) / (2 * math.pi * special.ive(0, concentration))
        return share * peak + (1 - share) / (2 * math.pi)

    def below(t: float) -> float:
        return float(0.5 + integrate.quad(density, 0.0, t, epsabs=1e-13, epsrel=1e-12, limit=200)[0])

    u = ((uniform - axis) / (2 * math.pi) + 0.5) % 1.0
    return axis + float(optimize.brentq(lambda t: below(t) - u, -math.pi, math.pi, xtol=1e-13))


# --- death ---------------------------------------------------------------------------------------------------------


def without(positions: Floats, parents: Ints, gone: NDArray[np.bool_]) -> tuple[Floats, Ints]:
    """Nodes that are left, in order, and the tree: whoever has lost its parent has none."""
    left = [node for node in range(len(parents)) if not gone[node]]
    number = {node: place for place, node in enumerate(left)}
    return positions[left], np.array([number.get(int(parents[node]), -1) for node in left], dtype=np.int64)


# --- detachment ----------------------------------------------------------------------------------------------------


def networks(parents: Ints) -> int:
    """Connected components of the graph of nodes and their parents."""
    joined = np.flatnonzero(parents >= 0)
    graph = sparse.coo_array((np.ones(len(joined)), (joined, parents[joined])), shape=(len(parents),) * 2)
    return int(sparse.csgraph.connected_components(graph, directed=False)[0])


# --- births --------------------------------------------------------------------------------------------------------


def patch_parents(positions: Floats, fed: Floats, side: float, least: float = 0.0) -> list[int]:
    """Who buds at an event, by patches: quotas, whole parts, largest remainders, the best fed first."""
    patches: dict[tuple[int, int], list[int]] = defaultdict(list)
    for node, (x, y) in enumerate(positions):
        if fed[node] >= least:
            patches[math.floor(x / side + 0.5), math.floor(y / side + 0.5)].append(node)
    quotas = {place: min(math.expm1(float(np.mean(fed[nodes]))), 1.0) * len(nodes) for place, nodes in patches.items()}
    buds = {place: math.floor(quota) for place, quota in quotas.items()}
    left = math.ceil(sum(quotas.values())) - sum(buds.values())
    for place in sorted(quotas, key=lambda place: (buds[place] - quotas[place], place))[:left]:
        buds[place] += 1
    chosen = [node for place, nodes in patches.items() for node in sorted(nodes, key=lambda n: -fed[n])[: buds[place]]]
    return sorted(chosen, key=lambda node: -fed[node])


def clock_step(phases: Floats, lengths: Floats, fed: Floats, dt: float, least: float = 0.0) -> tuple[Floats, Ints]:
    """Phases of all nodes a step later, those of the newborn at the end, and their mothers."""
    later = phases + dt * fed
    ripe = np.flatnonzero((later >= lengths) & (fed >= least))
    for node in ripe:  # of a node that has waited, no more than this step counts for the next cycle
        later[node] = min(later[node] - lengths[node], dt * fed[node])
    return np.append(later, later[ripe]), ripe


def euler_lotka(variation: float) -> float:
    """r of 2 E[e^(−rΨ)] = 1, log Ψ normal about log(ln 2) with σ² = log(1 + v²)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    lengths = math.log(2) * np.exp(math.sqrt(math.log1p(variation**2)) * nodes)
    share = weights / weights.sum()
    return float(optimize.brentq(lambda r: 2 * np.sum(share * np.exp(-r * lengths)) - 1, 0.1, 5.0))


# --- shapes of cells -----------------------------------------------------------------------------------------------


def superellipse_level(x: Floats, y: Floats, ends: Floats, ratio: float, exponent: float) -> Floats:
    """(|u/p|^n + |v/q|^n)^(2/n) - 1 at points, of the cell between two nodes."""
    (ax, ay), (bx, by) = ends
    p, angle = 0.5 * math.hypot(bx - ax, by - ay), math.atan2(by - ay, bx - ax)
    dx, dy = x - 0.5 * (ax + bx), y - 0.5 * (ay + by)
    u, v = dx * math.cos(angle) + dy * math.sin(angle), dy * math.cos(angle) - dx * math.sin(angle)
    total = np.abs(u / p) ** exponent + np.abs(v / (ratio * p)) ** exponent
    return np.asarray(total ** (2 / exponent) - 1)


def superellipse_area(p: float, q: float, exponent: float) -> float:
    """4 p q Gamma(1 + 1/n)^2 / Gamma(1 + 2/n)."""
    return float(4 * p * q * special.gamma(1 + 1 / exponent) ** 2 / special.gamma(1 + 2 / exponent))


# --- contact between cells -----------------------------------------------------------------------------------------


def cell_overlap(ends: Floats, ratio: float, union: float, boundary: float, points: int = 400) -> float:
    """The integral of 1/2 + 1/2 tanh(-f / K), f the smooth maximum of two ellipses between ends 0, 1 and 2, 3."""
    low, high = ends.min(axis=0) - 1, ends.max(axis=0) + 1
    x, y = np.linspace(low, high, points).T
    across, up = np.meshgrid(x, y, indexing="ij")
    first, second = (superellipse_level(across, up, two, ratio, 2.0) for two in (ends[:2], ends[2:]))
    f = union * np.logaddexp(first / union, second / union)
    return float(np.sum(0.5 + 0.5 * np.tanh(-f / boundary)) * (x[1] - x[0]) * (y[1] - y[0]))


def lens_area(radius: float, distance: float) -> float:
    """Where two circles of one radius overlap."""
    half = distance / 2
    return 2 * (radius**2 * math.acos(half / radius) - half * math.sqrt(radius**2 - half**2))


# --- media ---------------------------------------------------------------------------------------------------------


def closed_step(field: Floats, rate: Floats, source: Floats, diffusivity: float, spacing: float, dt: float) -> Floats:
    """Crank-Nicolson of dc/dt = D lap c - b c + s, no flux: squares that exchange with those beside them."""
    points = len(field)
    line = sparse.diags_array([np.ones(points - 1), np.ones(points - 1)], offsets=[-1, 1])
    line = line - sparse.diags_array(np.asarray(line.sum(axis=0)).ravel())
    eye = sparse.eye_array(points)
    flow = diffusivity / spacing**2 * (sparse.kron(line, eye) + sparse.kron(eye, line)) - sparse.diags_array(
        rate.ravel()
    )
    left, right = (sparse.eye_array(points**2) + sign * dt / 2 * flow for sign in (-1, 1))
    new = sparse.linalg.spsolve(left.tocsc(), right @ field.ravel() + dt * source.ravel())
    return np.asarray(new.reshape(field.shape))


def nitrogen_births(wanted: list[float], held: float, cost: float) -> list[int]:
    """Children at each event, of those asked for, in a dish that holds so much nitrogen: one by one while it lasts."""
    born = []
    for asked in wanted:
        children = 0
        while children < asked and held >= cost:
            held, children = held - cost, children + 1
        born.append(children)
    return born


# --- collocated nodes ----------------------------------------------------------------------------------------------


def divided(spring: Ints, together: Ints, first: int, size: int) -> None:
    """A and C after the group [first, first + size) was halved, in place: appendix A.1."""
    half = size // 2
    lower, upper = slice(first, first + half), slice(first + half, first + size)
    together[lower, upper] = together[upper, lower] = 0
    for n in range(first, first + half):
        spring[n, n + half] = spring[n + half, n] = 1


def collocated_pull(x: Floats, spring: Ints, together: Ints) -> Floats:
    """The mean force on every node's group: springs of rest length 1 where A and not C."""
    force = np.zeros_like(x)
    for n, m in np.argwhere((spring == 1) & (together == 0)):
        apart = x[n] - x[m]
        length = math.hypot(*apart)
        force[n] += (1 - length) * apart / length
    return np.asarray(together @ force / together.sum(axis=1, keepdims=True))
