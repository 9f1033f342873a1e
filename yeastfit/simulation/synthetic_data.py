"""Synthetic data sets: hard-model colonies, photographed, with the truth kept beside them.

A data set is made from a `Recipe` alone:

    manifest.csv            what a fit reads (`yeastfit.read_dataset`)
    images/                 the photographs
    truth/parameters.json   parameters by name, and the recipe; a fit never opens this folder
    truth/masks/            what segmentation should find
    truth/curves.csv        statistics of every true mask in µm, and what only the model knows

A file of recipes is TOML, a table for each data set:

    [name]
    parameters = { mobility = 2.0, aspect_ratio = 0.6 }
    seed = 1
    hours = [4, 8, 12]
    [name.model]                       # where a rule is not the source's (`yeastfit.RULES`)
    budding = { rule = "uniform" }
"""

import shutil
import tomllib
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from yeastfit.errors import InputError
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.smooth_statistics import node_statistics
from yeastfit.model.cells import Cells
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD
from yeastfit.model.simulate import Snapshot
from yeastfit.progress import Progress, silent
from yeastfit.seeds import check_seed, photograph_stream
from yeastfit.simulation.cell_coverage import coverage, true_mask
from yeastfit.simulation.photograph import Optics, photograph, write_micrograph
from yeastfit.simulation.simulate import member_keys, simulate
from yeastfit.storage import read_json, versions, write_json, write_table

OF_MASKS = ("area", "perimeter", "outer_perimeter", "compactness", "outer_compactness", "radius", "max_radius")
OF_NODES = ("growth_rate", "cell_count", "mean_radius")  # with `OF_MASKS` the columns of truth/curves.csv, which stay


@dataclass(frozen=True)
class Recipe:
    """Everything a synthetic data set is made from.

    Attributes:
        parameters: By name; the default of the others.
        seed: Of colonies and photographs.
        hours: When each colony is photographed.
        replicates: Number of colonies.
        pixel_size: In µm.
        extent: Side of a photograph in µm.
        kind: Of image file, see `write_micrograph`.
        numerics: Grid, time step and capacity.
        scales: Units of the model.
        optics: Of the microscope.
        model: Rules of the colonies.
    """

    parameters: dict[str, float]
    seed: int
    hours: tuple[float, ...]
    replicates: int = 10
    pixel_size: float = 0.75
    extent: float = 120.0
    kind: str = "tiff"
    numerics: Numerics = field(default_factory=lambda: Numerics(domain=24.0, spacing=0.1, dt=0.005, capacity=256))
    scales: Scales = field(default_factory=Scales)
    optics: Optics = field(default_factory=Optics)
    model: Model = field(default_factory=Model)

    def truth(self) -> Parameters:
        """Values of all parameters of the model.

        Raises:
            InputError: A name or value is not admissible.
        """
        return self.model.complete(Parameters(**self.parameters))

    def asdict(self) -> dict[str, Any]:
        """Plain data; rules are named where they are not the source's."""
        plain = {name: value for name, value in asdict(self).items() if name != "model"}
        rules = self.model.asdict()
        return plain if rules == Model().asdict() else {**plain, "model": rules}


def read_truth(source: str | Path) -> dict[str, float] | None:
    """Read the parameters that a synthetic data set was made with.

    Arguments:
        source: The data set, or a file in its folder.

    Returns:
        Parameters by name; None where the data set has no truth/parameters.json.
    """
    source = Path(source)
    path = (source.parent if source.is_file() else source) / "truth" / "parameters.json"
    return {name: read_json(path)[name] for name in PARAMETERS} if path.is_file() else None


def read_recipes(path: str | Path) -> dict[str, Recipe]:
    """Read recipes by name from a TOML file: one table each, with the fields of `Recipe`.

    Raises:
        InputError: It is no such file, or a table has other fields, unknown rules or inadmissible values.
    """
    path = Path(path)
    try:
        tables = tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: not a TOML file of recipes ({error})") from None
    return {name: _recipe(table, f"{path}, [{name}]") for name, table in tables.items()}


def _recipe(table: Any, where: str) -> Recipe:
    known = {each.name for each in fields(Recipe)}
    if not isinstance(table, dict) or set(table) - known or {"parameters", "seed", "hours"} - set(table):
        raise InputError(f"{where}: expected parameters, seed and hours, and at most {', '.join(sorted(known))}")
    kinds = {"numerics": Numerics, "scales": Scales, "optics": Optics}
    try:
        nested: dict[str, Any] = {key: kind(**table[key]) for key, kind in kinds.items() if key in table}
        nested["model"] = Model.of(table.get("model", {}))
        values = {name: float(value) for name, value in table["parameters"].items()}
        hours = tuple(float(hour) for hour in table["hours"])
        recipe = Recipe(**{**table, **nested, "parameters": values, "seed": check_seed(table["seed"]), "hours": hours})
        recipe.truth()
        return recipe
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{where}: {error}") from None


class _CellRecorder(eqx.Module):
    """Keeps the ellipses of every sampled step, to be photographed at any resolution."""

    def __call__(self, snapshot: Snapshot) -> tuple[Cells, dict[str, Array]]:
        return snapshot.cells, node_statistics(snapshot, OF_NODES)

    def finish(self, observed: tuple[Cells, dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        cells, nodes = observed
        return {**nodes, **{f"cells/{each.name}": getattr(cells, each.name) for each in fields(cells)}}


def synthesize(recipe: Recipe, folder: str | Path, progress: Progress = silent) -> None:
    """Make a data set. The same recipe gives the same bytes.

    Arguments:
        recipe: What it is made from.
        folder: Where; replaced as a whole.
        progress: Told how many photographs were taken.

    Raises:
        InputError: The recipe's parameters are not admissible, a colony reaches the edge of its photograph, or the
            model ran into a problem, such as a colony that outgrew its capacity.
    """
    folder = Path(folder)
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
        raise InputError(f"recipe for {folder.name}: {run.warnings()[0]}")
    partial = folder.with_name(f".{folder.name}-partial")
    shutil.rmtree(partial, ignore_errors=True)
    rows, curves = [], []
    total = recipe.replicates * len(recipe.hours)
    for member in range(recipe.replicates):
        for k, hours in enumerate(recipe.hours):
            name = f"colony{member + 1:02d}_{hours:04.1f}h"
            shape = _photograph(recipe, run.statistics, member, k, partial, name)
            units = {key: recipe.scales.length ** STATISTICS[key].unit_power for key in OF_NODES}
            nodes = {key: float(run.statistics[key][member, k]) * unit for key, unit in units.items()}
            curves.append({"replicate": member + 1, "hours": hours, **shape, **nodes})
            file = f"images/{name}.tif"
            rows.append({"file": file, "replicate": member + 1, "hours": hours, "um_per_pixel": recipe.pixel_size})
            progress(f"photographed {len(rows)} of {total}", len(rows) / total)
    write_table(partial / "truth" / "curves.csv", curves)
    truth = {**recipe.truth().asdict(), "recipe": recipe.asdict(), "versions": versions()}
    write_json(partial / "truth" / "parameters.json", truth)
    write_table(partial / "manifest.csv", rows)
    shutil.rmtree(folder, ignore_errors=True)
    partial.rename(folder)


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


def write_mask(path: Path, mask: np.ndarray, pixel_size: float | None = None) -> None:
    """A mask as a one-bit PNG, colony white, with its resolution where µm per pixel are given."""
    from PIL import Image

    density: dict[str, Any] = {} if pixel_size is None else {"dpi": (25_400 / pixel_size, 25_400 / pixel_size)}
    Image.fromarray(mask).save(path, optimize=True, **density)
