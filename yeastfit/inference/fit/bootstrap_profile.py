"""Errors of a fit beyond its covariance: a bootstrap over replicates, and profiles of the likelihood.

Both take hundreds of fits. They are made on a response surface around the estimate (`response_surface`), from fine
simulations of its own, with the fit's Σ. Its box reaches `REACH` standard errors from the estimate, at least `NEAREST`
and at most `FARTHEST` in log λ, and not beyond the bounds: what lies at its edge is reported as such.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from yeastfit.errors import InputError
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.response_surface import Minima, ResponseSurface, fewest_runs, response_surface
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.simulators import Simulators, colony_simulators, given_simulators
from yeastfit.inference.parameter_space import Vector
from yeastfit.inference.simulator import Simulator
from yeastfit.kinds import check_kind, check_list
from yeastfit.memory import check_count
from yeastfit.model.model import Model
from yeastfit.numbers import AT_LEAST_ONE
from yeastfit.seeds import Stream, stream_of

RUNS = 512  # simulations around an estimate
REACH = 3.5  # standard errors: 1 draw of a bootstrap in 2000 lies beyond
NEAREST = 0.1  # of log λ, the spread of the last stage's pairs: nearer, Monte-Carlo errors hide the slopes
FARTHEST = 0.7  # of log λ, a factor of 2: farther, curves are not quadratic
AT_EDGE = 0.98  # of the box's half width
LEVELS = {"68%": 1.0, "95%": 3.84}  # rises of χ² for one parameter (Wilks 1938, doi:10.1214/aoms/1177732360)


@dataclass(frozen=True)
class Bootstrap:
    """Estimates from replicates drawn with replacement.

    Attributes:
        free: Names of the entries.
        values: λ.
        log_standard_errors: Standard deviation of log λ, by entry.
        intervals: 95 %, by percentiles of λ.
        at_edge: Share of the draws that ended at the edge of the surface: then errors are too small.
        unconverged: Fits that ran into their limit of steps.
        simulations: Made for the surface.
    """

    free: tuple[str, ...]
    values: Float[np.ndarray, "draw entry"]
    log_standard_errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    at_edge: float
    unconverged: int
    simulations: int


@dataclass(frozen=True)
class Profile:
    """χ² with one parameter held and the others at their best.

    Attributes:
        name: Of the entry.
        estimate: λ where χ² is least.
        log_standard_error: Of log λ, from the covariance.
        values: λ.
        rise: Of χ² above its least.
        intervals: Of λ, all values whose rise is below `LEVELS` and what lies between them; nan for an end that the
            surface does not reach.
        unconverged: Fits that ran into their limit of steps.
    """

    name: str
    estimate: float
    log_standard_error: float
    values: Float[np.ndarray, " point"]
    rise: Float[np.ndarray, " point"]
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    unconverged: int = 0

    @property
    def doubts(self) -> list[str]:
        """What speaks against its intervals, in words."""
        least, inside = int(np.argmin(self.rise)), self.rise <= LEVELS["95%"]
        found = []
        if least in (0, len(self.rise) - 1):
            found.append(f"the profile of {self.name} is lowest where the surface ends, at {self.values[least]:.4g}")
        if np.diff(np.flatnonzero(inside)).max(initial=1) > 1:
            found.append(f"the profile of {self.name} has several valleys: its interval holds values that fit worse")
        if np.interp(np.log(self.estimate), np.log(self.values), self.rise) > LEVELS["95%"]:
            found.append(f"the fitted {self.name}, {self.estimate:.4g}, lies outside of what its profile accepts")
        return found


@dataclass(frozen=True)
class Explored:
    """A fit with the surface around it.

    Attributes:
        fit: The fit.
        surface: Around its estimate.
        simulations: Made for that.
    """

    fit: Fit
    surface: ResponseSurface
    simulations: int

    def bootstrap(self, draws: int = 500, seed: int = 0) -> Bootstrap:
        """Fit resampled replicates.

        Arguments:
            draws: Fits.
            seed: Of the draws.

        Raises:
            InputError: Single replicates are not known, or only one, or there are fewer than two draws.
        """
        rng, free = np.random.default_rng(stream_of(seed, Stream.BOOTSTRAP, 0)), self.fit.free
        if draws < 2:
            raise InputError(f"draws is {draws}, a bootstrap needs at least 2")
        check_count("draws", draws)
        targets = [each.targets for each in self.fit.conditions]
        samples = np.stack([np.concatenate([each.resampled(rng) for each in targets]) for _ in range(draws)])
        found = self._minimise(samples)
        low, high = np.percentile(np.exp(found.theta), (2.5, 97.5), axis=0)
        away = np.abs(found.theta - self.surface.centre) > AT_EDGE * self.surface.reach
        return Bootstrap(
            free,
            np.exp(found.theta),
            dict(zip(free, found.theta.std(axis=0, ddof=1).tolist(), strict=True)),
            dict(zip(free, zip(low.tolist(), high.tolist(), strict=True), strict=True)),
            float(away.any(axis=1).mean()),
            int((~found.converged).sum()),
            self.simulations,
        )

    def profile(self, name: str, points: int = 41) -> Profile:
        """Profile χ² over the width of the surface.

        Arguments:
            name: Of an entry.
            points: At which it is held.

        Raises:
            InputError: The name is not free.
        """
        if name not in self.fit.free:
            raise InputError(f"profile of {name!r}, which is not free: {', '.join(self.fit.free)} are")
        k, surface = self.fit.free.index(name), self.surface
        data = np.concatenate([each.targets.values for each in self.fit.conditions])
        best = self._minimise(data[None])
        theta = best.theta[0]
        grid = np.unique(np.append(surface.centre[k] + surface.reach[k] * np.linspace(-1, 1, points), theta[k]))
        found = self._minimise(np.tile(data, (len(grid), 1)), held=(k, grid))
        least = min(float(best.chi_square[0]), float(found.chi_square.min()))
        rise = np.maximum(found.chi_square - least, 0.0)
        intervals = {label: _interval(grid, rise, level) for label, level in LEVELS.items()}
        error, unconverged = self.fit.log_standard_errors[name], int((~found.converged).sum())
        return Profile(name, float(np.exp(theta[k])), error, np.exp(grid), rise, intervals, unconverged)

    def _minimise(self, values: Float[np.ndarray, "fit observable"], held: tuple[int, Vector] | None = None) -> Minima:
        sigma = block_diag(*(each.covariance for each in self.fit.conditions))
        priors = [self.fit.prior.get(name, (0.0, np.inf)) for name in self.fit.free]
        centre, width = np.array(priors).T
        return self.surface.minimise(np.linalg.cholesky(sigma), values, centre=centre, pull=1.0 / width, held=held)


def explore(
    fit: Fit,
    simulator: Simulator | Mapping[str, Simulator] | None = None,
    *,
    fine: Simulator | Mapping[str, Simulator] | None = None,
    runs: int | None = None,
) -> Explored:
    """Simulate around a fit's estimate, for `Explored.bootstrap` and `Explored.profile`. Same fit, same result.

    Arguments:
        fit: The fit.
        simulator: That the fit was made with, where one was handed in.
        fine: Likewise.
        runs: Simulations of each condition; by default 512, or as many as the parameters need.

    Returns:
        The fit with a response surface around its estimate.

    Raises:
        InputError: The fit is of a simulator that is not given, or there are too few runs.
        SimulationError: Most simulations failed.
    """
    check_kind("fit", fit, Fit, "the result of yeastfit.fit(…)")
    targets = {each.name: each.targets for each in fit.conditions}
    both = _colonies_of(fit) if simulator is None else given_simulators(targets, simulator, fine)
    finer = both[1] if fit.settings.refined else {}
    ensembles = Ensembles(targets, both[0], fit.space, fit.seed, fit.settings, finer)
    simulate = partial(ensembles.single_simulations, stream=Stream.SURFACE, refined=True)
    default = max(RUNS, fewest_runs(len(fit.space.entries)))
    runs = default if runs is None else AT_LEAST_ONE.read_whole(runs, "runs")
    surface = response_surface(simulate, *_box(fit), runs, stream_of(fit.seed, Stream.SURFACE, 1))
    return Explored(fit, surface, ensembles.tally.simulated)


def profiles(explored: Explored, names: Sequence[str] | None = None) -> dict[str, Profile]:
    """Profile several parameters.

    Arguments:
        explored: A fit with the surface around it.
        names: Of the parameters; by default of all free ones.

    Returns:
        Profiles by name.

    Raises:
        InputError: A name is not free.
    """
    check_kind("explored", explored, Explored, "the result of yeastfit.explore(…)")
    check_list("names", names)
    return {name: explored.profile(name) for name in (explored.fit.free if names is None else names)}


def _colonies_of(fit: Fit) -> tuple[Simulators, Simulators]:
    """Coarse and fine simulators of a fit of colonies."""
    if fit.resolutions is None:
        raise InputError("simulator is missing: this fit is of one that was handed in, give it here, too")
    free = dict.fromkeys(entry.parameter for entry in fit.space.entries)
    targets = {each.name: each.targets for each in fit.conditions}
    values = {each.name: each.parameters for each in fit.conditions}
    return colony_simulators(targets, tuple(free), values, fit.resolutions, Model.of(fit.rules or {}))


def _box(fit: Fit) -> tuple[Vector, Vector]:
    """Centre and reach: the box is moved inward where a bound is nearer than its width."""
    relative = np.array([fit.log_standard_errors[name] for name in fit.free])
    reach = np.clip(REACH * np.nan_to_num(relative, nan=np.inf), NEAREST, FARTHEST)
    low, high = fit.space.low, fit.space.high
    reach = np.minimum(reach, 0.5 * (high - low))
    return np.clip(fit.theta, low + reach, high - reach), reach


def _interval(grid: np.ndarray, rise: np.ndarray, level: float) -> tuple[float, float]:
    """Least and largest value whose rise is not above a level, values between them included whatever theirs is.

    Ends are interpolated linearly in log λ; nan at one that is not reached.
    """

    def first(places: np.ndarray, heights: np.ndarray) -> float:
        k = int(np.argmax(heights <= level))
        if k == 0:  # the first of all, or none
            return float("nan")
        share = (level - heights[k - 1]) / (heights[k] - heights[k - 1])
        return float(np.exp(places[k - 1] + share * (places[k] - places[k - 1])))

    return first(grid, rise), first(grid[::-1], rise[::-1])
