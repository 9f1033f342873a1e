"""Ranks of true parameters in their posteriors, and what to expect of them if posteriors are right.

If ranks are uniform, bands of single histogram bars are binomial; the simultaneous band of the ECDF is that of
Säilynoja et al. (2022, doi:10.1007/s11222-022-10090-6), by simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binom, binomtest

from benchmarks.recovery import SEED
from benchmarks.report import Report

LIKELIHOOD, JOINT = "log-likelihood", "joint posterior (TARP)"
LEVELS = {0.5: (45.0, 55.0), 0.9: (86.0, 94.0)}  # percentage of truths inside, by probability of the interval
LEAST_P, TRIALS = 0.01, 2000  # smallest p; sets of uniform ranks simulated for it
Record = dict[str, Any]


class Ranked(Protocol):
    """What is read here of a method whose posteriors were calibrated."""

    @property
    def method(self) -> str:
        """Its name."""

    @property
    def draws(self) -> int:
        """L, the number of draws that a truth is ranked among."""

    @property
    def bins(self) -> int:
        """Of the histograms."""


@dataclass(frozen=True)
class Uniform:
    """Ranks of `count` data sets among L draws if posteriors are right.

    Attributes:
        count: Number of data sets.
        at: k / (L + 1) for k = 1..L, where the ECDF, the share of ranks below k, is compared.
        table: Two-sided binomial probability of a number of ranks below k.
        tails: The smallest such probability over k, for simulated sets of uniform ranks.
    """

    count: int
    at: Float[np.ndarray, " draw"]
    table: Float[np.ndarray, "number draw"]
    tails: Float[np.ndarray, " trial"]

    @staticmethod
    def of(count: int, draws: int) -> "Uniform":
        """By simulation with a fixed seed."""
        at, number = np.arange(1, draws + 1) / (draws + 1), np.arange(count + 1)[:, None]
        table = 2 * np.minimum(binom.cdf(number, count, at), binom.sf(number - 1, count, at))
        trials = np.random.default_rng(SEED).integers(draws + 1, size=(TRIALS, count))
        return Uniform(count, at, table, np.array([_tail(table, one) for one in trials]))

    def p_value(self, ranks: Int[np.ndarray, " count"]) -> float:
        """Probability that uniform ranks depart at least as far from uniformity."""
        return float((1 + np.sum(self.tails <= _tail(self.table, ranks))) / (1 + TRIALS))

    def band(self) -> Float[np.ndarray, "2 draw"]:
        """Simultaneous 95 % band of the ECDF minus its diagonal."""
        tail = 0.5 * np.quantile(self.tails, 0.05)
        return binom.ppf([[tail], [1 - tail]], self.count, self.at) / self.count - self.at


def below(ranks: Int[np.ndarray, " count"], draws: int) -> Int[np.ndarray, " draw"]:
    """How many ranks are below k, for k = 1..L."""
    return np.cumsum(np.bincount(ranks, minlength=draws + 1))[:-1]


def _tail(table: Float[np.ndarray, "number draw"], ranks: Int[np.ndarray, " count"]) -> float:
    draws = table.shape[1]
    return float(table[below(ranks, draws), np.arange(draws)].min())


def column(records: Sequence[Record], key: str, name: str) -> np.ndarray:
    """A rank or share for all data sets."""
    return np.array([record[key][name] for record in records])


def quantities(records: Sequence[Record]) -> tuple[str, ...]:
    """What was ranked: the parameters; the log-likelihood and the joint posterior where they were."""
    return tuple(records[0]["share"])


def coverage(records: Sequence[Record], level: float) -> tuple[float, float, float]:
    """Percentage of true values inside their intervals, with an interval from the scatter of data sets."""
    parameters = [name for name in quantities(records) if name not in (LIKELIHOOD, JOINT)]
    inside = np.mean([_inside(name, column(records, "share", name), level) for name in parameters], axis=0)
    error = 1.96 * inside.std(ddof=1) / np.sqrt(len(inside)) if len(inside) > 1 else np.nan
    middle = inside.mean()
    return 100 * middle, 100 * max(0.0, middle - error), 100 * min(1.0, middle + error)


def _inside(name: str, shares: np.ndarray, level: float) -> np.ndarray:
    """In the central interval of this probability; of the joint posterior, in the region nearest to a random point."""
    if name == JOINT:
        return shares <= level
    return np.abs(shares - 0.5) <= 0.5 * level


def verdicts(report: Report, part: Ranked, records: Sequence[Record]) -> None:
    """Add figures and tables of one method to the report."""
    whole = [record for record in records if record["status"] == "done"]
    none = None if report.quick else 0.0
    failed = "; ".join(record["status"] for record in records if record["status"] != "done")
    report.add(f"{part.method}: posteriors that failed", len(records) - len(whole), "", none, False, failed)
    if not whole:
        return
    for level, (low, high) in LEVELS.items():
        _judged(report, coverage(whole, level), f"{part.method}: inside {100 * level:g} % intervals", low, high)
    uniform = Uniform.of(len(whole), part.draws)
    p = {name: uniform.p_value(column(whole, "rank", name)) for name in quantities(whole)}
    target = None if report.quick else LEAST_P
    note = f"of {len(p)} quantities, multiplied by their number"
    report.add(f"{part.method}: least p of uniform ranks", min(1.0, len(p) * min(p.values())), "", target, note=note)
    rows = [_row(name, column(whole, "share", name), p[name]) for name in quantities(whole)]
    report.table(f"{part.method}, {len(whole)} data sets: coverage of intervals, %", rows)
    for key, (what, unit) in MEDIANS.items():
        if (values := np.array([record[key] for record in whole if record[key] is not None], dtype=float)).size:
            note = f"{values.min():.4g} to {values.max():.4g}"
            report.add(f"{part.method}: {what}, median", float(np.median(values)), unit, note=note)
    warned = sum(bool(record["warnings"]) for record in whole)
    report.add(f"{part.method}: posteriors with warnings", 100 * warned / len(whole), "%")
    unsettled = sum("not settled" in " ".join(record["warnings"]) for record in whole)
    report.add(
        f"{part.method}: posteriors not settled",
        100 * unsettled / len(whole),
        "%",
        note="as many as that used up their simulations",
    )


MEDIANS = {
    "effective": ("independent draws", ""),
    "weighed": ("draws by their weights alone", ""),
    "rounds": ("rounds or populations", ""),
    "simulations": ("simulated data sets", ""),
    "fresh": ("simulated data sets not shared", ""),
    "tolerance": ("tolerance, a Mahalanobis distance", ""),
    "seconds": ("one posterior, in one process", "s"),
}


def _judged(report: Report, found: tuple[float, float, float], what: str, low: float, high: float) -> None:
    """Add a coverage with its targets."""
    middle, least, most = found
    note = f"95 % interval {least:.0f} to {most:.0f} %, over all parameters"
    if report.quick:
        report.add(what, middle, "%", note=note)
    else:
        report.add(what, middle, "%", low, note=note)
        report.add(f"{what}, at most", middle, "%", high, at_least=False)


def _row(name: str, shares: np.ndarray, p: float) -> dict[str, Any]:
    row: dict[str, Any] = {"quantity": name.replace("_", " ")}
    for level in LEVELS:
        inside = int(_inside(name, shares, level).sum())
        ends = binomtest(inside, len(shares)).proportion_ci(method="wilson")
        row[f"{100 * level:g} %"] = 100 * inside / len(shares)
        row["interval" + " " * len(row)] = f"{100 * ends.low:.0f} to {100 * ends.high:.0f}"
    return row | {"mean share of draws below": float(shares.mean()), "p": p}


def picture(parts: Sequence[Ranked], records: Sequence[Sequence[Record]], path: Path) -> None:
    """Histograms of ranks and, below them, their ECDF minus its diagonal, each with its band."""
    done = ([one for one in each if one["status"] == "done"] for each in records)
    shown = [(part, whole) for part, whole in zip(parts, done, strict=True) if whole]
    figure = Figure(figsize=(14, 5 * len(shown)), layout="constrained")
    panels = figure.subplots(2 * len(shown), max(len(quantities(whole)) for _, whole in shown), squeeze=False)
    for k, (part, whole) in enumerate(shown):
        uniform = Uniform.of(len(whole), part.draws)
        for n, name in enumerate(quantities(whole)):
            ranks = column(whole, "rank", name)
            _histogram(panels[2 * k, n], part, ranks)
            panels[2 * k, n].set(xlabel="rank of the truth")
            panels[2 * k, n].set_title(f"{part.method}:\n{fill(name.replace('_', ' '), 18)}", fontsize=9)
            low, high = uniform.band()
            panel = panels[2 * k + 1, n]
            panel.fill_between(uniform.at, low, high, color="#c9a57b", alpha=0.4, lw=0, label="95 %, all of it")
            panel.step(uniform.at, below(ranks, part.draws) / len(ranks) - uniform.at, color="#7a5230", lw=1.2)
            panel.axhline(0.0, color="black", lw=0.8)
            panel.set(xlabel="rank / (L + 1)", ylabel="ECDF − diagonal")
        panels[2 * k + 1, 0].legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, -0.02))
    figure.savefig(path, dpi=70)


def _histogram(panel: Axes, part: Ranked, ranks: np.ndarray) -> None:
    low, high = binom.ppf([0.025, 0.975], len(ranks), 1 / part.bins)
    panel.hist(ranks, bins=np.linspace(-0.5, part.draws + 0.5, part.bins + 1).tolist(), color="#c9a57b")
    panel.axhspan(low, high, color="black", alpha=0.12, lw=0)
    panel.axhline(len(ranks) / part.bins, color="black", lw=0.8)
