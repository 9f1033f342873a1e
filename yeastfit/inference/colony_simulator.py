"""Colonies of the algebraic model as a `Simulator`: one colony a row, measured as the data were.

Colonies are hard ones. They grow on a dish wide enough for the largest colony that was seen, with room for every cell
that is born.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from operator import itemgetter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from yeastfit.errors import InputError
from yeastfit.inference.colony_curves import ColonyCurves
from yeastfit.inference.resolution import FARTHER, Resolution, seen_width, usual_resolution
from yeastfit.inference.simulator import Rows, Seeds, Values, once
from yeastfit.inference.targets import Targets
from yeastfit.kinds import check_kind
from yeastfit.measure.statistics.model_as_mask import HardStatistics, mask_of
from yeastfit.measure.statistics.polar import Polar
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.memory import check_memory
from yeastfit.model.colony import PROBLEMS
from yeastfit.model.model import RULES, Model, check_name
from yeastfit.model.numerics import POINT, Numerics, most_nodes
from yeastfit.model.nutrient import largest_diffusivity
from yeastfit.model.parameters import PARAMETERS, Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.simulate import Schedule
from yeastfit.observable import Observable
from yeastfit.parameter_set import ParameterSet
from yeastfit.seeds import keys_of
from yeastfit.simulation.simulate import SHORT, member_keys, schedule_of, simulate
from yeastfit.specification import Specification, found_at, module_outside, path_of, source_digest

DEFAULT_FREE = ("mobility", "metabolic_rate", "aspect_ratio")
MARGIN = 3.0  # L0 between a colony and the edge of the dish: several diffusion lengths, nutrient is untouched there
OUTLINE_PIXEL, AROUND = (
    0.05,
    1.5,
)  # L0, of `outlines`: a pixel, and what is shown around the farthest node
SEEN = PROBLEMS | {
    "left_domain": f"a node came to the edge of the dish, which is over {FARTHER:g} times as wide as any colony of the "
    "data: these parameters make larger ones, which are measured as far as the dish goes",
    "not_finite": "positions or nutrient are not finite, after a node came to the edge of the dish, or dt is too large",
}
"""`PROBLEMS` of colonies in a dish that the data make."""
NOT_COME = (
    "the colony did not come to {area:.4g} L0², the area at which it would be compared, by the data's time or before "
    "it had all the nodes that its capacity allows, and counts as none of the data's kind; a larger growth rate leaves "
    "more time"
)

TOO_FAST = "diffusivity is above {most:.3g}, which needs a shorter time step, or a coarser grid, in single precision"
ROUNDING = 1e-5  # of log λ, in single precision


@dataclass(frozen=True)
class ColonySimulator:
    """Grows one colony for each row and measures it.

    Attributes:
        parameters: The free ones.
        fixed: Values of the others.
        observables: The columns.
        curves: What is grown and recorded.
        measured: Which of the curves' points are columns.
        resolution: That `of` was asked for; None where the simulator was not made by it.
        problems: What colonies ran into, by what it means and what to do; they are measured all the same.
    """

    parameters: ParameterSet
    fixed: dict[str, float]
    observables: tuple[Observable, ...]
    curves: ColonyCurves
    measured: Bool[np.ndarray, " point"]
    resolution: Resolution | None = None
    problems: Counter[str] = field(default_factory=Counter)

    @staticmethod
    def of(
        targets: Targets,
        free: Sequence[str] = DEFAULT_FREE,
        fixed: Mapping[str, float] | None = None,
        resolution: Resolution | None = None,
        model: Model | None = None,
        area: float | None = None,
    ) -> "ColonySimulator":
        """Colonies that are seen as the data of one condition are.

        Arguments:
            targets: The data; columns are in the order of `Targets.values`.
            free: Names of the free parameters.
            fixed: Values of others, by name; the default of those that are not named.
            resolution: By default Δt = 0.005 and a grid of 0.1 L0, or that of `usual_resolution` for large colonies.
            model: The rules of the colonies; by default the source's.
            area: In L0²: colonies are measured when they come to it, at the data's time at the latest. The data are
                statistics of masks at one time then.

        Raises:
            InputError: A name or value is not admissible, or two times lie closer than a time step.
        """
        check_kind("targets", targets, Targets, "yeastfit.Targets of one condition")
        model = Model() if model is None else model
        check_kind("model", model, Model)
        resolution, imaging, seen = resolution or usual_resolution(targets), targets.imaging, seen_width(targets)
        assert imaging is not None
        dt, spacing, times = resolution.dt, resolution.spacing, targets.times
        if times[0] < dt or (np.diff(times) < dt).any():
            unit = 1.0 / imaging.scales.rate
            found = ", ".join(f"{unit * time:.4g}" for time in times)
            raise InputError(
                f"targets: times in hours are {found}, they must be at least a time step apart, {unit * dt:.3g} hours "
                f"at dt = {dt:g}: give a smaller dt"
            )
        check_spacing(spacing)
        reach = f"targets: colonies reach {imaging.extent:.3g} L0 from their start, a grid of spacing {spacing:g} there"
        check_memory(POINT * (seen / spacing) ** 2, reach)
        domain = 2 * spacing * np.ceil((0.5 * seen + MARGIN) / spacing)
        most, room = most_nodes(float(times[-1]), model.births.doublings), resolution.capacity
        if most <= SHORT and (room is None or room > SHORT):  # arrays have room for what can be, not for what may
            room = most
        numerics = Numerics(float(domain), spacing, dt, room, substeps=resolution.substeps)
        if imaging.estimator == "smooth":
            observe: SmoothStatistics | HardStatistics = SmoothStatistics(
                seen, imaging.spacing, imaging.smoothing, statistics=targets.names
            )
        else:
            observe = HardStatistics(seen, imaging.spacing, targets.names)
        curves = ColonyCurves(targets.names, numerics, observe, HARD, schedule_of(times, numerics))
        if area is not None and (len(times) > 1 or imaging.estimator == "smooth"):
            raise InputError(
                f"area is {area:g}, at which colonies are compared whatever their age: targets must have one time and "
                f'the estimator "mask", they have {len(times)} and {imaging.estimator!r}'
            )
        curves, values = replace(curves, model=model, area=area), parameter_values(fixed, model.parameters)
        chosen = model.parameters.subset(free)
        held = {name: value for name, value in values.items() if name not in chosen}
        return ColonySimulator(chosen, held, targets.observables, curves, targets.measured.ravel(), resolution)

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters of the model, free and held."""
        return self.curves.model.parameters.names

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Curves, one row a proposal; nan throughout where a value is not finite, or diffusion too fast to compute."""
        logs, kind = self.logarithms(values), jnp.result_type(float)
        diffusivity = logs[:, self.curves.model.parameters.names.index("diffusivity")]
        most = largest_diffusivity(self.curves.numerics, kind)
        fast = diffusivity > np.log(most)
        np.minimum(diffusivity, np.log(most) - ROUNDING, out=diffusivity)
        z = jnp.asarray(logs, kind)
        found = np.asarray(self.curves.members(z, keys_of(seeds)), dtype=float)
        each = found[once(values, seeds)]
        self._count(each)
        if self.curves.area is not None:
            missed = int(np.isnan(each[:, : -len(PROBLEMS)]).all(axis=1).sum())
            self.problems.update({NOT_COME.format(area=self.curves.area): missed} if missed else {})
        too_fast = int(fast[once(values, seeds)].sum())
        self.problems.update({TOO_FAST.format(most=most): too_fast} if too_fast else {})
        rows = found[:, : -len(PROBLEMS)][:, self.measured]
        return np.where(np.isfinite(rows).all(axis=1, keepdims=True) & ~fast[:, None], rows, np.nan)

    def in_blocks_of(self, rows: int) -> "ColonySimulator":
        """The same, for calls with so many rows: fewer than `BLOCK` are not filled up. No value depends on it."""
        return replace(self, curves=replace(self.curves, block=rows))

    @property
    def about(self) -> str:
        """What decides over a colony, beside its free parameters and its seed."""
        curves, observe = self.curves, self.curves.observe
        of_rules = {f"{question} {rule.pop('rule')}": rule for question, rule in curves.model.asdict().items()}
        rules = [name + "".join(f" {key} {value}" for key, value in each.items()) for name, each in of_rules.items()]
        image = {f"image {name}": one for name, one in _plain_fields(observe).items() if isinstance(one, int | float)}
        named = {**self.fixed, **asdict(curves.numerics), **image, "area": curves.area}
        measured = "masks" if isinstance(observe, HardStatistics) else "smooth"
        own = [type(part) for part in curves.model.parts if module_outside(type(part))]
        sources = [f"{rule.__name__} {source_digest(rule)}" for rule in own]
        return ", ".join([*rules, *sources, measured, *(f"{name} {value}" for name, value in named.items())])

    @property
    def specification(self) -> Specification:
        """How other processes make the same simulator.

        Raises:
            InputError: A rule or a statistic is defined where others cannot import it.
        """
        curves, observe = self.curves, self.curves.observe
        rules = [type(part) for part in curves.model.parts if module_outside(type(part))]
        entries = [STATISTICS[one] for one in curves.names]
        forms = (form for one in entries for form in (one.smooth, one.mask, one.nodes) if form)
        arguments = {
            "free": self.parameters.names,
            "fixed": self.fixed,
            "observables": [(one.statistic, one.time) for one in self.observables],
            "measured": self.measured,
            "names": curves.names,
            "numerics": asdict(curves.numerics),
            "observe": {"hard": isinstance(observe, HardStatistics)} | _plain_fields(observe),
            "relaxation": _plain_fields(curves.relaxation),
            "schedule": _plain_fields(curves.schedule),
            "model": curves.model.asdict(),
            "area": curves.area,
            "rules": [path_of(rule) for rule in rules],
        }
        imports = dict.fromkeys(module for thing in (*rules, *forms) for module in module_outside(thing))
        return Specification(path_of(colony_simulator_of), arguments, tuple(imports))

    def logarithms(self, values: Values) -> np.ndarray:
        """Log λ of all the model's parameters [row, parameter], the free ones from the rows."""
        names = self.curves.model.parameters.names
        with np.errstate(divide="ignore"):
            found = np.tile(np.log([self.fixed.get(name, 1.0) for name in names]), (len(values), 1))
            for k, name in enumerate(self.parameters.names):
                found[:, names.index(name)] = np.log(values[:, k])
        return found

    def outlines(self, values: Values, time: float, seed: int = 0) -> list[Bool[np.ndarray, "x y"]]:
        """Draw one colony at each row.

        Arguments:
            values: Free parameters.
            time: At which, in 1/μ*, unless colonies are compared at one area.
            seed: Of the colonies.

        Returns:
            Where the cells of each colony are; `OUTLINE_PIXEL` a pixel.
        """
        numerics = self.curves.numerics
        model, logs = self.curves.model, jnp.asarray(self.logarithms(values), jnp.result_type(float))
        parameters = Parameters.from_array(model.parameters.names, jnp.exp(logs))
        keys = member_keys(seed, len(values))
        if self.curves.area is not None:
            grown, _ = self.curves.grown_to_area(parameters, keys)
        else:
            observe = SmoothStatistics(extent=numerics.domain, spacing=numerics.spacing)
            how = {"model": model, "numerics": numerics, "relaxation": HARD, "observe": observe, "throw": False}
            grown = simulate(parameters, keys, times=[time], **how).colony  # type: ignore[arg-type]
        places = np.abs(np.asarray(grown.positions)[np.asarray(grown.alive)])
        farthest = places.max(where=np.isfinite(places), initial=0.0)  # what is not finite is not in the picture
        points = 2 * int(np.ceil((float(farthest) + AROUND) / OUTLINE_PIXEL)) + 1
        each = (jax.tree.map(itemgetter(k), (grown, parameters)) for k in range(len(values)))
        width = OUTLINE_PIXEL * (points - 1)
        return [mask_of(colony, its, HARD, width, points, model) for colony, its in each]

    def _count(self, values: np.ndarray) -> None:
        met = values[:, -len(PROBLEMS) :].sum(axis=0).astype(int).tolist()
        self.problems.update({SEEN[name]: count for name, count in zip(PROBLEMS, met, strict=True) if count})


