"""`yeastfit design`: which measurement would reduce the errors of the parameters most."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from yeastfit.commands.options import Out, Seed, names_in, numbers_in, with_parameters
from yeastfit.commands.terminal import out, shown_progress, warn
from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import DEFAULT_FREE
from yeastfit.inference.information.design import design as make_design
from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.sensitivity.estimate import sensitivity as estimate_sensitivity
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.measure.statistics.registry import known_statistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters
from yeastfit.progress import Progress
from yeastfit.report.design_files import FILES, write_design
from yeastfit.storage import remove_files, write_manifest


@dataclass(frozen=True)
class Colonies:
    """Which colonies to grow for the sensitivity, as the options say it; parameters where they are not the default."""

    changed: dict[str, float] = field(default_factory=dict)
    times: str = "2,3,4,5,6"
    statistics: str = "compactness,radius,area"
    runs: int = 256
    dt: float = 0.005
    seed: int = 0

    def sensitivity(self, progress: Progress) -> Sensitivity:
        """Estimate the derivatives by regression along all parameters, which costs as much as along one."""
        times = numbers_in("--times", self.times)
        if not times or not np.isfinite(times).all() or min(times) <= 0:
            raise InputError(f"--times is {self.times!r}, it must hold numbers above 0")
        # every node may bud once in a unit of time
        numerics = Numerics(dt=self.dt, capacity=2 ** (int(np.floor(max(times) + 1e-6)) + 1))
        return estimate_sensitivity(
            Parameters(**self.changed),
            times=times,
            statistics=names_in(self.statistics),
            method="regression",
            runs=self.runs,
            seed=self.seed,
            numerics=numerics,
            progress=progress,
        )

    def read(self, path: Path) -> Sensitivity:
        """Read an earlier sensitivity instead; raise `InputError` where an option asks for other colonies."""
        given = [*self.changed, *(one.name for one in fields(self)[1:] if getattr(self, one.name) != one.default)]
        if given:
            option = "--" + given[0].replace("_", "-")
            raise InputError(f"{option} is given beside --sensitivity, but {path} says it: leave out one of the two")
        try:
            return Sensitivity.load(path)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"--sensitivity: {path} cannot be read as one ({type(error).__name__}: {error}), "
                "need the sensitivity.json of an earlier run"
            ) from error


@with_parameters(PARAMETERS)
def design(
    folder: Out,
    free: Annotated[
        str, typer.Option(help="Names of the parameters that are to be estimated, with commas.")
    ] = ",".join(DEFAULT_FREE),
    times: Annotated[
        str, typer.Option(help="Times at which colonies could be photographed, in units of 1/μ*, with commas.")
    ] = Colonies.times,
    statistics: Annotated[
        str,
        typer.Option(help=f"Statistics that could be measured, with commas: {', '.join(known_statistics('smooth'))}."),
    ] = Colonies.statistics,
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
            help="Relative error of measuring a mean curve (0.02 is 2 %), in addition to the variation between "
            "colonies.",
        ),
    ] = 0.01,
    runs: Annotated[
        int, typer.Option(help="Number of colonies to simulate, a multiple of 16. More give smaller errors.")
    ] = Colonies.runs,
    dt: Annotated[float, typer.Option(help="Time step, in units of 1/μ*.")] = Colonies.dt,
    sensitivity: Annotated[
        Path | None,
        typer.Option(help="sensitivity.json of an earlier run, to use instead of new simulations.", show_default=False),
    ] = None,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Find the measurement that would reduce the errors of the parameters most.

    Simulates colonies with the parameters given here and with slightly different ones. Writes design.csv and
    design.png, every possible next measurement with what it would achieve, and spectrum.png and information.json, what
    the existing data can and cannot tell about the parameters.
    """
    changed = {name: value for name, value in parameters.items() if value != PARAMETERS[name].default}
    colonies = Colonies(changed, times, statistics, runs, dt, seed)
    remove_files(folder, FILES)
    if sensitivity:
        found = colonies.read(sensitivity)
    else:
        with shown_progress("growing colonies") as progress:
            found = colonies.sensitivity(progress)
        found.save(folder / "sensitivity.json")
    known: dict[str, Any] = {
        "measured_times": measured_times and numbers_in("--measured-times", measured_times),
        "measured_statistics": measured_statistics and names_in(measured_statistics),
        "replicates": replicates,
        "added": added,
        "new_replicates": not same_colonies,
        "steps": steps,
        "by": by,
        "criterion": criterion,
        "measurement_error": measurement_error,
    }
    result = make_design(found, free=names_in(free), **known)
    write_design(folder, result)
    configuration = {"parameters": found.at, "free": result.free, **known}
    inputs = [sensitivity] if sensitivity else []
    write_manifest(folder, command="design", seed=found.seed, inputs=inputs, configuration=configuration)
    warn(list(found.warnings))
    warn(result.before.sentences())
    values_used = ", ".join(f"{name} {value:g}" for name, value in found.at.items())
    out.print(f"at {values_used}", highlight=False)
    errors = ", ".join(f"{name} {percent(error)}" for name, error in result.before.log_standard_errors.items())
    out.print(f"errors of log λ from what is measured: {errors}", highlight=False)
    for number, sentence in enumerate(result.sentences(), start=1):
        out.print(f"{number}. {sentence}", highlight=False)
    out.print(f"Results in {folder}")
