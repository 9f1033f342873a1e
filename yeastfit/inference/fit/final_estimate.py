"""From the last stage of a fit to its estimate: the minimum of the affine function, and whether the fit converged."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from yeastfit.inference.curve_covariance import Square
from yeastfit.inference.fit.result import Condition, FitStatus
from yeastfit.inference.information.result import Information
from yeastfit.inference.parameter_space import ParameterSpace, Vector
from yeastfit.inference.simulator import Simulator, named_values
from yeastfit.inference.targets import Targets

FARTHEST = 0.5  # of log λ: the longest last step; the affine function is known over the spread of the pairs, 0.1


def last_step(
    known: Information,
    residuals: Float[np.ndarray, " row"],
    jacobian: Float[np.ndarray, "row free"],
    count: int,
    theta: Vector,
    space: ParameterSpace,
) -> Vector:
    """Step to the minimum of the affine function, in the directions that are seen, not far and inside the bounds.

    Where the data see nothing, their gradient is noise, and must not pull against a prior.

    Arguments:
        known: Information at θ.
        residuals: At θ, of variance 1; the data's, then the priors'.
        jacobian: Their derivatives in θ.
        count: How many of them are the data's.
        theta: θ.
        space: Its bounds.
    """
    _, rows = known.significant
    data = rows.T @ (rows @ (jacobian[:count].T @ residuals[:count]))
    gradient = -data - jacobian[count:].T @ residuals[count:]
    seen = known.eigenvalues > 0
    rows = known.directions[seen]
    step = rows.T @ (rows @ gradient / known.eigenvalues[seen])
    step *= min(1.0, FARTHEST / max(np.abs(step).max(), 1e-12))
    return np.clip(theta + step, space.low, space.high) - theta


def verdict(converged: bool, ended: str, failed: bool, away: Vector, known: Information) -> tuple[FitStatus, str]:
    """Status of a fit, and its detail.

    Where the optimiser did not say that it converged, the fit has if the estimate, which all ensembles near its last
    point make together, is within one standard error of that point.

    Arguments:
        converged: Whether the best descent's last stage did.
        ended: How it ended, in words.
        failed: Whether the optimiser failed.
        away: From that point to the estimate.
        known: Information.
    """
    if converged:
        return FitStatus.CONVERGED, ""
    apart = float(np.sqrt(away @ known.matrix @ away))
    if apart < 1 and not failed:
        return FitStatus.WITHIN_NOISE, ended
    return FitStatus.NOT_CONVERGED, f"{ended}, and the estimate is {apart:.1f} standard errors from the last point"


def conditions(
    space: ParameterSpace,
    targets: Mapping[str, Targets],
    simulators: Mapping[str, Simulator],
    theta: Vector,
    fitted: Float[np.ndarray, " observable"],
    sigma: Square,
) -> tuple[Condition, ...]:
    """Each condition's part of the result.

    Arguments:
        space: Of the free parameters.
        targets: By condition.
        simulators: Likewise.
        theta: The estimate.
        fitted: Means there of all measured values, condition by condition.
        sigma: Σ of these.
    """
    found, first = list[Condition](), 0
    for name, one in targets.items():
        here = slice(first, first + len(one.values))
        table = np.full(one.mean.shape, np.nan)
        table[one.measured] = fitted[here]
        parameters = named_values(simulators[name], space.values(name, theta[None])[0])
        found.append(Condition(name, one, parameters, table, sigma[here, here]))
        first = here.stop
    return tuple(found)
