"""All summary statistics, one entry each, in the order of the tables of `yeastfit measure`.

Everything else asks this registry: tables and pages for units and meanings, plots for titles, simulations for what to
record, fits for what data may hold and how well it is measured. A statistic is added by its entry in one of the files
collected here, or from outside the package by `register_statistic`.
"""

import sys
from collections.abc import Iterable
from typing import Literal

from yeastfit.errors import InputError
from yeastfit.measure.statistics import colonies, filaments, fractal, nodes, shape, spatial_indices
from yeastfit.measure.statistics.statistic import Form, Statistic

Estimator = Literal["smooth", "mask"]
"""How shapes are measured: through a smooth indicator, or on a black-and-white image."""

STATISTICS: dict[str, Statistic] = {}
"""Statistics by name."""

RECORDED = (
    *("compactness", "radius", "mean_radius", "growth_rate", "cell_count", "area", "perimeter"),
    *("outer_perimeter", "outer_compactness"),
)
"""What simulations record where no statistics are named, and registered ones besides; in the order of pictures."""

OTHER_COLUMNS = (
    *("file", "condition", "replicate", "hours", "um_per_pixel", "pixel_size_from", "warnings", "mask"),
    *("member", "time"),
)
"""Columns that tables have beside statistics."""


def register_statistic(statistic: Statistic) -> None:
    """Add a statistic of one's own.

    From then on `measure` has it in its tables and pages, simulations record it, and fits and posteriors may name it
    among their statistics, in this process. Processes that `measure` starts are sent registered statistics too, where
    their functions can be pickled: those at the top level of a module. Otherwise one process measures all images.
    A statistic whose functions are defined anew, as when a notebook's cell is run again, replaces the earlier one.

    Arguments:
        statistic: The entry.

    Raises:
        InputError: The name is taken by another statistic or by a column of the tables.
    """
    name = statistic.name
    if name in STATISTICS and (name in _OWN or _defined(statistic) != _defined(STATISTICS[name])):
        raise InputError(f"statistic {name!r}: there is one of this name ({STATISTICS[name].meaning}), choose another")
    if name in OTHER_COLUMNS:
        raise InputError(f"statistic {name!r}: tables have a column of this name, choose another")
    if _KNOWN.setdefault(name, statistic) is not statistic and (jax := sys.modules.get("jax")) is not None:
        jax.clear_caches()  # compiled programs hold the earlier functions
    _KNOWN[name] = STATISTICS[name] = statistic


def _defined(statistic: Statistic) -> set[tuple[str, str]]:
    """Where a statistic's functions are defined."""
    forms = (form for form in (statistic.smooth, statistic.mask, statistic.nodes) if form)
    return {(form.__module__, form.__qualname__) for form in forms}


_OWN, _KNOWN = frozenset[str](), dict[str, Statistic]()
for _topic in (shape, colonies, fractal, filaments, spatial_indices, nodes):
    for _entry in _topic.ENTRIES:
        register_statistic(_entry)
_OWN = frozenset(STATISTICS)


def register_missing(statistics: Iterable[Statistic]) -> None:
    """Register those that are not there yet: what a process does that another one has started."""
    for statistic in statistics:
        STATISTICS.setdefault(statistic.name, statistic)


def registered() -> tuple[Statistic, ...]:
    """Statistics that were added by `register_statistic`."""
    return tuple(entry for name, entry in STATISTICS.items() if name not in _OWN)


def names_with(*forms: Form) -> tuple[str, ...]:
    """Names of all statistics that have one of these forms."""
    return tuple(name for name, entry in STATISTICS.items() if set(forms) & set(entry.forms))


def names_in_tables() -> tuple[str, ...]:
    """Names of all statistics that a table of measurements may hold: of masks, and what no shape tells."""
    return tuple(name for name, entry in STATISTICS.items() if "mask" in entry.forms or not entry.forms)


def recorded(estimator: Estimator) -> tuple[str, ...]:
    """What simulations record by an estimator where no statistics are named."""
    wanted = (*RECORDED, *(entry.name for entry in registered()))
    return tuple(name for name in wanted if name in names_with(estimator, "nodes"))


def most_telling_first(names: Iterable[str]) -> tuple[str, ...]:
    """Those of the names that are statistics: the recorded ones first, then the others in the order of tables."""
    names = set(names)
    return tuple(name for name in dict.fromkeys((*RECORDED, *STATISTICS)) if name in names)


def known_statistics(estimator: Estimator) -> tuple[str, ...]:
    """What data and simulations can be compared in: statistics of images, and what somebody may have counted."""
    comparable = (name for name in names_with(estimator, "nodes") if STATISTICS[name].comparable)
    return most_telling_first(comparable)


def measurement_errors() -> dict[str, float]:
    """Relative errors of measured means, by name, of those statistics whose error is not the usual one."""
    errors = {name: entry.measurement_error for name, entry in STATISTICS.items()}
    return {name: error for name, error in errors.items() if error != Statistic.measurement_error}


def title_of(name: str, length: str = "L0") -> str:
    """What a plot calls a statistic, in a unit of length, or another observable of a simulator."""
    return STATISTICS[name].title(length) if name in STATISTICS else name.replace("_", " ")


def check_names(names: Iterable[str], *forms: Form) -> tuple[str, ...]:
    """The names, each of which must be a statistic with one of these forms.

    Raises:
        InputError: One is not.
    """
    names, known = tuple(names), names_with(*forms)
    for name in names:
        if name not in known:
            raise InputError(f"statistics: got {name!r}, need some of {', '.join(known)}")
    return names
