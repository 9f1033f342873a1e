"""`yeastfit fit`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.commands import design_run as design_command
from yeastfit.commands import measured_source as fit_command
from yeastfit.commands.options import Jobs, Length, MeasurementError, Out, Rate, Seed, Truth, with_parameters
from yeastfit.commands.terminal import out, shown_progress, warn
from yeastfit.inference.fit.bootstrap_profile import explore, profiles
from yeastfit.inference.fit.least_squares import DEFAULT_FREE
from yeastfit.inference.fit.least_squares import fit as run_fit
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.settings import MEASUREMENT_ERROR, FitSettings
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.processors import available_processors
from yeastfit.storage import write_manifest


@with_parameters
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
    options: dict[str, Any] = {
        "free": design_command.names(free),
        "own": () if own == "none" else design_command.names(own),
        "bounds": fit_command.named_numbers("--bounds", bounds or (), "the ends of a range"),
        "prior": fit_command.named_numbers("--prior", prior or (), "its centre and width"),
    }
    error = MEASUREMENT_ERROR if measurement_error is None else measurement_error
    settings = FitSettings(method=method, starts=starts, dt=dt, measurement_error=error)  # type: ignore[arg-type]
    fit_command.check_source(source, condition or ())
    known = fit_command.known_truth(source) if truth else None
    for name in fit_command.RESULTS:
        (folder / name).unlink(missing_ok=True)
    with shown_progress("measuring micrographs") as advance:
        data = fit_command.measurements(source, folder, jobs or available_processors(), advance)
    warn(data.warnings)
    targets = data.targets(condition or (), design_command.names(statistics), Scales(length, rate))
    fit_command.write_targets(folder, targets)
    single = next(iter(targets.values())) if len(targets) == 1 else targets
    with shown_progress("fitting") as stage:
        result = run_fit(
            single, fixed=Parameters(**parameters), seed=seed, settings=settings, progress=stage, **options
        )
    fit_command.write_fit(folder, result, known)
    lines = _explored(folder, result, bootstrap, profile)
    more = {"configuration": {"parameters": parameters, **options}, "seconds": result.seconds, "status": result.status}
    write_manifest(folder, command="fit", seed=seed, inputs=data.inputs, **more)
    warn(list(result.warnings))
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
    with shown_progress("fitting") as stage:
        stage("growing colonies around the estimate", 0.0)
        explored = explore(result)
    lines = fit_command.write_bootstrap(folder, explored.bootstrap(bootstrap), result) if bootstrap else []
    return lines + (fit_command.write_profiles(folder, profiles(explored)) if profile else [])
