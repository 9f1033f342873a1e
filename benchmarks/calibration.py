"""Simulation-based calibration of the emulator and of ABC-SMC.

A true λ is drawn from the prior, data are simulated at it, and a posterior is inferred from the data. If posteriors are
right, the truth is distributed like a draw from its own posterior: its rank among L independent draws is uniform on
0..L (Talts et al. 2018, arXiv:1804.06788), and a central interval of probability q contains it with probability q. This
holds for each λ and for any function of λ and data. The function used here is the log-likelihood of an emulator trained
on other simulations, from the prior alone. It detects posteriors that are right on average over the data but respond
to them too little (Modrák et al. 2023, doi:10.1214/23-BA1404). All parameters together are ranked, too: by how many
draws lie nearer to a random point than the truth (TARP, Lemos et al. 2023, arXiv:2302.03026), likewise uniform.

The algebraic model has the prior mobility 0.5 to 3, metabolic rate 0.4 to 2.5, aspect ratio 0.45 to 0.9, each log-
uniform. Colonies are young and the model is coarse, since the samplers are tested here and not the model; data and
posteriors use the same one. The data are compactness and radius. 200 posteriors are by the emulator, in 8 groups of 25
data sets: a group has one seed and one store, so its data sets share the simulations of the first round, as they do for
a user who keeps the store. 100 posteriors are by ABC-SMC with regression adjustment, of smaller data sets, in 4 groups
that share the populations drawn from the prior. With --model offlattice there are 100 posteriors by the emulator, in 4
groups of 25, of the five parameters of that model with the beta priors of Li et al. 2024; colonies are of fewer cells
than theirs.

Bands and intervals are at 95 %. Those of single parameters are binomial. The parameters of a data set are
dependent, so the interval over all of them uses the scatter between data sets. p is the probability that uniform ranks
depart at least as far from uniformity, measured by the largest departure of their ECDF from the diagonal (Säilynoja et
al. 2022, doi:10.1007/s11222-022-10090-6).

Targets: over all parameters, 50 % intervals contain 45 % to 55 % of the truths and 90 % intervals 86 % to 94 %. The
smallest p, multiplied by the number of quantities tested (Bonferroni), is at least 0.01. No posterior fails.

    python -m benchmarks.calibration [--quick] [--json FILE] [--docs DIR] [--work DIR] [--jobs N] [--method NAME]
                                     [--model NAME] [--again N] [--workers N | --scheduler tcp://HOST:PORT]

Simulations of each group and a line of JSON for each finished data set are kept in the folder given by --work,
out/calibration by default; an interrupted run continues there with the same version of the code. N groups run at a
time, each in its own process; by default N is the number of cores, since a chain uses one core. With --workers or
--scheduler groups follow each other, and worker processes simulate (docs/cluster.md); no result depends on them.
--quick: a few data sets with tiny settings, no targets. --method restricts the run to `emulator` or `abc-smc`. --again,
a number above 0, takes other truths, data and seeds, in a folder of its own: to tell what is chance. --docs writes
DIR/calibration.md and DIR/calibration.png, or DIR/calibration-NAME for one method or the off-lattice model.
"""

import argparse
import gc
import json
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from benchmarks.calibration_parts import FULL, STUDIES, Part
from benchmarks.lines import append_line, read_lines
from benchmarks.ranks import JOINT, LIKELIHOOD, Record, picture, verdicts
from benchmarks.recovery import SEED
from benchmarks.report import Report, code, command
from benchmarks.workers import add_workers, workers_of
from yeastfit.errors import InputError
from yeastfit.inference.abc.smc import SmcDiagnostics
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.posterior.calibration_ranks import joint_rank
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.simulator import Simulator, labels_of
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.workers.spread import Workers
from yeastfit.processors import available_processors
from yeastfit.seeds import Stream, stream_of


