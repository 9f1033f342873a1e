"""The command line: a thin file over the library. Every run leaves `manifest.json`; bad input ends with exit code 2."""

import functools
import inspect
import os
import sys
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from yeastfit import design_command, fit_command, infer_command, plot
from yeastfit.design_command import Run
from yeastfit.errors import InputError
from yeastfit.gradients import check_gradients
from yeastfit.infer.design import design as make_design
from yeastfit.infer.directions import percent
from yeastfit.infer.fit import DEFAULT_FREE
from yeastfit.infer.fit import fit as run_fit
from yeastfit.infer.fitted import Fit
from yeastfit.infer.priors import template
from yeastfit.infer.settings import MEASUREMENT_ERROR, FitSettings
from yeastfit.infer.space import check_free
from yeastfit.infer.uncertainty import explore, profiles
from yeastfit.measure.dataset import given, read_overrule
from yeastfit.measure.tasks import find_tasks
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import NAMES, PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation import member_keys
from yeastfit.simulation import simulate as run_simulation
from yeastfit.storage import write_manifest, write_table
from yeastfit.survey import survey
from yeastfit.survey_results import clear_results, refuse_mixed_folder, write_results
from yeastfit.synthesis import read_recipes
from yeastfit.synthesis import synthesize as make_dataset

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=__doc__)
INTERRUPTED = 130  # typer's exit code after Ctrl-C
out, err = Console(), Console(stderr=True)

Out = Annotated[Path, typer.Option("--out", help="Folder for the results; made if missing.", show_default=False)]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Random seed: same seed, same result.")]
Rate = Annotated[float, typer.Option("--rate", help="Maximal growth rate μ* per hour; the unit of time is 1/μ*.")]
Truth = Annotated[bool, typer.Option("--truth", help="Show the true parameters beside, if known.")]
Jobs = Annotated[
    int | None, typer.Option(min=1, help="Most processes that measure; by default one a core.", show_default=False)
]
MeasurementError = Annotated[
    float | None,
    typer.Option(min=0, help="Relative, beside the scatter of colonies; by default 0.02 of compactness, else 0.01."),
]
Length = Annotated[float, typer.Option("--length", help="Cell length L0 in µm: the model's unit of length.")]


def _option(name: str) -> Any:
    info = PARAMETERS[name]
    text = f"{info.symbol}: {info.meaning}; plausible {info.plausible[0]:g} to {info.plausible[1]:g}."
    return typer.Option(f"--{name.replace('_', '-')}", help=text, rich_help_panel="Model parameters (dimensionless)")


DEFAULT = {name: info.default for name, info in PARAMETERS.items()}


def _with_parameters(command: Callable[..., None]) -> Callable[..., None]:
    """Gives a command an option for each of λ1 … λ7; it receives them in one dictionary, `parameters`."""

    @functools.wraps(command)
    def wrapped(**given: Any) -> None:
        parameters = {name: given.pop(name) for name in NAMES}
        command(**given, parameters=parameters)

    signature = inspect.signature(command)
    own = [each for each in signature.parameters.values() if each.name != "parameters"]
    kind = inspect.Parameter.KEYWORD_ONLY
    options = [
        inspect.Parameter(name, kind, default=DEFAULT[name], annotation=Annotated[float, _option(name)])
        for name in NAMES
    ]
    wrapped.__signature__ = signature.replace(parameters=[each.replace(kind=kind) for each in own] + options)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {each.name: each.annotation for each in [*own, *options]}
    return wrapped


