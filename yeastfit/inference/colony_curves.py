"""Curves of single colonies as a function of log λ, in blocks of one size that compile once.

Colonies that could outgrow such a program grow one by one, in arrays as long as they need (`simulate`), and so do those
that are compared at one area, whatever their age.
"""

from collections.abc import Iterator
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import HardStatistics, mask_of
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import PROBLEMS, Colony
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics, map_members, most_nodes, on_one_device
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, trajectory
from yeastfit.simulation.large_ensemble import member_of
from yeastfit.simulation.simulate import SHORT, simulate

BLOCK = 32  # members that run together
TANGENTS = 8  # members that run together with their derivatives


class ColonyCurves(eqx.Module):
    """Curves of chosen statistics at chosen steps, of every member of an ensemble with given keys.

    A member's values are its curves, statistic by statistic, and then which of `PROBLEMS` it ran into, 0 or 1 each.
    `block` members run together; no value depends on it.

    With an `area` in L0² there is one step in the schedule, the latest: a member is measured as a mask as soon as it
    has that area. One that does not come to it, or not with fewer nodes than its capacity, has no values.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    numerics: Numerics = eqx.field(static=True)
    observe: SmoothStatistics | HardStatistics
    relaxation: Relaxation
    schedule: Schedule
    model: Model = Model()
    block: int = eqx.field(static=True, default=BLOCK)
    area: float | None = eqx.field(static=True, default=None)

    @property
    def unlimited(self) -> bool:
        """Whether nothing limits members to as many nodes as one program has room for."""
        time = float(np.asarray(self.schedule.steps)[-1]) * self.numerics.dt
        limited = self.numerics.capacity is not None and self.numerics.capacity <= SHORT
        return not limited and most_nodes(time, self.model.births.doublings) > SHORT

    def grown(self, z: Float[Array, " parameter"], key: Array) -> tuple[Colony, dict[str, Array]]:
        """One colony at the end, and what was observed. z: log λ of all the model's parameters, in order."""
        rules = self.schedule, self.relaxation, self.numerics, self.observe, self.model
        parameters = Parameters.from_array(self.model.parameters.names, jnp.exp(z))
        return trajectory(parameters, self.model.start(key, self.numerics), *rules)

    def member(self, z: Float[Array, " parameter"], key: Array) -> Float[Array, " value"]:
        """One colony's values, of smooth statistics; differentiable where the relaxation is."""
        colony, observed = self.grown(z, key)
        curves = [observed[name] for name in self.names]
        problems = jnp.stack([getattr(colony.problems, name) for name in PROBLEMS])
        return jnp.concatenate([*curves, problems.astype(curves[0].dtype)])

    def members(self, z: Float[Array, "*member parameter"], keys: Array) -> Float[Array, "member value"]:
        """All members, with one z for all or one for each. Statistics of masks are taken on the host."""
        if self.area is not None:
            return _of_one_area(self, z, keys)
        if self.unlimited:
            return _of_any_size(self, z, keys)
        run = _masked if isinstance(self.observe, HardStatistics) else _members
        return jnp.concatenate([run(self, *block)[:size] for *block, size in _blocks(z, keys, self.block)])

    def grown_to_area(self, parameters: Parameters, keys: Array) -> tuple[Colony, Bool[np.ndarray, " member"]]:
        """All members as they come to `area`, to as many nodes as they may have, or to the last step.

        Second, which came to the area with fewer nodes than that.
        """
        pixels = HardStatistics(self.numerics.domain, self.numerics.spacing, ("area",))
        how = {"model": self.model, "numerics": self.numerics, "relaxation": self.relaxation, "throw": False}
        latest = float(np.asarray(self.schedule.steps)[-1]) * self.numerics.dt
        until = {"area": self.area, "nodes": (most := self.numerics.most_room)}
        grown = simulate(parameters, keys, times=[latest], until=until, observe=pixels, **how)  # type: ignore[arg-type]
        reached = np.isfinite(np.asarray(grown.reached, dtype=float))
        return grown.colony, reached & ~grown.capacity_reached & (np.asarray(grown.colony.count) < most)

    def members_with_tangents(
        self, z: Float[Array, " parameter"], keys: Array
    ) -> tuple[Float[Array, "member value"], Float[Array, "member parameter value"]]:
        """All members, and their derivatives in z."""
        blocks = [(on_one_device(_with_tangents(self, *block)), size) for *block, size in _blocks(z, keys, TANGENTS)]
        values, tangents = ([block[k][:size] for block, size in blocks] for k in (0, 1))
        return jnp.concatenate(values), jnp.concatenate(tangents)


