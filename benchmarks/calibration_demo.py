"""Calibration of the emulator near the data of the demo: posterior simulation-based calibration.

Calibration over a prior says that posteriors are right on average over all data that the prior makes. Near the data of
the demo it is judged where it is used: true λ are draws of the demo's posterior, data like the demo's are simulated at
them, and each truth is ranked among the draws of the posterior of both data sets together, which is uniform where
posteriors are right (Säilynoja, Schmitt, Bürkner & Vehtari 2025, arXiv:2502.03279). All three parameters together are
ranked by TARP (Lemos et al. 2023, arXiv:2302.03026). The table has the share of truths inside intervals of 50 and 90 %,
each with Wilson's 95 % interval.

Targets: Wilson's intervals of 50 % and 90 % intervals, and of the joint regions, contain 50 % and 90 %. No posterior
fails.

    python -m benchmarks.calibration_demo [--quick] [--json FILE] [--docs DIR] [--work DIR] [--data-sets N]

Simulations are kept in the folder given by --work, out/calibration_demo by default; an interrupted run finds them
there. --data-sets: 25 by default, of which each takes about ten minutes on two cores. --quick: four young colonies and
three data sets with tiny networks, no targets.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import yeastfit
from benchmarks.report import Report, command
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.posterior.calibration_ranks import LEVELS

DEMO = Path(__file__).parents[1] / "data" / "synthetic" / "demo"
FREE = ("mobility", "metabolic_rate", "aspect_ratio")


def calibrated(work: Path, data_sets: int, quick: bool, report: Report) -> yeastfit.Calibration:
    """The demo's posterior, and posteriors of data simulated at its draws."""
    hours, colonies = (6.0, 4) if quick else (14.0, 10)
    dataset = yeastfit.read_dataset(DEMO)
    frames = [one for one in dataset.frames if one.hours <= hours and int(one.replicate) <= colonies]
    shown = replace(dataset, frames=tuple(frames))
    targets = yeastfit.Targets.from_dataset(shown, yeastfit.measure_dataset(shown))
    resolution = yeastfit.Resolution(dt=0.02) if quick else yeastfit.Resolution()
    simulator = yeastfit.ColonySimulator.of(targets, FREE, resolution=resolution)
    settings: dict[str, Any] = {}
    if quick:
        networks = TrainingSettings(members=2, width=16, steps=100)
        settings = {"simulations": 128, "first": 64, "batch": 64, "most_steps": 500, "training": networks}
    work.mkdir(parents=True, exist_ok=True)
    prior = yeastfit.Prior.default(simulator.parameters)
    report.stage("the posterior of the demo")
    found = yeastfit.infer(simulator, prior, targets, store=work / "demo.h5", **settings)
    return yeastfit.calibrate(
        simulator,
        found,
        data_sets=data_sets,
        draws=19 if quick else 99,
        store=work / "pairs.h5",
        progress=lambda what, share: report.stage(what) if what.startswith("data set") else None,
        **settings,
    )


def judge(report: Report, found: yeastfit.Calibration) -> None:
    """Figures and the table of a calibration."""
    count, none = len(found.truths), None if report.quick else 0.0
    report.add("posteriors that failed", len(found.failed), "", none, False, "; ".join(found.failed))
    report.add("posteriors with warnings", 100 * found.warned / count, "%")
    rows = found.rows()
    for level in LEVELS:
        name = f"{100 * level:g}"
        missed = [row["quantity"] for row in rows if not row[f"from_{name}"] <= level <= row[f"to_{name}"]]
        report.add(f"quantities off their {name} % intervals", len(missed), "", none, False, ", ".join(missed))
    report.table(f"{count} data sets near the demo: shares of truths inside", rows)
    report.details["ranks"] = {"of": found.free, "each": found.ranks.tolist(), "joint": found.joint_ranks.tolist()}


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/calibration_demo"))
    parser.add_argument("--data-sets", type=int)
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        count = own.data_sets or (3 if quick else 25)
        judge(report, calibrated(own.work / ("quick" if quick else "full"), count, quick, report))
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            page = "\n\n".join([report.head(__doc__), *report.sections()])
            (report.docs / "calibration-demo.md").write_text(page, encoding="utf-8")

    command("calibration_demo", run, others)


if __name__ == "__main__":
    main()
