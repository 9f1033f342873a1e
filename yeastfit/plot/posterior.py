"""Pictures of a posterior: traces and ranks of chains, predictive curves and colonies, an emulator's checks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool
from matplotlib.figure import Figure

from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.posterior.chain_diagnostics import ChainDiagnostics
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.targets import Targets
from yeastfit.kinds import check_kind
from yeastfit.measure.outlining.segmentation import outline
from yeastfit.measure.statistics.registry import title_of
from yeastfit.plot.style import COLONY, CONDITIONS, OUTLINE, literal, words

LINES = 12  # chains of a trace plot, at most


TITLE = 32  # letters above the picture of a colony


def traces(posterior: Posterior) -> Figure:
    """Every parameter along the first `LINES` chains, or the weights of weighted draws.

    Arguments:
        posterior: Draws of it.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("posterior", posterior, Posterior, "a yeastfit.Posterior")
    count = len(posterior.free)
    figure = Figure(figsize=(9, 0.8 + 1.6 * count), layout="constrained")
    for k, panel in enumerate(figure.subplots(count, 1, sharex=not posterior.weighted, squeeze=False)[:, 0]):
        if posterior.weighted:
            panel.plot(posterior.flat[:, k], posterior.weights.ravel(), ".", ms=3, color=COLONY, alpha=0.6)
            panel.set_xlabel(words(posterior.free[k]), fontsize=8)
            panel.set_ylabel("weight", fontsize=8)
        else:
            for number, chain in enumerate(posterior.values[:LINES, :, k]):
                panel.plot(chain, lw=0.6, color=CONDITIONS[number % len(CONDITIONS)], alpha=0.8)
            panel.set_ylabel(words(posterior.free[k]), fontsize=8)
        panel.tick_params(labelsize=7)
    if not posterior.weighted:
        figure.axes[-1].set_xlabel("draw", fontsize=8)
        chains = min(LINES, len(posterior.values))
        figure.suptitle(f"{chains} of {len(posterior.values)} chains", fontsize=9)
    return figure


def ranks(chains: ChainDiagnostics) -> Figure:
    """Shares of each chain's draws by rank over all draws; where chains agree they lie in the grey band of chance.

    Arguments:
        chains: Diagnostics of the chains, those of a posterior.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("chains", chains, ChainDiagnostics, "Posterior.chains")
    count, number, bins = chains.ranks.shape
    figure = Figure(figsize=(1.0 + 3.0 * count, 2.9), layout="constrained")
    edges, faint = np.linspace(0, 1, bins + 1), min(0.6, 6 / number)
    for k, panel in enumerate(figure.subplots(1, count, sharey=True, squeeze=False)[0]):
        middle, width = chains.ranks[k].mean(axis=0), 2 * chains.chance[k]
        panel.stairs(middle + width, edges, baseline=np.maximum(middle - width, 0), fill=True, color="0.85")
        for one, shares in enumerate(chains.ranks[k]):
            panel.stairs(shares, edges, baseline=None, color=CONDITIONS[one % len(CONDITIONS)], alpha=faint)
        panel.axhline(1 / bins, color="black", lw=1)
        panel.set(xlabel="rank", ylim=(0, None))
        panel.set_title(f"{words(chains.free[k])}, p = {chains.unequal[k]:.2g}", fontsize=9)
        panel.tick_params(labelsize=7)
    figure.axes[0].set_ylabel(f"share of each of {number} chains\n(grey: two sd of chance)", fontsize=8)
    return figure


def predictive(
    predicted: Predictive, targets: Targets, noun: tuple[str, str] = ("simulation", "simulations")
) -> Figure:
    """Bands of 50 and 90 % of the predicted curves, over the data with their standard errors.

    Arguments:
        predicted: Result of `Posterior.predict`.
        targets: The data.
        noun: What one replicate is called, and several.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("predicted", predicted, Predictive, "what Posterior.predict returns")
    check_kind("targets", targets, Targets)
    count = len(targets.names)
    figure = Figure(figsize=(max(5.2 * count, 6.5), 4.2), layout="constrained")
    wide, narrow, middle = predicted.band(0.9), predicted.band(0.5), np.median(predicted.statistics, axis=0)
    first = 0
    for row, panel in enumerate(figure.subplots(1, count, squeeze=False)[0]):
        measured = targets.measured[row]
        times = targets.clock[measured]
        part = slice(first, first + int(measured.sum()))
        first = part.stop
        if len(times) > 1:
            panel.fill_between(times, *wide[part].T, color=COLONY, alpha=0.2, lw=0, label="90 % of predictions")
            panel.fill_between(times, *narrow[part].T, color=COLONY, alpha=0.35, lw=0, label="50 % of predictions")
            panel.plot(times, middle[part], color=COLONY, lw=1.4)
        else:
            for band, width, what in ((wide, 3, "90 %"), (narrow, 8, "50 %")):
                panel.vlines(times, *band[part].T, color=COLONY, lw=width, alpha=0.5, label=f"{what} of predictions")
        error = targets.scatter[row, measured] / np.sqrt(targets.replicates[row, measured])
        error = np.where(np.isfinite(error), error, 0.0)
        panel.errorbar(
            times, targets.mean[row, measured], error, fmt="o", ms=4, color="black", label="data ± standard error"
        )
        name = targets.names[row]
        panel.set_title(title_of(name, targets.length_unit), fontsize=10)
        panel.set_xlabel(targets.clock_label)
    figure.axes[0].legend(fontsize=8)
    inside = predicted.inside(0.9).sum()
    of = f"one {noun[0]}" if predicted.replicates == 1 else f"means of {predicted.replicates} {noun[1]}"
    figure.suptitle(
        f"{len(predicted.values)} draws of the posterior, {of} each; {inside} of {len(predicted.observed)} "
        f"observations in the 90 % band, p = {predicted.p_value:.2f}",
        fontsize=9,
    )
    return figure


