"""The corner plot of a posterior: every parameter alone, and every pair."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy import stats

from yeastfit.inference.posterior.draws import weighted_quantile
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.kinds import check_kind
from yeastfit.plot.style import COLONY, TRUTH, label_log_axis, words

SHOWN = 2000  # dots, at most
BINS = 30
REACH = 6.0  # quartiles from the median that an axis reaches: four standard deviations of a normal distribution
TOLD = 0.002  # share of draws beyond an axis, from where it is told
WIDE = 5.0  # largest over smallest λ, from where an axis is logarithmic


def corner(posterior: Posterior, truth: Mapping[str, float] | None = None) -> Figure:
    """Every parameter and every pair of parameters, each axis over the bulk of the posterior.

    An axis reaches `REACH` times as far from the median as the quartiles do, and not beyond the draws; how many lie
    further out, as on the thin trail of a posterior, stands in the panel.

    Diagonal: the posterior's histogram, the prior's density as a grey line and its ends as dashes, and the 90 %
    interval. Below: draws, with contours around 50 and 90 % of them. An axis is logarithmic where the prior is one of
    log λ and the posterior wide (`WIDE`); densities are of what the axis shows.

    Arguments:
        posterior: Draws and prior.
        truth: True λ by name, as green lines.

    Returns:
        A figure.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("posterior", posterior, Posterior, "a yeastfit.Posterior")
    free, weights = posterior.free, posterior.weights.ravel()
    count = len(free)
    figure = Figure(figsize=(1.4 + 2.1 * count, 1.2 + 2.1 * count), layout="constrained")
    panels: Any = figure.subplots(count, count, squeeze=False)
    dots = posterior.flat
    if posterior.weighted or len(dots) > SHOWN:
        dots = posterior.drawn(SHOWN, np.random.default_rng(0))
    distributions = posterior.prior.distributions.values()
    axes = [_Axis.of(column, weights, one) for column, one in zip(posterior.flat.T, distributions, strict=True)]
    for (row, column), panel in np.ndenumerate(panels):
        if column > row:
            panel.axis("off")
            continue
        if row == column:
            _margin(panel, posterior, row, axes[row])
        else:
            panel.plot(dots[:, column], dots[:, row], ".", ms=1.5, color=COLONY, alpha=0.35, rasterized=True)
            _contours(panel, dots[:, [column, row]], axes[column], axes[row])
            panel.set(yscale=axes[row].scale, ylim=axes[row].ends)
        panel.set(xscale=axes[column].scale, xlim=axes[column].ends)
        panel.tick_params(labelsize=7, which="both")
        axes[column].label(panel.xaxis)
        if row != column:
            axes[row].label(panel.yaxis)
        if truth and free[column] in truth:
            panel.axvline(truth[free[column]], color=TRUTH, lw=1.2)
        if truth and free[row] in truth and row != column:
            panel.axhline(truth[free[row]], color=TRUTH, lw=1.2)
        if row == count - 1:
            panel.set_xlabel(words(free[column]), fontsize=9)
        if column == 0 and row:
            panel.set_ylabel(words(free[row]), fontsize=9)
    note = "; green: the truth" if truth else ""
    figure.suptitle(f"posterior, grey: the prior{note};\nbars 90 %, lines hold 50 and 90 % of the draws", fontsize=9)
    return figure


