"""Figures of simulated colonies: the last state of one colony, and every statistic as colonies grow."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from yeastfit.inference.models.grown import Grown
from yeastfit.kinds import check_kind
from yeastfit.measure.statistics.registry import most_telling_first, title_of
from yeastfit.panel import Panel
from yeastfit.plot.style import COLONY

EMPTY = "#f3efe6"  # the dish around the colony
KINDS = (EMPTY, COLONY, "#c2410c")


def colony(simulation: Grown, member: int = 0, **shown: Any) -> Figure:
    """Draw one colony at its end, with axes in µm.

    Arguments:
        simulation: What `simulate` returned.
        member: Which colony of the ensemble.
        **shown: For the simulation's `panels`: `width`, of the part shown, in cell lengths L0.

    Returns:
        A figure with a panel for each thing to be seen; the first says how wide a part is shown.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("simulation", simulation, Grown, "what yeastfit.simulate returned")
    panels = simulation.panels(member, **shown)
    figure = Figure(figsize=(0.3 + 4.6 * len(panels), 4.4), layout="constrained")
    draw_panels(figure, panels)
    return figure


def draw_panels(figure: Figure, panels: Sequence[Panel]) -> None:
    """Draw panels side by side, with axes in µm; the first says how wide a part is shown."""
    axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for panel, each in zip(axes, panels, strict=True):
        _draw(figure, panel, each)
        half = panels[0].half_width
        panel.set(xlim=(-half, half), ylim=(-half, half), xlabel="µm", aspect="equal", title=each.title)
    axes[0].set_ylabel("µm")


def curves(simulation: Grown) -> Figure:
    """Draw every statistic as colonies grow: single ones as thin lines, their mean as a thick one.

    Arguments:
        simulation: What `simulate` returned.

    Returns:
        A figure with one panel for each statistic.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("simulation", simulation, Grown, "what yeastfit.simulate returned")
    statistics = simulation.statistics
    names = dict.fromkeys((*most_telling_first(statistics), *statistics))
    marker = "-" if len(simulation.clock) > 1 else "o"
    lines = -(-len(names) // 4)
    figure = Figure(figsize=(11, 2.75 * lines), layout="constrained")
    axes = figure.subplots(lines, 4, squeeze=False).ravel()
    for name, panel in zip(names, axes, strict=False):
        values = np.atleast_2d(statistics[name])
        panel.plot(simulation.clock, values.T, marker, color=COLONY, alpha=0.35, lw=0.8)
        panel.plot(simulation.clock, values.mean(axis=0), marker, color=COLONY, lw=2)
        panel.set(xlabel=simulation.clock_label, title=title_of(name, simulation.length_unit))
        panel.title.set_fontsize(9)
    for panel in axes[len(names) :]:
        panel.axis("off")
    return figure


def _draw(figure: Figure, axes: Any, panel: Panel) -> None:
    half = panel.half_width
    how: dict[str, Any] = {"origin": "lower", "extent": (-half, half, -half, half), "vmin": 0}
    if panel.grey:
        axes.imshow(panel.values.T, cmap="gray", vmax=1, **how)
        return
    if not panel.kinds:
        image = axes.imshow(panel.values.T, cmap="viridis", vmax=1, **how)
        figure.colorbar(image, ax=axes, label=panel.label, shrink=0.85)
        return
    colours = ListedColormap(KINDS[: len(panel.kinds)])
    axes.imshow(panel.values.T, cmap=colours, vmax=len(panel.kinds) - 1, interpolation="nearest", **how)
    if len(panel.kinds) > 2:
        for colour, kind in zip(KINDS[1:], panel.kinds[1:], strict=False):
            axes.plot([], [], "s", color=colour, label=kind)
        axes.legend(fontsize=8, loc="upper right")
