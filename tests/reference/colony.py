"""The hard colony model of docs/model.md, sections 1 to 4, in double precision with NumPy and SciPy only.

It is written from the equations, for clarity, and shares no code with the package. Equation numbers are the
source's, as in docs/model.md. All quantities are dimensionless. Fields are indexed [ix, iy] on the grid points
x_i = -L/2 + i h, i = 0 .. L/h, boundary included; the nutrient, the level set and the biomass share them.
"""

# mypy: disable-error-code="import-untyped"

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg
from skimage.measure import perimeter as pixel_perimeter

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
AngleOf = Callable[[int, Ints], Floats]

CG_TOLERANCE = 1e-12
# Exact ties are common (the two first nodes see equal nutrient by symmetry) and the solver's noise would order
# them at random, so nutrients closer than this count as equal. Zero gives the plain sort.
TIE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Parameters:
    """lambda_1 .. lambda_7 of docs/model.md, section 1, in that order."""

    diffusivity: float = 0.1
    elasticity: float = 5.0
    repulsivity: float = 5.0
    repulsion_radius: float = 0.5
    mobility: float = 1.0
    metabolic_rate: float = 1.0
    aspect_ratio: float = 0.7

    def __post_init__(self) -> None:
        if not 0.0 < self.aspect_ratio <= 1.0:
            raise ValueError(f"aspect_ratio must lie in (0, 1], got {self.aspect_ratio}")


@dataclass(frozen=True)
class Numerics:
    """Domain side L, grid spacing h, time step, node capacity, budding distance delta, and steps of motion a step."""

    domain: float = 40.0
    spacing: float = 0.1
    dt: float = 0.02
    capacity: int = 500
    bud_distance: float = 0.01
    substeps: int = 1

    def __post_init__(self) -> None:
        intervals = self.domain / self.spacing
        if abs(intervals - round(intervals)) > 1e-9 * intervals or round(intervals) < 2:
            raise ValueError(f"domain {self.domain} must be a multiple (at least 2) of spacing {self.spacing}")
        if self.dt <= 0.0:
            raise ValueError(f"dt must be positive, got {self.dt}")
        if self.capacity < 2:
            raise ValueError(f"capacity must hold the two first nodes, got {self.capacity}")

    @property
    def intervals(self) -> int:
        """L/h."""
        return round(self.domain / self.spacing)

    @property
    def size(self) -> int:
        """Grid points along a side, L/h + 1."""
        return self.intervals + 1

    @property
    def grid(self) -> Floats:
        """The grid coordinates x_i = -L/2 + i h of either axis."""
        return np.asarray(-0.5 * self.domain + self.spacing * np.arange(self.size), dtype=np.float64)

    @property
    def event_interval(self) -> int:
        """Steps from one mitosis event to the next, ceil(1/dt)."""
        # 1/dt may land an ulp above the integer that is meant, and a bare ceil would then skip one step.
        return math.ceil((1.0 / self.dt) * (1.0 - 1e-12))


@dataclass
class Colony:
    """The state: nodes, their tree, the nutrient, the number of steps taken, and the parents of every past event.

    `parents[k]` is the parent of node k, -1 for node 0. `births[e - 1]` lists the parents chosen at event e, in
    order of decreasing nutrient; their children were appended in that order.
    """

    positions: Floats
    parents: Ints
    nutrient: Floats
    step: int = 0
    births: list[Ints] = field(default_factory=list)


def start(numerics: Numerics, angle: float) -> Colony:
    """Equations 2.9 and 2.11: c = 1, and two nodes at +(1/2)(cos, sin) (node 0) and -(1/2)(cos, sin) (node 1)."""
    half = 0.5 * np.array([math.cos(angle), math.sin(angle)])
    return Colony(
        positions=np.array([half, -half]),
        parents=np.array([-1, 0], dtype=np.int64),
        nutrient=np.ones((numerics.size, numerics.size)),
    )


# --- fields at the nodes -----------------------------------------------------------------------------------------


def require_inside(positions: Floats, numerics: Numerics) -> None:
    """Raise ValueError if a node lies outside [-L/2, L/2]^2 or is not finite."""
    inside = np.all(np.abs(positions) <= 0.5 * numerics.domain, axis=1)
    if not np.all(inside):
        node = int(np.argmin(inside))
        x, y = positions[node]
        raise ValueError(f"node {node} left the domain: ({x:g}, {y:g}) with side {numerics.domain:g}")


