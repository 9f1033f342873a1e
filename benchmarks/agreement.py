"""One posterior by three methods: emulator, ABC-SMC and ABC-MCMC compared on the synthetic micrographs.

The data are reduced until they are within ABC's reach: the first four colonies at 7 and 9 hours, which makes four
numbers. The prior is narrower, too: log-uniform, mobility 0.5 to 3, metabolic rate 0.4 to 2.5, aspect ratio 0.45 to
0.9. All methods use the coarse model of the calibration, since the methods are tested here and not the model. A
simulated data set of ABC is the mean of four colonies, with measurement error. Every method runs through the code of
`yeastfit infer`, with two independent seeds:

- emulator: until it has settled;
- ABC-SMC: populations of 1000 until the budget is spent, followed by regression adjustment;
- ABC-MCMC: 32 chains at the final ε of ABC-SMC, followed by the same regression adjustment (Wegmann et al. 2009,
  doi:10.1534/genetics.109.102509).

Posterior means of log λ have Monte-Carlo errors. The emulator's follow from the effective sample size of its chains and
from its own prediction error, as a share of the variance in its likelihood. ABC's follow from a jackknife that repeats
the adjustment without parts of a population or without whole chains. z is the difference of two means divided by its
error; its rms is 1 if the errors are right.

Targets: the rms of z between methods is at most 1.5, and no two means differ by more than half a standard deviation.

    python -m benchmarks.agreement [--quick] [--json FILE] [--docs DIR] [--work DIR]

Runs are kept in the folder given by --work, out/agreement by default, and reused by the same version of the code.
--quick: one data set, one seed, tiny settings, no targets. --docs writes DIR/agreement.md and DIR/agreement.png.
"""

import argparse
import gc
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from benchmarks.calibration_models import MODEL, PRIOR
from benchmarks.recovery import BOX
from benchmarks.report import Report, code, command
from yeastfit.commands.measured_source import measure_source
from yeastfit.commands.posterior_run.config import Request
from yeastfit.commands.posterior_run.run import POSTERIOR, STORED, InferRun
from yeastfit.commands.run_folder import inputs_of
from yeastfit.inference.abc.mcmc import McmcDiagnostics
from yeastfit.inference.abc.regression_adjustment import Accepted
from yeastfit.inference.abc.smc import SmcDiagnostics
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.posterior.draws import weighted_quantile
from yeastfit.inference.posterior.result import Posterior
from yeastfit.processors import available_processors
from yeastfit.progress import silent
from yeastfit.results.folder import results_folder
from yeastfit.simulation.recipe import read_truth
from yeastfit.storage import write_table

DATA = Path(__file__).parent.parent / "data" / "synthetic"
SETS = ("demo", "slender", "compact")
COLONIES, HOURS = 4, (7.0, 9.0)
METHODS = ("emulator", "abc-smc", "abc-mcmc")
LEVEL = 0.9  # probability of intervals and regions
RMS, APART = 1.5, 0.5  # largest rms of z; largest difference of means in standard deviations
COLOURS = {"emulator": "#7a5230", "abc-smc": "#1b6ca8", "abc-mcmc": "#1b8a3a"}


@dataclass(frozen=True)
class Size:
    """How much is computed.

    Attributes:
        sets: Names of the data sets.
        seeds: Of every method.
        simulations: Of the emulator, at most.
        population: Of ABC-SMC.
        smc: Simulated data sets of ABC-SMC, at most.
        pilot: Simulated data sets of ABC's pilot.
        steps: Of each chain of ABC-MCMC.
        dt: Time step.
        spacing: Of the nutrient's grid.
    """

    sets: tuple[str, ...] = SETS
    seeds: tuple[int, ...] = (1, 2)
    simulations: int = 4096
    population: int = 1000
    smc: int = 16000
    pilot: int = 1024
    steps: int = 640
    dt: float = MODEL.dt
    spacing: float = MODEL.spacing


QUICK = Size(SETS[:1], (1,), simulations=256, population=64, smc=400, pilot=128, steps=10, dt=0.05, spacing=0.4)


