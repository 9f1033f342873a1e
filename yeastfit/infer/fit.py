"""λ from target curves by weighted least squares.

The mean curves m(λ) of an ensemble with fixed keys are fitted to target means y,

    minimise (m(λ) + d − y)ᵀ W (m(λ) + d − y),

with optimistix's Levenberg–Marquardt in unconstrained variables (`bijection`). m is the relaxed model's, which has
derivatives; d = m_hard(λ̂) − m(λ̂) is what the relaxation, and the fit's coarser time step, change at the estimate of the
round before, so that the curves compared with the data at λ̂ are the hard model's (a defect correction, as in space
mapping; Bandler et al. 1994). Rounds: a scout over the plausible box; a fit with a small ensemble and d = 0; then rounds
with the full ensemble and d renewed until λ̂ moves by less than its standard errors.

Covariance. One colony's curves scatter with a covariance S, taken from the hard ensemble and scaled to the measured
scatter. The mean of R replicates compared with E simulated colonies has Σ = S (1/R + 1/E) + measurement error. With
J the derivative of m, W the weights and Ĵ the Jacobian in use, which has Monte-Carlo noise of its own,

    cov log λ̂ = A⁻¹ Ĵᵀ W Σ W Ĵ A⁻ᵀ,    A = ĴᵀWJ,

A from two independent halves of the ensemble, in whose product that noise averages out.
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
from scipy.stats import qmc

from yeastfit.errors import InputError
from yeastfit.infer.bijection import check_free, from_free, log_of_free, to_free
from yeastfit.infer.curves import Curves, robust_mean
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

    members: ensemble of the relaxed model, from whose two halves the errors come. scouts: points of the plausible box
    looked at first. small: ensemble of the first fit. hard_members: ensemble of the hard model that d and S come from.
    dt, spacing: of the relaxed model; contact: its ramp's width, which dt · repulsivity / contact < 1 asks for; turning:
    see `Relaxation`. hard_dt: of the hard one. rounds: at most, with the full ensemble. max_steps: of Levenberg–Marquardt
    in each. tolerance: on the change of log λ and of the residuals that counts as converged. measurement_error: relative
    error of a measured mean that replicates do not average out. shrinkage: of correlations in the weights, because
    differences between neighbouring times are where errors of a percent in the model weigh most.
    """

    members: int = 64
    scouts: int = 128
    small: int = 32
    hard_members: int = 128
    dt: float = 0.02
    spacing: float = 0.2
    contact: float = 0.2
    turning: float = 0.5
    hard_dt: float = 0.01
    rounds: int = 3
    max_steps: int = 12
    tolerance: float = 0.01
    measurement_error: float = 0.01
    shrinkage: float = 0.2

    def __post_init__(self) -> None:
        for name in ("members", "small", "hard_members", "scouts"):
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
        targets = {k: np.array(v) if isinstance(v, list) and k != "names" else v for k, v in data["targets"].items()}
        names = tuple(name for name in NAMES if data["parameters"][name]["free"])
        errors = {name: data["parameters"][name]["standard_error"] for name in names}
        return Fit(
            parameters=Parameters(**{name: data["parameters"][name]["value"] for name in NAMES}),
            free=names,
            standard_errors={name: nan if error is None else error for name, error in errors.items()},
            covariance=np.array(data["covariance_of_logarithms"]["matrix"], dtype=float),
            targets=Targets(**{**targets, "names": tuple(targets["names"])}),
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
        sd = np.sqrt(self._measured_variance() + (settings.measurement_error * mean) ** 2)
        diagonal = np.diag(1.0 / sd)
        z = self._scout(diagonal) if start is None else to_free(start, self.free)
        self.progress("first fit", 0.1)
        z, ended = self._minimise(z, settings.small, diagonal, np.zeros(self.y.size), "first fit")
        for number in range(1, settings.rounds + 1):
            share = 0.3 + 0.6 * (number - 1) / settings.rounds
            self.progress(f"round {number}: hard ensemble", share)
            defect, scatter = self._defect(z)
            sigma = self._covariance(scatter)
            weight = np.linalg.inv(self._shrunk(sigma))
            whiten = np.linalg.cholesky(weight).T
            before = z
            self.progress(f"round {number}: fit", share + 0.1 / settings.rounds)
            z, ended = self._minimise(z, settings.members, whiten, defect, f"round {number}")
            covariance, cut = self._errors(z, weight, sigma)
            moved = np.abs(log_of_free(z, self.free) - log_of_free(before, self.free)) / np.sqrt(np.diag(covariance))
            if (moved < 0.5).all():
                break
        self.progress("hard ensemble at the estimate", 0.95)
        fitted, _ = self._hard_mean(z)
        residual = fitted - mean
        return self._result(
            z,
            ended=ended,
            settled=bool((moved < 0.5).all()),
            covariance=covariance,
            cut=cut,
            fitted=fitted,
            sigma=sigma,
            chi_square=float(residual @ np.linalg.solve(sigma, residual)),
            seconds=clock.perf_counter() - began,
        )

    def _scout(self, whiten: np.ndarray) -> Array:
        """The best of a low-discrepancy set of points in the middle of the plausible box, by one colony each."""
        self.progress("scouting the plausible box", 0.0)
        count = self.settings.scouts
        shares = qmc.Sobol(len(self.free), rng=self.seed).random(count)
        # z of ±2 is the middle 76 % of the range, on its logarithmic scale
        z = jnp.asarray(4.0 * shares - 2.0, self.y.dtype)
        curves = self._simulate(self.relaxed, z, count)
        cost = np.sum(((curves - self.y) @ whiten.T) ** 2, axis=1)
        best = int(np.nanargmin(np.where(np.isfinite(cost), cost, np.inf)))
        self._record("scout", float(cost[best]), z[best])
        return z[best]

    def _minimise(
        self, z: Array, members: int, whiten: np.ndarray, defect: np.ndarray, stage: str
    ) -> tuple[Array, str]:
        """Levenberg–Marquardt, step by step; the best point met, and how it ended."""
        keys = member_keys(self.seed, members)
        matrix, shift = jnp.asarray(whiten, z.dtype), jnp.asarray(defect, z.dtype) - self.y

        def residuals(z: Array, _: Any) -> tuple[Array, None]:
            return matrix @ (self.relaxed.mean(z, keys) + shift), None

        solver: Any = optx.LevenbergMarquardt(rtol=self.settings.tolerance, atol=self.settings.tolerance)
        shape = jax.ShapeDtypeStruct(self.y.shape, z.dtype)
        common = {"fn": residuals, "args": None, "options": {}, "tags": frozenset()}
        state = solver.init(y=z, f_struct=shape, aux_struct=None, **common)
        for _ in range(self.settings.max_steps):
            z, state, _ = solver.step(y=z, state=state, **common)
            self.simulations += members
            self._record(stage, float(jnp.sum(state.f_info.residual**2)), z)
            done, result = solver.terminate(y=z, state=state, **common)
            if result != optx.RESULTS.successful:
                return z, f"the optimiser failed: {optx.RESULTS[result]}"
            if done:
                return z, "converged"
        return z, f"the step limit of {self.settings.max_steps} was reached"

    def _simulate(self, curves: Curves, z: Array, members: int) -> np.ndarray:
        self.simulations += members
        return np.asarray(curves.members(z, member_keys(self.seed, members)), dtype=float)

    def _hard_mean(self, z: Array) -> tuple[np.ndarray, np.ndarray]:
        members = self._simulate(self.hard, z, self.settings.hard_members)
        return members.mean(axis=0), np.cov(members.T)

    def _defect(self, z: Array) -> tuple[np.ndarray, np.ndarray]:
        """m_hard − m at z, m of the very ensemble that is fitted; and the covariance of one hard colony's curves."""
        hard, scatter = self._hard_mean(z)
        return hard - self._simulate(self.relaxed, z, self.settings.members).mean(axis=0), scatter

    def _measured_variance(self) -> np.ndarray:
        return (self.targets.scatter**2 / self.targets.replicates).ravel()

    def _covariance(self, scatter: np.ndarray) -> np.ndarray:
        """Σ: the model's covariance of one colony scaled, statistic by statistic, to the measured scatter, plus errors."""
        targets = self.targets
        mean = targets.mean.ravel()
        count = len(targets.times)
        model = np.diag(scatter).reshape(-1, count).mean(axis=1)
        ratio = np.sqrt((targets.scatter**2).mean(axis=1) / model).repeat(count)
        replicates = np.sqrt(np.tile(targets.replicates, len(targets.names)))
        data = scatter * np.outer(ratio, ratio) / np.outer(replicates, replicates)
        sigma = data + scatter / self.settings.hard_members
        error = self.settings.measurement_error * mean
        same = np.kron(np.eye(len(targets.names)), np.ones((count, count)))
        # half of the variance common to all times of a statistic, half for each by itself
        return sigma + 0.5 * same * np.outer(error, error) + 0.5 * np.diag(error**2)

    def _shrunk(self, sigma: np.ndarray) -> np.ndarray:
        kept = 1.0 - self.settings.shrinkage
        return kept * sigma + (1.0 - kept) * np.diag(np.diag(sigma))

    def _errors(self, z: Array, weight: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, float]:
        """Covariance of log λ̂ (see above), and the share of members' derivatives that were outliers."""
        keys = member_keys(self.seed, self.settings.members)
        scale = np.asarray(jax.jacfwd(lambda z: log_of_free(z, self.free))(z), dtype=float)
        _, tangents = self.relaxed.members_with_tangents(z, keys)
        self.simulations += self.settings.members
        means = [robust_mean(tangents[k::2]) for k in (0, 1)]
        first, second = (np.asarray(jacobian, dtype=float) @ np.linalg.inv(scale) for jacobian, _ in means)
        share_cut = float(np.mean([cut for _, cut in means]))
        cross = first.T @ weight @ second
        a = 0.5 * (cross + cross.T)
        used = 0.5 * weight @ (first + second)
        if np.linalg.eigvalsh(a).min() <= 0:
            return np.full_like(a, np.nan), share_cut
        return np.linalg.solve(a, np.linalg.solve(a, used.T @ sigma @ used).T), share_cut

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
        cut: float,
        fitted: np.ndarray,
        sigma: np.ndarray,
        chi_square: float,
        seconds: float,
    ) -> Fit:
        parameters = from_free(z, self.free, self.fixed)
        errors = {
            name: float(getattr(parameters, name)) * float(np.sqrt(covariance[i, i])) for i, name in enumerate(self.free)
        }
        warnings = []
        freedom = self.targets.mean.size - len(self.free)
        if chi_square > freedom + 4 * np.sqrt(2 * freedom):
            warnings.append(f"the model does not reach the data: chi-square {chi_square:.0f} on {freedom} degrees of freedom")
        if cut > 0.2:
            warnings.append(f"{cut:.0%} of the members' derivatives were outliers: standard errors are uncertain")
        if not np.isfinite(covariance).all():
            warnings.append("the data do not determine all free parameters: no standard errors, fix one of them")
        converged = ended == "converged" and settled and bool(np.isfinite(fitted).all())
        if ended == "converged":
            ended = "converged" if settled else f"not settled after {self.settings.rounds} rounds"
        return Fit(
            parameters=parameters,
            free=self.free,
            standard_errors=errors,
            covariance=covariance,
            converged=converged,
            status=ended,
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


