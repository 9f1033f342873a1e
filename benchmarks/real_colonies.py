"""What the runs of real colonies say: parameters, predictions, colonies left out, and what is not there yet.

Three sets of real colonies (`data/real`), seen by the off-lattice model, by the algebraic one, and by that in a dish
that runs out of nitrogen. This page is made from the folders of runs of `yeastfit infer`, WORK/MODEL/SET, whatever of
them is there:

    cd data/real
    more="--model offlattice --variation --leave-out 4 --most-steps 60000"
    yeastfit infer awri796-50um $more --cells 45000 --out WORK/offlattice/awri796-50um
    yeastfit infer awri796-500um $more --cells 90000 --out WORK/offlattice/awri796-500um
    yeastfit infer simi-white-50um $more --cells 65000 --out WORK/offlattice/simi-white-50um
    yeastfit compare WORK/offlattice/* --out WORK/comparison

    three="--statistics filament_area_index,filament_radius_index,angular_index --variation --leave-out 4"
    more="$three --match area --capacity 30000 --batch 8 --simulations 1024 --first 256 --each 128 --draws 20
        --prior-draws 0 --free mobility,metabolic_rate,diffusivity,aspect_ratio"
    yeastfit infer awri796-50um $more --area 142000 --out WORK/algebraic/awri796-50um
    yeastfit infer awri796-500um $more --area 257000 --out WORK/algebraic/awri796-500um
    yeastfit infer simi-white-50um $more --area 203000 --out WORK/algebraic/simi-white-50um
    more="$three --medium nitrogen --nitrogen-per-birth 150 --nitrogen-uptake 0 --length 23.7 --rate 0.1 --spacing 0.4
        --dt 0.025 --substeps 4 --capacity 30000 --batch 8 --simulations 4096 --first 256 --each 256
        --draws 20 --prior-draws 0 --prior nitrogen.toml --free mobility,metabolic_rate,aspect_ratio,nitrogen"
    yeastfit infer awri796-50um --most-steps 60000 $more --out WORK/nitrogen/awri796-50um
    yeastfit infer awri796-500um --most-steps 60000 $more --out WORK/nitrogen/awri796-500um
    yeastfit infer simi-white-50um --most-steps 60000 $more --out WORK/nitrogen/simi-white-50um
    more="--most-steps 260000 $more"
    yeastfit infer awri796-50um $more --births clocks --cycle-variation 0.2 --out WORK/clocks/awri796-50um
    yeastfit infer awri796-50um $more,death_rate --death starvation --out WORK/death/awri796-50um
    yeastfit infer awri796-50um $more,budding_bias --budding polar --polarity 1 --out WORK/polar/awri796-50um
    more="$three --model offlattice --most-steps 60000"
    yeastfit infer awri796-50um $more --cells 45000 --out WORK/offlattice-3/awri796-50um
    yeastfit infer awri796-500um $more --cells 90000 --out WORK/offlattice-3/awri796-500um
    yeastfit infer simi-white-50um $more --cells 65000 --out WORK/offlattice-3/simi-white-50um
    for one in awri796-50um awri796-500um simi-white-50um; do  # of the folders those that are there
        yeastfit compare WORK/{algebraic,nitrogen,clocks,death,polar,offlattice-3}/$one --out WORK/models/$one
    done
    yeastfit compare WORK/nitrogen/* --out WORK/nitrogen-compared

Colonies of the algebraic model are grown to a tenth of the photographed area: a thousand take an hour of a processor,
and not ten. In a dish with nitrogen they are grown to the photographed time. The three statistics are of shape alone:
how large a colony is, and so L0, 23.7 µm here, is not asked. The priors of `nitrogen.toml` are log-uniform: mobility
0.1 to 10, metabolic_rate 0.02 to 5, aspect_ratio 0.15 to 1, nitrogen 3 to 100, death_rate 0.01 to 10, budding_bias 0.1
to 30. Further rules were tried on the first set: births by clocks, death by starvation, polar budding. The off-lattice
model is asked by these three statistics, too (`offlattice-3`), so that models are compared on the same data.

A posterior that has not settled says nothing of the yeast. For such a one the page asks why: it looks at the colonies
that the run has simulated where its posterior is (in the central 80 % of every parameter). The likelihood takes the
statistics of one colony for normally distributed; excess kurtosis, 0 then, and the largest colony beside the 95 %
quantile say whether they are.

    python -m benchmarks.real_colonies --work WORK --docs docs
"""

import argparse
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.stats import kurtosis

