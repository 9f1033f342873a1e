"""Figures of simulated colonies: the last state of one colony, and every statistic over time."""

import jax
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from yeastfit.measure.statistics.model_as_mask import mask_of
from yeastfit.measure.statistics.registry import most_telling_first, title_of
from yeastfit.plot.style import COLONY
from yeastfit.simulation.result import Simulation

EMPTY = "#f3efe6"  # the dish around the colony


def colony(simulation: Simulation, member: int = 0, width: float | None = None) -> Figure:
    """Draw the last state of one colony: its cells beside the nutrient, with axes in µm.

    Arguments:
        simulation: What `simulate` returned.
        member: Which colony of the ensemble.
        width: Width of the part shown, in cell lengths L0; by default twice the colony's reach.

    Returns:
        A figure with two panels.
    """
    state, parameters = simulation.colony, simulation.parameters
    if state.count.ndim:
        state = jax.tree.map(lambda leaf: leaf[member], state)
    parameters = jax.tree.map(lambda leaf: leaf if leaf.ndim == 0 else leaf[member], parameters)
    numerics, length = simulation.numerics, simulation.scales.length
    alive = np.asarray(state.alive)
    reach = float(np.abs(np.asarray(state.positions)[alive]).max()) + 2.0
    width = min(numerics.domain, width or 2 * reach)
    mask = mask_of(state, parameters.aspect_ratio, simulation.relaxation, width, points=801)
    half, edge = 0.5 * width * length, 0.5 * numerics.domain * length
    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.imshow(mask.T, origin="lower", extent=(-half, half, -half, half), cmap=ListedColormap([EMPTY, COLONY]))
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


def curves(simulation: Simulation) -> Figure:
    """Draw every statistic over time: single colonies as thin lines, their mean as a thick one.

    Arguments:
        simulation: What `simulate` returned.

    Returns:
        A figure with one panel for each statistic.
    """
    hours = simulation.scales.hours(simulation.times)
    names = most_telling_first(simulation.statistics)
    lines = -(-len(names) // 4)
    figure = Figure(figsize=(11, 2.75 * lines), layout="constrained")
    axes = figure.subplots(lines, 4, squeeze=False).ravel()
    for name, panel in zip(names, axes, strict=False):
        values = np.atleast_2d(simulation.statistics[name])
        panel.plot(hours, values.T, color=COLONY, alpha=0.35, lw=0.8)
        panel.plot(hours, values.mean(axis=0), color=COLONY, lw=2)
        panel.set(xlabel="hours", title=title_of(name))
        panel.title.set_fontsize(9)
    for panel in axes[len(names) :]:
        panel.axis("off")
    return figure
