"""What `yeastfit infer` does: measurements, a sampler's run in a folder that it can be taken up from, and its draws.

Files of a run: measured/ (where micrographs were measured), targets.csv, simulations.h5 (every colony, those of another
run in reused.h5, too), chains.h5 or populations.npz, samples.npz; then what `infer_results` makes of them.
"""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from yeastfit import fit_command
from yeastfit.errors import InputError
from yeastfit.infer.abc_mcmc import abc_mcmc
from yeastfit.infer.abc_smc import SmcSettings, abc_smc
from yeastfit.infer.colony_simulator import ColonySimulator
from yeastfit.infer.distances import Distance, KernelName, LiDistance, Mahalanobis, WeightedCurves
from yeastfit.infer.emulated import EmulatedSettings, Given, emulated
from yeastfit.infer.ensembles import measurement_covariance
from yeastfit.infer.fit import DEFAULT_FREE
from yeastfit.infer.mcmc_settings import McmcSettings, Move
from yeastfit.infer.measurements import TABLE, read_measurements
from yeastfit.infer.pilot import pilot_of
from yeastfit.infer.predictive import Predictive, Replicates, predict, silhouettes
from yeastfit.infer.priors import Prior, default_prior
from yeastfit.infer.regression import CurveSquare
from yeastfit.infer.samples import Samples
from yeastfit.infer.settings import MEASUREMENT_ERROR, FitSettings
from yeastfit.infer.simulations import Recorded, Store
from yeastfit.infer.simulator import Mismeasured, Simulator, Wrapper, root_of
from yeastfit.infer.space import check_free
from yeastfit.infer.surface import monomials
from yeastfit.infer.targets import Targets
from yeastfit.infer_folder import RunFolder, inputs_of, run_versions
from yeastfit.infer_results import Results, photographs, write_results
from yeastfit.model.colony import PROBLEMS
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.progress import Progress
from yeastfit.storage import written_whole

Method = Literal["emulator", "abc-mcmc", "abc-smc"]
DistanceName = Literal["li", "mahalanobis", "curves"]
FIRST = 512  # simulations of the emulator's first round, where so many are allowed
SIMULATIONS, REUSED = "simulations.h5", "reused.h5"
COLONIES = 6  # of either kind, in the picture
BATCH = 32  # colonies that are grown together
OWN = {  # options that only some methods have
    "steps": ("abc-mcmc",),
    "move": ("abc-mcmc",),
    "kernel": ("abc-mcmc",),
    "share": ("abc-mcmc",),
    "walkers": ("abc-mcmc", "emulator"),
    "simulations": ("abc-smc", "emulator"),
    "population": ("abc-smc",),
    "epsilon": ("abc-mcmc", "abc-smc"),
    "distance": ("abc-mcmc", "abc-smc"),
    "pilot": ("abc-mcmc", "abc-smc"),
    "colonies": ("abc-mcmc", "abc-smc"),
}
NAMES = {"epsilon": "tolerance", "share": "pilot-quantile"}
LI = {"distance": "li", "kernel": "indicator", "move": "gaussian", "colonies": 1, "measurement_error": 0.0}


