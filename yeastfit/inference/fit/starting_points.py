"""Where a fit begins: the best of points all over the box; later the best along what the data do not see.

Points are compared by χ² with the screening covariance, after one simulation or a small ensemble each. Where conditions
have parameters of their own, the best of each condition make one place more.
"""

from collections.abc import Callable

import numpy as np

from yeastfit.errors import SimulationError
from yeastfit.inference.fit.descent import are_different
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.information.result import Information
from yeastfit.inference.parameter_space import ParameterSpace, Points, Vector
from yeastfit.seeds import Stream, stream_of

ALONG = 3  # places along what is not seen, at least: ensembles of the first stage hardly tell them apart

PriorCost = Callable[[Points], np.ndarray]
"""What Gaussian priors add to χ² at each point."""


def screened(ensembles: Ensembles, prior_cost: PriorCost) -> list[Vector]:
    """The best of some low-discrepancy points of the box, apart from each other, after one simulation each.

    Raises:
        SimulationError: All simulations failed.
    """
    settings = ensembles.settings
    points = ensembles.space.sobol_points(settings.screened, stream_of(ensembles.seed, Stream.SCREENING, 0))
    rows = ensembles.single_simulations(points, Stream.SCREENING)
    chosen = _best(ensembles, prior_cost, points, rows, members=2, most=settings.starts)
    place = best_of_each(ensembles, points, rows, members=2) if chosen else None
    if place is not None and all(are_different(place, other) for other in chosen):
        chosen.append(place)
    if not chosen:
        met = "".join(f"; {problem}" for problem in ensembles.problems)
        raise SimulationError(
            f"{len(points)} simulations all over the box failed (not finite): look at the simulator, or "
            f"narrow the bounds{met}"
        )
    return chosen


def along_unseen(ensembles: Ensembles, prior_cost: PriorCost, theta: Vector, known: Information) -> list[Vector]:
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
    return _best(ensembles, prior_cost, np.stack(places), rows, members, max(ALONG, ensembles.settings.starts))


def best_of_each(ensembles: Ensembles, points: Points, rows: np.ndarray, members: int) -> Vector | None:
    """Each condition's own parameters from the point that suits it best, the shared ones from the best point of all.

    A point may suit one condition and not another, and those that suit all are rare among some all over a box.

    Arguments:
        ensembles: Data and space.
        points: θ.
        rows: Means at the points.
        members: That they are the means of.

    Returns:
        None where nothing is a condition's own.
    """
    conditions, entries = list(ensembles.targets), ensembles.space.entries
    if all(entry.condition is None for entry in entries):
        return None
    costs = ensembles.screening_costs(rows, members)
    costs[~np.isfinite(costs).all(axis=1)] = np.inf
    best, best_of = np.argmin(costs.sum(axis=1)), np.argmin(costs, axis=0)
    chosen = [best if one.condition is None else best_of[conditions.index(one.condition)] for one in entries]
    return points[chosen, np.arange(len(entries))]


def _best(
    ensembles: Ensembles, prior_cost: PriorCost, points: Points, rows: np.ndarray, members: int, most: int
) -> list[Vector]:
    """At most so many, apart from each other; those that failed are none."""
    cost = ensembles.screening_costs(rows, members).sum(axis=1) + prior_cost(points)
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
