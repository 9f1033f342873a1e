"""Parameters of mechanisms, recovered from synthetic micrographs together with mobility and metabolic rate.

Three rules beyond the source's: buds biased along the nutrient's gradient (κ = 2), births by clocks (v = 0.3), death by
starvation (h = 0.5, c_d = 0.4; the dead vanish). For each, three data sets of ten colonies are photographed every hour
from 3 h to 11 h, outlined and measured by `yeastfit measure`, and fitted to compactness, radius and area: mobility and
metabolic rate, both 1, and the rule's own parameter, with everything else held at its true value; plausible ranges are
the bounds. A pull is (log λ̂ − log λ) / standard error of log λ. Where the data determine a parameter no better than its
plausible range, the fit reports it as not determined and its pull is left out.

Colonies are small and fits short (32 points screened, two starts, stages of 16 and 64 pairs), so that all nine take
minutes.

    python -m benchmarks.recovery_of_rules [--quick] [--json FILE] [--docs DIR] [--work DIR]

Data sets, and a line in fits.jsonl for each finished fit, are kept in the folder given by --work,
out/recovery-of-rules by default; an interrupted run continues there. --quick: one data set of each rule, of four
colonies to 7 h. --docs writes DIR/recovery-of-rules.md.
"""

import argparse
import gc
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from benchmarks.lines import append_line, read_lines
from benchmarks.report import Report, command
from yeastfit.commands.measured_source import measure_source
from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.fit.least_squares import fit
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.targets_from_table import targets_of
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.processors import available_processors
from yeastfit.progress import silent
from yeastfit.simulation.recipe import Recipe
from yeastfit.simulation.synthetic_data import synthesize

Record = dict[str, Any]
SHARED = {"mobility": 1.0, "metabolic_rate": 1.0}
STATISTICS = ("compactness", "radius", "area")
SEEDS = 3
SETTINGS = FitSettings(screened=32, starts=2, members=(16, 64), spreads=(0.2, 0.15), refined=32)


@dataclass(frozen=True)
class Case:
    """A rule, the parameter that is recovered, its true value, and what is held."""

    rules: dict[str, dict[str, Any]]
    brought: str
    value: float
    held: dict[str, float]

    @property
    def free(self) -> tuple[str, ...]:
        """What is fitted."""
        return (*SHARED, self.brought)

    @property
    def truth(self) -> dict[str, float]:
        """Of the free parameters."""
        return {**SHARED, self.brought: self.value}


CASES = {
    "biased budding": Case({"budding": {"rule": "biased"}}, "budding_bias", 2.0, {}),
    "clocks": Case({"births": {"rule": "clocks"}}, "cycle_variation", 0.3, {}),
    "death": Case({"death": {"rule": "starvation", "dead": "vanish"}}, "death_rate", 0.5, {"starvation": 0.4}),
}


def recipe_of(case: Case, seed: int, quick: bool) -> Recipe:
    """One data set."""
    return Recipe(
        parameters={**case.truth, **case.held},
        seed=seed,
        hours=tuple(float(hour) for hour in range(3, 8 if quick else 12)),
        replicates=4 if quick else 10,
        extent=150.0,
        numerics=Numerics(domain=24.0, spacing=0.1, dt=0.01 if quick else 0.005, capacity=256),
        model=Model.of(case.rules),
    )


def recovered(name: str, seed: int, work: Path, quick: bool, report: Report) -> Record:
    """Photograph, unless that was done, measure and fit."""
    case, what = CASES[name], f"{name}, seed {seed}"
    recipe, folder = recipe_of(case, seed, quick), work / f"{case.brought}-{seed}"
    if not (folder / "truth" / "parameters.json").is_file():  # written completely or not at all
        report.stage(f"{what}: photographed")
        synthesize(recipe, folder)
    report.stage(f"{what}: measured")
    data = measure_source(folder, work / f"{case.brought}-{seed}-measured", available_processors(), silent)
    report.stage(f"{what}: fitted")
    began, used = time.perf_counter(), time.process_time()
    targets = targets_of(data.rows, data.folder, statistics=STATISTICS, scales=recipe.scales)
    try:
        found = fit(targets, free=case.free, fixed=case.held, model=recipe.model, seed=seed, settings=SETTINGS)
    except (InputError, SimulationError) as error:
        result: Record = {
            "status": f"failed: {error}",
            "log": dict.fromkeys(case.free),
            "error": dict.fromkeys(case.free),
        }
    else:
        result = {
            "status": found.message,
            "log": dict(zip(found.free, found.theta.tolist(), strict=True)),
            "error": {key: value if np.isfinite(value) else None for key, value in found.log_standard_errors.items()},
            "chi_square": found.chi_square,
            "degrees_of_freedom": found.degrees_of_freedom,
            "colonies": found.simulations,
            "warnings": list(found.warnings),
        }
    took = {"seconds": time.perf_counter() - began, "processor seconds": time.process_time() - used}
    return {"rule": name, "seed": seed, "asked": _asked(recipe), **result, **took}