@dataclass(frozen=True)
class Found:
    """One posterior: mean and standard deviation of log λ, and the error of the mean."""

    posterior: Posterior
    mean: Float[np.ndarray, " free"]
    sd: Float[np.ndarray, " free"]
    error: Float[np.ndarray, " free"]

    @property
    def x(self) -> Float[np.ndarray, "draw free"]:
        """log λ of the draws."""
        return np.log(self.posterior.flat)

    @property
    def weights(self) -> Float[np.ndarray, " draw"]:
        """Weights of the draws."""
        return self.posterior.weights.ravel()

    @property
    def epsilon(self) -> float | None:
        """The last tolerance of ABC."""
        diagnostics = self.posterior.diagnostics
        if isinstance(diagnostics, SmcDiagnostics):
            return diagnostics.tolerances[-1]
        return diagnostics.tolerance if isinstance(diagnostics, McmcDiagnostics) else None

    @staticmethod
    def of(posterior: Posterior) -> "Found":
        """From a posterior. The emulator's own error is included; draws of ABC-MCMC are adjusted."""
        size, diagnostics = posterior.effective_size, posterior.diagnostics
        if isinstance(diagnostics, McmcDiagnostics):
            size, posterior = accepted(posterior).worth(parts=len(posterior.values)), moved(posterior)
        share = 1 / size
        if isinstance(diagnostics, EmulatorDiagnostics):
            share = share + diagnostics.rounds[-1].error_share
        x, weights = np.log(posterior.flat), posterior.weights.ravel()
        mean = weights @ x
        sd = np.sqrt(weights @ (x - mean) ** 2)
        return Found(posterior, mean, sd, sd * np.sqrt(share))

    def inside(self, truth: Float[np.ndarray, " free"], level: float = LEVEL) -> tuple[list[bool], bool]:
        """Whether each log λ lies in its central interval, and all of them in the joint region."""
        low, high = np.log(self.posterior.interval(level)).T
        each = ((low <= truth) & (truth <= high)).tolist()
        covariance = np.cov(self.x.T, aweights=self.weights)
        off = np.vstack([truth, self.x]) - self.mean
        apart = np.einsum("df,df->d", off, np.linalg.solve(covariance, off.T).T)
        return each, bool(apart[0] <= weighted_quantile(apart[1:], self.weights, level))


def accepted(posterior: Posterior) -> Accepted:
    """Draws of ABC-MCMC as accepted simulations, chain by chain."""
    assert isinstance(posterior.diagnostics, McmcDiagnostics)
    statistics = posterior.statistics.reshape(-1, len(posterior.observed))
    distances = posterior.diagnostics.distance(statistics)
    weights = posterior.weights.ravel()
    return Accepted(posterior.flat, weights, statistics, distances, posterior.observed, posterior.prior)


def moved(posterior: Posterior) -> Posterior:
    """Draws of ABC-MCMC after regression adjustment."""
    values, weights, why = accepted(posterior).adjusted()
    shape = posterior.values.shape
    return replace(posterior, values=values.reshape(shape), weights=weights.reshape(shape[:2])).warned(*why)


def posterior(source: Path, folder: Path, request: Request) -> Found:
    """The draws of a run of `yeastfit infer`, continued if it was interrupted."""
    kept = folder / POSTERIOR
    if not kept.is_file():
        with results_folder(folder, "infer", resume=True) as results:
            run = InferRun.begin(request, source, results, True, available_processors(), silent)
            run.sample(lambda rows: None, silent)
            results.finish(inputs=inputs_of(source), seed=request.seed, kept=STORED)
        jax.clear_caches()
        gc.collect()
    return Found.of(Posterior.load(kept))


def few(name: str, work: Path) -> Path:
    """A table of the first colonies at two times, with the outlines measured from the whole data set."""
    measured, table = work / name / "measured", work / name / "few" / "measurements.csv"
    if table.is_file():
        return table
    data = measure_source(DATA / name, measured, available_processors(), silent)
    colonies = list(dict.fromkeys(row["replicate"] for row in data.rows))[:COLONIES]
    rows = [dict(row) for row in data.rows if row["replicate"] in colonies and row["hours"] in HOURS]
    for row in rows:
        row["mask"] = os.path.relpath(data.folder / str(row["mask"]), table.parent)
    write_table(table, rows)
    return table


def beside(name: str, seed: int, size: Size, work: Path, report: Report) -> dict[str, Found]:
    """Posteriors of the reduced data of one set, by method."""
    table, prior = few(name, work), work / "prior.toml"
    prior.write_text(PRIOR.toml())
    common: dict[str, Any] = {"prior": prior, "seed": seed}
    common["forward_model"] = Algebraic(dt=size.dt, spacing=size.spacing)
    abc = {"replicates": COLONIES, "pilot": size.pilot}
    found = dict[str, Found]()
    for method in METHODS:
        report.stage(f"{name}, seed {seed}: {method}")
        own: dict[str, Any] = {"simulations": size.simulations}
        if method == "abc-smc":
            own = {**abc, "population": size.population, "simulations": size.smc}
        elif method == "abc-mcmc":
            own = {**abc, "tolerance": found["abc-smc"].epsilon, "steps": size.steps}
        request = Request.of(method, own, **common)
        found[method] = posterior(table, work / name / f"{method}-{seed}", request)
    return found


def truth_of(name: str, free: Sequence[str]) -> Float[np.ndarray, " free"]:
    """True log λ of a data set."""
    known = read_truth(DATA / name)
    assert known is not None, name
    return np.log([known[one] for one in free])


