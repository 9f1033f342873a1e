"""Pictures of a posterior: corner, traces and ranks of chains, predictive curves and colonies, an emulator's checks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from scipy import stats

from yeastfit.infer.laws import Law
from yeastfit.infer.samples import Samples, weighted_quantile
from yeastfit.measure.segmentation import outline
from yeastfit.plot import COLONY, CONDITIONS, LABELS, OUTLINE, TRUTH

if TYPE_CHECKING:
    from yeastfit.infer.diagnostics import Diagnostics
    from yeastfit.infer.predictive import Predictive
    from yeastfit.infer.priors import Prior
    from yeastfit.infer.targets import Targets

SHOWN = 2000  # dots of a corner plot, at most
BINS = 30
WIDE = 5.0  # largest over smallest λ, from where an axis is logarithmic
LINES = 12  # chains of a trace plot, at most


def corner(samples: Samples, prior: "Prior", truth: Mapping[str, float] | None = None) -> Figure:
    """Every parameter and every pair, each axis over what the posterior reaches.

    Diagonal: the posterior's histogram, the prior's density as a grey line and its ends as dashes, and the 90 %
    interval. Below: draws, with areas of 50 and 90 % of them. An axis is logarithmic where the prior is one of log λ
    and the posterior wide (`WIDE`); densities are of what the axis shows. truth: green lines.
    """
    free, weights = samples.free, samples.weights.ravel()
    count = len(free)
    figure = Figure(figsize=(1.4 + 2.1 * count, 1.2 + 2.1 * count), layout="constrained")
    panels: Any = figure.subplots(count, count, squeeze=False)
    dots = samples.flat
    if samples.weighted or len(dots) > SHOWN:
        dots = samples.drawn(SHOWN, np.random.default_rng(0))
    axes = [_Axis.of(samples.flat[:, k], weights, prior.laws[name]) for k, name in enumerate(free)]
    for (row, column), panel in np.ndenumerate(panels):
        if column > row:
            panel.axis("off")
            continue
        if row == column:
            _margin(panel, samples, prior, row, axes[row])
        else:
            panel.plot(dots[:, column], dots[:, row], ".", ms=1.5, color=COLONY, alpha=0.35, rasterized=True)
            _areas(panel, dots[:, [column, row]], axes[column], axes[row])
            panel.set(yscale=axes[row].scale, ylim=axes[row].ends)
        panel.set(xscale=axes[column].scale, xlim=axes[column].ends)
        panel.tick_params(labelsize=7, which="both")
        if truth and free[column] in truth:
            panel.axvline(truth[free[column]], color=TRUTH, lw=1.2)
        if truth and free[row] in truth and row != column:
            panel.axhline(truth[free[row]], color=TRUTH, lw=1.2)
        if row == count - 1:
            panel.set_xlabel(free[column].replace("_", " "), fontsize=9)
        if column == 0 and row:
            panel.set_ylabel(free[row].replace("_", " "), fontsize=9)
    known = "; green: the truth" if truth else ""
    figure.suptitle(f"posterior, grey: the prior{known};\nbars 90 %, lines hold 50 and 90 % of the draws", fontsize=9)
    return figure


def traces(samples: Samples) -> Figure:
    """Every parameter along the chains, the first `LINES` of them; or weights, where draws are weighted."""
    count = len(samples.free)
    figure = Figure(figsize=(9, 0.8 + 1.6 * count), layout="constrained")
    for k, panel in enumerate(figure.subplots(count, 1, sharex=not samples.weighted, squeeze=False)[:, 0]):
        if samples.weighted:
            panel.plot(samples.flat[:, k], samples.weights.ravel(), ".", ms=3, color=COLONY, alpha=0.6)
            panel.set_xlabel(samples.free[k].replace("_", " "), fontsize=8)
            panel.set_ylabel("weight", fontsize=8)
        else:
            for number, chain in enumerate(samples.values[:LINES, :, k]):
                panel.plot(chain, lw=0.6, color=CONDITIONS[number % len(CONDITIONS)], alpha=0.8)
            panel.set_ylabel(samples.free[k].replace("_", " "), fontsize=8)
        panel.tick_params(labelsize=7)
    if not samples.weighted:
        figure.axes[-1].set_xlabel("draw", fontsize=8)
        chains = min(LINES, len(samples.values))
        figure.suptitle(f"{chains} of {len(samples.values)} chains", fontsize=9)
    return figure


def ranks(found: "Diagnostics") -> Figure:
    """Shares of each chain's draws by rank over all draws: alike, and near the line, where chains agree."""
    count, chains, bins = found.ranks.shape
    figure = Figure(figsize=(1.0 + 3.0 * count, 2.8), layout="constrained")
    for k, panel in enumerate(figure.subplots(1, count, sharey=True, squeeze=False)[0]):
        for number, shares in enumerate(found.ranks[k]):
            panel.stairs(shares, np.linspace(0, 1, bins + 1), color=CONDITIONS[number % len(CONDITIONS)], alpha=0.6)
        panel.axhline(1 / bins, color="black", lw=1)
        panel.set(xlabel="rank", ylim=(0, None))
        panel.set_title(f"{found.free[k].replace('_', ' ')}, p = {found.unequal[k]:.2g}", fontsize=9)
        panel.tick_params(labelsize=7)
    figure.axes[0].set_ylabel(f"share of each of {chains} chains", fontsize=8)
    return figure


