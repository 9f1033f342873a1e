"""Errors of a fit beyond its covariance: a bootstrap over replicates, and profiles of the likelihood.

Both take hundreds of fits. They are made on a response surface around the estimate (`response_surface`), from fine
colonies of their own, with the fit's Σ. Its box reaches three and a half standard errors from the estimate, at least
`NEAREST` and at most `FARTHEST` in log λ, and not beyond the bounds: what lies at its edge is told as such.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from yeastfit.errors import InputError
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.response_surface import Surface, study
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.parameter_space import Vector

NEAREST, FARTHEST, ERRORS = 0.1, 0.7, 3.5
AT_EDGE = 0.98  # of the box's half width


@dataclass(frozen=True)
class Bootstrap:
    """Estimates from replicates drawn with replacement.

    values: λ [draw, entry]. standard_errors: deviation of log λ, by entry. intervals: 95 %, by percentiles of λ.
    at_edge: share of the draws that ended at the edge of the surface: then errors are too small.
    """

    free: tuple[str, ...]
    values: Float[np.ndarray, "draw entry"]
    standard_errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    at_edge: float
    simulations: int


@dataclass(frozen=True)
class Profile:
    """χ² with one parameter held and the others at their best.

    values: λ; rise: of χ² above its least. intervals: of λ, where the rise is below 1 (68 %) and 3.84 (95 %);
    nan for an end that the surface does not reach. standard_error: of log λ, from the covariance.
    """

    name: str
    estimate: float
    standard_error: float
    values: Float[np.ndarray, " point"]
    rise: Float[np.ndarray, " point"]
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Explored:
    """A fit with the surface around it. simulations: colonies grown for that."""

    fit: Fit
    surface: Surface
    simulations: int

    def bootstrap(self, draws: int = 500, seed: int = 0) -> Bootstrap:
        """Fits of resampled replicates. Raises `InputError` where single colonies are not known, or only one."""
        rng, free = np.random.default_rng(seed), self.fit.free
        if draws < 2:
            raise InputError(f"draws is {draws}, a bootstrap needs at least 2")
        targets = [each.targets for each in self.fit.conditions]
        samples = np.stack([np.concatenate([each.resampled(rng) for each in targets]) for _ in range(draws)])
        theta = self._least(samples)[0]
        low, high = np.percentile(np.exp(theta), (2.5, 97.5), axis=0)
        away = np.abs(theta - self.surface.centre) > AT_EDGE * self.surface.reach
        return Bootstrap(
            free,
            np.exp(theta),
            dict(zip(free, theta.std(axis=0, ddof=1).tolist(), strict=True)),
            dict(zip(free, zip(low.tolist(), high.tolist(), strict=True), strict=True)),
            float(away.any(axis=1).mean()),
            self.simulations,
        )

    def profile(self, name: str, points: int = 41) -> Profile:
        """Over the width of the surface. Raises `InputError` for a name that is not free."""
        if name not in self.fit.free:
            raise InputError(f"profile of {name!r}, which is not free: {', '.join(self.fit.free)} are")
        k, surface = self.fit.free.index(name), self.surface
        data = np.concatenate([each.targets.values for each in self.fit.conditions])
        theta, least = (one[0] for one in self._least(data[None]))
        grid = np.unique(np.append(surface.centre[k] + surface.reach[k] * np.linspace(-1, 1, points), theta[k]))
        squares = self._least(np.tile(data, (len(grid), 1)), held=(k, grid))[1]
        rise = np.maximum(squares - min(float(least), float(squares.min())), 0.0)
        intervals = {label: _interval(grid, rise, level) for label, level in (("68%", 1.0), ("95%", 3.84))}
        error = self.fit.information.standard_errors[name]
        return Profile(name, float(np.exp(theta[k])), error, np.exp(grid), rise, intervals)

    def _least(
        self, values: Float[np.ndarray, "fit curve"], held: tuple[int, np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        sigma = block_diag(*(each.covariance for each in self.fit.conditions))
        pulls = [self.fit.prior.get(name, (0.0, np.inf)) for name in self.fit.free]
        centre, width = np.array(pulls).T
        return self.surface.minimise(np.linalg.cholesky(sigma), values, centre=centre, pull=1.0 / width, held=held)


def explore(fit: Fit, *, runs: int = 512) -> Explored:
    """Grow colonies around a fit's estimate, for `Explored.bootstrap` and `Explored.profile`.

    runs: colonies of each condition. Same fit, same result.
    """
    targets = {each.name: each.targets for each in fit.conditions}
    ensembles = Ensembles.of(targets, fit.space, fit.seed + 1, fit.settings)
    surface = study(partial(ensembles.alone, refined=True), *_box(fit), runs, fit.seed)
    return Explored(fit, surface, ensembles.grown)


def profiles(explored: Explored, names: Sequence[str] | None = None) -> dict[str, Profile]:
    """Of several parameters, all free ones by default."""
    return {name: explored.profile(name) for name in (explored.fit.free if names is None else names)}


def _box(fit: Fit) -> tuple[Vector, Vector]:
    """Centre and reach: the box is moved inward where a bound is nearer than its width."""
    relative = np.array([fit.information.standard_errors[name] for name in fit.free])
    reach = np.clip(ERRORS * np.nan_to_num(relative, nan=np.inf), NEAREST, FARTHEST)
    low, high = fit.space.low, fit.space.high
    reach = np.minimum(reach, 0.5 * (high - low))
    return np.clip(fit.theta, low + reach, high - reach), reach


def _interval(grid: np.ndarray, rise: np.ndarray, level: float) -> tuple[float, float]:
    """Where the rise crosses a level, by linear interpolation in log λ; nan at an end that is not reached."""
    lowest = int(np.argmin(rise))

    def crossing(places: np.ndarray, heights: np.ndarray) -> float:
        above = np.flatnonzero(heights > level)
        if not above.size:
            return float("nan")
        k = int(above[0])
        share = (level - heights[k - 1]) / (heights[k] - heights[k - 1])
        return float(np.exp(places[k - 1] + share * (places[k] - places[k - 1])))

    left = crossing(grid[: lowest + 1][::-1], rise[: lowest + 1][::-1])
    return left, crossing(grid[lowest:], rise[lowest:])
