"""`yeastfit design`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.commands import design_run as design_command
from yeastfit.commands.design_run import Run
from yeastfit.commands.options import DEFAULT, Out, Seed, with_parameters
from yeastfit.commands.terminal import out, shown_progress, warn
from yeastfit.inference.fit.least_squares import DEFAULT_FREE
from yeastfit.inference.information.design import design as make_design
from yeastfit.inference.information.identifiability import percent
from yeastfit.storage import write_manifest


@with_parameters
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
        with shown_progress("growing colonies") as stage:
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
    warn(found.warnings)
    warn(result.before.sentences())
    values_used = ", ".join(f"{name} {value:g}" for name, value in found.parameters.asdict().items())
    out.print(f"at {values_used}", highlight=False)
    errors = ", ".join(f"{name} {percent(error)}" for name, error in result.before.standard_errors.items())
    out.print(f"errors of log λ from what is measured: {errors}", highlight=False)
    for number, sentence in enumerate(result.sentences(), start=1):
        out.print(f"{number}. {sentence}", highlight=False)
    out.print(f"Results in {folder}")
