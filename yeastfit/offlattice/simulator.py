"""Colonies of the off-lattice model as a forward model that fits and samplers can ask: one colony a row, measured.

A colony of N cells grows; a mask of its first n ≤ N is drawn and measured. n is chosen so that the mask has a given
area: colonies are compared at one size, or each at one of several, drawn by its seed.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from inspect import signature
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Shaped

from yeastfit.errors import InputError
from yeastfit.kinds import check_list
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.observable import Observable
from yeastfit.offlattice.colony import DELAY, MOST_ATTEMPTS, OfflatticeColony, grow, in_threads
from yeastfit.offlattice.masks.area_matching import MaskOf, Match, MatchedMask, search_from_below
from yeastfit.offlattice.masks.ellipse_mask import TooWide
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import DRAWING, GROWING, INFERRED, NUTRIENT_EXPONENT, PARAMETERS, rates_of
from yeastfit.offlattice.statistics.li2024_statistics import ENTRIES
from yeastfit.offlattice.statistics.smoothed_branch_index import SMOOTHED
from yeastfit.offlattice.statistics.smoothed_outline import TEXTURE
from yeastfit.offlattice.status import Status
from yeastfit.parameter_set import ParameterSet
from yeastfit.seeds import Stream, stream_of
from yeastfit.specification import Specification, described, module_outside, path_of, undescribed
from yeastfit.text import listed

OF_BINS = (*ENTRIES, SMOOTHED)
"""What is measured on masks as Li et al. draw them."""
WIDE = "its filaments reach so far that an image of it would be enormous; left out"
CUT = "the frame of Li et al.'s masks cuts the colony off (--masks bins shows all of it)"


@runtime_checkable
class Picture(Protocol):
    """Masks of a colony's first cells, such as `BinnedOutlines` and `Ellipses`."""

    @property
    def pixel_size(self) -> float:
        """µm."""

    def mask(self, cells: int) -> Bool[np.ndarray, "row column"]:
        """The mask of so many."""


class Drawn(NamedTuple):
    """What of a colony is measured.

    Attributes:
        mask: None where there is none.
        pixel_size: µm.
        problem: What the colony ran into, in words; empty for nothing.
    """

    mask: Bool[np.ndarray, "row column"] | None
    pixel_size: float
    problem: str