@app.command()
@_with_parameters
def simulate(
    folder: Out,
    members: Annotated[int, typer.Option(help="How many colonies to grow.")] = 4,
    time: Annotated[float, typer.Option(help="How long, in model units of 1/μ* (2.17 hours by default).")] = 10.0,
    every: Annotated[float, typer.Option(help="Model time between two rows of the table.")] = 0.2,
    hard: Annotated[bool, typer.Option("--hard/--relaxed", help="Exact rules, or the differentiable ones.")] = False,
    dt: Annotated[float, typer.Option(help="Time step.")] = 0.02,
    spacing: Annotated[float, typer.Option(help="Grid spacing in cell lengths L0.")] = 0.1,
    domain: Annotated[float, typer.Option(help="Side of the square dish in L0.")] = 40.0,
    capacity: Annotated[int, typer.Option(help="Largest number of nodes (cells + 1).")] = 500,
    rate: Rate = Scales.rate,
    length: Length = Scales.length,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Grow colonies and write their statistics over time (curves.csv) and pictures.

    curves.csv has a row for each colony and time. Lengths are in cell lengths L0; columns that end in _um are in µm.
    """
    chosen = Parameters(**parameters)
    numerics = Numerics(domain=domain, spacing=spacing, dt=dt, capacity=capacity)
    if not 0 < every <= time:
        raise InputError(f"every is {every:g}, it must be above 0 and at most the time, {time:g}")
    times = np.unique(np.append(np.arange(1, int(time / every + 1e-9) + 1) * every, time))
    keys = member_keys(seed, members)
    relaxation = HARD if hard else Relaxation()
    with _progress("growing colonies") as advance:
        result = run_simulation(
            chosen, keys, times=times, numerics=numerics, relaxation=relaxation, scales=Scales(length, rate)
        )
        write_table(folder / "curves.csv", result.rows())
        result.save(folder / "simulation.npz")
        plot.save(plot.curves(result), folder / "curves.png")
        for member in range(members):
            advance(member + 1, members)
            plot.save(plot.colony(result, member), folder / f"colony_{member}.png")
    _warn(result.warnings())
    configuration = {"parameters": chosen.asdict(), "hard": hard, "numerics": vars(numerics), "members": members}
    more = {"configuration": configuration, "seconds": result.seconds}
    write_manifest(folder, command="simulate", seed=seed, inputs=[], **more)
    count = result.statistics["cell_count"][:, -1]
    out.print(
        f"{members} colonies to t = {result.times[-1]:g} ({result.scales.hours(float(result.times[-1])):.1f} h): "
        f"{count.mean():.1f} cells on average, in {result.seconds:.1f} s. Results in {folder}"
    )


@app.command()
def measure(
    paths: Annotated[
        list[Path],
        typer.Argument(help="A data set, or micrographs (TIFF, PNG, JPEG) and folders of them.", show_default=False),
    ],
    folder: Out,
    pixel_size: Annotated[float | None, typer.Option(help="µm per pixel, for images that do not say it.")] = None,
    seed_point: Annotated[
        str | None, typer.Option(metavar="X,Y", help="A pixel of the colony, where another object would be taken.")
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Contrast with the background, in grey levels, that makes a pixel colony.")
    ] = None,
    roi: Annotated[
        str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Look only there: left, top, right, bottom, in pixels.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Most processes at once; by default one a core.", show_default=False)
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Kept in the manifest only: measuring draws nothing.")] = 0,
) -> None:
    """Outline the colony in each micrograph and measure it; lengths in µm.

    A folder with manifest.csv or manifest.toml is a data set, whose manifest goes before the options given here; of a
    folder without, every image is measured. Writes measurements.csv, masks, overlays to check the outlines by eye,
    contact_sheet.png and index.html, a page of it all; for a data set also the curves of each condition. A file that
    cannot be measured is reported, the rest goes on, and the exit code is 2.
    """
    options: dict[str, Any] = {"seed_point": seed_point, "threshold": threshold, "roi": roi}
    tasks, dataset, skipped = find_tasks(paths, pixel_size, read_overrule(options, "options"))
    refuse_mixed_folder(folder, tasks)
    clear_results(folder)
    with _progress("measuring") as advance:
        outcomes = survey(tasks, folder, jobs=jobs or os.cpu_count() or 1, progress=advance)
    measured = [outcome for outcome in outcomes if outcome.row]
    options["pixel_size"] = pixel_size
    settings = {name: value for name, value in options.items() if value is not None}
    title = f"Micrographs of {(dataset.folder if dataset else paths[0] if len(paths) == 1 else folder).resolve().name}"
    write_results(folder, title, outcomes, dataset=dataset, skipped=skipped, settings=settings)
    inputs = ([dataset.manifest] if dataset else []) + [outcome.task.path for outcome in outcomes if outcome.sha256]
    failed = [outcome.error for outcome in outcomes if not outcome.row]
    overruled = {task.label: given(task.overrule) for task in tasks if given(task.overrule)}
    more = {"configuration": {**settings, "overruled": overruled}, "failed": failed}
    write_manifest(folder, command="measure", seed=seed, inputs=inputs, **more)
    _warn([f"{outcome.task.label}: {doubt}" for outcome in measured for doubt in outcome.doubts])
    if skipped:
        _warn([f"passed over, no images by their names: {', '.join(path.name for path in skipped)}"])
    out.print(f"{len(measured)} of {len(tasks)} micrographs measured. Results in {folder}, on one page: index.html")
    if failed:
        _fail(failed)


@app.command()
def synthesize(
    folder: Out,
    recipe: Annotated[Path, typer.Option(help="TOML file with one table per data set.", show_default=False)],
    only: Annotated[list[str] | None, typer.Option(help="Name of a data set in it; all by default.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the recipe's seed.")] = None,
) -> None:
    """Make synthetic micrographs with known parameters: one data set, OUT/NAME, for each table of the recipe.

    A data set holds photographs, a manifest, and under truth/ what was put in.
    """
    from dataclasses import replace

    recipes = read_recipes(recipe)
    unknown = sorted(set(only or ()) - set(recipes))
    if unknown:
        raise InputError(f"{recipe}: no data set {unknown[0]!r}, there are {', '.join(recipes)}")
    for name in only or recipes:
        chosen = recipes[name] if seed is None else replace(recipes[name], seed=seed)
        with _progress(name) as advance:
            make_dataset(chosen, folder / name, advance)
        write_manifest(folder / name / "truth", command="synthesize", seed=chosen.seed, inputs=[recipe])
        out.print(f"{name}: {chosen.replicates} colonies at {len(chosen.hours)} times in {folder / name}")


@app.command()
@_with_parameters
def fit(
    source: Annotated[
        Path, typer.Argument(help="A data set, or measurements.csv of `yeastfit measure`.", show_default=False)
    ],
    folder: Out,
    condition: Annotated[
        list[str] | None,
        typer.Option(help="Which condition's colonies; again for more, which are fitted together.", show_default=False),
    ] = None,
    free: Annotated[str, typer.Option(help="Parameters to fit, by name, with commas.")] = ",".join(DEFAULT_FREE),
    own: Annotated[
        str, typer.Option(help="Those of them that differ between conditions; the others are shared.")
    ] = "none",
    statistics: Annotated[
        str,
        typer.Option(help="Curves to fit, with commas: compactness, radius, area, perimeter, or what the table has."),
    ] = "compactness,radius",
    bounds: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH", help="Search there, not over the plausible range.", show_default=False),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE:WIDTH", help="Gaussian in log λ: its centre λ, and its width.", show_default=False
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="levenberg-marquardt, dogleg or bfgs.")] = FitSettings.method,
    starts: Annotated[int, typer.Option(min=1, help="Places to begin from.")] = FitSettings.starts,
    dt: Annotated[float, typer.Option(help="Time step.")] = FitSettings.dt,
    measurement_error: MeasurementError = None,
    bootstrap: Annotated[int, typer.Option(min=0, help="Fits of resampled replicates to make, 500 for instance.")] = 0,
    profile: Annotated[bool, typer.Option("--profile", help="Profile the likelihood of every parameter.")] = False,
    rate: Rate = Scales.rate,
    length: Length = Scales.length,
    truth: Truth = False,
    jobs: Jobs = None,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Fit model parameters to the curves of a data set, with errors (fit.json, parameters.csv, pictures).

    Micrographs are measured first, with all that `yeastfit measure` leaves; measurements.csv saves that. A single
    photograph of each colony will do. Parameters that are not free are held at the values given here. Exit code 1 where
    the fit did not converge.
    """
    for name in fit_command.RESULTS:
        (folder / name).unlink(missing_ok=True)
    fit_command.check_conditions(source, condition or ())
    with _progress("measuring micrographs") as advance:
        data = fit_command.measurements(source, folder, jobs or os.cpu_count() or 1, advance)
    _warn(data.warnings)
    targets = data.targets(condition or (), design_command.names(statistics), Scales(length, rate))
    fit_command.write_targets(folder, targets)
    options: dict[str, Any] = {
        "free": design_command.names(free),
        "own": () if own == "none" else design_command.names(own),
        "bounds": fit_command.named_numbers("--bounds", bounds or (), "the ends of a range"),
        "prior": fit_command.named_numbers("--prior", prior or (), "its centre and width"),
    }
    error = MEASUREMENT_ERROR if measurement_error is None else measurement_error
    settings = FitSettings(method=method, starts=starts, dt=dt, measurement_error=error)  # type: ignore[arg-type]
    single = next(iter(targets.values())) if len(targets) == 1 else targets
    with _stages() as stage:
        result = run_fit(
            single, fixed=Parameters(**parameters), seed=seed, settings=settings, progress=stage, **options
        )
    known = fit_command.read_truth(source) if truth else None
    fit_command.write_fit(folder, result, known)
    lines = _explored(folder, result, bootstrap, profile)
    more = {"configuration": {"parameters": parameters, **options}, "seconds": result.seconds, "status": result.status}
    write_manifest(folder, command="fit", seed=seed, inputs=data.inputs, **more)
    _warn(list(result.warnings))
    out.print(fit_command.table_of(result, known))
    for line in lines:
        out.print(line, highlight=False)
    out.print(
        f"{result.status}; chi-square {result.chi_square:.1f} on {result.degrees_of_freedom} degrees of freedom; "
        f"{result.simulations} simulated colonies in {result.seconds:.0f} s. Results in {folder}"
    )
    if not result.converged:
        raise typer.Exit(1)


def _explored(folder: Path, result: Fit, bootstrap: int, profile: bool) -> list[str]:
    """Bootstrap and profiles, where they are asked for."""
    if not (bootstrap or profile):
        return []
    with _stages() as stage:
        stage("growing colonies around the estimate", 0.0)
        explored = explore(result)
    lines = fit_command.write_bootstrap(folder, explored.bootstrap(bootstrap), result) if bootstrap else []
    return lines + (fit_command.write_profiles(folder, profiles(explored)) if profile else [])


@app.command()
@_with_parameters
def infer(
    source: Annotated[
        Path | None, typer.Argument(help="A data set, or measurements.csv of `yeastfit measure`.", show_default=False)
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", help="Folder of the run; made if missing.", show_default=False)
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="emulator (by default), abc-mcmc or abc-smc.", show_default=False)
    ] = None,
    free: Annotated[str, typer.Option(help="Parameters to infer, by name, with commas.")] = ",".join(DEFAULT_FREE),
    statistics: Annotated[
        str, typer.Option(help="Curves of the data, with commas: compactness, radius, area, perimeter, or the table's.")
    ] = "compactness,radius",
    condition: Annotated[str | None, typer.Option(help="Which condition's colonies.", show_default=False)] = None,
    prior: Annotated[
        Path | None, typer.Option(help="TOML file; by default log-uniform, plausible ranges.", show_default=False)
    ] = None,
    print_prior: Annotated[
        bool, typer.Option("--print-prior", help="Print such a file for the free parameters, and end.")
    ] = False,
    simulations: Annotated[
        int | None,
        typer.Option(help="Simulated data sets at most; 4096, abc-smc 20000.", show_default=False),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="abc-mcmc: steps of each chain, in all, resumed ones included; 1000.")
    ] = None,
    walkers: Annotated[int | None, typer.Option(help="Chains; 32, which colonies are grown together.")] = None,
    distance: Annotated[
        str | None, typer.Option(help="ABC: mahalanobis (by default), curves or li.", show_default=False)
    ] = None,
    tolerance: Annotated[float | None, typer.Option(help="ABC: ε, the largest distance.", show_default=False)] = None,
    pilot_quantile: Annotated[
        float | None, typer.Option(help="abc-mcmc: or ε as this quantile of the pilot's distances; 0.02.")
    ] = None,
    pilot: Annotated[int | None, typer.Option(help="ABC: simulations from the prior beforehand; 500.")] = None,
    kernel: Annotated[str | None, typer.Option(help="abc-mcmc: indicator (by default) or gaussian.")] = None,
    move: Annotated[str | None, typer.Option(help="abc-mcmc: gaussian (by default), stretch or de.")] = None,
    population: Annotated[int | None, typer.Option(help="abc-smc: draws of a population; 500.")] = None,
    colonies: Annotated[
        int | None, typer.Option(help="ABC: colonies whose mean is one simulated data set; 1.", show_default=False)
    ] = None,
    li: Annotated[
        bool,
        typer.Option(
            "--li",
            help="As Li et al. 2024: abc-mcmc, their distance, indicator, Gaussian proposal Σ/3; area within 5 %.",
        ),
    ] = False,
    draws: Annotated[int, typer.Option(min=10, help="Of the posterior predictive check.")] = 40,
    dt: Annotated[float, typer.Option(help="Time step.")] = FitSettings.fine_dt,
    spacing: Annotated[float, typer.Option(help="Of the nutrient's grid, in L0.")] = FitSettings.fine_spacing,
    measurement_error: MeasurementError = None,
    reuse: Annotated[
        Path | None,
        typer.Option(help="Folder of another run, whose simulations serve again.", show_default=False),
    ] = None,
    rate: Rate = Scales.rate,
    length: Length = Scales.length,
    truth: Truth = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in the folder.")] = False,
    jobs: Jobs = None,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Infer the posterior of model parameters from a data set (posterior.csv, samples.npz, index.html).

    Micrographs are measured first. Every simulation is kept: a run that was stopped, or killed, goes on with --resume
    to the bits it would have come to, and with more --steps or --simulations it gets longer; with --reuse another run
    of these data, by any method, makes use of them. The emulator compares the
    data with means of as many colonies as were observed; ABC with single ones, unless --colonies says otherwise, which
    widens its posterior. Parameters that are not free are held at the values given here.
    """
    if print_prior:
        sys.stdout.write(template(check_free(design_command.names(free))))
        return
    if source is None or folder is None:
        raise InputError(f"{'SOURCE' if source is None else '--out'} is missing: yeastfit infer SOURCE --out FOLDER")
    request = infer_command.Request.of(
        li,
        {
            "method": method or ("abc-mcmc" if li else "emulator"),
            **{"free": check_free(design_command.names(free)), "statistics": design_command.names(statistics)},
            **{"condition": condition, "prior": prior, "fixed": parameters, "distance": distance, "epsilon": tolerance},
            **{"share": pilot_quantile, "kernel": kernel, "move": move, "pilot": pilot, "steps": steps},
            **{"walkers": walkers, "population": population, "simulations": simulations, "colonies": colonies},
            **{"draws": draws, "dt": dt, "spacing": spacing, "rate": rate, "length": length, "seed": seed},
            **{"measurement_error": measurement_error, "reuse": reuse},
        },
    )
    try:
        with _progress("measuring micrographs") as advance:
            run = infer_command.Run.begin(request, source, folder, resume, jobs or os.cpu_count() or 1, advance)
    except OSError as error:
        raise InputError(f"{folder}: {infer_command.reason(error)}") from error
    _warn([*run.folder.notes, *run.data.warnings])
    if run.folder.finished:
        out.print(f"this run is finished: results in {folder}, on one page: index.html")
        return
    try:
        with _simulations() as (tell, say):
            samples = run.sample(tell, say)
            say("posterior predictive check", 1.0)
            results, remarks = run.results(samples, fit_command.read_truth(source) if truth else None, tell)
    except KeyboardInterrupt:
        err.print(f"stopped; {run.folder.resume_hint()}", markup=False, highlight=False, soft_wrap=True)
        raise
    except OSError as error:
        raise InputError(f"{folder}: {infer_command.reason(error)}; {run.folder.resume_hint()}") from error
    more = {"configuration": run.folder.configuration, "seconds": samples.seconds, "warnings": results.warnings}
    write_manifest(folder, command="infer", seed=seed, inputs=infer_command.inputs_of(source), **more)
    _warn([*results.warnings, *remarks])
    out.print(results.table())
    for line in results.lines():
        out.print(line, highlight=False)
    out.print(f"{samples.simulations} simulated data sets. Results in {folder}, on one page: index.html")


@app.command()
@_with_parameters
def gradcheck(
    folder: Annotated[
        Path | None, typer.Option("--out", help="Folder for gradcheck.csv; without it, only the terminal.")
    ] = None,
    time: Annotated[float, typer.Option(help="How long the colony grows; it is looked at half-way, too.")] = 3.0,
    dt: Annotated[float, typer.Option(help="Time step.")] = 0.02,
    spacing: Annotated[float, typer.Option(help="Grid spacing in cell lengths L0.")] = 0.2,
    domain: Annotated[float, typer.Option(help="Side of the square dish in L0.")] = 12.0,
    capacity: Annotated[int, typer.Option(help="Largest number of nodes (cells + 1).")] = 64,
    contact: Annotated[float, typer.Option(help="Width of the contact ramp in L0; 0 is the hard rule.")] = 0.2,
    tolerance: Annotated[float, typer.Option(help="Largest relative difference.")] = 5e-4,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Check the derivatives of a colony's statistics against differences and reverse mode (gradcheck.csv).

    In every parameter and width, and in random directions of initial positions, nutrient and budding angles. Ends with
    exit code 1 unless all agree. The table shows the worst of each direction.
    """
    chosen = Parameters(**parameters)
    numerics = Numerics(domain=domain, spacing=spacing, dt=dt, capacity=capacity)
    with _progress("comparing derivatives") as advance:
        result = check_gradients(
            chosen,
            times=[time / 2, time],
            key=seed,
            numerics=numerics,
            relaxation=Relaxation(contact=contact),
            tolerance=tolerance,
            progress=advance,
        )
    lines = result.summary()
    table = Table(*lines[0])
    for line in lines:
        table.add_row(*line.values())
    out.print(table)
    if folder:
        write_table(folder / "gradcheck.csv", result.rows())
        configuration = {"parameters": chosen.asdict(), "contact": contact, "numerics": vars(numerics)}
        more = {"configuration": configuration, "passed": result.passed}
        write_manifest(folder, command="gradcheck", seed=seed, inputs=[], **more)
    _warn(result.warnings())
    out.print(result.status + (f". Results in {folder}" if folder else ""))
    if not result.passed:
        raise typer.Exit(1)


