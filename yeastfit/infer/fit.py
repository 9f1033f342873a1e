"""λ from target curves by weighted least squares.

The mean curves m(λ) of an ensemble with fixed keys are fitted to target means y,

    minimise (m(λ) + d − y)ᵀ W (m(λ) + d − y),

with optimistix's Levenberg–Marquardt in unconstrained variables (`bijection`). m is the relaxed model's, which has
derivatives; d = m_hard(λ₀) − m(λ₀) is what the relaxation, and the fit's coarser time step, change at the estimate λ₀
of the round before (a defect correction, as in space mapping, Bandler et al. 1994, doi:10.1109/22.339794). Rounds: a
scout over the plausible box (`surface.scout`); then, in turn, a study of the hard model around the estimate
(`local_study`: m_hard, its derivative J, the covariance S of one colony's curves) and a fit with d from it. The study
also gives the Gauss–Newton step of the hard model,

    Δ = A⁻¹ JᵀW (y − m_hard),    A = JᵀWJ;

from the second on, the rounds end where Δ is small against its standard error, and the last Δ is applied, so that the
estimate is the hard model's. One colony's curves scatter with S, scaled to the measured scatter; the mean of R
replicates compared with the study's has Σ = S (1/R + its error) + measurement error, W is the inverse of Σ with
correlations shrunk, and

    cov log λ̂ = A⁻¹ JᵀW Σ WJ A⁻ᵀ,

with A from two independent halves of the study, in whose product the Monte-Carlo noise of J averages out.
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
from yeastfit.infer.curves import Curves
from yeastfit.infer.surface import Local, local_study, scout
from yeastfit.infer.targets import Targets
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import NAMES, Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation import member_keys, sample_steps
from yeastfit.storage import versions, write_json

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole fit that is behind."""

DEFAULT_FREE = ("mobility", "metabolic_rate", "aspect_ratio")


