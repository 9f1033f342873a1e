"""One round of the sequential emulator: its chains, proposals for the next one, and draws that lie far off."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import chi2

from yeastfit.errors import InputError
from yeastfit.inference.neural_likelihood.coordinates import Values
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.log_posterior import Ellipsoid
from yeastfit.inference.neural_likelihood.mcmc import Chains, Walk
from yeastfit.inference.posterior.robust_summary import covariance_of_most, far_off
from yeastfit.inference.prior.prior import Prior

LARGEST_ERROR = 0.3  # of the variance of the data, above which the emulator's error is warned of
FEW = 0.01  # of the draws, above which outlying ones are warned of
NEAR = 0.99  # of draws so many times as wide as the posterior with its trail lie in its neighbourhood
LOCAL = 1.6  # times as wide as proposals is the neighbourhood that a posterior is learnt in, once it is found
FOUND = 1.0  # standard deviations: a posterior that moved less is found
STRAY = 0.05  # of the draws at most lie outside the proposals of the round before where a posterior is found
OUTSIDE = 1e-3  # of the draws at most lie outside the neighbourhood that an emulator is restricted to
TRIES = 100  # times that draws outside the prior are repeated

Simulated = tuple[Float[np.ndarray, "_ free"], Float[np.ndarray, "_ statistic"]]


@dataclass(frozen=True)
class Neighbourhood:
    """Where draws of this mean and covariance lie, in the prior's coordinates.

    Attributes:
        mean: Of the draws.
        covariance: Of the draws.
    """

    mean: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]

    @staticmethod
    def of(
        draws: Float[np.ndarray, "draw free"],
        colonies: Float[np.ndarray, "draw free"],
        widen: float,
        weights: Float[np.ndarray, " draw"] | None = None,
    ) -> "Neighbourhood":
        """That of which w times the width is the width of proposals (`proposed`), all draws of a weight by default.

        The covariance is (cov(colonies) + (w² − 1) cov(draws)) / w²: that of the draws where colonies are these.
        """
        own, scattered = (np.atleast_2d(np.cov(one, rowvar=False, aweights=weights)) for one in (draws, colonies))
        return Neighbourhood(np.average(colonies, axis=0, weights=weights), own + (scattered - own) / widen**2)

    def holds(self, x: Float[np.ndarray, "row free"], widen: float) -> Bool[np.ndarray, " row"]:
        """Which rows lie where `NEAR` of normal draws do that are w times as wide."""
        return self.ellipsoid(widen)(x)

    def ellipsoid(self, widen: float) -> Ellipsoid:
        """Where `NEAR` of normal draws lie that are w times as wide."""
        whitening = np.linalg.inv(np.linalg.cholesky(self.covariance)).T
        return Ellipsoid(self.mean, whitening, np.asarray(widen**2 * chi2.ppf(NEAR, len(self.mean))))

    def surrounds(self, draws: Float[np.ndarray, "draw free"], widen: float) -> bool:
        """Whether nearly all draws lie where proposals from it do."""
        return 1.0 - float(self.holds(draws, widen).mean()) <= STRAY

    def kept_to(
        self, draws: Float[np.ndarray, "draw free"], simulations: Values, widen: float, least: int
    ) -> Ellipsoid | None:
        """The neighbourhood to which an emulator may be restricted; None where it should not be.

        Arguments:
            draws: Of the posterior, nearly all of which must lie in it.
            simulations: Of which so many must.
            widen: Of proposals.
            least: That many.
        """
        known = self.ellipsoid(LOCAL * widen)
        outside = 1.0 - float(known(draws).mean())
        return known if outside <= OUTSIDE and known(simulations).sum() >= least else None


@dataclass(frozen=True)
class Round:
    """One round's emulator and chains.

    Attributes:
        emulator: Trained on all simulations so far.
        walk: Can make the chains longer.
        chains: On its posterior.
        draws: Of the chains as long as they are between rounds, in the prior's coordinates, without z.
        colonies: One of each of these draws (`Problem.scattered`).
        neighbourhood: Where the emulator must be right.
        moved: How far `apart` the posterior is from that of the round before, in the parameter that moved most.
        error_share: The emulator's share of error at the mean (`error_share`).
        simulations: So far, those of other runs included.
        found: Whether the posterior is about where it was, or where proposals were made.
    """

    emulator: Emulator
    walk: Walk
    chains: Chains
    draws: Float[np.ndarray, "draw free"]
    colonies: Float[np.ndarray, "draw free"]
    neighbourhood: Neighbourhood
    moved: float
    error_share: float
    simulations: int
    found: bool

    def settled(self, settle: float) -> bool:
        """Whether neither the posterior's move nor the emulator's error is too large (`sequential`)."""
        return self.moved <= settle and self.error_share <= settle**2


def together(own: Simulated, reused: Simulated) -> Simulated:
    """Parameters and statistics of a run's own simulations and of reused ones, each once."""
    known = {row.tobytes() for row in np.column_stack(own)}
    new = np.array([row.tobytes() not in known for row in np.column_stack(reused)], dtype=bool)
    values, statistics = (np.concatenate([mine, others[new]]) for mine, others in zip(own, reused, strict=True))
    return values, statistics