@dataclass(frozen=True)
class Request:
    """What is asked for. Options that are None have the method's default, `settled`.

    statistics: curves of the data. fixed: λ of those that are not free. epsilon: or else the quantile `share` of the
    pilot. steps: of each chain, in all; simulations: at most. colonies: whose mean is one simulated data set, of ABC;
    the emulator learns single colonies and takes R of them for the R replicates. draws: of the posterior predictive
    check. dt, spacing: of the model that is meant, as the data sets of data/synthetic are made; a coarser one is off in
    compactness by up to 5 %. measurement_error: relative, of the means; None as `FitSettings` has it. reuse: another
    run's folder, whose colonies serve again: the emulator learns from all of them, ABC takes those it would grow.
    """

    method: Method = "emulator"
    free: tuple[str, ...] = DEFAULT_FREE
    statistics: tuple[str, ...] = ("compactness", "radius")
    condition: str | None = None
    prior: Path | None = None
    fixed: dict[str, float] = field(default_factory=dict)
    distance: DistanceName | None = None
    epsilon: float | None = None
    share: float | None = None
    kernel: KernelName | None = None
    move: Move | None = None
    pilot: int | None = None
    steps: int | None = None
    walkers: int | None = None
    population: int | None = None
    simulations: int | None = None
    colonies: int | None = None
    draws: int = 40
    dt: float = FitSettings.fine_dt
    spacing: float = FitSettings.fine_spacing
    measurement_error: float | None = None
    reuse: Path | None = None
    rate: float = Scales.rate
    length: float = Scales.length
    seed: int = 0

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise InputError(f"--method is {self.method!r}, it must be one of {', '.join(get_args(Method))}")
        if self.distance is not None and self.distance not in get_args(DistanceName):
            raise InputError(f"--distance is {self.distance!r}, it must be one of {', '.join(get_args(DistanceName))}")
        for name, methods in OWN.items():
            if getattr(self, name) is not None and self.method not in methods:
                option = NAMES.get(name, name)
                raise InputError(
                    f"--{option} is of --method {' or '.join(methods)}, not of {self.method}: leave it out"
                )
        if self.epsilon is not None and self.share is not None:
            raise InputError("--tolerance and --pilot-quantile are given, need one of the two")
        if self.steps is not None and self.steps < 4:
            raise InputError(f"--steps is {self.steps}, a chain needs at least 4 to be judged")

    @staticmethod
    def of(li: bool, options: dict[str, Any]) -> "Request":
        """Of options by name. li: with the settings of Li et al. 2024, beside which no others may be given."""
        if not li:
            return Request(**options)
        if options["method"] not in (None, "abc-mcmc"):
            raise InputError(f"--li is a way of --method abc-mcmc, not of {options['method']}")
        for name, value in LI.items():
            if options.get(name) not in (None, value):
                raise InputError(f"--{name} is {options[name]}, with --li it is {value}: leave out one of the two")
        return Request(**{**options, **LI, "method": "abc-mcmc"})

    def the_prior(self) -> Prior:
        """As the file says, or over the plausible ranges."""
        free = check_free(self.free)
        return Prior.read(self.prior, free) if self.prior else default_prior(free)

    def settled(self) -> "dict[str, Any]":
        """The method's settings, by name, with its defaults."""
        chosen = {name: value for name in OWN if (value := getattr(self, name)) is not None}
        return {**DEFAULTS[self.method], **chosen}

    def numerics(self) -> FitSettings:
        """How colonies are grown, and what errors their measured means have."""
        error = MEASUREMENT_ERROR if self.measurement_error is None else self.measurement_error
        return FitSettings(dt=self.dt, spacing=self.spacing, measurement_error=error)

    def configuration(self) -> dict[str, Any]:
        """What makes the run what it is, plain data."""
        other = {*OWN, "seed", "prior", "reuse"}
        plain = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in other}
        fixed = {name: value for name, value in self.fixed.items() if name not in self.free}
        reuse = None if self.reuse is None else str(self.reuse)
        return {**plain, **self.settled(), "fixed": fixed, "prior": self.the_prior().asdict(), "reuse": reuse}


DEFAULTS: dict[str, dict[str, Any]] = {
    "emulator": {"simulations": EmulatedSettings.most, "walkers": EmulatedSettings.walkers},
    "abc-mcmc": {
        **{"distance": "mahalanobis", "share": McmcSettings.share, "kernel": "indicator", "move": "gaussian"},
        **{"pilot": McmcSettings.pilot, "steps": McmcSettings.steps, "walkers": BATCH, "colonies": 1},
    },
    "abc-smc": {
        **{"distance": "mahalanobis", "pilot": McmcSettings.pilot, "colonies": 1},
        **{"population": SmcSettings.population, "simulations": 20_000},
    },
}


@dataclass(frozen=True)
class Watched(Wrapper):
    """A simulator that tells how many colonies it has grown: `tell(rows)` after each batch."""

    tell: Callable[[int], None]

    def __call__(self, values: Any, seeds: Any) -> Any:
        """As the simulator's own."""
        found = self.simulator(values, seeds)
        self.tell(len(values))
        return found


