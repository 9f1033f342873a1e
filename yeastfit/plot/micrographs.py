"""Pictures of colonies, curves and outlines. Functions return a figure; `save` writes it."""

import textwrap
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from yeastfit.measure.outlining.segmentation import outline
from yeastfit.measure.statistics.model_as_mask import mask_of
from yeastfit.storage import written_whole

if TYPE_CHECKING:
    from yeastfit.simulation.result import Simulation

COLONY, TRUTH, OUTLINE = "#7a5230", "#1b7837", "#ff4d00"
CONDITIONS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # Okabe and Ito
LABELS = {
    "compactness": "compactness P²/(4πA)",
    "radius": "radius, mean distance from centroid (L0)",
    "mean_radius": "mean radius of nodes d̄ (L0)",
    "growth_rate": "growth rate μ",
    "cell_count": "cells",
    "area": "area (L0²)",
    "perimeter": "perimeter (L0)",
}


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, whole or not at all."""
    with written_whole(path) as temporary:
        FigureCanvasAgg(figure).print_figure(temporary, dpi=130)


def colony(simulation: "Simulation", member: int = 0, width: float | None = None) -> Figure:
    """The last state of one member: cells beside the nutrient, in µm. width: of the part shown, in L0."""
    import jax

    state, parameters = simulation.colony, simulation.parameters
    if state.count.ndim:
        state = jax.tree.map(lambda leaf: leaf[member], state)
    parameters = jax.tree.map(lambda leaf: leaf if leaf.ndim == 0 else leaf[member], parameters)
    numerics, length = simulation.numerics, simulation.scales.length
    alive = np.asarray(state.alive)
    reach = float(np.abs(np.asarray(state.positions)[alive]).max()) + 2.0
    width = min(numerics.domain, width or 2 * reach)
    mask = mask_of(state, parameters.aspect_ratio, simulation.relaxation, width, points=801)
    half = 0.5 * width * length
    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.imshow(
        mask.T,
        origin="lower",
        extent=(-half, half, -half, half),
        cmap=ListedColormap(["#f3efe6", COLONY]),
    )
    edge = 0.5 * numerics.domain * length
    image = right.imshow(
        np.asarray(state.nutrient).T, origin="lower", extent=(-edge, edge, -edge, edge), cmap="viridis", vmin=0, vmax=1
    )
    figure.colorbar(image, ax=right, label="nutrient c / c0", shrink=0.85)
    time = float(simulation.times[-1])
    left.set_title(f"{int(state.count) - 1} cells at {simulation.scales.hours(time):.1f} h (t = {time:.4g})")
    right.set_title("nutrient")
    for axes in (left, right):
        axes.set(xlim=(-half, half), ylim=(-half, half), xlabel="µm", aspect="equal")
    left.set_ylabel("µm")
    return figure


def curves(simulation: "Simulation") -> Figure:
    """Every statistic of `LABELS` over time: members thin, their mean thick."""
    hours = simulation.scales.hours(simulation.times)
    names = [name for name in LABELS if name in simulation.statistics]
    figure = Figure(figsize=(11, 5.5), layout="constrained")
    axes = figure.subplots(2, 4).ravel()
    for name, panel in zip(names, axes, strict=False):
        values = np.atleast_2d(simulation.statistics[name])
        panel.plot(hours, values.T, color=COLONY, alpha=0.35, lw=0.8)
        panel.plot(hours, values.mean(axis=0), color=COLONY, lw=2)
        panel.set(xlabel="hours", title=LABELS[name])
        panel.title.set_fontsize(9)
    for panel in axes[len(names) :]:
        panel.axis("off")
    return figure


def overlay(
    pixels: np.ndarray, mask: np.ndarray, title: str, pixel_size: float | None = None, doubts: Sequence[str] = ()
) -> Figure:
    """A micrograph with the outline of what was taken for the colony; with a pixel size, axes in µm.

    doubts: sentences written across the bottom of the picture.
    """
    size = pixel_size or 1.0
    rows, columns = pixels.shape
    inches = np.array([6.3, 6.3 * rows / columns])
    whole = inches + 0.75
    figure = Figure(figsize=(whole[0], whole[1]))
    left, bottom, width, height = (*(0.6, 0.45) / whole, *inches / whole)
    axes = figure.add_axes((left, bottom, width, height))
    axes.imshow(pixels, cmap="gray", extent=(-0.5 * size, (columns - 0.5) * size, (rows - 0.5) * size, -0.5 * size))
    for contour in outline(mask):
        axes.plot(contour[:, 1] * size, contour[:, 0] * size, color=OUTLINE, lw=0.7)
    axes.set(xlabel="µm" if pixel_size else "pixels (size unknown)")
    figure.text(0.6 / whole[0], 1 - 0.2 / whole[1], title, fontsize=9, va="center", parse_math=False)
    if doubts:
        lines = "\n".join(textwrap.fill(f"• {doubt}", 95, subsequent_indent="   ") for doubt in doubts)
        box = {"facecolor": "#ffe9a8", "edgecolor": "none", "alpha": 0.92, "pad": 3}
        axes.text(0.01, 0.01, lines, transform=axes.transAxes, fontsize=7, va="bottom", bbox=box, parse_math=False)
    return figure


def thumbnail(pixels: np.ndarray, mask: np.ndarray | None, side: int) -> bytes:
    """A micrograph with the outline of its mask as a small JPEG, `side` pixels along its longer edge."""
    from PIL import Image, ImageDraw

    low, high = np.percentile(pixels, (0.2, 99.8))
    if low == high:
        low, high = float(pixels.min()), max(float(pixels.max()), float(pixels.min()) + 1)
    grey = np.clip((pixels.astype(np.float32) - low) * (255 / (high - low)), 0, 255).astype(np.uint8)
    scale = 2 * side / max(pixels.shape)  # drawn twice as large, so that reducing it makes smooth lines
    size = [max(2, round(length * scale)) for length in pixels.shape[::-1]]
    image = Image.fromarray(grey).resize((size[0], size[1]), Image.Resampling.BICUBIC).convert("RGB")
    canvas, width = ImageDraw.Draw(image), max(3, round(side / 140))
    for contour in [] if mask is None else outline(mask):
        canvas.line([(x, y) for y, x in ((contour + 0.5) * scale).tolist()], fill=OUTLINE, width=width, joint="curve")
    buffer = BytesIO()
    image.reduce(2).save(buffer, "JPEG", quality=82, optimize=True)
    return buffer.getvalue()


def thumbnail_sheet(
    thumbnails: Sequence[bytes], captions: Sequence[str], doubtful: Sequence[bool], columns: int
) -> Figure:
    """Many small pictures side by side, `columns` in a row; captions of doubtful ones in red."""
    from PIL import Image

    lines = -(-len(thumbnails) // columns)
    figure = Figure(figsize=(max(1.5 * columns, 3.0), 1.75 * lines))
    for k, (data, caption, doubt) in enumerate(zip(thumbnails, captions, doubtful, strict=True)):
        row, column = divmod(k, columns)
        left, bottom = (column + 0.03) / columns, 1 - (row + 0.98) / lines
        axes = figure.add_axes((left, bottom, 0.94 / columns, 0.8 / lines))
        with Image.open(BytesIO(data)) as image:
            axes.imshow(
                np.asarray(image.convert("RGB").reduce(max(1, max(image.size) // 260))), interpolation="antialiased"
            )
        axes.axis("off")
        axes.set_anchor("N")
        color = "#b00020" if doubt else "black"
        axes.set_title(textwrap.fill(caption, 26), fontsize=5.5, color=color, pad=2, parse_math=False)
    return figure


def condition_curves(
    rows: Sequence[Mapping[str, Any]], curves: Sequence[Mapping[str, Any]], units: Mapping[str, str]
) -> Figure:
    """A panel for each statistic of `units`: over hours, or side by side where every condition has one time.

    rows: of each image, with condition, replicate and hours; curves: their `measure.series.condition_curves`. Colonies
    are thin lines or dots. The band and the bars are one standard deviation of colonies about their mean.
    """
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    colors = {name: CONDITIONS[k % len(CONDITIONS)] for k, name in enumerate(conditions)}
    hours = [row["hours"] for row in rows]
    margin = 0.03 * (max(hours) - min(hours))
    over_time = len({(row["condition"], row["hours"]) for row in rows}) > len(conditions)
    columns = 4
    lines = -(-len(units) // columns)
    figure = Figure(figsize=(12.4, 2.35 * lines + 0.4), layout="constrained")
    axes = np.atleast_2d(figure.subplots(lines, columns, squeeze=False))
    for panel, (name, unit) in zip(axes.ravel(), units.items(), strict=False):
        chosen = [curve for curve in curves if curve["statistic"] == name]
        for k, condition in enumerate(conditions):
            mine = [row for row in rows if row["condition"] == condition]
            mean = [curve for curve in chosen if curve["condition"] == condition]
            (_time_panel if over_time else _dot_panel)(panel, mine, mean, name, colors[condition], k)
        panel.set_title(name.replace("_", " ") + (f" ({unit})" if unit else ""), fontsize=9)
        panel.tick_params(labelsize=7)
        panel.spines[["top", "right"]].set_visible(False)
        if over_time:
            panel.set_xlim(min(hours) - margin, max(hours) + margin)
            panel.set_xlabel("hours", fontsize=7)
        else:
            panel.set(xlim=(-0.6, len(conditions) - 0.4), xticks=range(len(conditions)))
            panel.set_xticklabels([textwrap.fill(name or "all", 16) for name in conditions], parse_math=False)
    for panel in axes.ravel()[len(units) :]:
        panel.axis("off")
    if over_time and conditions != [""]:
        handles = [Line2D([], [], color=colors[name], label=name or "no condition") for name in conditions]
        figure.legend(handles=handles, loc="outside upper center", ncols=min(len(conditions), 6), fontsize=8)
    return figure


def _time_panel(
    panel: Any, rows: list[Mapping[str, Any]], mean: list[Mapping[str, Any]], name: str, color: str, _: int
) -> None:
    """Colonies thin, mean thick, one standard deviation as a band."""
    for replicate in dict.fromkeys(row["replicate"] for row in rows):
        own = sorted((row["hours"], row[name]) for row in rows if row["replicate"] == replicate)
        panel.plot(*zip(*own, strict=True), color=color, alpha=0.3, lw=0.6)
    hours, centre, spread = (
        np.array([curve[key] for curve in mean], dtype=float) for key in ("hours", "mean", "standard_deviation")
    )
    panel.fill_between(hours, centre - spread, centre + spread, color=color, alpha=0.18, lw=0)
    panel.plot(hours, centre, "o-", color=color, lw=1.6, ms=2.5)


def _dot_panel(
    panel: Any, rows: list[Mapping[str, Any]], mean: list[Mapping[str, Any]], name: str, color: str, place: int
) -> None:
    """Colonies as dots side by side, their mean and one standard deviation as a bar."""
    values = np.sort(np.array([row[name] for row in rows], dtype=float))
    across = (np.arange(len(values)) * 0.618 % 1 - 0.5) * 0.5
    panel.plot(place + across, values, "o", color=color, ms=3, alpha=0.55, mew=0)
    for curve in mean:
        panel.errorbar(place, curve["mean"], curve["standard_deviation"], fmt="_", color="black", ms=14, lw=1.2)
