"""Are derivatives of a simulated colony right, in everything that it grows from? Checked as in `derivatives.check`."""

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree, UInt32

from yeastfit.derivatives.check import STEPS, compare, double
from yeastfit.derivatives.result import GradientCheck
from yeastfit.errors import InputError
from yeastfit.kinds import check_kind
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import BuddingRule, Context
from yeastfit.model.snapshot import Snapshot
from yeastfit.numbers import POSITIVE
from yeastfit.progress import Progress, silent
from yeastfit.seeds import key_of
from yeastfit.simulation.result import Simulation
from yeastfit.simulation.simulate import Observer, schedule_of, simulate

LARGEST = 100.0  # L0 per unit of log λ: one hundredth more λ would move a node by a whole cell
WIDTHS = ("union", "contact", "boundary")
POSITIONS = "positions of nodes"
SAMPLES = 20  # times at which the growth of derivatives is seen
Moves = dict[str, Array]  # how far a colony is moved, by kind of direction


def check_gradients(
    parameters: Parameters | None = None,
    *,
    times: Sequence[float] | np.ndarray = (1.5, 3.0),
    key: Array | int = 0,
    model: Model | None = None,
    numerics: Numerics | None = None,
    relaxation: Relaxation | None = None,
    observe: Observer | None = None,
    tolerance: float = 5e-4,
    steps: Sequence[float] = STEPS,
    draws: int = 2,
    progress: Progress = silent,
) -> GradientCheck:
    """Check JAX's derivatives of every statistic at every time through `simulate`, both ways, in double precision.

    Directions are the logarithm of each of the model's parameters (one that is 0 moves in units of its default) and of
    the three widths, and `draws` random ones each of initial positions, of initial nutrient around the colony, and of
    budding angles, whose largest entries are 1. The check also tells how these derivatives grow with time.

    Arguments:
        parameters: One value each.
        times: When statistics are compared.
        key: Of the colony, or a seed. Double precision draws another colony from a key than single precision does.
        model: The rules; by default the source's.
        numerics: By default a dish 12 L0 wide, with room for 64 nodes.
        relaxation: By default with a contact of 0.2.
        observe: What to check; by default all smooth statistics.
        tolerance: Relative. The nutrient is solved to 1e-6, which was seen to change differences in λ1 by 1e-4.
        steps: h, in units of a direction.
        draws: Random directions of each kind.
        progress: Told which of the directions is being compared.

    Returns:
        A `GradientCheck` with every comparison, the growth of derivatives and remarks on the model.

    Raises:
        InputError: A rule has no derivative, or `simulate` raises one.
    """
    relaxation = Relaxation(contact=0.2) if relaxation is None else relaxation
    numerics = Numerics(domain=12.0, spacing=0.2, capacity=64) if numerics is None else numerics
    model = Model() if model is None else model
    parameters = Parameters() if parameters is None else parameters
    classes = (parameters, Parameters), (model, Model), (numerics, Numerics), (relaxation, Relaxation)
    for given, kind in classes:
        check_kind(kind.__name__.lower(), given, kind)
    observe = SmoothStatistics(extent=numerics.domain, spacing=numerics.spacing) if observe is None else observe
    check_kind("observe", observe, Observer, "yeastfit.measure.SmoothStatistics(…)")
    if isinstance(observe, HardStatistics):
        raise InputError("observe is HardStatistics, which has no derivatives: use yeastfit.measure.SmoothStatistics")
    values = model.complete(parameters)
    _check_scalars(values)
    _check_smooth(relaxation)
    POSITIVE.read(tolerance, "tolerance")
    if draws < 1:
        raise InputError(f"draws is {draws}, it must be at least 1")
    wanted = np.asarray(schedule_of(times, numerics).steps)
    seen = np.union1d(np.linspace(0, wanted[-1], SAMPLES + 1)[1:].round().astype(int), wanted)
    seen, asked = seen[seen > 0], np.isin(seen[seen > 0], wanted)
    with jax.enable_x64(True):
        colonies = _Colonies(model, values, key_of(key), numerics, double(relaxation, "relaxation"), observe, seen)
        origin = colonies.origin(draws)

        def curves(x: Moves) -> tuple[PyTree, PyTree]:
            run = colonies.grown(x)
            statistics = {name: values[asked] for name, values in run.statistics.items() if name != POSITIONS}
            return (statistics, run.statistics[POSITIONS]), _births(run)

        remarks = colonies.grown(origin).warnings() + _chatter(values, relaxation, numerics)
        along = _directions(origin, values.values, numerics, draws)
        with np.errstate(all="ignore"):
            comparisons, tangents = compare(
                curves, origin, along, tolerance, steps, 0, progress, of=lambda outputs: outputs[0]
            )
            growth = {name: np.linalg.norm(tangent[1], axis=-1).max(axis=-1) for name, tangent in tangents.items()}
    kinds = {name: _kind(move) for name, move in along.items()}
    remarks += _useless(growth, kinds, float(seen[-1] * numerics.dt))
    return GradientCheck(
        comparisons, tolerance, tuple(wanted * numerics.dt), tuple(seen * numerics.dt), growth, tuple(remarks)
    )


