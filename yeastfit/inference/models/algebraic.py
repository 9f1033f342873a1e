"""The algebraic model (docs/model.md), composed of rules, as commands see it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import DEFAULT_FREE, OUTLINE_PIXEL, ColonySimulator, check_spacing
from yeastfit.inference.models.algebraic_settings import CELL, AlgebraicSettings
from yeastfit.inference.models.forward_model import Row, Seen
from yeastfit.inference.models.grown import Grown, Outlines
from yeastfit.inference.models.image_checks import check_images, of_pixels
from yeastfit.inference.models.last_images import last_images, mean_area, measured
from yeastfit.inference.resolution import Resolution, usual_resolution
from yeastfit.inference.sensitivity.estimate import sensitivity as estimate_sensitivity
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.inference.targets_from_table import targets_of
from yeastfit.measure.measurements_table import NEEDED, checked_rows, rows_of
from yeastfit.measure.outlining.outline_errors import COLONY_ERRORS, OUTLINE_ERRORS
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.model.numerics import Numerics, most_nodes
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.panel import Panel
from yeastfit.parameter_set import ParameterSet
from yeastfit.simulation.panels_over_time import panels_over_time
from yeastfit.simulation.simulate import member_keys, sample_times
from yeastfit.simulation.simulate import simulate as run_simulation

MANY = 5000  # cells of a colony from which on a fit takes days


@dataclass(frozen=True)
class Algebraic(AlgebraicSettings):
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

    @property
    def parameters(self) -> ParameterSet:
        """λ1 … λ7, and what the rules bring."""
        return self.rules.parameters

    def unit_of(self, name: str) -> tuple[float, str]:
        """µm and hours, by a cell's length and the growth rate."""
        one = self.parameters[name]
        return self.scales.unit(one.powers) if one.powers != (0, 0) else (1.0, one.unit)

    def simulator(self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]) -> Simulator:
        """Colonies that are seen as the data are."""
        area = None if self.area is None else self.area / self.length**2
        return ColonySimulator.of(targets, free, fixed, self.chosen(usual_resolution(targets)), self.rules, area)

    def fit_simulators(
        self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]
    ) -> tuple[Simulator, Simulator]:
        """Colonies in time steps as long as asked for, and at the default resolution where that is finer."""
        coarse, usual = self.chosen(usual_resolution(targets, coarse=True)), usual_resolution(targets)
        fine = replace(coarse, dt=min(usual.dt, coarse.dt), spacing=min(usual.spacing, coarse.spacing))
        of_coarse, of_fine = (ColonySimulator.of(targets, free, fixed, one, self.rules) for one in (coarse, fine))
        return of_coarse, of_fine

    def seen(self, rows: Sequence[Row], folder: Path, condition: str | None, statistics: Sequence[str]) -> Seen:
        """Curves over time, or statistics of the last images; lengths in L0.

        Raises:
            InputError: The data cannot be compared so, or, where colonies are compared at one area, that of an image is
                not known.
        """
        how: dict[str, Any] = {"condition": condition, "statistics": statistics, "scales": self.scales}
        if self.timed:
            areas = [float(row.get("area", np.nan)) for row in rows_of(rows, condition)]
            return Seen(self, targets_of(rows, folder, **how), tuple(self._too_many_cells(areas)))
        chosen, notes = last_images(checked_rows(rows, condition))
        latest = max(float(row["hours"]) for row in chosen)
        targets = targets_of([{**row, "hours": latest} for row in chosen], folder, estimator="mask", **how)
        areas = [measured(row, folder, ("area",))["area"] for row in chosen]
        mean = mean_area(chosen, areas)
        wanted = mean if self.area is None else self.area
        imaging = targets.imaging
        assert imaging is not None
        assert imaging.extent is not None
        smaller = replace(imaging, extent=imaging.extent * (wanted / float(np.mean(areas))) ** 0.5)
        notes += self._too_many_cells([wanted])
        return Seen(replace(self, area=wanted), replace(targets, imaging=smaller), tuple(notes))

    def measurement_errors(self, names: Sequence[str], given: float | None) -> dict[str, float]:
        """The usual ones, or by default, of colonies compared at their area, those of outlines of photographs."""
        usual = super().measurement_errors(names, given)
        if self.timed or given is not None:
            return usual
        return {name: OUTLINE_ERRORS.get(name, error) for name, error in usual.items()}

    def colony_errors(self, names: Sequence[str], given: float | None) -> dict[str, float]:
        """By default, of colonies compared at their area, those of outlines of photographs."""
        if self.timed or given is not None:
            return super().colony_errors(names, given)
        return {name: COLONY_ERRORS.get(name, 0.0) for name in names}

    def _too_many_cells(self, areas: Sequence[float]) -> list[str]:
        """Say that colonies are too large to grow hundreds of them, where their areas are known."""
        cells = max(filter(np.isfinite, areas), default=0.0) / (CELL * self.length**2)
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
            found |= {name: getattr(self.numerics, name) for name in ("dt", "spacing", "substeps")}
        return found

    def check(self, largest: Mapping[str, float], hours: Sequence[float]) -> None:
        """Raise `InputError` where steps in space or time are too long for colonies, a diffusivity, or the images."""
        how = self.chosen(Resolution())
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
        if not self.timed and "area" in statistics:
            raise InputError(
                "--statistics: 'area' is what simulated colonies are matched to (--match area), so that it tells "
                "nothing: leave it out, or give --match time"
            )
        check_images(images, self.length, by="--length", alike=not self.timed or of_pixels(statistics))

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
                dt=self.chosen(Resolution()).dt, capacity=most_nodes(latest, self.rules.births.doublings)
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
        chosen, numerics = self.rules.complete(Parameters(**values)), self.numerics
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
        chosen, numerics = self.rules.complete(Parameters(**values)), self.numerics
        until = self.until
        watched = () if self.until_area is None or "area" in statistics else ("area",)
        grown = run_simulation(
            chosen,
            member_keys(seed, members),
            times=sample_times(self.time, self.time if until is not None else self.every_row, numerics),
            until=until,
            model=self.rules,
            numerics=numerics,
            relaxation=HARD if self.hard else Relaxation(),
            observe=self._photographed([*statistics, *watched]) if statistics else None,
            scales=self.scales,
            keep=self.kept,
        )
        if not statistics:
            return grown
        return replace(grown, statistics={k: one for k, one in grown.statistics.items() if k not in watched})

    def keeping(self, folder: Path) -> "Algebraic":
        """The same, keeping colonies that grow in segments."""
        return replace(self, kept=folder)

    def ended_as(self, grown: Grown) -> "Algebraic":
        """The same, growing for the time at which the first colony came to what ended growth."""
        ends = np.atleast_1d(getattr(grown, "ends", self.time))
        return replace(self, time=max(float(ends[0]), self.numerics.dt), until_area=None, until_cells=None)

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
