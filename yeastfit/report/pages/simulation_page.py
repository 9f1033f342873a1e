"""The page of simulated colonies: what went wrong, how they grew, how they look, and with what parameters."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.models.grown import Grown
from yeastfit.measure.statistics.registry import STATISTICS, most_telling_first
from yeastfit.report import html as page
from yeastfit.report.pictures import as_words, figures
from yeastfit.storage import versions, written_whole

PICTURES = {"curves": "Every statistic as colonies grow: thin lines are colonies, the thick one their mean"}
MOVIE = "movie.gif"


def simulation_page(
    grown: Grown, model: ForwardModel, values: Mapping[str, float], members: int, folder: Path, made: Mapping[str, str]
) -> str:
    """Write the page.

    Arguments:
        grown: The colonies.
        model: That they are of.
        values: Parameters by name.
        members: How many colonies.
        folder: Of the pictures.
        made: How it was made: settings, versions.

    Returns:
        HTML.
    """
    shown = [f"colony_{member}" for member in range(members)]
    captions = {name: f"Colony {member + 1} at its end" for member, name in enumerate(shown)}
    sections = [
        ("Doubts", page.doubts(grown.warnings())),
        ("Parameters", _parameters(model, values)),
        ("Growth", figures(folder, PICTURES, "curves") + _ends(grown)),
        (model.nouns[1].capitalize(), f'<div class="cards wide">{figures(folder, captions, *shown)}</div>'),
        ("How this was made", page.pairs(made.items())),
    ]
    if (folder / MOVIE).is_file():
        alt = "The first colony as it grows, from its first cell to the end"
        moving = page.picture((folder / MOVIE).read_bytes(), alt)
        sections.insert(1, ("As it grows", f'<figure class="whole">{moving}</figure>'))
    foot = '<p class="soft">Numbers: curves.csv; everything: simulation.npz.</p>'
    return page.document("Simulated colonies", f"<p>{page.text(grown.sentence())}.</p>", sections, foot)


def write_simulation_page(
    folder: Path,
    grown: Grown,
    model: ForwardModel,
    values: Mapping[str, float],
    members: int,
    configuration: Mapping[str, Any],
) -> None:
    """Write index.html into a folder of simulated colonies; `configuration` is how they were made."""
    settings = {name: value for name, value in configuration.items() if name != "parameters"}
    made = {**as_words(settings), "versions": ", ".join(f"{name} {one}" for name, one in versions().items())}
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(simulation_page(grown, model, values, members, folder, made), encoding="utf-8")


def _parameters(model: ForwardModel, values: Mapping[str, float]) -> str:
    columns = [
        page.Column("parameter", words=True),
        page.Column("value"),
        page.Column("in_units", words=True),
        page.Column("meaning", words=True),
    ]
    cells = []
    for name, value in values.items():
        one = model.parameters[name]
        shown = page.in_units(value, *model.unit_of(name))
        cells.append([name.replace("_", " "), value, shown, f"{one.symbol}: {one.meaning}"])
    return page.table("Parameters", columns, cells, ["curves"] * len(cells))


def _ends(grown: Grown) -> str:
    """Mean and spread of every statistic at the end."""
    columns = [
        page.Column("statistic", words=True),
        page.Column("mean"),
        page.Column("sd"),
        page.Column("unit", words=True),
    ]
    cells = []
    for name in dict.fromkeys((*most_telling_first(grown.statistics), *grown.statistics)):
        values = np.atleast_2d(grown.statistics[name])[:, -1]
        spread = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
        power = STATISTICS[name].unit_power if name in STATISTICS else 0
        unit = {0: "", 1: grown.length_unit, 2: f"{grown.length_unit}²"}.get(power, "")
        cells.append([name.replace("_", " "), float(values.mean()), spread, unit])
    when = f"{grown.clock[-1]:.4g} {page.text(grown.clock_label)}"
    return f"<p>At {when}:</p>" + page.table("Statistics at the end", columns, cells, ["curves"] * len(cells))