def sample(values: Floats, positions: Floats, numerics: Numerics) -> Floats:
    """Bilinear interpolation of a grid field at the nodes."""
    require_inside(positions, numerics)
    scaled = (positions + 0.5 * numerics.domain) / numerics.spacing
    # A node on the far edge belongs to the last square, not to one beyond it.
    corner = np.clip(np.floor(scaled).astype(np.int64), 0, numerics.intervals - 1)
    ix, iy = corner.T
    s, t = (scaled - corner).T
    lower = (1.0 - s) * values[ix, iy] + s * values[ix + 1, iy]
    upper = (1.0 - s) * values[ix, iy + 1] + s * values[ix + 1, iy + 1]
    return np.asarray((1.0 - t) * lower + t * upper)


def sample_gradient(values: Floats, positions: Floats, numerics: Numerics) -> Floats:
    """Gradient at the nodes: central differences at the grid points, then bilinear.

    On the boundary ring the differences are one-sided; only nodes within h of the edge can notice.
    """
    slopes = [np.asarray(np.gradient(values, numerics.spacing, axis=axis)) for axis in (0, 1)]
    return np.stack([sample(slope, positions, numerics) for slope in slopes], axis=1)


# --- steps 1 to 3: cells, level set, biomass -----------------------------------------------------------------------


def level_set(positions: Floats, parents: Ints, parameters: Parameters, numerics: Numerics) -> Floats:
    """Equations 2.15 to 2.20: g = min over cells of f = (u/p)^2 + (v/q)^2 - 1, q = lambda_7 p.

    Each cell is evaluated on its own window, a box of grid points that holds all of {f <= 0} in the domain;
    outside every window g is +inf.
    """
    g = np.full((numerics.size, numerics.size), np.inf)
    grid = numerics.grid
    for child in range(1, len(positions)):
        end, other = positions[child], positions[parents[child]]
        length = math.hypot(end[0] - other[0], end[1] - other[1])
        if length == 0.0:
            continue  # the ellipse has shrunk to a point, which covers no area
        p = 0.5 * length
        q = parameters.aspect_ratio * p
        cos, sin = (end - other) / length
        x, y = 0.5 * (end + other)
        wx, ix = _window(x, math.hypot(p * cos, q * sin), grid, numerics)
        wy, iy = _window(y, math.hypot(p * sin, q * cos), grid, numerics)
        dx, dy = wx[:, None] - x, wy[None, :] - y
        u = cos * dx + sin * dy
        v = cos * dy - sin * dx
        f = (u / p) ** 2 + (v / q) ** 2 - 1.0
        np.minimum(g[ix, iy], f, out=g[ix, iy])
    return g


def _window(centre: float, reach: float, grid: Floats, numerics: Numerics) -> tuple[Floats, slice]:
    """Grid points of one axis within `reach` of `centre`, rounded outwards so that rounding loses none of them."""
    first = math.floor((centre - reach + 0.5 * numerics.domain) / numerics.spacing)
    last = math.ceil((centre + reach + 0.5 * numerics.domain) / numerics.spacing)
    where = slice(max(first, 0), max(last + 1, 0))
    return grid[where], where


def biomass(g: Floats, parameters: Parameters) -> Floats:
    """Equation 2.14: b = lambda_6 max(-g, 0)."""
    return np.asarray(parameters.metabolic_rate * np.maximum(-g, 0.0))


# --- step 4: nutrient ----------------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def _laplacian(interior: int, spacing: float) -> sparse.csr_array:
    """Five-point Laplacian on the interior points, [ix, iy] in C order, boundary values left out."""
    ones = np.ones(interior - 1)
    line = sparse.diags_array([ones, -2.0 * np.ones(interior), ones], offsets=[-1, 0, 1])
    eye = sparse.eye_array(interior)
    return ((sparse.kron(line, eye) + sparse.kron(eye, line)) / spacing**2).tocsr()


@lru_cache(maxsize=8)
def _boundary_sum(interior: int, spacing: float) -> Floats:
    """What the boundary value c = 1 adds to the five-point Laplacian at every interior point."""
    ring = np.zeros((interior, interior))
    for edge in (np.s_[0, :], np.s_[-1, :], np.s_[:, 0], np.s_[:, -1]):
        ring[edge] += 1.0 / spacing**2  # the corners touch two sides
    return ring.ravel()