@app.command()
@_with_parameters
def design(
    folder: Out,
    free: Annotated[str, typer.Option(help="Parameters to be found, by name, with commas.")] = ",".join(DEFAULT_FREE),
    times: Annotated[str, typer.Option(help="Model times that could be measured, with commas.")] = Run.times,
    statistics: Annotated[
        str, typer.Option(help="Curves that could be measured: compactness, radius, area, mean_radius, cell_count.")
    ] = Run.statistics,
    measured_times: Annotated[
        str | None, typer.Option(help="Which of the times are measured already; all by default, or none.")
    ] = None,
    measured_statistics: Annotated[
        str | None, typer.Option(help="Which of the curves are measured already; all by default.")
    ] = None,
    replicates: Annotated[int, typer.Option(min=1, help="Colonies measured already.")] = 10,
    added: Annotated[int, typer.Option(min=1, help="Further colonies, each seen at one time.")] = 10,
    same_colonies: Annotated[
        bool, typer.Option("--same-colonies", help="Not further colonies: those measured, at other times.")
    ] = False,
    steps: Annotated[int, typer.Option(min=1, help="How many measurements, one after the other.")] = 3,
    by: Annotated[str, typer.Option(help="One measurement is an image, with all curves, or a statistic.")] = "image",
    criterion: Annotated[str, typer.Option(help="Errors of log λ: their mean, or the volume they span.")] = "mean",
    measurement_error: Annotated[float, typer.Option(min=0, help="Relative, beside the scatter of colonies.")] = 0.01,
    runs: Annotated[int, typer.Option(help="Colonies to grow, a multiple of 16.")] = Run.runs,
    dt: Annotated[float, typer.Option(help="Time step.")] = Run.dt,
    sensitivity: Annotated[
        Path | None, typer.Option(help="sensitivity.json of an earlier run, instead of a new one.", show_default=False)
    ] = None,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Say which time and which curve, measured next, shrinks the errors of λ most (design.csv).

    Grows colonies at and around the λ given. spectrum.png and information.json show what the data measured already can
    tell and what they cannot; design.png every candidate for the next measurement.
    """
    changed = {name: value for name, value in parameters.items() if value != DEFAULT[name]}
    colonies = Run(changed, times, statistics, runs, dt, seed)
    for name in design_command.RESULTS:
        (folder / name).unlink(missing_ok=True)
    if sensitivity:
        colonies.refuse_beside(sensitivity)
        found = design_command.read_sensitivity(sensitivity)
    else:
        with _stages() as stage:
            found = colonies.sensitivity(stage)
        found.save(folder / "sensitivity.json")
    known: dict[str, Any] = {
        "measured_times": measured_times and design_command.numbers("--measured-times", measured_times),
        "measured_statistics": measured_statistics and design_command.names(measured_statistics),
        "replicates": replicates,
        "added": added,
        "new_colonies": not same_colonies,
        "steps": steps,
        "by": by,
        "criterion": criterion,
        "measurement_error": measurement_error,
    }
    result = make_design(found, free=design_command.names(free), **known)
    design_command.write_design(folder, result)
    configuration = {"parameters": found.parameters.asdict(), "free": result.free, **known}
    inputs = [sensitivity] if sensitivity else []
    write_manifest(folder, command="design", seed=found.seed, inputs=inputs, configuration=configuration)
    _warn(found.warnings)
    _warn(result.before.sentences())
    values_used = ", ".join(f"{name} {value:g}" for name, value in found.parameters.asdict().items())
    out.print(f"at {values_used}", highlight=False)
    errors = ", ".join(f"{name} {percent(error)}" for name, error in result.before.standard_errors.items())
    out.print(f"errors of log λ from what is measured: {errors}", highlight=False)
    for number, sentence in enumerate(result.sentences(), start=1):
        out.print(f"{number}. {sentence}", highlight=False)
    out.print(f"Results in {folder}")


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on a terminal, nothing elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def _stages() -> Iterator[Callable[[str, float], None]]:
    """What a fit is doing: a bar on a terminal, nothing elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        task = bar.add_task("fitting", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


@contextmanager
def _simulations() -> Iterator[tuple[Callable[[int], None], Callable[[str, float], None]]]:
    """What a sampler is doing, with colonies grown a second and the time that is left; nothing but on a terminal."""
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[grown]}")),
        *(TimeElapsedColumn(), TimeRemainingColumn(elapsed_when_finished=True)),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        task = bar.add_task("sampling", total=1.0, grown="")
        began, grown = clock.perf_counter(), 0

        def tell(rows: int) -> None:
            nonlocal grown
            grown += rows
            each = grown / (clock.perf_counter() - began)
            bar.update(task, grown=f"{grown} colonies, {each:.1f} a second")

        yield tell, lambda what, share: bar.update(task, description=what, completed=share)


def _warn(lines: list[str]) -> None:
    for line in lines:
        err.print(f"warning: {line}", markup=False, highlight=False, soft_wrap=True)


def _fail(lines: list[str]) -> None:
    for line in lines:
        err.print(f"error: {line}", markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(2)


def run(arguments: list[str] | None = None) -> int:
    """Run one command (by default the one on the command line) and return its exit code."""
    try:
        app(arguments)
    except InputError as error:
        err.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        return 2
    except SystemExit as finished:
        if finished.code == INTERRUPTED:
            err.print("interrupted: what stands in the folder without a manifest.json is not a result")
        return int(finished.code or 0)
    return 0


def main() -> None:
    """Entry point of `yeastfit`."""
    # one JAX device per core, over which ensembles are shared out
    jax.config.update("jax_num_cpu_devices", os.cpu_count() or 1)
    sys.exit(run())
