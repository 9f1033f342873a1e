"""One time step, and its repetition (docs/model.md, section 3).

    cells → level set → uptake → nutrient → deaths → births → detachment → motion

Which law holds at each of these is the model's business (`yeastfit.model.model`); this file only asks its rules.
"""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from yeastfit.model.colony import Colony, Problems
from yeastfit.model.laws.budding import bud
from yeastfit.model.laws.forces import velocity
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics, largest_in_ensemble
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context
from yeastfit.model.snapshot import Snapshot

SOURCE = Model()


Observe = Callable[[Snapshot], PyTree]


def step(
    colony: Colony, parameters: Parameters, relaxation: Relaxation, numerics: Numerics, model: Model = SOURCE
) -> tuple[Colony, Snapshot]:
    """One time step: cells eat, die, bud, let go and move, in this order.

    Arguments:
        colony: The state before.
        parameters: Values of all the model's parameters.
        relaxation: Smoothing widths.
        numerics: Grid and time step.
        model: The rules.

    Returns:
        The state after, and what statistics of the step are taken from.
    """

    def seen(colony: Colony, **changed: PyTree) -> Context:
        return Context.of(
            dataclasses.replace(colony, **changed), parameters, relaxation, numerics, model.death, model.medium
        )

    cells = model.cells(colony, parameters, relaxation)
    context = seen(colony)
    context = seen(model.medium.stepped(context, cells, model.uptake), step=colony.step + 1)
    shaken = model.fluctuations.answered(model.fluctuations.shaken(context), context.colony.nutrient.shape)
    context = seen(context.colony, nutrient=shaken)
    context = seen(context.colony, node_state=model.advance(context))
    context = seen(model.death.deaths(context))

    def with_births() -> Colony:
        paid, births = model.medium.afforded(context, model.births.births(context))
        return bud(dataclasses.replace(context, colony=paid), births, model.budding, model.node_state())

    colony = jax.lax.cond(model.births.due(context), with_births, lambda: context.colony)
    ends: dict[str, float | Array] = dict(model.node_state())
    ends |= {name: colony.node_state[name] for name in model.death.node_state()}
    parted = seen(model.detachment.detached(seen(colony), ends))  # of a dead cell both ends are dead
    positions = _moved(parted, model)
    from_edge = 0.5 * numerics.domain - jnp.abs(positions)
    problems, at_edge = parted.colony.problems, jnp.any((from_edge < 1.0) & (from_edge >= 0.0))
    problems = eqx.tree_at(lambda p: p.left_domain, problems, problems.left_domain | at_edge)
    colony = dataclasses.replace(parted.colony, positions=positions, problems=problems)
    return colony, Snapshot(cells, context.growth_rate, colony, parameters, relaxation)


def _moved(context: Context, model: Model) -> Float[Array, "node 2"]:
    """Places of all nodes after a time step, by `Numerics.substeps` equal steps in which only nodes move.

    To the rules, a substep is a step of a colony with so many times more steps, each so many times shorter.
    """
    colony, numerics = context.colony, context.numerics
    short = dataclasses.replace(numerics, dt=numerics.dt / numerics.substeps, substeps=1)

    def once(k: int | Array, positions: Float[Array, "node 2"]) -> Float[Array, "node 2"]:
        number = (colony.step - 1) * numerics.substeps + k + 1
        here = dataclasses.replace(
            context, colony=dataclasses.replace(colony, positions=positions, step=number), numerics=short
        )
        going = velocity(here, model.contact, model.medium, model.springs)
        return model.motion.answered(model.motion.moved(here, going), going.shape)

    if numerics.substeps == 1:
        return once(0, colony.positions)
    return jax.lax.fori_loop(0, numerics.substeps, once, colony.positions)


class Schedule(eqx.Module):
    """The steps after which something is observed. Other steps do not recompile, as long as `longest` stays.

    Attributes:
        steps: Rising.
        longest: A power of two, at least the number of steps from one to the next.
    """

    steps: Int[Array, " sample"]
    longest: int = eqx.field(static=True)

    @staticmethod
    def of(steps: Sequence[int] | np.ndarray, since: int = 0) -> "Schedule":
        """From step numbers that rise strictly from above `since`, the steps that the colony has done already."""
        most = int(np.diff(steps, prepend=since).max())
        return Schedule(jax.device_put(np.asarray(steps)), 1 << (most - 1).bit_length())


