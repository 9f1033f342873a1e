"""The files of a design: tables, JSON and figures."""

from pathlib import Path

from yeastfit import plot
from yeastfit.inference.information.design_result import Design
from yeastfit.storage import write_table


def write_design(folder: Path, result: Design) -> None:
    """Write design.csv, design.json, information.json and the figures.

    Arguments:
        folder: Where to.
        result: The design.
    """
    write_table(folder / "design.csv", result.rows())
    result.save(folder / "design.json")
    result.before.save(folder / "information.json")
    plot.save(plot.design(result), folder / "design.png")
    plot.save(plot.spectrum(result.before), folder / "spectrum.png")
    plot.save(plot.ellipses(result.before), folder / "ellipses.png")
