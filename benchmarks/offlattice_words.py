"""What the page of off-lattice posteriors says in words, all of it computed."""

from collections.abc import Mapping

import numpy as np

from benchmarks.li2024_published import PUBLISHED_POSTERIORS
from benchmarks.offlattice_runs import METHODS, Run
from yeastfit.errors import InputError
from yeastfit.inference.posterior.result import Posterior
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.offlattice.statistics.smoothed_branch_index import SMOOTHED

MANY = 50  # per cent of colonies that a frame cuts off
SYMBOLS = [one.symbol for one in PARAMETERS.values()]
SHORT = dict(zip(PUBLISHED, ("I_F", "I_R", "I_B"), strict=True)) | {SMOOTHED.name: "I_B, smoothed outlines"}


def missing(runs: list[Run]) -> str:
    """What is not there, in words."""
    left = [f"{run.colonies.name}: {METHODS[run.method]}{_so_far(run)}" for run in runs if not run.finished]
    if not left:
        return "All posteriors are finished."
    return "**Not finished**, and left out below but for chains of which the steps so far are shown:\n\n" + "\n".join(
        f"- {one}" for one in left
    )


def in_words(runs: list[Run], beyond: Mapping[tuple[str, str], float]) -> list[str]:
    """What the posteriors of one set say of the published one, of the model, and of colonies that a frame cuts off."""
    theirs, name = PUBLISHED_POSTERIORS[runs[0].key], runs[0].colonies.name
    moved = (np.array(theirs.last) - theirs.early) / np.array(theirs.last_error)
    far = [f"{SYMBOLS[k]} by {moved[k]:+.1f}" for k in np.flatnonzero(np.abs(moved) > 2)]
    said = ", ".join(far) + ": they were still on their way" if far else "nothing by more than 2"
    lines = [
        f"- **{name}.** From the mean of their first 100 states to their last states the published chains drift, in "
        f"standard errors of the latter: {said}."
    ]
    for run in (one for one in runs if one.there):
        found = run.posterior()
        if run.method == "protocol":
            off = np.abs(found.mean - theirs.mean) / np.array(theirs.error)
            near = ", ".join(f"{symbol} {one:.1f}" for symbol, one in zip(SYMBOLS, off, strict=True))
            lines.append(f"  - {run.name}: distance of its means from the published ones, in their errors: {near}.")
        elif run.method == "smc":
            off = (np.array(theirs.mean) - found.mean) / theirs.error
            near = ", ".join(f"{symbol} {one:+.1f}" for symbol, one in zip(SYMBOLS, off, strict=True))
            lines.append(f"  - Published less ABC-SMC's means, in published errors: {near}: what short chains did.")
        else:
            lines += [f"  - {run.name}: {said}" for said in unreached(run, found)]
        if beyond[run.key, run.method] > MANY and run.method != "emulator":
            share = f"{beyond[run.key, run.method]:.0f} % of its colonies reach beyond the frame"
            lines.append(f"  - {run.name}: {share}: what it finds is what the frame makes of them, not of the yeast.")
    return lines


def unreached(run: Run, found: Posterior) -> list[str]:
    """Statistics that no simulation from the prior reaches, and those that predictions miss by more than three sd."""
    observed, replicates = run.observed
    drawn = found.statistics.reshape(-1, len(observed))
    mean, sd = drawn.mean(axis=0), drawn.std(axis=0)
    missed = [
        f"{title(name)} is {observed[k]:.3g} and predicted {mean[k]:.3g} ± {sd[k]:.2g}"
        for k, name in enumerate(run.statistics)
        if abs(observed[k] - mean[k]) > 3 * sd[k]
    ]
    said = [] if found.settled else [f"{found.status}."]
    if beyond := [one for one in found.warnings if "the prior's simulations have" in one]:
        said.append(f"beyond the reach of single colonies from the prior: {'; '.join(beyond)}.")
    if missed:
        return [*said, f"means of {replicates} colonies are missed by more than three sd: {'; '.join(missed)}."]
    return [*said, f"means of {replicates} colonies lie within three sd of what is predicted."]


def title(name: str) -> str:
    """Of a statistic."""
    return SHORT.get(name, name.replace("_", " "))


def _so_far(run: Run) -> str:
    if not run.file("h5").is_file():
        return ""
    try:
        count = len(run.simulations()[0])
    except InputError:  # another process has the file
        return ", which is being computed"
    return f" ({count} simulations so far, after {run.seconds()['processor']:.0f} s of the processors)"
