"""Nutrient as random walkers instead of a field (source 5.1.1).

    dx_w = √(2 λ1) dW_w,    reflected at the dish's wall

A walker that comes within `uptake_radius` of a node is taken up by the nearest, and every `per_bud` walkers that a node
has taken up become its child. Walkers in the dish and those taken up are as many as at the start, at every step. The
nutrient that nodes drift along, and that pictures show, is a kernel density estimate of the walkers, over the density
at the start:

    c(x) = (L² / n) Σ_w N(x − x_w; width² 1)

Walkers come and go by whole numbers: colonies have no derivative along a path, and the regression of `sensitivity`
serves. The two rules of this file need each other.
"""

import dataclasses
import zlib
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from yeastfit.errors import InputError
from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony
from yeastfit.model.numerics import Numerics, largest_in_ensemble
from yeastfit.model.rules import BirthRule, Births, Context, MediumRule, Rule, UptakeRule
from yeastfit.parameter_set import Parameter
from yeastfit.text import quoted

UPTAKE_RADIUS = Parameter(
    "uptake_radius", "R_u", "distance within which a node takes up a walker", (0.05, 1.0), 0.25, "L0", positive=True
)

BLOCK = 32  # grid points that are smoothed together
SOME = 512  # walkers whose nearest nodes are looked for together
MOST = 10_000_000  # walkers: their places alone take 80 MB


class WalkerBirths(BirthRule):
    """A node that has taken up enough walkers buds.

    Attributes:
        per_bud: How many walkers, pieces of nutrient, a node takes up for each child.
    """

    name: ClassVar[str] = "walkers"
    doublings: ClassVar[float] = float("inf")  # who has taken up enough buds, in every step
    per_bud: int = eqx.field(static=True, default=10)

    def __check_init__(self) -> None:
        if not 1 <= self.per_bud <= MOST:
            raise InputError(f"births: per_bud is {quoted(self.per_bud)}, it must be from 1 to {MOST}")

    def objection(self, rules: Mapping[str, Rule]) -> str | None:
        """There must be walkers."""
        return None if rules["medium"].name == "walkers" else "needs walkers: choose medium 'walkers', too"

    def due(self, context: Context) -> Bool[Array, ""]:
        """Whether any node has enough."""
        return jnp.any(self._ripe(context))

    def births(self, context: Context) -> Births:
        """All nodes that have enough, in order of age."""
        colony, ripe = context.colony, self._ripe(context)
        room = colony.parents.shape[0] - colony.count
        paid = jnp.where(ripe & (jnp.cumsum(ripe) <= room), float(self.per_bud), 0.0)  # nothing for a child unborn
        return Births(
            parents=jnp.arange(ripe.shape[0]),
            weights=jnp.where(ripe, context.living, 0.0),
            event=colony.step,
            node_state={"taken": colony.node_state["taken"] - paid},
        )

    def _ripe(self, context: Context) -> Bool[Array, " node"]:
        return (context.living > 0) & (context.colony.node_state["taken"] >= self.per_bud)


