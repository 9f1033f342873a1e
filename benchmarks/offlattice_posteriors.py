"""Posteriors of the off-lattice model for the three sets of colonies of Li et al. 2024: theirs, and better ones.

Li et al. published posteriors of five parameters for two strains of yeast on two media, from chains of ABC-MCMC so
short that most never left the neighbourhood of their starts. Compared here, set by set:

- published: summaries of the stored chains, all rows;
- protocol reproduced: their ABC-MCMC as they ran it, as many chains and steps (`yeastfit.LI2024`);
- ABC-SMC to the same ε: the target of their chains, I_F, I_R and I_B of one colony within ε of the data's means,
  without the memory of starts; populations of weighted draws, not adjusted;
- emulator, I_F, I_R, I_B: a neural likelihood of single colonies; the data are the means of 14, 13 and 14 colonies, and
  the emulator says how far means of as many differ by chance. Nothing is accepted or rejected, there is no ε. It
  learns from the protocol's simulations, too;
- emulator, 5 statistics of single colonies: I_F, I_R, I_B of smoothed outlines, because I_B of photographs counts bumps
  of a pixel that simulated masks have not (`docs/recovery-offlattice.md`), branch length and compactness, of the 8
  colonies of each set that are in `data/real`. Means of photographs are known as well as outlines are (4 to 13 %,
  `docs/outlines.md`), which the other methods do not consider. Simulated masks are theirs, of bins of 4 pixels, without
  their frame of 1400 × 1800 pixels, which cuts wide colonies off.

Simulations are matched in area as theirs are, to 0.975 of the mean area of the data. Priors are their beta densities. A
published mean is reproduced where it lies within 3 √2 of its standard error, which the scatter of the chains gives; a
drift, from the mean of the first 100 states of all chains to that of their last, has the same sign, as far as errors
let it: beside each stands the chance that a second run of the same chains has the published sign, N(published drift,
sum of the squares of both errors) being that run's. Seconds are of all sittings, by the clock and of the processors; on
a machine that others use the former say little.

Targets: protocol and published means within 3 √2 standard errors, acceptance rates within 3 errors of both; of an
emulator R-hat ≤ 1.01, effective size ≥ 1000.

    python -m benchmarks.offlattice_posteriors [--quick] [--json FILE] [--docs DIR] [--work DIR] [--set NAME]
                                               [--method NAME] [--steps N] [--threads N] [--page]

Every posterior is kept in the folder given by --work, out/offlattice by default, with all its simulations; an
interrupted run goes on there. --set and --method restrict what is computed, --page computes nothing: the page is of all
that is there, and says what is not. --steps stops the protocol's chains early, to go on another time. Colonies grow on
N threads, by default one a core.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.stats import gaussian_kde, norm

from benchmarks.li2024_published import PUBLISHED_POSTERIORS, Published
from benchmarks.offlattice_runs import FIVE, METHODS, SEED, Run, Sizes, real_colonies
from benchmarks.offlattice_words import SYMBOLS, in_words, missing, title
from benchmarks.report import Report, command
from yeastfit.inference.abc.distances import LiDistance
from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.li2024 import LI2024, Li2024Colonies
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.result import Posterior
from yeastfit.offlattice.colony import grow, in_threads
from yeastfit.offlattice.masks.area_matching import search_from_below
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import PARAMETERS

NAMES = PARAMETERS.names
COLOURS = {"protocol": "#7a5230", "smc": "#2563a8", "emulator-theirs": "#3f8f4f", "emulator": "#c2410c"}
ERRORS = 3 * np.sqrt(2)
TINY = TrainingSettings(members=2, width=16, steps=100)
QUICK = Sizes(
    sets={key: replace(one, cells=1500, area=22_000, tolerance=0.3, chains=6, steps=5) for key, one in LI2024.items()},
    emulator=SequentialEmulator(256, first=128, walkers=16, most_steps=500, batch=32, training=TINY),
    smc=AbcSmc(population=20, simulations=400, batch=20, distance="li", adjust=False),
    at_mean=2,
)


def study(report: Report, sizes: Sizes, runs: list[Run], wanted: list[Run]) -> None:
    """Compute what is wanted and missing, then report on all that is there."""
    for run in wanted:
        report.stage(f"{run.key}: {METHODS[run.method]}")
        run.infer(report.stage)
    found = {(run.key, run.method): run.posterior() for run in runs if run.there}
    beyond = dict[tuple[str, str], float]()
    for key, colonies in sizes.sets.items():
        mine = {run.method: run for run in runs if run.key == key}
        results = {method: found[key, method] for method in METHODS if (key, method) in found}
        names = {method: run.name for method, run in mine.items()}
        report.table(f"{colonies.name}: parameters", parameters(key, results, names))
        report.table(f"{colonies.name}: cost", [cost(mine[method], results.get(method)) for method in METHODS])
        at_mean(report, key, colonies, sizes.at_mean)
        for method, posterior in results.items():
            judged(report, f"{colonies.name}, {names[method]}", method, posterior)
            beyond[key, method] = cut_off(report, mine[method], posterior)
        if "protocol" in results:
            protocol(report, mine["protocol"], results["protocol"], results.get("smc"))
        for method in ("emulator", "emulator-theirs"):
            if method in results:
                reach(report, mine[method], results[method])
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        picture(sizes, found).savefig(report.docs / "offlattice.png", dpi=70)
        words = [line for key in sizes.sets for line in in_words([run for run in runs if run.key == key], beyond)]
        text = [report.head(__doc__), CAPTION, missing(runs), "## In words", "\n".join(words), *report.sections()]
        (report.docs / "offlattice.md").write_text("\n\n".join(text))


CAPTION = """![Marginals](offlattice.png)

