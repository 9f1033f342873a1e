"""Parameter recovery: known parameters, rendered as synthetic micrographs, measured and fitted.

Twenty true λ are low-discrepancy points (scrambled Sobol') of a box in log λ: mobility 0.5 to 3, metabolic rate 0.4 to
2.5, aspect ratio 0.45 to 0.9, the other four at the source's values. For each, ten colonies are photographed at eleven
times, 4 h to 14 h, as in data/synthetic/recipes.toml but with a wider field of view; outlined and measured by
`yeastfit measure`; and fitted with the defaults of `yeastfit fit`: compactness and radius, three starts, plausible
ranges as bounds. A pull is (log λ̂ − log λ) / standard error of log λ.

Targets: of the parameters with a standard error, 90 % to 98 % lie within two of them; a normal distribution has 95 %.
The interval beside this figure is Wilson's for independent parameters, which the three of one fit are not. Parameters
that a fit reports as not determined are counted separately: where cells eat slowly, only the product of mobility and
metabolic rate affects a colony's shape.

    python -m benchmarks.recovery [--quick] [--json FILE] [--docs DIR] [--work DIR] [--again]
                                  [--workers N | --scheduler tcp://HOST:PORT]

The data sets, and a line in fits.jsonl for each finished fit, are kept in the folder given by --work, out/recovery by
default; an interrupted run continues there. --again repeats the fits with the same photographs and replaces photographs
of another recipe. --quick: two true λ, four colonies, five times, small ensembles, no targets, since six parameters
cannot distinguish 90 % from 98 %. --docs writes DIR/recovery.md and DIR/recovery.png.
"""

import argparse
import gc
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from scipy.stats import binomtest

from benchmarks.lines import append_line, read_lines
from benchmarks.report import Report, command
from benchmarks.workers import add_workers, workers_of
from yeastfit.commands.measured_source import measure_source
from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.colony_simulator import DEFAULT_FREE, ColonySimulator
from yeastfit.inference.fit.least_squares import fit
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.parameter_space import ParameterSpace
from yeastfit.inference.resolution import COARSE, Resolution
from yeastfit.inference.targets_from_table import targets_of
from yeastfit.inference.workers.spread import Workers
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS
from yeastfit.processors import available_processors
from yeastfit.progress import silent
from yeastfit.simulation.recipe import Recipe
from yeastfit.simulation.synthetic_data import synthesize

BOX = {"mobility": (0.5, 3.0), "metabolic_rate": (0.4, 2.5), "aspect_ratio": (0.45, 0.9)}
COUNT, SEED = 20, 2031
HOURS = tuple(float(hour) for hour in range(4, 15))
STATISTICS = ("compactness", "radius")
LOWEST, HIGHEST = 90.0, 98.0  # % of parameters within two standard errors
QUICK = FitSettings(screened=32, starts=2, members=(16, 48), spreads=(0.2, 0.15), refined=16)
Record = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """What is recovered, and how.

    Attributes:
        recipes: One for each true λ.
        settings: Of the fits.
        work: Folder of all its files.
    """

    recipes: tuple[Recipe, ...]
    settings: FitSettings
    work: Path

    @staticmethod
    def of(quick: bool, work: Path) -> "Study":
        """The full study, or a quick one in its own folder."""
        truths = np.exp(ParameterSpace.of(PARAMETERS.subset(tuple(BOX)), bounds=BOX).sobol_points(COUNT, SEED))
        recipes = tuple(
            Recipe(
                parameters=dict(zip(BOX, truth.tolist(), strict=True)),
                seed=SEED + number,
                hours=HOURS[2::2] if quick else HOURS,
                replicates=4 if quick else 10,
                extent=165.0,
                numerics=Numerics(domain=24.0, spacing=0.1, dt=0.01 if quick else 0.005, capacity=256),
            )
            for number, truth in enumerate(truths[: 2 if quick else COUNT], start=1)
        )
        return Study(recipes, QUICK if quick else FitSettings(), work / ("quick" if quick else "full"))

    @property
    def lines(self) -> Path:
        """A line of JSON for each finished fit."""
        return self.work / "fits.jsonl"

    def asked(self, number: int) -> dict[str, Any]:
        """Everything that determines a record."""
        what = {"recipe": self.recipes[number - 1].asdict(), "settings": asdict(self.settings)}
        return json.loads(json.dumps(what))

    def done(self) -> dict[int, Record]:
        """Records by the number of their truth. Raises `InputError` if one was made with other settings."""
        records = {record["truth"]: record for record in read_lines(self.lines)}
        for number, record in records.items():
            if number > len(self.recipes) or record["asked"] != self.asked(number):
                raise InputError(
                    f"--work: {self.lines} holds fits of other truths or settings; name another folder, or say --again"
                )
        return records

    def keep(self, record: Record) -> None:
        """Append a record."""
        append_line(self.lines, record)


