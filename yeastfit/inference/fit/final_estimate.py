"""From the last stage of a fit to its estimate: the minimum of the affine function, and whether the fit converged."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from yeastfit.inference.fit.result import Condition
from yeastfit.inference.information.result import Information
from yeastfit.inference.paired_regression import CurveSquare
from yeastfit.inference.parameter_space import Space, Vector
from yeastfit.inference.targets import Targets

FARTHEST = 0.5  # of log λ: the longest last step


def last_step(
    known: Information,
    residuals: Float[np.ndarray, " row"],
    jacobian: Float[np.ndarray, "row free"],
    count: int,
    theta: Vector,
    space: Space,
) -> Vector:
    """To the minimum of the affine function, in the directions that are seen, not far and inside the bounds.

    residuals, jacobian: at θ, of variance 1; the first `count` rows are the data's, the others the priors'. Where the
    data see nothing, their gradient is noise, and must not pull against a prior.
    """
    _, told = known.told_apart
    data = told.T @ (told @ (jacobian[:count].T @ residuals[:count]))
    gradient = -data - jacobian[count:].T @ residuals[count:]
    seen = known.eigenvalues > 0
    rows = known.directions[seen]
    step = rows.T @ (rows @ gradient / known.eigenvalues[seen])
    step *= min(1.0, FARTHEST / max(np.abs(step).max(), 1e-12))
    return np.clip(theta + step, space.low, space.high) - theta


def verdict(ended: str, failed: bool, away: Vector, known: Information) -> tuple[bool, str]:
    """Whether the fit converged, and how it ended in words.

    ended, failed: the best run's. Where the optimiser did not say so, it has if the estimate, which all ensembles near
    its last point make together, is within one standard error of that point, `away` from it.
    """
    if ended == "converged":
        return True, ended
    apart = float(np.sqrt(away @ known.matrix @ away))
    if apart < 1 and not failed:
        return True, f"converged within the noise of the ensemble: {ended}"
    return False, f"not converged: {ended}, and the estimate is {apart:.1f} standard errors from the last point"


def conditions(
    space: Space,
    targets: Mapping[str, Targets],
    theta: Vector,
    fitted: Float[np.ndarray, " curve"],
    sigma: CurveSquare,
) -> tuple[Condition, ...]:
    """Each condition's part of the result. fitted, sigma: of all measured values, condition by condition."""
    parameters, found, first = space.parameters(theta), list[Condition](), 0
    for name, one in targets.items():
        here = slice(first, first + len(one.values))
        table = np.full(one.mean.shape, np.nan)
        table[one.measured] = fitted[here]
        found.append(Condition(name, one, parameters[name], table, sigma[here, here]))
        first = here.stop
    return tuple(found)