@dataclass(frozen=True)
class Run:
    """A run in its folder. observed: the targets' values; replicates: colonies behind the fewest of them."""

    request: Request
    source: Path
    folder: RunFolder
    data: fit_command.Measurements
    targets: Targets
    colonies: ColonySimulator

    @staticmethod
    def begin(
        request: Request, source: Path, path: Path, resume: bool, jobs: int, progress: Callable[[int, int], None]
    ) -> "Run":
        """Opens the folder, measures or reads the data. Raises `InputError`, before anything is simulated."""
        configuration = request.configuration()
        chosen = [] if request.condition is None else [request.condition]
        fit_command.check_conditions(source, chosen)
        if request.reuse and not (path / REUSED).is_file() and not (request.reuse / SIMULATIONS).is_file():
            raise InputError(f"--reuse: {request.reuse} holds no {SIMULATIONS}, need the folder of a run of infer")
        folder = RunFolder.begin(path, configuration, inputs_of(source), request.seed, resume)
        measured = path / "measured"
        if (measured / TABLE).is_file():  # of these inputs, which have not changed; it is written after its masks
            data = fit_command.Measurements(read_measurements(measured / TABLE), measured, [], [])
        else:
            data = fit_command.measurements(source, measured, jobs, progress)
        targets = data.targets(chosen, request.statistics, Scales(request.length, request.rate))
        fit_command.write_targets(path, targets)
        single = next(iter(targets.values()))
        simulator = ColonySimulator.of(single, request.free, Parameters(**request.fixed), request.numerics())
        run = Run(request, source, folder, data, single, simulator)
        run.take_over()
        return run

    @property
    def replicates(self) -> int:
        """R of the data; the fewest where curves have different numbers of colonies."""
        return int(self.targets.replicates[self.targets.measured].min())

    @property
    def noise(self) -> CurveSquare:
        """Covariance of the means' errors of measurement."""
        return measurement_covariance(self.targets, self.request.numerics())

    @property
    def about(self) -> str:
        """What decides over a simulated colony, beside λ and seed."""
        targets, configuration = self.targets, self.folder.configuration
        named = {name: configuration[name] for name in ("fixed", "dt", "spacing", "rate", "length")}
        named |= {"extent": targets.extent, "estimator": targets.estimator, "pixels": targets.spacing}
        return ", ".join(f"{name} {value}" for name, value in named.items())

    def sample(self, tell: Callable[[int], None], say: Progress) -> Samples:
        """The sampler's run, its draws saved in samples.npz; those of a finished one are read."""
        path, request = self.folder.path, self.request
        if self.folder.finished:
            return Samples.load(path / "samples.npz")
        settings, prior, seed = request.settled(), request.the_prior(), request.seed
        observed = self.targets.values
        how: dict[str, Any] = {"seed": seed, "progress": say}
        with self.store(path / SIMULATIONS) as store:
            given = self.reused(store)
            simulator = self.data_sets(Recorded(Watched(self.colonies, tell), BATCH, store))
            if request.method == "emulator":
                plan = emulated_settings(settings["simulations"], settings["walkers"])
                how |= {"replicates": self.replicates, "noise": self.noise, "given": given}
                found = emulated(simulator, prior, observed, plan, **how)
            else:
                say("pilot", 0.0)
                recorded = Recorded(simulator, BATCH)
                distance = distance_of(settings["distance"], recorded, prior, observed, settings["pilot"], seed)
                if request.method == "abc-mcmc":
                    mcmc = McmcSettings(
                        **{name: value for name, value in settings.items() if name not in ("distance", "colonies")}
                    )
                    found = abc_mcmc(simulator, prior, distance, mcmc, path=path / "chains.h5", **how)
                else:
                    smc = SmcSettings(
                        population=settings["population"],
                        simulations=settings["simulations"],
                        epsilon=settings.get("epsilon"),
                        batch=BATCH,
                    )
                    found = abc_smc(simulator, prior, distance, smc, path=path / "populations.npz", **how)
            found = found.warned(*store.notes, *self.doubts())
        found.save(path / "samples.npz")
        return found

    def take_over(self) -> None:
        """Copies the simulations that are to be reused, once. Raises `InputError` where they are of something else."""
        reuse, copy = self.request.reuse, self.folder.path / REUSED
        if reuse is None or copy.is_file():
            return
        try:
            with written_whole(copy) as temporary:
                shutil.copyfile(reuse / SIMULATIONS, temporary)
                self.store(temporary).close()
        except InputError as error:
            raise InputError(f"--reuse: {reuse / SIMULATIONS} cannot be: {error}") from None

    def store(self, path: Path) -> Store:
        """Of colonies of this run's kind."""
        return Store(path, self.colonies.free, self.colonies.labels, self.about)

    def reused(self, store: Store) -> Given | None:
        """Those of another run, put into the store; their λ and statistics."""
        if self.request.reuse is None:
            return None
        with self.store(self.folder.path / REUSED) as other:
            values, seeds, statistics = other.all()
        store.append(values, seeds, statistics)
        return values, statistics

    def data_sets(self, colonies: Simulator) -> Simulator:
        """What the method simulates: single colonies for the emulator, else means, with errors of measurement."""
        if self.request.method == "emulator":
            return colonies
        count = self.request.settled()["colonies"]
        means = Replicates(colonies, count) if count > 1 else colonies
        return Mismeasured(means, root_of(self.noise)) if self.noise.any() else means

    def predictive(self, samples: Samples, tell: Callable[[int], None]) -> Predictive:
        """Data sets of as many colonies as were observed, at draws of the samples."""
        simulator = Watched(self.colonies, tell)
        with self.store(self.folder.path / SIMULATIONS) as store:
            recorded = Recorded(simulator, BATCH, store)
            return predict(
                samples,
                recorded,
                self.targets.values,
                replicates=self.replicates,
                noise=self.noise,
                draws=self.request.draws,
                seed=self.request.seed,
            )

    def results(
        self, samples: Samples, truth: dict[str, float] | None, tell: Callable[[int], None]
    ) -> tuple[Results, list[str]]:
        """All of the run's files but its manifest, and what is to be said of them."""
        found = self.predictive(samples, tell)
        shown = found.values[:COLONIES]
        grown = silhouettes(shown, self.colonies, float(self.targets.times[-1]), self.request.seed)
        images = self.source if self.source.is_dir() else self.source.parent
        seen = photographs(self.data.rows, self.data.folder, images, self.request.condition, COLONIES)
        results = Results.of(samples, self.request.the_prior(), found, truth, self.problems())
        inputs = ", ".join(f"{name} {one[:12]}…" for name, one in list(self.folder.inputs.items())[:COLONIES])
        made = {name: str(value) for name, value in self.folder.configuration.items() if value is not None}
        made |= {"seed": str(self.request.seed), "inputs (SHA-256)": f"{len(self.folder.inputs)}: {inputs}"}
        made |= {"versions": ", ".join(f"{name} {one}" for name, one in run_versions().items())}
        return results, write_results(self.folder.path, results, self.targets, seen, grown, made)

    def doubts(self) -> list[str]:
        """What the data do not fulfil, in words."""
        counts = self.targets.replicates[self.targets.measured]
        if not np.ptp(counts):
            return []
        return [
            f"the curves' points are means of {counts.min()} to {counts.max()} colonies, all are taken for means of "
            f"{counts.min()}"
        ]

    def problems(self) -> list[str]:
        """What colonies ran into that were grown by this call."""
        grown = self.colonies.colonies
        return [f"{count} of {grown.grown} colonies: {PROBLEMS[name]}" for name, count in grown.problems.items()]


