"""Where a fit begins: the best of points all over the box; later the best along what the data do not see.

Points are compared by χ² with the screening covariance, after one simulation or a small ensemble each. Where conditions
have parameters of their own, a place is put together of points that suit each of them: few of some all over a box suit
all at once.
"""

from collections.abc import Callable

import numpy as np

from yeastfit.errors import SimulationError
from yeastfit.inference.fit.descent import Descent, are_different
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.information.result import Information
from yeastfit.inference.parameter_space import ParameterSpace, Points, Vector
from yeastfit.seeds import Stream, stream_of

ALONG = 3  # places along what is not seen, at least: ensembles of the first stage hardly tell them apart

PriorCosts = Callable[[Points], np.ndarray]
"""What Gaussian priors add to χ² at each point, by entry."""


def screened(ensembles: Ensembles, prior_costs: PriorCosts) -> list[Vector]:
    """The best of some low-discrepancy points of the box, apart from each other, after one simulation each.

    Raises:
        SimulationError: All simulations failed.
    """
    settings = ensembles.settings
    points = ensembles.space.sobol_points(settings.screened, stream_of(ensembles.seed, Stream.SCREENING, 0))
    rows = ensembles.single_simulations(points, Stream.SCREENING)
    chosen = _best(ensembles, prior_costs, points, rows, members=2, most=settings.starts)
    chosen = put_together(ensembles, prior_costs, points, rows, members=2, shared=chosen)
    if not chosen:
        met = "".join(f"; {problem}" for problem in ensembles.problems)
        raise SimulationError(
            f"{len(points)} simulations all over the box failed (not finite): look at the simulator, or "
            f"narrow the bounds{met}"
        )
    return chosen


def along_unseen(ensembles: Ensembles, prior_costs: PriorCosts, theta: Vector, known: Information) -> list[Vector]:
    """The best places elsewhere along the directions that the data do not see at θ, after a small ensemble each.

    A valley that is flat where a descent ended may have its minimum at another place. None where all is seen.
    """
    places = _places_along(theta, known.directions[known.blind], ensembles.space)
    places = [place for place in places if are_different(place, theta)]
    if not places:
        return []
    members, spread = ensembles.settings.members[0], ensembles.settings.spreads[0]
    models = ensembles.local_models(places, members, spread)
    missing = np.full(len(ensembles.values), np.nan)
    rows = np.stack([missing if isinstance(model, SimulationError) else model.mean for model in models])
    return _best(ensembles, prior_costs, np.stack(places), rows, members, max(ALONG, ensembles.settings.starts))


def put_together(
    ensembles: Ensembles,
    prior_costs: PriorCosts,
    points: Points,
    rows: np.ndarray,
    members: int,
    shared: list[Vector],
) -> list[Vector]:
    """Places with each condition's own parameters from the point that suits it best, from the second best, and so on.

    Arguments:
        ensembles: Data and space.
        prior_costs: Of points, by entry.
        points: θ.
        rows: Means at the points.
        members: That they are the means of.
        shared: As many places, which the shared parameters are taken from.
    """
    places = np.array(shared)
    costs = ensembles.screening_costs(rows, members)
    for condition, cost in zip(ensembles.targets, costs.T, strict=True):
        own = [k for k, entry in enumerate(ensembles.space.entries) if entry.condition == condition]
        if own and shared:
            best = _apart(points[:, own], cost + prior_costs(points)[:, own].sum(axis=1), len(places))
            places[:, own] = [best[min(k, len(best) - 1)] for k in range(len(places))]
    return list(places)


def put_ends_together(ensembles: Ensembles, prior_costs: PriorCosts, descents: list[Descent]) -> list[Vector]:
    """One place more, where the ends of the first stage suit each condition best; none if it is one of them."""
    alive = [(one.theta, one.model.mean, one.cost) for one in descents if one.model is not None]
    if not alive:
        return []
    points, rows, costs = (np.stack(each) for each in zip(*alive, strict=True))
    best = points[np.argmin(costs)]
    places = put_together(ensembles, prior_costs, points, rows, ensembles.settings.members[0], [best])
    return [place for place in places if all(are_different(place, other) for other in points)]


def _best(
    ensembles: Ensembles, prior_costs: PriorCosts, points: Points, rows: np.ndarray, members: int, most: int
) -> list[Vector]:
    """At most so many places, priors included in their cost."""
    cost = ensembles.screening_costs(rows, members).sum(axis=1) + prior_costs(points).sum(axis=1)
    return _apart(points, cost, most)


def _apart(points: Points, cost: np.ndarray, most: int) -> list[Vector]:
    """The best, at most so many, apart from each other; those that failed are none."""
    ranked = points[np.argsort(np.where(np.isfinite(cost), cost, np.inf))][: int(np.isfinite(cost).sum())]
    chosen: list[Vector] = []
    for point in ranked:
        if len(chosen) < most and all(are_different(point, other) for other in chosen):
            chosen.append(point)
    return chosen


def _places_along(theta: Vector, directions: np.ndarray, space: ParameterSpace) -> list[Vector]:
    """Places of the box on the lines through θ, where the fastest entry changes by factors of two."""
    found = []
    for direction in directions:
        step = np.log(2.0) * direction / np.abs(direction).max()
        for towards in (step, -step):
            place = theta + towards
            while (place > space.low).all() and (place < space.high).all():
                found.append(place)
                place = place + towards
    return found
