"""Derivatives of ensemble means compared with central differences of the hard model: accuracy and cost.

λ3 in {0.1, 5}, λ5 in {0.1, 1, 2.5}, λ7 in {0.5, 0.7, 1}, the others 0.1, 5, 0.5, 1; compactness, d̄, radius, area and
N at four times from about 20 to 250 nodes; all seven derivatives in log λ. The reference are central differences: two
ensembles of the hard model with common keys for each parameter, at ±10 %, the distance that the regression uses, too.
They are compared with `yeastfit.sensitivity` at its default settings and with its two components. The hard model runs
at Δt λ3 ≤ 0.025 (docs/convergence.md has the remaining error of the time step).

Targets, for the default estimator: every entry agrees with the differences within 3 combined standard errors or within
15 %; for each statistic, all times together, the cosine is at least 0.97; variance times cost is at most 1/4 of that of
differences and at most that of the regression. Cost is counted in colonies of the hard model; a pathwise derivative
counts as many colonies as take the same time, measured separately in the middle of the grid. Then, for one colony of
the source's size, all seven derivatives in forward mode take at most 8 plain runs, and reverse mode at most 2 GB.

One λ more has rules beyond the source's at work (`gradients_of_rules`).

--quick: one λ, small ensembles up to 60 nodes. --docs DIR writes DIR/gradients.md and DIR/gradients.png.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from benchmarks.gradients_of_rules import audit_of_rules
from benchmarks.programs import LAMBDA, SOURCE, STEPS, Program, samples
from benchmarks.report import Report, command
from yeastfit import Numerics, Parameters, Relaxation, Sensitivity, member_keys, sensitivity, simulate
from yeastfit.inference.sensitivity.colonies import colonies_at, hard_but_smoothly_measured, tame
from yeastfit.inference.sensitivity.estimate import STATISTICS
from yeastfit.inference.sensitivity.pathwise import PATH_NODES
from yeastfit.inference.sensitivity.result import Estimate
from yeastfit.inference.simulator import member_seeds
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import Colony, start
from yeastfit.model.parameters import PARAMETERS
from yeastfit.model.simulate import trajectory

SPREAD, PATHS, NODES = 0.1, 8, (20, 50, 110, 250)
SIZES = (0, 35, 80, 160, 400)  # nodes, between the times
GRID = list(product((0.1, 5.0), (0.1, 1.0, 2.5), (0.5, 0.7, 1.0)))
DOMAIN = 28.8
METHODS = ("combined", "regression", "pathwise")


def numerics_of(parameters: Parameters, quick: bool) -> Numerics:
    """Δt λ3 ≤ 0.025 and Δt ≤ 0.01; a domain for 250 nodes and a capacity of twice as many."""
    dt = 0.005 if float(parameters.repulsivity) > 1 else 0.01
    return Numerics(domain=16.0 if quick else DOMAIN, spacing=0.2, dt=dt, capacity=128 if quick else 512)


def times_of(parameters: Parameters, numerics: Numerics, counts: tuple[int, ...]) -> np.ndarray:
    """Half-integer times at which a few relaxed colonies are closest to the given numbers of nodes."""
    coarse = Numerics(numerics.domain, 2 * numerics.spacing, 0.02, numerics.capacity)
    at = np.arange(2.5, 11.0)
    grown = simulate(parameters, member_keys(99, 8), times=at, numerics=coarse, throw=False)
    nodes = grown.statistics["cell_count"].mean(axis=0) + 1
    return at[np.unique([np.abs(np.log(nodes / count)).argmin() for count in counts])]


def differences(parameters: Parameters, times: np.ndarray, numerics: Numerics, members: int) -> tuple[Estimate, int]:
    """Central differences of the hard ensemble's mean, and the number of colonies they took."""
    relaxation = hard_but_smoothly_measured()
    colonies = colonies_at(parameters, None, STATISTICS, times, numerics, relaxation, _observe(numerics))
    centre = np.log([float(getattr(parameters, name)) for name in PARAMETERS.names])
    seeds = member_seeds(7, members)
    columns = []
    for k in range(len(PARAMETERS.names)):
        away = SPREAD * np.eye(len(PARAMETERS.names))[k]
        up, down = (colonies(np.tile(np.exp(centre + sign * away), (members, 1)), seeds) for sign in (1, -1))
        slopes = (up - down) / (2 * SPREAD)
        columns.append((slopes.mean(axis=0), slopes.std(axis=0, ddof=1) / np.sqrt(members)))
    jacobian, error = (np.stack([column[i] for column in columns], axis=-1) for i in (0, 1))
    return Estimate(jacobian, error), 2 * members * len(PARAMETERS.names)


