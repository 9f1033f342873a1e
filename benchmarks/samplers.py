"""The cost of a posterior compared with pyABC: colonies, and seconds, until its error stays below a threshold.

The problem is cheap: compactness and radius of young colonies at 3 and 4.5 units of time, by a coarse model that is
taken as the true one. Mobility and aspect ratio are free, log-uniform over their plausible ranges; the truth is 1.3 and
0.65. The data are the mean of 4 simulated colonies, so a simulated data set of ABC is the mean of 4, too. The emulator
learns single colonies and computes the scatter of means itself. Every method is charged for the colonies it simulates.

**Error.** The means and standard deviations of log λ are compared with a reference posterior (`reference`), whose
simulations are not counted and which states its own error. The error of a posterior is the largest of
|μ − μ_ref| / σ_ref and |log(σ / σ_ref)| over both parameters. It is evaluated after each round, population or block of
chain steps. A method has arrived when its error is below 0.25 and stays below to the end.

**Methods**, with three seeds each, and ten for the cheap emulator:

- emulator: default settings, rounds of 512 colonies until it has settled, at most 4. Each point of its curve is a
  separate run with that many colonies; seconds include training and the first compilation of networks of each size;
- ABC-SMC, yeastfit: populations of 500, default settings except for a given final ε; with regression adjustment;
- ABC-SMC, pyABC: populations of the same size, ε falling by medians to the same final value, otherwise its defaults
  (`rivals`);
- ABC-MCMC, yeastfit: 32 chains at the same ε, started from a pilot of 2048 data sets, since starts must lie within ε;
- the last two, adjusted: with the regression adjustment of our ABC-SMC, which costs no colonies and which pyABC lacks.

All ABC methods use one distance, Mahalanobis's with the scatter of a pilot of 500 data sets that are not counted, and
one tolerance, ε = 0.85, which all reach within a budget of 160 000 colonies. Seconds exclude the compilation of the
simulator. A run that does not arrive counts as infinitely long in the median; in a ratio, the colonies that it spent
are used as a bound, and the table says so.

Targets: the emulator needs at most 1/10 of the colonies that pyABC needs, medians over seeds.

    python -m benchmarks.samplers [--quick] [--json FILE] [--docs DIR]

With --json, an interrupted run continues. --quick: means of 2 colonies, small populations, a large ε, one seed, no
target. --docs writes DIR/samplers.md and DIR/samplers.png. Needs pyABC: pip install 'yeastfit[benchmarks]'.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.agreement import moved
from benchmarks.reference import Case, Moments, Reference
from benchmarks.report import Report, command
from yeastfit import Imaging, InputError, Targets
from yeastfit.inference.abc.distances import Distance
from yeastfit.inference.abc.mcmc import AbcMcmc
from yeastfit.inference.abc.pilot import distance_of
from yeastfit.inference.abc.regression_adjustment import Accepted
from yeastfit.inference.abc.smc import AbcSmc, SmcDiagnostics
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.samplers import infer
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulations import Simulations

TRUTH = {"mobility": 1.3, "aspect_ratio": 0.65}
REACH = (0.8, 0.3)  # of log λ around the truth, in which the posterior is searched for
STATISTICS, TIMES = ("compactness", "radius"), (3.0, 4.5)
EXTENT, PIXEL = 4.0, 0.2  # L0
COARSE = Resolution(dt=0.05, spacing=0.4)
EMULATOR, SMC, RIVAL, RIVAL_ADJUSTED, MCMC, MCMC_ADJUSTED = (
    "emulator",
    "ABC-SMC, yeastfit",
    "ABC-SMC, pyABC",
    "ABC-SMC, pyABC, adjusted",
    "ABC-MCMC, yeastfit",
    "ABC-MCMC, yeastfit, adjusted",
)
THRESHOLD, SHARE = 0.25, 0.1

Trace = list[dict[str, Any]]


@dataclass(frozen=True)
class Size:
    """How much is computed.

    Attributes:
        replicates: Colonies whose mean is a data set.
        pool: Colonies of the reference.
        witnesses: Simulated data sets of its check.
        nearest: How many of them are accepted.
        budget: Colonies of a run, at most.
        epsilon: The last tolerance of all ABC.
        population: Of ABC-SMC.
        pilot: Data sets of the pilot of ABC-MCMC.
        walkers: Its chains.
        steps: Of each chain.
        looks: How often its error is evaluated.
        scatter: Data sets behind the distance.
        block: Data sets simulated together.
        seeds: Of ABC.
        tries: Seeds of the emulator.
        emulator: Settings of the emulator.
    """

    replicates: int = 4
    pool: int = 32_768
    witnesses: int = 6_000
    nearest: int = 400
    budget: int = 160_000
    epsilon: float = 0.85
    population: int = 500
    pilot: int = 2048
    walkers: int = 32
    steps: int = 320
    looks: int = 8
    scatter: int = 500
    block: int = 32
    seeds: tuple[int, ...] = (1, 2, 3)
    tries: tuple[int, ...] = tuple(range(1, 11))
    emulator: SequentialEmulator = field(default_factory=lambda: SequentialEmulator(simulations=2048, first=512))

    def seeds_of(self, method: str) -> tuple[int, ...]:
        """Seeds of a method, by its name."""
        return self.tries if method == EMULATOR else self.seeds


QUICK = Size(
    replicates=2,
    pool=2048,
    witnesses=256,
    nearest=64,
    budget=6000,
    epsilon=1.5,
    population=100,
    pilot=256,
    walkers=8,
    steps=32,
    looks=2,
    scatter=128,
    seeds=(1,),
    tries=(1,),
    emulator=SequentialEmulator(
        simulations=512, first=256, most_steps=1000, training=TrainingSettings(members=3, width=32, steps=500)
    ),
)


def the_case(replicates: int) -> Case:
    """Simulated data of young colonies, and their simulator."""
    imaging = Imaging(EXTENT, spacing=PIXEL, smoothing=PIXEL)
    shape = Targets.from_means({name: np.ones(len(TIMES)) for name in STATISTICS}, TIMES, imaging=imaging)
    simulator = ColonySimulator.of(shape, tuple(TRUTH), resolution=COARSE)
    truth = np.array([TRUTH[name] for name in simulator.parameters.names])
    return Case.at(simulator, Prior.default(simulator.parameters), truth, replicates)


@dataclass(frozen=True)
class Race:
    """One case, its reference, and a distance for each seed."""

    case: Case
    reference: Reference
    size: Size

    def distance(self, seed: int) -> Distance:
        """Distance with the scatter of the run's own pilot."""
        data_sets = CachedSimulator(self.case.data_sets, self.size.block)
        return distance_of("mahalanobis", self.case.problem, data_sets, self.size.scatter, seed)

    def point(self, x: np.ndarray, weights: np.ndarray, colonies: int, seconds: float) -> dict[str, Any]:
        """One entry of a trace."""
        found = Moments.of(x, weights)
        error = self.reference.moments.error(found)
        return {
            "colonies": colonies,
            "seconds": seconds,
            "error": error,
            "mean": found.mean.tolist(),
            "sd": found.sd.tolist(),
        }

    def infer(self, sampler: SequentialEmulator | AbcMcmc | AbcSmc, seed: int, store: Simulations) -> Posterior:
        """The posterior by one method."""
        case = self.case
        how: dict[str, Any] = {"replicates": case.replicates, "seed": seed, "store": store}
        return infer(case.colonies, case.prior, case.observed, method=sampler, **how)

    def store(self) -> Simulations:
        """For simulations that the calls of a method share."""
        problem = self.case.problem
        return Simulations(problem.prior.free, problem.labels)

    def point_of(self, found: Posterior, colonies: int, seconds: float) -> dict[str, Any]:
        """One entry of a trace, from a posterior."""
        return self.point(self.case.prior.coordinates(found.flat), found.weights.ravel(), colonies, seconds)

    def emulator(self, seed: int) -> dict[str, Trace]:
        """A run for each number of rounds, until one has settled."""
        settings, trace = self.size.emulator, Trace()
        first, each = settings.round_sizes(len(self.case.prior.free))
        for most in range(first, settings.simulations + 1, each):
            found = self.infer(replace(settings, simulations=most), seed, self.store())
            trace.append(self.point_of(found, found.simulations, found.seconds))
            if isinstance(found.diagnostics, EmulatorDiagnostics) and found.diagnostics.rounds[-1].settled:
                break
        return {EMULATOR: trace}

    def smc(self, seed: int) -> dict[str, Trace]:
        """One more population in each call."""
        size, replicates, trace, seconds, store = self.size, self.case.replicates, Trace(), 0.0, self.store()
        settings = AbcSmc(
            population=size.population,
            tolerance=size.epsilon,
            simulations=size.budget // replicates,
            batch=size.block,
            distance=self.distance(seed),
            replicates=replicates,
        )
        for count in range(1, settings.populations + 1):
            found = self.infer(replace(settings, populations=count), seed, store)
            seconds += found.seconds
            assert isinstance(found.diagnostics, SmcDiagnostics)
            epsilons = found.diagnostics.tolerances
            if len(epsilons) < count:
                break
            trace.append(self.point_of(found, found.simulations * replicates, seconds) | {"epsilon": epsilons[-1]})
        return {SMC: trace}

    def rival(self, seed: int) -> dict[str, Trace]:
        """pyABC, plain and adjusted."""
        from benchmarks.rivals import pyabc_smc  # needs pyABC, which nothing else here does

        case, size = self.case, self.size
        distance = self.distance(seed)
        populations, seconds = pyabc_smc(
            case.data_sets,
            case.prior,
            distance,
            population=size.population,
            epsilon=size.epsilon,
            most=size.budget // case.replicates,
            block=size.block,
            seed=seed,
        )
        plain, better = Trace(), Trace()
        for one, so_far in zip(populations, seconds, strict=True):
            spent = one.simulated * case.replicates
            plain.append(self.point(one.x, one.weights, spent, so_far) | {"epsilon": one.epsilon})
            values, weights, _ = Accepted(
                case.prior.values(one.x),
                one.weights,
                one.statistics,
                one.distances,
                case.observed,
                case.prior,
            ).adjusted()
            x = case.prior.coordinates(values)
            better.append(self.point(x, weights, spent, so_far) | {"epsilon": one.epsilon})
        return {RIVAL: plain, RIVAL_ADJUSTED: better}

    def mcmc(self, seed: int) -> dict[str, Trace]:
        """Chains that continue with each call, plain and adjusted."""
        size, replicates, seconds, store = self.size, self.case.replicates, 0.0, self.store()
        plain, better = Trace(), Trace()
        settings = AbcMcmc(
            walkers=size.walkers,
            tolerance=size.epsilon,
            pilot=size.pilot,
            distance=self.distance(seed),
            replicates=replicates,
        )
        for steps in np.linspace(0, size.steps, size.looks + 1, dtype=int)[1:].tolist():
            try:
                found = self.infer(replace(settings, steps=steps), seed, store)
            except InputError as error:
                if plain or "simulations from the prior comes that close" not in str(error):
                    raise
                spent = {"colonies": size.pilot * replicates, "seconds": np.nan, "error": np.inf}
                gone = [spent | {"said": "no data set of the pilot came within ε, to start from"}]
                return {MCMC: gone, MCMC_ADJUSTED: gone}
            seconds += found.seconds
            colonies = found.simulations * replicates
            plain.append(self.point_of(found, colonies, seconds) | {"epsilon": size.epsilon})
            better.append(self.point_of(moved(found), colonies, seconds) | {"epsilon": size.epsilon})
        return {MCMC: plain, MCMC_ADJUSTED: better}


