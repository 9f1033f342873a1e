"""Recipes of synthetic data sets, and the truth that a data set keeps.

A file of recipes is TOML, a table for each data set:

    [name]
    parameters = { mobility = 2.0, aspect_ratio = 0.6 }
    seed = 1
    hours = [4, 8, 12]
    [name.model]                       # where a rule is not the source's (`yeastfit.RULES`)
    budding = { rule = "uniform" }
"""

import re
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.images import MAX_PIXELS, MIN_SIDE
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.numbers import HOURS, PIXEL_SIZES, Range
from yeastfit.seeds import check_seed
from yeastfit.simulation.photograph import KINDS, Optics
from yeastfit.storage import read_json
from yeastfit.text import file_name, quoted, short
from yeastfit.text_files import read_toml

REPLICATES = Range(1, 10_000)
PARTS: dict[str, type] = {"numerics": Numerics, "scales": Scales, "optics": Optics}
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
        InputError: A value is not admissible, or hours do not rise by at least a time step, or have the same first
            decimal.
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
        if len({photograph_name(0, hours) for hours in self.hours}) < len(self.hours):
            raise InputError(f"hours are {quoted(list(self.hours))}, they must differ in their first decimal")
        self._check_steps()
        REPLICATES.read_whole(REPLICATES.check(self.replicates, "replicates"), "replicates")
        side = PIXEL_SIZES.check(self.pixel_size, "pixel_size")
        Range(MIN_SIDE * side, MAX_PIXELS**0.5 * side, f"µm, as pixel_size is {side:g}").check(self.extent, "extent")
        if self.kind not in KINDS:
            raise InputError(f"kind is {quoted(self.kind)}, it must be one of {', '.join(KINDS)}")

    def check(self) -> None:
        """Raise `InputError` for parameters that cannot be simulated, before anything grows."""
        check_alpha(self.truth().diffusivity, self.numerics)

    def _check_steps(self) -> None:
        """Raise `InputError` where two photographs, or the beginning and the first, are less than a time step apart."""
        times = [self.scales.time(hours) for hours in self.hours]
        try:
            self.numerics.check_steps(times[-1])
        except InputError as error:
            raise InputError(f"hours has {self.hours[-1]:g}, which comes too late: {error}") from None
        steps = [0, *map(self.numerics.step_of, times)]
        if any(later <= earlier for earlier, later in pairwise(steps)):
            step = self.scales.hours(self.numerics.dt)
            raise InputError(
                f"hours are {quoted(list(self.hours))}, they must lie at least a time step from 0 and from each other, "
                f"{step:.3g} hours with numerics.dt = {self.numerics.dt:g}"
            )

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
    values = dict[str, float]()
    for name in names:
        if name not in found:
            raise InputError(f"{path}: {name} is missing, need a finite number")
        values[name] = Range().check(found[name], f"{path}: {name}")
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
        if len(alike) > 1:
            both = " and ".join(map(quoted, alike[:2]))
            raise InputError(f"{path}: data sets are called {both}, which are one folder on many systems: rename one")
        if file_name(name) != name or RESERVED_NAMES.fullmatch(name) or len(name) > LONGEST_NAME:
            raise InputError(f"{path}: a data set is called {quoted(name)}, need a name that its folder can have")
    return {name: _recipe(table, f"{path}, [{short(name)}]") for name, table in tables.items()}


def _recipe(table: Any, where: str) -> Recipe:
    known = {each.name for each in fields(Recipe)}
    if not isinstance(table, dict):
        raise InputError(f"{where}: is {quoted(table)}, need a table with parameters, seed and hours")
    if unknown := sorted(set(table) - known):
        raise InputError(f"{where}: {quoted(unknown[0])} is unknown, expected some of {', '.join(sorted(known))}")
    if missing := [name for name in ("parameters", "seed", "hours") if name not in table]:
        raise InputError(f"{where}: {missing[0]} is missing, need parameters, seed and hours")
    try:
        made = {name: _of_table(kind, table[name], name) for name, kind in PARTS.items() if name in table}
        rules = _checked(table.get("model", {}), dict, "model", "a table of rules")
        values = _checked(table["parameters"], dict, "parameters", "a table")
        values = {name: Range().check(value, f"parameters: {short(name)}") for name, value in values.items()}
        hours = tuple(_checked(table["hours"], list, "hours", "a list of numbers"))
        model = Model.of(rules)
        model.check_brought(values)
        model.parameters.check(values)
        recipe = Recipe(**{**table, **made, "model": model, "parameters": values, "hours": hours})
        recipe.check()
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


def photograph_name(member: int, hours: float) -> str:
    """Name of a photograph without its suffix; hours have one decimal."""
    return f"colony{member + 1:02d}_{hours:04.1f}h"