def check_spacing(spacing: float) -> None:
    """Raise `InputError` where the nutrient around a colony has no point of the grid."""
    if spacing > MARGIN:
        raise InputError(f"spacing is {spacing:g}, it must be at most {MARGIN:g} L0, the margin around a colony")


def colony_simulator_of(
    *,
    free: Sequence[str],
    fixed: Mapping[str, float],
    observables: Sequence[tuple[str, float]],
    measured: Sequence[bool],
    names: Sequence[str],
    numerics: Mapping[str, Any],
    observe: Mapping[str, Any],
    relaxation: Mapping[str, Any],
    schedule: Mapping[str, Any],
    model: Mapping[str, Any],
    area: float | None,
    rules: Sequence[str],
) -> ColonySimulator:
    """The simulator of a `ColonySimulator.specification`, whose arguments are plain data."""
    for rule in map(found_at, rules):
        check_name(rule)
        RULES[rule.question].setdefault(rule.name, rule)
    seen: dict[str, Any] = {**observe, "statistics": tuple(observe["statistics"])}
    hard = seen.pop("hard")
    if seen.get("polar"):
        seen["polar"] = Polar(**seen["polar"])
    curves = ColonyCurves(
        tuple(names),
        Numerics(**numerics),
        HardStatistics(**seen) if hard else SmoothStatistics(**seen),
        Relaxation(**relaxation),
        Schedule(jnp.asarray(schedule["steps"]), schedule["longest"]),
        Model.of(model),
        area=area,
    )
    columns = tuple(Observable(*one) for one in observables)
    chosen = curves.model.parameters.subset(free)
    return ColonySimulator(chosen, dict(fixed), columns, curves, np.array(measured, dtype=bool))


def _plain_fields(module: Any) -> dict[str, Any]:
    """Fields of an equinox module as plain data; arrays of one number become that number, bit by bit."""
    found = {each.name: getattr(module, each.name) for each in fields(module)}
    found = {name: asdict(one) if isinstance(one, Polar) else one for name, one in found.items()}
    return {name: np.asarray(one).tolist() if isinstance(one, jax.Array) else one for name, one in found.items()}


def parameter_values(given: Mapping[str, float] | None, known: ParameterSet = PARAMETERS) -> dict[str, float]:
    """All of a model's parameters by name: those given, and the defaults of the others."""
    values = dict(given or {})
    known.check(values)
    return {**known.defaults, **values}