def trajectory(
    parameters: Parameters,
    colony: Colony,
    schedule: Schedule,
    relaxation: Relaxation,
    numerics: Numerics,
    observe: Observe,
    model: Model = SOURCE,
) -> tuple[Colony, PyTree]:
    """Grow one colony from a given state.

    Differentiable in everything real, forwards and backwards. Reverse mode keeps the state at every sample and at √n of
    the n steps to the next one, and repeats the others. Other parameters, widths,
    states and steps of the schedule do not recompile.

    Arguments:
        parameters: One value of each of the model's parameters.
        colony: The state to start from.
        schedule: Steps to observe.
        relaxation: Smoothing widths.
        numerics: Grid and time step.
        observe: What to record, of a snapshot.
        model: The rules.

    Returns:
        The last state, and what was observed, stacked along the first axis.
    """

    def advance(carry: tuple[Snapshot, Array, Array], _: None) -> tuple[tuple[Snapshot, Array, Array], None]:
        snapshot, done, last = carry
        snapshot = jax.lax.cond(done < last, lambda s: step(s.colony, *rules)[1], lambda s: s, snapshot)
        return (snapshot, done + 1, last), None

    def block(carry: tuple[Snapshot, Array, Array], _: None) -> tuple[tuple[Snapshot, Array, Array], None]:
        return jax.lax.scan(jax.checkpoint(advance), carry, None, length=schedule.longest // blocks)

    def to_sample(carry: tuple[Snapshot, Array], last: Array) -> tuple[tuple[Snapshot, Array], PyTree]:
        (snapshot, _, _), _ = jax.lax.scan(jax.checkpoint(block), (*carry, last), None, length=blocks)
        colony = snapshot.colony
        colony = eqx.tree_at(lambda c: c.problems, colony, problems_of(colony, parameters, numerics, model))
        snapshot = eqx.tree_at(lambda s: s.colony, snapshot, colony)
        return (snapshot, last), observe(snapshot)

    blocks = 1 << ((schedule.longest.bit_length() - 1) // 2)
    rules = parameters, relaxation, numerics, model
    cells = model.cells(colony, parameters, relaxation)
    first = Snapshot(cells, jnp.zeros_like(colony.weights[0]), colony, parameters, relaxation)
    begin = first, largest_in_ensemble(colony.step.astype(schedule.steps.dtype))  # all members have done as many
    (snapshot, _), observed = jax.lax.scan(jax.checkpoint(to_sample), begin, schedule.steps)
    return snapshot.colony, observed


def problems_of(colony: Colony, parameters: Parameters, numerics: Numerics, model: Model) -> Problems:
    """The colony's problems, with those that can be seen at a sample time. A problem stays once it has occurred.

    Seldom looking is enough: while nobody dies, a node's degree never falls, so the last sample shows any instability.
    Whether a node comes to the edge is looked at in every step, too: a place that is not finite does not tell whether
    it got there step by step or by one jump.
    """
    before = colony.problems
    outside = jnp.any(jnp.abs(colony.positions) > 0.5 * numerics.domain - 1.0)
    # of the nutrient the sum is looked at: in an observed step a test of every point would take 4 % of the time
    finite = jnp.isfinite(colony.positions).all() & jnp.isfinite(jnp.sum(colony.nutrient))
    stiffness = numerics.dt / numerics.substeps * parameters.elasticity * model.springs.stiffness(colony)
    return Problems(
        capacity_reached=before.capacity_reached,
        left_domain=before.left_domain | (finite & outside),
        unstable=before.unstable | (stiffness >= 2.0),
        not_finite=before.not_finite | ~finite,
        died_out=before.died_out | (jnp.sum(model.death.living(colony)) < 0.5),
        store_empty=before.store_empty,
    )
