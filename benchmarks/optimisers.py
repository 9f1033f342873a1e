"""The cost of a fit compared with other optimisers: simulated colonies until the same residual is reached.

Data: the curves of data/synthetic/demo, with mobility, metabolic rate and aspect ratio free. All methods are judged by
the exact mean: χ²(θ) = (m(θ) − y)ᵀ Σ⁻¹ (m(θ) − y), with Σ at the true parameters and m from a response surface over
±0.2 in log λ around them, fitted to 1536 colonies that are not counted. A run has arrived when the best point that it
has found, by its own criterion, is within 2 of the smallest χ² on that surface. Large ensembles at the points found
check the surface.

The alternatives minimise χ² with m the mean of 64 colonies whose keys stay the same. They have the same bounds, the
same unbounded coordinates z (`parameter_space`), the same model, time step and estimator, and one run from each of the
three starts that `yeastfit.fit` chose:

- the Nelder–Mead simplex (SciPy), with edges of 0.5 in z;
- `scipy.optimize.least_squares` with forward differences of 0.1 in log λ. Its default step, 1e-8, is useless here:
  colonies are chaotic, the mean of 64 with fixed keys jumps, and differences on that scale show only the jumps;
- CMA-ES (package cma), with step 0.5 in z and default populations.

`yeastfit.fit` runs with default settings but without refinement, which changes the model and which the others would
need as well. All are stopped, or counted, when they arrive, which a user would not know. A single run may end in the
valley where only the product of mobility and metabolic rate matters. So three starts are compared, run in parallel
until one of them arrives: an alternative costs three times its shortest run; `yeastfit.fit` costs every colony that it
simulates, screening included, until it arrives, and until it stops by itself. `yeastfit.fit` from a single start is
listed, too. Every seed has its own keys. A run that has not arrived within the budget, or stops elsewhere, counts as
infinitely long in the median. To save time, a run of an alternative ends at 1.5 times the median number of colonies of
the best alternative before it.

Targets: the best alternative needs at least 3 times the colonies of `yeastfit.fit`, medians over seeds.

    python -m benchmarks.optimisers [--quick] [--json FILE] [--docs DIR]

With --json, an interrupted run continues. --quick: five times up to 8 h, with the metabolic rate held, as such data do
not distinguish it from mobility; small ensembles, one seed, one start, no target. --docs writes DIR/optimisers.md and
DIR/optimisers.png.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.contest import ALTERNATIVES, MARGIN, Contest, Objective, Stopped
from benchmarks.report import Report, command
from yeastfit import Fit, FitSettings, InputError, Targets, fit, measure_dataset, read_dataset
from yeastfit.inference.colony_simulator import DEFAULT_FREE
from yeastfit.inference.parameter_space import Vector
from yeastfit.simulation.recipe import read_truth

DEMO = Path(__file__).parents[1] / "data" / "synthetic" / "demo"
HOPELESS = 1.5  # times the best median so far, after which a run is given up
OURS, WHOLE, FEWER = "yeastfit.fit, one start", "yeastfit.fit", 3.0


@dataclass(frozen=True)
class Size:
    """How much is computed.

    Attributes:
        members: Colonies of an alternative's ensemble.
        judges: Colonies of the response surface.
        witnesses: Colonies of an ensemble that checks it.
        budget: Colonies of a run, at most.
        seeds: Of every method.
        starts: Of every alternative.
        times: How many times of the data are used.
        free: Names of the free parameters.
        settings: Of `yeastfit.fit`.
    """

    members: int = 64
    judges: int = 1536
    witnesses: int = 384
    budget: int = 6400
    seeds: tuple[int, ...] = (1, 2, 3)
    starts: int = 3
    times: int = 11
    free: tuple[str, ...] = DEFAULT_FREE
    settings: FitSettings = field(default_factory=lambda: FitSettings(refined=0))


QUICK = Size(
    members=8,
    judges=128,
    witnesses=64,
    budget=480,
    seeds=(1,),
    starts=1,
    times=5,
    free=("mobility", "aspect_ratio"),
    settings=FitSettings(screened=32, starts=1, members=(16, 32), spreads=(0.2, 0.15), max_steps=6, refined=0),
)


def alternative(contest: Contest, size: Size, name: str, seed: int, start: Vector, budget: float) -> dict[str, Any]:
    """One run of an alternative."""
    objective, began = Objective(contest, size.members, seed, budget), time.perf_counter()
    try:
        ALTERNATIVES[name](objective, contest.space.z_of(start), seed)
        ended = "stopped elsewhere"
    except Stopped:
        ended = "arrived" if objective.arrived else f"not within {budget:.0f}"
    theta = start if objective.theta is None else objective.theta
    return {
        "method": name,
        "seed": seed,
        "colonies": objective.spent,
        "seconds": time.perf_counter() - began,
        "arrived": objective.arrived,
        "ended": ended,
        "theta": theta.tolist(),
    }


def ours(contest: Contest, seed: int, start: Vector | None = None) -> dict[str, Any]:
    """A fit, from its own starts or from one: colonies until its best point arrives, and until it stops."""
    found = fit(
        contest.targets,
        contest.simulator,
        start=None if start is None else dict(zip(contest.space.names, np.exp(start), strict=True)),
        seed=seed,
        settings=contest.settings,
    )
    arrived = [(spent, theta) for spent, theta in estimates(found) if contest.rise(theta) < MARGIN]
    spent, theta = arrived[0] if arrived else (found.simulations, found.theta)
    return {
        "method": WHOLE if start is None else OURS,
        "seed": seed,
        "colonies": spent,
        "seconds": found.seconds * spent / found.simulations,
        "arrived": bool(arrived),
        "ended": "arrived" if arrived else found.message,
        "theta": theta.tolist(),
        "status": found.message,
        "whole": {"colonies": found.simulations, "seconds": found.seconds, "rise": contest.rise(found.theta)},
        "starts": [start.begin.tolist() for start in found.starts],
    }


def estimates(found: Fit) -> list[tuple[int, Vector]]:
    """Colonies so far and the best point of the stage so far; last, the estimate."""
    said, stage, cost = list[tuple[int, Vector]](), "", np.inf
    for step in found.history:
        if step.stage != stage:
            stage, cost = step.stage, np.inf
        if step.cost < cost:
            cost = step.cost
            said.append((step.simulations, np.log([step.values[name] for name in found.free])))
    return [*said, (found.simulations, found.theta)]


def median(runs: Sequence[Mapping[str, Any]]) -> float:
    """Median number of colonies; runs that did not arrive count as infinite."""
    return float(np.median([run["colonies"] if run["arrived"] else np.inf for run in runs]))


def side_by_side(runs: Sequence[Mapping[str, Any]], what: str = "colonies") -> float:
    """Cost of all starts of a seed in parallel until one arrives; median over seeds."""
    spent = []
    for seed in dict.fromkeys(run["seed"] for run in runs):
        starts = [run for run in runs if run["seed"] == seed]
        spent.append(len(starts) * min((run[what] for run in starts if run["arrived"]), default=np.inf))
    return float(np.median(spent))


def all_runs(report: Report, contest: Contest, size: Size) -> dict[str, list[dict[str, Any]]]:
    """All runs by method. Finished ones are kept and not repeated after an interruption."""
    report.stage("compiling")
    Objective(contest, size.members, 0, np.inf).residuals(contest.space.z_of(contest.best) + 1.0)
    runs: dict[str, list[dict[str, Any]]] = {WHOLE: []}
    for seed in size.seeds:
        report.stage(f"{WHOLE}, seed {seed}")
        runs[WHOLE].append(report.part(f"{WHOLE}, seed {seed}, {report.quick}", partial(ours, contest, seed)))
    for name in (OURS, *ALTERNATIVES):
        best = min((median(runs[other]) for other in ALTERNATIVES if other in runs), default=np.inf)
        budget = min(size.budget, HOPELESS * best)
        runs[name] = []
        for one in runs[WHOLE]:
            for number, start in enumerate(one["starts"][: size.starts], start=1):
                what, seed, place = f"{name}, seed {one['seed']}, start {number}", one["seed"], np.array(start)
                report.stage(what)
                make = (
                    partial(ours, contest, seed, place)
                    if name == OURS
                    else partial(alternative, contest, size, name, seed, place, budget)
                )
                runs[name].append(report.part(f"{what}, {report.quick}", make))
    return runs


def verdicts(report: Report, runs: Mapping[str, list[dict[str, Any]]], contest: Contest) -> None:
    """Add medians, failures and ratios to the report."""
    rows = []
    for name, done in runs.items():
        came = [run["colonies"] for run in done if run["arrived"]]
        ends = [run["ended"] for run in done if not run["arrived"]]
        note = f"{len(came)} of {len(done)} runs arrived" + (f"; {', '.join(dict.fromkeys(ends))}" if ends else "")
        report.add(f"{name}: colonies until there", side_by_side(done), "", note=note)
        report.add(f"{name}: seconds until there", side_by_side(done, "seconds"), "s")
        rows += [
            {
                "method": name,
                "seed": run["seed"],
                "colonies": run["colonies"],
                "seconds": run["seconds"],
                "ended": run["ended"],
                "χ² above minimum": contest.rise(np.array(run["theta"])),
                **{key: float(np.exp(value)) for key, value in zip(contest.space.names, run["theta"], strict=True)},
            }
            for run in done
        ]
    whole = [run["whole"] for run in runs[WHOLE]]
    rises = ", ".join(f"{one['rise']:.2f}" for one in whole)
    stopped = float(np.median([one["colonies"] for one in whole]))
    report.add(f"{WHOLE}: colonies until it stopped", stopped, "", note=f"χ² there above its minimum: {rises}")
    report.add(f"{WHOLE}: seconds until it stopped", np.median([one["seconds"] for one in whole]), "s")
    best = min(ALTERNATIVES, key=lambda name: side_by_side(runs[name]))
    target = None if report.quick else FEWER
    ratio = side_by_side(runs[best]) / side_by_side(runs[WHOLE])
    report.add("colonies, best alternative / ours", ratio, "×", target, note=best)
    seconds = side_by_side(runs[best], "seconds") / side_by_side(runs[WHOLE], "seconds")
    report.add("seconds, best alternative / ours", seconds, "×", note=best)
    report.add(
        "colonies, best alternative / ours until it stopped",
        side_by_side(runs[best]) / stopped,
        "×",
        note="the alternative is stopped when it arrives",
    )
    one = min(ALTERNATIVES, key=lambda name: median(runs[name]))
    note = f"{one}; medians over all runs; those that did not arrive count as infinite"
    report.add(
        "colonies, best alternative / ours, one start each", median(runs[one]) / median(runs[OURS]), "×", note=note
    )
    report.table("runs", rows)


def checked(report: Report, contest: Contest, runs: Mapping[str, list[dict[str, Any]]], members: int) -> None:
    """Compare the surface with ensembles at its minimum and where one run of each method arrived."""
    places = {"minimum": contest.best}
    for name, done in runs.items():
        if came := [run for run in done if run["arrived"]]:
            places[name] = np.array(came[0]["theta"])
    direct = {}
    for name, theta in places.items():
        report.stage(f"checking the surface: {name}")
        direct[name] = report.part(f"direct, {name}, {report.quick}", partial(contest.directly, theta, members))
    rows = [
        {
            "at": name,
            "χ² above minimum, on the surface": contest.rise(theta),
            "of the ensemble": direct[name] - direct["minimum"],
        }
        for name, theta in places.items()
    ]
    report.table(f"the response surface compared with ensembles of {members}", rows)
    off = max(abs(row["χ² above minimum, on the surface"] - row["of the ensemble"]) for row in rows)
    report.add(
        "response surface, largest difference from ensembles", off, "of χ²", note=f"smallest χ² {contest.least:.1f}"
    )


def picture(runs: Mapping[str, list[dict[str, Any]]], path: Path) -> None:
    """Plot the colonies of every run; crosses did not arrive."""
    figure = Figure(figsize=(8, 3), layout="constrained")
    panel = figure.subplots()
    for height, done in enumerate(runs.values()):
        away = height + np.linspace(-0.2, 0.2, len(done))
        for place, run in zip(away, done, strict=True):
            panel.plot(run["colonies"], place, "o" if run["arrived"] else "x", color=f"C{height}", ms=5)
        if np.isfinite(middle := median(done)):
            panel.plot([middle] * 2, [height - 0.35, height + 0.35], color=f"C{height}")
    panel.set(xscale="log", xlabel=f"colonies until χ² was within {MARGIN:g} of its least (×: it never was)")
    panel.set_yticks(range(len(runs)), list(runs))
    panel.invert_yaxis()
    figure.savefig(path, dpi=80)


def markdown(report: Report, size: Size) -> str:
    """The text of the page."""
    parts = [
        f"""# The cost of a fit compared with other optimisers

