"""Do simulated colonies look like real ones, where texture is asked for and outlines may lie outside of cells?

Posteriors of the off-lattice model by three indices of shape predict hairs that are more and thinner than real ones
are, with rougher outlines and more holes. Here nine statistics are asked for: four of shape, I_F, I_R, angular index
and solidity; four of texture, compactness, length and ends of skeletons and width of filaments, of smoothed outlines,
as bumps of a pixel look like ends of hairs; and the radius of the largest circle inside, which tells how round a core
is and how free of holes. Two parameters more are free, which are the same for all colonies of a set: how far outlines
lie outside of the cells, `margin`, and how much nutrient smaller colonies had, `nutrient_exponent`. Gaps of 12 µm, two
cells, are closed: where wider ones may be, hairs are as thick as real ones by webs between them, which real ones do not
have. Colonies of a set differ in when filaments begin, `transition`, and in nothing else: by the best likelihood that
explains their scatter at 500 µM as well as a scatter for each of the five parameters of growth, and better than one for
all of them:

    cd data/real
    more="--model offlattice --match each --variation --varying transition --leave-out 4 --each 1024 --simulations 20480
        --most-steps 60000 --draws 20 --prior-draws 0 --statistics texture
        --free transition,sated_from_pseudohyphal,pseudohyphal_from_sated,fork,any_mother,nutrient_exponent,margin"
    yeastfit infer simi-white-50um $more --cells 88000 --out WORK/simi-white-50um

and so on. Colonies are simulated from each posterior, each at the area of one of the real ones, and compared with these
in the nine statistics and in six that were not asked for: smoothed I_B, holes, wave number, and fractal dimension,
compactness and ends of outlines as they are, in which real colonies have bumps and simulated ones have not. To each
simulated colony the error of an outline is added, as the posterior has it ([outlines](outlines.md)). How much colonies
of one λ vary, by their areas and by chance, and how much outlines do, is told as shares of what real ones do: the
posterior makes up for less by a scatter of parameters, and cannot for more.

Target: 80 to 97 % of what colonies left out have shown lies in the predicted interval of 90 %.

    python -m benchmarks.likeness [--quick] [--json FILE] [--docs DIR] [--work DIR] [--page] [--images DIR --grid FILE]

Runs are kept in the folder given by --work, out/likeness by default; an interrupted one goes on there. --page computes
no posterior: the page is of what is there. --quick: one set, 160 simulations, no target.

With the masks or photographs that `data/real` was measured on, which are no part of the project, in the folder given by
--images, a picture of 3 × 6 colonies is written besides: of each set three of them and three simulated ones, mixed,
all at one scale. Which are real is printed: can you tell? The last table of the page is of these masks, too: how far
cores are off a circle, of real and simulated colonies and of simulated ones without hairs, whose n* is 1 (a core is
what a disc of radius 60 µm reaches), what of circles 5 to 30 % wider than the largest one inside lies inside the
colony, in how many pieces, and how wide hairs are at three distances beyond the core.
"""

import argparse
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.likeness_masks import FREE, cores, drawn, grid, real_masks
from benchmarks.offlattice_runs import real_colonies
from benchmarks.real_answers import CALLED
from benchmarks.real_run import CELLS, RealRun
from benchmarks.report import Report, command
from yeastfit.errors import InputError
from yeastfit.inference.comparison.conditions import ConditionComparison
from yeastfit.inference.models.offlattice_drawing import TEXTURE
from yeastfit.inference.simulator import member_seeds
from yeastfit.plot.style import save
from yeastfit.results.contents import RUN
from yeastfit.storage import read_json

FURTHER = ("smoothed_branch_index", "hole_count", "wave_number", "fractal_dimension", "compactness", "branch_count")
OPTIONS = (
    f"--model offlattice --match each --variation --varying transition --free {','.join(FREE)} --statistics texture"
)
HOW = f"{OPTIONS} --leave-out 4 --each 1024 --simulations 20480 --most-steps 60000 --draws 20 --prior-draws 0"
QUICK = f"{OPTIONS} --leave-out 2 --most-steps 500 --walkers 32 --simulations 160 --draws 10"
INSIDE = (0.8, 0.97)
COLONIES = 100  # simulated from each posterior
OF_ONE = 10  # of these have one λ, where variation at one λ is told


def judge(report: Report, runs: list[RealRun]) -> None:
    """Figures and tables of what is there."""
    rows: list[dict[str, Any]] = []
    for one in (each for each in runs if each.there):
        name, inside = CALLED[one.name], one.left_out.coverage(0.9)
        low, high = (None, None) if report.quick else INSIDE
        report.add(f"{name}: left out, inside 90 %", inside, "", low)
        report.add(f"{name}: the same, at most", inside, "", high, False)
        compared = compare(one, 10 if report.quick else COLONIES)
        for title, names in (("asked for", TEXTURE), ("not asked for", FURTHER)):
            shares = [row["inside 90 %"] for row in compared if row["statistic"] in names]
            report.add(f"{name}: real colonies inside predicted 90 %, statistics {title}", float(np.mean(shares)), "")
        report.table(f"{name}: real and simulated colonies", compared)
        rows.append(_row(one))
    if rows:
        report.table("Runs", rows)


