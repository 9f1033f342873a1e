"""Limits around data: colonies that are simulated beyond them count like failed ones in a likelihood that is learnt.

Let A be a box that holds all colonies o_r of the data. Whatever A is,

    p(o_r | λ) = P(s ∈ A | λ) p(o_r | s ∈ A, λ).

The second factor is what networks learn as a normal distribution, and the first is a probability that they learn
besides, like that of failure (`neural_likelihood.emulator`). Without limits, rare colonies far from all others decide
what mean and scatter are: of off-lattice colonies one in a hundred has an I_R of 1 to 20 where real ones have 0.2, and
where such ones occur the scatter that is learnt from them makes any data likely. Within limits they count as what they
are, colonies unlike the data.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError

BEYOND = 3.0
"""Ranges of the data by which limits lie beyond them."""

Limits = Float[np.ndarray, "statistic 2"]


def limits_around(colonies: Float[np.ndarray, "colony statistic"]) -> Limits | None:
    """Least and largest value of each statistic, `BEYOND` times the colonies' range beyond them; None of one colony.

    Values that were not measured are nan. A statistic that is the same in all colonies has no limits.
    """
    if len(colonies) < 2:
        return None
    low, high = np.nanmin(colonies, axis=0), np.nanmax(colonies, axis=0)
    reach = np.where(high > low, BEYOND * (high - low), np.inf)
    return np.stack([low - reach, high + reach], axis=1)


def check_limits(limits: Limits, colonies: Float[np.ndarray, "colony statistic"], labels: Sequence[str]) -> None:
    """Raise `InputError` where these are no limits around colonies, or their means, of as many statistics."""
    if limits.shape != (len(labels), 2):
        raise InputError(f"limits have shape {limits.shape}, two for each of {len(labels)} statistics are expected")
    low, high = np.nanmin(colonies, axis=0), np.nanmax(colonies, axis=0)
    for k, label in enumerate(labels):
        if not limits[k, 0] < low[k] <= high[k] < limits[k, 1]:
            raise InputError(
                f"limits of {label} are {limits[k, 0]:g} and {limits[k, 1]:g}, all data must lie between them: they "
                f"are from {low[k]:g} to {high[k]:g}"
            )
        if np.isfinite(limits[k]).sum() == 1:
            raise InputError(
                f"limits of {label} are {limits[k, 0]:g} and {limits[k, 1]:g}: give two numbers, or −inf and inf"
            )


def within(statistics: Float[np.ndarray, "row statistic"], limits: Limits | None) -> Float[np.ndarray, "row statistic"]:
    """The rows, nan throughout where one of their values is not between the limits; all of them without limits."""
    if limits is None:
        return statistics
    inside = np.all((statistics > limits[:, 0]) & (statistics < limits[:, 1]), axis=1, keepdims=True)
    return np.where(inside, statistics, np.nan)
