"""How far the model is from its limit in Δt, h and every width, and how far the relaxed model is from the hard one.

λ = 0.1, 5, 5, 0.5, 1, 1, 0.7; ensembles with the same keys on a domain of 24 L0, up to about 250 nodes at t = 8.5. One
estimator measures all of them (K = 0.2 at 0.1 L0, no blur). Each difference is one between the means of two ensembles,
with a standard error from the differences of their members. Targets: at every time, and at Δt = 0.02 and 0.01, the
relaxed model with default widths differs from the hard model in the limit Δt → 0 by at most 3 % in d̄, A and N and 5 %
in C. Beside that, the order of convergence of one colony in double precision, whose births and angles are the same for
all Δt and h.

--docs DIR writes DIR/convergence.md and DIR/convergence.png. --quick uses small ensembles that end at 60 nodes: their
errors exceed the targets, so the verdict says little.
"""

from datetime import date
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from matplotlib.figure import Figure

from benchmarks.programs import LAMBDA
from benchmarks.report import Report, command
from yeastfit import HARD, Numerics, Parameters, Relaxation, member_keys, simulate
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.snapshot import Snapshot

NAMES = ("compactness", "growth_rate", "mean_radius", "radius", "area", "perimeter", "cell_count")
TARGETS = {"mean_radius": 3.0, "area": 3.0, "cell_count": 3.0, "compactness": 5.0}
DOMAIN, FINEST = 24.0, 0.000625
Curves = dict[str, np.ndarray]  # [member, time] by statistic


