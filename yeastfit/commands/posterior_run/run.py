"""What `yeastfit infer` does: measurements, a sampler's run in a folder that can be resumed, and its results.

Files of a run from its beginning: run.json (what it is), measured/ (where micrographs were measured), simulations.h5
(every simulation; those of another run also in reused.h5), problems.json (what simulations ran into). At its end:
targets.csv, colonies.csv, chains.h5 (the chains, as emcee reads them), posterior.npz, what `posterior_files` makes of
them, and manifest.json.
"""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from yeastfit.commands.generated.samplers import extending
from yeastfit.commands.measured_source import MEASURED, Measurements, measure_once
from yeastfit.commands.posterior_run.config import MADE_LAST, Request
from yeastfit.commands.posterior_run.doubts import doubts_of
from yeastfit.commands.posterior_run.leave_out import predicted_from_others, single_colonies
from yeastfit.commands.posterior_run.reused import REUSED, SIMULATIONS, check_reusable, take_over
from yeastfit.commands.posterior_run.watched_simulator import Met, Watched
from yeastfit.commands.run_folder import RunFolder, inputs_of, run_versions
from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.curve_covariance import measurement_covariance
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.posterior.emcee_file import write_chains
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.prior.variation import Varied
from yeastfit.inference.samplers import sample
from yeastfit.inference.simulator import Simulator, Tally, inside, labels_of, member_seeds, problems_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.targets import Targets
from yeastfit.inference.workers.spread import Workers
from yeastfit.progress import Progress, silent
from yeastfit.report.files.fit_files import write_targets
from yeastfit.report.files.posterior_files import Outlines, photographs, with_arviz, write_results
from yeastfit.report.posterior_summary import Summary
from yeastfit.results.contents import RUN, check_own
from yeastfit.results.folder import ResultsFolder

PROBLEMS_MET, POSTERIOR, CHAINS = "problems.json", "posterior.npz", "chains.h5"
LEFT_OUT, COLONIES = "left_out.npz", "colonies.png"
STORED = (RUN, MEASURED, SIMULATIONS, REUSED, PROBLEMS_MET)  # what a stopped run goes on with
BATCH = 32  # simulations of the predictive check that run together
PICTURED = 6  # photographs, and simulations beside them


