"""What the package knows about one summary statistic: its name, unit and meaning, and how it is computed.

A statistic has one or two of three forms. `mask` takes the black-and-white image of a colony, photographed or
simulated. `smooth` takes a smooth indicator of either, and can be differentiated. `nodes` takes the state of a
simulated colony: it is for what no image shows. One without any form is a quantity of models that are no colonies, such
as an optical density, which tables hold.
"""

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from yeastfit.errors import InputError
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.numbers import Range

if TYPE_CHECKING:  # they bring JAX, which masks are measured without
    from yeastfit.measure.statistics.indicator import Indicator
    from yeastfit.model.snapshot import Snapshot

Form = Literal["mask", "smooth", "nodes"]


@dataclass(frozen=True)
class Statistic:
    """One summary statistic.

    Attributes:
        name: In Python, in tables and on the command line.
        unit_power: 1 for a length, 2 for an area, 0 for a number without unit.
        meaning: One line for a reader of a table.
        label: The title of a plot, without the unit; by default the name with spaces.
        mask: Its value for the pixels of a black-and-white image, in pixels.
        smooth: Its value for a smooth indicator, in the unit of the indicator's spacing. jax traces it.
        nodes: Its value for one step of a simulated colony, in L0. jax traces it.
        may_vanish: Whether it may be 0 or negative; the data of a fit are refused otherwise.
        measurement_error: Relative error of a measured mean that does not average out over replicates.
        is_count: Whether values of a mask are whole numbers.
        comparable: Whether data and simulations can be compared in it. False for where a colony lies in its image,
            and for what nobody can observe.
        reach: No colony reaches farther from its start than this many times the value or, of an area A, √(A / π).
            None where the value does not tell.
        possible: Values that a mask can have, in µm or µm²; other numbers in a table are refused. By default any
            number, above 0 for lengths, areas and counts, or at least 0 where they may vanish.

    Raises:
        InputError: `nodes` is given beside another form, or an attribute makes no sense.
    """

    name: str
    unit_power: int
    meaning: str
    label: str = ""
    _: KW_ONLY
    mask: Callable[[Pixels], float] | None = None
    smooth: Callable[["Indicator"], Any] | None = None
    nodes: Callable[["Snapshot"], Any] | None = None
    may_vanish: bool = False
    measurement_error: float = 0.01
    is_count: bool = False
    comparable: bool = True
    reach: float | None = None
    possible: Range | None = None

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise InputError(f"statistic: name is {self.name!r}, it must be letters, digits and underscores")
        if self.unit_power not in (0, 1, 2):
            raise InputError(f"statistic {self.name!r}: unit_power is {self.unit_power!r}, it must be 0, 1 or 2")
        if self.nodes and len(self.forms) > 1:
            raise InputError(f"statistic {self.name!r}: nodes is for what no image shows, leave out {self.forms[0]}")
        for form in self.forms:
            if not callable(getattr(self, form)):
                raise InputError(f"statistic {self.name!r}: {form} is {getattr(self, form)!r}, it must be a function")
        if not (math.isfinite(self.measurement_error) and self.measurement_error >= 0):
            error = self.measurement_error
            raise InputError(f"statistic {self.name!r}: measurement_error is {error}, it must be finite and at least 0")
        if self.reach is not None and not (self.unit_power and math.isfinite(self.reach) and self.reach > 0):
            raise InputError(f"statistic {self.name!r}: reach is {self.reach}, it is for lengths and areas, above 0")
        if not self.label:
            object.__setattr__(self, "label", self.name.replace("_", " "))

    @property
    def forms(self) -> tuple[Form, ...]:
        """The forms that it has."""
        return tuple(form for form in get_args(Form) if getattr(self, form) is not None)

    def unit(self, length: str = "µm") -> str:
        """Its unit, in terms of a unit of length; empty where it has none."""
        return ("", length, f"{length}²")[self.unit_power]

    @property
    def admissible(self) -> Range:
        """Values that a mask can have, in µm or µm²."""
        if self.possible is None:
            sized = self.unit_power or self.is_count
            return Range(0.0, unit=self.unit(), above=not self.may_vanish) if sized else Range()
        return self.possible

    def title(self, length: str) -> str:
        """The label, with its unit in terms of a unit of length."""
        return self.label + (f" ({self.unit(length)})" if self.unit_power else "")