def proposed(
    draws: Float[np.ndarray, "draw free"],
    colonies: Float[np.ndarray, "draw free"],
    count: int,
    widen: float,
    prior: Prior,
    admits: Callable[[Values], Bool[np.ndarray, " row"]],
    rng: np.random.Generator,
) -> Float[np.ndarray, "count free"]:
    """Proposals around colonies of the posterior's draws, in the prior's coordinates.

    They are x + √(w² − 1) ξ, x a colony and ξ as wide as the bulk of the draws: w times as wide as the draws, where
    colonies do not scatter. The draw, moved by as much, stays in the prior; the colony may leave it.

    Arguments:
        draws: In the prior's coordinates.
        colonies: One of each draw.
        count: How many proposals.
        widen: w.
        prior: Of λ.
        admits: Which λ colonies may have (`Problem.admits`).
        rng: Where randomness comes from.

    Raises:
        InputError: Hardly any proposal lies in the prior.
    """
    root = np.sqrt(widen**2 - 1.0) * np.linalg.cholesky(covariance_of_most(draws))
    proposals = np.zeros((0, draws.shape[1]))
    for _ in range(TRIES):
        which = rng.integers(len(colonies), size=count)
        move = rng.standard_normal((count, draws.shape[1])) @ root.T
        x = colonies[which] + move
        inside = np.isfinite(prior.log_density_of_coordinates(draws[which] + move))
        proposals = np.concatenate([proposals, x[inside & admits(prior.values(x))]])
        if len(proposals) >= count:
            return proposals[:count]
    raise InputError(f"widen is {widen:g}: with it hardly a draw lies in the prior, lower it")


def unsettled(last: Round, settle: float, simulations: int, settled: bool) -> list[str]:
    """Warnings of a posterior that has not settled, and of an emulator whose error widens it.

    Arguments:
        last: The last round.
        settle: Largest change that counts as settled.
        simulations: That were made.
        settled: Whether it has.
    """
    share, warnings = last.error_share, list[str]()
    if not settled:
        moved = f"it moved by {last.moved:.2f} standard deviations in the last round, {settle:g} is wanted"
        if np.isinf(last.moved):
            moved = "whether one round more would move it is not known"
        warnings.append(
            f"the posterior has not settled: {moved}, the emulator's error is {100 * share:.1f} % of the variance "
            f"of the data, {100 * settle**2:g} % is wanted; {simulations} simulations were allowed: allow more"
        )
    if share > LARGEST_ERROR:
        warnings.append(
            f"the emulator's error is {100 * share:.0f} % of the variance of the data and widens the posterior: "
            "more simulations narrow it"
        )
    return warnings


def far_draws(
    draws: Float[np.ndarray, "draw free"], before: Float[np.ndarray, "draw2 free"] | None, prior: Prior
) -> list[str]:
    """A warning of outlying draws: their fraction in the last round and the one before, and where they lie.

    Arguments:
        draws: Of the last round, in the prior's coordinates.
        before: Of the round before, where there was one.
        prior: Of the parameters.
    """
    far = far_off(draws, draws)
    if far.mean() < FEW:
        return []
    low, high = prior.values(np.quantile(draws[far], [0.05, 0.95], axis=0)).tolist()
    where = ", ".join(f"{name} {a:.3g} to {b:.3g}" for name, a, b in zip(prior.free, low, high, strict=True))
    then = "" if before is None else f", {100 * far_off(before, draws).mean():.1f} % did in the round before"
    return [
        f"{100 * far.mean():.1f} % of the draws lie far from the others ({where}){then}: how many do is the least "
        "certain part of a posterior, and so are quantiles that reach there"
    ]
