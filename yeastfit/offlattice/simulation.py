"""Colonies of the off-lattice model as they grow: measured and drawn after every so many cells, the model's clock.

The first n cells are measured twice: as ellipses on the pixels of a photograph for the statistics of `measure`, and as
Li et al. draw them for theirs, whose names begin with li2024_.
"""

import time as clock
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from yeastfit.errors import InputError, SimulationError
from yeastfit.kinds import check_list
from yeastfit.measure.statistics.registry import recorded
from yeastfit.memory import check_count
from yeastfit.numbers import AT_LEAST_ONE, Range
from yeastfit.offlattice.colony import BYTES_PER_CELL, DELAY, OfflatticeColony, grow, in_threads
from yeastfit.offlattice.masks.ellipse_mask import PIXEL, Ellipses, TooWide
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import DRAWING, DRAWN, PARAMETERS, Rates
from yeastfit.offlattice.simulator import OF_BINS, Picture, known_statistics, statistics_of
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.offlattice.status import Status
from yeastfit.panel import Panel
from yeastfit.seeds import check_seeds
from yeastfit.storage import as_json, from_json, reads_saved, written_whole
from yeastfit.text import listed

SHARE = "pseudohyphal_share"
THEIRS = {entry.name for entry in OF_BINS}
"""What is measured on masks as Li et al. draw them."""

COLUMNS = ("x", "y", "direction", "pseudohyphal", "mother", "can_bud")
NUMBERS = ("cells", "sated", "attempts", "sated_attempts", "numbers_drawn")