from benchmarks.real_answers import CALLED, answers, comparison_in
from benchmarks.report import Report, command
from yeastfit.commands.posterior_run.run import SIMULATIONS
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.neural_likelihood.single_colonies import wide_scatter
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.variation import NAME as VARIATION
from yeastfit.inference.prior.variation import Variation
from yeastfit.measure.measurements_table import TABLE, read_measurements
from yeastfit.results.contents import MANIFEST, RUN
from yeastfit.storage import read_json

SETS = tuple(CALLED)
DATA = Path(__file__).parents[1] / "data" / "real"
MODELS = ("offlattice", "offlattice-3", "algebraic", "nitrogen")
TRIED = ("clocks", "death", "polar")  # with nitrogen, on the first set
RUNS = [*((model, name) for model in MODELS for name in SETS), *((rule, SETS[0]) for rule in TRIED)]
HEAVY = 10.0  # excess kurtosis from where a statistic is called heavy-tailed
MIDDLE = (0.1, 0.9)
NEAR = 1.5  # a factor by which a statistic may be off
FEWEST = 50  # simulations that are worth looking at


def judge(report: Report, work: Path) -> list[str]:
    """Fill the report with what is there; sentences of what it means."""
    said = []
    for model, name in RUNS:
        folder, title = work / model / name, f"{name}, {model}"
        found = _run(report, folder, title) if (folder / MANIFEST).is_file() else _unfinished(folder)
        said.append(f"**{title}**: {' '.join(found)}")
    said += _conditions(report, work / "comparison", "off-lattice model")
    said += _conditions(report, work / "nitrogen-compared", "algebraic model with nitrogen")
    return said + [one for name in SETS for one in _models(report, work / "models" / name)]


def _conditions(report: Report, folder: Path, model: str) -> list[str]:
    """What `yeastfit compare` found of conditions, under one model."""
    names = ("parameter", "first", "second", "median_first", "median_second")
    ratio = ("ratio", "ratio_q05", "ratio_q95", "first_larger", "error", "told_apart")  # of the first to the second
    return _verdicts(report, folder, f"Conditions compared, {model}", "conditions", names + ratio)


def _models(report: Report, folder: Path) -> list[str]:
    """What it found of the models, on the same colonies by three statistics."""
    names = ("run", "log_density", "standard_error", "behind_best", "error_of_that", "inside_50_%", "inside_90_%")
    return _verdicts(report, folder, f"Models compared, {folder.name}", "models", names)


def _verdicts(report: Report, folder: Path, title: str, table: str, names: tuple[str, ...]) -> list[str]:
    """A table of a comparison, and in words what it means and whether it is to be doubted."""
    if (found := comparison_in(folder)) is None:
        return [f"**{title}**: not there yet."]
    report.table(title, [{name: row[name] for name in names} for row in found[table]])
    doubt = f", to be doubted ({'; '.join(found['doubts'])})" if found["doubts"] else ""
    return [f"**{title}**{doubt}: {'; '.join(found['verdicts'])}."]


def _run(report: Report, folder: Path, title: str) -> list[str]:
    """One run: its figures and tables, and what they mean."""
    posterior, kept = Posterior.load(folder / "posterior.npz"), folder / "predictive.npz"
    predicted = Predictive.load(kept) if kept.is_file() else None  # where too few simulations succeeded
    reused = getattr(posterior.diagnostics, "reused", 0)
    made = f"{posterior.simulations} colonies" + (f", and {reused} of earlier runs (`--reuse`)" if reused else "")
    report.add(f"{title}: settled", float(posterior.settled), "", 1, note=made)
    ends = posterior.interval(0.9)
    report.table(
        f"{title}: parameters",
        [
            {"parameter": name, "mean": float(posterior.mean[k]), "5 %": float(ends[k, 0]), "95 %": float(ends[k, 1])}
            for k, name in enumerate(posterior.free)
        ],
    )
    outside = list[str]()
    if predicted is not None:
        report.table(f"{title}: means of {predicted.replicates} colonies", predicted.rows())
        outside = [label for label, one in zip(predicted.labels, predicted.inside(0.9), strict=True) if not one]
    said = [f"{posterior.status}."]
    how = read_json(folder / RUN)["configuration"]
    if how.get("match") == "area" and how["area"] is not None:
        said.insert(0, f"colonies of {how['area'] / 1e6:.3g} mm² beside photographed ones of {_mean_area(folder):.3g};")
    if predicted is None:
        said.append("Too few simulations of it succeed for a prediction.")
    else:
        inside = "It predicts its data."
        said.append(f"Outside what its posterior predicts: {', '.join(outside)}." if outside else inside)
    if VARIATION in posterior.free:
        tau = float(posterior.mean[posterior.free.index(VARIATION)])
        said += [f"To be doubted: {one}." for one in wide_scatter(Variation(**how["variation"]), tau)]
    if not posterior.settled:
        said += [*_tails(report, folder, posterior, title), "Its parameters are no result."]
    if (folder / "left_out.npz").is_file():
        found = LeftOut.load(folder / "left_out.npz")
        report.add(f"{title}: left out, inside 90 %", found.coverage(0.9), "", 0.8)
        report.table(f"{title}: colonies left out", found.rows())
        said.append(f"{found.sentence()}.")
    return said