@dataclass(frozen=True)
class Study:
    """What is calibrated.

    Attributes:
        parts: One for each method.
        work: Folder of all its files.
        method: The only method, by its name on the command line; None for all.
        model: In `STUDIES`.
    """

    parts: tuple[Part, ...]
    work: Path
    method: str | None = None
    model: str = "algebraic"

    @property
    def name(self) -> str:
        """Name of the page."""
        model = None if self.model == "algebraic" else self.model
        return "-".join(["calibration", *filter(None, (model, self.method))])

    @property
    def groups(self) -> list[tuple[int, int]]:
        """Part and group of each piece of work."""
        return [(k, group) for k, part in enumerate(self.parts) for group in range(part.groups)]

    def file(self, k: int, group: int, suffix: str) -> Path:
        """Records of one group."""
        return self.work / f"{self.parts[k].method.lower()}{group:02d}.{suffix}"

    def asked(self, k: int) -> dict[str, Any]:
        """Everything that determines the records of a part."""
        part = self.parts[k]
        what = {**asdict(part), **part.model.about(), "seed": SEED, "code": code()}
        return json.loads(json.dumps(what))

    def done(self, k: int, group: int) -> list[Record]:
        """Records of a group. Raises `InputError` if one was made with other settings."""
        lines = self.file(k, group, "jsonl")
        records, asked = read_lines(lines), self.asked(k)
        if any(record["asked"] != asked for record in records):
            raise InputError(f"--work: {lines} holds data sets of other settings or other code; name another folder")
        return records

    def keep(self, k: int, group: int, record: Record) -> None:
        """Append a record."""
        append_line(self.file(k, group, "jsonl"), record)


def grow(study: Study, k: int, group: int, workers: Workers | None = None) -> None:
    """Compute the missing data sets of a group."""
    part, done = study.parts[k], {record["number"] for record in study.done(k, group)}
    numbers = [n for n in range(1, part.count + 1) if part.group(n) == group and n not in done]
    if not numbers:
        return
    simulator = part.simulator() if workers is None else part.simulator(workers.spread)
    seed = 100 * part.seed + group
    file, about = study.file(k, group, "h5"), json.dumps(study.asked(k))
    with Store(file, simulator.parameters.names, labels_of(simulator), about) as store:
        judge = part.judging(simulator, seed, store)
        for number in numbers:
            record = calibrated(part, number, simulator, seed, store, judge)
            study.keep(k, group, {"number": number, "asked": study.asked(k), **record})
            said = f"{part.method} {number} of {part.count}: {record['status']}, {record['seconds']:.0f} s"
            print(f"  {said}, ranks {record.get('rank')}", file=sys.stderr, flush=True)


def calibrated(part: Part, number: int, simulator: Simulator, seed: int, store: Store, judge: Emulator) -> Record:
    """One data set: draw a truth, simulate data, infer the posterior, rank the truth."""
    rng = np.random.default_rng(stream_of(part.seed, Stream.TRUTH, number))
    truth = part.prior.sample(1, rng)
    data = part.data(simulator, truth, rng)
    observed = data.mean(axis=0) if part.limited else data
    began, kept = time.perf_counter(), len(store)
    record: Record = {
        "truth": dict(zip(part.prior.free, truth[0].tolist(), strict=True)),
        "observed": observed.tolist(),
    }
    try:
        found = part.posterior(simulator, data, seed, store)
    except InputError as error:
        return record | {"status": f"failed: {error}", "seconds": time.perf_counter() - began}
    count = part.replicates if part.emulator else 1
    return record | {
        "status": "done",
        **placed(found, truth[0], part.draws, rng, lambda values: judge.log_likelihood(values, observed, count)),
        "effective": float(found.effective_size.min()),
        "weighed": float(1 / np.sum(found.weights**2)),
        "simulations": found.simulations,
        "fresh": len(store) - kept,
        "seconds": time.perf_counter() - began,
        "warnings": found.sentences(),
        "rounds": len(found.diagnostics.rows()),
        "tolerance": found.diagnostics.tolerances[-1] if isinstance(found.diagnostics, SmcDiagnostics) else None,
    }


def placed(
    found: Posterior,
    truth: Float[np.ndarray, " free"],
    draws: int,
    rng: np.random.Generator,
    log_likelihood: Callable[[np.ndarray], np.ndarray],
) -> dict[str, dict[str, float]]:
    """Rank of a truth among draws, and the share of the posterior below it.

    For the log-likelihood and for all parameters together the share is that of the draws, as it is computed only for
    them.
    """
    drawn = np.concatenate([truth[None], found.drawn(draws, rng)])
    columns = np.column_stack([drawn, log_likelihood(drawn)])
    rank = np.append((columns[1:] < columns[0]).sum(axis=0), joint_rank(found.prior, truth, drawn[1:], rng))
    share = np.append(found.weights.ravel() @ (found.flat < truth), (rank[-2:] + 0.5) / (draws + 1))
    names = (*found.free, LIKELIHOOD, JOINT)
    return {name: dict(zip(names, one.tolist(), strict=True)) for name, one in (("rank", rank), ("share", share))}


