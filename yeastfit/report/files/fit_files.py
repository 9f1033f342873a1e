"""The files of a fit: tables, JSON and figures."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from yeastfit import plot
from yeastfit.inference.fit.bootstrap_profile import Bootstrap, Profile
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.targets import Targets
from yeastfit.storage import write_table

OBSERVED = "colonies.csv"


def write_targets(folder: Path, targets: Mapping[str, Targets]) -> None:
    """Write targets.csv, the curves to be fitted, and colonies.csv, what single colonies have, where that is known.

    Arguments:
        folder: Where to.
        targets: The curves by condition.
    """
    write_table(
        folder / "targets.csv",
        [
            {
                "condition": name,
                "statistic": each.names[row],
                "time": float(each.times[column]),
                "hours": float(each.clock[column]),
                "replicates": int(each.replicates[row, column]),
                "mean": float(each.mean[row, column]),
                "scatter": float(each.scatter[row, column]),
                "estimator": "" if each.imaging is None else each.imaging.estimator,
            }
            for name, each in targets.items()
            for row, column in np.argwhere(each.measured)
        ],
    )
    single = [
        {
            "condition": name,
            "colony": colony,
            "statistic": each.names[row],
            "time": float(each.times[column]),
            "hours": float(each.clock[column]),
            "value": float(curve[row, column]),
        }
        for name, each in targets.items()
        for colony, curve in zip(each.colonies, [] if each.curves is None else each.curves, strict=True)
        for row, column in np.argwhere(np.isfinite(curve))
    ]
    if single:
        write_table(folder / OBSERVED, single)


def write_fit(folder: Path, result: Fit, truth: Mapping[str, float] | None = None) -> None:
    """Write fit.json, parameters.csv and the figures of a fit.

    Arguments:
        folder: Where to.
        result: The fit.
        truth: True parameters by name, where they are known.
    """
    result.save(folder / "fit.json")
    write_table(folder / "parameters.csv", result.rows())
    by_entry = {entry.name: truth[entry.parameter] for entry in result.space.entries} if truth else None
    plot.save(plot.fit(result, by_entry), folder / "fit.png")
    plot.save(plot.convergence(result), folder / "convergence.png")
    plot.save(plot.spectrum(result.information), folder / "spectrum.png")
    plot.save(plot.ellipses(result.information), folder / "ellipses.png")


def write_bootstrap(folder: Path, result: Bootstrap, fitted: Fit) -> None:
    """Write bootstrap.csv, with a row for each draw, and its figure.

    Arguments:
        folder: Where to.
        result: The bootstrap.
        fitted: The fit whose replicates were resampled.
    """
    write_table(folder / "bootstrap.csv", [dict(zip(result.free, row, strict=True)) for row in result.values.tolist()])
    plot.save(plot.bootstrap(result, fitted), folder / "bootstrap.png")


def write_profiles(folder: Path, results: Mapping[str, Profile]) -> None:
    """Write profiles.csv, with a row for each value of each parameter, and the figure.

    Arguments:
        folder: Where to.
        results: Profiles by parameter.
    """
    rows = [
        {"parameter": name, "value": value, "chi_square_rise": rise}
        for name, each in results.items()
        for value, rise in zip(each.values.tolist(), each.rise.tolist(), strict=True)
    ]
    write_table(folder / "profiles.csv", rows)
    plot.save(plot.profiles(results), folder / "profiles.png")