@dataclass(frozen=True)
class OfflatticeSimulator:
    """Grows one colony for each row and measures it. Made by `of`.

    Attributes:
        parameters: The free ones, with which a colony grows, or is drawn.
        fixed: Values of the others.
        observables: The columns.
        cells: N, of which a colony grows (its area / the largest)^s: see `NUTRIENT_EXPONENT`.
        area: Of the mask that is measured, pixels; of several each colony has one; None for the mask of all cells.
        draw: The pictures of a colony: `BinnedOutlines.whole`, `BinnedOutlines.of` with Li et al.'s frame, or
            `Ellipses.of`, to which those of `DRAWING` are given that are free.
        match: How the area is matched: Li et al.'s `search_from_below` or `match_exactly`.
        delay: See `grow`.
        most_attempts: See `grow`.
        threads: How many colonies grow at a time; None for as many as there are processors to use.
        limits: Least and largest value of each column, to which those beyond are set (`posterior.limits`).
        problems: What colonies ran into, in words. A row is nan where its colony did not grow to the end, or is too
            wide for an image; one whose area was missed is measured all the same.
    """

    parameters: ParameterSet
    fixed: Mapping[str, float]
    observables: tuple[Observable, ...]
    cells: int
    area: float | tuple[float, ...] | None = None
    draw: Callable[..., Picture] = BinnedOutlines.whole
    match: Callable[[MaskOf, int, float], MatchedMask] = search_from_below
    delay: float = DELAY
    most_attempts: int = MOST_ATTEMPTS
    threads: int | None = None
    limits: tuple[tuple[float, float], ...] | None = None
    problems: Counter[str] = field(default_factory=Counter)

    @staticmethod
    def of(
        statistics: Sequence[str],
        *,
        cells: int,
        area: float | Sequence[float] | None = None,
        free: Sequence[str] = PARAMETERS.names,
        fixed: Mapping[str, float] | None = None,
        draw: Callable[..., Picture] = BinnedOutlines.whole,
        match: Callable[[MaskOf, int, float], MatchedMask] = search_from_below,
        delay: float = DELAY,
        most_attempts: int = MOST_ATTEMPTS,
        threads: int | None = None,
        limits: Sequence[tuple[float, float]] | None = None,
    ) -> "OfflatticeSimulator":
        """Colonies of N cells that are compared at one area, or at several.

        Arguments:
            statistics: Names: those of `li2024_statistics.ENTRIES`, and all that `measure` has for masks.
            cells: N.
            area: See the attributes, as all below.
            free: Names of the free parameters.
            fixed: Values of others, by name; the default of those that are not named.
            draw: See above.
            match: See above.
            delay: See above.
            most_attempts: See above.
            threads: See above.
            limits: See above.

        Raises:
            InputError: A statistic or parameter is unknown, a value not admissible, one of drawing free that `draw`
                does not take, or one of several areas given for a single one.
        """
        check_list("statistics", statistics)
        if limits is not None and len(limits) != len(statistics):
            raise InputError(f"limits are {len(limits)} pairs, each of the {len(statistics)} statistics needs one")
        if unknown := [name for name in statistics if name not in known_statistics()]:
            raise InputError(f"statistics: got {unknown[0]!r}, need some of {listed(list(known_statistics()))}")
        if not statistics:
            raise InputError("statistics: got none, need at least one")
        if isinstance(area, Sequence) and not area:
            raise InputError("area: got none, need at least one, or None for whole colonies")
        chosen = INFERRED.subset(free)
        if untaken := [name for name in DRAWING if name in chosen and name not in signature(draw).parameters]:
            raise InputError(f"free names {untaken[0]!r}, which is that of ellipses, and draw is {_name_of(draw)}")
        given = dict(fixed or {})
        GROWING.check(given)
        if NUTRIENT_EXPONENT.name in {*chosen, *given} and not isinstance(area, Sequence):
            raise InputError(f"{NUTRIENT_EXPONENT.name} is given, which is for several areas, and area is {area}")
        if twice := [name for name in given if name in chosen]:
            raise InputError(f"parameter {twice[0]!r} is free, it cannot have the fixed value {given[twice[0]]:g}")
        held = {name: value for name, value in (PARAMETERS.defaults | given).items() if name not in chosen}
        return OfflatticeSimulator(
            parameters=chosen,
            fixed=held,
            observables=tuple(map(Observable, statistics)),
            cells=cells,
            area=tuple(area) if isinstance(area, Sequence) else area,
            draw=draw,
            match=match,
            delay=delay,
            most_attempts=most_attempts,
            threads=threads,
            limits=None if limits is None else tuple((low, high) for low, high in limits),
        )

    def __call__(
        self, values: Float[np.ndarray, "row parameter"], seeds: Shaped[np.ndarray, " row"]
    ) -> Float[np.ndarray, "row statistic"]:
        """Statistics, one row a colony; nan throughout where it did not grow to the end. Equal rows grow once."""
        if np.shape(values) != (len(seeds), len(self.parameters)):
            shape = f"({len(seeds)}, {len(self.parameters)}), a row for each seed"
            raise InputError(f"values have the shape {np.shape(values)}, it must be {shape}")
        jobs = [(tuple(row), seed) for row, seed in zip(values.tolist(), np.asarray(seeds).tolist(), strict=True)]
        different = list(dict.fromkeys(jobs))
        found = dict(zip(different, in_threads(self._measured, different, self.threads), strict=True))
        self.problems.update(problem for _, problem in found.values() if problem)
        return np.array([found[job][0] for job in jobs]).reshape(len(jobs), len(self.observables))

    @property
    def about(self) -> str:
        """What decides over a colony, beside its free parameters and its seed."""
        told = {**self.fixed, **{name: getattr(self, name) for name in ("cells", "area", "delay", "most_attempts")}}
        told |= {name: _name_of(getattr(self, name)) for name in ("draw", "match")}
        return ", ".join(["offlattice", *(f"{name} {value}" for name, value in told.items()), f"limits {self.limits}"])

    @property
    def specification(self) -> Specification:
        """How other processes make the same simulator, on one thread.

        Raises:
            InputError: Masks are drawn or matched by a function that others cannot import.
        """
        arguments = {
            "observables": [(one.statistic, one.time) for one in self.observables],
            "cells": self.cells,
            "area": self.area,
            "free": self.parameters.names,
            "fixed": dict(self.fixed),
            "draw": described(self.draw),
            "match": described(self.match),
            "delay": self.delay,
            "most_attempts": self.most_attempts,
            "limits": self.limits,
        }
        registered = [STATISTICS[one.statistic] for one in self.observables if one.statistic in STATISTICS]
        imports = dict.fromkeys(module for one in registered if one.mask for module in module_outside(one.mask))
        return Specification(path_of(offlattice_simulator_of), arguments, tuple(imports))

    def colony(self, values: Sequence[float], seed: int) -> OfflatticeColony:
        """The colony of one row.

        Arguments:
            values: Free parameters.
            seed: Of the row.

        Returns:
            All its cells.
        """
        given = self._of_all(values)
        rates = rates_of({name: value for name, value in given.items() if name in PARAMETERS})
        cells = self.cells_of(values, seed)
        return grow(rates, cells=cells, seed=seed, delay=self.delay, most_attempts=self.most_attempts)

    def covered(
        self, values: Float[np.ndarray, "row parameter"], seeds: Shaped[np.ndarray, " row"]
    ) -> Float[np.ndarray, " row"]:
        """Area that all cells of a colony cover.

        Arguments:
            values: Free parameters, one colony a row.
            seeds: Of the rows.

        Returns:
            Areas in µm²; nan where a colony did not grow to the end, or is too wide for an image.
        """
        whole = replace(self, area=None)

        def one(job: tuple[list[float], int]) -> float:
            drawn = whole.drawn(*job)
            return np.nan if drawn.mask is None else np.count_nonzero(drawn.mask) * drawn.pixel_size**2

        jobs = [(row, int(seed)) for row, seed in zip(values.tolist(), seeds, strict=True)]
        return np.array(in_threads(one, jobs, self.threads))

    def area_of(self, seed: int) -> float | None:
        """At which the colony of a seed is compared, in pixels."""
        if not isinstance(self.area, tuple):
            return self.area
        return self.area[np.random.default_rng(stream_of(seed, Stream.AREAS, 0)).integers(len(self.area))]

    def cells_of(self, values: Sequence[float], seed: int) -> int:
        """How many cells the colony of one row grows.

        Arguments:
            values: Free parameters.
            seed: Of the row, which decides over its area.

        Returns:
            N (its area / the largest)^s.
        """
        exponent = self._of_all(values).get(NUTRIENT_EXPONENT.name, 0.0)
        area = self.area_of(seed) if exponent else None
        if area is None or not isinstance(self.area, tuple):
            return self.cells
        return max(1, round(self.cells * (area / max(self.area)) ** exponent))

    def drawn(self, values: Sequence[float], seed: int) -> Drawn:
        """What of the colony of one row is measured.

        Arguments:
            values: Free parameters.
            seed: Of the row, which decides over its area, too, where there are several.

        Returns:
            Its mask, or why there is none.
        """
        colony = self.colony(values, seed)
        if colony.status is not Status.GROWN:
            return Drawn(None, np.nan, f"{colony.status.value}; left out")
        given = dict(zip(self.parameters.names, values, strict=True))
        try:
            picture = self.draw(colony, **{name: value for name, value in given.items() if name in DRAWING})
        except TooWide:
            return Drawn(None, np.nan, WIDE)
        if (area := self.area_of(seed)) is None:
            mask, problem = picture.mask(colony.x.size), ""
        else:
            matched = self.match(picture.mask, colony.x.size, area)
            mask, problem = matched.mask, "" if matched.match is Match.MATCHED else matched.match.value
        cut = mask[[0, -1]].any() or mask[:, [0, -1]].any()
        return Drawn(mask, picture.pixel_size, problem or (CUT if cut else ""))

    def _of_all(self, values: Sequence[float]) -> dict[str, float]:
        """Free and held parameters, by name."""
        return {**self.fixed, **dict(zip(self.parameters.names, values, strict=True))}

    def _measured(self, job: tuple[tuple[float, ...], int]) -> tuple[list[float], str]:
        """One row, and what the colony ran into; empty where it was nothing."""
        drawn = self.drawn(*job)
        if drawn.mask is None:
            return [np.nan] * len(self.observables), drawn.problem
        found = statistics_of(drawn.mask, drawn.pixel_size, [one.statistic for one in self.observables])
        row = np.array([found[one.statistic] for one in self.observables])
        return (row if self.limits is None else np.clip(row, *np.transpose(self.limits))).tolist(), drawn.problem