@dataclass(frozen=True)
class FitSettings:
    """How a fit is computed. Defaults suit colonies of up to some hundred cells on two cores.

    members: ensemble of the relaxed model. scouts: colonies in each box of the scout. study: colonies of a study of the
    hard model; spread: half width of its box in log λ. dt, spacing: of the relaxed model; contact: its ramp's width,
    which dt · repulsivity / contact < 1 asks for; turning: see `Relaxation`. hard_dt: of the hard one. rounds: at most.
    max_steps: of Levenberg–Marquardt in each. gain: of χ², below which an accepted step ends it; it also ends after
    `patience` refused steps in a row, because a finite ensemble's mean is rough on the scale of its Monte-Carlo error.
    measurement_error: relative error of a measured mean that replicates do not average out, half of its variance common
    to all times. shrinkage: of correlations in the weights, because differences between neighbouring times are where
    errors of a percent in the model weigh most. settled: Δ in standard errors.
    """

    members: int = 64
    scouts: int = 256
    study: int = 512
    spread: float = 0.25
    dt: float = 0.02
    spacing: float = 0.2
    contact: float = 0.2
    turning: float = 0.5
    hard_dt: float = 0.005
    rounds: int = 4
    max_steps: int = 8
    gain: float = 0.3
    patience: int = 2
    measurement_error: float = 0.01
    shrinkage: float = 0.2
    settled: float = 1.5

    def __post_init__(self) -> None:
        for name in ("members", "study", "scouts"):
            if getattr(self, name) < 4 or getattr(self, name) % 2:
                raise InputError(f"{name} is {getattr(self, name)}, it must be an even number of at least 4")


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

    def _curves(self, dt: float, relaxation: Relaxation) -> Curves:
        """The model on a domain wide enough, and with room for every cell that could be born."""
        targets, settings = self.targets, self.settings
        # 3 L0 beyond the colony, several diffusion lengths, the nutrient is untouched; whole grid intervals
        domain = 2 * settings.spacing * np.ceil((1.3 * targets.extent + 3.0) / settings.spacing)
        events = int(np.floor(targets.times[-1] + 1e-6))
        numerics = Numerics(domain=float(domain), spacing=settings.spacing, dt=dt, capacity=2 ** (events + 1))
        observe = SmoothStatistics(2.6 * targets.extent, targets.spacing, targets.smoothing)
        steps = sample_steps(targets.times, numerics)
        return Curves(targets.names, self.free, numerics, observe, self.fixed, relaxation, steps)

    def run(self, start: Parameters | None) -> Fit:
        """All rounds."""
        began, settings = clock.perf_counter(), self.settings
        mean = self.targets.mean.ravel()
        z, ended = self._scout() if start is None else to_free(start, self.free), "nothing was wrong"
        for number in range(1, settings.rounds + 1):
            share = 0.15 + 0.85 * (number - 1) / settings.rounds
            self.progress(f"round {number}: study of the hard model", share)
            log_values = np.asarray(log_of_free(z, self.free), dtype=float)
            local = self._study(log_values)
            sigma = self._covariance(local)
            weight = np.linalg.inv(self._shrunk(sigma))
            step, covariance = _gauss_newton(local, mean - local.mean, weight, sigma)
            settled = number > 1 and bool((np.abs(step) < settings.settled * np.sqrt(np.diag(covariance))).all())
            residual = local.mean - mean
            self._record(f"round {number}, hard model", float(residual @ weight @ residual), z)
            if settled or number == settings.rounds:
                break
            self.progress(f"round {number}: fit", share + 0.3 / settings.rounds)
            z, ended = self._corrected_fit(z, local, np.linalg.cholesky(weight).T, f"round {number}")
        inside = (np.abs(step) < settings.spread).all()
        if inside:
            z = free_of_log(jnp.asarray(self._inside(log_values + step), self.y.dtype), self.free)
        fitted = local.mean + local.jacobian @ step * inside
        self._record("estimate", float((fitted - mean) @ weight @ (fitted - mean)), z)
        return self._result(
            z,
            ended=ended,
            settled=settled,
            covariance=covariance,
            fitted=fitted,
            sigma=sigma,
            chi_square=float((fitted - mean) @ np.linalg.solve(sigma, fitted - mean)),
            seconds=clock.perf_counter() - began,
        )

    def _scout(self) -> Array:
        """A start anywhere in the plausible box, from response surfaces of the relaxed model."""
        targets, keys = self.targets, member_keys(self.seed, self.settings.scouts)
        mean = targets.mean.ravel()
        self.simulations += 3 * len(keys)
        log_values = scout(
            self.relaxed,
            mean,
            # the relaxation's bias, a few percent, weighs here too: half of it is left to the rounds
            np.full(mean.size, max(0.02, self.settings.measurement_error)),
            np.tile(targets.replicates, len(targets.names)),
            keys,
            lambda number: self.progress(f"scouting, box {number + 1} of 3", 0.05 * number),
        )
        return free_of_log(jnp.asarray(self._inside(log_values), self.y.dtype), self.free)

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

    def _simulate(self, curves: Curves, z: Array, members: int) -> np.ndarray:
        self.simulations += members
        return np.asarray(curves.members(z, member_keys(self.seed, members)), dtype=float)

    def _study(self, log_values: np.ndarray) -> Local:
        """The hard model around a point, with colonies that the fits do not use."""
        keys = member_keys(self.seed, self.settings.study)
        self.simulations += len(keys)
        return local_study(self.hard, self._inside(log_values), keys, self.settings.spread)

    def _inside(self, log_values: np.ndarray) -> np.ndarray:
        """log λ at least 1e-3 inside its plausible range, where z is finite."""
        low, high = (np.asarray(end, dtype=float) for end in log_range(self.free))
        return np.clip(log_values, low + 1e-3, high - 1e-3)

    def _corrected_fit(self, z: Array, local: Local, whiten: np.ndarray, stage: str) -> tuple[Array, str]:
        """A fit of the relaxed model with its defect at z, as the ensemble that is fitted has it."""
        relaxed = self._simulate(self.relaxed, z, self.settings.members).mean(axis=0)
        return self._minimise(z, self.settings.members, whiten, local.mean - relaxed, stage)

    def _covariance(self, local: Local) -> np.ndarray:
        """Σ: the model's covariance of one colony, scaled by statistic to the measured scatter, plus errors."""
        targets, scatter = self.targets, local.scatter
        mean = targets.mean.ravel()
        count = len(targets.times)
        model = np.diag(scatter).reshape(-1, count).mean(axis=1)
        ratio = np.sqrt((targets.scatter**2).mean(axis=1) / model).repeat(count)
        replicates = np.sqrt(np.tile(targets.replicates, len(targets.names)))
        data = scatter * np.outer(ratio, ratio) / np.outer(replicates, replicates)
        error = self.settings.measurement_error * mean
        same = np.kron(np.eye(len(targets.names)), np.ones((count, count)))
        return data + local.mean_error * scatter + 0.5 * same * np.outer(error, error) + 0.5 * np.diag(error**2)

    def _shrunk(self, sigma: np.ndarray) -> np.ndarray:
        kept = 1.0 - self.settings.shrinkage
        return kept * sigma + (1.0 - kept) * np.diag(np.diag(sigma))

    def _record(self, stage: str, cost: float, z: Array) -> None:
        values = from_free(z, self.free, self.fixed).asdict()
        self.history.append({"stage": stage, "cost": cost, **{name: values[name] for name in self.free}})

    def _result(
        self,
        z: Array,
        *,
        ended: str,
        settled: bool,
        covariance: np.ndarray,
        fitted: np.ndarray,
        sigma: np.ndarray,
        chi_square: float,
        seconds: float,
    ) -> Fit:
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
        converged = settled and bool(np.isfinite(fitted).all())
        status = "converged"
        if not converged:
            status = f"not settled after {self.settings.rounds} rounds; in the last fit {ended}"
        return Fit(
            parameters=parameters,
            free=self.free,
            standard_errors=errors,
            covariance=covariance,
            converged=converged,
            status=status,
            chi_square=chi_square,
            targets=self.targets,
            fitted=fitted.reshape(self.targets.mean.shape),
            curve_covariance=sigma,
            history=self.history,
            simulations=self.simulations,
            seed=self.seed,
            settings=self.settings,
            seconds=seconds,
            warnings=warnings,
        )


def _gauss_newton(
    local: Local, residual: np.ndarray, weight: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Δ log λ and its covariance (see above), which is nan where the two halves do not agree on a direction."""
    first, second = local.halves
    cross = first.T @ weight @ second
    a = 0.5 * (cross + cross.T)
    used = weight @ local.jacobian
    if np.linalg.eigvalsh(a).min() <= 0:
        return np.linalg.lstsq(used.T @ local.jacobian, used.T @ residual)[0], np.full_like(a, np.nan)
    spread = np.linalg.solve(a, used.T)
    return spread @ residual, spread @ sigma @ spread.T