def colonies(
    photographs: Sequence[tuple[str, np.ndarray | None, Bool[np.ndarray, "row column"], float]],
    simulated: Sequence[tuple[str, Bool[np.ndarray, "x y"], float]],
) -> Figure:
    """Photographs above, simulated outlines below, all on one scale; one row of outlines without photographs.

    Arguments:
        photographs: Title, grey values where there are some, mask, µm per pixel; the mask's outline is drawn.
        simulated: Title, mask, µm per pixel.

    Returns:
        A figure.
    """
    columns = max(len(photographs), len(simulated))
    rows = 2 if photographs else 1
    figure = Figure(figsize=(1.9 * columns + 0.4, 2.1 * rows + 0.2), layout="constrained")
    axes: Any = figure.subplots(rows, columns, squeeze=False)
    reach = max([*(_reach(one[2], one[3]) for one in photographs), *(_reach(one[1], one[2]) for one in simulated)])
    for panel in axes.ravel():
        panel.axis("off")
    for panel, (title, pixels, mask, pixel) in zip(axes[0], photographs, strict=False):
        extent = _about_the_centre(mask, pixel)
        if pixels is None:
            panel.imshow(np.where(mask, 1.0, np.nan), cmap="Greys", vmin=0, vmax=2, extent=extent)
        else:
            panel.imshow(pixels, cmap="gray", extent=extent)
        _frame(panel, mask, extent, pixel, reach, title)
    for panel, (title, mask, pixel) in zip(axes[-1], simulated, strict=False):
        extent = _about_the_centre(mask.T, pixel)
        panel.imshow(np.where(mask.T, 1.0, np.nan), cmap="Greys", vmin=0, vmax=2, extent=extent)
        _frame(panel, mask.T, extent, pixel, reach, title)
    said = "above: observed; below: simulated" if photographs else "simulated"
    figure.suptitle(f"{said} at draws of the posterior; {2 * reach:.0f} µm across", fontsize=9)
    return figure


def cross_validation(diagnostics: EmulatorDiagnostics) -> Figure:
    """Residuals of simulations held out from an emulator: their mean, ideally 0, and their variance, ideally 1.

    Arguments:
        diagnostics: Of a run of the emulator, `Posterior.diagnostics`.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("diagnostics", diagnostics, EmulatorDiagnostics, "Posterior.diagnostics of a run of the emulator")
    last = diagnostics.rounds[-1].cross_validation
    chance = 2 / np.sqrt(last.rows)
    figure = Figure(figsize=(max(6.0, 0.34 * len(last.labels) + 2.5), 4.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for panel, values, aim, width, what in (
        (upper, last.mean, 0.0, chance, "mean (sd)"),
        (lower, np.diag(last.covariance), 1.0, chance * np.sqrt(2), "variance"),
    ):
        panel.axhspan(aim - width, aim + width, color="0.85", lw=0)
        panel.axhline(aim, color="black", lw=0.8)
        panel.plot(values, "o", ms=4, color=COLONY)
        panel.set_ylabel(what, fontsize=8)
        panel.tick_params(labelsize=7)
    lower.set_xticks(range(len(last.labels)), last.labels, rotation=90, fontsize=6)
    figure.suptitle(
        f"standardised residuals of {last.rows} held-out simulations; grey: two standard errors of chance", fontsize=9
    )
    return figure


def _reach(mask: Bool[np.ndarray, "row column"], pixel: float) -> float:
    """µm from the centroid to the furthest pixel."""
    places = np.argwhere(mask)
    return float(np.linalg.norm(places - places.mean(axis=0), axis=1).max() + 2) * pixel


def _about_the_centre(mask: Bool[np.ndarray, "row column"], pixel: float) -> tuple[float, float, float, float]:
    """Extent in µm with the centroid at 0, rows downwards."""
    row, column = np.argwhere(mask).mean(axis=0)
    rows, columns = mask.shape
    left, top = -(column + 0.5) * pixel, -(row + 0.5) * pixel
    return left, left + columns * pixel, top + rows * pixel, top


def _frame(
    panel: Any, mask: Bool[np.ndarray, "row column"], extent: tuple[float, ...], pixel: float, reach: float, title: str
) -> None:
    for contour in outline(mask):
        panel.plot(
            extent[0] + (contour[:, 1] + 0.5) * pixel, extent[3] + (contour[:, 0] + 0.5) * pixel, color=OUTLINE, lw=0.8
        )
    panel.set(xlim=(-reach, reach), ylim=(reach, -reach))
    panel.set_title(literal(title, TITLE), fontsize=7)
