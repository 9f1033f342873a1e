"""Posteriors for ArviZ: one NetCDF file with all that its plots and checks ask for.

Groups, after ArviZ's schema: `posterior`, a variable [chain, draw] for each parameter; `posterior_predictive`, a
variable [chain, draw, statistic] with the statistics of each draw; `observed_data`, those observed; `sample_stats`, lp,
the log probability, acceptance_rate, of the draw's chain, and weight where draws differ in weight.

ArviZ before 1.0 holds them as `InferenceData`, from 1.0 on as xarray's `DataTree`; files are the same. It is imported
when it is needed: `pip install yeastfit[arviz]`.
"""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.infer.samples import Samples
from yeastfit.storage import written_whole

STATISTICS = "statistics"
Groups = dict[str, dict[str, np.ndarray]]


def to_arviz(samples: Samples, observed: Float[np.ndarray, " statistic"] | None = None) -> Any:
    """`InferenceData` or `DataTree`, whichever the ArviZ that is installed has.

    observed: statistics of the data, in the order of the samples' labels; without them there is no group of them.
    Raises `InputError` where ArviZ is missing, or `observed` does not fit.
    """
    groups, arviz = groups_of(samples, observed), _arviz()
    about = {
        "inference_library": "yeastfit",
        "method": samples.method,
        "seed": samples.seed,
        "simulations": samples.simulations,
        "settings": json.dumps(samples.settings, default=np.ndarray.tolist),
        "warnings": json.dumps(samples.warnings),
    }
    named = {"dims": {STATISTICS: ["statistic"]}, "coords": {"statistic": list(samples.labels)}}
    with warnings.catch_warnings():  # one chain of weighted draws is as meant
        warnings.filterwarnings("ignore", "More chains", UserWarning)
        warnings.filterwarnings("ignore", "Found chain dimension to be longer", UserWarning)
        if int(arviz.__version__.split(".")[0]) < 1:
            return arviz.from_dict(**groups, **named, posterior_attrs=about)
        return arviz.from_dict(groups, **named, attrs={"posterior": about})


def to_netcdf(samples: Samples, path: str | Path, observed: Float[np.ndarray, " statistic"] | None = None) -> None:
    """`to_arviz` as a NetCDF file, written whole or not at all; `arviz.from_netcdf` reads it."""
    data = to_arviz(samples, observed)
    with written_whole(path) as temporary:
        data.to_netcdf(str(temporary), engine="h5netcdf")


def groups_of(samples: Samples, observed: Float[np.ndarray, " statistic"] | None = None) -> Groups:
    """Arrays by group and variable. Raises `InputError` where `observed` does not fit."""
    chains, draws = samples.weights.shape
    stats = {"lp": samples.log_probability}
    if len(samples.acceptance) == chains:
        stats["acceptance_rate"] = np.repeat(samples.acceptance[:, None], draws, axis=1)
    if samples.weighted:
        stats["weight"] = samples.weights
    groups = {"posterior": {name: samples.values[:, :, k] for k, name in enumerate(samples.free)}}
    if np.isfinite(samples.statistics).any():
        groups["posterior_predictive"] = {STATISTICS: samples.statistics}
    groups["sample_stats"] = stats
    if observed is not None:
        if observed.shape != (len(samples.labels),):
            raise InputError(
                f"observed has shape {observed.shape}, expected one number for each of {', '.join(samples.labels)}"
            )
        groups["observed_data"] = {STATISTICS: observed}
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