def _observe(numerics: Numerics) -> SmoothStatistics:
    return SmoothStatistics(numerics.domain, 0.1)


def estimates(found: Sensitivity) -> dict[str, Estimate]:
    """Estimates by name."""
    return {"combined": Estimate(found.jacobian, found.error), **found.parts}


def compare(estimate: Estimate, truth: Estimate) -> dict[str, np.ndarray]:
    """z-scores and relative differences, [observable, parameter], and cosines, [statistic]; NaN is ignored."""
    both = np.hypot(estimate.error, truth.error)
    off = estimate.jacobian - truth.jacobian
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(off == 0, 0.0, off / both)
        relative = np.where(off == 0, 0.0, np.abs(off / truth.jacobian))
    there = np.isfinite(estimate.jacobian)
    a, b = (np.where(there, e.jacobian, 0.0).reshape(len(STATISTICS), -1) for e in (estimate, truth))
    cosine = np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return {"z": z, "relative": relative, "cosine": cosine}


def audit(report: Report, quick: bool) -> list[dict[str, Any]]:
    """All λ: a row for each estimator, statistic, time and parameter."""
    grid = [(5.0, 1.0, 0.7)] if quick else GRID
    rows = []
    for number, point in enumerate(grid):
        what = f"λ {number + 1} of {len(grid)}: λ3 {point[0]}, λ5 {point[1]}, λ7 {point[2]}"
        report.stage(what)
        rows += report.part(f"{what}, {quick}", partial(audit_of, report, quick, number, *point))
    return rows


def asking(
    quick: bool, repulsivity: float, mobility: float, aspect_ratio: float
) -> tuple[Callable[..., Sensitivity], np.ndarray, Numerics]:
    """`sensitivity` at one λ, its times, and the numerics of the hard model."""
    parameters = Parameters(**LAMBDA).replace(repulsivity=repulsivity, mobility=mobility, aspect_ratio=aspect_ratio)
    numerics = numerics_of(parameters, quick)
    times = times_of(parameters, numerics, NODES[:2] if quick else NODES)
    return partial(sensitivity, parameters, times=times, numerics=numerics, observe=_observe(numerics)), times, numerics


def worth_of_a_path(report: Report, quick: bool) -> list[float]:
    """How many colonies of the hard model take as long as a pathwise derivative, for a soft and a stiff contact."""
    found = []
    for repulsivity in (5.0,) if quick else (0.1, 5.0):
        report.stage(f"cost of a path: λ3 {repulsivity}")
        ask, _, _ = asking(quick, repulsivity, 1.0, 0.7)
        for _ in range(2):  # the first compiles
            seconds = ask(runs=64, paths=PATHS).seconds
        found.append((seconds["pathwise"] / PATHS) / (seconds["regression"] / 64))
    return found


