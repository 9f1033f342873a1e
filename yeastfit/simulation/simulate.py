"""`simulate`: one colony or an ensemble of them."""

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from yeastfit.errors import InputError, SimulationError
from yeastfit.kinds import check_kind
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.memory import ITEM, check_count, check_memory
from yeastfit.model.colony import Colony
from yeastfit.model.model import Model
from yeastfit.model.numerics import FIRST_ROOM, WIDE, Numerics, map_members, most_nodes, on_one_device
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, trajectory
from yeastfit.model.snapshot import Snapshot
from yeastfit.numbers import array_of
from yeastfit.seeds import key_of
from yeastfit.simulation.ensemble_in_segments import grown_in_segments
from yeastfit.simulation.result import Simulation
from yeastfit.simulation.until import Until
from yeastfit.specification import module_outside
from yeastfit.text import quoted

SHORT = 4096  # nodes: a colony that cannot come to more is grown by one program


@runtime_checkable
class Observer(Protocol):
    """What is recorded at the sample times: traced and batched; then `finish`, on the host, makes statistics of it."""

    def __call__(self, snapshot: Snapshot) -> PyTree:
        """Of one colony at one time."""

    def finish(self, observed: Any) -> dict[str, np.ndarray]:
        """Of the whole ensemble."""


def member_keys(seed: int | Array, members: int) -> Array:
    """Keys of an ensemble: member i's is the seed's folded with i, whatever the number of members.

    Arguments:
        seed: A whole number from 0 to 2⁶⁴ − 1, or one of jax's keys.
        members: How many.

    Returns:
        One key for each member.

    Raises:
        InputError: The seed is none, or there is no member or more than can be counted.
    """
    if not isinstance(members, int | np.integer) or isinstance(members, bool) or members < 1:
        raise InputError(f"members is {quoted(members)}, it must be a whole number of at least 1")
    check_count("members", members)
    return _folded(key_of(seed), np.arange(members, dtype=np.int32))


