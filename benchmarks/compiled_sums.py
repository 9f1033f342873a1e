"""Whether compiled sums change what colonies are like: many colonies with them and with plain ones.

Compiled contact, springs and nutrient (`Numerics.compiled`) are the plain sums in another order, so that one step
differs by rounding. Colonies of one seed are the same bit by bit up to 500 nodes, from where on loops are compiled, and
later as different as any two. So ensembles are compared: the colony of `benchmarks.large` in a dish of 100 L0, with
the same seeds for both, measured as photographs are with 0.3 L0 a pixel. An entry is the difference of the means,
compiled less plain, in standard errors of the mean of 32 plain colonies, ± its error from the pairs.

Target: no statistic differs by more than 0.3, beyond two errors.

    python -m benchmarks.compiled_sums [--quick] [--json FILE] [--work DIR] [--pairs N]

Finished groups of 32 pairs are kept in the folder given by --work, out/compiled_sums by default; an interrupted run
goes on from there. 1024 pairs by default, of which a group takes half a minute on two cores. --quick: 32 pairs to
t = 10.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.convergence_large import NAMES, PIXEL
from benchmarks.large import LARGE
from benchmarks.lines import append_line, read_lines
from benchmarks.report import Report, command
from yeastfit import InputError, Numerics, member_keys, simulate
from yeastfit.measure.statistics.model_as_mask import HardStatistics

SIDE, GROUP = 100.0, 32  # the dish in L0; colonies of a group, and of the ensemble whose error is the unit
MOST = 0.3


def grown(group: int, times: tuple[float, ...], compiled: bool) -> list[Any]:
    """Statistics [member, statistic, time] of one group."""
    run = simulate(
        LARGE,
        member_keys(group, GROUP),
        times=times,
        numerics=Numerics(SIDE, 0.4, 0.025, compiled=compiled),
        observe=HardStatistics(SIDE, PIXEL, tuple(NAMES)),
    )
    return np.stack([run.statistics[name] for name in NAMES], axis=1).astype(float).tolist()


def study(report: Report, work: Path, times: tuple[float, ...], groups: int) -> None:
    """Grow what is missing, and compare. Raises `InputError` if a folder holds colonies of other times."""
    file, done = work / "groups.jsonl", {}
    for record in read_lines(file):
        if record["times"] != list(times):
            raise InputError(f"--work: {work} holds colonies of other times; name another folder")
        done[record["group"]] = record
    for group in (one for one in range(groups) if one not in done):
        report.stage(f"group {group + 1} of {groups}")
        done[group] = {"group": group, "times": list(times)}
        done[group] |= {name: grown(group, times, name == "compiled") for name in ("compiled", "plain")}
        append_line(file, done[group])
    pairs = GROUP * groups
    ours, plain = (np.concatenate([done[group][name] for group in range(groups)]) for name in ("compiled", "plain"))
    unit = plain.std(axis=0, ddof=1) / GROUP**0.5
    gap = (ours - plain).mean(axis=0) / unit
    error = (ours - plain).std(axis=0, ddof=1) / pairs**0.5 / unit
    rows = [
        {"t": f"{at:g}", "cells": f"{plain[:, 0, k].mean():.0f}"}
        | {symbol: f"{gap[j, k]:+.2f} ± {error[j, k]:.2f}" for j, symbol in enumerate(NAMES.values())}
        for k, at in enumerate(times)
    ]
    report.table(f"{pairs} pairs: compiled less plain, in standard errors of {GROUP} colonies", rows)
    beyond = int((np.abs(gap) - 2 * error > MOST).sum())
    report.add(f"statistics that differ by more than {MOST}, beyond two errors", beyond, "", 0, at_least=False)
    report.add(
        "largest difference", np.abs(gap).max(), "", note=f"with errors of {error.min():.2g} to {error.max():.2g}"
    )


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/compiled_sums"))
    parser.add_argument("--pairs", type=int, default=1024)
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        times, groups = ((8.0, 10.0), 1) if quick else ((8.0, 10.0, 12.0, 16.0), -(-own.pairs // GROUP))
        study(report, own.work / ("quick" if quick else "full"), times, groups)

    command("compiled_sums", run, others)


if __name__ == "__main__":
    main()
