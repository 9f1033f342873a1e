"""What fits and samplers ask of a forward model: rows of parameters and seeds in, rows of statistics out.

Anything with `parameters`, `observables` and this call is a `Simulator`; nothing has to inherit from it. Further
attributes are read where they exist:

    fixed           values of parameters that are held, by name: for tables
    names           all parameters, free and held, in the order of tables
    problems        how often simulations ran into what, in words: for warnings (a `collections.Counter`)
    blocks          rows in blocks, each as soon as it is there, with the arguments of `rows_in_blocks`: for stores
    specification   how other processes make the same simulator (a `Specification`): for workers
    in_blocks_of    the same simulator for calls with so many rows, where it wants to know: for workers

Wrappers count what is simulated, average replicates and add errors of measurement.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Array, Float, Shaped

from yeastfit.errors import InputError
from yeastfit.observable import Observable
from yeastfit.parameter_set import ParameterSet
from yeastfit.seeds import Stream, check_seed, stream_of
from yeastfit.simulation.simulate import member_keys
from yeastfit.text import short

Values = Float[np.ndarray, "row parameter"]
Seeds = Shaped[np.ndarray, " row"]  # whole numbers from 0 to 2⁶⁴ − 1
Rows = Float[np.ndarray, "row statistic"]


@runtime_checkable
class Simulator(Protocol):
    """A forward model with some parameters free and the others held."""

    @property
    def parameters(self) -> ParameterSet:
        """The free parameters, one per column of `values`."""

    @property
    def observables(self) -> tuple[Observable, ...]:
        """What the columns of the result are."""

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Simulate one replicate per row.

        Arguments:
            values: Parameters themselves, not their logarithms.
            seeds: One per row. The same row and seed give the same result, whatever the batch.

        Returns:
            One row of statistics per row; nan throughout where a simulation failed.
        """


@dataclass(frozen=True)
class Wrapper:
    """A simulator around another one, with the same parameters and observables."""

    simulator: Simulator

    @property
    def parameters(self) -> ParameterSet:
        """The free parameters."""
        return self.simulator.parameters

    @property
    def observables(self) -> tuple[Observable, ...]:
        """What the columns of the result are."""
        return self.simulator.observables

    @property
    def fixed(self) -> Mapping[str, float]:
        """Parameters that are held."""
        return fixed_of(self.simulator)

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters, free and held."""
        return names_of(self.simulator)

    @property
    def problems(self) -> Counter[str]:
        """What simulations ran into."""
        return problems_of(self.simulator)

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows of the simulator inside."""
        return self.simulator(values, seeds)


def check_simulator(simulator: object, name: str = "simulator") -> None:
    """Raise `InputError` where an object lacks what makes a simulator, or is its class instead."""
    lacks = [part for part in ("parameters", "observables") if not hasattr(simulator, part)]
    if isinstance(simulator, type):
        what = f"({simulator.__name__}) is a class"
    elif lacks:
        what = f"({type(simulator).__name__}) has no {' and no '.join(lacks)}"
    elif not callable(simulator):
        what = f"({type(simulator).__name__}) cannot be called"
    else:
        return
    raise InputError(
        f"{name} {what}: it must be an object with parameters, observables and a call (values, seeds) -> rows"
    )


def inside(simulator: Simulator) -> Simulator:
    """What is inside all wrappers."""
    return inside(simulator.simulator) if isinstance(simulator, Wrapper) else simulator


@dataclass
class Tally:
    """How many different simulations were asked for. A batch may be filled up with copies, which do not count.

    Attributes:
        simulated: All of them.
        failed: Those with a value that is not finite, where somebody looks (`Counted`).
    """

    simulated: int = 0
    failed: int = 0


