"""The settings of the algebraic model, each an option of commands, and what follows from them."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from yeastfit.errors import InputError
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.resolution import COARSE, OF_WIDE_DISHES, Resolution, usual_in
from yeastfit.model.model import Model
from yeastfit.model.numerics import WIDE, Numerics
from yeastfit.model.parameters import Scales
from yeastfit.numbers import CELL_LENGTHS, GROWTH_RATES, PIXEL_SIZES, Range
from yeastfit.parameter_set import LARGEST

PHOTOGRAPHED = 1.55  # µm per pixel of the micrographs of Li et al. 2024
CELL = 0.5  # area that a cell covers, in L0²
EVERY = 0.2  # between two rows of a table, in 1/μ*
SIMULATE, DATA = ("simulate",), ("simulate", "fit", "infer")
Match = Literal["time", "area"]


@dataclass(frozen=True)
class AlgebraicSettings(ForwardModel):
    """How its colonies grow, and when they are compared with data."""

    rules: Model = field(default_factory=Model)
    time: Annotated[
        float,
        Setting("How long the colonies grow, in units of 1/μ* (2.17 hours unless --rate is given).", commands=SIMULATE),
    ] = 10.0
    every: Annotated[
        float | None,
        Setting(
            f"Interval between two rows of the table, in the same unit as --time; {EVERY}, or all of a shorter time.",
            commands=SIMULATE,
        ),
    ] = None
    hard: Annotated[
        bool,
        Setting("Use the model's exact rules, or the smoothed ones.", commands=SIMULATE, negative="relaxed"),
    ] = False
    times: Annotated[
        tuple[float, ...],
        Setting("Times at which colonies could be photographed, in units of 1/μ*, with commas.", commands=("design",)),
    ] = (2.0, 3.0, 4.0, 5.0, 6.0)
    dt: Annotated[
        float | None,
        Setting(
            f"Time step, in units of 1/μ*. Default: {Numerics.dt:g} for simulate, {COARSE.dt:g} for fit, "
            f"{Resolution.dt:g} for infer and design; {OF_WIDE_DISHES.dt:g} in {OF_WIDE_DISHES.substeps} substeps "
            f"in dishes wider than {WIDE:g} L0.",
            commands=(*DATA, "design"),
        ),
    ] = None
    substeps: Annotated[
        int | None,
        Setting(
            "Steps within a time step in which only nodes move, as springs and contact need shorter ones. Default: 1, "
            "or that of the default time step.",
            commands=DATA,
        ),
    ] = None
    spacing: Annotated[
        float | None,
        Setting(
            f"Spacing of the nutrient's grid, in cell lengths L0. Default: {COARSE.spacing:g} for fit, else "
            f"{Resolution.spacing:g}; {OF_WIDE_DISHES.spacing:g} in dishes wider than {WIDE:g} L0.",
            commands=DATA,
        ),
    ] = None
    domain: Annotated[float, Setting("Side of the square dish, in cell lengths L0.", commands=SIMULATE)] = 40.0
    pixel_size: Annotated[
        float, Setting("µm per pixel of the images that --statistics are measured on.", commands=SIMULATE)
    ] = PHOTOGRAPHED
    capacity: Annotated[
        int | None,
        Setting(
            "Largest possible number of nodes in a colony (cells + 1). Growth beyond it is cut, which results tell; "
            "without it, where memory ends.",
            commands=DATA,
        ),
    ] = None
    compiled: Annotated[
        bool,
        Setting(
            "Compute contact, springs and nutrient of colonies of more than 500 nodes by loops compiled by numba, "
            "or without them.",
            commands=SIMULATE,
            negative="plain",
        ),
    ] = True
    until_area: Annotated[
        float | None,
        Setting("Area in L0² at which a colony stops growing, if it reaches it before --time.", commands=SIMULATE),
    ] = None
    until_cells: Annotated[
        int | None,
        Setting("Number of cells at which a colony stops growing, if it reaches it before --time.", commands=SIMULATE),
    ] = None
    rate: Annotated[
        float,
        Setting("Maximal growth rate μ* of the cells, per hour. Model time is in units of 1/μ*.", commands=DATA),
    ] = Scales.rate
    kept: Annotated[
        Path | None, Setting("Folder in which large colonies are kept as they grow.", commands=("python",))
    ] = None
    length: Annotated[
        float, Setting("Mean length L0 of a cell, in µm. Model lengths are in units of L0.", commands=DATA)
    ] = Scales.length
    match: Annotated[
        Match,
        Setting(
            "When simulated colonies are compared with the data: at the images' times, or, whatever their age, when "
            "they have the mean area of the last images (area); one that has not by the time of these is none of the "
            "data's kind.",
            commands=("infer",),
        ),
    ] = "time"
    area: Annotated[
        float | None,
        Setting("With --match area: the area in µm², instead of the data's mean.", commands=("infer",)),
    ] = None

    def __post_init__(self) -> None:
        CELL_LENGTHS.check(self.length, "length")
        GROWTH_RATES.check(self.rate, "rate")
        self.chosen(Resolution())
        PIXEL_SIZES.read(self.pixel_size, "pixel_size")
        for name in ("until_area", "until_cells"):
            if (end := getattr(self, name)) is not None:
                Range(0, LARGEST, above=True).check(end, name)
        if self.match not in get_args(Match):
            raise InputError(f"match is {self.match!r}, it must be {' or '.join(get_args(Match))}")
        if self.area is not None:
            Range(CELL * self.length**2, unit="µm²").read(self.area, "area")
            if self.timed:
                raise InputError(f"area is {self.area:g} and match time: it is for match area, leave it out")

    @property
    def timed(self) -> bool:
        """Whether colonies are compared at the images' times."""
        return self.match == "time"

    @property
    def until(self) -> dict[str, float] | None:
        """What ends growth before the time.

        Raises:
            InputError: Two things would.
        """
        given = {"area": self.until_area, "cells": self.until_cells}
        found = {name: value for name, value in given.items() if value is not None}
        if len(found) > 1:
            raise InputError("--until-area and --until-cells are both given: growth ends at one of them")
        return found or None

    @property
    def every_row(self) -> float:
        """Time between two rows of a table."""
        return min(max(EVERY, self.numerics.dt), self.time) if self.every is None else self.every

    @property
    def numerics(self) -> Numerics:
        """Of `simulate`."""
        usual = usual_in(self.domain, Resolution(Numerics.dt, Numerics.spacing))
        if self.spacing is None and usual is OF_WIDE_DISHES:  # the nearest that the dish is a whole number of
            usual = replace(usual, spacing=self.domain / round(self.domain / usual.spacing))
        how = self.chosen(usual)
        return Numerics(self.domain, how.spacing, how.dt, how.capacity, compiled=self.compiled, substeps=how.substeps)

    def chosen(self, usual: Resolution) -> Resolution:
        """What is given, and the usual values of the rest; a time step that is given has one substep."""
        own: dict[str, Any] = {name: getattr(self, name) for name in ("dt", "spacing", "substeps", "capacity")}
        one = replace(usual, substeps=1) if self.dt is not None else usual
        return replace(one, **{name: value for name, value in own.items() if value is not None})

    @property
    def scales(self) -> Scales:
        """Units of the model."""
        return Scales(self.length, self.rate)
