"""Curves of single colonies as a function of log λ: what fits, sensitivities and posteriors are made of."""

from collections import Counter
from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import PROBLEMS, Colony, start
from yeastfit.model.numerics import Numerics, map_members, on_one_device
from yeastfit.model.parameters import NAMES, Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, trajectory

BLOCK = 32  # members that run together; all ensembles run in blocks of one size, which compiles once
TANGENTS = 8  # members with their derivatives, likewise
OUTLIER = 5.0  # times its scale a derivative may be off the median


class Curves(eqx.Module):
    """Curves of chosen statistics at chosen steps, of every member of an ensemble with fixed keys, in log λ1 … log λ7.

    A member's values are its curves, statistic by statistic, and then which of `PROBLEMS` it ran into, 0 or 1 each.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    numerics: Numerics = eqx.field(static=True)
    observe: SmoothStatistics | HardStatistics
    relaxation: Relaxation
    schedule: Schedule

    def grown(self, z: Float[Array, " 7"], key: Array) -> tuple[Colony, dict[str, Array]]:
        """One colony at the end, and what was observed."""
        rules = self.schedule, self.relaxation, self.numerics, self.observe
        return trajectory(Parameters.from_array(NAMES, jnp.exp(z)), start(key, self.numerics), *rules)

    def member(self, z: Float[Array, " 7"], key: Array) -> Float[Array, " value"]:
        """One colony's values; of smooth statistics, and then differentiable where the relaxation is."""
        colony, observed = self.grown(z, key)
        curves = [observed[name] for name in self.names]
        problems = jnp.stack([getattr(colony.problems, name) for name in PROBLEMS])
        return jnp.concatenate([*curves, problems.astype(curves[0].dtype)])

    def members(self, z: Float[Array, "*member 7"], keys: Array) -> Float[Array, "member value"]:
        """All members, with one z for all or one for each. Statistics of masks are taken on the host."""
        run = _masked if isinstance(self.observe, HardStatistics) else _members
        return jnp.concatenate([run(self, *block)[:size] for *block, size in _blocks(z, keys, BLOCK)])

    def members_with_tangents(
        self, z: Float[Array, " 7"], keys: Array
    ) -> tuple[Float[Array, "member value"], Float[Array, "member 7 value"]]:
        """All members, and their derivatives in z."""
        blocks = [(on_one_device(_with_tangents(self, *block)), size) for *block, size in _blocks(z, keys, TANGENTS)]
        values, tangents = ([block[k][:size] for block, size in blocks] for k in (0, 1))
        return jnp.concatenate(values), jnp.concatenate(tangents)


def without_problems(values: Array | np.ndarray) -> tuple[Float[np.ndarray, "member curve"], Counter[str]]:
    """The curves among `Curves`' values, and how many members ran into each of `PROBLEMS`."""
    table = np.asarray(values, dtype=float)
    met = dict(zip(PROBLEMS, table[:, -len(PROBLEMS) :].sum(axis=0).astype(int).tolist(), strict=True))
    return table[:, : -len(PROBLEMS)], Counter({name: count for name, count in met.items() if count})


class Robust(eqx.Module):
    """A mean over members that a few of them cannot carry away.

    error: standard error of `mean`. cut: share of the members that were cut. spread: standard deviation of all members
    over that of those left as they are; far above 1, a plain mean would mean nothing.
    """

    mean: Float[Array, "*entry"]
    error: Float[Array, "*entry"]
    cut: Float[Array, "*entry"]
    spread: Float[Array, "*entry"]


def robust_mean(values: Float[Array, "member *entry"]) -> Robust:
    """Mean of all members, each cut at `OUTLIER` times the scale of the nearest 95 % around the median.

    A single colony's derivative may grow without bound along a chaotic path while the ensemble's does not.
    """
    finite = jnp.isfinite(values)
    middle = jnp.nanmedian(jnp.where(finite, values, jnp.nan), axis=0)
    middle = jnp.where(jnp.isfinite(middle), middle, 0.0)
    apart = jnp.where(finite, values - middle, jnp.inf)
    left = len(values) - max(1, round(0.05 * len(values)))
    near = jnp.sort(jnp.abs(apart), axis=0)[: max(left, 1)]
    scale = jnp.sqrt(jnp.mean(near**2, axis=0))
    kept = jnp.clip(apart, -OUTLIER * scale, OUTLIER * scale)
    kept = jnp.where(finite, kept, 0.0)
    inside = jnp.std(kept, axis=0)
    return Robust(
        mean=middle + jnp.mean(kept, axis=0),
        error=inside / np.sqrt(max(1, len(values) - 1)),
        cut=jnp.mean(kept != apart, axis=0),
        spread=jnp.where(inside > 0, jnp.std(apart, axis=0) / jnp.where(inside > 0, inside, 1.0), 1.0),
    )


def _blocks(z: Float[Array, "... 7"], keys: Array, block: int) -> Iterator[tuple[Array, Array, int]]:
    """Members in blocks of one size; the last is filled up with repetitions."""
    # explicit type: a weakly typed z would compile everything a second time
    z = jnp.broadcast_to(jnp.asarray(z, jnp.result_type(float)), (*keys.shape, z.shape[-1]))
    for first in range(0, len(keys), block):
        size = min(block, len(keys) - first)
        pick = jnp.minimum(first + jnp.arange(block), len(keys) - 1)
        yield z[pick], keys[pick], size


def _members(curves: Curves, z: Float[Array, "member 7"], keys: Array) -> Float[Array, "member value"]:
    return on_one_device(_smooth_members(curves, z, keys))


def _masked(curves: Curves, z: Float[Array, "member 7"], keys: Array) -> Float[Array, "member value"]:
    colony, observed = on_one_device(_grown(curves, z, keys))
    found = curves.observe.finish(jax.tree.map(np.asarray, observed))
    problems = np.stack([np.asarray(getattr(colony.problems, name)) for name in PROBLEMS], axis=1)
    return jnp.asarray(np.concatenate([*(found[name] for name in curves.names), problems], axis=1, dtype=float))


@eqx.filter_jit
def _smooth_members(curves: Curves, z: Float[Array, "member 7"], keys: Array) -> Float[Array, "member value"]:
    return map_members(curves.member, z, keys)


@eqx.filter_jit
def _grown(curves: Curves, z: Float[Array, "member 7"], keys: Array) -> tuple[Colony, dict[str, Array]]:
    return map_members(curves.grown, z, keys)


@eqx.filter_jit
def _with_tangents(curves: Curves, z: Float[Array, "member 7"], keys: Array) -> tuple[Array, Array]:
    def one(z: Array, key: Array) -> tuple[Array, Array]:
        push = partial(jax.jvp, lambda z: curves.member(z, key), (z,))
        return jax.vmap(lambda direction: push((direction,)), out_axes=(None, 0))(jnp.eye(z.size, dtype=z.dtype))

    return map_members(one, z, keys)
