"""Are derivatives of a simulated colony right, with respect to all that it grows from? Checked as in `derivatives`."""

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree, UInt32

from yeastfit.derivatives.check import STEPS, compare, double
from yeastfit.derivatives.result import GradientCheck
from yeastfit.errors import InputError
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import BuddingRule, Context
from yeastfit.model.simulate import Snapshot
from yeastfit.progress import Progress, silent
from yeastfit.simulation.result import Simulation
from yeastfit.simulation.simulate import Observer, schedule_of, simulate

LARGEST = 100.0  # L0 per unit of log λ: one hundredth more λ would move a node by a whole cell
WIDTHS = ("union", "contact", "boundary")
POSITIONS = "positions of nodes"


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
    """Check jax's derivatives of every statistic at every time through `simulate`, both ways, in double precision.

    In log λ1..λ7 (where λ is 0, in λ / its default), the logarithms of the three widths, and in `draws` random
    directions each of initial positions, of initial nutrient around the colony, and of budding angles, as large as 1.
    Also how these derivatives grow with time.

    parameters: one value each. key: of the colony, or a seed. Double precision draws another colony from a key than
    single precision does. numerics: by default a dish 12 L0 wide. relaxation: by default with a contact of 0.2.
    tolerance: relative; the nutrient is solved to 1e-6, of which differences in λ1 were seen to make 1e-4.
    Raises `InputError` for rules without a derivative, and where `simulate` does.
    """
    relaxation = Relaxation(contact=0.2) if relaxation is None else relaxation
    numerics = numerics or Numerics(domain=12.0, spacing=0.2, capacity=64)
    observe = observe or SmoothStatistics(extent=numerics.domain, spacing=numerics.spacing)
    model = model or Model()
    complete = model.complete(parameters or Parameters())
    values = _values(complete)
    _check_smooth(relaxation)
    if draws < 1:
        raise InputError(f"draws is {draws}, it must be at least 1")
    wanted = np.asarray(schedule_of(times, numerics).steps)
    seen = np.union1d(np.linspace(0, wanted[-1], 21)[1:].round().astype(int), wanted)
    seen, asked = seen[seen > 0], np.isin(seen[seen > 0], wanted)
    with jax.enable_x64(True):
        colony = model.start(jax.random.key(key) if isinstance(key, int | np.integer) else key, numerics)
        relaxation, lam = double(relaxation, "relaxation"), jnp.array(list(values.values()))
        usual = jnp.array([one.default or one.plausible[1] for one in model.parameters.parameters])
        unit = jnp.where(lam > 0, lam, usual)
        origin = {
            "λ": jnp.zeros_like(lam),
            "widths": jnp.zeros(len(WIDTHS)),
            "positions": colony.positions,
            "nutrient": colony.nutrient,
            "budding": jnp.zeros(draws),
        }

        def grown(x: dict[str, Array]) -> Simulation:
            widths = [getattr(relaxation, name) * (1 + x["widths"][k]) for k, name in enumerate(WIDTHS)]
            return simulate(
                # leaves are not checked, where values would be: a step may lead beyond the largest one
                jax.tree.unflatten(jax.tree.structure(complete), [*(lam + unit * x["λ"])]),
                model=eqx.tree_at(lambda m: m.budding, model, _Turned(x["budding"], model.budding)),
                start=eqx.tree_at(lambda c: (c.positions, c.nutrient), colony, (x["positions"], x["nutrient"])),
                times=seen * numerics.dt,
                numerics=numerics,
                relaxation=eqx.tree_at(lambda r: [getattr(r, name) for name in WIDTHS], relaxation, widths),
                observe=_AndPositions(observe),
            )

        def curves(x: dict[str, Array]) -> tuple[PyTree, PyTree]:
            run = grown(x)
            statistics = {name: values[asked] for name, values in run.statistics.items() if name != POSITIONS}
            return (statistics, run.statistics[POSITIONS]), _births(run)

        remarks = grown(origin).warnings() + _chatter(values, relaxation, numerics)
        along = _directions(origin, tuple(values), numerics, draws)
        with np.errstate(all="ignore"):
            comparisons, tangents = compare(
                curves, origin, along, tolerance, steps, 0, progress, of=lambda outputs: outputs[0]
            )
            growth = {name: np.linalg.norm(tangent[1], axis=-1).max(axis=-1) for name, tangent in tangents.items()}
    remarks += _useless(growth, float(seen[-1] * numerics.dt))
    return GradientCheck(
        comparisons, tolerance, tuple(wanted * numerics.dt), tuple(seen * numerics.dt), growth, tuple(remarks)
    )


def _directions(
    origin: dict[str, Array], names: Sequence[str], numerics: Numerics, draws: int
) -> dict[str, dict[str, Array]]:
    """Of every λ and width alone, and random ones of what a colony starts from, whose largest entry is 1."""
    zero, rng = jax.tree.map(jnp.zeros_like, origin), np.random.default_rng(0)
    found = {f"log {name}": zero | {"λ": jnp.eye(len(names))[k]} for k, name in enumerate(names)}
    found |= {f"log {name} width": zero | {"widths": jnp.eye(len(WIDTHS))[k]} for k, name in enumerate(WIDTHS)}
    axis = np.asarray(numerics.axis())
    nodes, near = np.arange(numerics.capacity)[:, None] < 2, np.exp(-0.5 * (axis[:, None] ** 2 + axis**2))
    for name, where in (("positions", nodes), ("nutrient", near)):
        for k in range(draws):
            d = rng.normal(size=origin[name].shape) * where
            found[f"{name} {k + 1}"] = zero | {name: jnp.asarray(d / np.abs(d).max())}
    return found | {f"budding {k + 1}": zero | {"budding": jnp.eye(draws)[k]} for k in range(draws)}


def _values(parameters: Parameters) -> dict[str, float]:
    for name, value in parameters.values.items():
        if np.ndim(value):
            raise InputError(f"{name} has shape {value.shape}, a check is of one number each")
    return {name: float(value) for name, value in parameters.values.items()}


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


def _chatter(values: dict[str, float], relaxation: Relaxation, numerics: Numerics) -> list[str]:
    """A pair r apart, pushed for one step: r − λ4 shrinks by 1 − 2 Δt λ3 / w, which grows where that is below −1."""
    ratio = numerics.dt * values["repulsivity"] / float(relaxation.contact)  # type: ignore[arg-type]
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