def audit_of(
    report: Report, quick: bool, seed: int, repulsivity: float, mobility: float, aspect_ratio: float
) -> list[dict[str, Any]]:
    """All rows of one λ."""
    members, runs = (16, 64) if quick else (32, 256)
    ask, times, numerics = asking(quick, repulsivity, mobility, aspect_ratio)
    found = ask(runs=runs, paths=PATHS, seed=seed)
    truth, colonies = differences(Parameters(**found.at), times, numerics, members)
    for warning in found.warnings:
        report.stage(warning)
    counts = zip(found.observables, found.mean.tolist(), strict=True)
    nodes = {one.time: count for one, count in counts if one.statistic == "cell_count"}
    rows = []
    for method, estimate in {"differences": truth, **estimates(found)}.items():
        beside = compare(estimate, truth)
        for row, k in np.ndindex(estimate.jacobian.shape):
            one = found.observables[row]
            rows.append(
                {
                    "repulsivity": repulsivity,
                    "mobility": mobility,
                    "aspect_ratio": aspect_ratio,
                    "statistic": one.statistic,
                    "time": one.time,
                    "nodes": nodes[one.time] + 1,
                    "parameter": PARAMETERS.names[k],
                    "method": method,
                    "derivative": float(estimate.jacobian[row, k]),
                    "error": float(estimate.error[row, k]),
                    "z": float(beside["z"][row, k]),
                    "relative": float(beside["relative"][row, k]),
                    "cosine": float(beside["cosine"][STATISTICS.index(one.statistic)]),
                    "share": float(found.pathwise_share[row]),
                    "colonies": {"differences": colonies, "pathwise": 0}.get(method, runs),
                    "paths": PATHS if method in ("combined", "pathwise") else 0,
                }
            )
    return rows


def verdicts(report: Report, rows: list[dict[str, Any]], worths: list[float]) -> None:
    """Add targets and tables, by statistic and method and by colony size."""
    table = {method: _columns(rows, method) for method in ("differences", *METHODS)}
    exact = table["differences"]
    worth = float(np.mean(worths))
    note = "of the hard model in the same time: " + ", ".join(f"{each:.2g}" for each in worths)
    report.add("cost of a pathwise derivative", worth, "colonies", note=note)
    for one in table.values():
        one["cost"] = one["colonies"] + worth * one["paths"]
    moves = _variance(exact) > 1e-6 * _variance(table["regression"])  # in small colonies the count hardly varies
    summary, sizes = [], []
    for method in METHODS:
        one = table[method]
        outside = (np.abs(one["z"]) > 3) & (one["relative"] > 0.15)
        with np.errstate(divide="ignore", invalid="ignore"):
            cost = np.where(moves, _variance(one) / _variance(exact), np.nan)
            against = np.where(moves, _variance(one) / _variance(table["regression"]), np.nan)
        for name in STATISTICS:
            of = one["statistic"] == name
            summary.append(
                {
                    "method": method,
                    "statistic": name,
                    "entries": int(np.isfinite(one["z"][of]).sum()),
                    "outside": int(outside[of].sum()),
                    "rms z": float(np.sqrt(np.nanmean(one["z"][of] ** 2))),
                    "lowest cosine": float(np.nanmin(one["cosine"][of])),
                    "var × cost / differences": float(np.nanmedian(cost[of])),
                    "largest": float(np.nanmax(cost[of])),
                    "var × cost / regression": float(np.nanmedian(against[of])),
                    "largest ": float(np.nanmax(against[of])),
                    "mean pathwise weight": float(one["share"][of].mean()) if method == "combined" else None,
                }
            )
        if method == "combined":
            sizes = [
                {
                    "nodes": f"{low} to {high}",
                    "entries": int(of.sum()),
                    "outside": int(outside[of].sum()),
                    "rms z": float(np.sqrt(np.mean(one["z"][of] ** 2))),
                    "var × cost / differences": float(np.nanmedian(cost[of])),
                    "largest": float(np.nanmax(cost[of])),
                    "var × cost / regression": float(np.nanmedian(against[of])),
                    "smallest": float(np.nanmin(against[of])),
                    "mean pathwise weight": float(one["share"][of].mean()),
                }
                for low, high in pairwise(SIZES)
                if (of := (one["nodes"] >= low) & (one["nodes"] < high)).any()
            ]
            chance = f"of {outside.size}; {0.0027 * outside.size:.0f} beyond 3 errors expected by chance"
            report.add("entries outside 3 errors and 15 %", outside.sum(), "", 0, at_least=False, note=chance)
            report.add("lowest cosine per statistic", one["cosine"].min(), "", 0.97)
            note = f"median {np.nanmedian(cost):.2f}"
            report.add("variance × cost / differences", np.nanmax(cost), "×", 0.25, False, note)
            note = f"median {np.nanmedian(against):.2f}, smallest {np.nanmin(against):.2f}"
            report.add("variance × cost / regression", np.nanmax(against), "×", 1.0, False, note)
    report.table("estimators compared with central differences of the hard model", summary)
    report.table("combined, by colony size", sizes)


