"""Posteriors compared with the truth: `yeastfit infer` with default settings on the synthetic micrographs.

For each data set the emulator infers a posterior from the compactness and radius of ten colonies at eleven times, with
the plausible ranges as prior. Does the central 90 % interval of each λ contain its true value, and does the joint 90 %
region contain all three? That region holds the 90 % of draws nearest to the posterior mean in Mahalanobis distance, in
log λ.

Targets: all nine intervals and all three regions contain the truth.

    python -m benchmarks.truth [--quick] [--json FILE] [--docs DIR] [--work DIR]

Runs are kept in the folder given by --work, out/truth by default, and reused by the same version of the code. --quick:
one data set, few simulations of a coarse model, no targets. --docs writes DIR/truth.md.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.agreement import DATA, LEVEL, SETS, posterior, truth_of, yes
from benchmarks.report import Report, code, command
from yeastfit.commands.posterior_run.config import Request
from yeastfit.inference.models.algebraic import Algebraic

DEFAULT = Request()
QUICK = Request.of("emulator", {"simulations": 256}, forward_model=Algebraic(dt=0.05, spacing=0.4))


def judge(report: Report, sets: tuple[str, ...], work: Path, request: Request = DEFAULT) -> None:
    """Infer the posterior of each set and compare it with the truth."""
    rows, inside, together = [], 0, 0
    for name in sets:
        report.stage(name)
        one = posterior(DATA / name, work / name, request)
        truth = truth_of(name, one.posterior.free)
        each, joint = one.inside(truth)
        inside, together = inside + sum(each), together + joint
        for k, (parameter, (low, high)) in enumerate(
            zip(one.posterior.free, one.posterior.interval(LEVEL), strict=True)
        ):
            ends = f"{low:.3g} to {high:.3g}"
            row = {"set": name, "λ": parameter, "true": float(np.exp(truth[k])), "90 %": ends}
            rows.append({**row, "inside": yes(each[k])})
        note = f"truth {'inside' if joint else 'outside'} the joint region; {one.posterior.simulations} colonies"
        report.add(name, one.posterior.seconds, "s", note=note)
    each_target, joint_target = (None, None) if report.quick else (len(rows), len(sets))
    report.add("λ inside their 90 % intervals", inside, "", each_target, note=f"of {len(rows)}")
    report.add("sets inside their joint 90 % region", together, "", joint_target, note=f"of {len(sets)}")
    report.table("truth and posterior", rows)


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/truth"))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        work = own.work / f"{'quick' if quick else 'full'}-{code()}"
        judge(report, SETS[:1] if quick else SETS, work, QUICK if quick else DEFAULT)
        if report.docs is not None:
            report.docs.mkdir(parents=True, exist_ok=True)
            (report.docs / "truth.md").write_text("\n".join([report.head(__doc__), "", *report.sections()]))

    command("truth", run, others)


if __name__ == "__main__":
    main()
