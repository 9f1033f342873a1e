"""Variation between colonies: is it found, and are intervals right with and without it?

Synthetic sets of 14 colonies: true λ from the prior; λ_r of colony r from y(λ_r) = y(λ) + τ ξ_r, with y a logarithm, or
a logit of shares. τ is 0, or |N(0, 0.3²)|, or one parameter scatters alone, with √k times 0.2 for k parameters, which
the model of one common τ does not have. Each set is inferred twice by one emulator: with τ unknown, from its single
colonies, and by taking all colonies for those of one λ, from their mean. Where one parameter scatters alone, it is
inferred a third time, told which (`--varying`).

Coverage is the share of the true λ that lie in their 50 and 90 % intervals, of all parameters and sets of a group.
Posteriors are sampled by population Monte Carlo (adaptive importance sampling; Cappé et al. 2008,
doi:10.1007/s11222-008-9059-x), which is cheaper here than the chains of `yeastfit infer`; the density is the same.

    python -m benchmarks.variation [--work DIR] [--docs docs]

Every posterior is kept in the folder of `--work`; a study that was stopped goes on.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp
from scipy.stats import halfnorm, multivariate_t

from benchmarks.lines import append_line, read_lines
from benchmarks.report import Report, command
from benchmarks.variation_models import Studied, studied
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.log_posterior import LogPosterior
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.posterior.draws import weighted_quantile
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.variation import ColonyCoordinates, Variation, Varied
from yeastfit.inference.simulator import Simulator, seed_of
from yeastfit.seeds import Stream, stream_of

COLONIES, SD, ALONE, SEED = 14, 0.3, 0.2, 2024
STEP = 0.01  # of y, by which slopes of the emulator's mean are found
GROUPS = {"none": "τ = 0", "common": "τ of all parameters", "one": "one parameter scatters"}
TOLD = "variation of that parameter"
SHARES = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
DRAWS, ROUNDS, MOST_ROUNDS, FREEDOM, ENOUGH = 1024, 7, 43, 5.0, 100.0  # of population Monte Carlo
LEVELS = {0.5: ("q25", "q75"), 0.9: ("q05", "q95")}


@dataclass(frozen=True)
class Study:
    """One model with its emulator.

    Attributes:
        model: What is studied.
        simulator: Of single colonies.
        emulator: Of it.
    """

    model: Studied
    simulator: Simulator
    emulator: Emulator

    @staticmethod
    def of(model: Studied, work: Path) -> "Study":
        """Train, on simulations that are kept."""
        simulator, file = model.simulator(), work / f"{model.file}.npz"
        problem = Problem(simulator, model.prior, np.zeros(len(simulator.observables)))
        values = problem.prior_values(model.trained, SEED)
        if not file.is_file():
            work.mkdir(parents=True, exist_ok=True)
            np.savez(file, rows=simulator(values, seed_of(SEED, range(len(values)))))
        emulator = train(values, np.load(file)["rows"], prior=model.prior, labels=problem.labels, seed=SEED)
        return Study(model, simulator, emulator)

    def truth(self, group: str, number: int) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, " free"]]:
        """λ, and the scatter of each parameter."""
        rng = np.random.default_rng(stream_of(SEED, Stream.TRUTH, number, list(GROUPS).index(group)))
        values = self.model.prior.sample(1, rng)[0]
        tau = np.zeros(len(values))
        if group == "common":
            tau[:] = halfnorm.rvs(scale=SD, random_state=rng)
        elif group == "one":
            tau[rng.integers(len(tau))] = ALONE * np.sqrt(len(tau))
        return values, tau

    def colonies(self, group: str, number: int) -> Float[np.ndarray, "colony statistic"]:
        """A set of data."""
        values, tau = self.truth(group, number)
        rng = np.random.default_rng(stream_of(SEED, Stream.COLONIES, number, list(GROUPS).index(group)))
        coordinates = ColonyCoordinates.of(self.simulator.parameters)
        each = coordinates.moved(np.tile(values, (COLONIES, 1)), tau * rng.standard_normal((COLONIES, len(values))))
        return self.simulator(each, rng.integers(2**32, size=COLONIES, dtype=np.uint64))

    def ways(self, group: str, tau: Float[np.ndarray, " free"]) -> dict[str, Variation | None]:
        """How a set is inferred."""
        found: dict[str, Variation | None] = {"variation": Variation(), "one λ": None}
        if group == "one":
            found[TOLD] = Variation(varying=[self.model.prior.free[int(np.argmax(tau))]])
        return found

    def record(self, group: str, number: int) -> dict[str, Any]:
        """All posteriors of a set."""
        values, tau = self.truth(group, number)
        rows = self.colonies(group, number)
        found = {"group": group, "number": number, "truth": values, "tau": tau}
        rows = rows[np.isfinite(rows).all(axis=1)]
        for name, variation in self.ways(group, tau).items():
            problem = Problem.of(self.simulator, self.model.prior, rows, variation=variation)
            found[name] = posterior(LogPosterior(self.emulator, problem), problem, seed=number)
        return found


def posterior(density: LogPosterior, problem: Problem, seed: int) -> dict[str, Any]:
    """Quantiles of every parameter, and what they rest on, by population Monte Carlo."""
    rng, variation = np.random.default_rng(seed), problem.variation
    varied = 0 if variation is None else 1
    start = problem.prior.coordinates(problem.prior_values(2 * DRAWS, seed))
    x = np.column_stack([start, rng.standard_normal((len(start), varied))])
    log_weights = np.concatenate([density(one) for one in np.split(x, 2)])
    for number in range(MOST_ROUNDS):
        middle, covariance = _gathered(x, log_weights)
        proposal = multivariate_t(middle, covariance * 1.2, df=FREEDOM)
        count = 4 * DRAWS if number and number % ROUNDS == 0 else DRAWS
        x = proposal.rvs(count, random_state=rng)
        log_weights = np.concatenate([density(one) for one in np.split(x, count // DRAWS)]) - proposal.logpdf(x)
        weights = np.exp(log_weights - logsumexp(log_weights))
        if count > DRAWS and np.sum(weights**2) * ENOUGH < 1:
            break
    places, z = density.parts(x)
    inside = weights > 0
    values = problem.prior.values(places)[inside]
    columns = values if variation is None else np.column_stack([values, variation.tau(z)[inside]])
    quantiles = {
        name: [weighted_quantile(column, weights[inside], share) for column in columns.T]
        for name, share in SHARES.items()
    }
    found = quantiles | {"effective": float(1 / np.sum(weights**2))}
    if variation is not None:
        found["absent"] = float(weights[inside] @ (columns[:, -1] == 0))
    return found


def _gathered(x: np.ndarray, log_weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of draws whose weights are tempered until they are worth `ENOUGH` draws."""
    power = 1.0
    while True:
        weights = np.exp(power * log_weights - logsumexp(power * log_weights))
        if 1 / np.sum(weights**2) >= ENOUGH:
            break
        power *= 0.7
    middle = weights @ x
    off = x - middle
    return middle, (off * weights[:, None]).T @ off + 1e-9 * np.eye(x.shape[1])


