"""What `yeastfit infer --leave-out K` adds to a run: every colony predicted from the others."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.comparison.cross_validation import cross_validate, dealt
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
    curves = np.zeros((0, *targets.measured.shape)) if targets.curves is None else targets.curves
    colonies = curves[:, targets.measured]
    names = targets.colonies if len(targets.colonies) == len(colonies) else tuple(map(str, range(1, len(colonies) + 1)))
    check_groups(groups, names, dict(zip(targets.points, np.isfinite(colonies).T.tolist(), strict=True)), nouns)
    return colonies


def check_groups(
    groups: int, names: Sequence[str], there: Mapping[str, Sequence[bool]], nouns: tuple[str, str]
) -> None:
    """Check that single colonies can be left out in groups, before anything is simulated.

    Arguments:
        groups: How many; 0 for none.
        names: Of the colonies.
        there: By what is observed: which of the colonies have it.
        nouns: What one colony is called, and several.

    Raises:
        InputError: There are more groups than colonies, or the others of a group lack something.
    """
    if not groups:
        return
    if len(names) == 1:
        raise InputError(f"--leave-out is {groups}, the data have a single {nouns[0]}: leave out --leave-out")
    if len(names) < groups:
        raise InputError(
            f"--leave-out is {groups}, the data have {len(names)} single {nouns[1]}: give at most as many, or 0"
        )
    group = dealt(names, groups)
    for what, has in there.items():
        if len(set(group[np.asarray(has)])) < 2:
            of = ", ".join(name for name, one in zip(names, has, strict=True) if one)
            raise InputError(
                f"--leave-out is {groups}: {what} there is only {nouns[0]} {of}, which no others predict: leave out "
                "these images, or --leave-out"
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
    values, seeds, statistics = store.all()
    order = np.lexsort((*values.T, seeds))  # not that in which they were made: damaged ones are made again at the end
    return cross_validate(
        posterior,
        problem,
        colonies,
        (values[order], statistics[order]),
        groups=groups,
        names=targets.colonies,
        labels=targets.points,
        settings=sampler,
        seed=seed,
        progress=progress,
    )