def recovered(study: Study, number: int, report: Report, workers: Workers | None = None) -> Record:
    """One true λ: photograph it, unless that was done, measure and fit."""
    recipe, folder = study.recipes[number - 1], study.work / f"truth{number:02d}"
    what = f"truth {number} of {len(study.recipes)}: {_words(recipe.parameters)}"
    if not _same_recipe(folder, study.asked(number)["recipe"]):
        report.stage(f"{what}, photographed")
        synthesize(recipe, folder)
    report.stage(f"{what}, measured")
    data = measure_source(folder, study.work / f"measured{number:02d}", available_processors(), silent)
    report.stage(f"{what}, fitted")
    began = time.perf_counter()
    record: Record = {"truth": number, "asked": study.asked(number), "left out": len(data.warnings)}
    try:
        targets = targets_of(data.rows, data.folder, statistics=STATISTICS, scales=recipe.scales)
        if workers is None:
            found = fit(targets, seed=number, settings=study.settings)
        else:  # the simulators that the fit would make itself
            each = (ColonySimulator.of(targets, resolution=one) for one in (COARSE, Resolution()))
            coarse, fine = map(workers.spread, each)
            found = fit(targets, coarse, fine=fine, seed=number, settings=study.settings)
    except (InputError, SimulationError) as error:
        nothing = dict.fromkeys(DEFAULT_FREE)
        failed = {"status": f"failed: {error}", "converged": False, "simulations": None, "warnings": []}
        return record | failed | {"seconds": time.perf_counter() - began, "log": nothing, "error": nothing}
    return record | {
        "status": found.message,
        "converged": found.converged,
        "simulations": found.simulations,
        "seconds": time.perf_counter() - began,
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "log": dict(zip(found.free, found.theta.tolist(), strict=True)),
        "error": {name: _or_none(value) for name, value in found.log_standard_errors.items()},
        "warnings": list(found.warnings),
    }


def _same_recipe(folder: Path, recipe: Mapping[str, Any]) -> bool:
    """Whether a data set exists and was made from this recipe. It is written completely or not at all."""
    file = folder / "truth" / "parameters.json"
    return file.is_file() and json.loads(file.read_text())["recipe"] == recipe


def _words(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in values.items())


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def table_of(records: Sequence[Record]) -> dict[str, np.ndarray]:
    """truth, log, error and pull, [truth, parameter]; nan where a fit gives none."""
    names = DEFAULT_FREE
    truth = np.log([[record["asked"]["recipe"]["parameters"][name] for name in names] for record in records])
    log, error = (
        np.array([[record[key][name] for name in names] for record in records], dtype=float) for key in ("log", "error")
    )
    return {"truth": truth, "log": log, "error": error, "pull": (log - truth) / error}


def verdicts(report: Report, records: Sequence[Record]) -> None:
    """Add figures and tables to the report."""
    found = table_of(records)
    pull, off = found["pull"], np.abs(np.expm1(found["log"] - found["truth"]))
    told = pull[np.isfinite(pull)]
    for number, limit in enumerate((2.0, 1.0)):
        inside = int((np.abs(told) <= limit).sum())
        ends = binomtest(inside, max(1, told.size)).proportion_ci(method="wilson")
        note = f"{inside} of {told.size}; 95 % interval {100 * ends.low:.0f} to {100 * ends.high:.0f} %"
        share, what = 100 * inside / max(1, told.size), f"within {limit:g} standard error{'s' if limit > 1 else ''}"
        if number or report.quick:
            report.add(what, share, "%", note=note)
        else:
            report.add(what, share, "%", LOWEST, note=note)
            report.add(
                f"{what}, at most", share, "%", HIGHEST, at_least=False, note="above it, standard errors are too large"
            )
    none = pull.size - told.size
    note = f"{none} of {pull.size}: reported as not determined, or the fit failed; not counted above"
    report.add("without a standard error", 100 * none / pull.size, "%", note=note)
    rows: list[dict[str, Any]] = [
        {
            "parameter": name,
            "rms pull": _rms(pull[:, k]),
            "mean pull": float(np.nanmean(pull[:, k])),
            "within 1": int((np.abs(pull[:, k]) <= 1).sum()),
            "within 2": int((np.abs(pull[:, k]) <= 2).sum()),
            "of": len(pull),
            "median error %": float(100 * np.nanmedian(off[:, k])),
            "median standard error %": float(100 * np.nanmedian(found["error"][:, k])),
        }
        for k, name in enumerate(DEFAULT_FREE)
        if np.isfinite(pull[:, k]).any()
    ]
    for row in rows:
        report.add(f"{row['parameter']}: rms pull", row["rms pull"], "", note="1 if errors are right")
        report.add(f"{row['parameter']}: median relative error", row["median error %"], "%")
    seconds = np.array([record["seconds"] for record in records])
    report.add("a fit, median", np.median(seconds), "s", note=f"longest {seconds.max():.0f} s; without measuring")
    colonies = np.array([record["simulations"] for record in records], dtype=float)
    report.add("simulated colonies, median", np.nanmedian(colonies), "", note=f"at most {np.nanmax(colonies):.0f}")
    good = sum(record["converged"] for record in records)
    report.add("converged", 100 * good / len(records), "%", note=f"{good} of {len(records)}")
    if rows:
        report.table("by parameter", rows)
    report.table("by truth: true, fitted, pull", [_row(record, found, k) for k, record in enumerate(records)])
    report.details["truths"] = list(records)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _row(record: Record, found: Mapping[str, np.ndarray], k: int) -> dict[str, Any]:
    row: dict[str, Any] = {"truth": record["truth"]}
    for column, name in enumerate(DEFAULT_FREE):
        true, log, pull = (found[key][k, column] for key in ("truth", "log", "pull"))
        row[name.replace("_", " ")] = f"{np.exp(true):.3g}, {np.exp(log):.3g}, {pull:+.1f}"
    seen = {"χ²": record.get("chi_square"), "of": record.get("degrees_of_freedom"), "s": record["seconds"]}
    return (
        row
        | seen
        | {"colonies": record["simulations"], "warnings": len(record["warnings"])}
        | {"status": record["status"]}
    )