@dataclass(frozen=True)
class _Axis:
    """One parameter's axis: its ends in λ, and whether it is logarithmic."""

    ends: tuple[float, float]
    scale: Literal["linear", "log"]

    @staticmethod
    def of(values: Float[np.ndarray, " draw"], weights: Float[np.ndarray, " draw"], prior: Distribution) -> "_Axis":
        first, low, middle, high, last = (
            weighted_quantile(values, weights, share) for share in (0.0005, 0.25, 0.5, 0.75, 0.9995)
        )
        if prior.logarithmic and middle * (high / low) ** (REACH / 2) > WIDE * middle:
            low, high = middle * (low / middle) ** REACH, middle * (high / middle) ** REACH
        else:
            low, high = middle + REACH * (low - middle), middle + REACH * (high - middle)
        low, high = (max(low, first), min(high, last)) if high > low else (first, last)
        wide = prior.logarithmic and high > WIDE * low
        axis = _Axis((low, high), "log" if wide else "linear")
        low, high, *support = axis.plain(np.array([low, high, *prior.support])).tolist()
        margin = 0.05 * (high - low) or 0.1 * abs(high) or 0.01
        ends = max(low - margin, support[0] - 0.2 * margin), min(high + margin, support[1] + 0.2 * margin)
        return _Axis((float(axis.back(np.array(ends[0]))), float(axis.back(np.array(ends[1])))), axis.scale)

    def label(self, axis: Any) -> None:
        """A few numbers that do not run into each other."""
        if self.scale == "log":
            label_log_axis(axis, *self.ends)
        else:
            axis.set_major_locator(MaxNLocator(3))

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


def _margin(panel: Any, posterior: Posterior, k: int, axis: _Axis) -> None:
    """One parameter's histogram with the prior's density, both of what the axis shows."""
    prior, edges = posterior.prior.distributions[posterior.free[k]], axis.grid(BINS + 1)
    shares = np.histogram(posterior.flat[:, k], edges, weights=posterior.weights.ravel())[0]
    panel.stairs(shares / np.diff(axis.plain(edges)), edges, fill=True, color=COLONY, alpha=0.6)
    x = axis.grid(200)
    x = x[(x > prior.support[0]) & (x < prior.support[1])]
    density = prior.density.pdf(np.log(x) if prior.logarithmic else x)
    panel.plot(x, density / x if prior.logarithmic and axis.scale == "linear" else density, color="0.5", lw=1.2)
    for end in prior.support:
        if axis.ends[0] < end < axis.ends[1]:
            panel.axvline(end, color="0.5", lw=1, ls="--")
    panel.plot(posterior.interval(0.9)[k], [0, 0], color="black", lw=4, solid_capstyle="butt")
    panel.set(yticks=[], ylim=(0, None))
    for place, beyond, text in (
        (0.02, posterior.flat[:, k] < axis.ends[0], "← {}"),
        (0.98, posterior.flat[:, k] > axis.ends[1], "{} →"),
    ):
        share = float(posterior.weights.ravel()[beyond].sum())
        if share >= TOLD:
            side: Literal["left", "right"] = "left" if place < 0.5 else "right"
            panel.text(
                place, 0.94, text.format(f"{share:.1%}"), transform=panel.transAxes, fontsize=7, ha=side, va="top"
            )


def _contours(panel: Any, pair: Float[np.ndarray, "draw 2"], across: _Axis, along: _Axis) -> None:
    """Contours around 50 and 90 % of the smoothed density of draws, where these span the plane."""
    inside = [
        (one.ends[0] <= values) & (values <= one.ends[1]) for one, values in zip((across, along), pair.T, strict=True)
    ]
    pair = pair[inside[0] & inside[1]]
    if len(pair) < 10:
        return
    plain = np.stack([across.plain(pair[:, 0]), along.plain(pair[:, 1])])
    scatter = plain.std(axis=1)
    if not (scatter > 0).all() or abs(np.corrcoef(plain)[0, 1]) > 1 - 1e-9:
        return
    x, y = across.grid(60), along.grid(60)
    places = np.stack(np.meshgrid(across.plain(x), along.plain(y))).reshape(2, -1)
    density = stats.gaussian_kde(plain)(places).reshape(60, 60)
    falling = np.sort(density.ravel())[::-1]
    held = np.cumsum(falling) / falling.sum()
    levels = sorted({float(falling[np.searchsorted(held, share)]) for share in (0.5, 0.9)})
    panel.contour(x, y, density, levels=levels, colors="black", linewidths=0.8)
