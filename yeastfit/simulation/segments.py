"""One colony of any size, grown in segments from one division event to the next.

A segment is compiled for the number of nodes that its arrays have room for. Where births would be cut although more
nodes are allowed, the segment is grown again with `WIDER` times the room, so that the work follows the nodes that live.
Another program takes as long as the steps that it would make shorter: more than a second for what is observed, which is
compiled for `SPARE` times as much room at once.

In dishes wider than `WIDE`, where colonies are expected to become large, programs for more room are compiled beside the
steps (`ProgramsAhead`).

On a CPU, colonies with room for more than `FIRST_ROOM` nodes grow by compiled loops (`with_compiled_rules`) unless
`Numerics.compiled` is False; smaller ones have the bits that those of one program have.

Who asks for a colony `until` something gets it at the first step at which that is reached: the segment that passes it
is divided in two again and again.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PyTree

from yeastfit.model.colony import Colony, Problems, widened
from yeastfit.model.compiled.rules import with_compiled_level_set, with_compiled_rules
from yeastfit.model.model import Model
from yeastfit.model.numerics import FIRST_ROOM, WIDE, Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Observe, problems_of, step
from yeastfit.model.snapshot import Snapshot
from yeastfit.simulation.programs_ahead import ProgramsAhead, programs_ahead

WIDER = 4
AHEAD = 300_000  # nodes for which programs are run once beforehand: beyond, that takes memory
SPARE = 16

Passed = Callable[[Colony, PyTree], bool]
Keep = Callable[[Colony, Sequence[PyTree]], None]


@dataclasses.dataclass(frozen=True)
class Segments:
    """How one colony is grown.

    Attributes:
        parameters: One value of each of the model's parameters.
        relaxation: Smoothing widths.
        numerics: Grid, time step and the most nodes.
        observe: What to record at sample times, of a snapshot.
        model: The rules.
    """

    parameters: Parameters
    relaxation: Relaxation
    numerics: Numerics
    observe: Observe
    model: Model

    def grown(
        self,
        colony: Colony,
        samples: Sequence[int],
        passed: Passed | None = None,
        observed: Sequence[PyTree] = (),
        keep: Keep | None = None,
    ) -> tuple[Colony, list[PyTree]]:
        """Grow a colony. Not differentiable.

        Arguments:
            colony: The state to start from.
            samples: Steps to observe, rising; the last ends the growth.
            passed: Whether the colony, with what was observed of it, has grown as far as it should. It is then
                observed at the first step of which that holds, and grows no further.
            observed: What was observed at the samples that the colony is beyond.
            keep: Called after each segment with the colony, and what has been observed.

        Returns:
            The last state, and what was observed.
        """
        observed = list(observed)
        with programs_ahead(partial(self._compile, colony)) as ahead:
            for sample in samples:
                while (done := int(colony.step)) < sample:
                    last = min(sample, self._before_event(done))
                    before = colony
                    colony, found = self._segment(before, last, passed is not None or last == sample, ahead)
                    if passed is not None and passed(colony, found):
                        colony, found = self._first(before, colony, found, passed, ahead)
                        return colony, [*observed, found]
                    if last == sample:
                        observed.append(found)
                    if keep is not None:
                        keep(colony, observed)
        return colony, observed

    def shapes(self, colony: Colony) -> PyTree:
        """Of what is observed of a colony."""
        rules = self.parameters, self.relaxation, self.model
        return jax.eval_shape(lambda one: self.observe(_before_steps(one, *rules)), colony)

    def _before_event(self, done: int) -> int:
        """The last step before the next division event, which begins a segment: few steps are lost where it is cut."""
        every = self.numerics.steps_per_event
        return (done + 1) // every * every + every - 1

    def _first(
        self, before: Colony, colony: Colony, found: PyTree, passed: Passed, ahead: ProgramsAhead
    ) -> tuple[Colony, PyTree]:
        """The colony at the first step at which it has passed, which lies in the segment since `before`."""
        while int(colony.step) - int(before.step) > 1:
            middle = (int(colony.step) + int(before.step)) // 2
            between, seen = self._segment(before, middle, True, ahead)
            if passed(between, seen):
                colony, found = between, seen
            else:
                before = between
        return colony, found

    def _segment(self, colony: Colony, last: int, seen: bool, ahead: ProgramsAhead) -> tuple[Colony, PyTree]:
        """The colony at step `last`, and what is observed there, if it is seen, with as much room as that takes."""
        while True:
            room = colony.parents.shape[0]
            if self.numerics.domain > WIDE:
                following = self._wider(room), self._wider(self._wider(room))
                ahead.ask([one for one in following if room < one <= AHEAD])
            snapshot, cut = self._advanced(colony, last)
            if not cut:
                return snapshot.colony, self._observed(snapshot) if seen else None
            ahead.await_for(self._wider(room))
            colony = widened(colony, self._wider(room), self.model.node_state())

    def _wider(self, room: int) -> int:
        """What comes after so much room."""
        return min(WIDER * room, self.numerics.most_room)

    def _compiles(self, room: int) -> bool:
        """Whether a colony with so much room grows by compiled loops."""
        return self.numerics.compiled and room > FIRST_ROOM

    def _advanced(self, colony: Colony, last: int) -> tuple[Snapshot, bool]:
        """What statistics of step `last` are taken from, and whether a birth was cut that need not be."""
        room = colony.parents.shape[0]
        model = with_compiled_rules(self.model) if self._compiles(room) else self.model
        rules = self.parameters, self.relaxation, self.numerics, model
        snapshot, cut = _advanced(colony, jnp.asarray(last), jnp.asarray(room < self.numerics.most_room), *rules)
        return snapshot, bool(cut)

    def _compile(self, colony: Colony, room: int) -> None:
        """Run the programs for so much room, for no step."""
        snapshot, _ = self._advanced(widened(colony, room, self.model.node_state()), int(colony.step))
        self._observed(snapshot)

    def _observed(self, snapshot: Snapshot) -> PyTree:
        """What is observed, by a program that colonies of many sizes share."""
        room, wide = snapshot.colony.parents.shape[0], FIRST_ROOM
        while wide < room:
            wide *= SPARE
        wide = max(min(wide, self.numerics.most_room), room)
        seen = snapshot.widened(wide, self.model.node_state())
        return _observed(self.observe, with_compiled_level_set(seen) if self._compiles(room) else seen)


@eqx.filter_jit
def _advanced(
    colony: Colony,
    last: Int[Array, ""],
    widens: Bool[Array, ""],
    parameters: Parameters,
    relaxation: Relaxation,
    numerics: Numerics,
    model: Model,
) -> tuple[Snapshot, Bool[Array, ""]]:
    """What statistics of step `last` are taken from.

    Where the arrays can be made wider, steps end at the first birth that was cut; whether there was one comes last.
    """
    earlier = colony.problems.capacity_reached

    def marked(problems: Problems, value: Bool[Array, ""]) -> Problems:
        return eqx.tree_at(lambda one: one.capacity_reached, problems, value)

    def goes_on(snapshot: Snapshot) -> Bool[Array, ""]:
        return (snapshot.colony.step < last) & ~(snapshot.colony.problems.capacity_reached & widens)

    colony = dataclasses.replace(colony, problems=marked(colony.problems, jnp.zeros_like(earlier)))
    first = _before_steps(colony, parameters, relaxation, model)
    rules = parameters, relaxation, numerics, model
    snapshot = jax.lax.while_loop(goes_on, lambda one: step(one.colony, *rules)[1], first)
    problems = problems_of(snapshot.colony, parameters, numerics, model)
    cut = problems.capacity_reached & widens
    problems = marked(problems, problems.capacity_reached | earlier)
    return eqx.tree_at(lambda one: one.colony.problems, snapshot, problems), cut


@eqx.filter_jit
def _observed(observe: Observe, snapshot: Snapshot) -> PyTree:
    return observe(snapshot)


def _before_steps(colony: Colony, parameters: Parameters, relaxation: Relaxation, model: Model) -> Snapshot:
    cells, nothing = model.cells(colony, parameters, relaxation), jnp.zeros_like(colony.weights[0])
    return Snapshot(cells, nothing, colony, parameters, relaxation)