class _Colonies:
    """One colony as a function of how far it is moved along every kind of direction."""

    def __init__(
        self,
        model: Model,
        parameters: Parameters,
        key: Array,
        numerics: Numerics,
        relaxation: Relaxation,
        observe: Observer,
        seen: np.ndarray,
    ) -> None:
        self.model, self.numerics, self.relaxation = model, numerics, relaxation
        self.observe, self.seen = _AndPositions(observe), seen
        self.colony = model.start(key, numerics)
        self.values, self.tree = jnp.array([float(value) for value in jax.tree.leaves(parameters)]), parameters
        usual = jnp.array([one.default or one.plausible[1] for one in model.parameters.parameters])
        self.unit = jnp.where(self.values > 0, self.values, usual)

    def origin(self, draws: int) -> Moves:
        """No move of parameters, widths and budding angles; positions and nutrient as they are."""
        return {
            "λ": jnp.zeros_like(self.values),
            "widths": jnp.zeros(len(WIDTHS)),
            "positions": self.colony.positions,
            "nutrient": self.colony.nutrient,
            "budding": jnp.zeros(draws),
        }

    def grown(self, x: Moves) -> Simulation:
        """The colony with its curves and the positions of its nodes."""
        widths = [getattr(self.relaxation, name) * (1 + x["widths"][k]) for k, name in enumerate(WIDTHS)]
        return simulate(
            # leaves are not checked, where values would be: a step may lead beyond the largest one
            jax.tree.unflatten(jax.tree.structure(self.tree), [*(self.values + self.unit * x["λ"])]),
            model=eqx.tree_at(lambda m: m.budding, self.model, _Turned(x["budding"], self.model.budding)),
            start=eqx.tree_at(lambda c: (c.positions, c.nutrient), self.colony, (x["positions"], x["nutrient"])),
            times=self.seen * self.numerics.dt,
            numerics=self.numerics,
            relaxation=eqx.tree_at(lambda r: [getattr(r, name) for name in WIDTHS], self.relaxation, widths),
            observe=self.observe,
        )


def _directions(origin: Moves, names: Iterable[str], numerics: Numerics, draws: int) -> dict[str, Moves]:
    """Of every λ and width alone, and random ones of what a colony starts from, whose largest entry is 1."""
    zero, rng = jax.tree.map(jnp.zeros_like, origin), np.random.default_rng(0)
    units = jnp.eye(origin["λ"].size)
    found = {f"log {name}": zero | {"λ": units[k]} for k, name in enumerate(names)}
    found |= {f"log {name} width": zero | {"widths": jnp.eye(len(WIDTHS))[k]} for k, name in enumerate(WIDTHS)}
    axis = np.asarray(numerics.axis())
    nodes, near = np.arange(numerics.room)[:, None] < 2, np.exp(-0.5 * (axis[:, None] ** 2 + axis**2))
    for name, where in (("positions", nodes), ("nutrient", near)):
        for k in range(draws):
            d = rng.normal(size=origin[name].shape) * where
            found[f"{name} {k + 1}"] = zero | {name: jnp.asarray(d / np.abs(d).max())}
    return found | {f"budding {k + 1}": zero | {"budding": jnp.eye(draws)[k]} for k in range(draws)}


