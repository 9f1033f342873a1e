"""Figures of what data tell about parameters: sloppy spectrum, error ellipses, and what to measure next."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from yeastfit.inference.information.design_result import Design
from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.information.result import Information
from yeastfit.kinds import check_kind
from yeastfit.plot.style import words

SEEN, BLIND = "#7a5230", "#b00020"
CIRCLE = np.linspace(0.0, 2 * np.pi, 181)


def spectrum(result: Information) -> Figure:
    """Draw the eigenvalues of the Fisher information, above the parameters that each eigenvector combines.

    Labels say how well the combination of parameters is known whose largest power is 1, as `Information.rows` does.
    Directions the data do not determine are red. An open triangle marks the noise of the derivatives for an eigenvalue
    that is not significant.

    Arguments:
        result: What `yeastfit.information` returned, or the `information` of a fit.

    Returns:
        A figure with two panels.

    Raises:
        InputError: An argument is of another class.
    """
    _check_information(result)
    count = len(result.free)
    figure = Figure(figsize=(2.6 + 0.85 * count, 3.9 + 0.33 * count), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 0.3 + 0.3 * count))
    places = np.arange(count)
    known = result.eigenvalues > 0
    scale = result.eigenvalues[known].max() if known.any() else 1.0
    floor = np.where(result.noise_floor > 0, result.noise_floor, 1e-6 * scale)
    colors = np.where(result.blind, BLIND, SEEN)
    upper.scatter(places[known], result.eigenvalues[known], c=colors[known], s=46, zorder=3)
    upper.scatter(places[~known], floor[~known], marker="v", s=46, facecolors="none", edgecolors=BLIND, zorder=3)
    upper.plot(places, floor, "_", color="0.6", ms=22, label="noise of the derivatives")
    upper.axhline(result.limit**-2, color=BLIND, lw=0.8, ls="--", label=f"error of log λ {result.limit:g}: blind below")
    for k, row in zip(places, result.rows(), strict=True):
        height = result.eigenvalues[k] if known[k] else floor[k]
        upper.annotate(
            row["combination_known_to"],
            (k, height),
            xytext=(0, 7),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    upper.set_yscale("log")
    upper.margins(x=0.5 / count, y=0.16)
    upper.set_ylabel("eigenvalue, 1 / variance of log λ", fontsize=8)
    upper.set_title("How well each direction is known", fontsize=10)
    upper.legend(fontsize=7, loc="best")
    image = lower.imshow(result.directions.T, cmap="RdBu", vmin=-1, vmax=1, aspect="auto")
    _write_numbers(lower, result.directions.T, "{:.2f}", lambda value: abs(value) > 0.65)
    lower.set(xticks=places, yticks=range(count), yticklabels=[words(name) for name in result.free])
    lower.set_xticklabels([str(k + 1) for k in places])
    lower.set_xlabel("direction in log λ", fontsize=8)
    figure.colorbar(image, ax=lower, label="component", shrink=0.9, pad=0.02)
    return figure


def ellipses(result: Information) -> Figure:
    """Draw the error ellipses of every pair of parameters: one and two standard errors of log λ, in percent.

    Arguments:
        result: What `yeastfit.information` returned, or the `information` of a fit.

    Returns:
        A figure with one panel for each pair; parameters the data do not determine are named instead.

    Raises:
        InputError: An argument is of another class.
    """
    _check_information(result)
    kept = [k for k, name in enumerate(result.free) if name not in result.undetermined]
    cells = max(1, len(kept) - 1)
    figure = Figure(figsize=(1.6 + 1.9 * cells, 1.0 + 1.75 * cells), layout="constrained")
    axes = figure.subplots(cells, cells, squeeze=False)
    for (row, column), panel in np.ndenumerate(axes):
        if column > row or len(kept) < 2:
            panel.axis("off")
            continue
        x, y = kept[column], kept[row + 1]
        draw_ellipse(panel, result.log_covariance[np.ix_([x, y], [x, y])])
        panel.tick_params(labelsize=7)
        if row == cells - 1:
            panel.set_xlabel(words(result.free[x]) + " (%)", fontsize=8)
        if column == 0:
            panel.set_ylabel(words(result.free[y]) + " (%)", fontsize=8)
    lines = ["Errors of log λ: one and two standard errors"]
    if result.undetermined:
        lines.append(words("not determined: " + ", ".join(result.undetermined), 22 + 20 * cells))
    if len(kept) < 2:
        lines.append("no pair is left")
    figure.suptitle("\n".join(lines), fontsize=9)
    return figure


def design(result: Design) -> Figure:
    """Draw by how much each candidate measurement would reduce the typical error, in percent.

    Arguments:
        result: What `yeastfit.design` returned.

    Returns:
        A figure with a row for each statistic, one for whole images, and the chosen sequence as numbers.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("result", result, Design, "what yeastfit.design returned")
    rows = [*(words(name) for name in result.statistics), "whole image"]
    table = np.vstack([100 * result.table(), np.full((1, len(result.times)), np.nan)])
    for choice in result.images:
        table[-1, result.column(choice)] = 100 * choice.reduction
    figure = Figure(figsize=(2.4 + 0.62 * max(len(result.times), 3), 1.5 + 0.5 * len(rows)), layout="constrained")
    axes = figure.subplots()
    top = np.nanmax(table) if np.isfinite(table).any() else 1.0
    image = axes.imshow(np.ma.masked_invalid(table), cmap="YlGnBu", vmin=0, vmax=max(top, 1e-9), aspect="auto")
    _write_numbers(axes, table, "{:.1f}", lambda value: value > 0.6 * top)
    axes.axhline(len(result.statistics) - 0.5, color="white", lw=3)
    axes.set(xticks=range(len(result.times)), yticks=range(len(rows)), yticklabels=rows)
    axes.set_xticklabels(["" if np.isnan(time) else f"{time:g}" for time in result.times])
    axes.set_xlabel("" if np.isnan(result.times).all() else "time")
    for number, choice in enumerate(result.sequence, start=1):
        single = len(choice.statistics) == 1 and len(result.statistics) > 1
        row = result.statistics.index(choice.statistics[0]) if single else len(rows) - 1
        column = result.column(choice)
        axes.annotate(
            f"{number}",
            (column, row),
            xytext=(9 * (number - 1) - 15, 12),
            textcoords="offset points",
            fontsize=7,
            ha="center",
            va="center",
            bbox={"boxstyle": "circle,pad=0.15", "facecolor": "#ff4d00", "edgecolor": "none"},
            color="white",
        )
    who = f"{result.added:g} further replicates" if result.new_replicates else "the same replicates"
    figure.suptitle(
        f"Measured next, in {who}:\nfall of the typical error ({percent(result.typical_error)} now)",
        fontsize=9,
    )
    figure.colorbar(image, ax=axes, label="%", shrink=0.9, pad=0.02)
    return figure


def draw_ellipse(panel: Any, covariance: Float[np.ndarray, "2 2"]) -> None:
    """Draw one and two standard errors of a pair, in percent, into a panel.

    Arguments:
        panel: Axes of matplotlib.
        covariance: Covariance of the pair's log λ.
    """
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(CIRCLE), np.sin(CIRCLE)])
    one = 100 * (vectors * np.sqrt(np.maximum(values, 0.0))) @ circle
    panel.fill(*(2 * one), color=SEEN, alpha=0.18, lw=0)
    panel.fill(*one, color=SEEN, alpha=0.45, lw=0)
    panel.axhline(0, color="0.7", lw=0.6)
    panel.axvline(0, color="0.7", lw=0.6)


def _check_information(result: Any) -> None:
    check_kind("result", result, Information, "what yeastfit.information returned, or Fit.information")


def _write_numbers(axes: Any, table: np.ndarray, form: str, bright: Callable[[float], bool]) -> None:
    """Every finite entry of an image as text, in white where `bright` says so."""
    for (row, column), value in np.ndenumerate(table):
        if np.isfinite(value):
            color = "white" if bright(value) else "black"
            axes.text(column, row, form.format(value), ha="center", va="center", fontsize=7, color=color)
