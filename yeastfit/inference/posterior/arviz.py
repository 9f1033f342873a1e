"""Posteriors for ArviZ: one NetCDF file with all that its plots and checks ask for.

Groups, after ArviZ's schema: `posterior`, a variable [chain, draw] for each parameter; `posterior_predictive`, the
statistics [1, draw, statistic] of data sets simulated anew at some of the draws; `observed_data`, those observed;
`sample_stats`, lp, the log probability, acceptance_rate, of the draw's chain, weight where draws differ in weight, and
simulated [chain, draw, statistic], what each draw has of its own: in ABC the simulation that was accepted, near to the
data because it was accepted; with the emulator what that draws.

ArviZ before 1.0 holds them as `InferenceData`, from 1.0 on as xarray's `DataTree`; files are the same. It is imported
when it is needed: `pip install yeastfit[arviz]`.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.posterior.samples import Samples
from yeastfit.storage import as_json, check_room, written_whole

STATISTICS, SIMULATED = "statistics", "simulated"
Groups = dict[str, dict[str, np.ndarray]]


def to_arviz(samples: Samples, found: Predictive | None = None) -> Any:
    """`InferenceData` or `DataTree`, whichever the ArviZ that is installed has.

    found: of `predict`, what was observed and what was predicted; without it there are no groups of these. Raises
    `InputError` where ArviZ is missing, or `found` is of other statistics.
    """
    return _arviz_of(groups_of(samples, found), samples)


def _arviz_of(groups: Groups, samples: Samples) -> Any:
    arviz = _arviz()
    about = {
        "inference_library": "yeastfit",
        "method": samples.method,
        "seed": samples.seed,
        "simulations": samples.simulations,
        "settings": as_json(samples.settings),
        "warnings": as_json(samples.warnings),
    }
    dims = {STATISTICS: ["statistic"], SIMULATED: ["statistic"]}
    named = {"dims": dims, "coords": {"statistic": list(samples.labels)}}
    with warnings.catch_warnings():  # one chain of weighted draws is as meant
        warnings.filterwarnings("ignore", "More chains", UserWarning)
        warnings.filterwarnings("ignore", "Found chain dimension to be longer", UserWarning)
        if int(arviz.__version__.split(".")[0]) < 1:
            return arviz.from_dict(**groups, **named, posterior_attrs=about)
        return arviz.from_dict(groups, **named, attrs={"posterior": about})


def to_netcdf(samples: Samples, path: str | Path, found: Predictive | None = None) -> None:
    """`to_arviz` as a NetCDF file, written whole or not at all; `arviz.from_netcdf` reads it."""
    groups = groups_of(samples, found)
    data = _arviz_of(groups, samples)
    size = sum(values.nbytes for group in groups.values() for values in group.values())
    with written_whole(path) as temporary:
        check_room(temporary, 2 * size)
        data.to_netcdf(str(temporary), engine="h5netcdf")


def groups_of(samples: Samples, found: Predictive | None = None) -> Groups:
    """Arrays by group and variable. Raises `InputError` where `found` is of other statistics."""
    chains, draws = samples.weights.shape
    stats = {"lp": samples.log_probability}
    if len(samples.acceptance) == chains:
        stats["acceptance_rate"] = np.repeat(samples.acceptance[:, None], draws, axis=1)
    if samples.weighted:
        stats["weight"] = samples.weights
    if np.isfinite(samples.statistics).any():
        stats[SIMULATED] = samples.statistics
    groups = {"posterior": {name: samples.values[:, :, k] for k, name in enumerate(samples.free)}}
    groups["sample_stats"] = stats
    if found is not None:
        if found.labels != samples.labels:
            raise InputError(
                f"found is of {', '.join(found.labels)}, expected the statistics of the samples, "
                f"{', '.join(samples.labels)}"
            )
        groups["posterior_predictive"] = {STATISTICS: found.statistics[None]}
        groups["observed_data"] = {STATISTICS: found.observed}
    return groups


def _arviz() -> Any:
    """ArviZ, without its announcement of 1.0, whose interface is served here too."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=FutureWarning)
            import arviz
    except ImportError as error:
        raise InputError(f"ArviZ is not installed ({error}): pip install yeastfit[arviz]") from error
    return arviz