def picture(records: Sequence[Record], path: Path) -> None:
    """Plot fitted against true values, with two standard errors, and the pulls."""
    found = table_of(records)
    figure = Figure(figsize=(15, 4), layout="constrained")
    *panels, last = figure.subplots(1, len(DEFAULT_FREE) + 1)
    for k, (name, panel) in enumerate(zip(DEFAULT_FREE, panels, strict=True)):
        true, log, error = (found[key][:, k] for key in ("truth", "log", "error"))
        value, known = np.exp(log), np.isfinite(error)
        bars = np.stack([value - np.exp(log - 2 * error), np.exp(log + 2 * error) - value])[:, known]
        panel.errorbar(np.exp(true[known]), value[known], bars, fmt="o", ms=4, lw=1, color="#7a5230")
        if not known.all():
            panel.plot(np.exp(true[~known]), value[~known], "x", ms=5, color="0.6", label="said to be not determined")
            panel.legend(fontsize=8)
        panel.plot(BOX[name], BOX[name], color="black", lw=0.8)
        panel.set(xscale="log", yscale="log", xlabel=f"true {name.replace('_', ' ')}", ylabel="fitted, ± 2 errors")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if name != "aspect_ratio" else range(1, 10)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(NullLocator())
    pulls = found["pull"][np.isfinite(found["pull"])]
    last.hist(np.clip(pulls, -4, 4), bins=np.linspace(-4, 4, 17), density=True, color="#c9a57b")
    grid = np.linspace(-4, 4, 161)
    last.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color="black", lw=1, label="normal distribution")
    last.set(xlabel="pull (those beyond 4 at 4)", ylabel="density")
    last.legend(fontsize=8)
    figure.savefig(path, dpi=70)


def markdown(report: Report) -> str:
    """The text of the page."""
    box = "; ".join(f"{name.replace('_', ' ')} {low:g} to {high:g}" for name, (low, high) in BOX.items())
    parts = [
        f"""# Parameter recovery

{report.origin}

True λ are a low-discrepancy sequence in log λ ({box}; the others at the source's values). Each was rendered as
micrographs of ten colonies at eleven times, outlined and measured like any photograph, and fitted with default
settings, from three starts, to compactness and radius. A pull is (log λ̂ − log λ) / standard error of log λ.

![Fitted against true](recovery.png)
"""
    ]
    return "\n".join([*parts, *report.sections()])


def recover(report: Report, study: Study, workers: Workers | None = None) -> None:
    """Fit the truths that are missing, one at a time, and report on all."""
    records = study.done()
    for number in range(1, len(study.recipes) + 1):
        if number not in records:
            records[number] = recovered(study, number, report, workers)
            study.keep(records[number])
            jax.clear_caches()  # each truth compiles its own programs, as domains differ in size
            gc.collect()
    ordered = [records[number] for number in sorted(records)]
    verdicts(report, ordered)
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        picture(ordered, report.docs / "recovery.png")
        (report.docs / "recovery.md").write_text(markdown(report))


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/recovery"))
    parser.add_argument("--again", action="store_true")
    add_workers(parser)
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        study = Study.of(quick, own.work)
        if own.again:
            study.lines.unlink(missing_ok=True)
        workers = workers_of(own)
        with workers or nullcontext():
            recover(report, study, workers)

    command("recovery", run, others)


if __name__ == "__main__":
    main()