Marginal densities, with the prior dotted. The published posterior, of which only summaries are known here, is the bar:
5 %, 50 % and 95 % quantiles, a dot at the mean."""


def parameters(key: str, results: dict[str, Posterior], names: dict[str, str]) -> list[dict[str, Any]]:
    """Means, medians and intervals side by side."""
    theirs = PUBLISHED_POSTERIORS[key]
    rows = []
    for k, name in enumerate(NAMES):
        about = {"parameter": f"{SYMBOLS[k]} {name.replace('_', ' ')}"}
        interval = f"{theirs.low[k]:.3f} to {theirs.high[k]:.3f}"
        row = about | {"posterior": "published", "mean": theirs.mean[k], "median": theirs.median[k]}
        rows.append(
            row | {"90 % interval": interval, "effective size": theirs.size[k], "mean − published, errors": None}
        )
        for method, found in results.items():
            low, high = found.interval(0.9)[k]
            row = about | {"posterior": names[method], "mean": float(found.mean[k])}
            row |= {"median": float(found.quantile(0.5)[k]), "90 % interval": f"{low:.3f} to {high:.3f}"}
            row["effective size"] = int(effective(method, found)[k])
            rows.append(row | {"mean − published, errors": float((found.mean[k] - theirs.mean[k]) / theirs.error[k])})
    return rows


def effective(method: str, found: Posterior) -> Float[np.ndarray, " free"]:
    """Independent draws: of the protocol as for the published chains, from the scatter of the chains' means."""
    if method != "protocol":
        return found.effective_size
    return (found.sd / chain_error(found)) ** 2


def chain_error(found: Posterior) -> Float[np.ndarray, " free"]:
    """Standard error of the mean, from the scatter of the chains' means."""
    means = found.values.mean(axis=1)
    return means.std(axis=0, ddof=1) / np.sqrt(len(means))


def cost(run: Run, found: Posterior | None) -> dict[str, Any]:
    """Simulations and seconds."""
    row: dict[str, Any] = {"posterior": run.name, "data": f"mean of {run.observed[1]} colonies"}
    if found is None:
        return row | dict.fromkeys(("simulations", "accepted, %", "seconds", "processor seconds", "status"), "")
    seconds, accepted = (
        run.seconds(),
        100 * float(np.ravel(found.acceptance)[-1 if run.method == "smc" else slice(None)].mean()),
    )
    row |= {"simulations": found.simulations, "accepted, %": accepted, "seconds": seconds["clock"]}
    return row | {"processor seconds": seconds["processor"], "status": str(found.status)}


def judged(report: Report, what: str, method: str, found: Posterior) -> None:
    """Add R-hat and effective size."""
    target = method.startswith("emulator") and not report.quick
    if found.chains is not None:
        report.add(
            f"{what}: split R-hat, largest", float(found.chains.r_hat.max()), "", 1.01 if target else None, False
        )
    least = float(effective(method, found).min())
    report.add(f"{what}: effective size, least", least, "", 1000 if target else None)


