"""`yeastfit infer`."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.commands.console.failures import reason
from yeastfit.commands.console.signals import remaining
from yeastfit.commands.console.terminal import Pace, out, shown_progress, warn
from yeastfit.commands.generated.model import ChosenModel, Inferred, ModelOptions, Statistics
from yeastfit.commands.generated.options import completion, flag_of, generated
from yeastfit.commands.generated.samplers import SamplerOptions
from yeastfit.commands.generated.workers import WorkerOptions
from yeastfit.commands.measured_source import check_source, colonies_at, hours_of, truth_of
from yeastfit.commands.options import Jobs, MeasurementError, Overwrite, Seed, Truth, folder_option, names_in
from yeastfit.commands.posterior_run.config import Request
from yeastfit.commands.posterior_run.leave_out import check_groups
from yeastfit.commands.posterior_run.run import SIMULATIONS, STORED, InferRun
from yeastfit.commands.run_folder import inputs_of, read_run
from yeastfit.errors import InputError
from yeastfit.inference.prior.prior import template
from yeastfit.inference.prior.variation import Variation
from yeastfit.inference.samplers import SAMPLERS
from yeastfit.inference.workers.spread import Workers
from yeastfit.processors import available_processors
from yeastfit.results.contents import GONE, Contents, not_as_written
from yeastfit.results.contents import RUN as RUN_FILE
from yeastfit.results.folder import ResultsFolder, results_folder

DATA, MODEL, RUN = "Data", "Model and prior", "The run"


@generated(chosen=ModelOptions("infer"), settings=SamplerOptions(), workers=WorkerOptions())
def infer(
    source: Annotated[
        Path | None, typer.Argument(help="A data set, or measurements.csv of `yeastfit measure`.", show_default=False)
    ] = None,
    folder: Annotated[
        Path | None,
        folder_option("Folder of the run; made if missing.", show_default=False, rich_help_panel=RUN),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help=f"How the posterior is sampled: {', '.join(SAMPLERS)}; by default the first.",
            autocompletion=completion(SAMPLERS),
            show_default=False,
            rich_help_panel=MODEL,
        ),
    ] = None,
    free: Inferred = None,
    statistics: Statistics = None,
    condition: Annotated[
        str | None,
        typer.Option(
            help="Condition whose colonies are used. Needed where the data have more than one.",
            show_default=False,
            rich_help_panel=DATA,
        ),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            help="What is known of the parameters beforehand, a TOML file. By default plausible values count alike.",
            show_default=False,
            rich_help_panel=MODEL,
        ),
    ] = None,
    print_prior: Annotated[
        bool,
        typer.Option(
            "--print-prior",
            help="Print a file for --prior to start from, for the free parameters, and end.",
            rich_help_panel=MODEL,
        ),
    ] = False,
    li: Annotated[
        bool,
        typer.Option(
            "--li",
            help="As Li et al. 2024: abc-mcmc, their distance, indicator, Gaussian proposal Σ/3, beta prior of aspect "
            "ratio; compactness, radius and area unless --statistics names others; the last area within 5 %.",
            rich_help_panel=MODEL,
        ),
    ] = False,
    draws: Annotated[
        int | None,
        typer.Option(
            min=10,
            help=f"Data sets simulated at the end to check the posterior, at least 10. Default: {Request.draws}.",
            show_default=False,
            rich_help_panel=RUN,
        ),
    ] = None,
    prior_draws: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Data sets simulated from the prior for posterior.nc, which ArviZ compares with the data; 0 for none. "
            f"Default: {Request.prior_draws}.",
            show_default=False,
            rich_help_panel=RUN,
        ),
    ] = None,
    measurement_error: MeasurementError = None,
    variation: Annotated[
        bool,
        typer.Option(
            "--variation/--no-variation",
            help="Whether parameters may differ from colony to colony: their scatter is inferred too, from the single "
            "colonies. Without it all colonies have the same parameters, and are compared by their mean.",
            rich_help_panel=MODEL,
        ),
    ] = False,
    varying: Annotated[
        str | None,
        typer.Option(
            help="Which parameters may differ from colony to colony, separated by commas. Default: all free ones but "
            "those that all colonies share.",
            show_default=False,
            rich_help_panel=MODEL,
        ),
    ] = None,
    variation_zero: Annotated[
        float | None,
        typer.Option(
            help=f"Prior probability that parameters do not scatter. Default: {Variation.zero:g}.",
            show_default=False,
            rich_help_panel=MODEL,
        ),
    ] = None,
    variation_sd: Annotated[
        float | None,
        typer.Option(
            help="Prior of the scatter where they do: sd of a half-normal distribution, in log λ or logit λ. "
            f"Default: {Variation.sd:g}.",
            show_default=False,
            rich_help_panel=MODEL,
        ),
    ] = None,
    leave_out: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Groups into which the colonies are dealt: each group is left out once and predicted by the others; 0 "
            f"for none. No further simulations are needed. Default: {Request.leave_out}.",
            show_default=False,
            rich_help_panel=RUN,
        ),
    ] = None,
    reuse: Annotated[
        Path | None,
        typer.Option(
            help="Folder of another run on the same data, whose simulations are used again.",
            show_default=False,
            rich_help_panel=RUN,
        ),
    ] = None,
    truth: Truth = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the run in the folder.", rich_help_panel=RUN)
    ] = False,
    overwrite: Overwrite = False,
    jobs: Jobs = None,
    seed: Seed = 0,
    *,
    chosen: ChosenModel,
    settings: dict[str, Any],
    workers: Workers | None,
) -> None:
    """Infer which model parameters the data leave possible (posterior.csv, posterior.npz, index.html).

    Micrographs are measured first. Every simulation is kept: --resume reproduces the uninterrupted run exactly
    after a stop or a kill, makes it longer with more --steps or --simulations, and predicts anew with other
    --draws, --prior-draws or --leave-out. --reuse reads another run's simulations: the emulator trains on all of
    them, ABC on those it would have made itself. The emulator compares the data with means of as many colonies as
    were observed; ABC with single ones, unless --colonies says otherwise, which widens its posterior. --variation
    lets colonies differ in their parameters. Parameters that are not free are held at the values given here. Exit
    code 1 where the posterior has not settled.
    """
    asked: dict[str, Any] = {
        **{"model": chosen.name, "forward_model": chosen.forward, "fixed": chosen.values},
        **{"free": names_in(free), "statistics": names_in(statistics), "condition": condition, "prior": prior},
        **{
            **_as_before(folder if resume else None, draws=draws, prior_draws=prior_draws, leave_out=leave_out),
            "measurement_error": measurement_error,
            "variation": _variation(names_in(varying), zero=variation_zero, sd=variation_sd) if variation else None,
            "reuse": reuse,
            "seed": seed,
        },
    }
    sampled = "emulator" if method is None else method
    if not variation and (varying, variation_zero, variation_sd) != (None, None, None):
        raise InputError(
            "--varying, --variation-zero or --variation-sd is given, a setting of --variation: give that, too"
        )
    request = Request.of_li(method, settings, **asked) if li else Request.of(sampled, settings, **asked)
    chosen.check_free(request.parameters.names)
    if print_prior:
        of_runs: dict[str, Any] = {"--resume": resume, "--overwrite": overwrite, "--truth": truth, "--reuse": reuse}
        of_runs |= {"--out": folder, "SOURCE": source, "--workers or --scheduler": workers, "--jobs": jobs}
        of_runs |= {"--condition": condition, "--statistics": statistics, "--measurement-error": measurement_error}
        of_runs |= {"--draws": draws, "--prior-draws": prior_draws}
        of_runs |= {"--leave-out": leave_out, "--method": method, **{flag_of(name): True for name in settings}}
        for name, given in of_runs.items():
            if given is not None and given is not False and given != 0:
                raise InputError(f"{name} is given beside --print-prior, which begins no run: leave out one of the two")
        sys.stdout.write(template(request.the_prior(), request.parameters))
        return
    if source is None or folder is None:
        raise InputError(f"{'SOURCE' if source is None else '--out'} is missing: yeastfit infer SOURCE --out FOLDER")
    if resume and overwrite:
        raise InputError("--overwrite starts over, --resume continues: give one of the two")
    conditions, columns = [] if condition is None else [condition], request.forward_model.columns
    (images,) = check_source(source, conditions, columns, statistics=request.statistics, jobs=jobs).values()
    _check_images(request, images)
    if workers is not None:
        workers.check()
    true_values = truth_of(source, request.forward_model.parameters) if truth else None
    reads = [*inputs_of(source), *([reuse / SIMULATIONS] if reuse else [])]
    with results_folder(folder, "infer", reads=reads, overwrite=overwrite, resume=resume, stored=STORED) as results:
        if resume and not (folder / RUN_FILE).is_file() and not results.finished:
            warn([f"--resume: there is nothing to resume in {folder}, a new run begins"])
        run = _begun(request, source, results, resume, jobs or available_processors())
        warn([*run.folder.notes, *run.data.warnings])
        settled = _finished(run, truth) if results.finished else _run(run, true_values, workers)
    if not settled:
        raise typer.Exit(1)


def _as_before(folder: Path | None, **given: int | None) -> dict[str, Any]:
    """Entries of `Request` that leave the posterior as it is; what is not given is that of the run which goes on."""
    before: Mapping[str, Any] = {}
    if folder is not None and (folder / RUN_FILE).is_file():
        with suppress(InputError):  # a run that cannot go on says why
            before = read_run(folder / RUN_FILE)["configuration"]
    known = {name: one for name, one in before.items() if type(one) is int}
    return {name: known.get(name, getattr(Request, name)) if one is None else one for name, one in given.items()}


def _check_images(request: Request, images: Sequence[Mapping[str, Any]]) -> None:
    """Raise `InputError` where the request does not suit the images that there are."""
    model, hours = request.forward_model, hours_of(images)
    compared = hours if model.timed else hours[-1:]
    model.check(request.largest(), compared)
    model.check_images(images, request.statistics)
    request.check_sampler(len(request.statistics) * max(1, len(compared)))
    names, there = colonies_at(images, compared if model.timed else ())
    check_groups(request.leave_out, names, there, model.nouns)


def _variation(varying: tuple[str, ...], **given: float | None) -> Variation:
    """Raise `InputError` by the names of the options."""
    try:
        return Variation(varying=varying, **{name: value for name, value in given.items() if value is not None})
    except InputError as error:
        raise InputError(str(error).replace("variation: ", "--variation-")) from None


def _begun(request: Request, source: Path, results: ResultsFolder, resume: bool, jobs: int) -> InferRun:
    """Measure or read the data."""
    try:
        with (
            remaining("repeat the command with --resume to go on"),
            shown_progress("measuring micrographs") as progress,
        ):
            return InferRun.begin(request, source, results, resume, jobs, progress)
    except OSError as error:
        raise InputError(f"{results.path}: {reason(error)}") from error


def _finished(run: InferRun, truth: bool) -> bool:
    """Say that there is nothing to do; whether the posterior has settled."""
    path = run.folder.path
    others = not_as_written(path, Contents.of(path).listed)
    for name in (one for one, what in others.items() if what == GONE):
        raise InputError(
            f"--resume: {path / name} is gone since the run finished: put it back, or begin anew by --overwrite"
        )
    warn(["--truth: the page of a finished run stays as it is"] if truth else [])
    warn([f"{path / name} {what} since the run finished" for name, what in others.items()])
    posterior = run.saved()
    out.print(f"this run is finished: results in {run.folder.path}, on one page: index.html")
    out.print(str(posterior.status))
    return posterior.settled


@contextmanager
def _opened(workers: Workers | None, run: InferRun) -> Iterator[None]:
    """Workers where some are asked for; a run that has not simulated leaves nothing where there are none."""
    with ExitStack() as stack:
        try:
            stack.enter_context(workers or nullcontext())
        except InputError:
            if not run.tally.simulated:
                run.folder.take_back()
            raise
        yield


def _run(run: InferRun, truth: Mapping[str, float] | None, workers: Workers | None) -> bool:
    """Sample and write everything; whether the posterior has settled."""
    folder = run.folder.path
    try:
        with remaining(run.folder.resume_hint()), shown_progress("sampling") as progress, _opened(workers, run):
            run = run.on(workers)
            pace = Pace(run.simulations_at_most, run.tally.simulated, run.model.nouns[1], progress)
            pace.aside = str if workers is None else lambda: workers.status
            posterior = run.sample(pace.count, pace)
            pace("posterior predictive check", 1.0)
            summary, remarks = run.results(posterior, truth, pace.count, pace)
        more = {"configuration": run.folder.configuration, "seconds": posterior.seconds, "warnings": summary.warnings}
        more |= {"status": posterior.status.name}
        if workers is not None or run.mixed():
            more["workers"] = {**({} if workers is None else workers.asdict()), "mixed_arithmetic": run.mixed()}
        finish = run.folder.results.finish
        changed = finish(seed=run.request.seed, inputs=inputs_of(run.source), kept=STORED, **more)
    except OSError as error:
        raise InputError(f"{folder}: {reason(error)}; {run.folder.resume_hint()}") from error
    warn([*changed, *(one for one in summary.warnings if one not in run.data.warnings), *remarks])
    out.print(summary.table())
    for line in summary.lines():
        out.print(line, highlight=False)
    out.print(f"{posterior.simulations} simulations. Results in {folder}, on one page: index.html")
    return posterior.settled
