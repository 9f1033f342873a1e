"""`yeastfit gradcheck`: check the derivatives that fits rely on."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from yeastfit.commands.console.terminal import out, shown_progress, warn
from yeastfit.commands.generated.model import ChosenModel, ModelOptions
from yeastfit.commands.generated.options import generated
from yeastfit.commands.options import Overwrite, Seed, folder_option
from yeastfit.derivatives.check_colony import check_gradients
from yeastfit.errors import InputError
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import WIDTHS, Relaxation
from yeastfit.numbers import POSITIVE
from yeastfit.results.folder import results_folder
from yeastfit.storage import write_table


@generated(chosen=ModelOptions("gradcheck", only="algebraic"))
def gradcheck(
    folder: Annotated[
        Path | None,
        folder_option("Folder for gradcheck.csv. By default, only print.", show_default=False),
    ] = None,
    time: Annotated[
        float,
        typer.Option(help="How long the colony grows, in units of 1/μ*. Statistics are checked then and half-way."),
    ] = 3.0,
    dt: Annotated[float, typer.Option(help="Time step, in units of 1/μ*.")] = 0.02,
    spacing: Annotated[float, typer.Option(help="Spacing of the nutrient's grid, in cell lengths L0.")] = 0.2,
    domain: Annotated[float, typer.Option(help="Side of the square dish, in cell lengths L0.")] = 12.0,
    capacity: Annotated[int, typer.Option(help="Largest possible number of nodes in a colony (cells + 1).")] = 64,
    contact_width: Annotated[
        float,
        typer.Option(help="Distance over which contact forces fade in, in cell lengths L0, above 0."),
    ] = 0.2,
    tolerance: Annotated[float, typer.Option(help="Largest relative difference that counts as agreement.")] = 5e-4,
    overwrite: Overwrite = False,
    seed: Seed = 0,
    *,
    chosen: ChosenModel,
) -> None:
    """Check the derivatives of a colony's statistics.

    Compares automatic differentiation, forward and reverse, with finite differences: along every parameter, along the
    widths of the smoothed rules, and along random changes of the initial positions, the nutrient and the budding
    angles. The table shows the worst case of each. Ends with exit code 1 unless all agree.
    """
    if overwrite and folder is None:
        raise InputError("--overwrite is given without --out: name the folder, or leave it out")
    POSITIVE.read(time, "--time")
    WIDTHS.read(contact_width, "--contact-width")
    if time < 2 * dt:
        raise InputError(f"--time is {time:g}, it must be at least two time steps, --dt {dt:g}")
    model: Model = chosen.forward.rules  # type: ignore[attr-defined]
    parameters = model.complete(Parameters(**chosen.values))
    numerics = Numerics(domain=domain, spacing=spacing, dt=dt, capacity=capacity)
    opened = results_folder(folder, "gradcheck", overwrite=overwrite) if folder else nullcontext()
    with opened as results, shown_progress("comparing derivatives") as progress:
        result = check_gradients(
            parameters,
            model=model,
            times=[time / 2, time],
            key=seed,
            numerics=numerics,
            relaxation=Relaxation(contact=contact_width),
            tolerance=tolerance,
            progress=progress,
        )
        if results:
            write_table(results.partial / "gradcheck.csv", result.rows())
            configuration = {**chosen.configuration("gradcheck"), "parameters": parameters.asdict()}
            configuration |= {"contact_width": contact_width, "numerics": vars(numerics)}
            results.finish(seed=seed, inputs=[], configuration=configuration, passed=result.passed)
    lines = result.summary()
    table = Table(*lines[0])
    for line in lines:
        table.add_row(*line.values())
    out.print(table)
    warn(result.warnings())
    out.print(result.status + (f". Results in {folder}" if folder else ""))
    if not result.passed:
        raise typer.Exit(1)
