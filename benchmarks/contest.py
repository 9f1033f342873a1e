"""One χ² for several optimisers: the judge, the counting objective, and the alternatives to `yeastfit.fit`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import cma
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, minimize

from yeastfit import ColonySimulator, FitSettings, SimulationError, Simulator, Targets
from yeastfit.inference.curve_covariance import Square, whitened
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.response_surface import ResponseSurface, response_surface
from yeastfit.inference.parameter_space import ONLY, ParameterSpace, Points, Vector
from yeastfit.inference.resolution import COARSE
from yeastfit.inference.simulator import Rows, member_seeds
from yeastfit.seeds import Stream

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
    simulator: Simulator
    space: ParameterSpace
    settings: FitSettings
    root: Square
    surface: ResponseSurface
    best: Vector
    least: float

    @staticmethod
    def of(
        targets: Targets, truth: Mapping[str, float], free: Sequence[str], settings: FitSettings, judges: int
    ) -> "Contest":
        """With a surface around the true parameters, from `judges` colonies, and a quarter as many for Σ."""
        simulator = ColonySimulator.of(targets, free, truth, COARSE)
        space = ParameterSpace.of(simulator.parameters)
        centre = np.log([truth[name] for name in space.names])
        ensembles = Ensembles({ONLY: targets}, {ONLY: simulator}, space, JUDGES_SEED, settings)
        (model,) = ensembles.local_models([centre], judges // 4, 0.1, full=True)
        if isinstance(model, SimulationError):
            raise model
        root, reach = np.linalg.cholesky(ensembles.covariance(model)), np.full(len(centre), REACH)
        simulate = partial(ensembles.single_simulations, stream=Stream.SURFACE)
        surface = response_surface(simulate, centre, reach, judges, JUDGES_SEED)
        found = surface.minimise(root, targets.values[None])
        return Contest(targets, simulator, space, settings, root, surface, found.theta[0], float(found.chi_square[0]))

    def residuals(self, mean: Float[np.ndarray, " observable"]) -> Float[np.ndarray, " observable"]:
        """Residuals of variance 1."""
        return whitened(self.root, mean - self.targets.values)

    def rise(self, theta: Vector) -> float:
        """The exact χ² above its minimum; infinite off the surface."""
        if (np.abs(theta - self.surface.centre) > self.surface.reach * (1 + 1e-9)).any():
            return np.inf
        return float(np.sum(self.residuals(self.surface.mean(theta)) ** 2)) - self.least

    def directly(self, theta: Vector, members: int) -> float:
        """χ² of a large ensemble at a point."""
        values = self.space.values(ONLY, np.tile(theta, (members, 1)))
        rows = self.simulator(values, member_seeds(WITNESS_SEED, members))
        return float(np.sum(self.residuals(rows.mean(axis=0)) ** 2))


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
        self.seeds = member_seeds(self.seed, self.members)
        self.known: dict[bytes, np.ndarray] = {}

    def residuals(self, z: Vector) -> Float[np.ndarray, " observable"]:
        """Residuals at one point, a candidate for the best one."""
        return self.asked(np.atleast_2d(z))[0]

    def square(self, z: Vector) -> float:
        """χ² at one point."""
        return float(np.sum(self.residuals(z) ** 2))

    def differences(self, z: Vector) -> Float[np.ndarray, "observable entry"]:
        """Forward differences in z, with steps of `DIFFERENCE` in log λ."""
        step = DIFFERENCE / self.contest.space.slope(self.contest.space.theta_of(z))
        here = self.known[z.tobytes()] if z.tobytes() in self.known else self.residuals(z)
        return (self._simulated(z + np.diag(step)) - here).T / step

    def asked(self, points: Points) -> Rows:
        """Residuals at several points, all candidates for the best one. Raises `Stopped`."""
        found = self._simulated(points)
        for z, residuals in zip(points, found, strict=True):
            self.known = {z.tobytes(): residuals}
            if (cost := float(residuals @ residuals)) < self.cost:
                self.cost, self.theta = cost, self.contest.space.theta_of(z)
        self.arrived = self.theta is not None and self.contest.rise(self.theta) < MARGIN
        if self.arrived:
            raise Stopped
        return found

    def _simulated(self, points: Points) -> Rows:
        if self.spent + self.members * len(points) > self.budget:
            raise Stopped
        self.spent += self.members * len(points)
        theta = np.repeat([self.contest.space.theta_of(z) for z in points], self.members, axis=0)
        rows = self.contest.simulator(self.contest.space.values(ONLY, theta), np.tile(self.seeds, len(points)))
        means = [part.mean(axis=0) for part in np.split(rows, len(points))]
        whole = [np.isfinite(mean).all() for mean in means]
        return np.stack(
            [
                self.contest.residuals(mean) if good else np.full(len(mean), NOWHERE)
                for mean, good in zip(means, whole, strict=True)
            ]
        )


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