def _asked(recipe: Recipe) -> Record:
    """Everything that determines a record."""
    plain: Record = json.loads(json.dumps({"recipe": recipe.asdict(), "settings": asdict(SETTINGS)}))
    return plain


def rows_of(records: list[Record]) -> list[Record]:
    """A row for each fit and parameter."""
    rows = []
    for record in records:
        for name, true in CASES[record["rule"]].truth.items():
            log, error = record["log"][name], record["error"][name]
            row: Record = {"rule": record["rule"], "seed": record["seed"], "parameter": name, "true": true}
            row["fitted"] = None if log is None else float(np.exp(log))
            row["error of log"] = error
            row["pull"] = None if log is None or error is None else (log - np.log(true)) / error
            rows.append(row | {"status": record["status"]})
    return rows


def summary(rows: list[Record]) -> list[Record]:
    """A row for each rule and parameter."""
    found = []
    for rule, name in dict.fromkeys((row["rule"], row["parameter"]) for row in rows):
        of = [row for row in rows if (row["rule"], row["parameter"]) == (rule, name)]
        pulls = [row["pull"] for row in of if row["pull"] is not None]
        errors = [100 * abs(row["fitted"] / row["true"] - 1) for row in of if row["fitted"] is not None]
        found.append(
            {
                "rule": rule,
                "parameter": name,
                "determined": f"{len(pulls)} of {len(of)}",
                "rms pull": float(np.sqrt(np.mean(np.square(pulls)))) if pulls else None,
                "largest pull": max(map(abs, pulls), default=None),
                "median error %": float(np.median(errors)) if errors else None,
            }
        )
    return found


def said(records: list[Record]) -> list[Record]:
    """A row for each fit: its doubts, such as why a parameter has no standard error."""
    return [
        {"rule": one["rule"], "seed": one["seed"], "doubts": "; ".join(one.get("warnings", [])) or "none"}
        for one in sorted(records, key=lambda one: (list(CASES).index(one["rule"]), one["seed"]))
    ]


def recover(report: Report, work: Path, quick: bool) -> None:
    """Fit what is missing, and report on all."""
    kept = {(record["rule"], record["seed"]): record for record in read_lines(work / "fits.jsonl")}
    for name, case in CASES.items():
        for seed in range(1, (1 if quick else SEEDS) + 1):
            if (name, seed) not in kept:
                kept[name, seed] = recovered(name, seed, work, quick, report)
                append_line(work / "fits.jsonl", kept[name, seed])
            elif kept[name, seed]["asked"] != _asked(recipe_of(case, seed, quick)):
                raise InputError(f"--work: {work} holds fits of other data or settings; name another folder")
        jax.clear_caches()
        gc.collect()
    rows = rows_of([kept[name, seed] for name in CASES for seed in range(1, SEEDS + 1) if (name, seed) in kept])
    pulls = np.array([row["pull"] for row in rows if row["pull"] is not None])
    inside = int((np.abs(pulls) <= 2).sum())
    report.add("within 2 standard errors", 100 * inside / max(1, pulls.size), "%", note=f"{inside} of {pulls.size}")
    report.add(
        "without a standard error", len(rows) - pulls.size, "", note=f"of {len(rows)}: not determined, or failed"
    )
    brought = [row["pull"] for row in rows if row["parameter"] not in SHARED and row["pull"] is not None]
    if brought:
        report.add("the rules' own: rms pull", np.sqrt(np.mean(np.square(brought))), "", note="1 if errors are right")
    used = [record["processor seconds"] for record in kept.values()]
    report.add("a fit, median", np.median(used), "processor s", note=f"longest {max(used):.0f}; without measuring")
    report.table("by rule and parameter", summary(rows))
    report.table("by data set", rows)
    report.table("what the fits say of their parameters", said(list(kept.values())))
    report.details["fits"] = list(kept.values())
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        (report.docs / "recovery-of-rules.md").write_text("\n\n".join([report.head(__doc__), *report.sections()]))


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/recovery-of-rules"))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        recover(report, own.work / ("quick" if quick else "full"), quick)

    command("recovery_of_rules", run, others)


if __name__ == "__main__":
    main()