def _blocks(z: Float[Array, "... parameter"], keys: Array, block: int) -> Iterator[tuple[Array, Array, int]]:
    """Members in blocks of one size; the last is filled up with repetitions."""
    # explicit type: a weakly typed z would compile everything a second time
    z = jnp.broadcast_to(jnp.asarray(z, jnp.result_type(float)), (*keys.shape, z.shape[-1]))
    for first in range(0, len(keys), block):
        size = min(block, len(keys) - first)
        pick = jnp.minimum(first + jnp.arange(block), len(keys) - 1)
        yield z[pick], keys[pick], size


def _members(curves: ColonyCurves, z: Float[Array, "member parameter"], keys: Array) -> Float[Array, "member value"]:
    return on_one_device(_smooth_members(curves, z, keys))


def _masked(curves: ColonyCurves, z: Float[Array, "member parameter"], keys: Array) -> Float[Array, "member value"]:
    colony, observed = on_one_device(_grown(curves, z, keys))
    found = curves.observe.finish(jax.tree.map(np.asarray, observed))
    problems = _problems_of(colony)
    return jnp.asarray(np.concatenate([*(found[name] for name in curves.names), problems], axis=1, dtype=float))


def _of_any_size(
    curves: ColonyCurves, z: Float[Array, "*member parameter"], keys: Array
) -> Float[Array, "member value"]:
    grown = simulate(
        _parameters_of(curves, z, keys),
        keys,
        times=np.asarray(curves.schedule.steps) * curves.numerics.dt,
        model=curves.model,
        numerics=curves.numerics,
        relaxation=curves.relaxation,
        observe=curves.observe,
        throw=False,
    )
    problems = _problems_of(grown.colony)
    return jnp.asarray(np.concatenate([*(grown.statistics[name] for name in curves.names), problems], axis=1))


def _of_one_area(
    curves: ColonyCurves, z: Float[Array, "*member parameter"], keys: Array
) -> Float[Array, "member value"]:
    seen, parameters = curves.observe, _parameters_of(curves, z, keys)
    colonies, whole = curves.grown_to_area(parameters, keys)
    points = round(seen.extent / seen.spacing) + 1
    rows = np.full((len(keys), len(curves.names)), np.nan)
    for k in np.flatnonzero(whole):
        colony, its = member_of((colonies, parameters), int(k))
        mask = mask_of(colony, its, curves.relaxation, seen.spacing * (points - 1), points, curves.model)
        found = measure_mask(mask, seen.spacing, curves.names)
        rows[k] = [found[name] for name in curves.names]
    return jnp.asarray(np.concatenate([rows, _problems_of(colonies)], axis=1))


def _parameters_of(curves: ColonyCurves, z: Float[Array, "*member parameter"], keys: Array) -> Parameters:
    """Of every member."""
    names = curves.model.parameters.names
    return Parameters.from_array(names, jnp.exp(jnp.broadcast_to(z, (*keys.shape, len(names)))))


def _problems_of(colonies: Colony) -> Bool[np.ndarray, "member problem"]:
    """Which of `PROBLEMS` each member ran into."""
    return np.stack([np.asarray(getattr(colonies.problems, name)) for name in PROBLEMS], axis=1)


@eqx.filter_jit
def _smooth_members(
    curves: ColonyCurves, z: Float[Array, "member parameter"], keys: Array
) -> Float[Array, "member value"]:
    return map_members(curves.member, z, keys)


@eqx.filter_jit
def _grown(curves: ColonyCurves, z: Float[Array, "member parameter"], keys: Array) -> tuple[Colony, dict[str, Array]]:
    return map_members(curves.grown, z, keys)


@eqx.filter_jit
def _with_tangents(curves: ColonyCurves, z: Float[Array, "member parameter"], keys: Array) -> tuple[Array, Array]:
    def one(z: Array, key: Array) -> tuple[Array, Array]:
        push = partial(jax.jvp, lambda z: curves.member(z, key), (z,))
        return jax.vmap(lambda direction: push((direction,)), out_axes=(None, 0))(jnp.eye(z.size, dtype=z.dtype))

    return map_members(one, z, keys)