def _kind(move: Moves) -> str:
    """What a direction moves."""
    return next(kind for kind, amounts in move.items() if np.any(amounts))


def _check_scalars(parameters: Parameters) -> None:
    for name, value in parameters.values.items():
        if np.ndim(value):
            raise InputError(f"{name} has shape {value.shape}, a check is of one number each")


def _check_smooth(relaxation: Relaxation) -> None:
    """Raises where a rule has no derivative, or jax is told to leave out a part of it."""
    for name in WIDTHS:
        if getattr(relaxation, name) is None:
            raise InputError(f"{name} width 0 is the hard rule, which has no derivative everywhere: give one above 0")
    if relaxation.births == "whole":
        raise InputError("births is 'whole', and a whole number has no derivative: it must be 'fractional'")
    if relaxation.turning is not None and float(relaxation.turning) != 1.0:
        raise InputError(
            f"turning is {float(relaxation.turning):g}, with which derivatives leave out what differences see: "
            "check without, it changes no value"
        )


class _Turned(BuddingRule):
    """φ of a rule, turned by Σ_k amounts_k z_k; the standard normal z belong to the child's lineage as φ does.

    The turns of `TurnedBudding` belong to slots, and rounding decides which of two nodes fed alike has the lower slot.
    """

    name: ClassVar[str] = "turned by lineage"
    amounts: Float[Array, " draw"]
    base: BuddingRule

    def angles(
        self, context: Context, parents: Int[Array, " node"], lineages: UInt32[Array, "node 2"]
    ) -> Float[Array, " node"]:
        draw = lambda data: jax.random.normal(jax.random.wrap_key_data(data), self.amounts.shape)  # noqa: E731
        return self.base.angles(context, parents, lineages) + jax.vmap(draw)(lineages) @ self.amounts


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


def _chatter(values: Parameters, relaxation: Relaxation, numerics: Numerics) -> list[str]:
    """A pair r apart, pushed for one step: r − λ4 shrinks by 1 − 2 Δt λ3 / w, which grows where that is below −1."""
    ratio = numerics.dt * float(values.repulsivity) / float(relaxation.contact)  # type: ignore[arg-type]
    if ratio <= 1.0:
        return []
    return [
        f"dt · repulsivity / contact is {ratio:.3g}: contacts chatter, and derivatives grow up to "
        f"{2 * ratio - 1:.3g}-fold in every step; above 1, take a wider contact or a smaller dt"
    ]


def _useless(growth: dict[str, np.ndarray], kinds: dict[str, str], time: float) -> list[str]:
    """Whether derivatives of this colony have outgrown any change one could make; `kinds` of the directions."""
    sizes = {name: float(np.nan_to_num(values[-1], nan=np.inf)) for name, values in growth.items()}
    worst = max((name for name in sizes if kinds[name] in ("λ", "widths")), key=sizes.__getitem__)
    if sizes[worst] <= LARGEST:
        return []
    rate = np.log(max(size for name, size in sizes.items() if kinds[name] == "positions")) / time
    return [
        f"by t = {time:g} a change of {worst} by 0.01 moves a node by {sizes[worst] / 100:.3g} L0 to first order, and "
        f"displacements have grown as exp({rate:.2g} t): exact for this colony, but useless for any change, and not "
        "what an ensemble's mean does. End earlier, take a wider contact, a smaller dt or turning below 1, or ask "
        "yeastfit.sensitivity for the derivative of a mean"
    ]