class WalkerMedium(MediumRule):
    """Walkers that nodes take up. Not differentiable along a path.

    Attributes:
        walkers: How many pieces of nutrient there are at the start.
        width: Over what distance their density is smoothed, in L0.
    """

    name: ClassVar[str] = "walkers"
    idle: ClassVar[tuple[str, ...]] = ("metabolic_rate",)
    parameters: ClassVar[tuple[Parameter, ...]] = (UPTAKE_RADIUS,)
    keeps: ClassVar[tuple[str, ...]] = ("walkers", "free", "walker_key")
    walkers: int = eqx.field(static=True, default=5000)
    width: float = eqx.field(static=True, default=0.5)

    def __check_init__(self) -> None:
        if not 1 <= self.walkers <= MOST:
            raise InputError(f"medium: walkers is {quoted(self.walkers)}, it must be from 1 to {MOST}")
        if not self.width > 0:
            raise InputError(f"medium: width is {quoted(self.width)}, it must be above 0")

    def objection(self, rules: Mapping[str, Rule]) -> str | None:
        """Walkers are no field that could be shaken, and births are by them."""
        for question, only in (("births", "walkers"), ("fluctuations", "none"), ("uptake", "biomass")):
            if rules[question].name != only:
                other = f"{question} {rules[question].name!r}"
                return f"excludes {other}, there is no field of nutrient: it needs {question} {only!r}"
        return None

    def node_state(self) -> dict[str, float]:
        """How many walkers a node has taken up and not yet made a child of."""
        return {"taken": 0.0}

    def advance(self, context: Context) -> dict[str, Float[Array, " node"]]:
        """As it is: `stepped` counts."""
        return {"taken": context.colony.node_state["taken"]}

    def store(self, key: Array, numerics: Numerics) -> dict[str, Array]:
        """Walkers, uniform in the dish."""
        own = jax.random.fold_in(key, zlib.crc32(b"walkers"))
        half = 0.5 * numerics.domain
        places = jax.random.uniform(own, (self.walkers, 2), minval=-half, maxval=half)
        return {"walkers": places, "free": jnp.ones(self.walkers, bool), "walker_key": jax.random.key_data(own)}

    def stepped(self, context: Context, cells: Cells, uptake: UptakeRule) -> Colony:
        """Walkers walk, nodes take up, and the density is estimated anew."""
        colony, parameters, numerics = context.colony, context.parameters, context.numerics
        medium, free = colony.medium, colony.medium["free"]
        key = jax.random.fold_in(jax.random.wrap_key_data(medium["walker_key"]), colony.step)
        drawn = jax.random.normal(key, medium["walkers"].shape, medium["walkers"].dtype)
        half = 0.5 * numerics.domain
        ahead = medium["walkers"] + jnp.sqrt(2.0 * parameters.diffusivity * numerics.dt) * drawn
        places = jnp.clip(jnp.where(jnp.abs(ahead) > half, jnp.sign(ahead) * 2 * half - ahead, ahead), -half, half)
        places = jax.lax.stop_gradient(places)
        node, near = nearest_node(colony, context.living > 0, places, parameters["uptake_radius"])
        eaten = free & near
        store = colony.node_state["taken"].at[node].add(jnp.where(eaten, 1.0, 0.0))
        left = free & ~eaten
        problems = eqx.tree_at(lambda p: p.store_empty, colony.problems, colony.problems.store_empty | ~jnp.any(left))
        return dataclasses.replace(
            colony,
            nutrient=density(places, left, self.width, numerics),
            medium={**medium, "walkers": places, "free": left},
            node_state={**colony.node_state, "taken": store},
            problems=problems,
        )


def density(
    places: Float[Array, "walker 2"], free: Bool[Array, " walker"], width: float, numerics: Numerics
) -> Float[Array, "x y"]:
    """Density of free walkers on the grid, over that of all of them, spread evenly: a Gaussian kernel.

    Each walker is shared between the four grid points around it; of its kernel nothing lies beyond the wall.
    """
    scaled = (places + 0.5 * numerics.domain) / numerics.spacing
    corner = jnp.clip(jnp.floor(scaled).astype(int), 0, numerics.points - 2)
    s, t = jnp.unstack(scaled - corner, axis=-1)
    one = jnp.where(free, (numerics.domain / numerics.spacing) ** 2 / free.shape[0], 0.0)
    grid = jnp.zeros((numerics.points,) * 2, places.dtype)
    for di, dj, share in ((0, 0, (1 - s) * (1 - t)), (0, 1, (1 - s) * t), (1, 0, s * (1 - t)), (1, 1, s * t)):
        grid = grid.at[corner[:, 0] + di, corner[:, 1] + dj].add(one * share)
    axis = numerics.spacing * np.arange(numerics.points)
    gauss = np.exp(-0.5 * ((axis[:, None] - axis) / width) ** 2)
    cell = np.where((axis == axis[0]) | (axis == axis[-1]), 0.5, 1.0)  # of the wall's points half lies in the dish
    kernel = jnp.asarray(gauss / (cell @ gauss), places.dtype)
    tails = np.sqrt(-2.0 * np.log(np.finfo(places.dtype).eps)) * width  # beyond, the kernel is 0 to rounding
    return banded_products(kernel, grid, int(np.ceil(tails / numerics.spacing)))


