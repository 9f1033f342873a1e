"""`yeastfit design`: which measurement would reduce the errors of the parameters most."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from yeastfit.commands.console.terminal import out, shown_progress, warn
from yeastfit.commands.design_checks import (
    check_effective,
    check_freedom,
    check_logarithms,
    check_measured,
    check_runs,
)
from yeastfit.commands.generated.model import ChosenModel, DesignedStatistics, Fitted, ModelOptions
from yeastfit.commands.generated.options import flag_of, generated
from yeastfit.commands.generated.workers import WorkerOptions, paced
from yeastfit.commands.options import MeasurementError, Out, Overwrite, check_once, names_in, numbers_in
from yeastfit.errors import InputError
from yeastfit.inference.information.design import check_arguments
from yeastfit.inference.information.design import design as make_design
from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.workers.spread import Workers
from yeastfit.numbers import SEEDS
from yeastfit.report.files.design_files import write_design
from yeastfit.results.contents import check_finished
from yeastfit.results.folder import results_folder

REPLICATES, ADDED, RUNS = 10, 10, 256  # unless they are given
NO_TIME = (np.nan,)


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
    replicates: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=f"Number of colonies that have been measured already. By default {REPLICATES}.",
            show_default=False,
        ),
    ] = None,
    added: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=f"Number of further colonies to measure, each of them at one time. By default {ADDED}.",
            show_default=False,
        ),
    ] = None,
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
    measurement_error: MeasurementError = None,
    runs: Annotated[
        int | None,
        typer.Option(
            help=f"Number of colonies to simulate, a multiple of 16. More give smaller errors. By default {RUNS}.",
            show_default=False,
        ),
    ] = None,
    sensitivity: Annotated[
        Path | None,
        typer.Option(help="sensitivity.json of an earlier run, to use instead of new simulations.", show_default=False),
    ] = None,
    overwrite: Overwrite = False,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=SEEDS.high,
            help="Seed of the random numbers, by default 0. The same seed gives the same results.",
            show_default=False,
        ),
    ] = None,
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
        others = {"statistics": statistics is not None, "runs": runs is not None, "seed": seed is not None}
        given = (*chosen.given, *(name for name, one in others.items() if one))
        if given:
            said = f"{flag_of(given[0])} is given beside --sensitivity, but {sensitivity} says it"
            raise InputError(f"{said}: leave out one of the two")
        if workers is not None:
            raise InputError("--workers or --scheduler is given beside --sensitivity, with which no colony grows")
    known: dict[str, Any] = {
        "measured_times": None if measured_times is None else numbers_in("--measured-times", measured_times),
        "measured_statistics": None if measured_statistics is None else names_in(measured_statistics),
        "replicates": REPLICATES if replicates is None else replicates,
        "added": ADDED if added is None else added,
        "new_replicates": not same_colonies,
        "steps": steps,
        "by": by,
        "criterion": criterion,
    }
    for name in ("measured_times", "measured_statistics"):
        check_once(flag_of(name), known[name] or ())
    check_arguments(*(known[name] for name in ("replicates", "added", "steps", "by", "criterion")))
    given_here = {"replicates": replicates, "added": added, "measured_statistics": known["measured_statistics"]}
    check_effective(given_here, known["measured_times"] == [], same_colonies)
    inputs, how = ([sensitivity], {}) if sensitivity else ([], chosen.configuration("design"))
    earlier = _read(sensitivity) if sensitivity else None
    names = chosen.forward.statistics_named(names_in(statistics) or chosen.forward.designed)
    fitted = names_in(free) or chosen.forward.fitted
    if earlier is not None and not free and not set(fitted) <= set(earlier.free):
        raise InputError(
            f"--sensitivity: {sensitivity} holds {', '.join(earlier.free)}, not {', '.join(fitted)}: give --free, or "
            "the --model that it is of"
        )
    runs = RUNS if runs is None else runs
    if earlier is None:
        at = {**chosen.forward.parameters.defaults, **chosen.values}
        check_logarithms(chosen.forward.parameters.subset(fitted).names, at)
        if times := NO_TIME if not chosen.forward.timed else how.get("times"):
            check_measured(known, names, times)
            check_runs(known, names, times, runs, sum(value > 0 for value in at.values()))
    else:
        check_measured(known, earlier.statistics, earlier.times, f"those in {sensitivity}")
        check_freedom(known, earlier, f"--sensitivity: {sensitivity} is of runs that are")
    with results_folder(folder, "design", reads=inputs, overwrite=overwrite) as results:
        if earlier is None:
            with shown_progress("growing colonies") as progress, workers or nullcontext():
                how_far: dict[str, Any] = {} if workers is None else {"elsewhere": workers.spread}
                how_far["progress"] = paced(progress, workers, chosen.forward.nouns[1])
                found = chosen.forward.sensitivity(names, chosen.values, runs=runs, seed=seed or 0, **how_far)
            check_measured(known, found.statistics, found.times, "those of the model")  # where only it knows them
            check_freedom(known, found, f"--runs is {runs}, which is")
            found.save(results.partial / "sensitivity.json")
        else:
            found = earlier
        known["measurement_error"] = chosen.forward.measurement_errors(found.statistics, measurement_error)
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


def _read(path: Path) -> Sensitivity:
    """An earlier sensitivity."""
    check_finished(path.parent)
    try:
        return Sensitivity.load(path)
    except InputError as error:
        raise InputError(f"--sensitivity: {error}, need the sensitivity.json of an earlier run") from error