{report.origin}

Simulated colonies, and seconds without compilation, until the exact χ² of the best point found is within
{MARGIN:g} of its minimum ("until there"). The alternatives minimise the χ² of a mean of {size.members} colonies with
fixed keys, from the starts that `yeastfit.fit` chose, and are stopped when they arrive. Each figure is for all starts
of a seed in parallel until one arrives, as a median over seeds; that of `yeastfit.fit` includes the search for starts.
The table of runs has each of them. `python -m benchmarks.optimisers --help` has the rules.

![Colonies of every run](optimisers.png)
"""
    ]
    return "\n".join([*parts, *report.sections()])


def run(report: Report, quick: bool) -> None:
    """Measure the data, fit the surface, run all optimisers, and write the page."""
    size, truth = QUICK if quick else Size(), read_truth(DEMO)
    if truth is None:
        raise InputError(f"{DEMO}: no true parameters there, make the data set with `make data`")
    report.stage("measuring the micrographs")
    dataset = read_dataset(DEMO)
    targets = first_times(Targets.from_dataset(dataset, measure_dataset(dataset)), size.times)
    report.stage("the surface that judges")
    contest = Contest.of(targets, truth, size.free, size.settings, size.judges)
    runs = all_runs(report, contest, size)
    verdicts(report, runs, contest)
    checked(report, contest, runs, size.witnesses)
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        picture(runs, report.docs / "optimisers.png")
        (report.docs / "optimisers.md").write_text(markdown(report, size))
    report.details["runs"] = runs


def first_times(targets: Targets, count: int) -> Targets:
    """The targets up to the count-th time."""
    curves = None if targets.curves is None else targets.curves[..., :count]
    tables = {name: getattr(targets, name)[:, :count] for name in ("mean", "scatter", "replicates")}
    return replace(targets, times=targets.times[:count], curves=curves, **tables)


if __name__ == "__main__":
    command("optimisers", run)
