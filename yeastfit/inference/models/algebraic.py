"""The algebraic model (docs/model.md), composed of rules, as commands see it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import DEFAULT_FREE, OUTLINE_PIXEL, ColonySimulator, check_spacing
from yeastfit.inference.models.forward_model import ForwardModel, Row, Seen
from yeastfit.inference.models.grown import Grown, Outlines
from yeastfit.inference.models.image_checks import check_images, of_pixels
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.resolution import COARSE, OF_WIDE_DISHES, WIDE, Resolution, usual_in, usual_resolution
from yeastfit.inference.sensitivity.estimate import sensitivity as estimate_sensitivity
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.inference.targets_from_table import targets_of
from yeastfit.measure.measurements_table import NEEDED, rows_of
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics, most_nodes
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.numbers import CELL_LENGTHS, GROWTH_RATES, PIXEL_SIZES, Range
from yeastfit.panel import Panel
from yeastfit.parameter_set import LARGEST, ParameterSet
from yeastfit.simulation.panels_over_time import panels_over_time
from yeastfit.simulation.simulate import member_keys, sample_times
from yeastfit.simulation.simulate import simulate as run_simulation

PHOTOGRAPHED = 1.55  # µm per pixel of the micrographs of Li et al. 2024
MANY = 5000  # cells of a colony from which on a fit takes days
CELL = 0.5  # area that a cell covers, in L0²
EVERY = 0.2  # between two rows of a table, in 1/μ*
SIMULATE, DATA = ("simulate",), ("simulate", "fit", "infer")


@dataclass(frozen=True)
class Algebraic(ForwardModel):
    """Colonies of the algebraic model, photographed at several times."""

    free: ClassVar[tuple[str, ...]] = DEFAULT_FREE
    fitted: ClassVar[tuple[str, ...]] = DEFAULT_FREE
    nouns: ClassVar = ("colony", "colonies")
    columns: ClassVar = NEEDED
    units: ClassVar = (
        "Parameters are dimensionless. Lengths are in L0, the mean length of a cell, areas in L0²; statistics are "
        "named by their times in units of 1/μ*, μ* the largest growth rate of cells. Pictures of curves count hours, "
        "too."
    )

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

    def __post_init__(self) -> None:
        CELL_LENGTHS.check(self.length, "length")
        GROWTH_RATES.check(self.rate, "rate")
        self._chosen(Resolution())
        PIXEL_SIZES.read(self.pixel_size, "pixel_size")
        for name in ("until_area", "until_cells"):
            if (end := getattr(self, name)) is not None:
                Range(0, LARGEST, above=True).check(end, name)

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
    def _every(self) -> float:
        """Time between two rows of a table."""
        return min(max(EVERY, self._numerics.dt), self.time) if self.every is None else self.every

    @property
    def _numerics(self) -> Numerics:
        """Of `simulate`."""
        usual = usual_in(self.domain, Resolution(Numerics.dt, Numerics.spacing))
        if self.spacing is None and usual is OF_WIDE_DISHES:  # the nearest that the dish is a whole number of
            usual = replace(usual, spacing=self.domain / round(self.domain / usual.spacing))
        how = self._chosen(usual)
        return Numerics(self.domain, how.spacing, how.dt, how.capacity, compiled=self.compiled, substeps=how.substeps)

    def _chosen(self, usual: Resolution) -> Resolution:
        """What is given, and the usual values of the rest; a time step that is given has one substep."""
        own: dict[str, Any] = {name: getattr(self, name) for name in ("dt", "spacing", "substeps", "capacity")}
        one = replace(usual, substeps=1) if self.dt is not None else usual
        return replace(one, **{name: value for name, value in own.items() if value is not None})

    @property
    def parameters(self) -> ParameterSet:
        """λ1 … λ7, and what the rules bring."""
        return self.rules.parameters

    @property
    def scales(self) -> Scales:
        """Units of the model."""
        return Scales(self.length, self.rate)

    def unit_of(self, name: str) -> tuple[float, str]:
        """µm and hours, by a cell's length and the growth rate."""
        one = self.parameters[name]
        return self.scales.unit(one.powers) if one.powers != (0, 0) else (1.0, one.unit)

    def simulator(self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]) -> Simulator:
        """Colonies that are seen as the data are."""
        return ColonySimulator.of(targets, free, fixed, self._chosen(usual_resolution(targets)), self.rules)

    def fit_simulators(
        self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]
    ) -> tuple[Simulator, Simulator]:
        """Colonies in time steps as long as asked for, and at the default resolution where that is finer."""
        coarse, usual = self._chosen(usual_resolution(targets, coarse=True)), usual_resolution(targets)
        fine = replace(coarse, dt=min(usual.dt, coarse.dt), spacing=min(usual.spacing, coarse.spacing))
        of_coarse, of_fine = (ColonySimulator.of(targets, free, fixed, one, self.rules) for one in (coarse, fine))
        return of_coarse, of_fine

    def seen(self, rows: Sequence[Row], folder: Path, condition: str | None, statistics: Sequence[str]) -> Seen:
        """Curves over time, lengths in L0."""
        targets = targets_of(rows, folder, condition=condition, statistics=statistics, scales=self.scales)
        return Seen(self, targets, tuple(self._too_many_cells(rows_of(rows, condition))))

    def _too_many_cells(self, rows: Sequence[Row]) -> list[str]:
        """Say that colonies are too large to grow hundreds of them, where the table has their areas."""
        areas = [float(row["area"]) for row in rows if np.isfinite(float(row.get("area", np.nan)))]
        cells = max(areas, default=0.0) / (CELL * self.length**2)
        if cells < MANY:
            return []
        return [
            f"the largest colony has the area of about {round(cells, -3):.0f} cells of {self.length:g} µm: this model "
            "grows hundreds of colonies cell by cell, for hours to days; --model offlattice is for such colonies"
        ]

    def settings(self, command: str) -> dict[str, Any]:
        """The settings that a command has; of `simulate`, the steps that the dish's width decides, too."""
        found = super().settings(command)
        if command == "simulate":
            found |= {name: getattr(self._numerics, name) for name in ("dt", "spacing", "substeps")}
        return found

    def check(self, largest: Mapping[str, float], hours: Sequence[float]) -> None:
        """Raise `InputError` where steps in space or time are too long for colonies, a diffusivity, or the images."""
        how = self._chosen(Resolution())
        check_spacing(how.spacing)
        step = Numerics(domain=100 * how.spacing, spacing=how.spacing, dt=how.dt)
        check_alpha(jnp.asarray(largest["diffusivity"], jnp.result_type(float)), step)
        gaps = np.diff(hours, prepend=0.0)
        if len(hours) and gaps.min() < (one := how.dt / self.rate):
            raise InputError(
                f"hours of images are {', '.join(f'{time:g}' for time in hours)}: a time step, --dt {how.dt:g} at "
                f"--rate {self.rate:g} per hour, takes {one:.3g} hours, it must be at most {gaps.min():.3g}"
            )

    def check_images(self, images: Sequence[Row], statistics: Sequence[str]) -> None:
        """Raise `InputError` where pixels are of no size for cells, or of two sizes where statistics depend on it."""
        check_images(images, self.length, by="--length", alike=of_pixels(statistics))

    def outlines(self, simulator: Any, values: Float[np.ndarray, "row free"], targets: Targets, seed: int) -> Outlines:
        """Where the cells of one colony are at the data's last time, at each row."""
        scales = targets.imaging.scales if targets.imaging is not None else Scales()
        return simulator.outlines(values, float(targets.times[-1]), seed), OUTLINE_PIXEL * scales.length

    def sensitivity(self, statistics: Sequence[str], values: Mapping[str, float], **how: Any) -> Sensitivity:
        """By regression along all parameters, which costs as much as along one."""
        times = self.times
        if not times or not np.isfinite(times).all() or min(times) <= 0:
            raise InputError(f"--times is {','.join(f'{time:g}' for time in times)}, it must hold numbers above 0")
        latest = max(times)
        try:
            numerics = Numerics(
                dt=self._chosen(Resolution()).dt, capacity=most_nodes(latest, self.rules.births.doublings)
            )
        except InputError as error:
            raise InputError(f"--times has {latest:g}, when a colony may have that many nodes: {error}") from None
        return estimate_sensitivity(
            Parameters(**values),
            times=times,
            statistics=statistics,
            method="regression",
            model=self.rules,
            numerics=numerics,
            **how,
        )

    def movie(self, values: Mapping[str, float], seed: int, frames: int) -> Iterator[list[Panel]]:
        """Cells and nutrient of one colony."""
        chosen, numerics = self.rules.complete(Parameters(**values)), self._numerics
        relaxation = HARD if self.hard else Relaxation()
        times = sample_times(self.time, max(self.time / frames, numerics.dt), numerics)
        yield from panels_over_time(
            chosen,
            member_keys(seed, 1),
            times=times,
            model=self.rules,
            numerics=numerics,
            relaxation=relaxation,
            scales=self.scales,
        )

    def grow(self, values: Mapping[str, float], members: int, seed: int, statistics: Sequence[str] = ()) -> Grown:
        """Colonies in an ensemble, seen at regular times and at the end; named statistics as `measure` takes them."""
        chosen, numerics = self.rules.complete(Parameters(**values)), self._numerics
        until = self.until
        return run_simulation(
            chosen,
            member_keys(seed, members),
            times=sample_times(self.time, self.time if until is not None else self._every, numerics),
            until=until,
            model=self.rules,
            numerics=numerics,
            relaxation=HARD if self.hard else Relaxation(),
            observe=self._photographed(statistics) if statistics else None,
            scales=self.scales,
            keep=self.kept,
        )

    def keeping(self, folder: Path) -> "Algebraic":
        """The same, keeping colonies that grow in segments."""
        return replace(self, kept=folder)

    def ended_as(self, grown: Grown) -> "Algebraic":
        """The same, growing for the time at which the first colony came to what ended growth."""
        ends = np.atleast_1d(getattr(grown, "ends", self.time))
        return replace(self, time=max(float(ends[0]), self._numerics.dt), until_area=None, until_cells=None)

    def _photographed(self, statistics: Sequence[str]) -> HardStatistics:
        """Statistics of black-and-white images of the whole dish.

        Raises:
            InputError: A pixel is larger than a cell, or a name is not a statistic of images or nodes.
        """
        pixel = self.pixel_size / self.length
        if pixel > 1:
            raise InputError(
                f"--pixel-size is {self.pixel_size:g} µm, which is more than a cell's length, {self.length:g} µm"
            )
        return HardStatistics(self.domain, pixel, tuple(statistics))
