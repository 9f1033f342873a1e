"""An emulator's share of error, and why a posterior that has settled has a small one.

The emulator's mean has an error of covariance E, and the log probability that one replicate succeeds, of variance v
(`emulator`). With V the covariance that n statistics are compared with, V^(−1/2) (o − m) ~ N(0, 1), and R replicates,
the log-likelihood has an error of variance tr V⁻¹E + R² v to first order; over n, that is

    share = (tr V⁻¹E + R² v) / n.

A single statistic whose error is the share s of its variance moves a parameter that it determines by √s standard
deviations, and one that the prior determines as well by less. So settle² allows for moves of `settle`.

**Both criteria agree** as long as errors come from the simulations. Estimates from N and from N + k of them, k new,
differ by what the new ones add: the variance of the difference is that of the former less that of the latter (Hausman
1978, doi:10.2307/1913827), here share · k / N of a parameter's own. With a share of settle² and k = N / 7, a parameter
moves by 0.38 settle, and the largest of three quantiles of five parameters, some twice that, stays below `settle`. What
networks make of their starts and batches by chance is another matter: it differs from round to round in full, and must
be less than an eighth of settle² for the move to stay below `settle`. Hence more networks where there are more
parameters (`TrainingSettings.resolved`).
"""

import numpy as np
from jaxtyping import Float

from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.places import Places


def error_share(
    emulator: Emulator,
    problem: Problem,
    places: Float[np.ndarray, "1 free"] | Places[np.ndarray],
) -> float:
    """The share at one λ.

    Arguments:
        emulator: Of the likelihood.
        problem: Whose data it is compared with.
        places: λ, or where colonies of it are.
    """
    _, scatter, error, _ = emulator.moments(places)
    one = scatter[0] + (0.0 if problem.single_noise is None else problem.single_noise)
    total = one / problem.replicates + error[0] + (0.0 if problem.noise is None else problem.noise)
    of_success = problem.replicates**2 * emulator.success_error(places)[0]
    return float((np.trace(np.linalg.solve(total, error[0])) + of_success) / len(total))
