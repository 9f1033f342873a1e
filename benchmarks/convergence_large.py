"""How far numerics may be coarsened for colonies of real size: Δt, h and the width of contact, at t = 30 and 60.

The colonies of `benchmarks.large`, relaxed, in a dish of 300 L0, with the same seeds for all settings: discs, λ5 = 1.3,
λ6 = 0.9, λ7 = 0.65, and those of hungry cells, λ6 = 1.8, λ7 = 0.9, with a third of the cells in an area. Statistics
are those of images with 0.3 L0 a pixel, as photographs are measured. An entry is the difference of a setting's mean
from that of the reference, Δt = 0.025, h = 0.4 and w = 0.05, in percent, that of I_F and I_R in hundredths, ± its
standard error from the differences of pairs of colonies with one seed. Colonies of one seed are alike at first and as
different as any at the end, so a standard error says what so many seeds can tell. At Δt = 0.1 forward Euler does not
hold the springs: positions become not finite. Plain sums are those of the plain switch, `Numerics.compiled` = False,
which differ from the reference's by rounding.

    python -m benchmarks.convergence_large [--quick] [--json FILE] [--docs DIR] [--work DIR] [--seeds N] [--until T]

Colonies are kept in the folder given by --work, out/convergence_large by default, as they are finished; an interrupted
run goes on from there. One colony to t = 60 takes half a minute to two minutes of a processor. --until 30 leaves out
the later time. --quick: two seeds to t = 8.
"""

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.large import HUNGRY, LARGE
from benchmarks.lines import append_line, read_lines
from benchmarks.report import Report, command
from yeastfit import InputError, Numerics, Relaxation, member_keys, simulate
from yeastfit.measure.statistics.model_as_mask import HardStatistics

COLONIES = {"discs": LARGE, "hungry": HUNGRY}
SIDE, PIXEL = 300.0, 0.3
NAMES = {
    "cell_count": "N",
    "area": "area",
    "radius": "radius",
    "compactness": "C",
    "filament_area_index": "I_F",
    "filament_radius_index": "I_R",
}
REFERENCE = {"dt": 0.025, "spacing": 0.4, "contact": 0.05}
CHANGES: dict[str, Mapping[str, float]] = {
    "reference": {},
    "Δt 0.05": {"dt": 0.05},
    "Δt 0.0125": {"dt": 0.0125},
    "Δt 0.00625": {"dt": 0.00625},
    "Δt 0.003125": {"dt": 0.003125},
    "h 0.2": {"spacing": 0.2},
    "h 0.8": {"spacing": 0.8},
    "w 0.025": {"contact": 0.025},
    "w 0.1": {"contact": 0.1},
    "w 0.2": {"contact": 0.2},
    "w 0.025, Δt 0.0125": {"contact": 0.025, "dt": 0.0125},
    "w 0.1, Δt 0.0125": {"contact": 0.1, "dt": 0.0125},
    "w 0.2, Δt 0.0125": {"contact": 0.2, "dt": 0.0125},
    "w 0.025, Δt 0.003125": {"contact": 0.025, "dt": 0.003125},
    "Δt 0.0125 in 2 substeps": {"dt": 0.0125, "substeps": 2},
    "Δt 0.025 in 2 substeps": {"substeps": 2},
    "Δt 0.025 in 4 substeps": {"substeps": 4},
    "Δt 0.025 in 8 substeps": {"substeps": 8},
    "Δt 0.05 in 8 substeps": {"dt": 0.05, "substeps": 8},
    "Δt 0.025 in 4 substeps, h 0.8": {"substeps": 4, "spacing": 0.8},
    "plain sums": {"compiled": False},
}
DEAR = ("Δt 0.003125", "w 0.025, Δt 0.003125", "plain sums")  # to the earlier time only: many times as much work
SEEDS, SEEDS_ALONE = 4, 64  # and at most, of colonies that were grown to the earlier time alone
CHOOSE = """How to choose, by the runs of 27 November 2026:

- **Δt decides for discs.** From 0.025 to 0.00625 the area falls by 9 % at t = 30 and by 15 % at t = 60, and compactness
  by a half: where Δt λ3 / w is 2.5, contacts chatter, push nodes apart and open gaps between cells, whose outlines
  count. From 0.00625 to half of it they fall by 1.5 % and not at all. At 0.05 a quarter to a third of the cells is not
  born. Colonies of hungry cells, which branch, chatter less: 3 ± 1 and 4 ± 2 % of the area; what their C loses is
  within its error, 7 to 10 %.
- **Substeps do it at half the cost.** Motion alone needs the shorter step, and is a quarter of a step's cost: four
  substeps of Δt = 0.025 come to the area of Δt = 0.00625 within 1 %, to its N within 2 % and to its C within 4 % of the
  reference's, and take half the time. Eight, or Δt = 0.0125 in two, change no more than 3 %.
- **A linearly implicit step does not** (benchmarks.implicit_step, one disc to t = 24). With three iterations, in nearly
  twice the time of four substeps, its C is 35 % off that of Δt = 0.00625, and that of substeps 0.4 %; with eight, in
  2.4 times, 26 %; at Δt = 0.05 a fifth of the cells is not born. A contact ends within the width w, of which a
  derivative knows nothing.
- **w** is part of the model: the wider, the tighter, by 9 % of the area of discs from 0.05 to 0.1.
- **h**: of discs 0.8 is as good as 0.2. Colonies that branch see the nutrient between their branches: from 0.2 to 0.4
  their area falls by 3 ± 1 %, from 0.4 to 0.8 by 7 ± 1 % and C by 15 ± 7 % (t = 30).
- So **defaults for dishes wider than 100 L0 are Δt = 0.025 in 4 substeps and h = 0.4**: N within 2 % of the finest
  steps, the area within 1 % for discs and 5 % for branching colonies, at a quarter of the cost of Δt = 0.00625 and
  h = 0.2.
- **I_F and I_R** tell nothing of the discs, which have no filaments: the radius of the core jumps. Of branching
  colonies, too, they scatter by more than steps change.
- Plain sums and compiled ones agree: N and area of discs within 0.2 ± 0.6 %, C within 0.4 ± 0.6 %; 1024 pairs are
  compared by benchmarks.compiled_sums."""
