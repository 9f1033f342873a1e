"""Posteriors for ArviZ: one NetCDF file with everything its plots and checks ask for.

Groups, after ArviZ's schema:

    posterior             one variable [chain, draw] per parameter
    sample_stats          lp, the log probability; acceptance_rate, of the draw's chain; simulated
                          [chain, draw, statistic], the draw's own simulation (ABC) or prediction (emulator)
    log_prior             log density of each λ, one variable [chain, draw] per parameter
    log_likelihood        data [chain, draw], of all statistics together up to a constant, where the method has a
                          likelihood: that of the emulator
    prior                 draws of the prior [1, draw]; the first are those of prior_predictive
    prior_predictive      statistics [1, draw, statistic] of data sets simulated at draws of the prior
    posterior_predictive  the same at draws of the posterior
    observed_data         statistics observed
    prior_sbc             where a true λ of each simulated data set lies in its own posterior [1, data set]: PIT values
                          in 0..1, uniform where posteriors are right; `joint` is that of all parameters together (TARP)
    posterior_sbc         the same where true λ were drawn from the posterior

ArviZ reads no weights. Of weighted draws (ABC-SMC), `posterior`, `sample_stats` and `log_prior` hold as many draws
resampled by weight (systematic resampling, in random order), which plots and summaries take as they are. A group
`weighted_draws` holds the original ones: parameters, lp, simulated and `weight`.

ArviZ before 1.0 has `InferenceData`, from 1.0 on xarray's `DataTree`; the files are the same. It is imported when it is
needed: `pip install yeastfit[arviz]`.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from yeastfit.errors import InputError
from yeastfit.inference.posterior.calibration_ranks import Calibration
from yeastfit.inference.posterior.draws import Draws
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.kinds import check_kind
from yeastfit.seeds import Stream, stream_of
from yeastfit.storage import check_room, written_whole

STATISTICS, SIMULATED, WEIGHTED = "statistics", "simulated", "weighted_draws"
PRIOR_DRAWS = 1000  # in the group `prior`
DIMS = {STATISTICS: ["statistic"], SIMULATED: ["statistic"]}
Groups = dict[str, dict[str, np.ndarray]]


@dataclass(frozen=True)
class Beside:
    """What goes into the file beside the draws, where it is there.

    Attributes:
        predictive: Data predicted at draws of the posterior.
        prior_predictive: Data predicted at draws of the prior.
        calibration: Ranks of simulation-based calibration.
    """

    predictive: Predictive | None = None
    prior_predictive: Predictive | None = None
    calibration: Calibration | None = None

    def check(self, draws: Draws) -> None:
        """Raise `InputError` where something is of other statistics or parameters than the draws."""
        for name, one in (("predictive", self.predictive), ("prior_predictive", self.prior_predictive)):
            if one is not None:
                check_kind(name, one, Predictive, "what Posterior.predict or predict_prior returns")
            if one is not None and one.labels != draws.labels:
                raise InputError(
                    f"{name} is of {', '.join(one.labels)}, expected the statistics of the posterior, "
                    f"{', '.join(draws.labels)}"
                )
        if self.calibration is not None:
            check_kind("calibration", self.calibration, Calibration, "the result of yeastfit.calibrate(…)")
        if self.calibration is not None and self.calibration.free != draws.free:
            raise InputError(
                f"calibration is of {', '.join(self.calibration.free)}, expected the parameters of the posterior, "
                f"{', '.join(draws.free)}"
            )


def inference_data(draws: Draws, beside: Beside, about: Mapping[str, Any], seed: int) -> Any:
    """`InferenceData` or `DataTree`, whichever the installed ArviZ has.

    Arguments:
        draws: Of the posterior.
        beside: Predicted data and calibration; their groups are there where they are.
        about: Attributes of the posterior.
        seed: For resampling weighted draws, and for draws of the prior.

    Raises:
        InputError: ArviZ is missing, or something is of other statistics or parameters.
    """
    return _assembled(groups_of(draws, beside, seed), draws.labels, about)


def write_netcdf(path: str | Path, draws: Draws, beside: Beside, about: Mapping[str, Any], seed: int) -> None:
    """`inference_data` as a NetCDF file, written whole or not at all."""
    groups = groups_of(draws, beside, seed)
    data = _assembled(groups, draws.labels, about)
    size = sum(values.nbytes for group in groups.values() for values in group.values())
    with written_whole(path) as temporary:
        check_room(temporary, 2 * size)
        data.to_netcdf(str(temporary), engine="h5netcdf")


def groups_of(draws: Draws, beside: Beside | None = None, seed: int = 0) -> Groups:
    """Arrays by group and variable.

    Raises:
        InputError: Something is of other statistics or parameters than the draws.
    """
    beside = beside or Beside()
    beside.check(draws)
    groups = _of_draws(draws, seed) | {"prior": _prior_draws(draws, beside.prior_predictive, seed)}
    if beside.prior_predictive is not None:
        groups["prior_predictive"] = {STATISTICS: beside.prior_predictive.statistics[None]}
    if beside.predictive is not None:
        groups["posterior_predictive"] = {STATISTICS: beside.predictive.statistics[None]}
        groups["observed_data"] = {STATISTICS: beside.predictive.observed}
    if beside.calibration is not None:
        which = "posterior_sbc" if beside.calibration.near else "prior_sbc"
        groups[which] = {name: one[None] for name, one in beside.calibration.shares().items()}
    return groups


def _of_draws(draws: Draws, seed: int) -> Groups:
    """Groups with a row for each draw."""
    shape = draws.weights.shape
    parameters = {name: draws.values[:, :, k] for k, name in enumerate(draws.free)}
    log_prior = draws.prior.log_densities(draws.flat).reshape(*shape, -1)
    stats = {"lp": draws.log_probability}
    if np.isfinite(draws.statistics).any():
        stats[SIMULATED] = draws.statistics
    groups = {
        "posterior": parameters,
        "sample_stats": stats,
        "log_prior": {name: log_prior[:, :, k] for k, name in enumerate(draws.free)},
    }
    if draws.log_likelihood is not None:
        groups["log_likelihood"] = {"data": draws.log_likelihood}
    if draws.weighted:
        chosen = resampled(draws.weights.ravel(), np.random.default_rng(stream_of(seed, Stream.RESAMPLING, 0)))
        groups = {name: _chosen(group, chosen) for name, group in groups.items()}
        groups[WEIGHTED] = {**parameters, **stats, "weight": draws.weights}
    elif len(draws.acceptance) == len(draws.weights):
        stats["acceptance_rate"] = np.repeat(draws.acceptance[:, None], shape[1], axis=1)
    return groups


def _prior_draws(draws: Draws, predicted: Predictive | None, seed: int) -> dict[str, np.ndarray]:
    """Draws of the prior, first those whose data were predicted: λ that come to nothing are fewer than in the prior."""
    first = np.zeros((0, len(draws.free))) if predicted is None else predicted.values
    rng = np.random.default_rng(stream_of(seed, Stream.RESAMPLING, 1))
    values = np.concatenate([first, draws.prior.sample(max(0, PRIOR_DRAWS - len(first)), rng)])
    return {name: values[None, :, k] for k, name in enumerate(draws.free)}


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
        unknown = ("log_prior", "prior_sbc", "posterior_sbc", WEIGHTED)  # to `from_dict` of these versions
        known = {name: group for name, group in groups.items() if name not in unknown}
        data = arviz.from_dict(**known, dims=DIMS, coords=coords, posterior_attrs=about)
        for name in unknown:
            if name in groups:
                data.add_groups({name: arviz.dict_to_dataset(groups[name], dims=DIMS, coords=coords)})
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