def protocol(report: Report, run: Run, found: Posterior, long: Posterior | None) -> None:
    """Add acceptance, means and drifts, next to the published ones; chains that were stopped have no targets."""
    theirs, name = PUBLISHED_POSTERIORS[run.key], f"{run.colonies.name}, {run.name}"
    target = run.finished and not report.quick
    share = found.acceptance.mean()
    error = found.acceptance.std(ddof=1) / np.sqrt(len(found.acceptance))
    apart = float(abs(share - theirs.acceptance) / np.hypot(error, 0.01))
    note = f"{100 * share:.1f} ± {100 * error:.1f} %, published {100 * theirs.acceptance:.1f} %"
    report.add(f"{name}: acceptance − published, in errors", apart, "", 3 if target else None, False, note)
    off = float(np.max(np.abs(found.mean - theirs.mean) / np.array(theirs.error)))
    report.add(f"{name}: means − published, in their errors, largest", off, "", ERRORS if target else None, False)
    rows = drifts(theirs, found, long)
    expected = f"{sum(row['its chance, %'] for row in rows) / 100:.1f} are expected of a second run of the same chains"
    same = sum(row["same sign"] == "yes" for row in rows)
    report.add(f"{name}: drifts of the published sign", same, f"of {len(rows)}", note=expected)
    report.table(f"{name}: drifts of the chains", rows)


def drifts(theirs: Published, found: Posterior, long: Posterior | None) -> list[dict[str, Any]]:
    """From the first 100 states to the last, published and here, and where ABC-SMC says it goes."""
    first = found.values[:, :100].mean(axis=(0, 1))
    last = found.values[:, -1]
    spread = last.std(axis=0, ddof=1) / np.sqrt(len(last))
    rows = []
    for k in range(len(NAMES)):
        before, now = theirs.last[k] - theirs.early[k], float(last[:, k].mean() - first[k])
        row: dict[str, Any] = {"parameter": SYMBOLS[k], "published, first 100": theirs.early[k]}
        row |= {"published, last": theirs.last[k], "error": theirs.last_error[k], "here, first 100": float(first[k])}
        row |= {"here, last": float(last[:, k].mean()), "error of that": float(spread[k])}
        row |= {"same sign": "yes" if before * now > 0 else "no"}
        row["its chance, %"] = 100 * float(norm.cdf(abs(before) / np.hypot(theirs.last_error[k], spread[k])))
        rows.append(row | {"ABC-SMC, mean": None if long is None else float(long.mean[k])})
    return rows


def at_mean(report: Report, key: str, colonies: Li2024Colonies, count: int) -> None:
    """Grow colonies at the published mean."""
    theirs = PUBLISHED_POSTERIORS[key]

    def one(seed: int) -> tuple[float, ...]:
        colony = grow(theirs.mean, cells=colonies.cells, seed=seed)
        matched = search_from_below(BinnedOutlines.of(colony).mask, colony.x.size, colonies.area)
        share = colony.pseudohyphal[: matched.cells].mean()
        return colony.attempts / colonies.cells, matched.cells, float(share), matched.area / colonies.area

    kept = report.part(f"{key}, {count} colonies at the mean", lambda: in_threads(one, range(count), None))
    mean, error = np.mean(kept, axis=0), np.std(kept, axis=0, ddof=1) / np.sqrt(count)
    what = ("attempts per cell", "cells kept", "pseudohyphal share of them", "area over A*")
    expected = (theirs.attempts, theirs.kept, theirs.pseudohyphal, 0.975)
    columns = zip(what, expected, mean.tolist(), error.tolist(), strict=True)
    rows = [{"quantity": a, "expected": b, "here": c, "error": d} for a, b, c, d in columns]
    report.table(f"{colonies.name}: {count} colonies at the published mean", rows)


def cut_off(report: Report, run: Run, found: Posterior) -> float:
    """Add which share of the colonies at draws of a posterior Li et al.'s frame cuts off, in per cent."""
    colonies, count = run.colonies, run.sizes.at_mean

    def one(job: tuple[list[float], int]) -> bool:
        colony = grow(job[0], cells=colonies.cells, seed=job[1])
        mask = search_from_below(BinnedOutlines.of(colony).mask, colony.x.size, colonies.area).mask
        return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())

    draws = found.drawn(count, np.random.default_rng(SEED)).tolist()
    cut = 100 * float(np.mean(in_threads(one, list(zip(draws, range(count), strict=True)), None)))
    report.add(f"{colonies.name}, {run.name}: colonies that the frame cuts off", cut, "%", note=f"of {count} at draws")
    return cut