@dataclass(frozen=True)
class Counted(Wrapper):
    """A simulator that counts the different rows of every call in `tally`, and those that are not finite."""

    tally: Tally

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows of the simulator inside."""
        found = rows_of(self.simulator, values, seeds)
        different = once(values, seeds)
        self.tally.simulated += len(different)
        self.tally.failed += int((~np.isfinite(found[different]).all(axis=1)).sum())
        return found


@dataclass(frozen=True)
class Replicates(Wrapper):
    """A simulator whose data sets are means over `count` data sets of another; nan where one of them is."""

    count: int

    def __post_init__(self) -> None:
        if self.count < 1:
            raise InputError(f"count is {self.count}, a mean needs at least 1")

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Means. Replicate k of a data set has the k-th seed of the data set's own."""
        each = np.array([seed_of(int(seed), range(self.count)) for seed in seeds], dtype=np.uint64).ravel()
        found = self.simulator(np.repeat(values, self.count, axis=0), each)
        return found.reshape(len(seeds), self.count, -1).mean(axis=1)


@dataclass(frozen=True)
class Limited(Wrapper):
    """A simulator whose statistics beyond limits are set to these."""

    limits: Float[np.ndarray, "statistic 2"]

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows within the limits; nan stays."""
        return np.clip(self.simulator(values, seeds), *self.limits.T)


@dataclass(frozen=True)
class Mismeasured(Wrapper):
    """A simulator whose statistics have Gaussian errors of measurement with covariance root rootᵀ.

    As ε falls, ABC with it comes to the posterior under these errors (Wilkinson 2013, doi:10.1515/sagmb-2013-0010).
    """

    root: Float[np.ndarray, "statistic statistic"]

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows with errors, which depend on a row's seed alone."""
        streams = [np.random.default_rng(stream_of(int(seed), Stream.ERRORS, 0)) for seed in seeds]
        normal = np.array([stream.standard_normal(len(self.root)) for stream in streams])
        return self.simulator(values, seeds) + normal.reshape(-1, len(self.root)) @ self.root.T


def rows_of(simulator: Simulator, values: Values, seeds: Seeds) -> Rows:
    """A simulator's rows, as numbers.

    Raises:
        InputError: They are no numbers, or another array than a row for each seed and a column for each observable.
    """
    found, expected = simulator(values, seeds), (len(seeds), len(simulator.observables))
    try:
        rows = np.asarray(found, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"simulator gave {short(found)}, expected an array of numbers of shape {expected}") from None
    if rows.shape != expected:
        what = "a row for each seed, a column for each observable"
        raise InputError(f"simulator gave shape {rows.shape}, expected {expected}: {what}")
    return rows


def rows_in_blocks(simulator: Simulator, values: Values, seeds: Seeds, size: int) -> Iterator[Rows]:
    """Rows block by block, in their order, each as soon as it is there.

    Arguments:
        simulator: One that has its own `blocks` decides over their size.
        values: Of all rows.
        seeds: Likewise.
        size: Of every call of any other simulator: the last block is filled up with copies of its first row.

    Raises:
        InputError: The simulator gives arrays of another shape.
    """
    own: Any = getattr(simulator, "blocks", None)
    if own is not None:
        yield from own(values, seeds, size)
        return
    for start in range(0, len(seeds), size):
        rows = np.arange(start, min(start + size, len(seeds)))
        padded = np.concatenate([rows, np.full(size - len(rows), start)])
        yield rows_of(simulator, values[padded], seeds[padded])[: len(rows)]


def labels_of(simulator: Simulator) -> tuple[str, ...]:
    """Names of the columns of a simulator's rows."""
    return tuple(map(str, simulator.observables))


def same_observables(first: Sequence[Observable], second: Sequence[Observable]) -> bool:
    """Whether two rows have the same columns; times may differ by rounding."""
    names, others = ([one.statistic for one in each] for each in (first, second))
    times, other_times = ([one.time for one in each] for each in (first, second))
    return names == others and np.allclose(times, other_times, rtol=1e-6, atol=1e-9, equal_nan=True)


