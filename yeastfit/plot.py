"""Every picture: colonies, curves, outlines and fits. Functions return a figure; `save` writes it."""

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from yeastfit.measure.segmentation import outline
from yeastfit.measure.series import Measured
from yeastfit.model.cells import cells_of, level_set
from yeastfit.storage import written_whole

if TYPE_CHECKING:
    from yeastfit.infer.fit import Fit
    from yeastfit.simulation import Simulation

COLONY, TRUTH, OUTLINE = "#7a5230", "#1b7837", "#ff4d00"
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
    points = 801
    cells, relaxation = cells_of(state, parameters.aspect_ratio), simulation.relaxation
    g = level_set(cells, relaxation.union, relaxation.union_reach, -width / 2, width / (points - 1), points)
    half = 0.5 * width * length
    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.imshow(
        np.asarray(g <= 0).T,
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
    hours = np.array([simulation.scales.hours(float(time)) for time in simulation.times])
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


def overlay(pixels: np.ndarray, mask: np.ndarray, title: str, pixel_size: float | None = None) -> Figure:
    """A micrograph with the outline of what was taken for the colony; with a pixel size, axes in µm."""
    figure = Figure(figsize=(7, 7 * pixels.shape[0] / pixels.shape[1] + 0.5), layout="constrained")
    axes = figure.subplots()
    size = pixel_size or 1.0
    rows, columns = pixels.shape
    axes.imshow(pixels, cmap="gray", extent=(-0.5 * size, (columns - 0.5) * size, (rows - 0.5) * size, -0.5 * size))
    for contour in outline(mask):
        axes.plot(contour[:, 1] * size, contour[:, 0] * size, color=OUTLINE, lw=0.7)
    axes.set(xlabel="µm" if pixel_size else "pixels (size unknown)")
    axes.set_title(title, fontsize=9)
    return figure


def contact_sheet(measured: list[Measured], titles: list[str], columns: int = 11) -> Figure:
    """Small overlays of many micrographs."""
    rows = -(-len(measured) // columns)
    figure = Figure(figsize=(1.35 * columns, 1.5 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for panel in axes:
        panel.axis("off")
    for panel, one, title in zip(axes, measured, titles, strict=False):
        panel.imshow(one.micrograph.pixels, cmap="gray")
        for contour in outline(one.segmentation.mask):
            panel.plot(contour[:, 1], contour[:, 0], color=OUTLINE, lw=0.6)
        panel.set_title(title, fontsize=6)
    return figure


def fit(result: "Fit", hours_per_time: float, truth: dict[str, float] | None = None) -> Figure:
    """Data with their standard errors, the fitted curves, and the residuals below; parameters in the title."""
    targets = result.targets
    hours = targets.times * hours_per_time
    count = len(targets.names)
    figure = Figure(figsize=(5.2 * count, 5.6), layout="constrained")
    axes = np.atleast_2d(figure.subplots(2, count, sharex=True, height_ratios=(3, 1)).T)
    error = targets.scatter / np.sqrt(targets.replicates)
    spread = np.sqrt(np.diag(result.curve_covariance)).reshape(targets.mean.shape)
    for k, (upper, lower) in enumerate(axes):
        name = targets.names[k]
        upper.fill_between(
            hours, *(result.fitted[k] + sign * spread[k] for sign in (-1, 1)), color=COLONY, alpha=0.2, lw=0
        )
        upper.plot(hours, result.fitted[k], color=COLONY, lw=1.8, label="fitted model, ± error of the comparison")
        upper.errorbar(
            hours, targets.mean[k], error[k], fmt="o", ms=4, color="black", label="micrographs, mean ± standard error"
        )
        upper.set_title(LABELS.get(name, name), fontsize=10)
        lower.axhline(0, color=COLONY, lw=1)
        lower.plot(hours, (targets.mean[k] - result.fitted[k]) / spread[k], "o", ms=4, color="black")
        lower.set(xlabel="hours", ylabel="residual / error" if k == 0 else "")
    axes[0, 0].legend(fontsize=8, loc="upper left")
    figure.suptitle(_summary(result, truth), fontsize=9)
    return figure


def _summary(result: "Fit", truth: dict[str, float] | None) -> str:
    values = result.parameters.asdict()
    parts = []
    for name in result.free:
        known = f", true {truth[name]:.3g}" if truth else ""
        parts.append(f"{name} {values[name]:.3g} ± {result.standard_errors[name]:.2g}{known}")
    return "    ".join(parts) + f"\nchi-square {result.chi_square:.1f} on {result.degrees_of_freedom}; {result.status}"


def convergence(result: "Fit") -> Figure:
    """The free parameters and χ² over the recorded steps."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    steps = np.arange(len(result.history))
    for name, color in zip(result.free, mpl.colormaps["Dark2"].colors, strict=False):  # type: ignore[attr-defined]
        upper.semilogy(steps, [row[name] for row in result.history], "o-", ms=3, color=color, label=name)
    lower.semilogy(steps, [row["cost"] for row in result.history], "o-", ms=3, color="black")
    upper.set_ylabel("parameter")
    upper.legend(fontsize=8)
    lower.set(xlabel="recorded step", ylabel="weighted squares")
    stages = [row["stage"] for row in result.history]
    for k in range(1, len(stages)):
        if stages[k] != stages[k - 1]:
            for axes in (upper, lower):
                axes.axvline(k - 0.5, color="0.8", lw=0.8)
    return figure