@dataclass(frozen=True)
class InferRun:
    """A run in its folder.

    Attributes:
        request: What is asked for.
        source: The data.
        folder: Where the run lies.
        data: Measurements.
        model: The model as the data are seen by it.
        targets: The curves that are compared.
        problem: What is sampled.
        sampler: With all its settings, those of an earlier call included.
        tally: Simulations since the run began.
        workers: That simulate; None where this process does.
        spread: The problem's simulator on these workers.
        unlike: Workers of other arithmetic of earlier calls, in words.
        reused_otherwise: How simulations taken from another run differ from what this one would make, in words.
    """

    request: Request
    source: Path
    folder: RunFolder
    data: Measurements
    model: ForwardModel
    targets: Targets
    problem: Problem
    sampler: Sampler
    tally: Tally = field(default_factory=Tally)
    workers: Workers | None = None
    spread: Simulator | None = None
    unlike: list[str] = field(default_factory=list)
    reused_otherwise: list[str] = field(default_factory=list)

    @staticmethod
    def begin(
        request: Request, source: Path, results: ResultsFolder, resume: bool, jobs: int, progress: Progress
    ) -> "InferRun":
        """Measure or read the data, or go on with a run.

        Raises:
            InputError: Something is wrong with options, data or folder; nothing has been simulated then.
        """
        path, configuration, prior = results.path, request.configuration(), request.the_prior()
        check_own(path, STORED)
        if request.reuse and not (path / REUSED).is_file():
            check_reusable(request.reuse, request)
        folder = RunFolder.begin(
            results,
            configuration,
            inputs_of(source),
            request.seed,
            resume,
            stored=STORED,
            extents=extending(configuration["method"]),
            kept=request.open_settings,
            made_last=MADE_LAST,
            copied=("reuse",) if (path / REUSED).is_file() else (),
        )
        try:
            run = InferRun._prepared(request, source, folder, prior, jobs, progress)
        except InputError:
            folder.take_back()
            raise
        folder.go_on(STORED)
        return run

    @staticmethod
    def _prepared(
        request: Request, source: Path, folder: RunFolder, prior: Prior, jobs: int, progress: Progress
    ) -> "InferRun":
        """The run in its folder, with data and problem."""
        results = folder.results
        chosen = [] if request.condition is None else [request.condition]
        data = measure_once(source, results, jobs, progress)
        (name, seen), *_ = data.seen(request.forward_model, chosen, request.statistics).items()
        folder.notes.extend(seen.notes)
        model, single = seen.model, seen.targets
        if request.leave_out:
            single_colonies(single, request.leave_out, model.nouns)
        write_targets(results.partial, {name: single})
        simulator = model.simulator(single, request.parameters.names, request.held)
        noise, colony_noise = (
            measurement_covariance(single.observables, single.values, errors(single.names, request.measurement_error))
            for errors in (model.measurement_errors, model.colony_errors)
        )
        problem = Problem.of(
            simulator,
            prior,
            single,
            noise=noise,
            colony_noise=colony_noise if colony_noise.any() else None,
            variation=request.variation,
            limits=model.limits(single),
        )
        settings = {name: folder.configuration["settings"][name] for name in request.open_settings}
        sampler = replace(request.sampler, **settings)  # type: ignore[type-var]
        run = InferRun(request, source, folder, data, model, single, problem, sampler)
        if not results.finished or folder.record is not None:
            run._take_up()
            run.reused_otherwise.extend(take_over(request.reuse, folder, sampler, run._store))
        return run

    def on(self, workers: Workers | None) -> "InferRun":
        """The same with workers that simulate, where there are some."""
        spread = None if workers is None else workers.spread(self.problem.simulator)
        return replace(self, workers=workers, spread=spread)

    @property
    def simulations_at_most(self) -> int | None:
        """Simulations of the run, those of the predictive check among them, where the sampler knows."""
        sampled = getattr(self.sampler, "simulations_at_most", None)
        checked = self.request.draws + self.prior_draws
        return None if sampled is None else sampled + checked * self.problem.replicates

    @property
    def prior_draws(self) -> int:
        """Data sets predicted from the prior: those asked for where there is ArviZ, whose file alone holds them."""
        return self.request.prior_draws if with_arviz() else 0

    def sample(self, tell: Callable[[int], None], progress: Progress) -> Posterior:
        """The sampler's run, its posterior saved; that which there is where only something else is made of it.

        Raises:
            InputError: The sampler refuses its settings, the data or what was simulated. Where it has not simulated
                anything before, the folder is as if there had been no run.
        """
        if self.folder.predicts and (self.folder.path / POSTERIOR).is_file():
            for name in (POSTERIOR, CHAINS):
                if (self.folder.path / name).is_file():
                    shutil.copyfile(self.folder.path / name, self.folder.results.partial / name)
            return self.saved()
        try:
            return self._sampled(tell, progress)
        except (InputError, MemoryError) as error:
            if not self.tally.simulated:
                self.folder.take_back()
            if isinstance(error, MemoryError):
                raise
            way = f"for other settings give another --out, with --reuse {self.folder.path}"
            raise InputError("; ".join([str(error), *([way] if self.tally.simulated else []), *self._met()])) from error

    def _sampled(self, tell: Callable[[int], None], progress: Progress) -> Posterior:
        path, partial = self.folder.path, self.folder.results.partial
        with self._store(path / SIMULATIONS) as store:
            if (path / REUSED).is_file():
                with self._store(path / REUSED) as other:
                    store.reuse(*other.all())
            problem = replace(self.problem, simulator=self._watched(tell))
            posterior = sample(problem, self.sampler, store, self.request.seed, progress).warned(
                *doubts_of(self.targets, self.problem, self.model.nouns)
            )
        if posterior.backend is not None:
            write_chains(partial / CHAINS, posterior.backend)
        posterior.save(partial / POSTERIOR)
        return posterior

    def saved(self) -> Posterior:
        """The posterior of a finished run."""
        return Posterior.load(self.folder.path / POSTERIOR)

    def results(
        self,
        posterior: Posterior,
        truth: Mapping[str, float] | None,
        tell: Callable[[int], None],
        progress: Progress = silent,
    ) -> tuple[Summary, list[str]]:
        """All files but the manifest; the summary, and remarks."""
        with self._store(self.folder.path / SIMULATIONS) as store:
            simulator = CachedSimulator(self._watched(tell), BATCH, store)
            predicted, doubts = self._predicted(posterior, simulator)
            beforehand, remarks = self._predicted_beforehand(posterior, simulator)
            left_out = self._left_out(posterior, store, progress) if self.request.leave_out else None
        summary = Summary.of(posterior, predicted, truth, [*doubts, *self.problems_met()], self.model, left_out)
        images = self.source if self.source.is_dir() else self.source.parent
        observed = photographs(self.data.rows, self.data.folder, images, self.request.condition, PICTURED)
        drawn = None if predicted is None else self._drawn(predicted)
        partial = self.folder.results.partial
        remarks += write_results(partial, summary, self.targets, observed, drawn, self._made(), beforehand)
        return summary, remarks

    def _left_out(self, posterior: Posterior, store: Store, progress: Progress) -> LeftOut:
        """Every colony predicted from the others."""
        groups, targets = self.request.leave_out, self.targets
        return predicted_from_others(
            posterior,
            self.problem,
            single_colonies(targets, groups, self.model.nouns),
            store,
            targets=targets,
            groups=groups,
            sampler=self.sampler,
            seed=self.request.seed,
            progress=progress,
        )

    def _predicted(self, posterior: Posterior, simulator: Simulator) -> tuple[Predictive | None, list[str]]:
        """Data predicted from the posterior, and why there are none."""
        try:
            return posterior.predict(simulator, draws=self.request.draws, seed=self.request.seed), []
        except SimulationError as error:
            return None, [f"posterior predictive: {error}"]

    def _drawn(self, predicted: Predictive) -> Outlines | None:
        """Simulated outlines at the first draws of the predictive check, where the model has some."""
        shown = predicted.values[:PICTURED]
        if self.problem.variation is not None:
            varied = Varied(self.problem.simulator, self.problem.varying)
            shown = varied.scattered(shown, member_seeds(self.request.seed, len(shown)))
        return self.model.outlines(self.problem.simulator, shown, self.targets, self.request.seed)

    def _predicted_beforehand(self, posterior: Posterior, simulator: Simulator) -> tuple[Predictive | None, list[str]]:
        """Data predicted from the prior, and why there are none."""
        if not self.prior_draws:
            return None, []
        try:
            return posterior.predict_prior(simulator, draws=self.prior_draws, seed=self.request.seed), []
        except (InputError, SimulationError) as error:
            return None, [f"posterior.nc has no prior_predictive: {error}"]

    def problems_met(self) -> list[str]:
        """What micrographs and simulations ran into, since the run began."""
        several = self.model.nouns[1]
        other = [f"a worker whose {several} are others of the same parameters and seeds: {one}" for one in self.mixed()]
        return [*self.data.warnings, *self._met(), *other, *self.reused_otherwise]

    def _met(self) -> list[str]:
        """What simulations ran into."""
        problems = sorted(problems_of(self.problem.simulator).items())
        return [f"{count} of {self.tally.simulated} {self.model.nouns[1]}: {what}" for what, count in problems]

    def mixed(self) -> list[str]:
        """Workers of other arithmetic, in words, since the run began."""
        return list(dict.fromkeys([*self.unlike, *([] if self.workers is None else self.workers.unlike)]))

    def _take_up(self) -> None:
        """Go on counting what simulations run into, where a run is resumed."""
        path, notes = self.folder.path, self.folder.notes
        kept, there = path / PROBLEMS_MET, (path / SIMULATIONS).is_file()
        if kept.is_file():
            try:
                met = Met.load(kept)
            except InputError as error:
                raise InputError(f"{error}: remove it and give --resume, what it says is counted anew") from None
            held = 0
            if there:
                with self._store(path / SIMULATIONS) as store:
                    held = len(store)
                    notes.extend(store.notes)
            if lost := max(met.simulated - held, 0):
                notes.append(f"{lost} of {met.simulated} simulations are lost, and made again where they are needed")
            if held:
                self.tally.simulated = met.simulated
                problems_of(self.problem.simulator).update(met.problems)
            self.unlike.extend(met.unlike)
        elif there:
            notes.append(f"{PROBLEMS_MET} is lost, and with it what simulations so far ran into")

    def _watched(self, tell: Callable[[int], None]) -> Simulator:
        simulator = self.problem.simulator if self.spread is None else self.spread
        return Watched(simulator, self.tally, self.folder.path / PROBLEMS_MET, tell, self.mixed)

    def _store(self, path: Path) -> Store:
        """Of simulations of this run's kind."""
        names, labels = self.problem.prior.free, labels_of(self.problem.simulator)
        return Store(path, names, labels, self._about())

    def _about(self) -> str:
        """What decides over a simulation, beside parameters and seed."""
        imaging, configuration = self.targets.imaging, self.folder.configuration
        named = {name: configuration[name] for name in ("model", "fixed")} | self.model.settings("infer")
        if imaging is not None:
            named |= {"extent": imaging.extent, "estimator": imaging.estimator, "pixels": imaging.spacing}
        if (resolution := getattr(inside(self.problem.simulator), "resolution", None)) is not None:
            named |= asdict(resolution)
        return ", ".join(f"{name} {value}" for name, value in named.items())

    def _made(self) -> dict[str, str]:
        """How the run was made, for its page."""
        inputs = ", ".join(f"{name} {one[:12]}…" for name, one in list(self.folder.inputs.items())[:PICTURED])
        plain = {**self.folder.configuration, **self.folder.configuration["settings"]}
        made = {name: str(value) for name, value in plain.items() if value is not None and name != "settings"}
        made |= {"seed": str(self.request.seed), "inputs (SHA-256)": f"{len(self.folder.inputs)}: {inputs}"}
        return made | {"versions": ", ".join(f"{name} {one}" for name, one in run_versions().items())}