def about_of(simulator: Simulator) -> str:
    """What decides over a simulation beside parameters and seed, for files; as far as the simulator says.

    That is its `about`; of a simulator without one what it holds fixed, and its fields that are plain data.
    """
    bare = inside(simulator)
    own = getattr(bare, "about", None)
    if isinstance(own, str):
        return own
    held = {one.name: getattr(bare, one.name) for one in fields(bare)} if is_dataclass(bare) else dict[str, object]()
    said = {name: value for name, value in held.items() if isinstance(value, str | bool | int | float)}
    said |= dict(fixed_of(bare))
    return ", ".join(f"{name} {value}" for name, value in said.items())


def fixed_of(simulator: Simulator) -> Mapping[str, float]:
    """Parameters that a simulator holds, where it says so."""
    return getattr(simulator, "fixed", {})


def names_of(simulator: Simulator) -> tuple[str, ...]:
    """All parameters of a simulator: in its own order where it says so, else the free ones and then the held."""
    found: Any = getattr(simulator, "names", None)
    return (*simulator.parameters.names, *fixed_of(simulator)) if found is None else found


def named_values(simulator: Simulator, values: Sequence[float] | np.ndarray) -> dict[str, float]:
    """All parameters of a simulator by name, the free ones from a row of values."""
    known = {**fixed_of(simulator), **dict(zip(simulator.parameters.names, map(float, values), strict=True))}
    return {name: known[name] for name in names_of(simulator)}


def problems_of(simulator: Simulator) -> Counter[str]:
    """What a simulator's runs came across, where it says so."""
    found: Any = getattr(simulator, "problems", None)
    return Counter() if found is None else found


def once(values: Values, seeds: Seeds) -> np.ndarray:
    """Numbers of the rows that differ from all before them."""
    keys = row_keys(values, seeds)
    return np.array(sorted({key: k for k, key in reversed(list(enumerate(keys)))}.values()), dtype=int)


def row_keys(values: Values, seeds: Seeds) -> list[bytes]:
    """What a simulation is found by: the bits of its parameters and its seed."""
    return [int(seed).to_bytes(8, "little") + row.tobytes() for row, seed in zip(values, seeds, strict=True)]


def root_of(covariance: Float[np.ndarray, "statistic statistic"]) -> Float[np.ndarray, "statistic statistic"]:
    """A matrix A with A Aᵀ the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def seed_of(seed: int, numbers: Sequence[int] | np.ndarray) -> Shaped[np.ndarray, " number"]:
    """Seeds, 0 ≤ seed < 2³², of the simulations with these numbers in a run.

    Each is the first word of `np.random.SeedSequence(seed, spawn_key=(number,))`: it depends on the run's seed and the
    number alone, so a resumed run draws what it would have drawn. Two of n numbers share a seed with probability
    n² / 2³³, which does no harm, as their parameters differ.
    """
    check_seed(seed)
    words = [np.random.SeedSequence(seed, spawn_key=(int(n),)).generate_state(1)[0] for n in np.ravel(numbers)]
    return np.array(words, dtype=np.uint64)


def member_seeds(seed: int | Array, members: int) -> Shaped[np.ndarray, " member"]:
    """Seeds of an ensemble, 64 bits each, whose member i is the same whatever the number of members.

    They are the bits of `yeastfit.member_keys`: a colony grown from one is the colony of that key.

    Arguments:
        seed: A number, or one of jax's keys.
        members: How many.
    """
    words = np.asarray(jax.random.key_data(member_keys(seed, members))).astype(np.uint64)
    return (words[:, 0] << np.uint64(32)) | words[:, 1]


def stream_seeds(seed: int, stream: Stream, members: int) -> Shaped[np.ndarray, " member"]:
    """Seeds of an ensemble of a named stream; see `member_seeds`."""
    return member_seeds(int(stream_of(seed, stream, 0).generate_state(1)[0]), members)