@dataclass(frozen=True, eq=False)
class OfflatticeSimulation:
    """Result of `simulate_offlattice`. Lengths are in µm.

    Attributes:
        cells: n of the samples.
        statistics: Of the first n cells, by name; nan where a colony has fewer.
        colonies: All members.
        parameters: The five values, and the width of gaps that are closed, by name.
        seconds: What it took, compiling included.
    """

    cells: Int[np.ndarray, " sample"]
    statistics: dict[str, Float[np.ndarray, "member sample"]]
    colonies: tuple[OfflatticeColony, ...]
    parameters: dict[str, float]
    seconds: float

    @property
    def clock(self) -> Float[np.ndarray, " sample"]:
        """Numbers of cells."""
        return self.cells.astype(float)

    @property
    def clock_label(self) -> str:
        """What `clock` counts."""
        return "cells"

    @property
    def length_unit(self) -> str:
        """Of the statistics."""
        return "µm"

    @property
    def drawing(self) -> dict[str, float]:
        """Parameters with which colonies are drawn as ellipses; defaults of those that a file does not have."""
        return {name: self.parameters.get(name, one.default) for name, one in DRAWING.items()}

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per member and sample."""
        return [
            {"member": member, "cells": cells, **{name: float(one[member, k]) for name, one in self.statistics.items()}}
            for member in range(len(self.colonies))
            for k, cells in enumerate(self.cells.tolist())
        ]

    def masks(self) -> tuple[list[Bool[np.ndarray, "row column"]], float]:
        """All cells of each colony as a camera would see them, and µm per pixel."""
        return [_ellipses(colony, **self.drawing).mask(colony.x.size) for colony in self.colonies], PIXEL

    def panels(self, member: int = 0, cells: int | None = None) -> list[Panel]:
        """Cells of one colony by form, and the outline that is measured.

        Arguments:
            member: Which colony of the ensemble.
            cells: How many of its cells, the first ones; by default all.

        Returns:
            Two panels.
        """
        colony = self.colonies[member]
        count = colony.x.size if cells is None else cells
        seen = _ellipses(colony, gap=0.0).first
        forms = np.append(1 + colony.pseudohyphal, 0).astype(int)[np.where(seen <= count, seen, 0) - 1]
        mask, share = _ellipses(colony, **self.drawing).mask(count), colony.pseudohyphal[:count].mean()
        left = "" if cells is None else f", {1 - count / colony.cells:.0%} of the nutrient left"
        title = f"{count} cells, {share:.1%} of them pseudohyphal"
        return [
            Panel(title, forms[::-1].T, 0.5 * PIXEL * len(forms), kinds=("nothing", "sated", "pseudohyphal")),
            Panel(f"as a camera sees it{left}", mask[::-1].T, 0.5 * PIXEL * len(mask), kinds=("nothing", "colony")),
        ]

    def warnings(self) -> list[str]:
        """Colonies that did not grow to the end, in words."""
        counts = Counter(each.message for each in self.colonies if each.status is not Status.GROWN)
        return [f"{count} of {len(self.colonies)} colonies: {message}" for message, count in counts.items()]

    def sentence(self) -> str:
        """What has been grown, in words."""
        count, share = len(self.colonies), np.mean([each.pseudohyphal.mean() for each in self.colonies])
        grown = "1 colony" if count == 1 else f"{count} colonies"
        sizes = [each.x.size for each in self.colonies]
        cells = f"{min(sizes)} cells" if min(sizes) == max(sizes) else f"{min(sizes)} to {max(sizes)} cells"
        return f"{grown} of {cells}, {share:.1%} of them pseudohyphal, in {self.seconds:.1f} s"

    def save(self, path: str | Path) -> None:
        """Save as a NumPy archive: curves, cells of all colonies and parameters."""
        arrays: dict[str, Any] = {f"statistics/{name}": values for name, values in self.statistics.items()}
        for member, each in enumerate(self.colonies):
            arrays |= {f"colony {member}/{name}": getattr(each, name) for name in COLUMNS}
        numbers = [{"status": each.status.name, **{n: getattr(each, n) for n in NUMBERS}} for each in self.colonies]
        about = {"parameters": self.parameters, "seconds": self.seconds, "colonies": numbers}
        with written_whole(path) as temporary, temporary.open("wb") as file:  # a file keeps its name as given
            np.savez_compressed(file, cells=self.cells, about=as_json(about), **arrays)

    @staticmethod
    @reads_saved("simulation")
    def load(path: str | Path) -> "OfflatticeSimulation":
        """Read what `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        with Path(path).open("rb") as opened, np.load(opened) as archive:
            arrays = {name: archive[name] for name in archive.files}
        about = from_json(str(arrays["about"]))
        rates = Rates(*(about["parameters"][name] for name in PARAMETERS))
        colonies = tuple(
            OfflatticeColony(
                rates=rates,
                status=Status[numbers.pop("status")],
                **{name: arrays[f"colony {member}/{name}"] for name in COLUMNS},
                **numbers,
            )
            for member, numbers in enumerate(about["colonies"])
        )
        statistics = {name.partition("/")[2]: one for name, one in arrays.items() if name.startswith("statistics/")}
        return OfflatticeSimulation(arrays["cells"], statistics, colonies, about["parameters"], about["seconds"])


def simulate_offlattice(
    parameters: Mapping[str, float],
    seeds: Sequence[int] | Integer[np.ndarray, " member"],
    *,
    cells: int,
    every: int | None = None,
    delay: float = DELAY,
    statistics: Sequence[str] | None = None,
) -> OfflatticeSimulation:
    """Grow a colony for each seed, and measure its first cells.

    Arguments:
        parameters: By name, the rest at their defaults.
        seeds: One a colony, 0 ≤ seed < 2⁶⁴.
        cells: N.
        every: Cells between two samples, the last of which is N; a twentieth of N by default.
        delay: See `grow`.
        statistics: Names of those of `li2024_statistics.ENTRIES`, and all that `measure` has for masks. By default what
            simulations record, and I_F, I_R and I_B. The share of pseudohyphal cells is always recorded.

    Returns:
        All of it; show its `warnings()` to users.

    Raises:
        InputError: A name or value is not admissible, there is no seed, so many cells do not fit into memory, filaments
            reach too far for an image, or numba is missing.
    """
    DRAWN.check(parameters)
    check_count("cells", AT_LEAST_ONE.check_whole(cells, "cells"), BYTES_PER_CELL)
    if not (each := check_seeds(seeds)):
        raise InputError("seeds: there are none, need one for each colony")
    check_list("statistics", [] if statistics is None else statistics)
    entries = known_statistics()
    names = [*(one for one in recorded("mask") if one in entries), *PUBLISHED] if statistics is None else statistics
    if unknown := [name for name in names if name not in entries]:
        raise InputError(f"statistics: got {unknown[0]!r}, need some of {listed(list(entries))}")
    values = DRAWN.defaults | dict(parameters)
    between = max(1, cells // 20) if every is None else Range(1, cells).check_whole(every, "every")
    regular = np.arange(between, cells + 1, between)
    samples = regular if regular[-1] == cells else np.append(regular, cells)

    def one(seed: int) -> tuple[OfflatticeColony, dict[str, np.ndarray]]:
        colony = grow({name: values[name] for name in PARAMETERS}, cells=cells, seed=seed, delay=delay)
        return colony, _measured(colony, samples, names, {name: values[name] for name in DRAWING})

    began = clock.perf_counter()
    grown = in_threads(one, each, None)
    measured = {name: np.stack([found[name] for _, found in grown]) for name in grown[0][1]}
    colonies = tuple(colony for colony, _ in grown)
    return OfflatticeSimulation(samples, measured, colonies, values, clock.perf_counter() - began)


def _ellipses(colony: OfflatticeColony, **drawing: float) -> Ellipses:
    try:
        return Ellipses.of(colony, **drawing)
    except TooWide:
        raise InputError(
            f"cells is {colony.cells}, of which filaments reach too far for an image: give fewer, or a larger "
            "transition"
        ) from None


def _measured(
    colony: OfflatticeColony, samples: Int[np.ndarray, " sample"], names: Sequence[str], drawing: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Statistics of the first cells; nan where there are not as many."""
    if not colony.x.size:
        raise SimulationError(f"a colony of {colony.cells} cells is {colony.message}")
    theirs = [name for name in names if name in THEIRS]
    ours = [name for name in names if name not in theirs]
    pictures: list[tuple[Picture, list[str]]] = []
    if ours:
        pictures.append((_ellipses(colony, **drawing), ours))
    if theirs:
        pictures.append((BinnedOutlines.whole(colony), theirs))
    found = {name: np.full(len(samples), np.nan) for name in (*ours, *theirs, SHARE)}
    for k, cells in enumerate(samples[samples <= colony.x.size].tolist()):
        for picture, chosen in pictures:
            for name, value in statistics_of(picture.mask(cells), picture.pixel_size, chosen).items():
                found[name][k] = value
        found[SHARE][k] = colony.pseudohyphal[:cells].mean()
    return found
