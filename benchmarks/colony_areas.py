"""Real colonies of a condition differ in area: should simulated ones?

Colonies of AWRI 796 at 500 µM of ammonium cover 1.6 to 3.6 mm², those of the other sets of `data/real` up to 1.6 and
1.9 times as much as the smallest. The off-lattice model's colonies are drawn at one area, the mean of the data
(`--match exactly`), or each at that of one real colony, taken at random (`--match each`). Everything else is the same:
three indices of shape, parameters that may differ between colonies, as many cells, those that cover the largest colony.

    cd data/real
    more="--model offlattice --statistics filament_area_index,filament_radius_index,angular_index --variation
        --leave-out 4 --most-steps 60000 --draws 20 --prior-draws 0"
    yeastfit infer awri796-500um $more --cells 127000 --match each --seed 0 --out WORK/awri796-500um/each-0

and so on. Predicted colonies have the areas of all colonies of the set, those left out among them: areas are given, and
not predicted. A colony left out is compared with predictions of any area, and not of its own.

Target: 80 to 97 % of what colonies left out have shown lies in the predicted interval of 90 %, with each area.

    python -m benchmarks.colony_areas [--quick] [--json FILE] [--docs DIR] [--work DIR] [--page]

Runs are kept in the folder given by --work, out/areas by default; an interrupted one goes on there. --page computes
nothing: the page is of what is there. --quick: one set, 128 simulations, no target.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.real_answers import CALLED
from benchmarks.real_run import RealRun
from benchmarks.report import Report, command
from yeastfit.inference.comparison.models import ModelComparison
from yeastfit.inference.prior.variation import NAME as VARIATION
from yeastfit.inference.prior.variation import absent

OPTIONS = "--model offlattice --variation --statistics filament_area_index,filament_radius_index,angular_index"
HOW = f"{OPTIONS} --leave-out 4 --most-steps 60000 --draws 20 --prior-draws 0"
QUICK = f"{OPTIONS} --leave-out 2 --most-steps 500 --walkers 32 --simulations 128 --draws 10"
MATCHES = {"each": "each at its area", "exactly": "all at the mean area"}
QUICKLY = [("awri796-50um", match, 0) for match in MATCHES]
SEEDS = {"awri796-500um": (0, 1, 2), "simi-white-50um": (0,), "awri796-50um": (0,)}
RUNS = [(name, match, seed) for match in MATCHES for name, seeds in SEEDS.items() for seed in seeds]
INSIDE = (0.8, 0.97)


@dataclass(frozen=True)
class Run(RealRun):
    """One posterior, by one way of matching."""

    match: str
    seed: int

    @property
    def title(self) -> str:
        """In words."""
        return f"{CALLED[self.name]}, {MATCHES[self.match]}, seed {self.seed}"

    def row(self) -> dict[str, Any]:
        """Of the table."""
        posterior, found = self.posterior, self.left_out
        tau = posterior.free.index(VARIATION)
        transition = posterior.free.index("transition")
        return {
            "run": self.title,
            "settled": "yes" if posterior.settled else "no",
            "simulations": posterior.simulations,
            "inside 50 %": f"{100 * found.coverage(0.5):.0f}",
            "inside 90 %": f"{100 * found.coverage(0.9):.0f}",
            "log density": f"{found.total:.1f} ± {found.standard_error:.1f}",
            "variation τ": f"{posterior.mean[tau]:.2f} ± {posterior.sd[tau]:.2f}",
            "P(τ = 0)": absent(posterior),
            "transition n*": f"{posterior.mean[transition]:.2f} ± {posterior.sd[transition]:.2f}",
        }


def judge(report: Report, runs: list[Run]) -> list[str]:
    """Figures and the table of what is there, and in words what it means."""
    done = [one for one in runs if one.there]
    for one in done:
        inside = one.left_out.coverage(0.9)
        wanted = one.match == "each" and not report.quick
        report.add(f"{one.title}: left out, inside 90 %", inside, "", INSIDE[0] if wanted else None)
        report.add(f"{one.title}: the same, at most", inside, "", INSIDE[1] if wanted else None, False)
    report.table("Runs", [one.row() for one in done])
    return [_compared(name, done) for name in CALLED if any(one.name == name for one in done)]


def _compared(name: str, runs: list[Run]) -> str:
    """Which way of matching predicts colonies left out better, seed by seed."""
    said = list[str]()
    for seed in sorted({one.seed for one in runs if one.name == name}):
        left_out = {MATCHES[one.match]: one.left_out for one in runs if (one.name, one.seed) == (name, seed)}
        if len(left_out) == len(MATCHES):
            best, other = ModelComparison.of(left_out).runs
            chance = "" if other.told_apart else ", which may be chance"
            said.append(f"{best.name} by {other.behind:.1f} ± {other.error:.1f}{chance} (seed {seed})")
    if not said:
        return f"**{CALLED[name]}**: of no seed are both runs there."
    return f"**{CALLED[name]}**: colonies left out are predicted better {'; '.join(said)}."


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/areas"))
    parser.add_argument("--page", action="store_true")
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        folder = own.work / ("quick" if quick else "full")
        runs = [
            Run(name, folder / name / f"{match}-{seed}", match, seed)
            for name, match, seed in (QUICKLY if quick else RUNS)
        ]
        for one in runs:
            if not own.page and not one.there:
                report.stage(one.title)
                one.infer(f"{QUICK if quick else HOW} --match {one.match} --seed {one.seed}")
        said = judge(report, runs)
        missing = [one.title for one in runs if not one.there]
        said += [f"Not there yet: {'; '.join(missing)}."] if missing else []
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            words = "\n".join(f"- {one}" for one in said)
            page = "\n\n".join([report.head(__doc__), "## In words", words, *report.sections()])
            (report.docs / "colony-areas.md").write_text(page, encoding="utf-8")

    command("colony_areas", run, others)


if __name__ == "__main__":
    main()
