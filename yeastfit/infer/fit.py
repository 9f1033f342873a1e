"""λ from target curves by weighted least squares.

The mean curves m(λ) of an ensemble with fixed keys are fitted to target means y,

    minimise (m(λ) + d − y)ᵀ W (m(λ) + d − y),

with optimistix's Levenberg–Marquardt in unconstrained variables (`bijection`). m is the relaxed model's, which has
derivatives; d is what the relaxation, and the fit's coarser time step, change at the estimate of the round before (a
defect correction, as in space mapping, Bandler et al. 1994, doi:10.1109/22.339794). The stages:

1. a scout over the plausible box (`surface.scout`), which comes back with several places;
2. a study of the hard model around each (`surface.study`): mean curves m_hard as a surface over a box in log λ, the
   covariance S of one colony's curves, and d = m_hard − m at the surface's best point; from the lowest of these points
3. the fit of the relaxed model starts;
4. a study around its result, whose surface is minimised, so that the estimate is the hard model's; and another one
   where the best point is not well inside the box.

One colony's curves scatter with S, scaled to the measured scatter; the mean of R replicates compared with the study's
has Σ = S (1/R + its error) + measurement error. W is the inverse of Σ with correlations shrunk. With J the derivative
of m_hard in log λ, whose Monte-Carlo error has the covariance S_kl G_ij,

    cov log λ̂ = A⁻¹ JᵀW Σ WJ A⁻¹,    A = JᵀWJ − tr(WS) G,

where the last term takes out what that error adds to JᵀWJ on average.
"""

import json
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.infer.bijection import check_free, free_of_log, from_free, log_of_free, log_range, to_free
from yeastfit.infer.curves import FreeCurves
from yeastfit.infer.surface import Surface, scout, study
from yeastfit.infer.targets import Targets
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import NAMES, Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation import member_keys, schedule_of
from yeastfit.storage import versions, write_json

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole fit that is behind."""

DEFAULT_FREE = ("mobility", "metabolic_rate", "aspect_ratio")


@dataclass(frozen=True)
class FitSettings:
    """How a fit is computed. Defaults suit colonies of up to some hundred cells on two cores.

    members: ensemble of the relaxed model. scouts: colonies in each box of the scout; starts: places it comes back
    with. study: colonies of a study of the hard model; spread: half width of its box in log λ. dt, spacing: of the
    relaxed model; contact: its ramp's width, which dt · repulsivity / contact < 1 asks for; turning: see `Relaxation`.
    hard_dt: of the hard one.
    studies: at most. max_steps: of Levenberg–Marquardt. gain: of χ², below which an accepted step ends it; it also
    ends after `patience` refused steps in a row, because a finite ensemble's mean is rough on the scale of its
    Monte-Carlo error. measurement_error: relative error of a measured mean that replicates do not average out, half
    of its variance common to all times. shrinkage: of correlations in the weights, because differences between
    neighbouring times are where errors of a percent in the model weigh most. inside: share of the box in which the
    last study's best point must lie.
    """

    members: int = 64
    scouts: int = 256
    starts: int = 3
    study: int = 512
    spread: float = 0.5
    dt: float = 0.02
    spacing: float = 0.2
    contact: float = 0.2
    turning: float = 0.5
    hard_dt: float = 0.01
    studies: int = 4
    max_steps: int = 8
    gain: float = 0.3
    patience: int = 2
    measurement_error: float = 0.01
    shrinkage: float = 0.2
    inside: float = 0.7

    def __post_init__(self) -> None:
        for name in ("members", "study", "scouts"):
            if getattr(self, name) < 4 or getattr(self, name) % 2:
                raise InputError(f"{name} is {getattr(self, name)}, it must be an even number of at least 4")
        for name, least in (("starts", 1), ("studies", 2)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least {least}")


@dataclass(frozen=True)
class Fit:
    """Result of `fit`: values, errors, status, and all it takes to repeat and to plot it.

    standard_errors: of λ, nan where the data do not determine one. covariance: of log λ of the free parameters.
    fitted: the hard model's mean curves at the estimate. curve_covariance: Σ. history: one row per step.
    """

    parameters: Parameters
    free: tuple[str, ...]
    standard_errors: dict[str, float]
    covariance: Float[np.ndarray, "free free"]
    converged: bool
    status: str
    chi_square: float
    targets: Targets
    fitted: Float[np.ndarray, "statistic time"]
    curve_covariance: Float[np.ndarray, "curve curve"]
    history: list[dict[str, Any]]
    simulations: int
    seed: int
    settings: FitSettings
    seconds: float
    warnings: list[str] = field(default_factory=list)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of target values less that of free parameters."""
        return self.targets.mean.size - len(self.free)

    def asdict(self) -> dict[str, Any]:
        """Everything as plain data, parameters by name with `value`, `standard_error` and `free`."""
        values = self.parameters.asdict()
        table = {
            name: {"value": values[name], "standard_error": self.standard_errors.get(name), "free": name in self.free}
            for name in NAMES
        }
        return {
            "parameters": table,
            "status": self.status,
            "converged": self.converged,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees_of_freedom,
            "covariance_of_logarithms": {"names": self.free, "matrix": self.covariance},
            "targets": asdict(self.targets),
            "fitted": self.fitted,
            "curve_covariance": self.curve_covariance,
            "history": self.history,
            "simulations": self.simulations,
            "seed": self.seed,
            "settings": asdict(self.settings),
            "seconds": self.seconds,
            "warnings": self.warnings,
            "versions": versions(),
        }

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    def load(path: str | Path) -> "Fit":
        """What `save` wrote."""
        data = json.loads(Path(path).read_text())
        nan = float("nan")
        targets: dict[str, Any] = {k: np.array(v) if isinstance(v, list) else v for k, v in data["targets"].items()}
        names = tuple(name for name in NAMES if data["parameters"][name]["free"])
        errors = {name: data["parameters"][name]["standard_error"] for name in names}
        return Fit(
            parameters=Parameters(**{name: data["parameters"][name]["value"] for name in NAMES}),
            free=names,
            standard_errors={name: nan if error is None else error for name, error in errors.items()},
            covariance=np.array(data["covariance_of_logarithms"]["matrix"], dtype=float),
            targets=Targets(**{**targets, "names": tuple(data["targets"]["names"])}),
            fitted=np.array(data["fitted"]),
            curve_covariance=np.array(data["curve_covariance"]),
            settings=FitSettings(**data["settings"]),
            **{k: data[k] for k in ("converged", "status", "chi_square", "history", "simulations", "seed")},
            **{k: data[k] for k in ("seconds", "warnings")},
        )