def reach(report: Report, run: Run, found: Posterior) -> None:
    """Add what the model can reach: over the prior, and at the posterior."""
    observed, replicates = run.observed
    _, statistics = run.simulations()
    whole = np.isfinite(statistics).all(axis=1)
    statistics = statistics[whole][: run.sizes.emulator.round_sizes(len(NAMES))[0]]
    drawn = found.statistics.reshape(-1, len(observed))
    rows = []
    for k, name in enumerate(run.statistics):
        mine, means = statistics[:, k], drawn[:, k]
        row: dict[str, Any] = {
            "statistic": title(name),
            "observed mean": float(observed[k]),
        }
        if run.method == "emulator":
            row["sd of real colonies"] = float(real_colonies(run.key, FIVE)[:, k].std(ddof=1))
        row |= {"prior, median": float(np.median(mine)), "largest": float(mine.max()), "least": float(mine.min())}
        row["prior beyond observed, %"] = 100 * float(min((mine >= observed[k]).mean(), (mine <= observed[k]).mean()))
        row |= {"predicted mean": float(means.mean()), "sd": float(means.std())}
        rows.append(row | {"observed − predicted, sd": float((observed[k] - means.mean()) / means.std())})
    about = f"{run.colonies.name}, {METHODS[run.method]}: what the model reaches"
    report.table(f"{about} (predicted: means of {replicates} colonies)", rows)
    if run.method == "emulator-theirs":
        distances = LiDistance(observed)(statistics)
        note = f"of {len(distances)} colonies from the prior; their ε is {run.colonies.tolerance:g}"
        report.add(f"{run.colonies.name}: least distance d", float(distances.min()), "", note=note)


def picture(sizes: Sizes, found: dict[tuple[str, str], Posterior]) -> Figure:
    """Marginals laid over each other: a row for each set, a column for each parameter."""
    figure = Figure(figsize=(16, 3.4 * len(sizes.sets)), layout="constrained")
    panels = figure.subplots(len(sizes.sets), len(NAMES), squeeze=False)
    grid = np.linspace(0.002, 0.998, 250)
    for row, (key, colonies) in zip(panels, sizes.sets.items(), strict=True):
        theirs = PUBLISHED_POSTERIORS[key]
        for k, panel in enumerate(row):
            prior = colonies.prior.distributions[NAMES[k]].density
            panel.plot(grid, prior.pdf(grid), "k:", lw=1, label="prior")
            for method, colour in COLOURS.items():
                if (key, method) in found:
                    panel.plot(grid, density(found[key, method], k)(grid), color=colour, label=METHODS[method])
            height = -0.06 * panel.get_ylim()[1]
            panel.plot([theirs.low[k], theirs.high[k]], [height, height], "k", lw=3, label="published")
            panel.plot([theirs.median[k]], [height], "w|", ms=9)
            panel.plot([theirs.mean[k]], [height], "ko", ms=6)
            panel.set(xlim=(0, 1), yticks=[], xlabel=f"{SYMBOLS[k]} ({NAMES[k].replace('_', ' ')})")
        row[0].set_ylabel(colonies.name)
    legend = panels[0, 0].get_legend_handles_labels()
    figure.legend(*legend, loc="outside lower center", ncols=len(legend[0]), frameon=False)
    return figure


def density(found: Posterior, k: int) -> Callable[[np.ndarray], np.ndarray]:
    """Kernel density of one parameter."""
    drawn = found.drawn(2000, np.random.default_rng(SEED))[:, k]
    return gaussian_kde(drawn) if np.ptp(drawn) > 0 else lambda at: np.zeros(len(at))


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/offlattice"))
    parser.add_argument("--set", choices=list(LI2024))
    parser.add_argument("--method", choices=list(METHODS))
    parser.add_argument("--steps", type=int)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--page", action="store_true")
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        sizes, folder = (QUICK, "quick") if quick else (Sizes(), "full")
        runs = [
            Run(key, method, sizes, own.work / folder, own.threads, own.steps)
            for method in METHODS
            for key in sizes.sets
        ]
        asked = [one for one in runs if own.set in (None, one.key) and own.method in (None, one.method)]
        study(report, sizes, runs, [] if own.page else asked)

    command("offlattice_posteriors", run, others)


if __name__ == "__main__":
    main()
