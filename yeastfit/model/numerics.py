"""Grid, time step and capacity: how the model is solved, as opposed to what it says."""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from yeastfit.errors import InputError
from yeastfit.memory import check_count, check_memory, machine_memory
from yeastfit.numbers import Range
from yeastfit.text import quoted

MOST_STEPS = 2**30  # counted in 32 bits
STEPS = Range(1.0 / MOST_STEPS, 1000.0)
"""Admissible Δt."""
POINT, NODE = 48, 600  # bytes that a step works on in single precision: a dozen grids, and lanes of contacts
FIRST_ROOM = 500  # nodes that a colony without a capacity begins with room for, the source's number
WIDE = 100.0  # L0: in wider dishes colonies are expected to become large
MOST_SUBSTEPS = 1000
MEMBER = "member"  # the name of the ensemble axis inside `trajectory`


@dataclass(frozen=True)
class Numerics:
    """Resolution of a simulation; lengths in L0, times in 1/μ*. Defaults are the source's. A change recompiles.

    Attributes:
        domain: Side of the square dish, centred on the origin.
        spacing: h of the nutrient grid; domain / spacing is a whole number.
        dt: Δt of forward Euler and Crank–Nicolson.
        substeps: Steps of Δt / substeps in which nodes move within a time step, while all else stands still.
        capacity: Largest number of nodes; births beyond it are cut. None: as many as are born, while memory lasts.
        bud_distance: δ, how far from its parent a child appears.
        compiled: Whether contact, springs and nutrient of large colonies on a CPU are computed by loops that numba has
            compiled, where it is installed: the same sums in another order. False is the plain calculation.

    Raises:
        InputError: A value is not positive, `substeps` is no whole number up to 1000, `compiled` neither True nor
            False, domain / spacing is not a whole number, dt is beyond what steps can be counted for, or a colony would
            not fit into memory.
    """

    domain: float = 40.0
    spacing: float = 0.1
    dt: float = 0.02
    capacity: int | None = None
    bud_distance: float = 0.01
    compiled: bool = True
    substeps: int = 1

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if (field.name == "capacity" and value is None) or field.name == "compiled":
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
                raise InputError(f"{field.name} is {quoted(value)}, it must be a number above 0")
        if not isinstance(self.compiled, bool):
            raise InputError(f"compiled is {quoted(self.compiled)}, it must be true or false")
        check_capacity(self.room)
        STEPS.read(self.dt, "dt")
        check_substeps(self.substeps)
        intervals = self.domain / self.spacing
        what = f"domain / spacing is {self.domain:g} / {self.spacing:g}: a grid of {intervals + 1:.5g}² points"
        check_memory(POINT * (intervals + 1) * (intervals + 1), what)
        if abs(intervals - round(intervals)) > 1e-6 * intervals or round(intervals) < 4:
            raise InputError(
                f"spacing is {self.spacing:g}: domain / spacing is {self.domain:g} / {self.spacing:g} = {intervals:g}, "
                "it must be a whole number of at least 4 grid intervals"
            )

    @property
    def points(self) -> int:
        """Grid points along one side, boundary included."""
        return round(self.domain / self.spacing) + 1

    @property
    def room(self) -> int:
        """Nodes that an array of fixed length holds: `capacity`, or `FIRST_ROOM` where there is none."""
        return FIRST_ROOM if self.capacity is None else self.capacity

    @property
    def most_room(self) -> int:
        """Nodes that a colony may come to: `capacity`, or what half of the memory holds."""
        return int(0.5 * machine_memory() / NODE) if self.capacity is None else int(self.capacity)

    @property
    def state_size(self) -> float:
        """Bytes of a colony's state, in single precision: nutrient and nodes."""
        return 4.0 * self.points**2 + 32.0 * self.room

    @property
    def steps_per_event(self) -> int:
        """Δn = ⌈1/Δt⌉, guarded against the last bit of 1/Δt."""
        return math.ceil(1.0 / self.dt - 1e-9)

    def axis(self) -> Float[Array, " point"]:
        """Coordinates of the grid points along one side."""
        return -0.5 * self.domain + self.spacing * jnp.arange(self.points)

    def check_steps(self, time: float) -> None:
        """Raise `InputError` where a time is more steps away than can be counted."""
        if not time / self.dt <= MOST_STEPS:
            raise InputError(
                f"time is {time:g}, {time / self.dt:.3g} steps of dt = {self.dt:g}, it must be at most "
                f"{MOST_STEPS * self.dt:g}, {MOST_STEPS} steps"
            )

    def step_of(self, time: float) -> int:
        """The step that ends at (or nearest to) a time."""
        return round(time / self.dt)


def check_substeps(substeps: int) -> None:
    """Raise `InputError` where substeps are not a whole number, from 1 to 1000."""
    if substeps != int(substeps) or not 1 <= substeps <= MOST_SUBSTEPS:
        raise InputError(f"substeps is {substeps:g}, it must be a whole number from 1 to {MOST_SUBSTEPS}")


def check_capacity(capacity: int) -> None:
    """Raise `InputError` where a capacity is not a whole number of nodes, at least 2, or is more than memory holds."""
    if capacity != int(capacity) or capacity < 2:
        raise InputError(f"capacity is {quoted(capacity)}, it must be a whole number of nodes, at least 2")
    check_count("capacity", capacity, NODE)


def most_nodes(time: float, doublings: float = 1.0) -> int:
    """Nodes that a colony may come to by a time: two, doubled so often in a unit of time, once as the source's buds."""
    return 2 ** (int(min(doublings * time, 60.0) + 1e-6) + 1)  # 2⁶¹ are more than any memory holds


def largest_in_ensemble(value: Array) -> Array:
    """The largest value over the members of the ensemble that is being traced.

    Trip counts of inner loops go through here: every member then does the same number of iterations (idle ones change
    nothing) and a batched loop keeps an unbatched condition, without which each iteration would copy the whole state.
    """
    try:
        return jax.lax.pmax(value, MEMBER)
    except NameError:  # not inside an ensemble
        return value


def map_members(one: Callable[..., PyTree], *batched: PyTree) -> PyTree:
    """`one` for every member, shared out over the local devices where they divide the members evenly.

    On a CPU the members of a device run one after the other, each in its core's cache; on an accelerator they run
    together. What a member computes does not depend on how many others there are, and devices never wait for each
    other. Results stay where they were made: `on_one_device` brings them together. `jax_num_cpu_devices` makes as many
    devices of a CPU as it has cores.
    """
    devices = jax.local_devices()
    members = jax.tree.leaves(batched)[0].shape[0]
    shares = max(n for n in range(1, len(devices) + 1) if members % n == 0)
    mesh = jax.sharding.Mesh(np.array(devices[:shares]), ("device",))
    split = jax.sharding.PartitionSpec("device")

    def share(*batched: PyTree) -> PyTree:
        if devices[0].platform == "cpu":
            return jax.lax.map(lambda member: one(*member), batched)
        return jax.vmap(one, axis_name=MEMBER)(*batched)

    return jax.shard_map(share, mesh=mesh, in_specs=split, out_specs=split, check_vma=False)(*batched)


def on_one_device(tree: PyTree) -> PyTree:
    """Arrays spread over devices, copied to the first one.

    Any operation on a spread array makes the devices meet, and on a CPU that waits for every core and gives up after 40
    seconds; a copy does not.
    """
    return jax.tree.map(
        lambda leaf: leaf if isinstance(leaf, jax.core.Tracer) else jax.device_put(np.asarray(leaf)), tree
    )
