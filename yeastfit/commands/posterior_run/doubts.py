"""What the data of `yeastfit infer` do not fulfil, in words."""

import numpy as np

from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.targets import Targets


def doubts_of(targets: Targets, problem: Problem, nouns: tuple[str, str]) -> list[str]:
    """One sentence for each thing that is taken for granted but is not so.

    Arguments:
        targets: The curves that are compared.
        problem: What is sampled.
        nouns: What one replicate is called, and several.
    """
    return _of_means(targets, nouns) if problem.variation is None else _of_colonies(problem, nouns[1])


def _of_means(targets: Targets, nouns: tuple[str, str]) -> list[str]:
    doubts, several = list[str](), nouns[1]
    counts = targets.replicates[targets.measured]
    if np.ptp(counts):
        doubts.append(
            f"the curves' points are means of {counts.min()} to {counts.max()} {several}, all are treated as means "
            f"of {counts.min()}"
        )
    if targets.curves is not None:
        seen = np.isfinite(targets.curves[:, targets.measured]).astype(int)
        shared = seen.T @ seen
        if (shared < np.minimum.outer(counts, counts)).any():
            doubts.append(
                f"not every {nouns[0]} is in all points of the curves, some two of them share "
                f"{shared.min()}: all are treated as the same {several}, seen at every time, so that intervals "
                "may be too narrow or too wide"
            )
    return doubts


def _of_colonies(problem: Problem, several: str) -> list[str]:
    rows, doubts = problem.colonies, list[str]()
    if rows is None:
        return doubts
    if len(rows) == 1:
        doubts.append("variation: one colony tells nothing of it, its posterior is its prior")
    for label, there in zip(problem.labels, np.isfinite(rows).sum(axis=0).tolist(), strict=True):
        if there < len(rows):
            doubts.append(f"{label} is missing in {len(rows) - there} of {len(rows)} {several}, whose rest counts")
    return doubts
