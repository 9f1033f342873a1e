"""Figures of a fit: data with the fitted curves, how the fit converged, likelihood profiles and bootstrap draws."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from yeastfit.inference.fit.bootstrap_profile import Bootstrap, Profile
from yeastfit.inference.fit.result import Condition, Fit
from yeastfit.kinds import check_kind, check_named
from yeastfit.measure.statistics.registry import title_of
from yeastfit.plot.information import draw_ellipse
from yeastfit.plot.style import COLONY, CONDITIONS, label_log_axis, literal, words
from yeastfit.text import short

NAME_WIDTH = 40  # letters of a condition's name in one line of a legend


def fit(result: Fit, truth: Mapping[str, float] | None = None) -> Figure:
    """Draw data with their standard errors, the fitted curves with theirs, and the residuals below.

    Arguments:
        result: What `yeastfit.fit` returned.
        truth: True values of the fitted parameters, where they are known; they are written above.

    Returns:
        A figure with a column for each statistic and a colour for each condition.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("result", result, Fit, "what yeastfit.fit returned")
    names = list(dict.fromkeys(name for each in result.conditions for name in each.targets.names))
    figure = Figure(figsize=(max(5.2 * len(names), 6.5), 5.8), layout="constrained")
    axes = figure.subplots(2, len(names), sharex=True, height_ratios=(3, 1), squeeze=False)
    for k, each in enumerate(result.conditions):
        color = COLONY if len(result.conditions) == 1 else CONDITIONS[k % len(CONDITIONS)]
        for row, name in enumerate(each.targets.names):
            upper, lower = axes[:, names.index(name)]
            _draw_condition(upper, lower, each, row, color)
    for k, name in enumerate(names):
        axes[0, k].set_title(title_of(name, result.conditions[0].targets.length_unit), fontsize=10)
        axes[1, k].axhline(0, color="0.6", lw=1)
        axes[1, k].set(xlabel=result.conditions[0].targets.clock_label, ylabel="residual / error" if not k else "")
    axes[0, 0].legend(fontsize=8, loc="best")
    figure.suptitle(_summary(result, truth), fontsize=9)
    return figure