def banded_products(kernel: Float[Array, "x x"], grid: Float[Array, "x y"], band: int) -> Float[Array, "x y"]:
    """K G Kᵀ for a kernel that is 0 farther than `band` from its diagonal, by blocks of rows, then of columns."""
    points = len(kernel)
    blocks = [
        (slice(start, start + BLOCK), slice(max(0, start - band), start + BLOCK + band))
        for start in range(0, points, BLOCK)
    ]
    half = jnp.concatenate([kernel[own, near] @ grid[near] for own, near in blocks])
    return jnp.concatenate([half[:, near] @ kernel[own, near].T for own, near in blocks], axis=1)


def nearest_node(
    colony: Colony, eats: Bool[Array, " node"], places: Float[Array, "walker 2"], radius: Float[Array, ""]
) -> tuple[Int[Array, " walker"], Bool[Array, " walker"]]:
    """The slot of that node nearest to each place which eats, and whether it is within a radius; else slot 0.

    Nodes are sorted into square bins of the radius' side, as for contact: a place meets three runs of the sorted order.
    Only places in the rectangle of the colony's bins are looked at.
    """
    positions = jax.lax.stop_gradient(colony.positions)
    bins = jnp.floor(positions / radius).astype(int)
    low = jnp.min(jnp.where(eats[:, None], bins, jnp.iinfo(bins.dtype).max), axis=0)
    bins = bins - low + 1
    columns, rows = jnp.unstack(jnp.max(jnp.where(eats[:, None], bins, 0), axis=0) + 2)
    key = jnp.where(eats, bins[:, 0] * rows + bins[:, 1], jnp.iinfo(bins.dtype).max)
    order = jnp.argsort(key)
    nodes = key[order], positions[order], order
    own_bins = jnp.floor(places / radius).astype(int) - low + 1
    around = jnp.all((own_bins >= 0) & (own_bins < jnp.stack([columns, rows])), axis=-1)  # few, the dish is wide
    count = places.shape[0]
    asked = jnp.nonzero(around, size=-(-count // SOME) * SOME, fill_value=count)[0]

    def find_some(i: Int[Array, ""], found: tuple[Array, Array]) -> tuple[Array, Array]:
        which = jax.lax.dynamic_slice(asked, (i * SOME,), (SOME,))
        at, own = (of_all.at[which].get(mode="clip") for of_all in (places, own_bins))
        squared, slot = _nearest(at, own, rows, *nodes)
        return found[0].at[which].set(squared, mode="drop"), found[1].at[which].set(slot, mode="drop")

    nobody = jnp.full(count, jnp.inf, places.dtype), jnp.zeros(count, order.dtype)
    trips = largest_in_ensemble((jnp.sum(around) + SOME - 1) // SOME)
    squared, slot = jax.lax.fori_loop(0, trips, find_some, nobody)
    return slot, squared < radius**2


def _nearest(
    at: Float[Array, "walker 2"],
    own: Int[Array, "walker 2"],
    rows: Int[Array, ""],
    key: Int[Array, " node"],
    positions: Float[Array, "node 2"],
    order: Int[Array, " node"],
) -> tuple[Float[Array, " walker"], Int[Array, " walker"]]:
    """Squared distance of the nearest node in the nine bins around each place, and its slot; inf and 0 without one.

    own: the place's bin. key, positions, order: bins, places and slots of the nodes, sorted by bin.
    """
    middle = (own[:, 0, None] + jnp.arange(-1, 2)) * rows + own[:, 1, None]
    first = jnp.searchsorted(key, middle - 1, side="left")
    runs = jnp.searchsorted(key, middle + 1, side="right") - first

    def lane(i: Int[Array, ""], best: tuple[Array, Array]) -> tuple[Array, Array]:
        closest, slot = best
        rank = jnp.minimum(first + i, order.shape[0] - 1)
        apart = jnp.sum((at[:, None] - positions[rank]) ** 2, axis=-1)
        apart = jnp.where(i < runs, apart, jnp.inf)
        of = jnp.argmin(apart, axis=1)[:, None]
        least, whose = jnp.take_along_axis(apart, of, 1)[:, 0], jnp.take_along_axis(order[rank], of, 1)[:, 0]
        return jnp.minimum(closest, least), jnp.where(least < closest, whose, slot)

    start = jnp.full(len(at), jnp.inf, at.dtype), jnp.zeros(len(at), order.dtype)
    found: tuple[Array, Array] = jax.lax.fori_loop(0, largest_in_ensemble(jnp.max(runs)), lane, start)
    return found