def predictive(found: "Predictive", targets: "Targets") -> Figure:
    """Bands of 50 and 90 % of the means that draws of the posterior predict, over the data with their errors."""
    count = len(targets.names)
    figure = Figure(figsize=(max(5.2 * count, 6.5), 4.2), layout="constrained")
    wide, narrow, middle = found.band(0.9), found.band(0.5), np.median(found.statistics, axis=0)
    first = 0
    for row, panel in enumerate(figure.subplots(1, count, squeeze=False)[0]):
        seen = targets.measured[row]
        hours = np.array([targets.scales.hours(float(time)) for time in targets.times[seen]])
        part = slice(first, first + int(seen.sum()))
        first = part.stop
        if len(hours) > 1:
            panel.fill_between(hours, *wide[part].T, color=COLONY, alpha=0.2, lw=0, label="90 % of predictions")
            panel.fill_between(hours, *narrow[part].T, color=COLONY, alpha=0.35, lw=0, label="50 % of predictions")
            panel.plot(hours, middle[part], color=COLONY, lw=1.4)
        else:
            for band, width, what in ((wide, 3, "90 %"), (narrow, 8, "50 %")):
                panel.vlines(hours, *band[part].T, color=COLONY, lw=width, alpha=0.5, label=f"{what} of predictions")
        error = targets.scatter[row, seen] / np.sqrt(targets.replicates[row, seen])
        error = np.where(np.isfinite(error), error, 0.0)
        panel.errorbar(
            hours, targets.mean[row, seen], error, fmt="o", ms=4, color="black", label="data ± standard error"
        )
        name = targets.names[row]
        panel.set_title(LABELS.get(name, name.replace("_", " ")), fontsize=10)
        panel.set_xlabel("hours")
    figure.axes[0].legend(fontsize=8)
    inside = found.inside(0.9).sum()
    of = "one colony" if found.replicates == 1 else f"means of {found.replicates} colonies"
    figure.suptitle(
        f"{len(found.values)} draws of the posterior, {of} each; {inside} of {len(found.observed)} observations in the "
        f"90 % band, p = {found.p_value:.2f}",
        fontsize=9,
    )
    return figure


def colonies(
    photographs: Sequence[tuple[str, np.ndarray | None, Bool[np.ndarray, "row column"], float]],
    grown: Sequence[tuple[str, Bool[np.ndarray, "x y"], float]],
) -> Figure:
    """Observed colonies above, simulated ones below, all on one scale.

    photographs: title, grey values where there are some, mask, µm per pixel; the mask's outline is drawn. grown:
    likewise, without grey values.
    """
    columns = max(len(photographs), len(grown))
    figure = Figure(figsize=(1.9 * columns + 0.4, 4.4), layout="constrained")
    axes: Any = figure.subplots(2, columns, squeeze=False)
    reach = max([*(_reach(one[2], one[3]) for one in photographs), *(_reach(one[1], one[2]) for one in grown)])
    for panel in axes.ravel():
        panel.axis("off")
    for panel, (title, pixels, mask, pixel) in zip(axes[0], photographs, strict=False):
        extent = _about_the_centre(mask, pixel)
        if pixels is None:
            panel.imshow(np.where(mask, 1.0, np.nan), cmap="Greys", vmin=0, vmax=2, extent=extent)
        else:
            panel.imshow(pixels, cmap="gray", extent=extent)
        _frame(panel, mask, extent, pixel, reach, title)
    for panel, (title, mask, pixel) in zip(axes[1], grown, strict=False):
        extent = _about_the_centre(mask.T, pixel)
        panel.imshow(np.where(mask.T, 1.0, np.nan), cmap="Greys", vmin=0, vmax=2, extent=extent)
        _frame(panel, mask.T, extent, pixel, reach, title)
    figure.suptitle(f"above: observed; below: grown from draws of the posterior; {2 * reach:.0f} µm across", fontsize=9)
    return figure


