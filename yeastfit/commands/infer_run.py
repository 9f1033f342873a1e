"""What `yeastfit infer` does: measurements, a sampler's run in a folder that it can be taken up from, and its draws.

Files of a run: measured/ (where micrographs were measured), targets.csv, simulations.h5 (every colony, those of another
run in reused.h5, too), problems.json (what they ran into), distance.json, chains.h5 or populations.npz, samples.npz;
then what `infer_results` makes of them.
"""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.commands.infer_config import BATCH, Request
from yeastfit.commands.measured_source import Measurements, check_source, measure_source, recorded_warnings
from yeastfit.commands.run_folder import RUN, RunFolder, inputs_of, read_run, run_versions
from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import Distance, restored
from yeastfit.inference.abc.mcmc import abc_mcmc
from yeastfit.inference.abc.mcmc_settings import McmcSettings
from yeastfit.inference.abc.pilot import distance_of
from yeastfit.inference.abc.smc import abc_smc
from yeastfit.inference.colony_simulator import ColonySimulator, Resolution
from yeastfit.inference.curve_covariance import Square, measurement_covariance
from yeastfit.inference.imaging import Imaging
from yeastfit.inference.neural_likelihood.sequential import emulated
from yeastfit.inference.neural_likelihood.settings import EmulatedSettings, Given
from yeastfit.inference.posterior.predictive_check import Predictive, predict
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.posterior.simulation_store import Recorded, Store
from yeastfit.inference.simulator import Mismeasured, Replicates, Simulator, Tally, Wrapper, labels_of, once, root_of
from yeastfit.inference.targets import Targets
from yeastfit.inference.targets_from_table import TABLE, read_measurements
from yeastfit.model.parameters import Scales
from yeastfit.progress import Progress
from yeastfit.report.fit_files import write_targets
from yeastfit.report.posterior_files import Results, photographs, write_results
from yeastfit.storage import read_json, write_json, written_whole

SIMULATIONS, REUSED, DISTANCE, PROBLEMS_MET = "simulations.h5", "reused.h5", "distance.json", "problems.json"
COLONIES = 6  # of either kind, in the picture


@dataclass(frozen=True)
class Watched(Wrapper):
    """A simulator of colonies that tells how many it has grown: `tell(rows)` after each batch.

    kept: file of what colonies have run into since the run began, written before their statistics are.
    """

    tally: Tally
    kept: Path
    tell: Callable[[int], None]

    def __call__(self, values: Any, seeds: Any) -> Any:
        """As the simulator's own."""
        found, grown = self.simulator(values, seeds), len(once(values, seeds))
        self.tally.simulated += grown
        write_json(self.kept, {"grown": self.tally.simulated, "problems": dict(self.problems)})
        self.tell(grown)
        return found