def convergence(result: Fit) -> Figure:
    """Draw the free parameters and χ² over the number of simulated colonies, in a colour for each start.

    Rejected steps are crosses. Vertical lines separate the stages of the fit.

    Arguments:
        result: What `yeastfit.fit` returned.

    Returns:
        A figure with one panel for each free parameter and one for χ².

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("result", result, Fit, "what yeastfit.fit returned")
    count = len(result.free)
    figure = Figure(figsize=(8, 2.2 + 1.3 * count), layout="constrained")
    *upper, lowest = figure.subplots(count + 1, 1, sharex=True, height_ratios=[1] * count + [1.4])
    colors = mpl.colormaps["Dark2"].colors  # type: ignore[attr-defined]
    for number in sorted({step.start for step in result.history}):
        steps = [step for step in result.history if step.start == number]
        taken = [step for step in steps if step.taken]
        refused = [step for step in steps if not step.taken]
        color = colors[(number - 1) % len(colors)]
        for panel, name in zip([*upper, lowest], [*result.free, None], strict=True):
            for shown, mark in ((taken, "o-"), (refused, "x")):
                values = [step.values[name] if name else step.cost for step in shown]
                label = f"start {number}" if name is None and mark == "o-" else None
                panel.plot([s.simulations for s in shown], values, mark, ms=4, lw=1.2, color=color, label=label)
    for panel, name in zip(upper, result.free, strict=True):
        panel.set_yscale("log")
        panel.set_ylabel(words(name, 24), fontsize=8)
        value, error = result.values[name], result.standard_errors[name]
        if np.isfinite(error):
            panel.axhspan(max(value - error, 1e-3 * value), value + error, color=COLONY, alpha=0.18, lw=0)
        panel.axhline(value, color=COLONY, lw=1)
        label_log_axis(panel.yaxis, *panel.get_ylim())
    lowest.set(yscale="log", xlabel="simulations")
    lowest.set_ylabel("weighted squares", fontsize=8)
    label_log_axis(lowest.yaxis, *lowest.get_ylim())
    lowest.legend(fontsize=8, ncols=3)
    stages = [step.stage for step in result.history]
    for k in range(1, len(stages)):
        if stages[k] != stages[k - 1]:
            between = 0.5 * (result.history[k - 1].simulations + result.history[k].simulations)
            for panel in (*upper, lowest):
                panel.axvline(between, color="0.8", lw=0.8)
    upper[0].set_title(f"{result.message}\nlines part the stages, bands are one standard error", fontsize=9)
    return figure


def profiles(results: Mapping[str, Profile]) -> Figure:
    """Draw the rise of χ² along each parameter, the others refitted, beside the parabola of its standard error.

    Arguments:
        results: Profiles by parameter.

    Returns:
        A figure with one panel for each parameter.

    Raises:
        InputError: An argument is of another class.
    """
    check_named("results", results, Profile, "what yeastfit.profiles returned")
    figure = Figure(figsize=(1.2 + 3.1 * len(results), 3.3), layout="constrained")
    for panel, (name, each) in zip(figure.subplots(1, len(results), squeeze=False)[0], results.items(), strict=True):
        panel.plot(each.values, each.rise, "o-", ms=3, color=COLONY, label="profile")
        if np.isfinite(each.log_standard_error):
            away = np.log(each.values / each.estimate) / each.log_standard_error
            panel.plot(each.values, away**2, color="0.5", lw=1, ls="--", label="standard error")
        for level, share in ((1.0, "68 %"), (3.84, "95 %")):
            panel.axhline(level, color="0.8", lw=0.8)
            panel.annotate(share, (1, level), xycoords=("axes fraction", "data"), fontsize=7, ha="right", va="bottom")
        panel.set(ylim=(-0.2, 9), xlabel=words(name))
    figure.axes[0].set_ylabel("rise of χ²")
    figure.axes[0].legend(fontsize=7)
    return figure


def bootstrap(result: Bootstrap, fitted: Fit) -> Figure:
    """Draw the estimates from resampled replicates for every pair of parameters, with the ellipse of the covariance.

    Arguments:
        result: What `Explored.bootstrap` returned.
        fitted: The fit whose replicates were resampled.

    Returns:
        A figure with one panel for each pair.

    Raises:
        InputError: An argument is of another class.
    """
    check_kind("result", result, Bootstrap, "what Explored.bootstrap returned")
    check_kind("fitted", fitted, Fit, "what yeastfit.fit returned")
    count = max(1, len(fitted.free) - 1)
    figure = Figure(figsize=(1.6 + 2.2 * count, 1.0 + 2.1 * count), layout="constrained")
    axes: Any = figure.subplots(count, count, squeeze=False)
    away = 100 * (np.log(result.values) - fitted.theta)
    for (row, column), panel in np.ndenumerate(axes):
        if column > row or len(fitted.free) < 2:
            panel.axis("off")
            continue
        x, y = column, row + 1
        part = fitted.log_covariance[np.ix_([x, y], [x, y])]
        if np.isfinite(part).all():
            draw_ellipse(panel, part)
        panel.plot(away[:, x], away[:, y], ".", ms=2.5, color="black", alpha=0.5)
        panel.tick_params(labelsize=7)
        if row == count - 1:
            panel.set_xlabel(words(fitted.free[x]) + " (%)", fontsize=8)
        if column == 0:
            panel.set_ylabel(words(fitted.free[y]) + " (%)", fontsize=8)
    figure.suptitle(
        "log λ of resampled replicates, less the estimate;\nellipses: one and two standard errors", fontsize=9
    )
    return figure


def _draw_condition(upper: Any, lower: Any, each: Condition, row: int, color: str) -> None:
    """Curve and residuals of one statistic of one condition."""
    targets = each.targets
    seen = targets.measured[row]
    times = targets.clock[seen]
    error = np.full(targets.mean.shape, np.nan)
    error[targets.measured] = np.sqrt(np.diag(each.covariance))
    fitted, mean, spread = each.fitted[row, seen], targets.mean[row, seen], error[row, seen]
    of = f" of {literal(each.name, NAME_WIDTH)}" if each.name else ""
    if seen.sum() > 1:
        upper.fill_between(times, fitted - spread, fitted + spread, color=color, alpha=0.2, lw=0)
        upper.plot(times, fitted, color=color, lw=1.8, label=f"fitted model{of}, ± error of the comparison")
    else:
        upper.errorbar(times, fitted, spread, fmt="_", ms=18, color=color, label=f"fitted model{of}, ± error")
    scatter = targets.scatter[row, seen] / np.sqrt(targets.replicates[row, seen])
    known = np.where(np.isfinite(scatter), scatter, 0.0)
    dots = "black" if not each.name else color
    upper.errorbar(times, mean, known, fmt="o", ms=4, color=dots, label=f"data{of}, mean ± standard error")
    lower.plot(times, (mean - fitted) / spread, "o", ms=4, color=dots)


def _summary(result: Fit, truth: Mapping[str, float] | None) -> str:
    """Estimates with their errors and the goodness of fit, in words."""
    parts = []
    for name, value in result.values.items():
        error = result.standard_errors[name]
        known = f", true {truth[name]:.3g}" if truth and name in truth else ""
        parts.append(
            f"{words(short(name))} {value:.3g}" + (f" ± {error:.2g}" if np.isfinite(error) else " (no error)") + known
        )
    lines = ["    ".join(parts[k : k + 3]) for k in range(0, len(parts), 3)]
    return "\n".join([*lines, f"chi-square {result.chi_square:.1f} on {result.degrees_of_freedom}; {result.message}"])