def simulate(
    parameters: Parameters,
    keys: Array | None = None,
    *,
    times: Sequence[Any] | np.ndarray | Array,
    until: Mapping[str, float] | None = None,
    model: Model | None = None,
    start: Colony | None = None,
    numerics: Numerics | None = None,
    relaxation: Relaxation | None = None,
    observe: Observer | None = None,
    scales: Scales | None = None,
    throw: bool = True,
    keep: str | Path | None = None,
) -> Simulation:
    """Grow one colony, or an ensemble of them.

    Differentiable by JAX, forwards (`jax.jvp`, `jax.jacfwd`) and backwards (`jax.vjp`, `jax.grad`), in parameters,
    widths, the start's positions, weights and nutrient, and arrays that rules of the model hold. What has no width in
    the relaxation, as all of `HARD`, jumps, and its derivative is 0:

        jax.jacfwd(lambda p: simulate(p, key, times=[5.0]).statistics["radius"])(parameters)

    Reverse mode costs about seven plain runs however many inputs there are, forward mode less than one for each.
    Nothing is checked while tracing. The derivative of one colony is exact but, once cells crowd, not the derivative of
    an ensemble's mean: see `sensitivity`.

    Parameters, keys, widths and times can change without recompiling, as long as shapes stay and the largest number of
    steps between two times stays below the same power of two.

    Births are cut only where `numerics.capacity` says so, or memory ends: colonies that could have more than `SHORT`
    nodes, or have outgrown `FIRST_ROOM`, grow in segments (`Segments`), one colony on each device. Their arrays get
    more room whenever that is needed; in dishes wider than `WIDE`, where colonies are expected to become large, they
    begin with room for `SHORT`. Derivatives need arrays of fixed length: while tracing, a capacity of None
    is `FIRST_ROOM`.

    Arguments:
        parameters: Shared by all members, or with one value per member for some. What rules bring has its default
            where nothing is given.
        keys: One random key for one colony, or an array of keys (`member_keys`) for an ensemble.
        times: Model times, rising, at least one step from the start and from each other; each is rounded to a whole
            number of steps.
        until: A statistic that is observed, or "nodes" or "cells", and its value, as in {"area": 24500.0}: each colony
            grows to the first step at which that is reached (`Simulation.reached`), or of several the first. `times`
            is then one time, at which colonies that have not come so far end. For derivatives simulate to the time
            reached.
        model: The rules; by default the source's.
        start: Instead of keys, a colony to continue (`Simulation.colony`, or `Model.start` with other positions or
            nutrient), or one per member along a first axis. Times are then later than its own.
        numerics: Grid, time step and capacity.
        relaxation: Smoothing widths; `HARD` for the hard model.
        observe: What to record; by default smooth statistics of a relaxed model and scikit-image's of a hard one.
        scales: Units of the result's tables.
        throw: Whether a time step too large for the springs, or a state that is not finite, is an error. Otherwise
            they are among the result's warnings.
        keep: Folder in which colonies that grow in segments are kept as they grow, every half minute. If the process is
            ended, the same call goes on from there. Files are removed when all colonies have grown.

    Returns:
        A `Simulation`; show its `warnings()` to users.

    Raises:
        InputError: An argument is not admissible, `until` is traced or names nothing that is observed, or dt turned
            out too large for the springs.
        SimulationError: Positions or nutrient became not finite.
    """
    numerics, model = Numerics() if numerics is None else numerics, Model() if model is None else model
    relaxation = Relaxation() if relaxation is None else relaxation
    check_kind("parameters", parameters, Parameters)
    check_kind("model", model, Model)
    check_kind("numerics", numerics, Numerics)
    check_kind("relaxation", relaxation, Relaxation)
    if keys is not None:
        check_kind("keys", keys, jax.Array, "keys of jax, such as yeastfit.member_keys(seed, members)")
    parameters = model.complete(parameters)
    if observe is None:
        hard = relaxation.boundary is None
        observe = (HardStatistics if hard else SmoothStatistics)(extent=numerics.domain, spacing=numerics.spacing)
    if (keys is None) == (start is None):
        raise InputError("simulate needs either keys, for new colonies, or start, a colony to go on from")
    began: Array | Colony = keys if start is None else model.resumed(start)  # type: ignore[assignment]
    batch = (keys if start is None else start.step).shape  # type: ignore[union-attr]
    inputs = jax.tree.leaves((parameters, began, relaxation, model))
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in inputs)
    if traced and isinstance(observe, HardStatistics):
        raise InputError("observe is HardStatistics, which jax cannot trace: use SmoothStatistics")
    since = 0 if start is None else _done(start)
    schedule = schedule_of(times, numerics, since)
    if not traced:
        check_alpha(parameters.diffusivity, numerics)
    if not batch:
        began = jax.tree.map(lambda leaf: leaf[None], began)
    end = None if until is None else Until.of(until, observe)
    if end is not None and (traced or len(schedule.steps) != 1):
        raise InputError("until ends growth where a colony is large enough: give one time, and trace only with times")
    watch = clock.perf_counter()
    members = batch[0] if batch else 1
    if members == 0:
        raise InputError(f"{'keys' if start is None else 'start'} is empty, need one for each of at least one colony")
    kept = numerics.state_size + len(schedule.steps) * getattr(observe, "sample_size", 0.0)
    check_count("members", members, kept)
    batched = _per_member(parameters, members)
    if end is None and (traced or is_small(float(np.asarray(schedule.steps)[-1] - since) * numerics.dt, numerics)):
        short = numerics if traced or numerics.room <= SHORT else replace(numerics, capacity=None)
        colony, observed = on_one_device(_run(batched, began, schedule, relaxation, short, observe, model))
        outgrown = not traced and bool(np.asarray(colony.problems.capacity_reached).any())
        done = not outgrown or colony.parents.shape[-1] >= numerics.most_room
    else:
        done = False
    if not done:
        few = replace(numerics, capacity=min(SHORT if numerics.domain > WIDE else FIRST_ROOM, numerics.most_room))
        samples = np.asarray(schedule.steps).tolist()
        colony, observed = grown_in_segments(
            batched, began, samples, relaxation, numerics, few, observe, model, end, keep
        )
    reached = None if end is None else end.times_reached(colony, observed, numerics)
    if throw and not traced:
        _check_steps(colony, batched, numerics, model)
    if not batch:
        colony, observed, reached = jax.tree.map(lambda leaf: leaf[0, ...], (colony, observed, reached))
    return Simulation(
        times=_steps_of(times, numerics) * numerics.dt,
        statistics=observe.finish(observed if traced else jax.tree.map(np.asarray, observed)),
        colony=colony,
        parameters=parameters,
        relaxation=relaxation,
        numerics=numerics,
        model=model,
        scales=scales or Scales(),
        seconds=clock.perf_counter() - watch,
        until=None if until is None else dict(until),
        reached=reached,
    )


