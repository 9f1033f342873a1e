"""The five parameters of the off-lattice model, all of them shares or probabilities, and two of how it is drawn.

Symbols and rules are those of Li et al. 2024 (see `growth`). Plausible is what their prior holds, all but 0.1 % at
either end: Beta(5, 2) for n*, Beta(2, 2) for p_ps and p_sp, Beta(2, 5) for γ and p_a. Defaults are the means of their
stored posterior for AWRI 796 at 50 µM ammonium sulphate.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.text import quoted


class Rates(NamedTuple):
    """The five values, as kernels take them."""

    transition: float
    sated_from_pseudohyphal: float
    pseudohyphal_from_sated: float
    fork: float
    any_mother: float


PARAMETERS = ParameterSet(
    (
        Parameter(
            "transition",
            "n*",
            "share of all cells that are born before pseudohyphal growth sets in",
            (0.18, 0.992),
            0.63,
            largest=1.0,
        ),
        Parameter(
            "sated_from_pseudohyphal",
            "p_ps",
            "probability that a pseudohyphal cell, once it has a pseudohyphal daughter, next buds a sated one",
            (0.018, 0.982),
            0.61,
            largest=1.0,
        ),
        Parameter(
            "pseudohyphal_from_sated",
            "p_sp",
            "probability that a sated cell buds a pseudohyphal daughter, from which a filament may grow",
            (0.018, 0.982),
            0.25,
            largest=1.0,
        ),
        Parameter(
            "fork",
            "γ",
            "probability that a filament may fork: that a second pseudohyphal daughter of one cell is allowed",
            (0.0082, 0.82),
            0.13,
            largest=1.0,
        ),
        Parameter(
            "any_mother",
            "p_a",
            "probability that the next mother is any cell that can bud, not one of the pseudohyphal cells",
            (0.0082, 0.82),
            0.12,
            largest=1.0,
        ),
    )
)

GAP = Parameter(
    "gap",
    "w",
    "width below which gaps between cells, drawn as ellipses, are closed, as outlines of photographs close them",
    (6.0, 30.0),
    12.0,
    unit="µm",
    largest=100.0,
    shared=True,
)
"""Two cells in yeast form are 12 µm wide together."""

MARGIN = Parameter(
    "margin",
    "d",
    "distance by which outlines lie outside of cells, drawn as ellipses: blur, and cells above and below flat hairs",
    (0.5, 10.0),
    0.0,
    unit="µm",
    largest=100.0,
    shared=True,
)

DRAWING = ParameterSet((GAP, MARGIN))
"""Of drawing, not of growth."""

DRAWN = ParameterSet((*PARAMETERS.parameters, *DRAWING.parameters))
"""All that decide over what is seen of a colony."""

NUTRIENT_EXPONENT = Parameter(
    "nutrient_exponent",
    "s",
    "exponent of the area that a colony is matched to in the number of cells it grows, N (area / largest)^s",
    (0.025, 0.975),
    0.0,
    largest=1.0,
    shared=True,
)
"""0 where all colonies of a plate had as much nutrient, 1 where one of half the area had half."""

GROWING = ParameterSet((*PARAMETERS.parameters, NUTRIENT_EXPONENT))
"""Of growth, where colonies of several areas are compared."""

INFERRED = ParameterSet((*GROWING.parameters, *DRAWING.parameters))
"""All that data can decide over."""

PRIOR = {
    "transition": (5.0, 2.0),
    "sated_from_pseudohyphal": (2.0, 2.0),
    "pseudohyphal_from_sated": (2.0, 2.0),
    "fork": (2.0, 5.0),
    "any_mother": (2.0, 5.0),
}
"""a and b of Li et al.'s beta priors, by name."""


def rates_of(parameters: Mapping[str, float] | Sequence[float] | Float[np.ndarray, " parameter"]) -> Rates:
    """Values by name, those not given at their defaults, or all five in order; whether they lie in [0, 1] is not asked.

    Raises:
        InputError: A name is unknown, or there are not five values.
    """
    if isinstance(parameters, Mapping):
        for name in parameters:
            if name not in PARAMETERS:
                raise InputError(f"unknown parameter {name!r}, expected one of {', '.join(PARAMETERS.names)}")
        values = (PARAMETERS.defaults | dict(parameters)).values()
    else:
        values = tuple(parameters)  # type: ignore[assignment]
    if len(values) != len(PARAMETERS):
        raise InputError(f"parameters: got {len(values)} values, need five: {', '.join(PARAMETERS.names)}")
    for name, value in zip(PARAMETERS.names, values, strict=True):
        if isinstance(value, str) or np.ndim(value):
            raise InputError(f"{name} is {quoted(value)}, it must be a number")
    return Rates(*(float(value) for value in values))


def in_range(rates: Rates) -> bool:
    """Whether all five lie in [0, 1]."""
    return all(0 <= value <= 1 for value in rates)
