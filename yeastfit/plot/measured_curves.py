"""The figure of a data set: every statistic over time, condition by condition, with the spread of colonies."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from yeastfit.plot.style import CONDITIONS, literal, words

COLUMNS = 4


def condition_curves(
    rows: Sequence[Mapping[str, Any]], curves: Sequence[Mapping[str, Any]], units: Mapping[str, str]
) -> Figure:
    """Draw a panel for each statistic: over hours, or side by side where every condition was photographed once.

    Colonies are thin lines or dots. Bands and bars are one standard deviation of colonies about their mean.

    Arguments:
        rows: One mapping for each image, with `condition`, `replicate`, `hours` and the statistics.
        curves: What `yeastfit.measure.replicate_curves.condition_curves` made of them.
        units: The statistics to draw, with their units.

    Returns:
        A figure with four panels in a row.
    """
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    colors = {name: CONDITIONS[k % len(CONDITIONS)] for k, name in enumerate(conditions)}
    hours = [row["hours"] for row in rows]
    margin = 0.03 * (max(hours) - min(hours))
    over_time = len({(row["condition"], row["hours"]) for row in rows}) > len(conditions)
    lines = -(-len(units) // COLUMNS)
    figure = Figure(figsize=(12.4, 2.35 * lines + 0.4), layout="constrained")
    axes = np.atleast_2d(figure.subplots(lines, COLUMNS, squeeze=False))
    for panel, (name, unit) in zip(axes.ravel(), units.items(), strict=False):
        for k, condition in enumerate(conditions):
            mine = [row for row in rows if row["condition"] == condition]
            mean = [curve for curve in curves if (curve["statistic"], curve["condition"]) == (name, condition)]
            if over_time:
                _draw_over_time(panel, mine, mean, name, colors[condition])
            else:
                _draw_side_by_side(panel, mine, mean, name, colors[condition], k)
        panel.set_title(words(name) + (f" ({unit})" if unit else ""), fontsize=9)
        panel.tick_params(labelsize=7)
        panel.spines[["top", "right"]].set_visible(False)
        if over_time:
            panel.set_xlim(min(hours) - margin, max(hours) + margin)
            panel.set_xlabel("hours", fontsize=7)
        else:
            panel.set(xlim=(-0.6, len(conditions) - 0.4), xticks=range(len(conditions)))
            panel.set_xticklabels([literal(name or "all", 16) for name in conditions])
    for panel in axes.ravel()[len(units) :]:
        panel.axis("off")
    if over_time and conditions != [""]:
        handles = [Line2D([], [], color=colors[name], label=literal(name or "no condition", 40)) for name in conditions]
        figure.legend(handles=handles, loc="outside upper center", ncols=min(len(conditions), 6), fontsize=8)
    return figure


def _draw_over_time(
    panel: Any, rows: list[Mapping[str, Any]], mean: list[Mapping[str, Any]], name: str, color: str
) -> None:
    """Colonies as thin lines, their mean as a thick one, one standard deviation as a band."""
    for replicate in dict.fromkeys(row["replicate"] for row in rows):
        own = sorted((row["hours"], row[name]) for row in rows if row["replicate"] == replicate)
        panel.plot(*zip(*own, strict=True), color=color, alpha=0.3, lw=0.6)
    hours, centre, spread = (
        np.array([curve[key] for curve in mean], dtype=float) for key in ("hours", "mean", "standard_deviation")
    )
    panel.fill_between(hours, centre - spread, centre + spread, color=color, alpha=0.18, lw=0)
    panel.plot(hours, centre, "o-", color=color, lw=1.6, ms=2.5)


def _draw_side_by_side(
    panel: Any, rows: list[Mapping[str, Any]], mean: list[Mapping[str, Any]], name: str, color: str, place: int
) -> None:
    """Colonies as dots beside each other, their mean as a dash, one standard deviation as a bar."""
    values = np.sort(np.array([row[name] for row in rows], dtype=float))
    across = (np.arange(len(values)) * 0.618 % 1 - 0.5) * 0.5
    panel.plot(place + across, values, "o", color=color, ms=3, alpha=0.55, mew=0)
    for curve in mean:
        panel.errorbar(place, curve["mean"], curve["standard_deviation"], fmt="_", color="black", ms=14, lw=1.2)
