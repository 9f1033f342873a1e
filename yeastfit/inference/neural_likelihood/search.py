"""Find where simulations are like the data, before there are enough of them to learn from.

Of simulations from a wide prior hardly any may lie within the limits around the data (`posterior.limits`). Until an
emulator has as many as it needs, n, further ones are made around the n that are nearest the data, with the width
√(w² − 1) = 1 times theirs (`training_rounds.proposed`): a population Monte Carlo (Beaumont et al. 2009,
doi:10.1093/biomet/asp052) that ends as soon as rounds can begin. They are simulations like all others, as the
likelihood is what is learnt. How far a simulation s is from the data is

    max_k |s_k − m_k| / h_k

with m_k in the middle of the limits of statistic k and h_k half of what lies between them: up to 1 within.
"""

import numpy as np
from jaxtyping import Float

from yeastfit.inference.posterior.limits import Limits, within

WIDEN = 2**0.5

Statistics = Float[np.ndarray, "row statistic"]


def nearest(
    x: Float[np.ndarray, "row free"], statistics: Statistics, limits: Limits | None, count: int
) -> Float[np.ndarray, "near free"] | None:
    """The simulations nearest the data, in the prior's coordinates, for proposals around them.

    Arguments:
        x: Of the simulations.
        statistics: Of the simulations; nan where one failed.
        limits: Around the data.
        count: How many simulations within the limits are enough.

    Returns:
        As many rows; None where nothing is to be looked for: without limits, where enough simulations are within
        them, or where most failed.
    """
    there = np.isfinite(statistics).all(axis=1)
    if limits is None or np.isfinite(within(statistics, limits)).all(axis=1).sum() >= count or there.sum() < count:
        return None
    bounded = np.isfinite(limits).all(axis=1)
    off = statistics[:, bounded] - limits[bounded].mean(axis=1)
    distance = np.abs(off / (np.ptp(limits[bounded], axis=1) / 2)).max(axis=1)
    return x[np.argsort(np.where(there, distance, np.inf), kind="stable")[:count]]
