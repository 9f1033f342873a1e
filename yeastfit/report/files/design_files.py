"""The files of a design: tables, JSON and figures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from yeastfit import plot
from yeastfit.inference.information.design_result import Design
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.report.pages.design_page import design_page
from yeastfit.report.pictures import as_words
from yeastfit.storage import versions, write_table, written_whole


def write_design(
    folder: Path,
    result: Design,
    model: ForwardModel,
    sensitivity: Sensitivity,
    settings: Mapping[str, Any],
) -> None:
    """Write design.csv, design.json, information.json, the figures and their page.

    Arguments:
        folder: Where to.
        result: The design.
        model: What was simulated.
        sensitivity: What the design was made from.
        settings: How, for the page.
    """
    write_table(folder / "design.csv", result.rows())
    result.save(folder / "design.json")
    result.before.save(folder / "information.json")
    plot.save(plot.design(result), folder / "design.png")
    plot.save(plot.spectrum(result.before), folder / "spectrum.png")
    plot.save(plot.ellipses(result.before), folder / "ellipses.png")
    made = {**as_words(settings), "seed": str(sensitivity.seed)}
    made["versions"] = ", ".join(f"{name} {one}" for name, one in versions().items())
    page = design_page(result, model, sensitivity.at, folder, made, sensitivity.warnings)
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(page, encoding="utf-8")