def sets(study: Study, work: Path, count: int, report: Report) -> list[dict[str, Any]]:
    """Records of all groups; missing ones are computed."""
    path = work / f"{study.model.file}.jsonl"
    there = {(one["group"], one["number"]) for one in read_lines(path) if one["group"] != "one" or TOLD in one}
    for number in range(count):
        for group in GROUPS:
            if (group, number) not in there:
                append_line(path, study.record(group, number))
        if number % 10 == 9:
            report.stage(f"{study.model.name}: {number + 1} of {count} sets of each group")
    every = {(one["group"], one["number"]): one for one in read_lines(path)}
    return [every[group, number] for group in GROUPS for number in range(count)]


def hits(records: list[dict[str, Any]], how: str, level: float) -> Iterator[bool]:
    """Whether each true λ lies in its interval."""
    low, high = LEVELS[level]
    for one in records:
        for k, value in enumerate(one["truth"]):
            yield one[how][low][k] <= value <= one[how][high][k]


def judge(report: Report, study: Study, records: list[dict[str, Any]]) -> None:
    """Figures and tables of one model."""
    name, rows = study.model.name, []
    for group, what in GROUPS.items():
        own = [one for one in records if one["group"] == group]
        for how in (one for one in ("variation", "one λ", TOLD) if one in own[0]):
            shares = {level: float(np.mean(list(hits(own, how, level)))) for level in LEVELS}
            row: dict[str, Any] = {"data": what, "inferred with": how}
            row |= {f"in {100 * level:g} %, %": 100 * share for level, share in shares.items()}
            width = [np.subtract(one[how]["q95"], one[how]["q05"])[: len(one["truth"])] for one in own]
            other = [np.subtract(one["one λ"]["q95"], one["one λ"]["q05"]) for one in own]
            row["width over that with one λ"] = float(np.median(np.array(width) / np.array(other)))
            row["effective draws, least"] = min(one[how]["effective"] for one in own)
            rows.append(row)
            if how == "variation" and group != "one":
                target = None if report.quick else 86.0
                label = f"{name}, {what}: coverage of 90 % intervals"
                report.add(label, 100 * shares[0.9], "%", target, note="at most 94 wanted")
                if target:
                    report.add(label, 100 * shares[0.9], "%", 94.0, at_least=False)
    report.table(f"{name}: coverage of the true parameters", rows)
    report.table(f"{name}: τ", list(_found(records)))
    _errors(report, study)