def reason(error: OSError) -> str:
    """In one line; HDF5's own words are many."""
    where = f" ({error.filename})" if error.filename else ""
    return os.strerror(error.errno) + where if error.errno else " ".join(str(error).split())


def emulated_settings(simulations: int, walkers: int) -> EmulatedSettings:
    """Rounds of `FIRST`, or of what is a power of two and at most half of the simulations."""
    first = min(FIRST, 2 ** max(1, int(np.log2(max(simulations, 2))) - 1))
    return EmulatedSettings(first=first, each=first, most=simulations, walkers=walkers, batch=min(128, first))


def distance_of(
    name: DistanceName,
    recorded: Recorded,
    prior: Prior,
    observed: Float[np.ndarray, " statistic"],
    pilot: int,
    seed: int,
) -> Distance:
    """Li et al.'s; or by the scatter of the pilot's simulations about a quadratic in their coordinates.

    Where area is among the statistics, Li et al.'s makes a condition of the last one.

    That scatter is what colonies of one λ differ by, which data sets should be compared by; over all of the prior's λ
    statistics differ much more. Raises `InputError` where the pilot is too small to tell it.
    """
    if name == "li":
        areas = [k for k, label in enumerate(recorded.labels) if label.startswith("area at ")]
        return LiDistance(observed, areas[-1] if areas and len(observed) > 1 else None)
    found = pilot_of(recorded, prior, LiDistance(observed), pilot, seed)
    whole = np.isfinite(found.distances)
    x, statistics = found.x[whole], found.statistics[whole]
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    terms = monomials(x)
    needed = terms.shape[1] + 2 * len(observed)
    if len(x) < needed:
        raise InputError(
            f"--pilot: {len(x)} of {pilot} simulations came to something, the scatter of {len(observed)} statistics "
            f"needs at least {needed}"
        )
    rest = statistics - terms @ np.linalg.lstsq(terms, statistics, rcond=None)[0]
    covariance = rest.T @ rest / (len(x) - terms.shape[1])
    if name == "curves":
        return WeightedCurves(observed, np.sqrt(np.diag(covariance)))
    return Mahalanobis(observed, 0.5 * (covariance + covariance.T))
