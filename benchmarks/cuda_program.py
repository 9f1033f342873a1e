"""The batch program as it is lowered for CUDA, inspected without a GPU: what each of its loops does in one round.

JAX lowers the ensemble that `yeastfit.simulate` runs on a GPU, all members together, for CUDA on any machine. Three
things decide whether such a program runs well there, and can be read from its StableHLO:

- calls of the host: none may stand in it, as each would stop the device;
- selections between a whole array that a loop carries and its next value: JAX makes them where a condition differs
  between members (jax-ml/jax#13522), and each copies the array, every round, for every member;
- operations of a step: each may become a kernel, and a kernel takes some 5 µs to start, however small its arrays.

Operations are counted as they stand, constants and reshapings left out, those of called functions at each call, and of
alternatives (windows of several sizes) all, of which one runs. XLA fuses many of them. Whole arrays are those with at
least as many numbers as the nutrient of all members.

    python -m benchmarks.cuda_program [--quick] [--json FILE]
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import prod
from typing import Any

import jax
import jax.numpy as jnp

from benchmarks.programs import LAMBDA, SOURCE, STATISTICS, samples
from benchmarks.report import Report, command
from yeastfit.model.colony import start
from yeastfit.model.numerics import MEMBER, Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Schedule, trajectory
from yeastfit.simulation.simulate import member_keys

MEMBERS = 64
HOST = ("callback", "host", "infeed", "outfeed", "send", "recv")
FREE = ("constant", "reshape", "return", "broadcast_in_dim", "convert", "iota", "slice", "get_tuple_element")


@dataclass
class Loop:
    """One loop of a program, or at depth 0 what is outside of all.

    Attributes:
        depth: Loops around it, itself included.
        operations: Of one round, by name, those of inner loops left out.
        copied: Shapes of the whole arrays that a round copies by selection.
        inner: Loops in it.
    """

    depth: int
    operations: Counter[str] = field(default_factory=Counter)
    copied: list[tuple[int, ...]] = field(default_factory=list)
    inner: list["Loop"] = field(default_factory=list)

    @property
    def counted(self) -> int:
        """Operations that may become kernels."""
        return sum(count for name, count in self.operations.items() if name not in FREE)

    @property
    def all(self) -> Iterator["Loop"]:
        """This one and all in it."""
        yield self
        for one in self.inner:
            yield from one.all


@dataclass
class Inspection:
    """What a module of StableHLO does.

    Attributes:
        functions: Of the module, by name.
        whole: Numbers of an array that counts as a whole one.
        root: The program outside all loops.
        host_calls: What calls the host.
    """

    functions: dict[str, Any]
    whole: int
    root: Loop = field(default_factory=lambda: Loop(0))
    host_calls: list[str] = field(default_factory=list)

    @staticmethod
    def of(module: Any, whole: int) -> "Inspection":
        """Inspect a module."""
        found = Inspection({one.attributes["sym_name"].value: one for one in module.body.operations}, whole)
        found._walk(found.functions["main"].regions[0].blocks[0], found.root, {})
        return found

    def _walk(self, block: Any, loop: Loop, carried: Mapping[Any, None]) -> None:
        """Count the operations of a block; `carried` holds the values that the loop around it has carried along."""
        for one in block.operations:
            operation = one.operation
            name, operands = operation.name.rpartition(".")[2], list(operation.operands)
            if name == "call":
                called = self.functions[operation.attributes["callee"].value].regions[0].blocks[0]
                pairs = zip(called.arguments, operands, strict=True)
                self._walk(called, loop, {inside: None for inside, outside in pairs if outside in carried})
                continue
            if name == "while":
                loop.inner.append(Loop(loop.depth + 1))
                body = operation.regions[1].blocks[0]
                self._walk(body, loop.inner[-1], dict.fromkeys(body.arguments))
                continue
            target = str(operation.attributes["call_target_name"]) if name == "custom_call" else name
            if any(word in target for word in HOST):
                self.host_calls.append(target)
            loop.operations[name] += 1
            if name == "select" and operands[1] != operands[2] and any(each in carried for each in operands[1:]):
                shape = tuple(operation.results[0].type.shape)
                loop.copied += [shape] * (prod(shape) >= self.whole)
            for region in operation.regions if name in ("case", "if") else ():
                self._walk(region.blocks[0], loop, carried)


def inspected(members: int, numerics: Numerics = SOURCE, schedule: Schedule | None = None) -> Inspection:
    """The ensemble's program as it is lowered for CUDA."""
    at = schedule or samples(100, 20)

    def run(parameters: Parameters, keys: jax.Array, at: Schedule) -> Any:
        rules = Relaxation(), numerics, STATISTICS
        return jax.vmap(lambda p, k: trajectory(p, start(k, numerics), at, *rules), axis_name=MEMBER)(parameters, keys)

    shared = jax.tree.map(lambda value: jnp.full(members, value), Parameters(**LAMBDA))
    traced = jax.jit(run).trace(shared, member_keys(0, members), at)
    module = traced.lower(lowering_platforms=("cuda",)).compiler_ir("stablehlo")
    return Inspection.of(module, members * numerics.points**2)


def run(report: Report, quick: bool) -> None:
    """Report on a batch."""
    members = 4 if quick else MEMBERS
    found = inspected(members)
    loops = list(found.root.all)
    rows = [
        {
            "depth": one.depth,
            "operations a round": one.counted,
            "with inner loops": sum(each.counted for each in one.all),
            "most frequent": ", ".join(
                f"{name} {count}" for name, count in one.operations.most_common() if name not in FREE
            )[:60],
            "whole arrays copied": len(one.copied),
        }
        for one in loops
    ]
    different = [row for k, row in enumerate(rows) if row not in rows[:k]]
    title = f"loops of {members} colonies of {SOURCE.room} nodes on {SOURCE.points}² points, equal ones once"
    report.table(title, [row | {"loops": rows.count(row)} for row in different])
    report.add("calls of the host", len(found.host_calls), "", 0, at_least=False)
    copied = sum(len(one.copied) for one in loops if one.depth)
    report.add("whole arrays copied in loops", copied, "", 0, at_least=False)


if __name__ == "__main__":
    command("cuda_program", run)
