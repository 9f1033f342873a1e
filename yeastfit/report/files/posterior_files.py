"""What `yeastfit infer` leaves of a posterior: tables, pictures, and one page of it all.

posterior.csv, diagnostics.json, predictive.csv, predictive.npz, left_out.csv and left_out.npz where colonies were left
out, posterior.nc where ArviZ is installed, pictures, and index.html. All can be made again from the files .npz.
"""

import importlib.util
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from matplotlib.figure import Figure

from yeastfit import plot
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.targets import Targets
from yeastfit.measure.measurements_table import rows_of
from yeastfit.measure.reading.images import read_image
from yeastfit.report.pages.posterior_page import posterior_page
from yeastfit.report.posterior_summary import Summary
from yeastfit.storage import write_json, write_table, written_whole

Outlines = tuple[list[Bool[np.ndarray, "x y"]], float]


@dataclass(frozen=True)
class Photograph:
    """An observed colony.

    Attributes:
        title: For the picture.
        pixels: Grey values, where there are some.
        mask: What was taken for the colony.
        pixel_size: µm per pixel.
    """

    title: str
    pixels: np.ndarray | None
    mask: Bool[np.ndarray, "row column"]
    pixel_size: float


def photographs(
    rows: Sequence[Mapping[str, Any]], folder: Path, images: Path, condition: str | None, most: int = 6
) -> list[Photograph]:
    """Some colonies at their last time.

    Arguments:
        rows: Measurements.
        folder: Of the masks.
        images: Where the photographs may lie.
        condition: Whose colonies.
        most: How many.
    """
    own = rows_of(rows, condition)
    last = max(row["hours"] for row in own)
    outlined = [row for row in own if "mask" in row and (folder / str(row["mask"])).is_file()]
    shown = []
    for row in [row for row in outlined if row["hours"] == last][:most]:
        mask = read_image(folder / str(row["mask"])) > 0
        path = images / str(row["file"])
        pixels = read_image(path) if path.is_file() else None
        pixels = None if pixels is None or pixels.shape != mask.shape else pixels
        shown.append(Photograph(f"colony {row['replicate']}, {last:g} h", pixels, mask, float(row["um_per_pixel"])))
    return shown


def write_results(
    folder: Path,
    summary: Summary,
    targets: Targets,
    observed: Sequence[Photograph],
    drawn: Outlines | None,
    made: Mapping[str, str],
    beforehand: Predictive | None = None,
) -> list[str]:
    """Write all files but the manifest.

    Arguments:
        folder: Where to.
        summary: Of the posterior.
        targets: The data.
        observed: Photographs.
        drawn: Simulated outlines at the first draws of the predictive check, and µm per pixel.
        made: How the run was made, for the page.
        beforehand: Data predicted from the prior, for posterior.nc.

    Returns:
        Remarks, in words.
    """
    posterior, predicted = summary.posterior, summary.predicted
    write_table(folder / "posterior.csv", summary.rows())
    write_json(folder / "diagnostics.json", summary.diagnostics())
    if predicted is not None:
        rows = zip(predicted.rows(), targets.clock[np.argwhere(targets.measured)[:, 1]].tolist(), strict=True)
        write_table(folder / "predictive.csv", [{targets.clock_label: round(time, 6), **row} for row, time in rows])
        predicted.save(folder / "predictive.npz")
    if summary.left_out is not None:
        write_table(folder / "left_out.csv", summary.left_out.colony_rows())
        summary.left_out.save(folder / "left_out.npz")
    figures = _figures(summary, targets, observed, drawn)
    for name, figure in figures.items():
        plot.save(figure, folder / f"{name}.png")
    pictures = {name: (folder / f"{name}.png").read_bytes() for name in figures}
    with written_whole(folder / "index.html") as temporary:
        page = posterior_page(summary, targets, pictures, made, photographed=bool(observed))
        temporary.write_text(page, encoding="utf-8")
    if not with_arviz():
        return ["posterior.nc is left out: ArviZ is not installed (pip install yeastfit[arviz])"]
    posterior.to_netcdf(folder / "posterior.nc", predicted, beforehand)
    return []


def with_arviz() -> bool:
    """Whether ArviZ is installed, so that there is a posterior.nc."""
    return importlib.util.find_spec("arviz") is not None


def _figures(
    summary: Summary, targets: Targets, observed: Sequence[Photograph], drawn: Outlines | None
) -> dict[str, Figure]:
    """All pictures of the page, by name."""
    posterior, predicted = summary.posterior, summary.predicted
    figures = {"corner": plot.corner(posterior, summary.truth), "traces": plot.traces(posterior)}
    if posterior.chains and posterior.chains.chains > 1:
        figures["ranks"] = plot.ranks(posterior.chains)
    if predicted is not None:
        figures["predictive"] = plot.predictive(predicted, targets, summary.model.nouns)
    if predicted is not None and drawn is not None:
        masks, pixel = drawn
        when = f", {targets.clock[-1]:.3g} {targets.clock_label}" if summary.model.timed else ""
        simulated = [(f"{_described(predicted, k)}{when}", mask, pixel) for k, mask in enumerate(masks)]
        figures["colonies"] = plot.colonies(
            [(one.title, one.pixels, one.mask, one.pixel_size) for one in observed], simulated
        )
    if summary.left_out is not None:
        figures["left_out"] = plot.left_out({"": summary.left_out})
    if isinstance(posterior.diagnostics, EmulatorDiagnostics):
        figures["emulator"] = plot.cross_validation(posterior.diagnostics)
    return figures


def _described(predicted: Predictive, k: int) -> str:
    """Parameters of one simulated picture, three digits each."""
    values = predicted.values[k].tolist()
    return ", ".join(f"{value:.{max(0, 2 - math.floor(math.log10(abs(value) or 1)))}f}" for value in values)