def markdown(report: Report, study: Study) -> str:
    """The text of the page."""
    head = report.head(__doc__)
    options = f" --model {study.model}" if study.model != "algebraic" else ""
    options += f" --method {study.method}" if study.method else ""
    head = head.replace("calibration --docs", f"calibration{options} --docs")
    parts = [
        f"""{head}

![Ranks of the truth]({study.name}.png)

Histograms of ranks, with a band that contains a single bar with probability 95 %; below them the ECDF of the ranks
minus its diagonal, with a band that contains all of it with probability 95 %. A posterior that is too narrow has high
bars at both ends.

## Settings

{study.parts[0].model.sentence()}
"""
    ]
    parts += [_settings(part) for part in study.parts]
    return "\n".join([*parts, *report.sections()])


def _settings(part: Part) -> str:
    """Settings of a part, and those that are not the sampler's defaults."""
    usual = asdict(type(part.settings)())
    other = {name: value for name, value in asdict(part.settings).items() if value != usual[name]}
    said = ", ".join(f"{name} {value} (default {usual[name]})" for name, value in other.items())
    return (
        f"- {part.method}: {part.count} data sets in {part.groups} groups, each the mean of {part.replicates} colonies "
        f"at {part.model.data()}; L = {part.draws}. Non-default settings: "
        f"{said or 'none'}.\n"
    )


def afresh(study: Study, k: int, group: int, workers: Workers | None = None) -> None:
    """Compute a group, then free its memory."""
    grow(study, k, group, workers)
    jax.clear_caches()  # chains differ in length, and each length compiles its own programs
    gc.collect()


def apart(report: Report, study: Study, jobs: int) -> None:
    """Compute all groups, several at a time in processes of their own."""
    pool = ProcessPoolExecutor(jobs, get_context("spawn"))
    try:
        running = {
            pool.submit(afresh, study, k, group): f"{study.parts[k].method} {group}" for k, group in study.groups
        }
        for number, one in enumerate(as_completed(running), start=1):
            one.result()
            report.stage(f"group {running[one]} is done, {number} of {len(running)}")
    finally:
        pool.shutdown(cancel_futures=True)


def calibrate(report: Report, study: Study, jobs: int, workers: Workers | None = None) -> None:
    """Compute the missing data sets, and report on all."""
    for k, group in study.groups:
        study.done(k, group)  # fails now rather than later
    if workers is not None or jobs == 1:
        with workers or nullcontext():
            for k, group in study.groups:
                afresh(study, k, group, workers)
    else:
        apart(report, study, jobs)
    records = [
        [record for group in range(part.groups) for record in study.done(k, group)]
        for k, part in enumerate(study.parts)
    ]
    for part, each in zip(study.parts, records, strict=True):
        verdicts(report, part, each)
    report.details["data sets"] = records
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        picture(study.parts, records, report.docs / f"{study.name}.png")
        (report.docs / f"{study.name}.md").write_text(markdown(report, study))


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/calibration"))
    parser.add_argument("--jobs", type=int, default=available_processors())
    parser.add_argument("--method", choices=[part.method.lower() for part in FULL])
    parser.add_argument("--model", choices=list(STUDIES), default="algebraic")
    parser.add_argument("--again", type=int, default=0)
    add_workers(parser)
    own, others = parser.parse_known_args(arguments)
    if own.again < 0:
        parser.error(f"--again: {own.again} is below 0")

    def run(report: Report, quick: bool) -> None:
        parts, folder = STUDIES[own.model][quick], "quick" if quick else "full"
        folder += f"-{own.again}" if own.again else ""
        asked = tuple(replace(part, again=own.again) for part in parts if own.method in (None, part.method.lower()))
        if not asked:
            parser.error(f"--method: {own.method} is not calibrated on the {own.model} model")
        model = () if own.model == "algebraic" else (own.model,)
        calibrate(
            report,
            Study(asked, own.work.joinpath(folder, *model), own.method, own.model),
            max(1, own.jobs),
            workers_of(own),
        )

    command("calibration", run, others)


if __name__ == "__main__":
    main()
