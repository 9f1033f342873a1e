"""`simulate`: one colony or an ensemble, and the result that holds everything about the run."""

import json
import time as clock
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from yeastfit.errors import InputError
from yeastfit.measure.hard import HardStatistics
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.colony import PROBLEMS, Colony, Problems
from yeastfit.model.colony import start as new_colony
from yeastfit.model.forces import stiffness
from yeastfit.model.mitosis import RANDOM, Budding
from yeastfit.model.numerics import Numerics, map_members, on_one_device
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import NAMES, Parameters, Scales
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, Snapshot, trajectory
from yeastfit.storage import written_whole


@runtime_checkable
class Observer(Protocol):
    """What is recorded at the sample times: traced and batched; then `finish`, on the host, makes statistics of it."""

    def __call__(self, snapshot: Snapshot) -> PyTree:
        """Of one colony at one time."""

    def finish(self, observed: Any) -> dict[str, np.ndarray]:
        """Of the whole ensemble."""


@dataclass(frozen=True)
class Simulation:
    """Result of `simulate`. Arrays have the keys' batch axis first, if there was one, then the sample times.

    times: model time, 1/μ*. statistics: by name, lengths in L0. colony: the last state of every member.
    """

    times: Float[np.ndarray, " sample"]
    statistics: dict[str, np.ndarray]
    colony: Colony
    parameters: Parameters
    relaxation: Relaxation
    numerics: Numerics
    scales: Scales
    seconds: float

    @property
    def problems(self) -> dict[str, int]:
        """How many members ran into each of `Problems`; empty when all went well."""
        counts = {name: int(np.sum(getattr(self.colony.problems, name))) for name in PROBLEMS}
        return {name: count for name, count in counts.items() if count}

    @property
    def capacity_reached(self) -> np.ndarray:
        """Whether births were cut because every node slot was taken, per member."""
        return np.asarray(self.colony.problems.capacity_reached)

    def warnings(self) -> list[str]:
        """The problems in words."""
        members = int(np.size(self.capacity_reached))
        return [f"{count} of {members} colonies: {PROBLEMS[name]}" for name, count in self.problems.items()]

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per member and sample time, lengths in L0 and in µm."""
        length, areas = self.scales.length, ("area", "overlap_area")
        units = {"radius": length, "mean_radius": length, "perimeter": length, **dict.fromkeys(areas, length**2)}
        units = {name: unit for name, unit in units.items() if name in self.statistics}
        curves = {name: np.atleast_2d(values) for name, values in self.statistics.items()}
        table = []
        for member in range(next(iter(curves.values())).shape[0]):
            for k, time in enumerate(self.times):
                row: dict[str, Any] = {"member": member, "time": float(time), "hours": self.scales.hours(float(time))}
                row |= {name: float(values[member, k]) for name, values in curves.items()}
                row |= {f"{name}_um{'2' * (name in areas)}": row[name] * unit for name, unit in units.items()}
                table.append(row)
        return table

    def save(self, path: str | Path) -> None:
        """Curves, last states and configuration in one NumPy archive."""
        arrays: dict[str, Any] = {f"statistics/{name}": values for name, values in self.statistics.items()}
        arrays |= {f"colony/{name}": getattr(self.colony, name) for name in _COLONY_ARRAYS}
        arrays |= {f"problems/{name}": getattr(self.colony.problems, name) for name in PROBLEMS}
        arrays |= {f"parameters/{name}": getattr(self.parameters, name) for name in NAMES}
        names = ("union", "contact", "boundary", "turning", "overhang")
        widths = {name: _number(getattr(self.relaxation, name)) for name in names}
        configuration = {
            "numerics": asdict(self.numerics),
            "scales": asdict(self.scales),
            "relaxation": {**widths, "births": self.relaxation.births},
            "seconds": self.seconds,
        }
        with written_whole(path) as temporary, temporary.open("wb") as file:  # a file keeps its name as given
            np.savez_compressed(file, times=self.times, configuration=json.dumps(configuration), **arrays)

    @staticmethod
    def load(path: str | Path) -> "Simulation":
        """What `save` wrote."""
        with np.load(path) as archive:
            groups: dict[str, dict[str, np.ndarray]] = {}
            for key in archive.files:
                group, _, name = key.partition("/")
                groups.setdefault(group, {})[name] = archive[key]
        configuration = json.loads(str(groups["configuration"][""]))
        problems = Problems(**{name: jnp.asarray(values) for name, values in groups["problems"].items()})
        states = {name: jnp.asarray(values) for name, values in groups["colony"].items()}
        return Simulation(
            times=groups["times"][""],
            statistics=groups["statistics"],
            colony=Colony(**states, problems=problems),
            parameters=Parameters(**groups["parameters"]),
            relaxation=Relaxation(**configuration["relaxation"]),
            numerics=Numerics(**configuration["numerics"]),
            scales=Scales(**configuration["scales"]),
            seconds=configuration["seconds"],
        )


_COLONY_ARRAYS = ("positions", "parents", "weights", "lineages", "count", "nutrient", "step")


def member_keys(seed: int | Array, members: int) -> Array:
    """Keys of an ensemble: member i's is the seed's folded with i, whatever the number of members."""
    key = jax.random.key(seed) if isinstance(seed, int | np.integer) else seed
    if members < 1:
        raise InputError(f"members is {members!r}, an ensemble needs at least 1")
    return jax.vmap(partial(jax.random.fold_in, key))(jnp.arange(members))


def simulate(
    parameters: Parameters,
    keys: Array | None = None,
    *,
    times: Sequence[Any] | np.ndarray | Array,
    start: Colony | None = None,
    numerics: Numerics | None = None,
    relaxation: Relaxation | None = None,
    observe: Observer | None = None,
    budding: Budding = RANDOM,
    scales: Scales | None = None,
    throw: bool = True,
) -> Simulation:
    """Grow one colony (`keys` one random key) or an ensemble (`keys` an array of them, see `member_keys`).

    parameters: λ, shared by all members or with one value per member in some fields. times: rising, in model units,
    at least one step and at least one step apart; each is rounded to a whole number of steps. start: instead of keys, a
    colony to go on from (`Simulation.colony`, or `model.colony.start` with other positions or nutrient), or one per
    member along a first axis; times are then later than its own. observe: what to record; by default smooth statistics
    for a relaxed model and scikit-image's for a hard one (`relaxation=HARD`). budding: turns of budding angles, shared
    by all members. What is not a shape can change without recompiling: λ, keys, widths, and times as long as the
    largest number of steps between two of them stays below the same power of two.

    Returns a `Simulation`; its `warnings()` are what a user should see. Raises `InputError`, also where dt turns out
    too large for the springs or a state is not finite, unless `throw` is False: then these are warnings too.

    jax differentiates it, forwards (`jax.jvp`, `jax.jacfwd`) and backwards (`jax.vjp`, `jax.grad`), in λ, the widths,
    and the start's positions, weights and nutrient, and `budding.turns`:

        jax.jacfwd(lambda p: simulate(p, key, times=[5.0]).statistics["radius"])(parameters)

    Backwards costs about seven plain runs however many inputs there are, forwards less than one for each. Nothing is
    checked while tracing. The derivative of one colony is exact and, once colonies crowd, not what an ensemble's mean
    does: see `sensitivity`.
    """
    numerics = numerics or Numerics()
    relaxation = Relaxation() if relaxation is None else relaxation
    if observe is None:
        hard = relaxation.boundary is None
        observe = (HardStatistics if hard else SmoothStatistics)(extent=numerics.domain, spacing=numerics.spacing)
    if (keys is None) == (start is None):
        raise InputError("simulate needs either keys, for new colonies, or start, a colony to go on from")
    began: Array | Colony = keys if start is None else start  # type: ignore[assignment]
    batch = (keys if start is None else start.step).shape  # type: ignore[union-attr]
    inputs = jax.tree.leaves((parameters, began, relaxation, budding))
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in inputs)
    if traced and isinstance(observe, HardStatistics):
        raise InputError("observe is HardStatistics, which jax cannot trace: use SmoothStatistics")
    since = 0 if start is None else _done(start)
    schedule = schedule_of(times, numerics, since)
    if not traced:
        check_alpha(parameters.diffusivity, numerics)
    if not batch:
        began = jax.tree.map(lambda leaf: leaf[None], began)
    watch = clock.perf_counter()
    batched = _per_member(parameters, batch[0] if batch else 1)
    colony, observed = on_one_device(_run(batched, began, schedule, relaxation, numerics, observe, budding))
    if throw and not traced:
        _check_steps(colony, batched, numerics)
    if not batch:
        colony, observed = jax.tree.map(lambda leaf: leaf[0], (colony, observed))
    return Simulation(
        times=_steps_of(times, numerics) * numerics.dt,
        statistics=observe.finish(observed if traced else jax.tree.map(np.asarray, observed)),
        colony=colony,
        parameters=parameters,
        relaxation=relaxation,
        numerics=numerics,
        scales=scales or Scales(),
        seconds=clock.perf_counter() - watch,
    )


def schedule_of(times: Sequence[Any] | np.ndarray | Array, numerics: Numerics, since: int = 0) -> Schedule:
    """Times to step numbers, checked; `since` is the step a colony has done already."""
    steps = _steps_of(times, numerics)
    if steps.size == 0 or steps[0] <= since or (np.diff(steps) < 1).any():
        values = np.array2string(np.atleast_1d(np.asarray(times, dtype=float)), precision=4, threshold=8)
        since_time = f"{since * numerics.dt:g} + " if since else ""
        raise InputError(
            f"times is {values}, it must rise from at least {since_time}dt = {numerics.dt:g} "
            "with at least dt between two times"
        )
    return Schedule.of(steps, since)


def _steps_of(times: Sequence[Any] | np.ndarray | Array, numerics: Numerics) -> np.ndarray:
    """Step numbers; none where times are not finite numbers in a row."""
    values = np.atleast_1d(np.asarray(times, dtype=float))
    sound = values.ndim == 1 and bool(np.isfinite(values).all())
    return np.rint((values if sound else np.zeros(0)) / numerics.dt).astype(int)


def _done(start: Colony) -> int:
    """Steps that a colony, or every colony of an ensemble, has done."""
    step = start.step if not isinstance(start.step, jax.core.Tracer) else jax.lax.stop_gradient(start.step)
    steps = np.unique(np.asarray(step))
    if steps.size != 1:
        raise InputError(f"start holds colonies at steps {steps.tolist()}, all must have done as many")
    return int(steps[0])


@eqx.filter_jit
def _run(
    parameters: Parameters,
    began: Array | Colony,
    schedule: Schedule,
    relaxation: Relaxation,
    numerics: Numerics,
    observe: Observer,
    budding: Budding,
) -> tuple[Colony, PyTree]:
    def one(parameters: Parameters, began: Array | Colony) -> tuple[Colony, PyTree]:
        colony = began if isinstance(began, Colony) else new_colony(began, numerics)
        return trajectory(parameters, colony, schedule, relaxation, numerics, observe, budding)

    return map_members(one, parameters, began)


def _per_member(parameters: Parameters, members: int) -> Parameters:
    """λ with one value per member in every field."""
    for name in NAMES:
        shape = getattr(parameters, name).shape
        if shape not in ((), (members,)):
            raise InputError(f"{name} has shape {shape}, it must be one number or one per member, ({members},)")
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (members,)), parameters)


def _check_steps(colony: Colony, parameters: Parameters, numerics: Numerics) -> None:
    """Raises where what was computed follows from the time step and not from the model."""
    if np.any(colony.problems.unstable):
        needed = 2.0 / np.max(parameters.elasticity * jax.vmap(stiffness)(colony))
        raise InputError(
            f"dt is {numerics.dt:g}, too large for the springs: forward Euler needs dt · elasticity · (degree + 1) "
            f"below 2 and the colonies grown here dt below {needed:.3g}"
        )
    if np.any(colony.problems.not_finite):
        raise InputError(f"dt is {numerics.dt:g} and positions or nutrient became not finite: lower dt")


def _number(width: Array | None) -> float | None:
    return None if width is None else float(width)