def nutrient_step(
    nutrient: Floats, b: Floats, parameters: Parameters, numerics: Numerics, tolerance: float = CG_TOLERANCE
) -> tuple[Floats, float]:
    """Equations 2.7 and 2.8: one Crank-Nicolson step of dc/dt = lambda_1 lap c - b c, c = 1 on the boundary.

    With A = lambda_1 lap - b, frozen over the step, and the boundary's share s of lambda_1 lap:
    (1 - dt/2 A) c_new = (1 + dt/2 A) c_old + dt s for the interior points. Returns the new field and the relative
    residual it satisfies.
    """
    interior = numerics.size - 2
    half = 0.5 * numerics.dt
    diffusion = parameters.diffusivity * _laplacian(interior, numerics.spacing)
    share = parameters.diffusivity * _boundary_sum(interior, numerics.spacing)
    uptake = b[1:-1, 1:-1].ravel()
    old = nutrient[1:-1, 1:-1].ravel()

    right = old + half * (diffusion @ old - uptake * old) + 2.0 * half * share

    def left(c: Floats) -> Floats:
        return np.asarray(c - half * (diffusion @ c - uptake * c))

    operator = LinearOperator((old.size, old.size), matvec=left, dtype=np.float64)
    new, failure = cg(operator, right, x0=old, rtol=tolerance, atol=0.0, maxiter=500)
    residual = float(np.linalg.norm(left(new) - right) / np.linalg.norm(right))
    # The solver stops on a residual it updates rather than evaluates, hence the margin on the true one.
    if failure or not residual <= 10.0 * tolerance:
        raise RuntimeError(f"nutrient step not solved: relative residual {residual:g}, asked for {tolerance:g}")
    result = np.ones_like(nutrient)
    result[1:-1, 1:-1] = new.reshape(interior, interior)
    return result, residual


# --- step 6: mitosis -----------------------------------------------------------------------------------------------


def birth_count(mu: float, nodes: int, capacity: int) -> tuple[int, bool]:
    """Delta N = ceil((e^mu - 1) N), at most N and at most what capacity leaves; and whether capacity cut it."""
    wanted = min(math.ceil(math.expm1(mu) * nodes), nodes)
    room = capacity - nodes
    return min(wanted, room), wanted > room


def choose_parents(nutrients: Floats, count: int, tie_tolerance: float = TIE_TOLERANCE) -> Ints:
    """The `count` nodes with the most nutrient, in decreasing order, ties by lower index first.

    Neighbours in that order whose nutrients differ by no more than `tie_tolerance` are tied.
    """
    order = np.argsort(-nutrients, kind="stable")
    drops = nutrients[order][:-1] - nutrients[order][1:] > tie_tolerance
    tied_group = np.concatenate([[0], np.cumsum(drops)])
    ranked = order[np.lexsort((order, tied_group))]
    return np.asarray(ranked[:count], dtype=np.int64)


# --- step 7: motion ------------------------------------------------------------------------------------------------


def velocity(positions: Floats, parents: Ints, nutrient: Floats, parameters: Parameters, numerics: Numerics) -> Floats:
    """Equation 2.10: lambda_2 sum_j A_ij (1 - r) e + lambda_3 sum_{j != i} H(lambda_4 - r) e + lambda_5 grad c.

    The contact sum includes joined pairs. H(0) = 0 here. Coincident nodes have no direction and do not push.
    """
    child = np.arange(1, len(positions))
    parent = parents[1:]
    apart = positions[child] - positions[parent]
    length = np.hypot(apart[:, 0], apart[:, 1])[:, None]
    pull = (1.0 - length) * _directions(apart, length)
    spring = np.zeros_like(positions)
    np.add.at(spring, child, pull)
    np.add.at(spring, parent, -pull)

    x, y = positions.T
    squared = (x[:, None] - x[None, :]) ** 2 + (y[:, None] - y[None, :]) ** 2
    i, j = np.nonzero(squared < parameters.repulsion_radius**2)  # the pairs i = j have no direction and drop out
    contact = np.zeros_like(positions)
    np.add.at(contact, i, _directions(positions[i] - positions[j], np.sqrt(squared[i, j])[:, None]))

    drift = sample_gradient(nutrient, positions, numerics)
    return parameters.elasticity * spring + parameters.repulsivity * contact + parameters.mobility * drift


def _directions(vectors: Floats, lengths: Floats) -> Floats:
    """vectors / lengths, zero where the length is zero."""
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)


# --- one step, and many --------------------------------------------------------------------------------------------


