"""Are derivatives right? Forward mode against differences and against reverse mode, on one's own model and parameters.

Forward mode gives J d, the derivative of f at x along a direction d. Differences give

    D_h = (f(x + h d) − f(x − h d)) / 2h    and    E_h = |f(x + h d) − 2 f(x) + f(x − h d)| / 2h,

half the difference of the two one-sided slopes: what rounding, a kink or a jump between the three points can do to D_h,
and more than curvature does. No one h suits all, and a simulated colony has a kink every 10⁻⁵ or so, where nodes pass
lines of the grid. So D_h is as uncertain as the larger of E_h and the change to the next h, and the least uncertain one
is taken. Steps between whose two sides the order of parents changes are left out: it is discrete (MODEL.md section 5).

Reverse mode gives Jᵀ v, and ⟨v, J d⟩ = ⟨Jᵀ v, d⟩ for every d, here for one random v, to rounding.

J d itself is uncertain where an input changed by its last bit changes it: colonies are chaotic. Where uncertainties are
large, neither agreement nor disagreement means anything, and the verdict is "uncertain".
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PyTree

from yeastfit.errors import InputError
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.colony import start
from yeastfit.model.mitosis import Budding
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import NAMES, PARAMETERS, Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Snapshot
from yeastfit.simulation import Observer, Simulation, schedule_of, simulate

STEPS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
TRANSPOSE = 1e-9  # what rounding may leave between forward and reverse mode
NUDGE = 1e-15  # a change of the inputs as large as their rounding
ROUNDINGS = 1e3  # what a program rounds on the way, in units of what that changes
FLOOR = 1e-3  # derivatives below this share of the value itself are compared to that share
LARGEST = 100.0  # L0 per unit of log λ: one hundredth more λ would move a node by a whole cell
Pair = Callable[[PyTree], tuple[PyTree, PyTree]]  # of inputs: outputs and discrete decisions
WIDTHS = ("union", "contact", "boundary")
VERDICTS = {
    "agrees": "agree",
    "crossed": "were not compared: every step crosses a change of the order of parents, or another discrete decision",
    "uncertain": "could not be compared: differences are all kinks, curvature and rounding",
    "differs": "differ",
    "not finite": "are not finite",
}


@dataclass(frozen=True)
class Comparison:
    """One derivative by jax and by another way: of the number `output[index]` along a direction.

    by: "differences", or "transpose", ⟨v, J d⟩ beside ⟨Jᵀ v, d⟩. uncertainty: of both. scale: what the tolerance and
    `error` refer to, the larger of both derivatives and `FLOOR` times the value.
    """

    by: str
    along: str
    output: str
    index: tuple[int, ...]
    forward: float
    other: float
    uncertainty: float
    scale: float
    verdict: str

    @property
    def error(self) -> float:
        """|forward − other| / scale."""
        return abs(self.forward - self.other) / self.scale if self.scale else 0.0


@dataclass(frozen=True)
class GradientCheck:
    """Result of `check_derivatives` and `check_gradients`: every comparison, and what a user should see.

    times: what the first index of an output stands for, if anything. growth: by direction and at `growth_times`, how
    far a unit of the direction moves the node that it moves most, to first order. remarks: on the model itself.
    """

    comparisons: tuple[Comparison, ...]
    tolerance: float
    times: tuple[float, ...] = ()
    growth_times: tuple[float, ...] = ()
    growth: dict[str, Float[np.ndarray, " time"]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all comparisons agree; what could not be compared has not passed."""
        return bool(self.comparisons) and all(c.verdict == "agrees" for c in self.comparisons)

    @property
    def counts(self) -> dict[str, int]:
        """How many comparisons came to each verdict."""
        found = Counter(c.verdict for c in self.comparisons)
        return {verdict: found[verdict] for verdict in VERDICTS if found[verdict]}

    def warnings(self) -> list[str]:
        """What does not agree, and what makes derivatives of one colony useless though they are right."""
        bad = [f"{n} of {len(self.comparisons)} derivatives {VERDICTS[v]}" for v, n in self.counts.items()]
        return [line for line in bad if not line.endswith(" agree")] + list(self.remarks)

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per comparison."""
        return [
            asdict(c) | {"index": " ".join(map(str, c.index)), "time": self._time(c), "error": c.error}
            for c in self.comparisons
        ]

    def summary(self) -> list[dict[str, str]]:
        """In words, a line for each direction: the comparison with differences that is least in order."""
        order, lines = list(VERDICTS), []
        for along in dict.fromkeys(c.along for c in self.comparisons):
            *differences, reverse = (c for c in self.comparisons if c.along == along)
            worst = max(differences, key=lambda c: (order.index(c.verdict), c.error))
            lines.append(
                {
                    "along": along,
                    "worst": self._of(worst),
                    "derivative": f"{worst.forward:.4g}",
                    "error": "" if np.isnan(worst.error) else f"{worst.error:.0e}",
                    "verdict": worst.verdict + ("" if reverse.verdict == "agrees" else f", reverse {reverse.verdict}"),
                }
            )
        return lines

    @property
    def status(self) -> str:
        """Passed or not, in a line."""
        counts = ", ".join(f"{n} {verdict}" for verdict, n in self.counts.items())
        return f"{'passed' if self.passed else 'not passed'}: of {len(self.comparisons)} derivatives {counts}"

    def __str__(self) -> str:
        lines = [list(line.values()) for line in self.summary()]
        lines.insert(0, list(self.summary()[0]))
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        table = ["  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]
        return "\n".join([*table, self.status, *(f"warning: {line}" for line in self.warnings())])

    def _time(self, c: Comparison) -> float | None:
        return float(self.times[c.index[0]]) if self.times and c.index else None

    def _of(self, c: Comparison) -> str:
        time = self._time(c)
        return c.output + (f" t={time:g}" if time is not None else f" {list(c.index)}" if c.index else "")


def check_derivatives(
    function: Callable[[PyTree], PyTree],
    inputs: PyTree,
    directions: Mapping[str, PyTree] | None = None,
    *,
    tolerance: float = 1e-6,
    steps: Sequence[float] = STEPS,
    seed: int = 0,
    has_aux: bool = False,
) -> GradientCheck:
    """Check jax's derivatives of any function of floating-point arrays, both ways, in double precision.

    function: of one pytree, to a pytree of arrays; with `has_aux`, to a pair of that and of its discrete decisions,
    arrays that must be the same on both sides of a difference. directions: by name, pytrees like `inputs`; by default a
    random one for each array of theirs, as large as its largest entry. steps: h, in units of a direction.
    tolerance: relative, of differences; reverse and forward mode agree to 1e-9. Where value and derivative are both 0,
    there is nothing to be relative to, and the verdict is likely "uncertain".
    Raises `InputError` where inputs or directions are not floating-point arrays of the same shapes.
    """
    with jax.enable_x64(True):
        x = _double(inputs, "inputs")
        along = _random(x, seed) if directions is None else _like(x, directions)
        pair = function if has_aux else lambda x: (function(x), ())
        with np.errstate(all="ignore"):  # what is not finite gets a verdict
            return GradientCheck(_compare(pair, x, along, tolerance, steps, seed)[0], tolerance)


def check_gradients(
    parameters: Parameters | None = None,
    *,
    times: Sequence[float] | np.ndarray = (1.5, 3.0),
    key: Array | int = 0,
    numerics: Numerics | None = None,
    relaxation: Relaxation | None = None,
    observe: Observer | None = None,
    tolerance: float = 5e-4,
    steps: Sequence[float] = STEPS,
    draws: int = 2,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> GradientCheck:
    """Check jax's derivatives of every statistic at every time through `simulate`, both ways, in double precision.

    In log λ1..λ7 (where λ is 0, in λ / its default), the logarithms of the three widths, and in `draws` random
    directions each of initial positions, of initial nutrient around the colony, and of budding angles, as large as 1.
    Also how these derivatives grow with time.

    parameters: one value each. key: of the colony, or a seed. Double precision draws another colony from a key than
    single precision does. numerics: by default a dish 12 L0 wide. relaxation: by default with a contact of 0.2.
    tolerance: relative; the nutrient is solved to 1e-6, of which differences in λ1 were seen to make 1e-4. progress: is
    called with the number of directions done and to do.
    Raises `InputError` for rules without a derivative, and where `simulate` does.
    """
    relaxation = Relaxation(contact=0.2) if relaxation is None else relaxation
    numerics = numerics or Numerics(domain=12.0, spacing=0.2, capacity=64)
    observe = observe or SmoothStatistics(extent=numerics.domain, spacing=numerics.spacing)
    values = _values(parameters or Parameters())
    _check_smooth(relaxation)
    if draws < 1:
        raise InputError(f"draws is {draws}, it must be at least 1")
    wanted = np.asarray(schedule_of(times, numerics).steps)
    seen = np.union1d(np.linspace(0, wanted[-1], 21)[1:].round().astype(int), wanted)
    seen, asked = seen[seen > 0], np.isin(seen[seen > 0], wanted)
    with jax.enable_x64(True):
        colony = start(jax.random.key(key) if isinstance(key, int | np.integer) else key, numerics)
        relaxation, lam = _double(relaxation, "relaxation"), jnp.array(values)
        unit = jnp.where(lam > 0, lam, jnp.array([PARAMETERS[name].default for name in NAMES]))
        origin = {
            "λ": jnp.zeros(len(NAMES)),
            "widths": jnp.zeros(len(WIDTHS)),
            "positions": colony.positions,
            "nutrient": colony.nutrient,
            "budding": jnp.zeros(draws),
        }

        def grown(x: dict[str, Array]) -> Simulation:
            widths = [getattr(relaxation, name) * (1 + x["widths"][k]) for k, name in enumerate(WIDTHS)]
            return simulate(
                # not through Parameters(...), which would refuse the step beyond a largest value
                eqx.tree_at(lambda p: [getattr(p, name) for name in NAMES], Parameters(), [*(lam + unit * x["λ"])]),
                start=eqx.tree_at(lambda c: (c.positions, c.nutrient), colony, (x["positions"], x["nutrient"])),
                times=seen * numerics.dt,
                numerics=numerics,
                relaxation=eqx.tree_at(lambda r: [getattr(r, name) for name in WIDTHS], relaxation, widths),
                observe=_AndPositions(observe),
                budding=_Turned(amounts=x["budding"]),
            )

        def curves(x: dict[str, Array]) -> tuple[PyTree, PyTree]:
            run = grown(x)
            statistics = {name: values[asked] for name, values in run.statistics.items() if name != POSITIONS}
            return (statistics, run.statistics[POSITIONS]), _births(run)

        remarks = grown(origin).warnings() + _chatter(values, relaxation, numerics)
        along = _directions(origin, numerics, draws)
        with np.errstate(all="ignore"):
            comparisons, tangents = _compare(
                curves, origin, along, tolerance, steps, 0, progress, of=lambda outputs: outputs[0]
            )
            growth = {name: np.linalg.norm(tangent[1], axis=-1).max(axis=-1) for name, tangent in tangents.items()}
    remarks += _useless(growth, float(seen[-1] * numerics.dt))
    return GradientCheck(
        comparisons, tolerance, tuple(wanted * numerics.dt), tuple(seen * numerics.dt), growth, tuple(remarks)
    )


# --- the comparison ------------------------------------------------------------------------------------------------


def _compare(
    pair: Pair,
    x: PyTree,
    along: Mapping[str, PyTree],
    tolerance: float,
    steps: Sequence[float],
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
    of: Callable[[PyTree], PyTree] = lambda outputs: outputs,
) -> tuple[tuple[Comparison, ...], dict[str, PyTree]]:
    """Comparisons of `of(outputs)`, where `pair` gives outputs and decisions; and J d of all outputs, by direction."""

    def flat(x: PyTree) -> tuple[Array, PyTree]:
        outputs, decisions = pair(x)
        return ravel_pytree(of(outputs))[0].astype(jnp.float64), decisions

    labels = _labels(of(pair(x)[0]))
    value, decisions = jax.tree.map(np.asarray, flat(x))
    nudged = x
    for d in along.values():
        nudged = _moved(nudged, d, NUDGE)
    found, tangents, forward, noise, chosen = [], {}, {}, {}, {}
    for k, (name, d) in enumerate(along.items()):
        progress(k, len(along))
        _, tangents[name], chosen[name] = jax.jvp(pair, (x,), (d,), has_aux=True)
        _, beside, alike = jax.jvp(flat, (nudged,), (d,), has_aux=True)
        forward[name] = np.asarray(ravel_pytree(of(tangents[name]))[0], np.float64)
        noise[name] = ROUNDINGS * (np.asarray(beside) - forward[name]) if _same(alike, decisions) else 0.0 * value
        # jax's programs of values and of derivatives round differently, which may decide between equals
        usable = steps if _same(chosen[name], decisions) else ()
        other, uncertainty, crossed = _differences(flat, x, d, value, decisions, usable)
        scale = np.fmax(np.fmax(np.abs(forward[name]), np.abs(other)), FLOOR * np.abs(value))
        numbers = np.stack([forward[name], other, uncertainty + np.abs(noise[name]), scale], axis=-1)
        for (output, index), (f, o, u, s) in zip(labels, numbers.tolist(), strict=True):
            verdict = _verdict(f, o, u, tolerance * s, crossed)
            found.append(Comparison("differences", name, output, index, f, o, u, s, verdict))
    progress(len(along), len(along))
    # every output counts alike
    largest = np.max([np.abs(tangent) for tangent in forward.values()], axis=0, initial=0.0)
    v = np.random.default_rng(seed).normal(size=value.shape) / np.where(largest > 0, largest, 1.0)
    _, pull, decided = jax.vjp(flat, x, has_aux=True)
    gradient = np.asarray(ravel_pytree(pull(jnp.asarray(v))[0])[0])
    for name, d in along.items():
        terms, back = v * forward[name], gradient * np.asarray(ravel_pytree(d)[0])
        f, o, s = float(terms.sum()), float(back.sum()), float(np.abs(terms).sum())
        u = abs(float((v * noise[name]).sum())) if f != o else 0.0
        verdict = _verdict(f, o, u, TRANSPOSE * s, crossed=not _same(decided, chosen[name]))
        found.append(Comparison("transpose", name, "all", (), f, o, u, s, verdict))
    return tuple(found), tangents


def _differences(
    flat: Callable[[PyTree], tuple[Array, PyTree]],
    x: PyTree,
    d: PyTree,
    value: np.ndarray,
    decisions: PyTree,
    steps: Sequence[float],
) -> tuple[np.ndarray, np.ndarray, bool]:
    """D_h and its uncertainty for the best h of each output; and whether every h crosses."""
    slopes, errors = [], []
    for h in steps:
        (up, above), (down, below) = flat(_moved(x, d, h)), flat(_moved(x, d, -h))
        if _same(above, decisions) and _same(below, decisions):
            rounding = 2 * np.finfo(float).eps * np.abs(value) / h
            slopes.append(np.asarray(up - down) / (2 * h))
            errors.append(np.abs(np.asarray(up + down) - 2 * value) / (2 * h) + rounding)
    if not slopes:
        return np.full(value.shape, np.nan), np.full(value.shape, np.inf), True
    change = np.abs(np.diff(slopes, axis=0, append=slopes[-2:-1] or slopes))
    uncertainty = np.nan_to_num(np.fmax(errors, change), nan=np.inf)
    best = np.argmin(uncertainty, axis=0)[None]
    return np.take_along_axis(np.array(slopes), best, 0)[0], np.take_along_axis(uncertainty, best, 0)[0], False


def _moved(x: PyTree, d: PyTree, h: float) -> PyTree:
    return jax.tree.map(lambda a, b: a + h * b, x, d)


def _verdict(forward: float, other: float, uncertainty: float, slack: float, crossed: bool) -> str:
    """E_h may be ten times the tolerance, since curvature, the most of it, leaves D_h alone."""
    gap = abs(forward - other)
    if crossed and np.isfinite(forward):
        return "crossed"
    if not np.isfinite(gap):
        return "not finite"
    if gap <= slack and uncertainty <= 10 * slack:
        return "agrees"
    return "differs" if gap > slack + 2 * uncertainty and uncertainty < 0.1 * abs(other) + slack else "uncertain"


def _same(one: PyTree, other: PyTree) -> bool:
    return all(map(np.array_equal, jax.tree.leaves(one), jax.tree.leaves(other)))


def _labels(outputs: PyTree) -> list[tuple[str, tuple[int, ...]]]:
    """Name and index of every number, in the order of `ravel_pytree`."""
    return [
        (jax.tree_util.keystr(path, simple=True, separator=".") or "output", index)
        for path, leaf in jax.tree_util.tree_leaves_with_path(outputs)
        for index in np.ndindex(np.shape(leaf))
    ]


# --- inputs and directions -----------------------------------------------------------------------------------------


def _double(tree: PyTree, name: str) -> PyTree:
    for leaf in jax.tree.leaves(tree):
        if not jnp.issubdtype(jnp.result_type(leaf), jnp.floating):
            raise InputError(f"{name} hold {leaf!r}, they must be floating-point arrays")
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), tree)


def _like(x: PyTree, directions: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """The directions in double precision, which must look like x."""
    shapes = jax.tree.map(jnp.shape, x)
    for name, direction in directions.items():
        if jax.tree.map(jnp.shape, direction) != shapes:
            raise InputError(f"direction {name!r} has shapes {jax.tree.map(jnp.shape, direction)}, inputs {shapes}")
    return {name: _double(direction, f"direction {name!r}") for name, direction in directions.items()}


def _random(x: PyTree, seed: int) -> dict[str, PyTree]:
    """One random direction for each array of x, as large as its largest entry, or as 1 if that is 0."""
    rng, found = np.random.default_rng(seed), {}
    leaves, tree = jax.tree.flatten(x)
    for k, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(x)):
        d = rng.normal(size=leaf.shape)
        zeros: list[Any] = [jnp.zeros_like(leaf) for leaf in leaves]
        zeros[k] = jnp.asarray(d / np.max(np.abs(d), initial=1e-300) * (float(jnp.max(jnp.abs(leaf))) or 1.0))
        found[jax.tree_util.keystr(path, simple=True, separator=".") or "input"] = jax.tree.unflatten(tree, zeros)
    return found


def _directions(origin: dict[str, Array], numerics: Numerics, draws: int) -> dict[str, dict[str, Array]]:
    """Of every λ and width alone, and random ones of what a colony starts from, whose largest entry is 1."""
    zero, rng = jax.tree.map(jnp.zeros_like, origin), np.random.default_rng(0)
    found = {f"log {name}": zero | {"λ": jnp.eye(len(NAMES))[k]} for k, name in enumerate(NAMES)}
    found |= {f"log {name} width": zero | {"widths": jnp.eye(len(WIDTHS))[k]} for k, name in enumerate(WIDTHS)}
    axis = np.asarray(numerics.axis())
    nodes, near = np.arange(numerics.capacity)[:, None] < 2, np.exp(-0.5 * (axis[:, None] ** 2 + axis**2))
    for name, where in (("positions", nodes), ("nutrient", near)):
        for k in range(draws):
            d = rng.normal(size=origin[name].shape) * where
            found[f"{name} {k + 1}"] = zero | {name: jnp.asarray(d / np.abs(d).max())}
    return found | {f"budding {k + 1}": zero | {"budding": jnp.eye(draws)[k]} for k in range(draws)}


def _values(parameters: Parameters) -> list[float]:
    for name in NAMES:
        if np.ndim(getattr(parameters, name)):
            raise InputError(f"{name} has shape {getattr(parameters, name).shape}, a check is of one number each")
    return [float(getattr(parameters, name)) for name in NAMES]


def _check_smooth(relaxation: Relaxation) -> None:
    """Raises where a rule has no derivative, or jax is told to leave out a part of it."""
    for name in WIDTHS:
        if getattr(relaxation, name) is None:
            raise InputError(f"relaxation width {name} is None, the hard rule, which has no derivative everywhere")
    if relaxation.births == "whole":
        raise InputError("births is 'whole', and a whole number has no derivative: it must be 'fractional'")
    if relaxation.turning is not None and float(relaxation.turning) != 1.0:
        raise InputError(
            f"turning is {float(relaxation.turning):g}, with which derivatives leave out what differences see: "
            "check without, it changes no value"
        )


# --- the colony ----------------------------------------------------------------------------------------------------

POSITIONS = "positions of nodes"


class _Turned(Budding):
    """φ turned by Σ_k amounts_k z_k, where the standard normal numbers z belong to the child's lineage as φ does.

    `Budding.turns` belong to slots, and which of two nodes that are fed alike gets the lower slot, rounding decides.
    """

    amounts: Float[Array, " draw"] = eqx.field(kw_only=True)

    def angles(self, lineages: Array, parents: Int[Array, " node"], event: Int[Array, ""]) -> Float[Array, " node"]:
        draw = lambda data: jax.random.normal(jax.random.wrap_key_data(data), self.amounts.shape)  # noqa: E731
        return super().angles(lineages, parents, event) + jax.vmap(draw)(lineages) @ self.amounts


class _AndPositions(eqx.Module):
    """What `observe` sees, and where the nodes are."""

    observe: Observer

    def __call__(self, snapshot: Snapshot) -> PyTree:
        return self.observe(snapshot), snapshot.colony.positions

    def finish(self, observed: Any) -> dict[str, Any]:
        return self.observe.finish(observed[0]) | {POSITIONS: observed[1]}


def _births(run: Simulation) -> tuple[Array, Array]:
    """Who was born, by lineage, and whose weight is less than the parent's.

    The order of equally fed parents that all have whole children is decided by rounding, and does not matter.
    """
    colony = run.colony
    by_lineage = jnp.lexsort(colony.lineages.T)
    part = (colony.parents >= 0) & (colony.weights < colony.weights[colony.parents])
    return colony.lineages[by_lineage], part[by_lineage]


def _chatter(values: list[float], relaxation: Relaxation, numerics: Numerics) -> list[str]:
    """A pair r apart, pushed for one step: r − λ4 shrinks by 1 − 2 Δt λ3 / w, which grows where that is below −1."""
    ratio = numerics.dt * values[NAMES.index("repulsivity")] / float(relaxation.contact)  # type: ignore[arg-type]
    if ratio <= 1.0:
        return []
    return [
        f"dt · repulsivity / contact is {ratio:.3g}: contacts chatter, and derivatives grow up to "
        f"{2 * ratio - 1:.3g}-fold in every step; above 1, take a wider contact or a smaller dt"
    ]


def _useless(growth: dict[str, np.ndarray], time: float) -> list[str]:
    """Whether derivatives of this colony have outgrown any change one could make."""
    sizes = {name: float(np.nan_to_num(values[-1], nan=np.inf)) for name, values in growth.items()}
    worst = max((name for name in sizes if name.startswith("log ")), key=sizes.__getitem__)
    if sizes[worst] <= LARGEST:
        return []
    rate = np.log(max(size for name, size in sizes.items() if name.startswith("positions"))) / time
    return [
        f"by t = {time:g} a change of {worst} by 0.01 moves a node by {sizes[worst] / 100:.3g} L0 to first order, and "
        f"displacements have grown as exp({rate:.2g} t): exact for this colony, but useless for any change, and not "
        "what an ensemble's mean does. End earlier, take a wider contact, a smaller dt or turning below 1, or ask "
        "yeastfit.sensitivity for the derivative of a mean"
    ]