def offlattice_simulator_of(
    *,
    observables: Sequence[tuple[str, float]],
    draw: Mapping[str, Any],
    match: Mapping[str, Any],
    **settings: Any,
) -> OfflatticeSimulator:
    """The simulator of an `OfflatticeSimulator.specification`, whose arguments are plain data."""
    columns = tuple(Observable(*one) for one in observables)
    functions = {"draw": undescribed(draw), "match": undescribed(match)}
    names = tuple(one.statistic for one in columns)
    return replace(OfflatticeSimulator.of(names, threads=1, **functions, **settings), observables=columns)


def _name_of(function: Any) -> str:
    """Of a function, or of a partial one with its arguments."""
    if isinstance(function, partial):
        return " ".join([_name_of(function.func), *(f"{name} {value}" for name, value in function.keywords.items())])
    return str(getattr(function, "__qualname__", type(function).__name__))


def known_statistics() -> dict[str, Statistic]:
    """Statistics of masks by name: Li et al.'s, those of smoothed outlines, and those of the registry."""
    return {entry.name: entry for entry in (*OF_BINS, *TEXTURE, *STATISTICS.values()) if entry.mask}


def statistics_of(mask: Bool[np.ndarray, "row column"], pixel_size: float, names: Sequence[str]) -> dict[str, float]:
    """Some of `known_statistics` of a mask, by name, in µm where `pixel_size` is."""
    pixels, entries = Pixels.of(mask), known_statistics()
    return {name: entries[name].mask(pixels) * pixel_size ** entries[name].unit_power for name in names}  # type: ignore[misc]