def step(
    colony: Colony,
    parameters: Parameters,
    numerics: Numerics,
    angle_of: AngleOf,
    *,
    cg_tolerance: float = CG_TOLERANCE,
    tie_tolerance: float = TIE_TOLERANCE,
) -> tuple[Colony, dict[str, Any]]:
    """One time step of docs/model.md, section 3, in its order; the colony given is left as it was.

    `angle_of(event, parents)` gives the budding angles of event 1, 2, ... for those parents in that order. The
    diagnostics are `growth_rate` (mu), `level_set` (g) and `biomass` (b) of this step's cells, `births` (parents
    chosen, empty without an event), `capacity_reached` (capacity cut this event) and `residual` (nutrient).
    """
    number = colony.step + 1
    positions, parents, births = colony.positions, colony.parents, list(colony.births)

    g = level_set(positions, parents, parameters, numerics)
    b = biomass(g, parameters)
    nutrient, residual = nutrient_step(colony.nutrient, b, parameters, numerics, cg_tolerance)
    nutrients = sample(nutrient, positions, numerics)
    mu = float(np.mean(nutrients))  # equation 2.13

    chosen = np.empty(0, dtype=np.int64)
    cut = False
    if number % numerics.event_interval == 0:
        count, cut = birth_count(mu, len(positions), numerics.capacity)
        chosen = choose_parents(nutrients, count, tie_tolerance)
        phi = np.asarray(angle_of(number // numerics.event_interval, chosen), dtype=np.float64)
        if phi.shape != chosen.shape:
            raise ValueError(f"angle_of gave shape {phi.shape} for {len(chosen)} parents")
        buds = positions[chosen] + numerics.bud_distance * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        positions = np.concatenate([positions, buds])
        parents = np.concatenate([parents, chosen])
        births.append(chosen)

    for _ in range(numerics.substeps):
        going = velocity(positions, parents, nutrient, parameters, numerics)
        positions = positions + numerics.dt / numerics.substeps * going
    require_inside(positions, numerics)
    diagnostics = {
        "growth_rate": mu,
        "level_set": g,
        "biomass": b,
        "births": chosen,
        "capacity_reached": cut,
        "residual": residual,
    }
    return Colony(positions, parents, nutrient, number, births), diagnostics


def statistics(
    colony: Colony, g: Floats, numerics: Numerics, growth_rate: float | None = None
) -> dict[str, float | int]:
    """The statistics of docs/model.md, section 4, on the black-and-white image {g <= 0} at the nutrient's grid points.

    Area is the pixel count times h^2. Perimeter is `skimage.measure.perimeter` with 4-neighbourhood times h: the
    length of the chains through the centres of border pixels, holes included, with weights 1, sqrt(2) and their
    mean by the local pattern. Compactness is P^2 / (4 pi A). Radius is the mean distance of colony pixels from
    their centroid. An empty image has no compactness and no radius (nan).

    Pass the step's `growth_rate`; without it, mu is the mean nutrient at the colony's present positions.
    """
    if growth_rate is None:
        growth_rate = float(np.mean(sample(colony.nutrient, colony.positions, numerics)))
    image = g <= 0.0
    area = float(np.count_nonzero(image)) * numerics.spacing**2
    length = float(pixel_perimeter(image, neighborhood=4)) * numerics.spacing
    radius = math.nan
    if area > 0.0:
        pixels = numerics.grid[np.argwhere(image)]
        radius = float(np.mean(np.linalg.norm(pixels - np.mean(pixels, axis=0), axis=1)))
    return {
        "growth_rate": growth_rate,
        "mean_radius": float(np.mean(np.linalg.norm(colony.positions, axis=1))),
        "cell_count": len(colony.positions) - 1,
        "area": area,
        "perimeter": length,
        "compactness": length**2 / (4.0 * math.pi * area) if area > 0.0 else math.nan,
        "radius": radius,
    }


def run(
    parameters: Parameters,
    numerics: Numerics,
    time: float,
    rng: np.random.Generator,
    sample_times: Iterable[float],
    *,
    cg_tolerance: float = CG_TOLERANCE,
) -> list[dict[str, Any]]:
    """Grow one colony to `time`; statistics at the steps nearest to the sample times, in increasing order.

    Every record also has `time`, `step`, `image` ({g <= 0}) and `capacity_reached`: whether capacity has cut the births
    of any event so far. A sample at time 0 describes the starting cells. All angles come from `rng`, the first cell's
    first.
    """
    last = round(time / numerics.dt)
    wanted = {round(moment / numerics.dt) for moment in sample_times}
    if wanted and not 0 <= min(wanted) <= max(wanted) <= last:
        raise ValueError(f"sample times must lie between 0 and {time:g}")

    def angle_of(event: int, chosen: Ints) -> Floats:
        return rng.uniform(0.0, 2.0 * math.pi, len(chosen))

    colony = start(numerics, rng.uniform(0.0, 2.0 * math.pi))
    reached = False
    records: list[dict[str, Any]] = []

    def record(g: Floats, growth_rate: float | None = None) -> None:
        values: dict[str, Any] = {"time": colony.step * numerics.dt, "step": colony.step, "capacity_reached": reached}
        records.append(values | statistics(colony, g, numerics, growth_rate) | {"image": g <= 0.0})

    if 0 in wanted:
        record(level_set(colony.positions, colony.parents, parameters, numerics))
    for number in range(1, last + 1):
        colony, diagnostics = step(colony, parameters, numerics, angle_of, cg_tolerance=cg_tolerance)
        reached = reached or diagnostics["capacity_reached"]
        if number in wanted:
            record(diagnostics["level_set"], diagnostics["growth_rate"])
    return records
