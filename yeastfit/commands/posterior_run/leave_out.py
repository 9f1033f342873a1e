"""What `yeastfit infer --leave-out K` adds to a run: every colony predicted from the others."""

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.comparison.cross_validation import cross_validate
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.targets import Targets
from yeastfit.progress import Progress


def single_colonies(targets: Targets, groups: int, nouns: tuple[str, str]) -> Float[np.ndarray, "colony statistic"]:
    """Statistics of the single colonies.

    Raises:
        InputError: Fewer are known than groups are to be left out.
    """
    curves = np.zeros((0, len(targets.measured))) if targets.curves is None else targets.curves
    check_groups(groups, len(curves), nouns)
    return curves[:, targets.measured]


def check_groups(groups: int, known: int, nouns: tuple[str, str]) -> None:
    """Raise `InputError` where more groups are to be left out than there are single colonies."""
    if known < groups:
        raise InputError(
            f"--leave-out is {groups}, the data have {known} single {nouns[1]}: give at most as many, or 0"
        )


def predicted_from_others(
    posterior: Posterior,
    problem: Problem,
    colonies: Float[np.ndarray, "colony statistic"],
    store: Store,
    *,
    targets: Targets,
    groups: int,
    sampler: Sampler,
    seed: int,
    progress: Progress,
) -> LeftOut:
    """Colonies left out in groups and predicted, from the simulations of a run.

    Arguments:
        posterior: Of all colonies.
        problem: What was sampled.
        colonies: Statistics of the single ones.
        store: The run's simulations.
        targets: Names of statistics and colonies.
        groups: Into which they are dealt.
        sampler: Of the run.
        seed: Of the run.
        progress: Told how far it is.
    """
    values, _, statistics = store.all()
    return cross_validate(
        posterior,
        problem,
        colonies,
        (values, statistics),
        groups=groups,
        names=targets.colonies,
        labels=targets.points,
        settings=sampler,
        seed=seed,
        progress=progress,
    )
