"""Synthetic data sets: hard-model colonies, photographed, with the truth kept beside them.

A data set is made from a `Recipe` alone:

    manifest.csv            what a fit reads (`yeastfit.read_dataset`)
    images/                 the photographs
    truth/parameters.json   parameters by name, and the recipe; a fit never opens this folder
    truth/masks/            what segmentation should find
    truth/curves.csv        statistics of every true mask in µm, and what only the model knows
    manifest.json           how it was made, and the SHA-256 of all these files

A file of recipes is TOML, a table for each data set:

    [name]
    parameters = { mobility = 2.0, aspect_ratio = 0.6 }
    seed = 1
    hours = [4, 8, 12]
    [name.model]                       # where a rule is not the source's (`yeastfit.RULES`)
    budding = { rule = "uniform" }
"""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import MAX_PIXELS, MIN_SIDE
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.smooth_statistics import node_statistics
from yeastfit.model.cells import Cells
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD
from yeastfit.model.simulate import Snapshot
from yeastfit.numbers import HOURS, PIXEL_SIZES, Range
from yeastfit.progress import Progress, silent
from yeastfit.results_folder import results_folder
from yeastfit.seeds import check_seed, photograph_stream
from yeastfit.simulation.cell_coverage import coverage, true_mask
from yeastfit.simulation.photograph import KINDS, Optics, photograph, write_micrograph
from yeastfit.simulation.simulate import member_keys, simulate
from yeastfit.storage import read_json, versions, write_json, write_table
from yeastfit.text import file_name, quoted, short
from yeastfit.text_files import read_toml

REPLICATES = Range(1, 10_000)
PARTS: dict[str, type] = {"numerics": Numerics, "scales": Scales, "optics": Optics}
OF_MASKS = ("area", "perimeter", "outer_perimeter", "compactness", "outer_compactness", "radius", "max_radius")
OF_NODES = ("growth_rate", "cell_count", "mean_radius")  # with `OF_MASKS` the columns of truth/curves.csv, which stay
LONGEST_NAME = 100
RESERVED_NAMES = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE | re.DOTALL)

BESIDE = ("recipe", "versions")  # what truth/parameters.json holds besides parameters


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

    Raises:
        InputError: A value is not admissible, or hours do not rise, or have the same first decimal.
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

    def __post_init__(self) -> None:
        check_seed(self.seed)
        if not self.hours:
            raise InputError("hours: there are none, need the times of the photographs")
        for hours in self.hours:
            HOURS.check(hours, "hours")
        if any(later <= earlier for earlier, later in pairwise(self.hours)):
            raise InputError(f"hours are {quoted(list(self.hours))}, they must rise")
        if len({_photograph_name(0, hours) for hours in self.hours}) < len(self.hours):
            raise InputError(f"hours are {quoted(list(self.hours))}, they must differ in their first decimal")
        REPLICATES.read_whole(REPLICATES.check(self.replicates, "replicates"), "replicates")
        side = PIXEL_SIZES.check(self.pixel_size, "pixel_size")
        Range(MIN_SIDE * side, MAX_PIXELS**0.5 * side, "µm").check(self.extent, "extent")
        if self.kind not in KINDS:
            raise InputError(f"kind is {quoted(self.kind)}, it must be one of {', '.join(KINDS)}")

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
    if not path.is_file():
        return None
    try:
        found = read_json(path)
    except (ValueError, RecursionError, OSError) as error:
        raise InputError(f"{path}: cannot be read ({short(error)}), need that of `yeastfit synthesize`") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds {quoted(found)}, need parameters by name")
    names = dict.fromkeys((*PARAMETERS, *(name for name in found if name not in BESIDE)))
    values = {name: Range().check(found.get(name), f"{path}: {name}") for name in names}
    try:
        PARAMETERS.check({name: values[name] for name in PARAMETERS})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return values


def read_recipes(path: str | Path) -> dict[str, Recipe]:
    """Read recipes by name from a TOML file: one table each, with the fields of `Recipe`.

    Raises:
        InputError: It is no such file, or a table has other fields, unknown rules or inadmissible values, or a name
            that no folder can have everywhere.
    """
    tables = read_toml(path)
    if not tables:
        raise InputError(f"{path}: no data set there, need a table [name] for each")
    for name in tables:
        alike = [one for one in tables if one.casefold() == name.casefold()]
        if file_name(name) != name or RESERVED_NAMES.fullmatch(name) or len(name) > LONGEST_NAME or len(alike) > 1:
            raise InputError(f"{path}: a data set is called {quoted(name)}, need a name that its folder can have")
    return {name: _recipe(table, f"{path}, [{short(name)}]") for name, table in tables.items()}


def _recipe(table: Any, where: str) -> Recipe:
    known = {each.name for each in fields(Recipe)}
    if not isinstance(table, dict) or set(table) - known or {"parameters", "seed", "hours"} - set(table):
        raise InputError(f"{where}: expected parameters, seed and hours, and at most {', '.join(sorted(known))}")
    try:
        made = {name: _of_table(kind, table[name], name) for name, kind in PARTS.items() if name in table}
        rules = _checked(table.get("model", {}), dict, "model", "a table of rules")
        values = _checked(table["parameters"], dict, "parameters", "a table")
        values = {name: Range().check(value, f"parameters: {short(name)}") for name, value in values.items()}
        hours = tuple(_checked(table["hours"], list, "hours", "a list of numbers"))
        recipe = Recipe(**{**table, **made, "model": Model.of(rules), "parameters": values, "hours": hours})
        recipe.truth()
        return recipe
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _of_table(kind: type, table: Any, name: str) -> Any:
    """Numerics, scales or optics of a table; ranges are lists in TOML."""
    known = [each.name for each in fields(kind)]
    for key in _checked(table, dict, name, "a table"):
        if key not in known:
            raise InputError(f"{name}: {quoted(key)} is unknown, expected some of {', '.join(known)}")
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in table.items()})


def _checked(value: Any, kind: type, name: str, what: str) -> Any:
    """A value of TOML that must be of a type."""
    if not isinstance(value, kind):
        raise InputError(f"{name} is {quoted(value)}, it must be {what}")
    return value


def _photograph_name(member: int, hours: float) -> str:
    return f"colony{member + 1:02d}_{hours:04.1f}h"


class _CellRecorder(eqx.Module):
    """Keeps the ellipses of every sampled step, to be photographed at any resolution."""

    def __call__(self, snapshot: Snapshot) -> tuple[Cells, dict[str, Array]]:
        return snapshot.cells, node_statistics(snapshot, OF_NODES)

    def finish(self, observed: tuple[Cells, dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        cells, nodes = observed
        return {**nodes, **{f"cells/{each.name}": getattr(cells, each.name) for each in fields(cells)}}


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
            photo = _photograph_name(member, hours)
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
