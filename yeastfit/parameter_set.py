"""Parameters of a simulator: their names, meaning, units and ranges, in a fixed order.

Fits, priors, designs, tables, pages and the command line ask a `ParameterSet` for everything they say about a
parameter. Every simulator brings one; nobody else lists parameters.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from yeastfit.errors import InputError
from yeastfit.kinds import check_list
from yeastfit.text import quoted

SMALLEST, LARGEST = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)  # simulations compute with


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        name: As in Python and in tables.
        symbol: For plots and pages.
        meaning: One line for a reader who does not know the model.
        plausible: The range that a fit searches and a default prior covers; above 0 for a fit, which works with log λ.
        default: The value it has where nobody gives one.
        unit: Empty for a dimensionless one.
        smallest: Admissible minimum.
        largest: Admissible maximum.
        positive: Whether `smallest` itself is inadmissible.
        powers: Of a cell's length L0 and of the growth rate μ*, by whose product it is multiplied to give it units:
            (2, 1) for µm²/h, (0, -1) for hours. (0, 0) for a number that has none.
        exceeded: Whether derivatives at `largest` are taken from simulations on both sides of it.
        shared: Whether all colonies of a condition have it in common, also where their other parameters scatter: one of
            the camera or of outlining, or of how colonies differ.
    """

    name: str
    symbol: str
    meaning: str
    plausible: tuple[float, float]
    default: float
    unit: str = ""
    smallest: float = 0.0
    largest: float = math.inf
    positive: bool = False
    powers: tuple[int, int] = (0, 0)
    exceeded: bool = False
    shared: bool = False

    def __post_init__(self) -> None:
        low, high = self.plausible
        if not self.name.isidentifier():
            raise InputError(f"parameter: name is {self.name!r}, it must be letters, digits and underscores")
        if len(self.powers) != 2 or not all(isinstance(power, int) for power in self.powers):
            raise InputError(f"{self.name}: powers is {self.powers!r}, it must be two whole numbers, of L0 and of μ*")
        if not self.admissible(np.asarray(self.default)):
            raise InputError(f"{self.name}: default is {self.default:g}, it must be {self.limits}")
        if not self.smallest <= low < high <= self.largest:
            raise InputError(
                f"{self.name}: plausible is {self.plausible}, it must rise within {self.smallest:g} to {self.largest:g}"
            )

    @property
    def limits(self) -> str:
        """The admissible range in words."""
        if math.isfinite(self.largest) and math.isfinite(self.smallest):
            return f"in {'(' if self.positive else '['}{self.smallest:g}, {self.largest:g}]"
        if math.isfinite(self.smallest):
            return f"finite and {'above' if self.positive else 'at least'} {self.smallest:g}"
        return f"finite and at most {self.largest:g}" if math.isfinite(self.largest) else "finite"

    def admissible(self, values: np.ndarray) -> np.ndarray | np.bool:
        """Whether each value is; 1e-6 above the maximum is, as single precision may round it up by its last bit."""
        least = values > self.smallest if self.positive else values >= self.smallest
        return np.isfinite(values) & least & (values <= self.largest * (1 + 1e-6))

    def check(self, value: float | np.ndarray) -> None:
        """Raise `InputError` where a value is not admissible."""
        try:
            values = np.asarray(value, dtype=float)
        except ValueError:
            raise InputError(f"{self.name} ({self.symbol}) is {quoted(value)}, it must be {self.limits}") from None
        size = np.abs(values)
        beyond = np.isfinite(size) & (size != 0) & ((size > LARGEST) | (size < SMALLEST))
        if beyond.any():
            one = f"{self.name} ({self.symbol}) is {values[beyond].flat[0]:g}"
            raise InputError(f"{one}, it must be 0 or of single precision, from {SMALLEST:.2g} to {LARGEST:.2g}")
        bad = ~self.admissible(values)
        if bad.any():
            raise InputError(f"{self.name} ({self.symbol}) is {values[bad].flat[0]:g}, it must be {self.limits}")


@dataclass(frozen=True)
class ParameterSet(Mapping[str, Parameter]):
    """Parameters by name, in order. A mapping from names to `Parameter`.

    Attributes:
        parameters: In order.

    Raises:
        InputError: Two parameters have one name.
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        twice = {name for name in self.names if self.names.count(name) > 1}
        if twice:
            raise InputError(f"parameters: the name {sorted(twice)[0]!r} appears twice")

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(one.name for one in self.parameters)

    @property
    def defaults(self) -> dict[str, float]:
        """Default values by name."""
        return {one.name: one.default for one in self.parameters}

    def __getitem__(self, name: str) -> Parameter:
        for one in self.parameters:
            if one.name == name:
                return one
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.parameters)

    def __add__(self, others: Iterable[Parameter]) -> "ParameterSet":
        """These and further ones."""
        return ParameterSet((*self.parameters, *others))

    def subset(self, names: Sequence[str]) -> "ParameterSet":
        """Some of them, in the order of this set.

        Raises:
            InputError: A name is unknown, none is given, or one is given twice.
        """
        check_list("free", names)
        for name in names:
            if name not in self.names:
                raise InputError(f"free names {name!r}, which is unknown, expected some of {', '.join(self.names)}")
        if not names:
            raise InputError(f"free names no parameter, need at least one of {', '.join(self.names)}")
        if twice := [name for name in names if list(names).count(name) > 1]:
            raise InputError(f"free names {twice[0]!r} twice, need each once")
        return ParameterSet(tuple(one for one in self.parameters if one.name in names))

    def check(self, values: Mapping[str, float]) -> None:
        """Raise `InputError` for an unknown name or an inadmissible value."""
        for name, value in values.items():
            if name not in self.names:
                raise InputError(f"unknown parameter {name!r}, expected one of {', '.join(self.names)}")
            self[name].check(value)
