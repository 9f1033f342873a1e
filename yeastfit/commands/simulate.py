"""`yeastfit simulate`: grow colonies, write their statistics over time and draw them."""

from typing import Annotated

import numpy as np
import typer

from yeastfit import plot
from yeastfit.commands.options import Length, Out, Rate, Seed, with_parameters
from yeastfit.commands.terminal import out, shown_progress, warn
from yeastfit.errors import InputError
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation.simulate import member_keys
from yeastfit.simulation.simulate import simulate as run_simulation
from yeastfit.storage import write_manifest, write_table


@with_parameters(PARAMETERS)
def simulate(
    folder: Out,
    members: Annotated[int, typer.Option(help="Number of colonies to grow.")] = 4,
    time: Annotated[
        float, typer.Option(help="How long the colonies grow, in units of 1/μ* (2.17 hours unless --rate is given).")
    ] = 10.0,
    every: Annotated[
        float, typer.Option(help="Interval between two rows of the table, in the same unit as --time.")
    ] = 0.2,
    hard: Annotated[
        bool,
        typer.Option("--hard/--relaxed", help="Use the model's exact rules, or the smoothed ones that fits use."),
    ] = False,
    dt: Annotated[float, typer.Option(help="Time step, in units of 1/μ*.")] = 0.02,
    spacing: Annotated[float, typer.Option(help="Spacing of the nutrient's grid, in cell lengths L0.")] = 0.1,
    domain: Annotated[float, typer.Option(help="Side of the square dish, in cell lengths L0.")] = 40.0,
    capacity: Annotated[
        int, typer.Option(help="Largest possible number of nodes in a colony (cells + 1). Growth beyond it is cut.")
    ] = 500,
    rate: Rate = Scales.rate,
    length: Length = Scales.length,
    seed: Seed = 0,
    *,
    parameters: dict[str, float],
) -> None:
    """Simulate growing colonies.

    Writes curves.csv, with a row for each colony and time, pictures of the curves and of every colony, and
    simulation.npz, which yeastfit.Simulation.load reads in Python. Lengths are in cell lengths L0; columns that end in
    _um are in µm.
    """
    chosen = Parameters(**parameters)
    numerics = Numerics(domain=domain, spacing=spacing, dt=dt, capacity=capacity)
    if not 0 < every <= time:
        raise InputError(f"every is {every:g}, it must be above 0 and at most the time, {time:g}")
    regular = np.arange(1, int(time / every + 1e-9) + 1) * every
    times = np.append(regular[regular < time - 0.5 * dt], time)
    keys = member_keys(seed, members)
    relaxation = HARD if hard else Relaxation()
    with shown_progress("growing colonies") as progress:
        result = run_simulation(
            chosen, keys, times=times, numerics=numerics, relaxation=relaxation, scales=Scales(length, rate)
        )
        write_table(folder / "curves.csv", result.rows())
        result.save(folder / "simulation.npz")
        plot.save(plot.curves(result), folder / "curves.png")
        for member in range(members):
            progress(f"drawing colony {member + 1} of {members}", member / members)
            plot.save(plot.colony(result, member), folder / f"colony_{member}.png")
    warn(result.warnings())
    configuration = {"parameters": chosen.asdict(), "hard": hard, "numerics": vars(numerics), "members": members}
    more = {"configuration": configuration, "seconds": result.seconds}
    write_manifest(folder, command="simulate", seed=seed, inputs=[], **more)
    count = result.statistics["cell_count"][:, -1]
    grown = "1 colony" if members == 1 else f"{members} colonies"
    out.print(
        f"{grown} to t = {result.times[-1]:g} ({result.scales.hours(float(result.times[-1])):.1f} h): "
        f"{count.mean():.1f} cells on average, in {result.seconds:.1f} s. Results in {folder}"
    )
