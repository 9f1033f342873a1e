"""What `yeastfit fit` does: measurements, made or read, the fit to them, and the files of both."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from yeastfit import plot
from yeastfit.commands.measure_batch import survey
from yeastfit.errors import InputError
from yeastfit.inference.fit.bootstrap_profile import Bootstrap, Profile
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.targets import Targets
from yeastfit.inference.targets_from_table import (
    TABLE,
    conditions_of,
    files_of,
    read_measurements,
    table_in,
    targets_of,
)
from yeastfit.measure.reading.batch_inputs import dataset_tasks
from yeastfit.measure.reading.dataset import MANIFESTS, dataset_folder, read_dataset
from yeastfit.model.parameters import NAMES, Scales
from yeastfit.progress import Progress
from yeastfit.report.measurement_files import clear_results, refuse_mixed_folder, write_results
from yeastfit.storage import read_json, write_table

RESULTS = (
    "fit.json",
    "parameters.csv",
    "targets.csv",
    "fit.png",
    "convergence.png",
    "spectrum.png",
    "ellipses.png",
    "bootstrap.csv",
    "bootstrap.png",
    "profiles.csv",
    "profiles.png",
    "manifest.json",
)


@dataclass(frozen=True)
class Measurements:
    """A table of measurements, where it lies, what it was made from, and what went wrong."""

    rows: list[dict[str, Any]]
    folder: Path
    inputs: list[Path]
    warnings: list[str]

    def targets(self, chosen: Sequence[str], statistics: Sequence[str], scales: Scales) -> dict[str, Targets]:
        """Of the chosen conditions, by name; of the only one where none is chosen."""
        there = conditions_of(self.rows)
        _check_chosen(chosen, there)
        return {
            name: targets_of(self.rows, self.folder, condition=name, statistics=statistics, scales=scales)
            for name in chosen or there
        }


def measurements(source: Path, folder: Path, jobs: int, progress: Progress) -> Measurements:
    """Read measurements.csv, or the one in a folder; or measure a data set, with all that `yeastfit measure` leaves."""
    table, where = table_in(source), dataset_folder(source)
    if where is None and table.is_file():
        rows = read_measurements(table)
        return Measurements(rows, table.parent, files_of(table, rows), told(rows, table.parent))
    dataset = read_dataset(where or source)
    tasks = dataset_tasks(dataset)
    refuse_mixed_folder(folder, tasks)
    clear_results(folder)
    outcomes = survey(tasks, folder, jobs=jobs, progress=progress)
    write_results(folder, f"Micrographs of {dataset.folder.resolve().name}", outcomes, dataset=dataset)
    rows = [outcome.row for outcome in outcomes if outcome.row]
    failed = [f"left out: {outcome.error}" for outcome in outcomes if not outcome.row]
    if not rows:
        raise InputError("; ".join(failed))
    doubts = [f"{outcome.task.label}: {doubt}" for outcome in outcomes for doubt in outcome.doubts]
    inputs = [dataset.manifest, *(outcome.task.path for outcome in outcomes if outcome.row)]
    return Measurements(rows, folder, inputs, failed + doubts)


def told(rows: Sequence[Mapping[str, Any]], folder: Path) -> list[str]:
    """What was said when these were measured, from measurements.csv and failures.csv."""
    failures, failed = folder / "failures.csv", list[str]()
    if failures.is_file():
        with failures.open(newline="", encoding="utf-8") as file:
            failed = [f"left out: {row['error']}" for row in csv.DictReader(file)]
    doubts = [(row["file"], one) for row in rows for one in str(row.get("warnings") or "").split(";")]
    return failed + [f"{name}: {one.strip()}" for name, one in doubts if one.strip()]


def check_source(source: Path, chosen: Sequence[str]) -> None:
    """Whether there are data, and of the conditions that are chosen, before anything is measured or written."""
    table, where = table_in(source), dataset_folder(source)
    if where is not None:
        _check_chosen(chosen, read_dataset(where).conditions)
    elif table.is_file():
        _check_chosen(chosen, conditions_of(read_measurements(table)))
    else:
        raise InputError(f"{source}: neither a data set, with {' or '.join(MANIFESTS)}, nor a {TABLE}")


def _check_chosen(chosen: Sequence[str], there: Sequence[str]) -> None:
    """Raises `InputError` where a condition is not there, or several are and none is chosen."""
    names = ", ".join(map(repr, there))
    for name in chosen:
        if name not in there:
            raise InputError(f"--condition: got {name!r}, the data have {names}")
    if not chosen and len(there) > 1:
        raise InputError(f"--condition: the data have {names}; choose one, or several by giving it again")


def named_numbers(option: str, texts: Sequence[str], what: str) -> dict[str, tuple[float, float]]:
    """NAME=A:B, several times."""
    found = {}
    for text in texts:
        name, _, pair = text.partition("=")
        try:
            first, second = (float(part) for part in pair.split(":"))
        except ValueError:
            raise InputError(f"{option} is {text!r}, it must be a name and {what}, such as mobility=0.5:2") from None
        found[name.strip().replace("-", "_")] = (first, second)
    return found


def read_truth(source: Path) -> dict[str, float] | None:
    """The parameters of a synthetic data set."""
    path = (source.parent if source.is_file() else source) / "truth" / "parameters.json"
    return {name: read_json(path)[name] for name in NAMES} if path.is_file() else None


def known_truth(source: Path) -> dict[str, float]:
    """`read_truth`. Raises `InputError` where nothing is known."""
    known = read_truth(source)
    if known is None:
        raise InputError(f"--truth: {source} has no truth/parameters.json beside it, leave --truth out")
    return known


def write_targets(folder: Path, targets: Mapping[str, Targets]) -> None:
    """targets.csv: the curves that are fitted."""
    write_table(
        folder / "targets.csv",
        [
            {
                "condition": name,
                "statistic": each.names[row],
                "time": float(each.times[column]),
                "hours": each.scales.hours(float(each.times[column])),
                "replicates": int(each.replicates[row, column]),
                "mean": float(each.mean[row, column]),
                "scatter": float(each.scatter[row, column]),
                "estimator": each.estimator,
            }
            for name, each in targets.items()
            for row, column in np.argwhere(each.measured)
        ],
    )


def write_fit(folder: Path, result: Fit, known: dict[str, float] | None) -> None:
    """Tables, JSON and pictures."""
    result.save(folder / "fit.json")
    write_table(folder / "parameters.csv", result.rows())
    by_entry = {entry.name: known[entry.parameter] for entry in result.space.entries} if known else None
    plot.save(plot.fit(result, by_entry), folder / "fit.png")
    plot.save(plot.convergence(result), folder / "convergence.png")
    plot.save(plot.spectrum(result.information), folder / "spectrum.png")
    plot.save(plot.ellipses(result.information), folder / "ellipses.png")


def write_bootstrap(folder: Path, found: Bootstrap, result: Fit) -> list[str]:
    """bootstrap.csv and its picture; lines for the terminal."""
    write_table(folder / "bootstrap.csv", [dict(zip(found.free, row, strict=True)) for row in found.values.tolist()])
    plot.save(plot.bootstrap(found, result), folder / "bootstrap.png")
    said = [
        f"bootstrap of replicates: {name} {found.intervals[name][0]:.4g} to {found.intervals[name][1]:.4g} (95 %)"
        for name in found.free
    ]
    if found.at_edge > 0.02:
        said.append(f"{found.at_edge:.0%} of the draws ended where the surface ends: these intervals are too narrow")
    return said


def write_profiles(folder: Path, found: Mapping[str, Profile]) -> list[str]:
    """profiles.csv and its picture; lines for the terminal."""
    rows = [
        {"parameter": name, "value": value, "chi_square_rise": rise}
        for name, each in found.items()
        for value, rise in zip(each.values.tolist(), each.rise.tolist(), strict=True)
    ]
    write_table(folder / "profiles.csv", rows)
    plot.save(plot.profiles(found), folder / "profiles.png")
    return [f"profile of {name}: {_interval(each.intervals['95%'])} (95 %)" for name, each in found.items()]


def table_of(result: Fit, known: dict[str, float] | None) -> Table:
    """Parameters with their errors, beside the true ones where these are known."""
    rows = result.rows()
    several = "condition" in rows[0]
    columns = ["parameter", "fitted", "standard error", *(["true", "(fitted - true) / error"] if known else [])]
    table = Table(*(["condition"] if several else []), *columns)
    for row in rows:
        value, error = row["value"], row["standard_error"]
        cells = [row["condition"]] if several else []
        cells += [row["parameter"], f"{value:.4g}", "fixed" if error is None else _error(error, value)]
        if known:
            off = "" if error is None or not np.isfinite(error) else f"{(value - known[row['parameter']]) / error:+.1f}"
            cells += [f"{known[row['parameter']]:.4g}", off]
        table.add_row(*cells)
    return table


def _error(error: float, value: float) -> str:
    return f"{error:.2g} ({error / value:.1%})" if np.isfinite(error) else "not determined"


def _interval(ends: tuple[float, float]) -> str:
    low, high = (f"{end:.4g}" if np.isfinite(end) else "beyond the surface" for end in ends)
    return f"{low} to {high}"
