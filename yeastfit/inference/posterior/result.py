"""A posterior: draws from it, whichever method they come from, with all it takes to judge and to repeat them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from emcee.backends import Backend
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.posterior.arviz import Beside, inference_data, write_netcdf
from yeastfit.inference.posterior.calibration_ranks import Calibration
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.draws import Draws
from yeastfit.inference.posterior.predictive_check import Predictive, predict
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.simulator import Simulator
from yeastfit.kinds import check_kind
from yeastfit.storage import as_json, from_json, reads_saved, written_whole
from yeastfit.text import quoted

ARRAYS = ("values", "weights", "log_probability", "acceptance", "statistics", "observed")
LIKELIHOOD = "log_likelihood"  # an array of the file only where the method has one
NOT_SAVED = ("backend",)


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior(Draws):
    """Result of every sampler: `Draws`, and how they were made.

    Attributes:
        simulations: Single simulations that the method asked for, those read from a store included.
        status: How the run ended.
        diagnostics: What the method reports of its own run.
        warnings: In words.
        method: Name in `SAMPLERS`.
        settings: Of the method, by name.
        seed: Of the run.
        seconds: That the run took.
        backend: emcee's, with every step of the chains, burn-in included, in the prior's coordinates; it is not saved.
    """

    simulations: int
    status: Status
    diagnostics: Diagnostics = field(default_factory=Diagnostics)
    warnings: tuple[str, ...] = ()
    method: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    seconds: float = 0.0
    backend: Backend | None = field(default=None, repr=False)

    @staticmethod
    def of(
        problem: Problem,
        values: Float[np.ndarray, "chain draw free"],
        *,
        simulations: int,
        status: Status | None = None,
        weights: Float[np.ndarray, "chain draw"] | None = None,
        log_probability: Float[np.ndarray, "chain draw"] | None = None,
        acceptance: Float[np.ndarray, " part"] | None = None,
        statistics: Float[np.ndarray, "chain draw statistic"] | None = None,
        warnings: Sequence[str] = (),
        **more: Any,
    ) -> "Posterior":
        """A sampler's result for a problem.

        Arguments:
            problem: What was sampled: prior, statistics and data.
            values: λ, one row of draws per chain.
            simulations: Single simulations that the method asked for (`CachedSimulator.asked`).
            status: How the run ended; by default what the chains say. Draws of different weights are not judged, and
                count as settled.
            weights: Of the sum 1 over all chains; by default all equal.
            log_probability: nan by default.
            acceptance: nan for each chain by default.
            statistics: nan by default.
            warnings: In words.
            **more: Further attributes, by name.

        Raises:
            InputError: An array has another shape, the status is none, or warnings are one text.
        """
        check_kind("problem", problem, Problem)
        check_kind("values", values, np.ndarray, "an array of numpy, [chain, draw, parameter]")
        if np.ndim(values) != 3 or values.shape[2] != len(problem.inferred_prior.free):
            raise InputError(
                f"values have shape {np.shape(values)}, they must be draws of {len(problem.inferred_prior.free)} "
                "parameters: (chain, draw, parameter)"
            )
        shape = values.shape[:2]
        given = {"weights": weights, "log_probability": log_probability, "statistics": statistics}
        for name, array in given.items():
            needed = (*shape, len(problem.labels)) if name == "statistics" else shape
            if array is not None and np.shape(array) != needed:
                raise InputError(f"{name}: the shape is {np.shape(array)}, values of {values.shape} need {needed}")
        low, high = problem.inferred_prior.support.T
        outside = (values < low) | (values > high)
        if outside.any():
            k = int(np.argmax(outside.any(axis=(0, 1))))
            raise InputError(
                f"values: {outside.any(axis=2).sum()} of {outside.any(axis=2).size} draws lie outside the prior, "
                f"{problem.inferred_prior.free[k]} is {values[..., k].min():.3g} to {values[..., k].max():.3g}, the "
                f"prior goes from {low[k]:.3g} to {high[k]:.3g}"
            )
        if acceptance is not None and np.ndim(acceptance) != 1:
            raise InputError(f"acceptance is {quoted(acceptance)}, it must be a row of numbers")
        if status is not None and not isinstance(status, Status):
            raise InputError(f"status is {quoted(status)}, it must be one of {', '.join(map(str, Status))}")
        if isinstance(warnings, str):
            raise InputError(f"warnings are {quoted(warnings)}, they must be a list of texts")
        posterior = Posterior(
            prior=problem.inferred_prior,
            labels=problem.labels,
            observed=problem.observed,
            replicates=problem.replicates,
            noise=problem.noise,
            varying=problem.varying,
            values=values,
            weights=np.full(shape, 1.0 / (shape[0] * shape[1])) if weights is None else weights,
            log_probability=np.full(shape, np.nan) if log_probability is None else log_probability,
            acceptance=np.full(shape[0], np.nan) if acceptance is None else acceptance,
            statistics=np.full((*shape, len(problem.labels)), np.nan) if statistics is None else statistics,
            simulations=simulations,
            status=status or Status.SETTLED,
            warnings=tuple(warnings),
            **more,
        )
        if status is None and not posterior.weighted and not (posterior.chains and posterior.chains.converged):
            return replace(posterior, status=Status.CHAINS_TOO_SHORT)
        return posterior

    @property
    def settled(self) -> bool:
        """Whether the run came to its end; `status` says why not."""
        return self.status is Status.SETTLED

    def sentences(self) -> list[str]:
        """Everything to be doubted: warnings, the chains' diagnostics, and the method's own."""
        chains = self.chains.sentences() if self.chains is not None else []
        return list(dict.fromkeys([*self.warnings, *chains, *self.diagnostics.sentences()]))

    def predict(self, simulator: Simulator, *, draws: int = 40, seed: int = 0) -> Predictive:
        """Posterior predictive check: simulate data like those observed at draws of the posterior.

        Arguments:
            simulator: Of one replicate; it may be one that stores its simulations.
            draws: How many data sets.
            seed: Same seed, same draws and simulations.

        Returns:
            The data sets beside the one observed.

        Raises:
            InputError: There are fewer than 10 draws, or the simulator has other parameters or statistics.
        """
        return predict(self, simulator, draws=draws, seed=seed)

    def predict_prior(self, simulator: Simulator, *, draws: int = 40, seed: int = 0) -> Predictive:
        """Prior predictive check: simulate data like those observed at draws of the prior.

        Arguments:
            simulator: As of `predict`, like the others.
            draws: Likewise.
            seed: Likewise.

        Returns:
            The data sets beside the one observed.

        Raises:
            InputError: As `predict`.
        """
        return predict(self, simulator, draws=draws, seed=seed, prior=True)

    def to_arviz(
        self,
        predictive: Predictive | None = None,
        prior_predictive: Predictive | None = None,
        calibration: Calibration | None = None,
    ) -> Any:
        """ArviZ's `InferenceData`, or xarray's `DataTree` where ArviZ is 1.0 or later.

        Weighted draws are resampled, as ArviZ reads no weights; the original ones are in a group `weighted_draws`.
        The groups that are there are listed in `yeastfit.inference.posterior.arviz`.

        Arguments:
            predictive: Result of `predict`; without it the groups of predicted and observed data are missing.
            prior_predictive: Result of `predict_prior`, for the group of that name.
            calibration: Result of `yeastfit.calibrate`, for the group `prior_sbc` or `posterior_sbc`.

        Returns:
            What the installed ArviZ plots and summarises.

        Raises:
            InputError: ArviZ is not installed, or an argument is of other statistics or parameters.
        """
        beside = Beside(predictive, prior_predictive, calibration)
        return inference_data(self, beside, self._about, self.seed)

    def to_netcdf(
        self,
        path: str | Path,
        predictive: Predictive | None = None,
        prior_predictive: Predictive | None = None,
        calibration: Calibration | None = None,
    ) -> None:
        """`to_arviz` as a NetCDF file, which `arviz.from_netcdf` reads.

        Arguments:
            path: The file, written whole or not at all.
            predictive: As of `to_arviz`, like the others.
            prior_predictive: Likewise.
            calibration: Likewise.

        Raises:
            InputError: As `to_arviz`.
        """
        write_netcdf(path, self, Beside(predictive, prior_predictive, calibration), self._about, self.seed)

    def save(self, path: str | Path) -> None:
        """Write all of it but `backend` as one .npz file."""
        arrays = {name: getattr(self, name) for name in ARRAYS}
        if self.log_likelihood is not None:
            arrays[LIKELIHOOD] = self.log_likelihood
        names = [one.name for one in fields(self) if one.name not in (*ARRAYS, LIKELIHOOD, *NOT_SAVED)]
        rest = {name: getattr(self, name) for name in names}
        rest |= {"prior": self.prior.asdict(), "status": self.status.name, "diagnostics": self.diagnostics.asdict()}
        with written_whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, rest=as_json(rest), **arrays)

    @staticmethod
    @reads_saved("posterior")
    def load(path: str | Path) -> "Posterior":
        """Read what `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in (*ARRAYS, *({LIKELIHOOD} & set(file.files)))}
            rest = from_json(str(file["rest"]))
        rest |= {name: tuple(rest[name]) for name in ("labels", "warnings", "varying") if name in rest}
        _check_shapes(arrays, len(rest["labels"]))
        arrays |= {name: np.array(rest.pop(name)) for name in ("noise", "worth") if rest[name] is not None}
        rest |= {"prior": Prior.of(rest["prior"]), "status": Status[rest["status"]]}
        return Posterior(**rest | {"diagnostics": Diagnostics.restored(rest["diagnostics"])}, **arrays)

    def warned(self, *sentences: str) -> "Posterior":
        """The same with further warnings."""
        return replace(self, warnings=(*self.warnings, *sentences))

    @property
    def _about(self) -> dict[str, Any]:
        """Attributes of the `posterior` group."""
        return {
            "inference_library": "yeastfit",
            "method": self.method,
            "seed": self.seed,
            "simulations": self.simulations,
            "status": str(self.status),
            "settings": as_json(self.settings),
            "warnings": as_json(self.warnings),
        }


def _check_shapes(arrays: dict[str, np.ndarray], statistics: int) -> None:
    """Raise `ValueError` where arrays of a file do not fit each other."""
    draws = arrays["weights"].shape
    shapes = {"log_probability": draws, "observed": (statistics,), "statistics": (*draws, statistics)}
    shapes |= {"values": (*draws, *arrays["values"].shape[-1:])}
    for name, shape in shapes.items():
        if arrays[name].shape != shape or len(draws) != 2:
            raise ValueError(f"{name} has shape {arrays[name].shape}, it must be {shape}")
    for name in ("values", "weights"):
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} holds numbers that are not finite")
