"""Posteriors for ArviZ: one NetCDF file with everything its plots and checks ask for.

Groups, after ArviZ's schema:

    posterior             one variable [chain, draw] per parameter
    sample_stats          lp, the log probability; acceptance_rate, of the draw's chain; simulated
                          [chain, draw, statistic], the draw's own simulation (ABC) or prediction (emulator)
    posterior_predictive  statistics [1, draw, statistic] of data sets simulated at draws of the posterior
    observed_data         statistics observed

ArviZ reads no weights. Of weighted draws (ABC-SMC), `posterior` and `sample_stats` hold as many draws resampled by
weight (systematic resampling, in random order), which plots and summaries take as they are. A group `weighted_draws`
holds the original ones: parameters, lp, simulated and `weight`.

ArviZ before 1.0 has `InferenceData`, from 1.0 on xarray's `DataTree`; the files are the same. It is imported when it is
needed: `pip install yeastfit[arviz]`.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from yeastfit.errors import InputError
from yeastfit.inference.posterior.draws import Draws
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.simulator import Stream, stream_of
from yeastfit.storage import check_room, written_whole

STATISTICS, SIMULATED, WEIGHTED = "statistics", "simulated", "weighted_draws"
DIMS = {STATISTICS: ["statistic"], SIMULATED: ["statistic"]}
Groups = dict[str, dict[str, np.ndarray]]


def inference_data(draws: Draws, predictive: Predictive | None, about: Mapping[str, Any], seed: int) -> Any:
    """`InferenceData` or `DataTree`, whichever the installed ArviZ has.

    Arguments:
        draws: Of the posterior.
        predictive: Predicted data; without it there are no groups of predicted and observed data.
        about: Attributes of the posterior.
        seed: For resampling weighted draws.

    Raises:
        InputError: ArviZ is missing, or `predictive` is of other statistics.
    """
    return _assembled(groups_of(draws, predictive, seed), draws.labels, about)


def write_netcdf(
    path: str | Path, draws: Draws, predictive: Predictive | None, about: Mapping[str, Any], seed: int
) -> None:
    """`inference_data` as a NetCDF file, written whole or not at all."""
    groups = groups_of(draws, predictive, seed)
    data = _assembled(groups, draws.labels, about)
    size = sum(values.nbytes for group in groups.values() for values in group.values())
    with written_whole(path) as temporary:
        check_room(temporary, 2 * size)
        data.to_netcdf(str(temporary), engine="h5netcdf")


def groups_of(draws: Draws, predictive: Predictive | None = None, seed: int = 0) -> Groups:
    """Arrays by group and variable.

    Raises:
        InputError: `predictive` is of other statistics.
    """
    parameters = {name: draws.values[:, :, k] for k, name in enumerate(draws.free)}
    stats = {"lp": draws.log_probability}
    if np.isfinite(draws.statistics).any():
        stats[SIMULATED] = draws.statistics
    groups = {"posterior": parameters, "sample_stats": stats}
    if draws.weighted:
        chosen = resampled(draws.weights.ravel(), np.random.default_rng(stream_of(seed, Stream.RESAMPLING, 0)))
        groups = {name: _chosen(group, chosen) for name, group in groups.items()}
        groups[WEIGHTED] = {**parameters, **stats, "weight": draws.weights}
    elif len(draws.acceptance) == len(draws.weights):
        stats["acceptance_rate"] = np.repeat(draws.acceptance[:, None], draws.weights.shape[1], axis=1)
    if predictive is not None:
        if predictive.labels != draws.labels:
            raise InputError(
                f"predictive is of {', '.join(predictive.labels)}, expected the statistics of the posterior, "
                f"{', '.join(draws.labels)}"
            )
        groups["posterior_predictive"] = {STATISTICS: predictive.statistics[None]}
        groups["observed_data"] = {STATISTICS: predictive.observed}
    return groups


def resampled(weights: np.ndarray, rng: np.random.Generator) -> Int[np.ndarray, " draw"]:
    """Numbers of as many draws as there are weights, by systematic resampling, in random order.

    Draw i is taken ⌊n w_i⌋ or ⌈n w_i⌉ times.
    """
    count = len(weights)
    places = (rng.random() + np.arange(count)) / count
    numbers = np.searchsorted(np.cumsum(weights) / weights.sum(), places, side="right")
    return rng.permutation(np.minimum(numbers, count - 1))


def _chosen(group: Mapping[str, np.ndarray], numbers: Int[np.ndarray, " draw"]) -> dict[str, np.ndarray]:
    """Draws with these numbers, as one chain."""
    return {name: one.reshape(-1, *one.shape[2:])[numbers][None] for name, one in group.items()}


def _assembled(groups: Groups, labels: tuple[str, ...], about: Mapping[str, Any]) -> Any:
    arviz = _arviz()
    coords = {"statistic": list(labels)}
    with warnings.catch_warnings():  # that there is one chain only is no mistake
        warnings.filterwarnings("ignore", "More chains", UserWarning)
        warnings.filterwarnings("ignore", "Found chain dimension to be longer", UserWarning)
        if int(arviz.__version__.split(".")[0]) >= 1:
            return arviz.from_dict(groups, dims=DIMS, coords=coords, attrs={"posterior": about})
        known = {name: group for name, group in groups.items() if name != WEIGHTED}
        data = arviz.from_dict(**known, dims=DIMS, coords=coords, posterior_attrs=about)
        if WEIGHTED in groups:
            data.add_groups({WEIGHTED: arviz.dict_to_dataset(groups[WEIGHTED], dims=DIMS, coords=coords)})
    return data


def _arviz() -> Any:
    """ArviZ, without its announcement of 1.0, whose interface is served here too."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=FutureWarning)
            import arviz
    except ImportError as error:
        raise InputError(f"ArviZ is not installed ({error}): pip install yeastfit[arviz]") from error
    return arviz
