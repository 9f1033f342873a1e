"""`yeastfit simulate`: grow colonies, write their statistics as they grow and draw them."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from yeastfit import plot
from yeastfit.commands.console.terminal import out, shown_progress, warn
from yeastfit.commands.generated.model import ChosenModel, ModelOptions
from yeastfit.commands.generated.options import flag_of, generated
from yeastfit.commands.options import Out, Overwrite, Seed, names_in
from yeastfit.errors import InputError
from yeastfit.inference.models.grown import Grown
from yeastfit.measure.photograph_panels import TimedPhotograph, panel_at, photographs_of_first_colony
from yeastfit.measure.reading.dataset import read_dataset
from yeastfit.measure.reading.outline_files import write_mask
from yeastfit.panel import Panel
from yeastfit.report.pages.simulation_page import write_simulation_page
from yeastfit.results.folder import results_folder
from yeastfit.storage import write_table

FRAMES = 40  # of a movie
UNTIL = ("until_area", "until_cells")  # what ends growth before its time
FAR = 10.0  # times the largest plausible value, from where a parameter is doubted


@generated(chosen=ModelOptions("simulate"))
def simulate(
    folder: Out,
    members: Annotated[int, typer.Option(help="Number of colonies to grow.")] = 4,
    statistics: Annotated[
        str | None,
        typer.Option(
            help="Statistics to record, with commas: any that yeastfit measure has, but where a colony lies, "
            "measured as it does on black-and-white images of colonies at the pixel size of photographs. By default "
            "a few that each model chooses, of the algebraic one by a smooth estimator on its own grid.",
            show_default=False,
        ),
    ] = None,
    movie: Annotated[
        bool,
        typer.Option(
            "--movie",
            help="Also show the first colony and its nutrient as they grow: movie.gif, and movie.mp4 where ffmpeg is "
            "installed.",
        ),
    ] = False,
    beside: Annotated[
        Path | None,
        typer.Option(
            help="A data set of photographs over time: each frame of the movie also shows the last photograph, so far, "
            "of the first colony that it names.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    seed: Seed = 0,
    *,
    chosen: ChosenModel,
) -> None:
    """Simulate growing colonies.

    Writes one page of everything (index.html), curves.csv, with a row for each colony and time (or number of cells,
    for a model without time), pictures of
    the curves and of every colony, and simulation.npz. Colonies of the off-lattice model are also written as masks,
    which yeastfit measure reads. Lengths are in µm in columns that end in _um and for the off-lattice model, otherwise
    in cell lengths L0.
    """
    parameters = {**chosen.forward.parameters.defaults, **chosen.values}
    for name, value in parameters.items():
        low, high = chosen.forward.parameters[name].plausible
        if abs(value) > FAR * max(abs(low), abs(high)):
            warn([f"{name} is {value:g}, plausible is {low:g} to {high:g}: equations may not be solved well"])
    configuration = {**chosen.configuration("simulate"), "parameters": parameters, "members": members}
    if beside is not None and not movie:
        raise InputError("--beside is given without --movie, which shows the photographs: give both, or neither")
    if "pixel_size" in chosen.given and not statistics:
        raise InputError("--pixel-size is given without --statistics, which are measured on such pixels: give both")
    if beside is not None and not chosen.forward.timed:
        raise InputError(f"--beside: photographs have hours, and colonies of --model {chosen.name} none: leave it out")
    if "every" in chosen.given and (end := next((name for name in UNTIL if name in chosen.given), None)):
        raise InputError(f"--every is given beside {flag_of(end)}, which shows ends alone: leave it out")
    data = None if beside is None else read_dataset(beside)
    photographs = [] if data is None else photographs_of_first_colony(data)
    reads = [] if data is None else [data.manifest, *(one.measured.micrograph.path for one in photographs)]
    named = chosen.forward.statistics_named(names_in(statistics))
    if named:
        configuration["statistics"] = list(named)
    with (
        results_folder(folder, "simulate", reads=reads, overwrite=overwrite) as results,
        shown_progress("growing colonies") as progress,
    ):
        result = chosen.forward.keeping(results.unfinished).grow(chosen.values, members, seed, named)
        shutil.rmtree(results.unfinished, ignore_errors=True)
        write_table(results.partial / "curves.csv", result.rows())
        result.save(results.partial / "simulation.npz")
        plot.save(plot.curves(result), results.partial / "curves.png")
        for member in range(members):
            progress(f"drawing colony {member + 1} of {members}", member / members)
            plot.save(plot.colony(result, member), results.partial / f"colony_{member}.png")
        late: list[str] = []
        if movie:
            progress("drawing the movie", 0.0)
            frames = list(chosen.forward.ended_as(result).movie(chosen.values, seed, FRAMES))
            if photographs:
                frames = _beside(photographs, frames, result)
                first, last = min(one.hours for one in photographs), _end_hours(result)
                if first > last * (1 + 1e-6):
                    late = [f"--beside: the first photograph is of {first:g} hours, the movie ends at {last:.3g} hours"]
            plot.movie(frames, results.partial / "movie")
        if (drawn := result.masks()) is not None:
            (results.partial / "masks").mkdir()
            for member, mask in enumerate(drawn[0]):
                write_mask(results.partial / "masks" / f"colony_{member}.png", mask, drawn[1])
        write_simulation_page(results.partial, result, chosen.forward, parameters, members, configuration)
        changed = results.finish(seed=seed, inputs=reads, configuration=configuration, seconds=result.seconds)
    warn([*changed, *late, *result.warnings()])
    out.print(f"{result.sentence()}. Results in {folder}, on one page: index.html")


def _beside(photographs: Sequence[TimedPhotograph], frames: Sequence[list[Panel]], result: Grown) -> list[list[Panel]]:
    """Frames at even times up to the end, each with the photograph of its time.

    Raises:
        InputError: The colonies have no time.
    """
    if result.clock_label != "hours":
        raise InputError(f"--beside: photographs have hours, and these colonies {result.clock_label}: leave it out")
    last, count = _end_hours(result), len(frames)
    return [
        [*panels, panel_at(photographs, last * (k + 1) / count, panels[0].half_width)]
        for k, panels in enumerate(frames)
    ]


def _end_hours(result: Grown) -> float:
    """At which the first colony ended."""
    ends = [row["hours"] for row in result.rows() if row.get("member") == 0 and "hours" in row]
    return float(ends[-1] if ends else result.clock[-1])
