"""One χ² for several optimisers: the judge, the counting objective, and the alternatives to `yeastfit.fit`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cma
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, minimize

from yeastfit import FitSettings, InputError, Parameters, Targets, member_keys
from yeastfit.inference.colonies import Colonies
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.response_surface import Surface, study
from yeastfit.inference.parameter_space import ALONE, Space, Vector

MARGIN = 2.0  # of χ² above its minimum that counts as the same residual
REACH = 0.2  # of the surface around the truth, in log λ
DIFFERENCE = 0.1  # step of least_squares' finite differences in log λ
EDGE = 0.5  # of the first simplex in z, and CMA-ES's first step
NOWHERE = 1e3  # residuals of a point whose simulations fail
JUDGES_SEED, WITNESS_SEED = 90_001, 90_002


@dataclass(frozen=True)
class Contest:
    """Data, Σ = L Lᵀ, and the response surface that tells how far χ² is above its minimum, at θ `best`."""

    targets: Targets
    space: Space
    settings: FitSettings
    factor: Float[np.ndarray, "curve curve"]
    surface: Surface
    best: Vector
    least: float

    @staticmethod
    def of(
        targets: Targets, truth: Mapping[str, float], free: Sequence[str], settings: FitSettings, judges: int
    ) -> "Contest":
        """With a surface around the true parameters, from `judges` colonies, and a quarter as many for Σ."""
        space = Space.of(free, {ALONE: Parameters(**truth)})
        centre = np.log([truth[name] for name in space.names])
        ensembles = Ensembles.of({ALONE: targets}, space, JUDGES_SEED, settings)
        (joint,) = ensembles.around([centre], judges // 4, 0.1, full=True)
        if isinstance(joint, InputError):
            raise joint
        factor = np.linalg.cholesky(ensembles.sigma(joint))
        surface = study(ensembles.alone, centre, np.full(len(centre), REACH), judges, JUDGES_SEED)
        best, least = surface.minimise(factor, targets.values[None])
        return Contest(targets, space, settings, factor, surface, best[0], float(least[0]))

    def colonies(self) -> Colonies:
        """What simulates further colonies."""
        settings = self.settings
        return Colonies.of(self.targets, dt=settings.dt, spacing=settings.spacing, capacity=settings.capacity)

    def whitened(self, mean: Float[np.ndarray, " curve"]) -> Float[np.ndarray, " curve"]:
        """Residuals of variance 1."""
        return solve_triangular(self.factor, mean - self.targets.values, lower=True)

    def rise(self, theta: Vector) -> float:
        """The exact χ² above its minimum; infinite off the surface."""
        if (np.abs(theta - self.surface.centre) > self.surface.reach * (1 + 1e-9)).any():
            return np.inf
        return float(np.sum(self.whitened(self.surface.mean(theta)) ** 2)) - self.least

    def directly(self, theta: Vector, members: int) -> float:
        """χ² of a large ensemble at a point."""
        keys = member_keys(WITNESS_SEED, members)
        grown = self.colonies().grow(self.space.log_parameters(ALONE, np.tile(theta, (members, 1))), keys)
        return float(np.sum(self.whitened(grown.mean(axis=0)) ** 2))


class Stopped(Exception):
    """A run has arrived, or has spent its budget."""


@dataclass
class Objective:
    """χ² in z, of the mean of an ensemble with fixed keys. cost, theta: of the best point; arrived: within `MARGIN`."""

    contest: Contest
    members: int
    seed: int
    budget: float
    spent: int = 0
    cost: float = np.inf
    theta: Vector | None = None
    arrived: bool = False

    def __post_init__(self) -> None:
        self.grower, self.keys = self.contest.colonies(), member_keys(self.seed, self.members)
        self.known: dict[bytes, np.ndarray] = {}

    def residuals(self, z: Vector) -> Float[np.ndarray, " curve"]:
        """Residuals at one point, a candidate for the best one."""
        return self.asked(np.atleast_2d(z))[0]

    def square(self, z: Vector) -> float:
        """χ² at one point."""
        return float(np.sum(self.residuals(z) ** 2))

    def differences(self, z: Vector) -> Float[np.ndarray, "curve entry"]:
        """Forward differences in z, with steps of `DIFFERENCE` in log λ."""
        step = DIFFERENCE / self.contest.space.slope(self.contest.space.of_z(z))
        here = self.known[z.tobytes()] if z.tobytes() in self.known else self.residuals(z)
        return (self._grown(z + np.diag(step)) - here).T / step

    def asked(self, points: Float[np.ndarray, "point entry"]) -> Float[np.ndarray, "point curve"]:
        """Residuals at several points, all candidates for the best one. Raises `Stopped`."""
        found = self._grown(points)
        for z, residuals in zip(points, found, strict=True):
            self.known = {z.tobytes(): residuals}
            if (cost := float(residuals @ residuals)) < self.cost:
                self.cost, self.theta = cost, self.contest.space.of_z(z)
        self.arrived = self.theta is not None and self.contest.rise(self.theta) < MARGIN
        if self.arrived:
            raise Stopped
        return found

    def _grown(self, points: Float[np.ndarray, "point entry"]) -> Float[np.ndarray, "point curve"]:
        if self.spent + self.members * len(points) > self.budget:
            raise Stopped
        self.spent += self.members * len(points)
        theta = np.repeat([self.contest.space.of_z(z) for z in points], self.members, axis=0)
        keys = jnp.concatenate([self.keys] * len(points))
        curves = self.grower.grow(self.contest.space.log_parameters(ALONE, theta), keys)
        means = [part.mean(axis=0) for part in np.split(curves, len(points))]
        return np.stack([self.contest.whitened(m) if np.isfinite(m).all() else np.full(len(m), NOWHERE) for m in means])


def with_differences(objective: Objective, z: Vector, seed: int) -> None:
    """Least squares in a trust region (SciPy)."""
    least_squares(objective.residuals, z, jac=objective.differences, method="trf", xtol=1e-4, ftol=1e-4, gtol=1e-6)


def simplex(objective: Objective, z: Vector, seed: int) -> None:
    """The Nelder–Mead simplex."""
    corners = np.concatenate([z[None], z + EDGE * np.eye(len(z))])
    options = {"initial_simplex": corners, "xatol": 1e-3, "fatol": 0.1, "maxfev": 10_000, "maxiter": 10_000}
    minimize(objective.square, z, method="Nelder-Mead", options=options)


def evolution(objective: Objective, z: Vector, seed: int) -> None:
    """CMA-ES, one population at a time, with random numbers of its own."""
    draws = np.random.default_rng(seed)
    options = {"verbose": -9, "seed": np.nan, "randn": lambda *shape: draws.standard_normal(shape)}
    strategy = cma.CMAEvolutionStrategy(z, EDGE, options)
    while not strategy.stop():
        points = strategy.ask()
        strategy.tell(points, np.sum(objective.asked(np.stack(points)) ** 2, axis=1).tolist())


ALTERNATIVES: dict[str, Callable[[Objective, Vector, int], None]] = {
    "least_squares, differences": with_differences,
    "Nelder–Mead": simplex,
    "CMA-ES": evolution,
}