def differences(runs: list[RealRun]) -> list[str]:
    """Which parameters differ between the sets that are there, in words."""
    found = [
        ConditionComparison.of(CALLED[a.name], a.posterior, CALLED[b.name], b.posterior)
        for a, b in combinations([one for one in runs if one.there], 2)
    ]
    return [said for one in found for said in one.sentences()]


def _row(run: RealRun) -> dict[str, Any]:
    """Of the table of runs."""
    posterior, found = run.posterior, run.left_out
    ends = posterior.interval(0.9)
    return {
        "set": CALLED[run.name],
        "settled": "yes" if posterior.settled else "no",
        "simulations": posterior.simulations,
        "of a round": read_json(run.folder / RUN)["configuration"]["settings"]["each"],
        "inside 50 %": f"{100 * found.coverage(0.5):.0f}",
        "inside 90 %": f"{100 * found.coverage(0.9):.0f}",
        "log density": f"{found.total:.1f} ± {found.standard_error:.1f}",
        **{
            name.replace("_", " "): f"{mean:.2g} ({low:.2g} to {high:.2g})"
            for name, mean, (low, high) in zip(posterior.free, posterior.mean.tolist(), ends.tolist(), strict=True)
        },
    }


def compare(run: RealRun, colonies: int) -> list[dict[str, Any]]:
    """Statistics of the real colonies of a set, and of colonies simulated from its posterior."""
    names = (*TEXTURE, *FURTHER)
    simulator, seen, values = drawn(run, names, colonies)
    alike = np.repeat(values[: max(1, colonies // OF_ONE), :-1], OF_ONE, axis=0)
    of_one = simulator.simulator(alike, member_seeds(1, len(alike))).reshape(-1, OF_ONE, len(names))
    deviation = np.sqrt(np.nanmean(np.nanvar(of_one, axis=1, ddof=1), axis=0))
    predicted, real = simulator(values, member_seeds(0, colonies)), real_colonies(run.name, names)
    errors = np.array([*seen.model.colony_errors(names, None).values()]) * np.abs(real.mean(axis=0))
    predicted = predicted[np.isfinite(predicted).all(axis=1)]
    predicted += errors * np.random.default_rng(1).standard_normal(predicted.shape)
    low, middle, high = np.quantile(predicted, (0.05, 0.5, 0.95), axis=0)
    return [
        {
            "statistic": name,
            "real, median": float(np.median(real[:, k])),
            "least": float(real[:, k].min()),
            "largest": float(real[:, k].max()),
            "simulated, median": float(middle[k]),
            "5 %": float(low[k]),
            "95 %": float(high[k]),
            "inside 90 %": float(np.mean((real[:, k] >= low[k]) & (real[:, k] <= high[k]))),
            "deviation at one λ / real": float(deviation[k] / real[:, k].std(ddof=1)),
            "of outlines / real": float(errors[k] / real[:, k].std(ddof=1)),
        }
        for k, name in enumerate(names)
    ]


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/likeness"))
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--images", type=Path)
    parser.add_argument("--grid", type=Path)
    own, others = parser.parse_known_args(arguments)
    if (own.images is None) != (own.grid is None):
        raise InputError("--images holds what --grid shows: give both, or neither")

    def run(report: Report, quick: bool) -> None:
        folder = own.work / "quick" if quick else own.work
        runs = [RealRun(name, folder / name) for name in (list(CELLS)[:1] if quick else CELLS)]
        for one in runs:
            if not own.page and not one.there:
                report.stage(CALLED[one.name])
                one.infer(QUICK if quick else HOW)
        judge(report, runs)
        if own.grid is not None:
            there = [one for one in runs if one.there]
            real = [real_masks(one, own.images) for one in there]
            report.table("Cores and what surrounds them, medians", cores(there, real))
            picture, said = grid(there, real)
            save(picture, own.grid)
            report.stage(f"{own.grid}: real are {said}")
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            missing = [f"Not there yet: {CALLED[one.name]}." for one in runs if not one.there]
            told = [f"- {one}." for one in differences(runs)]
            words = ["\n".join(["## What differs between the sets\n", *told])] if told else []
            page = "\n\n".join([report.head(__doc__), *missing, *words, *report.sections()])
            (report.docs / "likeness.md").write_text(page, encoding="utf-8")

    command("likeness", run, others)


if __name__ == "__main__":
    main()