def fit(
    targets: Targets,
    *,
    free: Sequence[str] = DEFAULT_FREE,
    fixed: Parameters | None = None,
    start: Parameters | None = None,
    seed: int = 0,
    settings: FitSettings | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit the free parameters to the targets, the others held at `fixed` (default: the source's values).

    start: where to begin; without it, a scout over the plausible box of the free parameters. Same seed, same result.
    Returns a `Fit`, whose `status` says in words how it ended. Raises `InputError`.
    """
    return _Fitter(
        targets,
        check_free(free),
        fixed or Parameters(),
        seed,
        settings or FitSettings(),
        progress or (lambda what, share: None),
    ).run(start)


class _Fitter:
    """The rounds of one fit, and what they leave behind for the next."""

    def __init__(
        self,
        targets: Targets,
        free: tuple[str, ...],
        fixed: Parameters,
        seed: int,
        settings: FitSettings,
        progress: Progress,
    ) -> None:
        if targets.mean.size <= len(free):
            raise InputError(f"{targets.mean.size} target values cannot determine {len(free)} free parameters")
        self.targets, self.free, self.fixed, self.seed = targets, free, fixed, seed
        self.settings, self.progress = settings, progress
        self.y = jnp.asarray(targets.mean.ravel())
        self.relaxed = self._curves(settings.dt, Relaxation(contact=settings.contact, turning=settings.turning))
        self.hard = self._curves(settings.hard_dt, HARD)
        self.history: list[dict[str, Any]] = []
        self.simulations = 0

    def _curves(self, dt: float, relaxation: Relaxation) -> FreeCurves:
        """The model on a domain wide enough, and with room for every cell that could be born."""
        targets, settings = self.targets, self.settings
        # 3 L0 beyond the colony, several diffusion lengths, the nutrient is untouched; whole grid intervals
        domain = 2 * settings.spacing * np.ceil((1.3 * targets.extent + 3.0) / settings.spacing)
        events = int(np.floor(targets.times[-1] + 1e-6))
        numerics = Numerics(domain=float(domain), spacing=settings.spacing, dt=dt, capacity=2 ** (events + 1))
        observe = SmoothStatistics(2.6 * targets.extent, targets.spacing, targets.smoothing)
        schedule = schedule_of(targets.times, numerics)
        return FreeCurves(targets.names, numerics, observe, relaxation, schedule, self.free, self.fixed)

    def run(self, start: Parameters | None) -> Fit:
        """All stages."""
        began, settings = clock.perf_counter(), self.settings
        starts = self._scout() if start is None else [np.asarray(log_of_free(to_free(start, self.free), self.free))]
        studied = []
        for number, log_values in enumerate(starts, start=1):
            self.progress(f"study of start {number} of {len(starts)}, hard model", 0.25 + 0.15 * number / len(starts))
            studied.append(self._estimate(log_values, f"study of start {number}"))
        first = min(studied, key=lambda estimate: estimate.cost)
        self.progress("fitting the relaxed model", 0.4)
        z, ended = self._corrected_fit(first)
        for number in range(2, settings.studies + 1):
            self.progress(f"study {number} of the hard model", 0.6 + 0.1 * number)
            last = self._estimate(np.asarray(log_of_free(z, self.free), dtype=float), f"study {number}")
            z = self._free(last.log_values)
            if last.settled(settings.inside):
                break
        return self._result(z, last, ended, seconds=clock.perf_counter() - began)

    def _scout(self) -> list[np.ndarray]:
        """Where to start in the plausible box, from response surfaces of the relaxed model."""
        targets, settings, keys = self.targets, self.settings, member_keys(self.seed, self.settings.scouts)
        mean = targets.mean.ravel()

        def scouting(number: int) -> None:
            self.progress(f"scouting, box {number + 1} of 3", 0.08 * number)
            self.simulations += len(keys)

        return scout(
            self.relaxed,
            mean,
            # the relaxation's bias, a few percent, weighs here too: half of it is left to the rounds
            np.full(mean.size, max(0.02, settings.measurement_error)),
            np.tile(targets.replicates.astype(float), len(targets.names)),
            keys,
            scouting,
            starts=settings.starts,
        )

    def _estimate(self, log_values: np.ndarray, stage: str) -> "_Estimate":
        """Where the hard model's surface around a point is lowest; weights at the centre first, then at that point."""
        surface, mean = self._study(log_values), self.targets.mean.ravel()
        log_values = surface.centre
        for _ in range(2):
            sigma = self._covariance(surface, log_values)
            weight = np.linalg.inv(self._shrunk(sigma))
            log_values = self._inside(surface.minimise(np.linalg.cholesky(weight).T, mean))
        fitted = surface.mean(log_values)
        cost = float((fitted - mean) @ weight @ (fitted - mean))
        self._record(stage, cost, self._free(log_values))
        return _Estimate(surface, log_values, fitted, sigma, weight, cost)

    def _free(self, log_values: np.ndarray) -> Array:
        return free_of_log(jnp.asarray(log_values, self.y.dtype), self.free)

    def _minimise(
        self, z: Array, members: int, whiten: np.ndarray, defect: np.ndarray, stage: str
    ) -> tuple[Array, str]:
        """Levenberg–Marquardt, step by step; the best point met, and how it ended."""
        keys = member_keys(self.seed, members)
        matrix, shift = jnp.asarray(whiten, z.dtype), jnp.asarray(defect, z.dtype) - self.y

        def residuals(z: Array, _: Any) -> tuple[Array, None]:
            return matrix @ (self.relaxed.mean(z, keys) + shift), None

        solver: Any = optx.LevenbergMarquardt(rtol=1e-3, atol=1e-3)
        shape = jax.ShapeDtypeStruct(self.y.shape, z.dtype)
        common: dict[str, Any] = {"fn": residuals, "args": None, "options": {}, "tags": frozenset()}
        state = solver.init(y=z, f_struct=shape, aux_struct=None, **common)
        before = np.inf
        for _ in range(self.settings.max_steps):
            z, state, _ = solver.step(y=z, state=state, **common)
            self.simulations += members
            cost = float(jnp.sum(state.f_info.residual**2))
            refused = int(state.num_steps_since_acceptance)
            if not refused:
                self._record(stage, cost, z)
            done, result = solver.terminate(y=z, state=state, **common)
            if result != optx.RESULTS.successful:
                return z, f"the optimiser failed: {optx.RESULTS[result]}"  # type: ignore[misc]
            if done or refused == self.settings.patience or (not refused and before - cost < self.settings.gain):
                return z, "converged"
            before = cost
        return z, f"the step limit of {self.settings.max_steps} was reached"

    def _simulate(self, curves: FreeCurves, z: Array, members: int) -> np.ndarray:
        self.simulations += members
        return np.asarray(curves.members(z, member_keys(self.seed, members)), dtype=float)

    def _study(self, log_values: np.ndarray) -> Surface:
        """The hard model around a point."""
        keys = member_keys(self.seed, self.settings.study)
        self.simulations += len(keys)
        return study(self.hard, self._inside(log_values), keys, self.settings.spread)

    def _inside(self, log_values: np.ndarray) -> np.ndarray:
        """log λ at least 1e-3 inside its plausible range, where z is finite."""
        low, high = (np.asarray(end, dtype=float) for end in log_range(self.free))
        return np.clip(log_values, low + 1e-3, high - 1e-3)

    def _corrected_fit(self, first: "_Estimate") -> tuple[Array, str]:
        """A fit of the relaxed model from an estimate with its defect there, as the ensemble that is fitted has it."""
        z, members = self._free(first.log_values), self.settings.members
        relaxed = self._simulate(self.relaxed, z, members).mean(axis=0)
        whiten = np.linalg.cholesky(first.weight).T
        return self._minimise(z, members, whiten, first.fitted - relaxed, "relaxed model")

    def _covariance(self, surface: Surface, log_values: np.ndarray) -> np.ndarray:
        """Σ: the model's covariance of one colony, scaled by statistic to the measured scatter, plus errors."""
        targets, scatter = self.targets, surface.scatter
        mean = targets.mean.ravel()
        count = len(targets.times)
        model = np.diag(scatter).reshape(-1, count).mean(axis=1)
        ratio = np.sqrt((targets.scatter**2).mean(axis=1) / model).repeat(count)
        replicates = np.sqrt(np.tile(targets.replicates, len(targets.names)))
        data = scatter * np.outer(ratio, ratio) / np.outer(replicates, replicates)
        error = self.settings.measurement_error * mean
        same = np.kron(np.eye(len(targets.names)), np.ones((count, count)))
        return (
            data
            + surface.mean_error(log_values) * scatter
            + 0.5 * same * np.outer(error, error)
            + 0.5 * np.diag(error**2)
        )

    def _shrunk(self, sigma: np.ndarray) -> np.ndarray:
        kept = 1.0 - self.settings.shrinkage
        return kept * sigma + (1.0 - kept) * np.diag(np.diag(sigma))

    def _record(self, stage: str, cost: float, z: Array) -> None:
        values = from_free(z, self.free, self.fixed).asdict()
        self.history.append({"stage": stage, "cost": cost, **{name: values[name] for name in self.free}})

    def _result(self, z: Array, last: "_Estimate", ended: str, seconds: float) -> Fit:
        covariance = _covariance_of_estimate(last.surface, last.log_values, last.weight, last.sigma)
        rest = last.fitted - self.targets.mean.ravel()
        chi_square = float(rest @ np.linalg.solve(last.sigma, rest))
        parameters = from_free(z, self.free, self.fixed)
        errors = {
            name: float(getattr(parameters, name)) * float(np.sqrt(covariance[i, i]))
            for i, name in enumerate(self.free)
        }
        warnings = []
        freedom = self.targets.mean.size - len(self.free)
        if chi_square > freedom + 4 * np.sqrt(2 * freedom):
            warnings.append(
                f"the model does not reach the data: chi-square {chi_square:.0f} on {freedom} degrees of freedom"
            )
        if not np.isfinite(covariance).all():
            warnings.append("the data do not determine all free parameters: no standard errors, fix one of them")
        converged = last.settled(self.settings.inside) and bool(np.isfinite(last.fitted).all())
        status = "converged"
        if not converged:
            status = f"not settled after {self.settings.studies} studies; the fit before them: {ended}"
        return Fit(
            parameters=parameters,
            free=self.free,
            standard_errors=errors,
            covariance=covariance,
            converged=converged,
            status=status,
            chi_square=chi_square,
            targets=self.targets,
            fitted=last.fitted.reshape(self.targets.mean.shape),
            curve_covariance=last.sigma,
            history=self.history,
            simulations=self.simulations,
            seed=self.seed,
            settings=self.settings,
            seconds=seconds,
            warnings=warnings,
        )


@dataclass(frozen=True)
class _Estimate:
    """The lowest point of a surface: m_hard there, Σ, W and the weighted squares."""

    surface: Surface
    log_values: np.ndarray
    fitted: np.ndarray
    sigma: np.ndarray
    weight: np.ndarray
    cost: float

    def settled(self, inside: float) -> bool:
        """Whether the point lies well inside the surface's box."""
        return bool((np.abs(self.log_values - self.surface.centre) < inside * self.surface.reach).all())


def _covariance_of_estimate(
    surface: Surface, log_values: np.ndarray, weight: np.ndarray, sigma: np.ndarray
) -> np.ndarray:
    """cov log λ̂ (see above); nan where a direction is not told from the noise of the derivatives: no data see it."""
    jacobian, error = surface.jacobian(log_values)
    a = jacobian.T @ weight @ jacobian - np.trace(weight @ surface.scatter) * error
    if np.linalg.eigvalsh(a).min() <= 0:
        return np.full_like(a, np.nan)
    spread = np.linalg.solve(a, jacobian.T @ weight)
    return spread @ sigma @ spread.T
