"""Synthetic data sets: hard-model colonies, photographed, with the truth kept beside them.

A data set is made from a `Recipe` alone:

    manifest.csv            what a fit reads (`yeastfit.read_dataset`)
    images/                 the photographs
    truth/parameters.json   parameters by name, and the recipe; a fit never opens this folder
    truth/masks/            what segmentation should find
    truth/curves.csv        statistics of every true mask in µm, and what only the model knows
    manifest.json           how it was made, and the SHA-256 of all these files
"""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Array

from yeastfit.errors import InputError
from yeastfit.measure.reading.outline_files import write_mask
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.smooth_statistics import node_statistics
from yeastfit.model.cells import Cells
from yeastfit.model.relaxation import HARD
from yeastfit.model.snapshot import Snapshot
from yeastfit.progress import Progress, silent
from yeastfit.results.folder import results_folder
from yeastfit.seeds import photograph_stream
from yeastfit.simulation.cell_coverage import coverage, true_mask
from yeastfit.simulation.photograph import photograph, write_micrograph
from yeastfit.simulation.recipe import BESIDE, Recipe, photograph_name
from yeastfit.simulation.simulate import member_keys, simulate
from yeastfit.storage import versions, write_json, write_table

OF_MASKS = ("area", "perimeter", "outer_perimeter", "compactness", "outer_compactness", "radius", "max_radius")
OF_NODES = ("growth_rate", "cell_count", "mean_radius")  # with `OF_MASKS` the columns of truth/curves.csv, which stay


class _CellRecorder(eqx.Module):
    """Keeps the ellipses of every sampled step, to be photographed at any resolution."""

    def __call__(self, snapshot: Snapshot) -> tuple[Cells, dict[str, Array]]:
        return snapshot.cells, node_statistics(snapshot, OF_NODES)

    def finish(self, observed: tuple[Cells, dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        cells, nodes = observed
        kept = {each.name: getattr(cells, each.name) for each in fields(cells)}
        return {**nodes, **{f"cells/{name}": values for name, values in kept.items() if values is not None}}


def synthesize(
    recipe: Recipe,
    folder: str | Path,
    progress: Progress = silent,
    *,
    inputs: Sequence[Path] = (),
    overwrite: bool = False,
) -> None:
    """Make a data set. The same recipe gives the same bytes.

    Arguments:
        recipe: What it is made from.
        folder: Where; a data set that is there is replaced once the new one is ready.
        progress: Told how many photographs were taken.
        inputs: Files that the recipe is from, for the manifest.
        overwrite: Whether results of another command may be replaced, and results that were changed since.

    Raises:
        InputError: The folder holds something else, the recipe's parameters are not admissible, a colony reaches the
            edge of its photograph, or the model ran into a problem, such as a colony that outgrew its capacity.
    """
    with results_folder(folder, "synthesize", reads=inputs, overwrite=overwrite) as results:
        _make(recipe, results.partial, results.path.name, progress)
        results.finish(seed=recipe.seed, inputs=inputs)


def _make(recipe: Recipe, folder: Path, name: str, progress: Progress) -> None:
    """Grow the colonies and write everything but manifest.json."""
    times = [recipe.scales.time(hours) for hours in recipe.hours]
    run = simulate(
        recipe.truth(),
        member_keys(recipe.seed, recipe.replicates),
        times=times,
        model=recipe.model,
        numerics=recipe.numerics,
        relaxation=HARD,
        observe=_CellRecorder(),
        scales=recipe.scales,
    )
    if run.problems:
        raise InputError(f"recipe for {name}: {run.warnings()[0]}")
    rows, curves = [], []
    total = recipe.replicates * len(recipe.hours)
    for member in range(recipe.replicates):
        for k, hours in enumerate(recipe.hours):
            photo = photograph_name(member, hours)
            shape = _photograph(recipe, run.statistics, member, k, folder, photo)
            units = {key: recipe.scales.length ** STATISTICS[key].unit_power for key in OF_NODES}
            nodes = {key: float(run.statistics[key][member, k]) * unit for key, unit in units.items()}
            curves.append({"replicate": member + 1, "hours": hours, **shape, **nodes})
            file = f"images/{photo}.tif"
            rows.append({"file": file, "replicate": member + 1, "hours": hours, "um_per_pixel": recipe.pixel_size})
            progress(f"photographed {len(rows)} of {total}", len(rows) / total)
    write_table(folder / "truth" / "curves.csv", curves)
    truth = {**recipe.truth().asdict(), **dict(zip(BESIDE, (recipe.asdict(), versions()), strict=True))}
    write_json(folder / "truth" / "parameters.json", truth)
    write_table(folder / "manifest.csv", rows)


def _photograph(
    recipe: Recipe, statistics: dict[str, np.ndarray], member: int, k: int, folder: Path, name: str
) -> dict[str, float]:
    """One photograph and its true mask on disk, and the mask's statistics."""
    cells = {key.partition("/")[2]: values[member, k] for key, values in statistics.items() if key.startswith("cells/")}
    kept = cells["weights"] > 0
    length = recipe.scales.length
    fraction, thickness = coverage(
        length * cells["centres"][kept],
        cells["directions"][kept],
        length * cells["half_lengths"][kept],
        length * cells["half_widths"][kept],
        recipe.extent,
        recipe.pixel_size,
        exponents=cells["exponents"][kept] if "exponents" in cells else None,
    )
    mask = true_mask(fraction)
    if mask[[0, -1]].any() or mask[:, [0, -1]].any():
        raise InputError(
            f"extent is {recipe.extent:g} µm, colony {member + 1} reaches the edge at {recipe.hours[k]:g} h"
        )
    rng = photograph_stream(recipe.seed, member, k)
    pixels = photograph(fraction, thickness, recipe.pixel_size, rng, recipe.optics)
    for part in ("images", "truth/masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    write_micrograph(folder / "images" / f"{name}.tif", pixels, recipe.pixel_size, recipe.kind)
    write_mask(folder / "truth" / "masks" / f"{name}.png", mask)
    return dict(measure_mask(mask, recipe.pixel_size, OF_MASKS))