def arrival(trace: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """The entry from which on the error stays below the threshold."""
    below = [point["error"] < THRESHOLD for point in trace]
    if not below or not below[-1]:
        return None
    return trace[len(below) - below[::-1].index(False) if False in below else 0]


def median(traces: Sequence[Trace], what: str = "colonies") -> float:
    """Median until arrival; runs that do not arrive count as infinite."""
    return float(np.median([np.inf if (one := arrival(trace)) is None else one[what] for trace in traces]))


def all_runs(report: Report, race: Race) -> dict[str, list[Trace]]:
    """Traces by method, one per seed. Finished runs are kept and not repeated after an interruption."""
    runs: dict[str, list[Trace]] = {name: [] for name in (EMULATOR, SMC, RIVAL, RIVAL_ADJUSTED, MCMC, MCMC_ADJUSTED)}
    methods: dict[str, Callable[[int], dict[str, Trace]]] = {
        EMULATOR: race.emulator,
        SMC: race.smc,
        RIVAL: race.rival,
        MCMC: race.mcmc,
    }
    for name, method in methods.items():
        for seed in race.size.seeds_of(name):
            what = f"{name}, seed {seed}"
            report.stage(what)
            for each, trace in report.part(f"{what}, {report.quick}", partial(method, seed)).items():
                runs[each].append(trace)
    return runs


def verdicts(report: Report, runs: Mapping[str, list[Trace]], size: Size) -> None:
    """Add medians, failures, ratios, and ABC at one tolerance to the report."""
    for name, traces in runs.items():
        there = [arrival(trace) for trace in traces]
        late = ", ".join(f"{trace[-1]['colonies']}" for trace, one in zip(traces, there, strict=True) if one is None)
        note = f"{sum(one is not None for one in there)} of {len(there)} arrived" + (late and f"; not within {late}")
        note = "; ".join([note, *dict.fromkeys(one[-1]["said"] for one in traces if "said" in one[-1])])
        report.add(f"{name}: colonies until there", median(traces), "", note=note)
    for name, traces in runs.items():
        report.add(f"{name}: seconds until there", median(traces, "seconds"), "s")
    target = None if report.quick else SHARE
    ratios(report, runs, "colonies", RIVAL, target)
    ratios(report, runs, "colonies", RIVAL_ADJUSTED)
    ratios(report, runs, "colonies", SMC)
    ratios(report, runs, "seconds", RIVAL)
    for name in (SMC, RIVAL):
        reached = [trace[-1] for trace in runs[name] if trace[-1]["epsilon"] <= size.epsilon]
        note = f"{len(reached)} of {len(runs[name])} reached it"
        if reached:
            colonies, seconds = (float(np.median([one[what] for one in reached])) for what in ("colonies", "seconds"))
            report.add(f"{name}: colonies to ε = {size.epsilon:g}", colonies, "", note=note)
            report.add(f"{name}: seconds to ε = {size.epsilon:g}", seconds, "s", note=note)
        else:
            report.add(f"{name}: colonies to ε = {size.epsilon:g}", np.inf, "", note=note)
    rows = [
        {
            "method": name,
            "seed": seed,
            "colonies": "" if (one := arrival(trace)) is None else one["colonies"],
            "seconds": "" if one is None else one["seconds"],
            "colonies in all": trace[-1]["colonies"],
            "seconds in all": trace[-1]["seconds"],
            "error at the end": trace[-1]["error"],
            "ε at the end": trace[-1].get("epsilon", ""),
        }
        for name, traces in runs.items()
        for seed, trace in zip(size.seeds_of(name), traces, strict=True)
    ]
    report.table(f"until the error stays below {THRESHOLD:g}", rows)


def ratios(report: Report, runs: Mapping[str, list[Trace]], what: str, other: str, target: float | None = None) -> None:
    """The emulator's cost divided by that of another method; NaN if the emulator did not arrive.

    A run of the other that did not arrive counts with all that it spent, so the ratio is an upper bound.
    """
    spent = [trace[-1] if (one := arrival(trace)) is None else one for trace in runs[other]]
    late = sum(arrival(trace) is None for trace in runs[other])
    share = median(runs[EMULATOR], what) / float(np.median([one[what] for one in spent]))
    note = f"at most: {late} of {len(spent)} did not arrive; what they spent is used" if late else ""
    if not np.isfinite(share):
        share, note = np.nan, "the emulator did not arrive"
    report.add(f"{what}, {EMULATOR} / {other}", share, "", target, at_least=False, note=note)


def checked(report: Report, race: Race) -> None:
    """Add the reference's own error, and its comparison with ABC on simulated data sets."""
    size, reference = race.size, race.reference
    report.add("reference: its own error", reference.own_error, "", note=f"{size.pool} colonies, halves compared")
    report.stage("checking the reference")

    def witness() -> dict[str, Any]:
        found, said = reference.witness(race.case, size.witnesses, size.nearest)
        return {"error": reference.moments.error(found), "said": said, "mean": found.mean.tolist()}

    found = report.part(f"witness, {report.quick}", witness)
    note = "; ".join([f"the nearest {size.nearest} of {size.witnesses} data sets, adjusted", *found["said"]])
    report.add("reference: compared with ABC", found["error"], "", note=note)


def picture(runs: Mapping[str, list[Trace]], path: Path) -> None:
    """Plot the errors of all runs against colonies."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    panel = figure.subplots()
    for number, (name, traces) in enumerate(runs.items()):
        for trace in traces:
            colonies, errors = ([point[what] for point in trace] for what in ("colonies", "error"))
            panel.plot(colonies, errors, "o-", color=f"C{number}", ms=3, lw=1, label=name)
    handles, labels = panel.get_legend_handles_labels()
    first = dict(zip(reversed(labels), reversed(handles), strict=True))
    panel.axhline(THRESHOLD, color="black", lw=0.8, ls="--")
    panel.set(xscale="log", yscale="log", xlabel="simulated colonies", ylabel="error of the posterior")
    figure.legend([first[name] for name in runs], list(runs), fontsize=8, ncols=3, loc="outside upper center")
    figure.savefig(path, dpi=80)


def markdown(report: Report, size: Size) -> str:
    """The text of the page."""
    parts = [
        f"""# The cost of a posterior compared with pyABC

{report.origin}

Simulated colonies and seconds until the error of a posterior, in its means and standard deviations, falls below
{THRESHOLD:g} and stays there ("until there"). The data are the mean of {size.replicates} young colonies; a simulated
data set of ABC costs as many, while the emulator learns single colonies. All ABC methods use the same distance and end
at ε = {size.epsilon:g}; SMC has populations of {size.population}. `python -m benchmarks.samplers --help` has the rules.

![Error against colonies](samplers.png)
"""
    ]
    return "\n".join([*parts, *report.sections()])


def run(report: Report, quick: bool) -> None:
    """Make the problem and its reference, run all methods, and write the page."""
    if find_spec("pyabc") is None:
        raise InputError("pyABC is not installed: pip install 'yeastfit[benchmarks]'")
    size = QUICK if quick else Size()
    report.stage("compiling, and simulating the data")
    case = the_case(size.replicates)
    report.stage("the reference")
    race = Race(case, Reference.of(case, np.array(REACH), size.pool), size)
    report.details["reference"] = {
        "mean": race.reference.moments.mean.tolist(),
        "sd": race.reference.moments.sd.tolist(),
        "observed": case.observed.tolist(),
    }
    runs = all_runs(report, race)
    verdicts(report, runs, size)
    checked(report, race)
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        picture(runs, report.docs / "samplers.png")
        (report.docs / "samplers.md").write_text(markdown(report, size))
    report.details["runs"] = runs


if __name__ == "__main__":
    command("samplers", run)