class OneEstimator(eqx.Module):
    """Smooth statistics with one K for the hard and the relaxed model."""

    smooth: SmoothStatistics
    boundary: jax.Array

    def __call__(self, snapshot: Snapshot) -> PyTree:
        """Statistics of one colony at one time."""
        relaxation = snapshot.relaxation
        same = Relaxation(relaxation.union, relaxation.contact, self.boundary, relaxation.births)
        return self.smooth(eqx.tree_at(lambda s: s.relaxation, snapshot, same, is_leaf=lambda x: x is relaxation))

    def finish(self, observed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The statistics as they were observed."""
        return observed


class Study:
    """Ensembles that differ in one setting, each simulated once."""

    def __init__(self, report: Report, quick: bool) -> None:
        self.report, self.members = report, 16 if quick else 128
        self.times = np.array([2.0, 4.0, 5.5] if quick else [2.0, 4.0, 5.5, 6.5, 7.5, 8.5])
        self.finest = 0.005 if quick else FINEST
        self.grown: dict[str, Curves] = {}

    def curves(
        self, relaxation: Relaxation, dt: float, h: float = 0.2, boundary: float = 0.2, spacing: float = 0.1
    ) -> Curves:
        """Statistics of one ensemble."""
        name = f"{_widths(relaxation)} {dt} {h} {boundary} {spacing}"
        if name not in self.grown:
            self.report.stage(f"Δt {dt:g}, h {h:g}, K {boundary:g} at {spacing:g}, {_widths(relaxation)}")
            numerics = Numerics(domain=DOMAIN, spacing=h, dt=dt, capacity=420)
            observe = OneEstimator(SmoothStatistics(DOMAIN, spacing), jnp.asarray(boundary))
            keys, parameters = member_keys(0, self.members), Parameters(**LAMBDA)
            run = simulate(
                parameters, keys, times=self.times, numerics=numerics, relaxation=relaxation, observe=observe
            )
            for warning in run.warnings():
                self.report.stage(warning)
            self.grown[name] = {name: run.statistics[name] for name in NAMES}
        return self.grown[name]

    def rows(self, what: str, one: Curves, other: Curves) -> list[dict[str, Any]]:
        """Differences of the means of `one` from those of `other` in percent, with standard errors, for each time."""
        rows = []
        for k, time in enumerate(self.times):
            row: dict[str, Any] = {"setting": what, "time": float(time), "nodes": other["cell_count"][:, k].mean() + 1}
            for name in NAMES:
                row[name], row[f"{name} error"] = _percent(one[name][:, k], other[name][:, k])
            rows.append(row)
        return rows


def _percent(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """100 (mean one / mean other − 1), and its standard error from the differences of the members."""
    ratio = one.mean() / other.mean()
    rest = (one - ratio * other) / other.mean()
    return float(100 * (ratio - 1)), float(100 * rest.std(ddof=1) / np.sqrt(len(rest)))


def _widths(relaxation: Relaxation) -> str:
    if relaxation.union is None and relaxation.contact is None and relaxation.births == "whole":
        return "hard"
    s, w = ("0" if width is None else f"{float(width):g}" for width in (relaxation.union, relaxation.contact))
    return f"s {s}, w {w}, {relaxation.births} births"


def ensembles(study: Study) -> dict[str, list[dict[str, Any]]]:
    """All tables of differences, by title."""
    relaxed, dt = Relaxation(), 0.01
    limit, usual = study.curves(HARD, study.finest), study.curves(relaxed, dt)
    tables: dict[str, list[dict[str, Any]]] = {}

    def table(title: str, base: Curves, settings: dict[str, Curves]) -> None:
        tables[title] = [row for what, curves in settings.items() for row in study.rows(what, curves, base)]

    steps = [step for step in (0.02, 0.01, 0.005, 0.0025) if step > study.finest]
    biases = {f"Δt {s:g}": study.curves(relaxed, s) for s in steps}
    narrow = {"Δt 0.005, w 0.025": study.curves(Relaxation(contact=0.025), 0.005)}
    table("bias of the relaxed model", limit, biases | narrow)
    table("hard, Δt", limit, {f"Δt {s:g}": study.curves(HARD, s) for s in steps})
    finest = study.curves(relaxed, steps[-1])
    table("relaxed, Δt", finest, {f"Δt {s:g}": study.curves(relaxed, s) for s in steps[:-1]})
    for title, model in (("hard, h", HARD), ("relaxed, h", relaxed)):
        fine = study.curves(model, dt, h=0.1)
        table(title, fine, {f"h {h:g}": study.curves(model, dt, h=h) for h in (0.4, 0.2)})
    table(
        "one relaxation at a time, all else hard, Δt 0.01",
        limit,
        {
            **{f"s {s:g}": study.curves(Relaxation(s, None, None, "whole"), dt) for s in (0.1, 0.05, 0.025)},
            **{f"w {w:g}": study.curves(Relaxation(None, w, None, "whole"), dt) for w in (0.2, 0.1, 0.05)},
            "all hard": study.curves(HARD, dt),
            "fractional births": study.curves(Relaxation(None, None, None, "fractional"), dt),
        },
    )
    table("K", usual, {f"K {k:g}": study.curves(relaxed, dt, boundary=k) for k in (0.4, 0.1, 0.05)})
    fine = study.curves(relaxed, dt, spacing=0.05)
    table(
        "grid of the measurement",
        fine,
        {f"{g:g} L0": study.curves(relaxed, dt, spacing=g) for g in (0.2, 0.1)},
    )
    return tables


def orders(report: Report) -> list[dict[str, Any]]:
    """Orders of convergence of one relaxed colony at t = 1.9, 4 nodes, from halving Δt or h.

    The contact is wide (w = 0.2), so that it chatters at no Δt used here, and children appear at 0.2 L0: at the model's
    δ = 0.01 their first step apart, 2 Δt λ3, exceeds δ, and no order is visible above Δt = δ / (2 λ3) = 0.001.
    """
    observe, rows = OneEstimator(SmoothStatistics(8.0, 0.05), jnp.asarray(0.2)), []

    def value(dt: float, h: float, name: str) -> float:
        numerics = Numerics(domain=12.0, spacing=h, dt=dt, capacity=16, bud_distance=0.2)
        relaxation, key = Relaxation(contact=0.2), member_keys(1, 1)[0]
        times, parameters = [1.9], Parameters(**LAMBDA)
        run = simulate(parameters, key, times=times, numerics=numerics, relaxation=relaxation, observe=observe)
        return float(run.statistics[name][0])

    with jax.enable_x64(True):
        for what, grid in (
            ("Δt", [(dt, 0.1) for dt in (0.01, 0.005, 0.0025, 0.00125, 0.000625)]),
            ("h", [(0.01, h) for h in (0.2, 0.1, 0.05, 0.025)]),
        ):
            report.stage(f"order in {what}")
            for name in ("mean_radius", "growth_rate", "area"):
                gaps = np.abs(np.diff([value(dt, h, name) for dt, h in grid]))
                order = float(np.mean(np.log2(gaps[:-1] / gaps[1:])))
                rows.append({"in": what, "statistic": name, "order": order, "last difference": float(gaps[-1])})
    return rows


def picture(tables: dict[str, list[dict[str, Any]]], path: Path) -> None:
    """Plot every table over time: a row of axes for each, a column for each statistic."""
    figure = Figure(figsize=(21, 2.6 * len(tables)), layout="constrained")
    axes = figure.subplots(len(tables), len(NAMES), sharex=True)
    for line, (title, table) in zip(axes, tables.items(), strict=True):
        for ax, name in zip(line, NAMES, strict=True):
            for what in dict.fromkeys(row["setting"] for row in table):
                rows = [row for row in table if row["setting"] == what]
                time, value, error = ([row[key] for row in rows] for key in ("time", name, f"{name} error"))
                ax.errorbar(time, value, error, marker="o", ms=3, capsize=2, label=what)
            ax.axhline(0.0, color="black", lw=0.7)
            if title.startswith("bias") and name in TARGETS:
                ax.axhspan(-TARGETS[name], TARGETS[name], color="0.93", zorder=-1)
            ax.set_title(name.replace("_", " "), fontsize=10)
        line[0].set_ylabel(f"{title.partition(',')[0]}\n{title.partition(', ')[2]}\n(%)", fontsize=9)
        line[0].legend(fontsize=7)
    for ax in axes[-1]:
        ax.set_xlabel("time (1/μ*)")
    figure.savefig(path, dpi=75)


def markdown(tables: dict[str, list[dict[str, Any]]], found: list[dict[str, Any]], members: int) -> str:
    """The text of the page."""
    parts = [
        f"""# Convergence, and how far the relaxed model is from the hard one

Written by `python -m benchmarks.convergence --docs docs` on {date.today()}; ensembles of {members} colonies with common
keys, λ = 0.1, 5, 5, 0.5, 1, 1, 0.7. Every entry is the difference between the means of two ensembles in percent, ± its
standard error. Area, perimeter, compactness and radius of both models are measured by one estimator (K = 0.2 at 0.1
L0).

![Differences over time](convergence.png)

How to choose:

- **Δt, hard.** The hard contact pushes a touching pair apart by Δt λ3 in each step. The error falls with Δt; at the
  source's 0.02 it is much larger than the whole effect of relaxation. Use 0.005 or less.
- **Δt, relaxed.** 0.01 at the default widths; 0.02 is nearly as good. At smaller Δt compactness is up to 5 % too low:
  at larger ones, the chatter that remains where Δt λ3 / w ≥ 1 compensates for part of the force that the ramp removes.
  So a smaller Δt needs a smaller w.
- **h.** 0.2 costs about 1 % of area relative to 0.1. Perimeter, and with it compactness, depends on K and on the grid
  on which it is measured, which is not the nutrient's. It has no limit, so compare only what was measured alike.
- **Widths.** The ramp pushes less than the step it replaces, so colonies are tighter, the more the wider it is. s
  closes gaps in the measured outline and changes growth little. The rows of single relaxations contain the hard model's
  own error at Δt = 0.01 ("all hard").
"""
    ]
    for title, rows in tables.items():
        last = rows if title.startswith("bias") else [row for row in rows if row["time"] == rows[-1]["time"]]
        when = "" if title.startswith("bias") else f", at t = {last[0]['time']:g}, {last[0]['nodes']:.0f} nodes"
        parts.append(f"## {title[0].upper()}{title[1:]}{when}\n\n{_table(last)}\n")
    lines = [
        f"| {r['in']} | {r['statistic'].replace('_', ' ')} | {r['order']:.2f} | {r['last difference']:.1e} |"
        for r in found
    ]
    head = "| halved | statistic | order | last difference |\n|---|---|---|---|\n"
    about = "## Order of one colony\n\nt = 1.9, 4 nodes, double precision, w = 0.2, children at 0.2 L0.\n\n"
    parts.append(about + head + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _table(rows: list[dict[str, Any]]) -> str:
    names = [name.replace("_", " ") for name in NAMES]
    lines = ["| | t | nodes | " + " | ".join(names) + " |", "|---" * (len(NAMES) + 3) + "|"]
    for row in rows:
        cells = [f"{row[name]:+.1f} ± {row[f'{name} error']:.1f}" for name in NAMES]
        lines.append(f"| {row['setting']} | {row['time']:g} | {row['nodes']:.0f} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def run(report: Report, quick: bool) -> None:
    """Simulate all ensembles, determine the orders, and write the page."""
    study = Study(report, quick)
    tables, found = ensembles(study), orders(report)
    for title, rows in tables.items():
        keep = ("setting", "time", "nodes", "compactness", "compactness error", "area", "area error")
        report.table(title, [{key: row[key] for key in (*keep, "mean_radius", "cell_count")} for row in rows])
    report.table("order of one colony", found)
    for row in tables["bias of the relaxed model"]:
        if row["setting"] in ("Δt 0.02", "Δt 0.01"):
            for name, target in TARGETS.items():
                note = f"{row[name]:+.2f} ± {row[f'{name} error']:.2f} %"
                what = f"bias of {name.replace('_', ' ')} at {row['nodes']:.0f} nodes, {row['setting']}"
                report.add(what, abs(row[name]), "%", target, at_least=False, note=note)
    if report.docs is not None:
        picture(tables, report.docs / "convergence.png")
        (report.docs / "convergence.md").write_text(markdown(tables, found, study.members))


if __name__ == "__main__":
    command("convergence", run)
