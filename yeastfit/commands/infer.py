"""`yeastfit infer`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from yeastfit.commands import infer_run as infer_command
from yeastfit.commands.infer_config import Request
from yeastfit.commands.measured_source import truth_of
from yeastfit.commands.options import (
    SMOOTH,
    Jobs,
    Length,
    MeasurementError,
    Rate,
    Seed,
    Truth,
    names_in,
    with_parameters,
)
from yeastfit.commands.terminal import err, growing, out, shown_progress, warn
from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import DEFAULT_FREE, Resolution
from yeastfit.inference.posterior.prior import template
from yeastfit.model.parameters import PARAMETERS, Scales
from yeastfit.processors import available_processors
from yeastfit.storage import write_manifest


@with_parameters(PARAMETERS)
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
        str | None,
        typer.Option(
            help=f"Curves of the data, with commas: {SMOOTH}, or the table's. By default compactness,radius.",
            show_default=False,
        ),
    ] = None,
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
    walkers: Annotated[int | None, typer.Option(help="Chains; 128 of emulator, 32 of abc-mcmc.")] = None,
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
            help="As Li et al. 2024: abc-mcmc, their distance, indicator, Gaussian proposal Σ/3, beta prior of aspect "
            "ratio; compactness, radius and area, the last area within 5 %.",
        ),
    ] = False,
    draws: Annotated[int, typer.Option(min=10, help="Of the posterior predictive check.")] = 40,
    dt: Annotated[float, typer.Option(help="Time step.")] = Resolution.dt,
    spacing: Annotated[float, typer.Option(help="Of the nutrient's grid, in L0.")] = Resolution.spacing,
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
    of these data makes use of them: the emulator of all, ABC of those that it would grow itself. The emulator compares
    the data with means of as many colonies as were observed; ABC with single ones, unless --colonies says otherwise,
    which widens its posterior. Parameters that are not free are held at the values given here.
    """
    if print_prior:
        sys.stdout.write(template(PARAMETERS.subset(names_in(free)).names, bounded=Request(li=li).bounded))
        return
    if source is None or folder is None:
        raise InputError(f"{'SOURCE' if source is None else '--out'} is missing: yeastfit infer SOURCE --out FOLDER")
    request = Request.of(
        li,
        {
            "method": method or ("abc-mcmc" if li else "emulator"),
            **({"statistics": names_in(statistics)} if statistics is not None else {}),
            **{"free": PARAMETERS.subset(names_in(free)).names},
            **{"condition": condition, "prior": prior, "fixed": parameters, "distance": distance, "epsilon": tolerance},
            **{"share": pilot_quantile, "kernel": kernel, "move": move, "pilot": pilot, "steps": steps},
            **{"walkers": walkers, "population": population, "simulations": simulations, "colonies": colonies},
            **{"draws": draws, "dt": dt, "spacing": spacing, "rate": rate, "length": length, "seed": seed},
            **{"measurement_error": measurement_error, "reuse": reuse},
        },
    )
    known = truth_of(source) if truth else None
    try:
        with shown_progress("measuring micrographs") as advance:
            run = infer_command.Run.begin(request, source, folder, resume, jobs or available_processors(), advance)
    except KeyboardInterrupt:
        err.print("stopped; repeat the command with --resume to go on", markup=False, highlight=False)
        raise
    except OSError as error:
        raise InputError(f"{folder}: {infer_command.reason(error)}") from error
    warn([*run.folder.notes, *run.data.warnings])
    if run.folder.finished:
        warn(["--truth: the page of a finished run stays as it is"] if truth else [])
        out.print(f"this run is finished: results in {folder}, on one page: index.html")
        return
    try:
        with growing(run.most, run.tally.simulated) as (tell, say):
            samples = run.sample(tell, say)
            say("posterior predictive check", 1.0)
            results, remarks = run.results(samples, known, tell)
    except KeyboardInterrupt:
        err.print(f"stopped; {run.folder.resume_hint()}", markup=False, highlight=False, soft_wrap=True)
        raise
    except OSError as error:
        raise InputError(f"{folder}: {infer_command.reason(error)}; {run.folder.resume_hint()}") from error
    more = {"configuration": run.folder.configuration, "seconds": samples.seconds, "warnings": results.warnings}
    write_manifest(folder, command="infer", seed=seed, inputs=infer_command.inputs_of(source), **more)
    warn([*(one for one in results.warnings if one not in run.data.warnings), *remarks])
    out.print(results.table())
    for line in results.lines():
        out.print(line, highlight=False)
    out.print(f"{samples.simulations} simulated data sets. Results in {folder}, on one page: index.html")
