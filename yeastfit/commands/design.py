"""`yeastfit design`: which measurement would reduce the errors of the parameters most."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from yeastfit.commands.console.terminal import out, shown_progress, warn
from yeastfit.commands.generated.model import ChosenModel, DesignedStatistics, Fitted, ModelOptions
from yeastfit.commands.generated.options import flag_of, generated
from yeastfit.commands.generated.workers import WorkerOptions, paced
from yeastfit.commands.options import Out, Overwrite, Seed, names_in, numbers_in
from yeastfit.errors import InputError
from yeastfit.inference.information.design import check_arguments
from yeastfit.inference.information.design import design as make_design
from yeastfit.inference.information.experiment import times_among
from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.workers.spread import Workers
from yeastfit.report.files.design_files import write_design
from yeastfit.results.contents import check_finished
from yeastfit.results.folder import results_folder

RUNS = 256


@generated(chosen=ModelOptions("design"), workers=WorkerOptions())
def design(
    folder: Out,
    free: Fitted = None,
    statistics: DesignedStatistics = None,
    measured_times: Annotated[
        str | None,
        typer.Option(
            help="Times that have been measured already, with commas, or none. By default all.", show_default=False
        ),
    ] = None,
    measured_statistics: Annotated[
        str | None,
        typer.Option(
            help="Statistics that have been measured already, with commas. By default all.", show_default=False
        ),
    ] = None,
    replicates: Annotated[int, typer.Option(min=1, help="Number of colonies that have been measured already.")] = 10,
    added: Annotated[
        int, typer.Option(min=1, help="Number of further colonies to measure, each of them at one time.")
    ] = 10,
    same_colonies: Annotated[
        bool, typer.Option("--same-colonies", help="Measure the same colonies again at other times, not further ones.")
    ] = False,
    steps: Annotated[int, typer.Option(min=1, help="Number of measurements to choose, one after the other.")] = 3,
    by: Annotated[
        str, typer.Option(help="What counts as one measurement: image (all its statistics) or statistic (one of them).")
    ] = "image",
    criterion: Annotated[
        str,
        typer.Option(
            help="What to make small: mean, the mean error of log λ, or volume, the volume of the error ellipsoid."
        ),
    ] = "mean",
    measurement_error: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            help="Relative error of measuring a mean curve (0.02 is 2 %), in addition to the variation between "
            "colonies.",
        ),
    ] = 0.01,
    runs: Annotated[
        int, typer.Option(help="Number of colonies to simulate, a multiple of 16. More give smaller errors.")
    ] = RUNS,
    sensitivity: Annotated[
        Path | None,
        typer.Option(help="sensitivity.json of an earlier run, to use instead of new simulations.", show_default=False),
    ] = None,
    overwrite: Overwrite = False,
    seed: Seed = 0,
    *,
    chosen: ChosenModel,
    workers: Workers | None,
) -> None:
    """Find the measurement that would reduce the errors of the parameters most.

    Simulates colonies with the parameters given here and with slightly different ones. Writes one page of everything
    (index.html), design.csv and
    design.png, every possible next measurement with what it would achieve, and spectrum.png and information.json, what
    the existing data can and cannot tell about the parameters.
    """
    if sensitivity:
        others = {"statistics": statistics is not None, "runs": runs != RUNS, "seed": seed != 0}
        given = (*chosen.given, *(name for name, one in others.items() if one))
        if given:
            said = f"{flag_of(given[0])} is given beside --sensitivity, but {sensitivity} says it"
            raise InputError(f"{said}: leave out one of the two")
        if workers is not None:
            raise InputError("--workers or --scheduler is given beside --sensitivity, with which no colony grows")
    known: dict[str, Any] = {
        "measured_times": None if measured_times is None else numbers_in("--measured-times", measured_times),
        "measured_statistics": None if measured_statistics is None else names_in(measured_statistics),
        "replicates": replicates,
        "added": added,
        "new_replicates": not same_colonies,
        "steps": steps,
        "by": by,
        "criterion": criterion,
        "measurement_error": measurement_error,
    }
    check_arguments(replicates, added, steps, by, criterion)
    if same_colonies and measured_times is None and measured_statistics is None:
        raise InputError(
            "--same-colonies: everything counts as measured, so that nothing is left to measure: say what has been "
            "measured by --measured-times or --measured-statistics"
        )
    inputs, how = ([sensitivity], {}) if sensitivity else ([], chosen.configuration("design"))
    earlier = _read(sensitivity) if sensitivity else None
    names = chosen.forward.statistics_named(names_in(statistics) or chosen.forward.designed)
    fitted = names_in(free) or chosen.forward.fitted
    if earlier is not None and not free and not set(fitted) <= set(earlier.free):
        raise InputError(
            f"--sensitivity: {sensitivity} holds {', '.join(earlier.free)}, not {', '.join(fitted)}: give --free, or "
            "the --model that it is of"
        )
    if earlier is None:
        _check_measured(known, names, how.get("times", ()))
        chosen.forward.parameters.subset(fitted)
    with results_folder(folder, "design", reads=inputs, overwrite=overwrite) as results:
        if earlier is None:
            with shown_progress("growing colonies") as progress, workers or nullcontext():
                how_far: dict[str, Any] = {} if workers is None else {"elsewhere": workers.spread}
                how_far["progress"] = paced(progress, workers, chosen.forward.nouns[1])
                found = chosen.forward.sensitivity(names, chosen.values, runs=runs, seed=seed, **how_far)
            found.save(results.partial / "sensitivity.json")
        else:
            found = earlier
        result = make_design(found, free=fitted, **known)
        write_design(results.partial, result, chosen.forward, found, {**how, "free": result.free, **known})
        more: dict[str, Any] = {"configuration": {**how, "parameters": found.at, "free": result.free, **known}}
        if workers is not None:
            more["workers"] = workers.asdict()
        changed = results.finish(seed=found.seed, inputs=inputs, **more)
    warn([*changed, *found.warnings])
    warn([*result.before.sentences(), *result.doubts()])
    values_used = ", ".join(f"{name} {value:g}" for name, value in found.at.items())
    out.print(f"at {values_used}", highlight=False)
    errors = ", ".join(f"{name} {percent(error)}" for name, error in result.before.log_standard_errors.items())
    out.print(f"errors of log λ from what is measured: {errors}", highlight=False)
    for number, sentence in enumerate(result.sentences(), start=1):
        out.print(f"{number}. {sentence}", highlight=False)
    out.print(f"Results in {folder}, on one page: index.html")


def _check_measured(known: Mapping[str, Any], names: Sequence[str], times: Sequence[float]) -> None:
    """Raise `InputError`, before anything is grown, where what has been measured is none of what will be there."""
    for name in known["measured_statistics"] or ():
        if name not in names:
            raise InputError(f"--measured-statistics: {name!r} is not among {', '.join(names)}")
    if known["measured_times"] and len(times):
        try:
            times_among(np.asarray(times), known["measured_times"])
        except InputError:
            said = f"--measured-times is {known['measured_times']}, need some of --times"
            raise InputError(f"{said}, {', '.join(f'{time:g}' for time in times)}") from None


def _read(path: Path) -> Sensitivity:
    """An earlier sensitivity."""
    check_finished(path.parent)
    try:
        return Sensitivity.load(path)
    except InputError as error:
        raise InputError(f"--sensitivity: {error}, need the sensitivity.json of an earlier run") from error