Record = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """Which colonies at which times, how many seeds, and the folder of finished ones."""

    colonies: str
    times: tuple[float, ...]
    seeds: int
    work: Path

    @cached_property
    def done(self) -> dict[tuple[str, int], Record]:
        """Finished colonies. Raises `InputError` if they were grown to other times or otherwise."""
        records = {}
        for record in read_lines(self.work / "colonies.jsonl"):
            name, known = record["name"], list(self.times)
            if record["times"] != known or record["settings"] != REFERENCE | dict(CHANGES.get(name, {})):
                raise InputError(f"--work: {self.work} holds colonies of other settings or times; name another folder")
            records[name, record["seed"]] = record
        return records

    def grow(self, name: str, seed: int) -> None:
        """One colony, measured and kept."""
        began, used, settings = time.perf_counter(), time.process_time(), REFERENCE | dict(CHANGES[name])
        run = simulate(
            COLONIES[self.colonies],
            member_keys(0, self.seeds)[seed],
            times=self.times,
            numerics=Numerics(
                SIDE,
                settings["spacing"],
                settings["dt"],
                compiled=settings.get("compiled", True) is True,
                substeps=int(settings.get("substeps", 1)),
            ),
            relaxation=Relaxation(contact=settings["contact"]),
            observe=HardStatistics(SIDE, PIXEL, tuple(NAMES)),
            throw=False,  # what went wrong stands in the record
        )
        record = {
            **{"name": name, "seed": seed, "settings": settings, "times": list(self.times)},
            **{"statistics": {one: run.statistics[one].tolist() for one in NAMES}, "warnings": run.warnings()},
            **{"seconds": time.perf_counter() - began, "processor seconds": time.process_time() - used},
        }
        append_line(self.work / "colonies.jsonl", record)
        self.done[name, seed] = record

    def rows(self, moment: int) -> list[dict[str, Any]]:
        """Differences from the reference at one of the times, by all seeds that are finished."""
        rows = []
        for name in CHANGES:
            seeds = sorted(seed for one, seed in self.done if one == name and ("reference", seed) in self.done)
            if not seeds:
                continue
            mine, reference = (
                {
                    one: np.array([self.done[of, seed]["statistics"][one][moment] for seed in seeds], dtype=float)
                    for one in NAMES
                }
                for of in (name, "reference")
            )
            cost = np.median([self.done[name, seed]["processor seconds"] for seed in seeds])
            row: dict[str, Any] = {"setting": name, "colonies": len(seeds), "processor s, all": float(cost)}
            for one, symbol in NAMES.items():
                mean = reference[one].mean()
                if name == "reference":
                    row[symbol] = _text(mean, reference[one].std(ddof=1) if len(seeds) > 1 else np.nan, "")
                    continue
                gaps = 100 * (mine[one] - reference[one]) / (1.0 if symbol.startswith("I") else mean)
                error = gaps.std(ddof=1) / len(seeds) ** 0.5 if len(seeds) > 1 else np.nan
                row[symbol] = _text(gaps.mean(), error, "+")
            rows.append(row)
        return rows


def _text(value: float, error: float, sign: str) -> str:
    digits = 1 if sign or value >= 10 else 3
    return f"{value:{sign}.{digits}f}" + (f" ± {error:.{digits}f}" if np.isfinite(error) else "")


def study(report: Report, found: Study) -> None:
    """Grow what is missing, seed by seed, and report."""
    for seed in range(found.seeds):
        for name in CHANGES:
            if (name, seed) not in found.done and not (len(found.times) > 1 and name in DEAR):
                report.stage(f"{name}, seed {seed}")
                found.grow(name, seed)
    for moment, at in enumerate(found.times):
        title = f"{found.colonies} at t = {at:g}: the reference with its scatter, and differences from it"
        report.table(title, found.rows(moment))
    warned = [f"{name}, seed {seed}: {'; '.join(one['warnings'])}" for (name, seed), one in found.done.items()]
    warned = [one for one in warned if not one.endswith(": ")]
    report.add(
        f"{found.colonies}: colonies with warnings", len(warned), "", note="; ".join(dict.fromkeys(warned))[:300]
    )


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/convergence_large"))
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--until", type=float, default=60.0)
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        times = (4.0, 8.0) if quick else tuple(at for at in (30.0, 60.0) if at <= own.until)
        folder = "quick" if quick else f"until-{times[-1]:g}"
        for name in COLONIES:
            before = "" if name == "discs" else f"{name}-"
            study(report, Study(name, times, 2 if quick else own.seeds, own.work / f"{before}{folder}"))
            alone = Study(name, (30.0,), SEEDS_ALONE, own.work / f"{before}until-30")
            if not quick and len(times) > 1 and alone.done:
                report.table(f"{name} grown to t = 30 alone, in further settings, too", alone.rows(0))
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            page = "\n\n".join([report.head(__doc__), CHOOSE, *report.sections()])
            (report.docs / "convergence-large.md").write_text(page, encoding="utf-8")

    command("convergence_large", run, others)


if __name__ == "__main__":
    main()