def _found(records: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """How τ is found, by its true value."""
    known = [one for one in records if one["group"] != "one"]
    for low, high, what in ((-1, 0, "0"), (0, 0.1, "0 to 0.1"), (0.1, 0.25, "0.1 to 0.25"), (0.25, 9, "above 0.25")):
        if own := [one for one in known if low < one["tau"][0] <= high]:
            yield {"true τ": what, **_of_tau(own, "variation")}
    told = [one for one in records if TOLD in one]
    yield {"true τ": f"{max(told[0]['tau']):.2g}, of one parameter, told which", **_of_tau(told, TOLD)}


def _of_tau(own: list[dict[str, Any]], how: str) -> dict[str, Any]:
    """How τ is found in these sets."""
    posteriors, true = [one[how] for one in own], np.array([max(one["tau"]) for one in own])
    middle, q05, q95 = (np.array([one[key][-1] for one in posteriors]) for key in ("median", "q05", "q95"))
    return {
        "sets": len(own),
        "P(τ = 0), mean": float(np.mean([one["absent"] for one in posteriors])),
        "median − truth, mean": float(np.mean(middle - true)),
        "rms": float(np.sqrt(np.mean((middle - true) ** 2))),
        "in 90 %, %": 100 * float(np.mean((q05 <= true) & (true <= q95))),
    }


def _errors(report: Report, study: Study) -> None:
    """What 8 and 14 colonies tell of one common τ, and of one for each parameter, at τ = 0.2."""
    places = study.model.prior.quantile(np.full((1, len(study.model.prior.free)), 0.5))
    _, scatter, _, _ = study.emulator.moments(places)
    root = np.linalg.cholesky(scatter[0])
    free, parts = len(study.model.prior.free), []
    for k in range(free):
        only = _only(study, places, k)
        parts.append(np.linalg.solve(root, np.linalg.solve(root, only).T))
    spread = np.eye(len(root)) + ALONE**2 * sum(parts)
    slopes = [2 * ALONE * np.linalg.solve(spread, one) for one in parts]
    rows = []
    for count in (8, COLONIES):
        information = np.array([[np.trace(a @ b) for b in slopes] for a in slopes]) * 0.5 * (count - 1)
        own = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)))
        row = {"colonies": count, "common τ": float(1 / np.sqrt(information.sum()))}
        rows.append(row | dict(zip(study.model.prior.free, own.tolist(), strict=True)))
    report.table(f"{study.model.name}: standard errors of τ = {ALONE:g}, common or of each parameter", rows)


def _only(study: Study, places: np.ndarray, k: int) -> Float[np.ndarray, "statistic statistic"]:
    """J_k J_kᵀ of one parameter, by a central difference."""
    step = STEP * np.array([[1.0], [-1.0]]) * np.eye(places.shape[1])[k]
    above, below = study.emulator.moments(ColonyCoordinates.of(study.simulator.parameters).moved(places, step))[0]
    column = (above - below) / (2 * STEP)
    return np.outer(column, column)


def scattered(report: Report, study: Study) -> None:
    """The emulator's moments of colonies around λ beside those of colonies grown with scattered λ."""
    free, rows = study.model.prior.free, []
    places = study.model.prior.quantile(np.full((1, len(free)), 0.5))
    _, alone, _, _ = study.emulator.moments(places)
    coordinates = ColonyCoordinates.of(study.simulator.parameters)
    for tau in (0.1, 0.2, 0.4, 0.8):
        mean, scatter, _, _ = study.emulator.moments(coordinates.around(places, np.array([tau])))
        count = 200 if report.quick else 1000
        values = np.repeat(np.column_stack([places, [[tau]]]), count, axis=0)
        grown = Varied(study.simulator)(values, seed_of(SEED, range(count)))
        grown = grown[np.isfinite(grown).all(axis=1)]
        sd = np.sqrt(np.diag(scatter[0]))
        row: dict[str, Any] = {
            "τ": tau,
            "√(trace V / trace C)": float(np.sqrt(np.mean(np.diag(scatter[0] / alone[0])))),
        }
        for label, off, ratio in zip(
            study.emulator.labels, (grown.mean(axis=0) - mean[0]) / sd, grown.std(axis=0, ddof=1) / sd, strict=True
        ):
            row[label.removeprefix("li2024_")] = f"{off:+.2f}, {ratio:.2f}"
        rows.append(row)
    report.table(f"{study.model.name}: grown colonies against the emulator's, mean off in sd, sd over sd", rows)


def main(arguments: list[str] | None = None) -> None:
    """Run the command: the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/variation"))
    parser.add_argument("--sets", type=int, default=60)
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        work, models = own.work / ("quick" if quick else "full"), studied(quick)
        for model in models:
            report.stage(f"{model.name}: simulations and emulator")
            study = Study.of(model, work)
            judge(report, study, sets(study, work, 3 if quick else own.sets, report))
            scattered(report, study)
        if report.docs is not None:
            said = "\n".join(f"- {one.name}: {one.sentence}" for one in models)
            parts = [report.head(__doc__), f"## Models\n\n{said}", *report.sections()]
            (report.docs / "variation.md").write_text("\n\n".join(parts) + "\n")

    command("variation", run, others)


if __name__ == "__main__":
    main()
