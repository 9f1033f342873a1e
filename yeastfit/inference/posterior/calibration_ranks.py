"""Where true parameters lie in posteriors of data simulated at them: simulation-based calibration.

A true λ is drawn from a distribution, data are simulated at it, and a posterior is inferred from the data. Where
posteriors are right, the truth is distributed like one more draw of its own posterior: of L independent draws, the
number below the truth is uniform on 0..L (Talts et al. 2018, arXiv:1804.06788). Single parameters may be right while
their joint posterior is not. For all of them together, a point r is drawn at random, and the draws nearer to r than the
truth are counted, which is uniform on 0..L, too (TARP; Lemos, Coogan, Hezaveh & Perreault-Levasseur 2023,
arXiv:2302.03026). Distances are Euclidean in the prior's cumulative probabilities, and r is uniform there: a few lines,
so that the package `tarp`, which takes no weighted draws and as many draws for each data set, is not needed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import binomtest

from yeastfit.inference.posterior.draws import Draws
from yeastfit.inference.prior.prior import Prior

JOINT = "joint"
LEVELS = (0.5, 0.9)


@dataclass(frozen=True, eq=False)
class Calibration:
    """Ranks of true parameters in their posteriors.

    Attributes:
        free: Names of the parameters.
        truths: λ of each data set.
        ranks: How many of the draws lie below the truth, parameter by parameter.
        joint_ranks: How many of the draws lie nearer to a random point than the truth.
        draws: L, the number of draws that a truth is ranked among.
        near: Whether truths were drawn from the posterior of observed data.
        warned: Data sets whose posterior came with warnings.
        failed: Why there is no posterior of further data sets, in words.
    """

    free: tuple[str, ...]
    truths: Float[np.ndarray, "set free"]
    ranks: Int[np.ndarray, "set free"]
    joint_ranks: Int[np.ndarray, " set"]
    draws: int
    near: bool = False
    warned: int = 0
    failed: tuple[str, ...] = ()

    def shares(self) -> dict[str, Float[np.ndarray, " set"]]:
        """(rank + ½) / (L + 1) of each parameter by name, and of all together (`joint`): uniform in 0..1."""
        columns = np.column_stack([self.ranks, self.joint_ranks])
        return dict(zip((*self.free, JOINT), (columns.T + 0.5) / (self.draws + 1), strict=True))

    def rows(self) -> list[dict[str, Any]]:
        """Rows of a table: the share of truths inside intervals of 50 and 90 %, with 95 % (Wilson) intervals.

        For `joint` they are the regions nearest to the random points.
        """
        rows = []
        for name, share in self.shares().items():
            row: dict[str, Any] = {"quantity": name}
            for level in LEVELS:
                inside = share <= level if name == JOINT else np.abs(share - 0.5) <= 0.5 * level
                ends = binomtest(int(inside.sum()), len(inside)).proportion_ci(method="wilson")
                row |= {f"inside_{100 * level:g}": float(inside.mean()), f"from_{100 * level:g}": float(ends.low)}
                row |= {f"to_{100 * level:g}": float(ends.high)}
            rows.append(row)
        return rows


def ranks_of(
    posterior: Draws, truth: Float[np.ndarray, " free"], draws: int, rng: np.random.Generator
) -> tuple[Int[np.ndarray, " free"], int]:
    """Ranks of a truth among draws of its posterior: of each parameter, and of all together.

    Arguments:
        posterior: The posterior.
        truth: λ that the data were simulated at.
        draws: L, how many draws.
        rng: Draws them, and the random point.
    """
    drawn = posterior.drawn(draws, rng)
    return (drawn < truth).sum(axis=0), joint_rank(posterior.prior, truth, drawn, rng)


def joint_rank(
    prior: Prior, truth: Float[np.ndarray, " free"], drawn: Float[np.ndarray, "draw free"], rng: np.random.Generator
) -> int:
    """How many draws lie nearer to a random point than the truth (TARP)."""
    unit = prior.shares(np.concatenate([truth[None], drawn]))
    distance = np.linalg.norm(unit - rng.random(unit.shape[1]), axis=1)
    return int((distance[1:] < distance[0]).sum())
