"""Pictures of runs beside each other: colonies left out with what was predicted of them, and marginal posteriors."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import gaussian_kde

from yeastfit.inference.comparison.conditions import evenly
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.comparison.runs import ComparedRun
from yeastfit.kinds import check_kind, check_named
from yeastfit.plot.style import CONDITIONS, words

COLUMNS = 3
APART = 0.8  # of the room of a colony, that the runs share
POINTS = 200  # of a density


def left_out(runs: Mapping[str, LeftOut]) -> Figure:
    """Every statistic of every colony over its predicted intervals of 50 and 90 %, of one run or several.

    Arguments:
        runs: On the same colonies, by name.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_named("runs", runs, LeftOut, "the result of yeastfit.cross_validate")
    first = next(iter(runs.values()))
    count, several = len(first.labels), len(runs) > 1
    rows, columns = -(-count // COLUMNS), min(COLUMNS, count)
    figure = Figure(figsize=(max(4.6 * columns, 6.0), 1.2 + 2.5 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    places = np.arange(len(first.colonies))
    for k, panel in enumerate(panels):
        if k >= count:
            panel.axis("off")
            continue
        for n, (name, one) in enumerate(runs.items()):
            shift = APART * ((n + 0.5) / len(runs) - 0.5)
            low, lower, _, upper, high = one.quantiles[:, :, k].T
            color = CONDITIONS[n % len(CONDITIONS)]
            panel.vlines(places + shift, low, high, color=color, lw=2, alpha=0.5)
            panel.vlines(places + shift, lower, upper, color=color, lw=6, alpha=0.5, label=words(name))
        panel.plot(places, first.observed[:, k], "o", color="black", ms=4, label="observed")
        panel.set_title(words(first.labels[k]), fontsize=9)
        panel.set_xticks(places, [words(name) for name in first.colonies], fontsize=7)
        panel.tick_params(labelsize=7)
    if several:
        legend = panels[0].get_legend_handles_labels()
        figure.legend(*legend, loc="outside lower center", ncols=2 * columns, fontsize=8, frameon=False)
    figure.suptitle("colonies left out, predicted by the others: intervals of 50 and 90 %; dots: observed", fontsize=9)
    return figure


def marginals(runs: Sequence[ComparedRun]) -> Figure:
    """Density of every parameter in every run, one panel a parameter, each scaled to the same height.

    Arguments:
        runs: Finished runs of `infer`.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("runs", runs, Sequence, "a list of finished runs")
    for one in runs:
        check_kind("runs", one, ComparedRun, "finished runs of infer")
    names = list(dict.fromkeys(name for one in runs for name in one.posterior.free))
    rows, columns = -(-len(names) // COLUMNS), min(COLUMNS, len(names))
    figure = Figure(figsize=(max(3.4 * columns, 6.0), 0.8 + 2.4 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for k, panel in enumerate(panels):
        if k >= len(names):
            panel.axis("off")
            continue
        _marginal(panel, runs, names[k])
    drawn = {line.get_label(): line for panel in panels for line in panel.get_lines()}
    figure.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=COLUMNS, fontsize=8, frameon=False)
    return figure


def _marginal(axes: Any, runs: Sequence[ComparedRun], name: str) -> None:
    """Densities in the prior's coordinate, drawn over λ, each scaled to the height 1."""
    for n, one in enumerate(runs):
        posterior = one.posterior
        if name not in posterior.free:
            continue
        column = evenly(posterior, posterior.free.index(name))
        spread = np.ptp(column)
        x = np.linspace(column.min(), column.max(), POINTS) if spread > 0 else np.array([column[0]])
        density = gaussian_kde(column)(x) if spread > 0 else np.ones(1)
        axes.plot(x, density / density.max(), color=CONDITIONS[n % len(CONDITIONS)], label=words(one.name))
    axes.set_title(words(name), fontsize=9)
    axes.set(yticks=[], ylim=(0, 1.08))
    axes.tick_params(labelsize=7)