def sample_times(time: float, every: float, numerics: Numerics) -> np.ndarray:
    """Times at an interval, the last one included.

    Arguments:
        time: The last one.
        every: The interval.
        numerics: Of the simulation.

    Returns:
        every, 2 · every, … and time.

    Raises:
        InputError: A time is shorter than a step, `every` is longer than all or shorter than a step, or there would
            be more steps than can be counted or more times than memory holds.
    """
    if not 0 < time < np.inf:
        raise InputError(f"time is {time:g}, it must be a number above 0")
    if time < numerics.dt * (1 - 1e-6):
        raise InputError(f"time is {time:g}, it must be at least dt = {numerics.dt:g}")
    if not 0 < every <= time:
        raise InputError(f"every is {every:g}, it must be above 0 and at most the time, {time:g}")
    numerics.check_steps(time)
    if every < numerics.dt * (1 - 1e-6):
        raise InputError(f"every is {every:g}, it must be at least dt = {numerics.dt:g}")
    check_memory(ITEM * time / every, f"every is {every:g}, which in a time of {time:g}")
    regular = np.arange(1, int(time / every + 1e-9) + 1) * every
    return np.append(regular[regular < time - 0.5 * numerics.dt], time)


def schedule_of(times: Sequence[Any] | np.ndarray | Array, numerics: Numerics, since: int = 0) -> Schedule:
    """Times to step numbers, checked; `since` is the step a colony has done already."""
    steps = _steps_of(times, numerics)
    if steps.size == 0 or steps[0] <= since or (np.diff(steps) < 1).any():
        values = np.array([float(f"{time:.7g}") for time in np.atleast_1d(np.asarray(times, dtype=float)).flat])
        since_time = f"{since * numerics.dt:g} + " if since else ""
        raise InputError(
            f"times is {quoted(values)}, it must rise from at least {since_time}dt = {numerics.dt:g} "
            "with at least dt between two times"
        )
    return Schedule.of(steps, since)


def _steps_of(times: Sequence[Any] | np.ndarray | Array, numerics: Numerics) -> np.ndarray:
    """Step numbers; none where times are not finite numbers in a row. Raises `InputError` where they are no numbers."""
    values = np.atleast_1d(array_of(times, "times"))
    sound = values.ndim == 1 and bool(np.isfinite(values).all())
    if sound and values.size:
        numerics.check_steps(float(values.max()))
    return np.rint((values if sound else np.zeros(0)) / numerics.dt).astype(int)


def _done(start: Colony) -> int:
    """Steps that a colony, or every colony of an ensemble, has done."""
    step = start.step if not isinstance(start.step, jax.core.Tracer) else jax.lax.stop_gradient(start.step)
    steps = np.unique(np.asarray(step))
    if steps.size != 1:
        raise InputError(f"start holds colonies at steps {steps.tolist()}, all must have done as many")
    return int(steps[0])


@jax.jit
def _folded(key: Array, numbers: Array | np.ndarray) -> Array:
    return jax.vmap(partial(jax.random.fold_in, key))(numbers)


@eqx.filter_jit
def _run(
    parameters: Parameters,
    began: Array | Colony,
    schedule: Schedule,
    relaxation: Relaxation,
    numerics: Numerics,
    observe: Observer,
    model: Model,
) -> tuple[Colony, PyTree]:
    def one(parameters: Parameters, began: Array | Colony) -> tuple[Colony, PyTree]:
        colony = began if isinstance(began, Colony) else model.start(began, numerics)
        return trajectory(parameters, colony, schedule, relaxation, numerics, observe, model)

    return map_members(one, parameters, began)


def is_small(time: float, numerics: Numerics) -> bool:
    """Whether colonies are grown by one program first, whose arrays have one length."""
    return most_nodes(time) <= SHORT or (numerics.capacity is not None and numerics.capacity <= FIRST_ROOM)


def _per_member(parameters: Parameters, members: int) -> Parameters:
    """λ with one value per member in every field."""
    for name, value in parameters.values.items():
        shape = value.shape
        if shape not in ((), (members,)):
            raise InputError(f"{name} has shape {shape}, it must be one number or one per member, ({members},)")
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (members,)), parameters)


def _check_steps(colony: Colony, parameters: Parameters, numerics: Numerics, model: Model) -> None:
    """Raises where what was computed follows from the time step and not from the model."""
    if np.asarray(colony.problems.unstable).any():
        needed = 2.0 / np.max(parameters.elasticity * jax.vmap(model.springs.stiffness)(colony))
        raise InputError(
            f"dt is {numerics.dt:g}, too large for the springs: forward Euler needs dt · elasticity · (degree + 1) "
            f"below 2 and the colonies grown here dt below {needed:.3g}"
        )
    not_finite, left = (np.asarray(getattr(colony.problems, name)) for name in ("not_finite", "left_domain"))
    if (not_finite & ~left).any():
        own = ", ".join(type(part).__name__ for part in model.parts if module_outside(type(part)))
        raise SimulationError(
            f"dt is {numerics.dt:g} and positions or nutrient became not finite: lower dt"
            + (f", or see whether {own} returns nan" if own else "")
        )
    if not_finite.any():
        raise SimulationError(
            f"domain is {numerics.domain:g}, and positions or nutrient became not finite after a colony had come to "
            "its edge: raise domain, or end earlier"
        )
