"""Which workers are trusted with simulations: those that repeat, bit by bit, what the asking process has simulated."""

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from yeastfit.inference.workers.arithmetic import Arithmetic, first_difference
from yeastfit.inference.workers.worker import Block


@dataclass(frozen=True)
class Patience:
    """When something counts as lost.

    Attributes:
        tries: Failures of one block.
        alone: Seconds without any worker, or without the scheduler.
        least: Seconds that a block may take at least.
        slack: Times the longest block so far that one may take.
        start: Seconds that the first block waits at most for all workers to be admitted.
        look: Seconds between two looks at who is there.
        admission: Seconds for making the simulator and the first blocks, compiling included.
        retry: Seconds between two attempts to reach a scheduler.
    """

    tries: int = 3
    alone: float = 600.0
    least: float = 60.0
    slack: float = 20.0
    start: float = 120.0
    look: float = 0.5
    admission: float = 900.0
    retry: float = 2.0


@dataclass(frozen=True)
class Reference:
    """What workers are compared with: blocks, their rows and the arithmetic of the process that asks.

    Attributes:
        blocks: Values and seeds.
        rows: Of each block.
        arithmetic: That they were computed with.
        seconds: Of the last.
    """

    blocks: list[Block]
    rows: list[np.ndarray]
    arithmetic: Arithmetic
    seconds: float


@dataclass
class Member:
    """A worker.

    Attributes:
        host: Its machine.
        name: For people; its address until it has said more.
        state: "asked", "admitted", "refused" or "silent".
        tickets: Of what it was asked for, in order.
        since: When it began with the first of these.
        seconds: Of the block that was timed.
        failures: Of being admitted.
        refusal: Why it was refused, in words.
        otherwise: Whether it was for no other reason than that it computes other bits.
    """

    host: str
    name: str
    state: str = "asked"
    tickets: deque[int] = field(default_factory=deque)
    since: float = field(default_factory=time.monotonic)
    seconds: float = 0.0
    failures: int = 0
    refusal: str = ""
    otherwise: bool = False


def reasons_against(answer: Mapping[str, Any], reference: Reference) -> tuple[list[str], list[str]]:
    """Why a worker is no good, and how its simulations would differ from those of the asking process.

    Arguments:
        answer: What `worker.admit` returned there.
        reference: What it is compared with.

    Returns:
        Reasons for which it cannot be used, and reasons that a user may accept.
    """
    mine, other = reference.arithmetic, Arithmetic(**answer["arithmetic"])
    unfit = [f"jax has {other.devices} devices there, not one a process"] if other.devices > 1 else []
    if answer["tasks"] > 1:
        unfit.append(f"it does {answer['tasks']} tasks at once: start it with --nthreads 1")
    reasons = mine.differences(other)
    bits = next(filter(None, map(first_difference, reference.rows, answer["rows"])), "")
    if bits and not reasons:
        reasons = [f"its processor, {other.processor}, computes other bits than {mine.processor}: {bits}"]
    return unfit, reasons