def held_out(rounds: Sequence[Mapping[str, Any]], labels: Sequence[str]) -> Figure:
    """Residuals of simulations that the emulator had not learnt from: their mean, to be 0, and variance, to be 1."""
    last = rounds[-1]["held_out"]
    mean, variance = np.array(last["mean"], dtype=float), np.diag(np.array(last["covariance"], dtype=float))
    chance = 2 / np.sqrt(last["rows"])
    figure = Figure(figsize=(max(6.0, 0.34 * len(labels) + 2.5), 4.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for panel, values, aim, width, what in (
        (upper, mean, 0.0, chance, "mean (sd)"),
        (lower, variance, 1.0, chance * np.sqrt(2), "variance"),
    ):
        panel.axhspan(aim - width, aim + width, color="0.85", lw=0)
        panel.axhline(aim, color="black", lw=0.8)
        panel.plot(values, "o", ms=4, color=COLONY)
        panel.set_ylabel(what, fontsize=8)
        panel.tick_params(labelsize=7)
    lower.set_xticks(range(len(labels)), labels, rotation=90, fontsize=6)
    figure.suptitle(
        f"standardised residuals of {last['rows']} held-out simulations; grey: two standard errors of chance",
        fontsize=9,
    )
    return figure


@dataclass(frozen=True)
class _Axis:
    """What is shown of one parameter: from where to where, in λ, and whether in log λ."""

    ends: tuple[float, float]
    scale: Literal["linear", "log"]

    @staticmethod
    def of(values: Float[np.ndarray, " draw"], weights: Float[np.ndarray, " draw"], law: Law) -> "_Axis":
        low, high = (weighted_quantile(values, weights, share) for share in (0.0005, 0.9995))
        wide = law.logarithmic and high > WIDE * low
        axis = _Axis((low, high), "log" if wide else "linear")
        low, high, *support = axis.plain(np.array([low, high, *law.support])).tolist()
        margin = 0.25 * (high - low) or 0.1 * abs(high)
        ends = max(low - margin, support[0] - 0.2 * margin), min(high + margin, support[1] + 0.2 * margin)
        return _Axis((float(axis.back(np.array(ends[0]))), float(axis.back(np.array(ends[1])))), axis.scale)

    def plain(self, values: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """λ, or log λ."""
        with np.errstate(divide="ignore"):
            return np.log(values) if self.scale == "log" else values

    def back(self, plain: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """λ of it."""
        return np.asarray(np.exp(plain)) if self.scale == "log" else plain

    def grid(self, count: int) -> Float[np.ndarray, " point"]:
        """Evenly spaced on the axis, in λ."""
        low, high = self.plain(np.array(self.ends)).tolist()
        return self.back(np.linspace(low, high, count))


def _margin(panel: Any, samples: Samples, prior: "Prior", k: int, axis: _Axis) -> None:
    """One parameter's histogram with the prior's density, both of what the axis shows."""
    law, edges = prior.laws[prior.free[k]], axis.grid(BINS + 1)
    shares = np.histogram(samples.flat[:, k], edges, weights=samples.weights.ravel())[0]
    panel.stairs(shares / np.diff(axis.plain(edges)), edges, fill=True, color=COLONY, alpha=0.6)
    x = axis.grid(200)
    x = x[(x > law.support[0]) & (x < law.support[1])]
    density = law.density.pdf(np.log(x) if law.logarithmic else x)
    panel.plot(x, density / x if law.logarithmic and axis.scale == "linear" else density, color="0.5", lw=1.2)
    for end in law.support:
        if axis.ends[0] < end < axis.ends[1]:
            panel.axvline(end, color="0.5", lw=1, ls="--")
    panel.plot(samples.interval(0.9)[k], [0, 0], color="black", lw=4, solid_capstyle="butt", clip_on=False)
    panel.set(yticks=[], ylim=(0, None))


def _areas(panel: Any, pair: Float[np.ndarray, "draw 2"], across: _Axis, along: _Axis) -> None:
    """Lines that hold 50 and 90 % of the smoothed density of draws, where these span the plane."""
    plain = np.stack([across.plain(pair[:, 0]), along.plain(pair[:, 1])])
    scatter = plain.std(axis=1)
    if len(pair) < 10 or not (scatter > 0).all() or abs(np.corrcoef(plain)[0, 1]) > 1 - 1e-9:
        return
    x, y = across.grid(60), along.grid(60)
    places = np.stack(np.meshgrid(across.plain(x), along.plain(y))).reshape(2, -1)
    density = stats.gaussian_kde(plain)(places).reshape(60, 60)
    falling = np.sort(density.ravel())[::-1]
    held = np.cumsum(falling) / falling.sum()
    levels = sorted({float(falling[np.searchsorted(held, share)]) for share in (0.5, 0.9)})
    panel.contour(x, y, density, levels=levels, colors="black", linewidths=0.8)


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
    panel.set_title(title, fontsize=7, parse_math=False)