@dataclass(frozen=True)
class Run:
    """A run in its folder. observed: the targets' values; replicates: colonies behind the fewest of them."""

    request: Request
    source: Path
    folder: RunFolder
    data: Measurements
    targets: Targets
    colonies: ColonySimulator
    tally: Tally = field(default_factory=Tally)

    @staticmethod
    def begin(request: Request, source: Path, path: Path, resume: bool, jobs: int, progress: Progress) -> "Run":
        """Opens the folder, measures or reads the data. Raises `InputError`, before anything is simulated."""
        configuration = request.configuration()
        chosen = [] if request.condition is None else [request.condition]
        check_source(source, chosen)
        request.check_numerics()
        if request.reuse and not (path / REUSED).is_file() and not (request.reuse / SIMULATIONS).is_file():
            raise InputError(f"--reuse: {request.reuse} holds no {SIMULATIONS}, need the folder of a run of infer")
        folder = RunFolder.begin(path, configuration, inputs_of(source), request.seed, resume)
        measured = path / "measured"
        if (measured / TABLE).is_file():  # of these inputs, which have not changed; it is written after its masks
            rows = read_measurements(measured / TABLE)
            data = Measurements(rows, measured, [], recorded_warnings(rows, measured))
        else:
            data = measure_source(source, measured, jobs, progress)
        targets = data.targets(chosen, request.statistics, Scales(request.length, request.rate))
        write_targets(path, targets)
        single = next(iter(targets.values()))
        resolution = Resolution(request.dt, request.spacing)
        simulator = ColonySimulator.of(single, request.free, request.fixed, resolution)
        run = Run(request, source, folder, data, single, simulator)
        if (path / PROBLEMS_MET).is_file():
            met = read_json(path / PROBLEMS_MET)
            run.tally.simulated = met["grown"]
            simulator.problems.update(met["problems"])
        run.take_over()
        return run

    @property
    def replicates(self) -> int:
        """R of the data; the fewest where curves have different numbers of colonies."""
        return int(self.targets.replicates[self.targets.measured].min())

    @property
    def most(self) -> int:
        """Colonies that the run grows at most, the predictive check's among them."""
        settings, plan = self.request.settled(), self.request.plan()
        if isinstance(plan, EmulatedSettings):
            sampled = plan.most
        else:
            chains = plan.steps * plan.walkers if isinstance(plan, McmcSettings) else plan.simulations
            sampled = settings["colonies"] * (settings["pilot"] + chains)
        return sampled + self.request.draws * self.replicates

    @property
    def noise(self) -> Square:
        """Covariance of the means' errors of measurement."""
        errors = self.targets.measurement_errors(self.request.measurement_error)
        return measurement_covariance(self.targets.observables, self.targets.values, errors)

    @property
    def about(self) -> str:
        """What decides over a simulated colony, beside λ and seed."""
        imaging, configuration = self.targets.imaging or Imaging(), self.folder.configuration
        named = {name: configuration[name] for name in ("fixed", "dt", "spacing", "rate", "length")}
        named |= {"extent": imaging.extent, "estimator": imaging.estimator, "pixels": imaging.spacing}
        return ", ".join(f"{name} {value}" for name, value in named.items())

    def sample(self, tell: Callable[[int], None], say: Progress) -> Samples:
        """The sampler's run, its draws saved in samples.npz; those of a finished one are read."""
        path, request = self.folder.path, self.request
        if self.folder.finished:
            return Samples.load(path / "samples.npz")
        prior, observed = request.the_prior(), self.targets.values
        how: dict[str, Any] = {"seed": request.seed, "progress": say}
        with self.store(path / SIMULATIONS) as store:
            given = self.reused(store)
            simulator = self.data_sets(Recorded(self.watched(tell), BATCH, store))
            chains = path / "chains.h5"
            plan = request.plan(self.folder.configuration.get("first"))
            if isinstance(plan, EmulatedSettings):
                how |= {"replicates": self.replicates, "noise": self.noise, "given": given}
                found = emulated(simulator, prior, observed, plan, path=chains, **how)
            else:
                say("pilot", 0.0)
                distance = self.distance(Recorded(simulator, BATCH))
                if isinstance(plan, McmcSettings):
                    found = abc_mcmc(simulator, prior, distance, plan, path=chains, **how)
                else:
                    found = abc_smc(simulator, prior, distance, plan, path=path / "populations.npz", **how)
            found = found.warned(*store.notes, *self.doubts())
        found.save(path / "samples.npz")
        return found

    def distance(self, recorded: Recorded) -> Distance:
        """As it was made when the run began: another processor would round its covariance in another way."""
        kept, request = self.folder.path / DISTANCE, self.request
        if kept.is_file():
            return restored(read_json(kept))
        settings = request.settled()
        name, pilot = settings["distance"], settings["pilot"]
        found = distance_of(name, recorded, request.the_prior(), self.targets.values, pilot, request.seed)
        write_json(kept, found.asdict())
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
        self.folder.notes.extend(self.of_no_use(reuse))

    def of_no_use(self, reuse: Path) -> list[str]:
        """In words, why ABC, which has use only for what it would grow itself, finds none of that in another run."""
        if self.request.method == "emulator" or not (reuse / RUN).is_file():
            return []
        other = read_run(reuse / RUN)
        earlier = {"colonies": 1, **other["configuration"], "seed": other["seed"]}
        now = {**self.folder.configuration, "seed": self.folder.seed}
        names = [name for name in ("seed", "prior", "colonies") if earlier[name] != now[name]]
        if not names:
            return []
        why = f"it has other {', '.join(names)} than this run"
        return [
            f"--reuse: nothing in {reuse} will be of use, {why}: {self.request.method} takes what it would grow itself"
        ]

    def watched(self, tell: Callable[[int], None]) -> Simulator:
        """Of single colonies."""
        return Watched(self.colonies, self.tally, self.folder.path / PROBLEMS_MET, tell)

    def store(self, path: Path) -> Store:
        """Of colonies of this run's kind."""
        return Store(path, self.colonies.parameters.names, labels_of(self.colonies), self.about)

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
        with self.store(self.folder.path / SIMULATIONS) as store:
            recorded = Recorded(self.watched(tell), BATCH, store)
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
        grown = self.colonies.outlines(shown, float(self.targets.times[-1]), self.request.seed)
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
        targets, said = self.targets, list[str]()
        counts = targets.replicates[targets.measured]
        if np.ptp(counts):
            said.append(
                f"the curves' points are means of {counts.min()} to {counts.max()} colonies, all are taken for means "
                f"of {counts.min()}"
            )
        if targets.curves is not None:
            seen = np.isfinite(targets.curves[:, targets.measured]).astype(int)
            shared = seen.T @ seen
            if (shared < np.minimum.outer(counts, counts)).any():
                said.append(
                    f"not every colony is in all points of the curves, some two of them share {shared.min()}: all are "
                    "taken for the same colonies, seen at every time, so that intervals may be too narrow or too wide"
                )
        return said

    def problems(self) -> list[str]:
        """What micrographs and colonies ran into, since the run began."""
        grown = self.tally.simulated
        met = [f"{count} of {grown} colonies: {what}" for what, count in self.colonies.problems.items()]
        return [*self.data.warnings, *met]


def reason(error: OSError) -> str:
    """In one line; HDF5's own words are many."""
    where = f" ({error.filename})" if error.filename else ""
    return os.strerror(error.errno) + where if error.errno else " ".join(str(error).split())
