"""The off-lattice model of Li et al. 2024, as commands see it; numba is imported where colonies grow.

It has no time. Colonies are compared in one image each, at one area: N cells grow, and so many of them are drawn as
cover the mean area of the data. Where colonies of the data differ in size, and so in how far their filaments
have grown, each may be drawn at the area of one of them, taken at random (`match` each). Whether smaller ones had less
nutrient is then a parameter, `nutrient_exponent`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.models.forward_model import ForwardModel, Row, Seen
from yeastfit.inference.models.grown import Outlines
from yeastfit.inference.models.image_checks import check_comparable, check_images
from yeastfit.inference.models.last_images import last_images, mean_area, measured
from yeastfit.inference.models.offlattice_drawing import CELL_LENGTH, COMPARABLE, TEXTURE, Drawing, Masks
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.inference.prior.prior import Bounded, Prior
from yeastfit.inference.sensitivity.estimate import sensitivity as estimate_sensitivity
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.simulator import member_seeds
from yeastfit.inference.targets import Targets
from yeastfit.inference.targets_from_table import check_some
from yeastfit.measure.measurements_table import NEEDED, check_same_size, checked_rows
from yeastfit.measure.outlining.outline_errors import COLONY_ERRORS, OUTLINE_ERRORS
from yeastfit.memory import check_count
from yeastfit.numbers import PIXEL_SIZES, Range
from yeastfit.offlattice.parameters import DRAWING, GROWING, INFERRED, NUTRIENT_EXPONENT, PARAMETERS, PRIOR
from yeastfit.panel import Panel
from yeastfit.parameter_set import ParameterSet
from yeastfit.text import listed

if TYPE_CHECKING:
    from yeastfit.offlattice.simulation import OfflatticeSimulation
    from yeastfit.offlattice.simulator import OfflatticeSimulator

THEIRS, SHAPE_AND_TEXTURE = "li2024", "texture"  # names of several statistics
COMPARED = ("fit", "infer", "design")
COVERED_AREAS = Range(40.0, unit="µm²")  # what a cell in yeast form covers
MANY = 300_000  # cells, from where it is not tried whether so many cover an area: that would take minutes
TRIED = 16  # colonies that show whether the cells cover the area of the data
COVERED = 0.75  # share of it that is enough; below 1 a warning counts the colonies that do not cover it
UNEQUAL = 1.5  # times as large as the smallest is the largest colony of data whose areas differ much
ROOM = 1.1  # times as many cells as cover it: Li et al. took as many
Match = Literal["li2024", "exactly", "each", "none"]


@dataclass(frozen=True)
class Offlattice(ForwardModel):
    """Colonies of the off-lattice model, one end image each."""

    free: ClassVar = PARAMETERS.names
    fitted: ClassVar = ("transition", "fork")
    statistics: ClassVar = COMPARABLE
    designed: ClassVar = COMPARABLE
    of_li: ClassVar = (THEIRS,)
    nouns: ClassVar = ("colony", "colonies")
    columns: ClassVar = NEEDED
    units: ClassVar = (
        "Parameters are shares and probabilities. Lengths are in µm, areas in µm²; indices of Li et al. 2024 have no "
        "unit."
    )

    cells: Annotated[
        int, Setting("Number N of cells that grow: the nutrient there is. Li et al. took 45000, 65000 and 90000.")
    ] = 45_000
    every: Annotated[
        int | None,
        Setting("Cells between two rows of the table; by default a twentieth of --cells.", commands=("simulate",)),
    ] = None
    area: Annotated[
        float | None,
        Setting(
            "Area in µm² that the cells drawn cover; by default the mean of the data, without data that of all cells.",
            commands=COMPARED,
        ),
    ] = None
    match: Annotated[
        Match,
        Setting(
            "How many cells are drawn: as Li et al. search for the area, within 5 %; exactly as many as cover it; as "
            "many as cover the area of one of the data's colonies, each drawn at random (each); or all, whatever the "
            "area (none).",
            commands=COMPARED,
        ),
    ] = "li2024"
    areas: Annotated[
        tuple[float, ...],
        Setting(
            "With match each: areas in µm² that colonies have, by default those of the data.",
            commands=("python",),
        ),
    ] = ()
    masks: Annotated[
        Masks | None,
        Setting(
            "How simulated colonies are drawn: as Li et al. do, in a frame that cuts wide ones off (li2024); the same "
            "without the frame (bins); or as ellipses at the photographs' pixel size. By default li2024 for their "
            "three indices, bins for others of theirs, smoothed_branch_index and angular_index, ellipses otherwise.",
            commands=COMPARED,
        ),
    ] = None
    pixel_size: Annotated[
        float | None,
        Setting("µm per pixel of ellipses; by default that of the data, or 1.55.", commands=COMPARED),
    ] = None
    delay: Annotated[
        float,
        Setting("Share of all cells by which pseudohyphal mothers come to be preferred later than the transition."),
    ] = 0.02

    def __post_init__(self) -> None:
        if self.cells < 1:
            raise InputError(f"cells is {self.cells}, it must be at least 1")
        if self.area is not None:
            COVERED_AREAS.read(self.area, "area")
            if self.match == "none":
                raise InputError(f"area is {self.area:g} and match none, which compares whole colonies: leave out one")
            if self.match == "each":
                raise InputError(f"area is {self.area:g} and match each, which takes the data's areas: leave out one")
        for area in self.areas:
            COVERED_AREAS.read(area, "areas")
        if self.areas and self.match != "each":
            raise InputError(f"areas are given and match is {self.match}: they are for match each, leave them out")
        if self.pixel_size is not None:
            PIXEL_SIZES.read(self.pixel_size, "pixel_size")
        for name, value, known in (("match", self.match, Match), ("masks", self.masks, Masks)):
            if value is not None and value not in get_args(known):
                raise InputError(f"{name} is {value!r}, it must be {' or '.join(get_args(known))}")
        Range(0.0, 1.0).read(self.delay, "delay")

    @property
    def timed(self) -> bool:
        """There is no time."""
        return False

    @property
    def parameters(self) -> ParameterSet:
        """The five of growth, how nutrient goes with area, and those of drawing ellipses."""
        return INFERRED

    @property
    def drawing(self) -> Drawing:
        """How colonies are drawn."""
        return Drawing(self.masks, self.pixel_size)

    def acting(self, statistics: Sequence[str]) -> ParameterSet:
        """Those of drawing only where ellipses are drawn, how nutrient goes with area where there are several."""
        drawn = DRAWING.names if self.drawing.kind(statistics) == "ellipses" else ()
        return INFERRED.subset((*(GROWING if self.match == "each" else PARAMETERS).names, *drawn))

    def statistics_named(self, names: Sequence[str]) -> tuple[str, ...]:
        """Those of `measure`, and those of Li et al.

        li2024 stands for the three that Li et al. compare colonies in, texture for the nine of `TEXTURE`.
        """
        from yeastfit.offlattice.simulator import known_statistics
        from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED

        known, several = known_statistics(), {THEIRS: PUBLISHED, SHAPE_AND_TEXTURE: TEXTURE}
        if twice := [name for name in names if list(names).count(name) > 1]:
            raise InputError(f"--statistics: {twice[0]!r} appears twice, expected each once")
        found = tuple(one for name in names for one in several.get(name, (name,)))
        for name in found:
            check_comparable(name)
            if name not in known:
                raise InputError(
                    f"--statistics: {name!r} is unknown, expected {', '.join(several)} or some of "
                    f"{listed(sorted(known))}"
                )
        return tuple(dict.fromkeys(found))

    def simulator(self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]) -> "OfflatticeSimulator":
        """Colonies that are seen as the data are.

        Raises:
            InputError: All cells of most colonies cover less than the area at which they are compared.
        """
        simulator = self._simulator(targets.names, free, fixed)
        self._check_reach(simulator)
        return replace(simulator, observables=targets.observables)

    def fit_simulators(
        self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]
    ) -> tuple["OfflatticeSimulator", "OfflatticeSimulator"]:
        """Twice those of `simulator`, no farther from the data than their limits: rare ones would decide over means."""
        limits, simulator = self.limits(targets), self.simulator(targets, free, fixed)
        if limits is not None:
            simulator = replace(simulator, limits=tuple((low, high) for low, high in limits.tolist()))
        return simulator, simulator

    def seen(self, rows: Sequence[Row], folder: Path, condition: str | None, statistics: Sequence[str]) -> Seen:
        """Statistics of the last image of each colony, with their mean area and pixel size.

        Raises:
            InputError: Pixel sizes differ, or a statistic is neither in the table nor to be had from masks.
        """
        every = checked_rows(rows, condition)
        chosen, notes = last_images(every)
        hours = max(float(row["hours"]) for row in chosen)
        check_same_size(chosen)
        values = [measured(row, folder, (*statistics, "area")) for row in chosen]
        curves = {name: np.array([[value[name]] for value in values]) for name in statistics}
        check_some(curves, len(chosen))
        targets = Targets.from_replicates(curves, [hours], colonies=[str(row["replicate"]) for row in chosen])
        areas = [value["area"] for value in values]
        area = mean_area(chosen, areas) if self.area is None else self.area
        pixel = float(np.mean([row["um_per_pixel"] for row in chosen])) if self.pixel_size is None else self.pixel_size
        notes += self.drawing.unused(statistics)
        if area not in COVERED_AREAS:
            raise InputError(
                f"{chosen[0]['file']}: colonies cover {area:.3g} µm² in the mean, which must be {COVERED_AREAS}, as a "
                f"cell does: is um_per_pixel {pixel:g}?"
            )
        seen = replace(self, pixel_size=pixel)
        if self.match == "each":
            seen = replace(seen, areas=self.areas or tuple(areas))
        elif self.match != "none":
            seen = replace(seen, area=area)
            notes += self._unequal(areas)
        return Seen(seen, replace(targets, time_label="hours", length_unit="µm"), tuple(notes))

    def _unequal(self, areas: Sequence[float]) -> list[str]:
        """What is to be said of colonies that differ much in area."""
        smallest, largest = min(areas), max(areas)
        if self.area is not None or largest < UNEQUAL * smallest:
            return []
        return [
            f"colonies cover {smallest:.3g} to {largest:.3g} µm², and simulated ones are all drawn at their mean: "
            "with --match each they are drawn at the areas of these"
        ]

    def check(self, largest: Mapping[str, float], hours: Sequence[float]) -> None:
        """Raise `InputError` where so many cells are no colony, or more than memory holds."""
        from yeastfit.offlattice.colony import BYTES_PER_CELL

        check_count("cells", self.cells, BYTES_PER_CELL)
        if self.cells == 1:
            raise InputError("cells is 1, the first cell alone, which has no shape: give more")

    def check_images(self, images: Sequence[Row], statistics: Sequence[str]) -> None:
        """Raise `InputError` where a statistic tells nothing, or pixels are of no size for cells, or of two sizes."""
        self._check_matched(statistics)
        self.drawing.of(statistics)
        check_images(last_images(images)[0], CELL_LENGTH, alike=True)

    def _check_matched(self, statistics: Sequence[str]) -> None:
        """Raise `InputError` where a statistic is the area that colonies are drawn with."""
        if "area" in statistics and self.match != "none":
            raise InputError(
                f"--statistics: 'area' is what simulated colonies are matched to (--match {self.match}), so that it "
                "tells nothing: leave it out, or give --match none"
            )

    def measurement_errors(self, names: Sequence[str], given: float | None) -> dict[str, float]:
        """Those of outlines of photographs, where nothing is given."""
        from yeastfit.offlattice.simulator import known_statistics

        usual = {name: one.measurement_error for name, one in known_statistics().items()} | OUTLINE_ERRORS
        return {name: usual[name] if given is None else given for name in names}

    def colony_errors(self, names: Sequence[str], given: float | None) -> dict[str, float]:
        """Those of outlines of photographs, where nothing is given."""
        return {name: COLONY_ERRORS.get(name, 0.0) if given is None else 0.0 for name in names}

    def prior(self, parameters: ParameterSet, *, bounded: Bounded = "log-uniform") -> Prior:
        """Li et al.'s beta distributions, a uniform one of the exponent; log-uniform ones of what is of drawing."""
        shapes = {**PRIOR, NUTRIENT_EXPONENT.name: (1.0, 1.0)}
        theirs = {name: Distribution("beta", dict(zip("ab", ab, strict=True))) for name, ab in shapes.items()}
        usual = Prior.default(parameters).distributions
        return Prior({name: theirs.get(name, one) for name, one in usual.items()})

    def outlines(
        self, simulator: "OfflatticeSimulator", values: Float[np.ndarray, "row free"], targets: Targets, seed: int
    ) -> Outlines:
        """The masks that are measured, of one colony at each row, as far as it has one."""
        seeds = member_seeds(seed, len(values)).tolist()
        masks = [simulator.drawn(row, one).mask for row, one in zip(values.tolist(), seeds, strict=True)]
        pixel_size = self.drawing.of([one.statistic for one in simulator.observables])[1]
        return [mask for mask in masks if mask is not None], pixel_size

    def sensitivity(self, statistics: Sequence[str], values: Mapping[str, float], **how: Any) -> Sensitivity:
        """By regression along all parameters above 0."""
        if unused := self.drawing.unused(statistics):
            raise InputError(unused[0])
        if self.area is not None:
            self._check_matched(statistics)
        acting, at = self.acting(statistics), self.held(statistics, (), values)
        moved = {name: value for name, value in at.items() if value > 0 and name in acting}
        simulator = self._simulator(statistics, tuple(moved), self.held(statistics, tuple(moved), values))
        return estimate_sensitivity(simulator=simulator, at=moved, **how)

    def grow(
        self, values: Mapping[str, float], members: int, seed: int, statistics: Sequence[str] = ()
    ) -> "OfflatticeSimulation":
        """Colonies, seen after every so many cells."""
        from yeastfit.offlattice.simulation import simulate_offlattice

        seeds, chosen = member_seeds(seed, members), tuple(statistics) or None
        return simulate_offlattice(
            self._of_no_area(values), seeds, cells=self.cells, every=self.every, delay=self.delay, statistics=chosen
        )

    def movie(self, values: Mapping[str, float], seed: int, frames: int) -> Iterator[list[Panel]]:
        """Cells by form, and the outline that is measured, of the first n cells, n up to all of them."""
        from yeastfit.offlattice.simulation import simulate_offlattice

        alone, at = member_seeds(seed, 1), self._of_no_area(values)
        grown = simulate_offlattice(at, alone, cells=self.cells, every=self.cells, delay=self.delay)
        count = grown.colonies[0].x.size
        for cells in np.unique(np.linspace(1, count, frames).round().astype(int)).tolist():
            yield grown.panels(0, cells)

    def _simulator(
        self, statistics: Sequence[str], free: Sequence[str], fixed: Mapping[str, float]
    ) -> "OfflatticeSimulator":
        from yeastfit.offlattice.masks.area_matching import match_exactly, search_from_below
        from yeastfit.offlattice.simulator import OfflatticeSimulator

        self.check({}, ())
        self._check_exponent(free, fixed)
        draw, pixel = self.drawing.of(statistics, free, fixed)
        area: float | tuple[float, ...] | None = None if self.area is None else self.area / pixel**2
        if self.match == "each":
            if not self.areas:
                raise InputError("match is each, which takes the areas of the data, and there are none: give another")
            area = tuple(one / pixel**2 for one in self.areas)
        match = search_from_below if self.match == "li2024" else match_exactly
        return OfflatticeSimulator.of(
            statistics,
            cells=self.cells,
            area=area,
            free=free,
            fixed={name: value for name, value in fixed.items() if name in PARAMETERS or (name in GROWING and value)},
            draw=draw,
            match=match,
            delay=self.delay,
        )

    def _check_exponent(self, free: Sequence[str], fixed: Mapping[str, float]) -> None:
        """Raise `InputError` where it is free, or not 0, and colonies have one area."""
        name = NUTRIENT_EXPONENT.name
        if self.match != "each" and (name in free or fixed.get(name)):
            said = f"--free: {name} is" if name in free else f"{name} is given, which is"
            raise InputError(
                f"{said} for colonies of several areas, and match is {self.match}: leave it out, or give --match each"
            )

    def _of_no_area(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of colonies that are compared with none: without the exponent."""
        self._check_exponent((), values)
        return {name: value for name, value in values.items() if name != NUTRIENT_EXPONENT.name}

    def _check_reach(self, simulator: "OfflatticeSimulator") -> None:
        """Raise `InputError` where the median of some colonies of the prior is far from covering the area."""
        largest = max(self.areas, default=self.area)
        if largest is None:
            return
        values = self.prior(simulator.parameters).sample(TRIED, np.random.default_rng(0))

        def reach(cells: int) -> float:
            """Area that colonies of so many cover, in the median."""
            covered = replace(simulator, cells=cells).covered(values, member_seeds(0, TRIED))
            return float(np.median(covered[np.isfinite(covered)])) if np.isfinite(covered).any() else np.inf

        if (reached := reach(self.cells)) >= COVERED * largest:
            return
        at_most, rounded, now = " at most" if self.areas else "", self.cells, reached
        while now < largest:  # of twice the cells colonies are less than twice as large
            enough = ROOM * rounded * largest / now
            rounded = ceil(enough / (step := 10 ** max(0, floor(log10(enough) - 1)))) * step
            now = reach(rounded) if rounded <= MANY else np.inf
        raise InputError(
            f"--cells is {self.cells}, which cover {reached:.3g} µm² (median of {TRIED} colonies of the prior), and "
            f"colonies are compared at {largest:.3g} µm²{at_most}: give about --cells {rounded}, or --match none to "
            "compare whole colonies of any area"
        )
