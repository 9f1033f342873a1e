"""One λ of the audit of derivatives in which rules beyond the source's are at work together.

Buds biased along the nutrient's gradient, births by clocks, death by starvation: all parameters, those of the rules
among them, by the regression of `yeastfit.sensitivity` and by central differences of the same hard colonies. The
differences move one parameter at a time by ±10 %, with common keys. There are no pathwise derivatives: births jump. The
entries of a parameter are of the same colonies, and err together: where one is outside 3 errors and 15 %, all of them
are estimated again by four times as many other colonies, and what is outside then counts. `benchmarks.gradients` has
this λ, too; alone it takes minutes instead of an hour.

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
    report.stage("biased budding, clocks and death together")
    rows = report.part(f"rules together, {quick}", partial(entries, quick))
    z = np.array([row["z"] for row in rows])
    suspects = tuple(dict.fromkeys(row["parameter"] for row in rows if _outside(row)))
    again = report.part(f"rules again, {quick}, {suspects}", partial(entries, quick, suspects)) if suspects else []
    first = f"{sum(map(_outside, rows))} at first, of {', '.join(suspects) or 'no parameter'}"
    note = f"of {z.size}, rms z {np.sqrt(np.mean(z**2)):.2f}; {first}"
    found = sum(map(_outside, again))
    report.add("rules together: outside 3 errors and 15 %", found, "", 0, at_least=False, note=note)
    report.table("biased budding, clocks and death together: regression against differences", _summary(rows))
    if again:
        report.table("again, by four times as many other colonies", _summary(again))


def _outside(row: dict[str, Any]) -> bool:
    """Whether an entry differs by more than 3 errors and 15 %."""
    return bool(abs(row["z"]) > 3 and row["relative"] > 0.15)


def _summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each parameter."""
    return [
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


def entries(quick: bool, again: tuple[str, ...] = ()) -> list[dict[str, Any]]:
    """A row for each statistic, time and parameter; or for these parameters, by four times as many other colonies."""
    members, runs = (16, 64) if quick else (64, 512)
    members, runs, seed = (4 * members, 4 * runs, 1) if again else (members, runs, 0)
    times = np.array([2.5, 3.5] if quick else [3.5, 4.5, 5.5])
    numerics = Numerics(domain=12.0 if quick else 20.0, spacing=0.2, dt=0.005, capacity=64 if quick else 256)
    parameters, observe = Parameters(**LAMBDA, **BROUGHT), SmoothStatistics(numerics.domain, 0.1)
    found = sensitivity(
        parameters,
        times=times,
        free=again or None,
        method="regression",
        runs=runs,
        seed=seed,
        model=RULES,
        numerics=numerics,
        observe=observe,
    )
    relaxation = hard_but_smoothly_measured()
    colonies = colonies_at(parameters, again or None, STATISTICS, times, numerics, relaxation, observe, RULES)
    names, seeds = colonies.parameters.names, member_seeds(7 + seed, members)
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