def _columns(rows: list[dict[str, Any]], method: str) -> dict[str, np.ndarray]:
    chosen = [row for row in rows if row["method"] == method]
    return {key: np.array([row[key] for row in chosen]) for key in chosen[0]}


def _variance(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Squared error, averaged over the seven parameters, times cost, for every entry."""
    squared = (columns["error"] ** 2).reshape(-1, len(PARAMETERS.names)).mean(axis=1)
    return np.repeat(squared, len(PARAMETERS.names)) * columns["cost"]


def cost_of_derivatives(report: Report, quick: bool) -> None:
    """Cost for one colony of the source's size, statistics every tenth step: plain, forward and reverse mode."""
    steps = 100 if quick else STEPS
    at, colony = samples(steps, 10), start(jax.random.key(0), SOURCE)
    relaxation, observe = Relaxation(contact=0.2, turning=0.0), SmoothStatistics(SOURCE.domain, SOURCE.spacing)
    values = jnp.log(jnp.array(list(LAMBDA.values())))

    def curves(values: jax.Array, colony: Colony) -> Any:
        return trajectory(
            Parameters.from_array(PARAMETERS.names, jnp.exp(values)), colony, at, relaxation, SOURCE, observe
        )[1]

    def forwards(values: jax.Array, colony: Colony) -> Any:
        push: Callable = partial(jax.jvp, lambda v: curves(v, colony), (values,))
        return jax.vmap(lambda unit: push((unit,)), out_axes=(None, 0))(jnp.eye(len(PARAMETERS.names)))

    def backwards(values: jax.Array, colony: Colony) -> Any:
        real, rest = eqx.partition(colony, eqx.is_inexact_array)
        return jax.grad(lambda v, r: jnp.sum(curves(v, eqx.combine(r, rest))["radius"]), (0, 1))(values, real)

    report.stage("cost of one colony's derivatives")
    plain, forward, backward = (Program.of(law, values, colony) for law in (curves, forwards, backwards))
    for program in (plain, forward, backward):
        program.timed(1)
        program.timed(3)
    note = f"aim 5; {plain.wall:.2f} s plain, {forward.wall:.2f} s with seven tangents"
    report.add("seven derivatives, forward mode", forward.wall / plain.wall, "plain runs", 8, at_least=False, note=note)
    note = "λ, positions, weights and nutrient"
    report.add("all derivatives, reverse mode", backward.wall / plain.wall, "plain runs", note=note)
    report.add("memory, reverse mode", backward.memory / 1e9, "GB", 2, at_least=False)
    report.add("memory, forward mode", forward.memory / 1e9, "GB")


def picture(rows: list[dict[str, Any]], path: Path) -> None:
    """Plot every estimator's derivatives against the differences, a column for each statistic."""
    figure = Figure(figsize=(20, 11), layout="constrained")
    axes = figure.subplots(len(METHODS), len(STATISTICS))
    truth = _columns(rows, "differences")
    for line, method in zip(axes, METHODS, strict=True):
        one = _columns(rows, method)
        for ax, name in zip(line, STATISTICS, strict=True):
            of = one["statistic"] == name
            for k, parameter in enumerate(PARAMETERS.names):
                at = of & (one["parameter"] == parameter)
                ax.errorbar(
                    truth["derivative"][at], one["derivative"][at], one["error"][at], truth["error"][at],
                    fmt="o", ms=3, lw=0.6, color=f"C{k}", label=parameter,
                )  # fmt: skip
            ends = np.array([truth["derivative"][of].min(), truth["derivative"][of].max()])
            ax.plot(ends, ends, color="black", lw=0.7)
            ax.set_title(f"{method}: {name.replace('_', ' ')}", fontsize=10)
            ax.set_xscale("symlog", linthresh=0.1 * float(np.abs(ends).max()))
            ax.set_yscale("symlog", linthresh=0.1 * float(np.abs(ends).max()))
        line[0].set_ylabel("∂ mean / ∂ log λ")
    for ax in axes[-1]:
        ax.set_xlabel("central differences, hard model")
    axes[0, 0].legend(fontsize=7)
    figure.savefig(path, dpi=70)


def markdown(report: Report) -> str:
    """The text of the page."""
    parts = [
        f"""# Derivatives of the ensemble mean, audited

{report.origin}

Derivatives of the hard model's mean in log λ1 … log λ7 at {len(GRID)} λ, for five statistics and four times from
about 20 to 250 nodes, compared with central differences of ±{SPREAD:.0%} with {32} colonies on each side and common
keys.

![Derivatives compared with central differences](gradients.png)

Conclusions:

- **Regression** over pairs in an orthogonal design has no visible bias at ±10 %: z-scores are as chance makes them. (At
  ±20 % a twentieth of all entries were outside, mostly in metabolic rate and aspect ratio, because all parameters move
  at once and third-order interactions enter.) Its advantage over differences grows with chaos. At equal cost its
  variance is a fifth to a third of theirs where contacts are stiff and colonies large, and two fifths where contacts
  are soft. In colonies of twenty nodes common keys help differences in one parameter about as much as the joint design
  helps the regression.
- **Pathwise** derivatives (`{_words(tame())}`), used up to {PATH_NODES} nodes, have a fraction of the
  variance of either, and a bias that no ensemble, however large, reveals by itself. The regression reveals it.
- **Combined** weights the pathwise estimate by how well it agrees with the regression. The James–Stein rule, which
  guarantees a result no worse than the regression, is cautious: seven numbers say little about a bias. At late times,
  where there are no pathwise derivatives, the combined estimate still pays for those at earlier times.

Tried and rejected, at λ = (0.1, 5, 5, 0.5, 1, 1, 0.7), colonies of 16 to 100 nodes. z is the root mean square over
parameters of the distance from the hard model's derivatives (512 runs of regression combined with 896 of differences),
in standard errors:

- Contact 0.2, turning 0, overhang 0.25, twice the spacing, Δt = 0.02: low variance at all times, but z = 2.6 to 5.0 for
  d̄, radius and area with 16 paths; with turning 0.5, z = 2.0 to 4.7. The model chosen above has z = 0.8 to 2.4.
- The same with exact derivatives: a variance as low as the others' at 16 nodes, 20 to 70 times the regression's at 60
  nodes, 150 to 20 000 times at 100.
- Regression on that relaxed model, three times as fast as on the hard one: z = 2.0 to 3.6, which costs more than the
  speed gains.

"Outside" means neither within 3 combined standard errors nor within 15 %. Variances are squared errors, averaged over
the parameters; those of "combined" include the possible bias of its pathwise part. "Largest" and "smallest" are over
all λ and times.
"""
    ]
    return "\n".join([*parts, *report.sections()])


def _words(relaxation: Relaxation) -> str:
    shares = {name: getattr(relaxation, name) for name in ("contact", "overhang", "turning")}
    return ", ".join(f"{name} {float(value):g}" for name, value in shares.items() if value is not None)


def run(report: Report, quick: bool) -> None:
    """Run the audit, measure the cost, and write the page."""
    rows = audit(report, quick)
    verdicts(report, rows, report.part(f"worth, {quick}", partial(worth_of_a_path, report, quick)))
    audit_of_rules(report, quick)
    cost_of_derivatives(report, quick)
    if report.docs is not None:
        picture(rows, report.docs / "gradients.png")
        (report.docs / "gradients.md").write_text(markdown(report))
    keep = ("repulsivity", "mobility", "aspect_ratio", "statistic", "time", "nodes", "parameter", "method")
    report.details["entries"] = [
        {**{key: row[key] for key in keep}, **{key: row[key] for key in ("derivative", "error", "z", "relative")}}
        for row in rows
    ]


if __name__ == "__main__":
    command("gradients", run)
