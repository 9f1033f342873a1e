"""The command line: a thin file over the library. Every run leaves `manifest.json`; bad input ends with exit code 2."""

import sys
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import typer
from rich.table import Table

from yeastfit import plot
from yeastfit.commands.design import design
from yeastfit.commands.fit import fit
from yeastfit.commands.infer import infer
from yeastfit.commands.measure_batch import survey
from yeastfit.commands.options import Length, Out, Rate, Seed, with_parameters
from yeastfit.commands.terminal import err, fail, out, shown_progress, warn
from yeastfit.derivatives.check_colony import check_gradients
from yeastfit.errors import InputError, SimulationError
from yeastfit.measure.reading.batch_inputs import find_tasks
from yeastfit.measure.reading.dataset import given, read_overrule
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.processors import available_processors
from yeastfit.report.measurement_files import clear_results, refuse_mixed_folder, write_results
from yeastfit.simulation.simulate import member_keys
from yeastfit.simulation.simulate import simulate as run_simulation
from yeastfit.simulation.synthetic_data import read_recipes
from yeastfit.simulation.synthetic_data import synthesize as make_dataset
from yeastfit.storage import write_manifest, write_table

HELP = """Parameters of yeast colonies from micrographs: simulate, measure, fit, infer.

Every run leaves `manifest.json`; bad input ends with one line and exit code 2."""
app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=HELP)
INTERRUPTED = 130  # typer's exit code after Ctrl-C


@app.command()
@with_parameters
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
    regular = np.arange(1, int(time / every + 1e-9) + 1) * every
    times = np.append(regular[regular < time - 0.5 * dt], time)
    keys = member_keys(seed, members)
    relaxation = HARD if hard else Relaxation()
    with shown_progress("growing colonies") as advance:
        result = run_simulation(
            chosen, keys, times=times, numerics=numerics, relaxation=relaxation, scales=Scales(length, rate)
        )
        write_table(folder / "curves.csv", result.rows())
        result.save(folder / "simulation.npz")
        plot.save(plot.curves(result), folder / "curves.png")
        for member in range(members):
            advance(f"drew {member + 1} of {members} colonies", (member + 1) / members)
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
    with shown_progress("measuring") as advance:
        outcomes = survey(tasks, folder, jobs=jobs or available_processors(), progress=advance)
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
    warn([f"{outcome.task.label}: {doubt}" for outcome in measured for doubt in outcome.doubts])
    if skipped:
        warn([f"passed over, no images by their names: {', '.join(path.name for path in skipped)}"])
    out.print(f"{len(measured)} of {len(tasks)} micrographs measured. Results in {folder}, on one page: index.html")
    if failed:
        fail(failed)


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
        with shown_progress(name) as advance:
            make_dataset(chosen, folder / name, advance)
        write_manifest(folder / name / "truth", command="synthesize", seed=chosen.seed, inputs=[recipe])
        out.print(f"{name}: {chosen.replicates} colonies at {len(chosen.hours)} times in {folder / name}")


app.command()(fit)
app.command()(infer)


@app.command()
@with_parameters
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
    with shown_progress("comparing derivatives") as advance:
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
    warn(result.warnings())
    out.print(result.status + (f". Results in {folder}" if folder else ""))
    if not result.passed:
        raise typer.Exit(1)


app.command()(design)


def run(arguments: list[str] | None = None) -> int:
    """Run one command (by default the one on the command line) and return its exit code."""
    try:
        app(arguments)
    except (InputError, SimulationError) as error:
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
    jax.config.update("jax_num_cpu_devices", available_processors())
    sys.exit(run())
