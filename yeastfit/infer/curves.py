"""Ensemble-mean curves as a differentiable function of the free parameters."""

from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.infer.bijection import from_free
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.colony import start
from yeastfit.model.numerics import Numerics, map_members, on_one_device
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, trajectory

BLOCK = 32  # members that run together
OUTLIER = 5.0  # robust standard deviations at which a member's derivative is cut


class Curves(eqx.Module):
    """Curves of chosen statistics at chosen steps, of every member of an ensemble with fixed keys.

    Means over members are differentiable in z: the derivative of the mean is estimated as the mean of the members'
    derivatives, each cut where it is an outlier (`OUTLIER`), because a single colony's derivative may grow without
    bound along a chaotic path while the ensemble's does not.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    free: tuple[str, ...] = eqx.field(static=True)
    numerics: Numerics = eqx.field(static=True)
    observe: SmoothStatistics
    fixed: Parameters
    relaxation: Relaxation
    schedule: Schedule

    def member(self, z: Float[Array, " free"], key: Array) -> Float[Array, " curve"]:
        """One colony's curves, statistic by statistic."""
        parameters = from_free(z, self.free, self.fixed)
        _, observed = trajectory(
            parameters, start(key, self.numerics), self.schedule, self.relaxation, self.numerics, self.observe
        )
        return jnp.concatenate([observed[name] for name in self.names])

    def members(self, z: Float[Array, "... free"], keys: Array) -> Float[Array, "member curve"]:
        """All members, with one z for all or one for each."""
        return jnp.concatenate([on_one_device(_members(self, *block))[:size] for *block, size in _blocks(z, keys)])

    def members_with_tangents(
        self, z: Float[Array, " free"], keys: Array
    ) -> tuple[Float[Array, "member curve"], Float[Array, "member free curve"]]:
        """All members, and their derivatives in z."""
        blocks = [(on_one_device(_with_tangents(self, *block)), size) for *block, size in _blocks(z, keys)]
        values, tangents = ([block[k][:size] for block, size in blocks] for k in (0, 1))
        return jnp.concatenate(values), jnp.concatenate(tangents)

    def mean(self, z: Float[Array, " free"], keys: Array) -> Float[Array, " curve"]:
        """Ensemble mean, whose derivative is `robust_mean` of the members'."""
        return _mean(self, z, keys)


def robust_mean(tangents: Float[Array, "member free curve"]) -> tuple[Float[Array, "curve free"], Float[Array, ""]]:
    """Mean over members of their derivatives, outliers cut; and the share of them that was."""
    tangents = jnp.where(jnp.isfinite(tangents), tangents, 0.0)
    middle = jnp.median(tangents, axis=0)
    # 1.4826: median absolute deviation to standard deviation of a Gaussian
    limit = OUTLIER * 1.4826 * jnp.median(jnp.abs(tangents - middle), axis=0)
    kept = jnp.clip(tangents, middle - limit, middle + limit)
    return jnp.mean(kept, axis=0).T, jnp.mean(kept != tangents)


def _blocks(z: Float[Array, "... free"], keys: Array) -> Iterator[tuple[Array, Array, int]]:
    """Members in blocks of one size, so that ensembles of all sizes run the same compiled program."""
    # explicit type: a weakly typed z would compile everything a second time
    z = jnp.broadcast_to(jnp.asarray(z, jnp.result_type(float)), (*keys.shape, z.shape[-1]))
    for first in range(0, len(keys), BLOCK):
        size = min(BLOCK, len(keys) - first)
        pick = jnp.minimum(first + jnp.arange(BLOCK), len(keys) - 1)
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
    return jnp.mean(values, axis=0), robust_mean(derivatives)[0] @ tangents[1]