def _unfinished(folder: Path) -> list[str]:
    """Of a run without a posterior: how near its colonies come to the data."""
    if not (folder / SIMULATIONS).is_file():
        return ["not there yet."]
    names = read_json(folder / RUN)["configuration"]["statistics"]
    observed = np.array([[row[name] for name in names] for row in read_measurements(DATA / folder.name / TABLE)], float)
    return ["there is no posterior.", _nearest(_simulations(folder)["statistics"], observed.mean(axis=0))]


def _simulations(folder: Path) -> np.ndarray:
    """All that a run has simulated."""
    with h5py.File(folder / SIMULATIONS) as file:
        rows: np.ndarray = file["simulations"][...]
    return rows[rows["check"] != 0]


def _mean_area(folder: Path) -> float:
    """Of the photographed colonies of a run, in mm²."""
    return float(np.mean([row["area"] for row in read_measurements(DATA / folder.name / TABLE)])) / 1e6


def _tails(report: Report, folder: Path, posterior: Posterior, title: str) -> list[str]:
    """How single colonies scatter that were simulated where the posterior is."""
    rows = _simulations(folder)
    reached = _nearest(rows["statistics"], posterior.observed)
    count = rows["values"].shape[1]  # without how much colonies vary
    low, high = (posterior.quantile(share)[:count] for share in MIDDLE)
    statistics = rows["statistics"][((rows["values"] > low) & (rows["values"] < high)).all(axis=1)]
    statistics = statistics[np.isfinite(statistics).all(axis=1)]
    if len(statistics) < FEWEST:
        return [reached, f"Only {len(statistics)} colonies were simulated where its posterior is."]
    table: list[dict[str, Any]] = []
    for k, label in enumerate(posterior.labels):
        one = statistics[:, k]
        quantiles = dict(zip(("5 %", "median", "95 %"), np.quantile(one, (0.05, 0.5, 0.95)).tolist(), strict=True))
        row = {"statistic": label, "observed mean": float(posterior.observed[k]), "simulated mean": float(one.mean())}
        table.append(
            {**row, "sd": float(one.std()), **quantiles, "largest": float(one.max()), "kurtosis": float(kurtosis(one))}
        )
    report.table(f"{title}: {len(statistics)} single colonies simulated where its posterior is", table)
    heavy = [str(row["statistic"]) for row in table if row["kurtosis"] > HEAVY]
    return [
        reached,
        f"Single colonies there are far from normally distributed in {', '.join(heavy)}: rare ones with a large value "
        "widen the likelihood there, and may be why it takes data for likely which most colonies miss."
        if heavy
        else "Single colonies there are not far from normally distributed.",
    ]


def _nearest(statistics: np.ndarray, observed: np.ndarray) -> str:
    """How near single colonies come to the means of the data: by what factor the worst statistic is off."""
    statistics = statistics[(statistics > 0).all(axis=1)]
    if not len(statistics):
        return "No colony that was simulated has all statistics."
    off = np.exp(np.abs(np.log(statistics / observed)).max(axis=1))
    return (
        f"Of {len(off)} colonies simulated in all, {int((off < NEAR).sum())} come within a factor of {NEAR} of the "
        f"data's means in all statistics; the nearest is off by {off.min():.2f}."
    )


def _section(title: str, sentences: list[str]) -> str:
    return f"## {title}\n\n" + "\n".join(f"- {one}" for one in sentences) + "\n\n"


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the option of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/real"))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        said = judge(report, own.work)
        done = [{"run": "/".join(one), "version of yeastfit": _made(own.work.joinpath(*one))} for one in RUNS]
        report.table("runs", done)
        if report.docs is not None:
            words = _section("Answers", answers(own.work))
            picture = own.work / "comparison" / "marginals.png"
            if picture.is_file():
                shutil.copyfile(picture, report.docs / "real.png")
                words += "![Posterior densities](real.png)\n\nPosterior densities of every parameter, by set.\n\n"
            words += _section("Run by run", said)
            text = "\n".join([report.head(__doc__), "", words, *report.sections()])
            (report.docs / "real.md").write_text(text, encoding="utf-8")

    command("real_colonies", run, others)


def _made(folder: Path) -> str:
    """Version that a run was made by."""
    return str(read_json(folder / RUN)["versions"].get("yeastfit", "")) if (folder / RUN).is_file() else "not there yet"


if __name__ == "__main__":
    main()
