"""One λ of the audit of derivatives in which rules beyond the source's are at work together.

Buds biased along the nutrient's gradient, births by clocks, death by starvation: all parameters, those of the rules
among them, by the regression of `yeastfit.sensitivity` and by central differences of the same hard colonies. The
differences move one parameter at a time by ±10 %, with common keys. There are no pathwise derivatives: births jump.
`benchmarks.gradients` has it, too; alone it takes minutes instead of an hour.

    python -m benchmarks.gradients_of_rules [--quick] [--json FILE] [--docs DIR]

--docs writes DIR/gradients-of-rules.md. An interrupted run continues where it stopped if --json is given.
"""

from functools import partial
from typing import Any

import numpy as np

from benchmarks.programs import LAMBDA
from benchmarks.report import Report, command
from yeastfit import Model, Numerics, Parameters, sensitivity
from yeastfit.inference.sensitivity.colonies import colonies_at, hard_but_smoothly_measured
from yeastfit.inference.sensitivity.estimate import STATISTICS
from yeastfit.inference.simulator import member_seeds
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics

RULES = Model.of({"budding": {"rule": "biased"}, "births": {"rule": "clocks"}, "death": {"rule": "starvation"}})
BROUGHT = {"budding_bias": 2.0, "cycle_variation": 0.2, "death_rate": 0.2, "starvation": 0.4}
SPREAD = 0.1


def audit_of_rules(report: Report, quick: bool) -> None:
    """Add the figures and the table of this λ."""
    rows = report.part(f"rules together, {quick}", partial(entries, report, quick))
    z = np.array([row["z"] for row in rows])
    outside = (np.abs(z) > 3) & (np.array([row["relative"] for row in rows]) > 0.15)
    note = f"of {z.size}; {0.0027 * z.size:.0f} beyond 3 errors expected by chance; rms z {np.sqrt(np.mean(z**2)):.2f}"
    report.add("rules together: outside 3 errors and 15 %", int(outside.sum()), "", 0, at_least=False, note=note)
    summary = [
        {
            "parameter": name,
            "entries": len(of),
            "rms z": float(np.sqrt(np.mean([row["z"] ** 2 for row in of]))),
            "∂ log N / ∂ log": next(row["derivative"] / row["mean"] for row in of if row["statistic"] == "cell_count"),
            "error": next(row["error"] / row["mean"] for row in of if row["statistic"] == "cell_count"),
        }
        for name in dict.fromkeys(row["parameter"] for row in rows)
        if (of := [row for row in rows if row["parameter"] == name])
    ]
    report.table("biased budding, clocks and death together: regression against differences", summary)


def entries(report: Report, quick: bool) -> list[dict[str, Any]]:
    """A row for each statistic, time and parameter."""
    report.stage("biased budding, clocks and death together")
    members, runs = (16, 64) if quick else (64, 512)
    times = np.array([2.5, 3.5] if quick else [3.5, 4.5, 5.5])
    numerics = Numerics(domain=12.0 if quick else 20.0, spacing=0.2, dt=0.005, capacity=64 if quick else 256)
    parameters, observe = Parameters(**LAMBDA, **BROUGHT), SmoothStatistics(numerics.domain, 0.1)
    found = sensitivity(
        parameters, times=times, model=RULES, method="regression", runs=runs, numerics=numerics, observe=observe
    )
    relaxation = hard_but_smoothly_measured()
    colonies = colonies_at(parameters, None, STATISTICS, times, numerics, relaxation, observe, RULES)
    names, seeds = colonies.parameters.names, member_seeds(7, members)
    centre = np.log([float(parameters[name]) for name in names])
    rows: list[dict[str, Any]] = []
    for k, name in enumerate(names):
        away = SPREAD * np.eye(len(names))[k]
        up, down = (colonies(np.tile(np.exp(centre + sign * away), (members, 1)), seeds) for sign in (1, -1))
        slopes = (up - down) / (2 * SPREAD)
        mean, error = slopes.mean(axis=0), slopes.std(axis=0, ddof=1) / np.sqrt(members)
        for row, one in enumerate(colonies.observables):
            at, column = found.observables.index(one), found.free.index(name)
            derivative, own = float(found.jacobian[at, column]), float(found.error[at, column])
            off, both = derivative - float(mean[row]), float(np.hypot(own, error[row]))
            rows.append(
                {
                    **{"statistic": one.statistic, "time": one.time, "parameter": name, "mean": float(found.mean[at])},
                    **{"derivative": derivative, "error": own, "differences": float(mean[row])},
                    "z": off / both if off else 0.0,
                    "relative": abs(off / float(mean[row])) if mean[row] else np.inf if off else 0.0,
                }
            )
    return rows


def run(report: Report, quick: bool) -> None:
    """The audit alone, and its page."""
    audit_of_rules(report, quick)
    if report.docs is not None:
        page = "\n\n".join([report.head(__doc__), *report.sections()])
        (report.docs / "gradients-of-rules.md").write_text(page)


if __name__ == "__main__":
    command("gradients_of_rules", run)