def agree(report: Report, size: Size, work: Path) -> dict[tuple[str, int], dict[str, Found]]:
    """Posteriors of the reduced data by three methods, and their differences."""
    found = {(name, seed): beside(name, seed, size, work, report) for name in size.sets for seed in size.seeds}
    rows, runs = [], []
    scores: dict[str, list[np.ndarray]] = {"between": [], "within": []}
    widest = 0.0
    for name in size.sets:
        every = [(method, seed, found[name, seed][method]) for seed in size.seeds for method in METHODS]
        for method, seed, one in every:
            each, joint = one.inside(truth_of(name, one.posterior.free))
            runs.append(
                {
                    "set": name,
                    "method": method,
                    "seed": seed,
                    **{
                        parameter: f"{one.mean[k]:+.3f} ± {one.sd[k]:.3f} ({one.error[k]:.3f})"
                        for k, parameter in enumerate(one.posterior.free)
                    },
                    "λ in 90 % intervals": sum(each),
                    "in joint region": yes(joint),
                    "ε": one.epsilon,
                    "data sets": one.posterior.simulations,
                    "s": one.posterior.seconds,
                }
            )
        for (method, seed, one), (other_method, other_seed, other) in combinations(every, 2):
            z = (one.mean - other.mean) / np.hypot(one.error, other.error)
            if method == other_method:
                scores["within"].append(z)
                continue
            scores["between"].append(z)
            pooled = np.sqrt(0.5 * (one.sd**2 + other.sd**2))
            shift = (one.mean - other.mean) / pooled
            widest = max(widest, float(np.abs(shift).max()))
            if seed == other_seed:
                rows.append(
                    {
                        "set": name,
                        "methods": f"{method}, {other_method}",
                        "seed": seed,
                        "shift, sd": " ".join(f"{one:+.2f}" for one in shift),
                        "z": " ".join(f"{one:+.1f}" for one in z),
                        "ratio of sd": " ".join(f"{one:.2f}" for one in one.sd / other.sd),
                    }
                )
    most: tuple[float | None, float | None] = (None, None) if report.quick else (RMS, APART)
    said = "1 if errors are right"
    report.add("z of means between methods, rms", _rms(scores["between"]), "", most[0], at_least=False, note=said)
    if scores["within"]:
        report.add("z of means of one method, rms", _rms(scores["within"]), "", note=f"two seeds; {said}")
    report.add("largest difference of means between methods", widest, "sd", most[1], at_least=False)
    report.table("reduced data: mean ± sd of log λ (Monte-Carlo error of the mean)", runs)
    report.table("reduced data: pairs of methods, λ in the order " + _names(BOX), rows)
    return found


def _names(names: Sequence[str] | dict[str, Any]) -> str:
    return ", ".join(name.replace("_", " ") for name in names)


def yes(value: bool) -> str:
    """A yes or no for a table."""
    return "yes" if value else "no"


def _rms(scores: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(scores) ** 2)))


def picture(found: dict[tuple[str, int], dict[str, Found]], size: Size, path: Path) -> None:
    """Cumulative distributions by all methods and seeds, with the truth; one row per set."""
    figure = Figure(figsize=(11, 3 * len(size.sets)), layout="constrained")
    panels = figure.subplots(len(size.sets), len(BOX), squeeze=False)
    for name, row in zip(size.sets, panels, strict=True):
        for k, (parameter, panel) in enumerate(zip(BOX, row, strict=True)):
            for seed in size.seeds:
                for method, one in found[name, seed].items():
                    order = np.argsort(one.x[:, k])
                    label = method if seed == size.seeds[0] else None
                    line = np.cumsum(one.weights[order])
                    panel.plot(np.exp(one.x[order, k]), line, lw=1, color=COLOURS[method], label=label)
            panel.axvline(np.exp(truth_of(name, tuple(BOX))[k]), color="black", lw=0.8, ls="--")
            panel.set(xscale="log", xlim=BOX[parameter], xlabel=f"{name}: {parameter.replace('_', ' ')}")
            panel.xaxis.set_major_formatter("{x:g}")
            panel.xaxis.set_minor_formatter("{x:g}")
            panel.tick_params(axis="x", which="both", labelsize=7)
    panels[0, 0].legend(fontsize=8)
    panels[0, 0].set(ylabel="share of the posterior below")
    figure.savefig(path, dpi=70)


def markdown(report: Report) -> str:
    """The text of the page."""
    parts = [
        f"""{report.head(__doc__)}

![Posteriors of the reduced data](agreement.png)

Cumulative posterior distributions of the reduced data, two runs of each method; dashed: the truth.
"""
    ]
    return "\n".join([*parts, *report.sections()])


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/agreement"))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        size, work = QUICK if quick else Size(), own.work / f"{'quick' if quick else 'full'}-{code()}"
        found = agree(report, size, work)
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            picture(found, size, report.docs / "agreement.png")
            (report.docs / "agreement.md").write_text(markdown(report))

    command("agreement", run, others)


if __name__ == "__main__":
    main()
