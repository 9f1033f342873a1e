"""Ensemble-mean curves as a differentiable function of parameters."""

from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.infer.bijection import from_free
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.colony import PROBLEMS, Colony, start
from yeastfit.model.numerics import Numerics, map_members, on_one_device
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, trajectory

BLOCK = 32  # members that run together; all ensembles run in blocks of one size, which compiles once
TANGENTS = 8  # members with their derivatives, likewise
OUTLIER = 5.0  # times its scale a derivative may be off the median


class Curves(eqx.Module):
    """Curves of chosen statistics at chosen steps, of every member of an ensemble with fixed keys.

    What z means is a subclass's matter: `parameters` makes λ of it. Means over members are differentiable in z: the
    derivative of the mean is the `robust_mean` of the members' derivatives.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    numerics: Numerics = eqx.field(static=True)
    observe: SmoothStatistics
    relaxation: Relaxation
    schedule: Schedule

    @abstractmethod
    def parameters(self, z: Float[Array, " free"]) -> Parameters:
        """λ of z."""

    def grown(self, z: Float[Array, " free"], key: Array) -> tuple[Colony, Float[Array, " curve"]]:
        """One colony at the end, and its curves, statistic by statistic."""
        colony = start(key, self.numerics)
        rules = self.schedule, self.relaxation, self.numerics, self.observe
        colony, observed = trajectory(self.parameters(z), colony, *rules)
        return colony, jnp.concatenate([observed[name] for name in self.names])

    def member(self, z: Float[Array, " free"], key: Array) -> Float[Array, " curve"]:
        """One colony's curves."""
        return self.grown(z, key)[1]

    def members(self, z: Float[Array, "... free"], keys: Array) -> Float[Array, "member curve"]:
        """All members, with one z for all or one for each."""
        return jnp.concatenate(
            [on_one_device(_members(self, *block))[:size] for *block, size in _blocks(z, keys, BLOCK)]
        )

    def members_with_tangents(
        self, z: Float[Array, " free"], keys: Array
    ) -> tuple[Float[Array, "member curve"], Float[Array, "member free curve"]]:
        """All members, and their derivatives in z."""
        blocks = [(on_one_device(_with_tangents(self, *block)), size) for *block, size in _blocks(z, keys, TANGENTS)]
        values, tangents = ([block[k][:size] for block, size in blocks] for k in (0, 1))
        return jnp.concatenate(values), jnp.concatenate(tangents)

    def mean(self, z: Float[Array, " free"], keys: Array) -> Float[Array, " curve"]:
        """Ensemble mean, whose derivative is `robust_mean` of the members'."""
        return _mean(self, z, keys)


class FreeCurves(Curves):
    """As a function of the free parameters, `infer.bijection`'s z; the others are fixed."""

    free: tuple[str, ...] = eqx.field(static=True)
    fixed: Parameters

    def parameters(self, z: Float[Array, " free"]) -> Parameters:
        """λ of z, inside the plausible ranges."""
        return from_free(z, self.free, self.fixed)


class LogCurves(Curves):
    """As a function of log λ1 … log λ7; a member's last values say which of `PROBLEMS` it ran into, 0 or 1 each."""

    def parameters(self, z: Float[Array, " 7"]) -> Parameters:
        """λ of its logarithms."""
        return Parameters(*jnp.unstack(jnp.exp(z)))

    def member(self, z: Float[Array, " 7"], key: Array) -> Float[Array, " value"]:
        """One colony's curves, and its problems."""
        colony, curves = self.grown(z, key)
        problems = [getattr(colony.problems, name) for name in PROBLEMS]
        return jnp.concatenate([curves, jnp.stack(problems).astype(curves.dtype)])


def without_problems(values: Array) -> tuple[Float[np.ndarray, "member curve"], Counter[str]]:
    """The curves among `LogCurves`' values, and how many members ran into each of `PROBLEMS`."""
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


def _blocks(z: Float[Array, "... free"], keys: Array, block: int) -> Iterator[tuple[Array, Array, int]]:
    """Members in blocks of one size; the last is filled up with repetitions."""
    # explicit type: a weakly typed z would compile everything a second time
    z = jnp.broadcast_to(jnp.asarray(z, jnp.result_type(float)), (*keys.shape, z.shape[-1]))
    for first in range(0, len(keys), block):
        size = min(block, len(keys) - first)
        pick = jnp.minimum(first + jnp.arange(block), len(keys) - 1)
        yield z[pick], keys[pick], size


@eqx.filter_jit
def _members(curves: Curves, z: Float[Array, "member free"], keys: Array) -> Float[Array, "member curve"]:
    return map_members(curves.member, z, keys)


@eqx.filter_jit
def _with_tangents(curves: Curves, z: Float[Array, "member free"], keys: Array) -> tuple[Array, Array]:
    def one(z: Array, key: Array) -> tuple[Array, Array]:
        push = partial(jax.jvp, lambda z: curves.member(z, key), (z,))
        return jax.vmap(lambda direction: push((direction,)), out_axes=(None, 0))(jnp.eye(z.size, dtype=z.dtype))

    return map_members(one, z, keys)


@eqx.filter_custom_jvp
def _mean(curves: Curves, z: Float[Array, " free"], keys: Array) -> Array:
    return jnp.mean(curves.members(z, keys), axis=0)


@_mean.def_jvp
def _mean_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    curves, z, keys = primals
    values, derivatives = curves.members_with_tangents(z, keys)
    return jnp.mean(values, axis=0), tangents[1] @ robust_mean(derivatives).mean
