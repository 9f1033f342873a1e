"""The files of `yeastfit measure`: tables, curves, a contact sheet and a page, each written whole or not at all."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from yeastfit import plot
from yeastfit.measure.reading.dataset import Dataset
from yeastfit.measure.replicate_curves import condition_curves
from yeastfit.measure.statistics.filaments import SKELETON
from yeastfit.measure.statistics.registry import STATISTICS, names_with
from yeastfit.report.outcome import Outcome
from yeastfit.report.pages.measurement_page import measurement_page
from yeastfit.storage import versions, write_json, write_table, written_whole
from yeastfit.text import short

OWN_COLUMNS = {
    "file": ("", "the image, as the manifest or the command line names it"),
    "condition": ("", "from the manifest; empty outside a data set"),
    "replicate": ("", "from the manifest; a colony is known by condition and replicate"),
    "hours": ("h", "from the manifest: since the colony was one cell"),
    "um_per_pixel": ("µm", "size of a pixel"),
    "pixel_size_from": ("", "where that comes from"),
    "warnings": ("", "doubts by name, with semicolons; the page explains them"),
    "mask": ("", "what was measured"),
}


def write_results(
    folder: Path,
    title: str,
    outcomes: Sequence[Outcome],
    *,
    dataset: Dataset | None = None,
    skipped: Sequence[Path] = (),
    settings: Mapping[str, Any] | None = None,
) -> None:
    """Write everything but masks and overlays, which `measure_batch` writes, and the manifest.

    measurements.csv has a row for each image that was measured, columns.json the units and meanings of its columns,
    failures.csv the images that were not. A data set also has curves.csv and curves.png, mean and spread of colonies.
    contact_sheet.png shows every outline, index.html everything.

    Arguments:
        folder: Where to.
        title: Of the page.
        outcomes: Of all micrographs.
        dataset: The data set they come from, if they do.
        skipped: Files that were passed over.
        settings: Options to show on the page.
    """
    rows = [outcome.row for outcome in outcomes if outcome.row]
    failures = [{"file": outcome.image.label, "error": outcome.error} for outcome in outcomes if not outcome.row]
    if rows:
        write_table(folder / "measurements.csv", rows)
        write_json(folder / "columns.json", _columns(rows[0]))
    if failures:
        write_table(folder / "failures.csv", failures)
    curves = _write_curves(folder, rows) if dataset and rows else b""
    _write_contact_sheet(folder, outcomes)
    made = {"yeastfit": versions()["yeastfit"], **(settings or {}), "skeleton": SKELETON}
    made |= {"versions": ", ".join(f"{name} {version}" for name, version in versions().items())}
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(measurement_page(title, outcomes, curves, skipped, made), encoding="utf-8")


def _columns(row: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Unit and meaning of every column."""
    known = OWN_COLUMNS | {name: (entry.unit(), entry.meaning) for name, entry in STATISTICS.items()}
    return {name: dict(zip(("unit", "meaning"), known[name], strict=True)) for name in row}


def _write_curves(folder: Path, rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Write curves.csv and curves.png; return the picture's bytes."""
    units = {name: STATISTICS[name].unit() for name in names_with("mask") if STATISTICS[name].comparable}
    curves = condition_curves(rows, list(units))
    written = [
        {key: "" if isinstance(value, float) and math.isnan(value) else value for key, value in curve.items()}
        | {"unit": units[curve["statistic"]]}
        for curve in curves
    ]
    write_table(folder / "curves.csv", written)
    plot.save(plot.condition_curves(rows, curves, units), folder / "curves.png")
    return (folder / "curves.png").read_bytes()


def _write_contact_sheet(folder: Path, outcomes: Sequence[Outcome]) -> None:
    """Write contact_sheet.png, with a column for each hour where that makes a good shape."""
    shown = [outcome for outcome in outcomes if outcome.thumbnail]
    if not shown:
        return
    captions = [_caption(outcome) for outcome in shown]
    doubtful = [bool(outcome.in_doubt) or not outcome.row for outcome in shown]
    hours = len({outcome.image.hours for outcome in shown})
    columns = hours if 3 < hours <= 16 else math.ceil(math.sqrt(1.6 * len(shown)))
    figure = plot.thumbnail_sheet([outcome.thumbnail for outcome in shown], captions, doubtful, columns)
    plot.save(figure, folder / "contact_sheet.png")


def _caption(outcome: Outcome) -> str:
    image = outcome.image
    known = image.hours is not None
    place = f"{image.condition} {image.replicate}, {image.hours:g} h".strip() if known else image.label
    remarks = [*outcome.doubts, *([] if outcome.row else ["not measured"])]
    return short(place) + (f" - {', '.join(remarks)}" if remarks else "")
