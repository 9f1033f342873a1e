"""How parameters of one condition differ from those of another, by two posteriors under the same model.

Posteriors of different colonies are independent: every draw a of one goes with every draw b of the other. Of each
parameter, quantiles of a − b and of a / b, and the probability that a > b.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.posterior.draws import Draws
from yeastfit.kinds import check_kind
from yeastfit.text import quoted

DRAWS = 1000  # of each posterior
SURE = 0.975
SHARES = np.array([0.05, 0.5, 0.95])


@dataclass(frozen=True)
class ParameterChange:
    """Of one parameter.

    Attributes:
        name: Of the parameter.
        first: Median of a.
        second: Median of b.
        difference: Quantiles of a − b at 5, 50 and 95 %.
        ratio: Of a / b; nan where a parameter may be 0 or below.
        larger: Probability that a > b.
        error: Standard error of that, by the independent draws of both.
    """

    name: str
    first: float
    second: float
    difference: Float[np.ndarray, "3"]
    ratio: Float[np.ndarray, "3"]
    larger: float
    error: float

    @property
    def told_apart(self) -> bool:
        """Whether one of them is larger with probability 97.5 % or more."""
        return max(self.larger, 1 - self.larger) >= SURE


@dataclass(frozen=True)
class ConditionComparison:
    """Two runs under the same model.

    Attributes:
        first: Name of the first run.
        second: Name of the second run.
        changes: Of every parameter that is free in both.
    """

    first: str
    second: str
    changes: tuple[ParameterChange, ...]

    @staticmethod
    def of(first: str, a: Draws, second: str, b: Draws) -> "ConditionComparison":
        """Compare two posteriors.

        Arguments:
            first: Name of the first run.
            a: Its draws.
            second: Name of the second run.
            b: Its draws.

        Raises:
            InputError: No parameter is free in both.
        """
        for name, draws in ((first, a), (second, b)):
            check_kind(f"draws of {quoted(name)}", draws, Draws, "a Posterior, or its draws")
        shared = [name for name in a.free if name in b.free]
        if not shared:
            raise InputError(f"{first} and {second}: no parameter is free in both")
        each = a.effective_size, b.effective_size
        changes = []
        for name in shared:
            i, j = a.free.index(name), b.free.index(name)
            smaller = float(min(each[0][i], each[1][j]))
            changes.append(_change(name, evenly(a, i), evenly(b, j), smaller))
        return ConditionComparison(first, second, tuple(changes))

    def rows(self) -> list[dict[str, Any]]:
        """One per parameter."""
        return [
            {
                "parameter": one.name,
                "first": self.first,
                "second": self.second,
                "median_first": one.first,
                "median_second": one.second,
                **dict(zip(("difference_q05", "difference", "difference_q95"), one.difference.tolist(), strict=True)),
                **dict(zip(("ratio_q05", "ratio", "ratio_q95"), one.ratio.tolist(), strict=True)),
                "first_larger": one.larger,
                "error": one.error,
                "told_apart": "yes" if one.told_apart else "no",
            }
            for one in self.changes
        ]

    def sentences(self) -> list[str]:
        """Verdicts, parameter by parameter."""
        said, same = [], []
        for one in self.changes:
            name = one.name.replace("_", " ")
            if not one.told_apart:
                same.append(name)
                continue
            side, sure = ("larger", one.larger) if one.larger > 0.5 else ("smaller", 1 - one.larger)
            low, middle, high = one.ratio if side == "larger" else 1 / one.ratio[::-1]
            by = f" by a factor of {middle:.2f} ({low:.2f} to {high:.2f})" if np.isfinite(middle) else ""
            said.append(f"{name} is {side} in {self.first} than in {self.second}{by}, with probability {sure:.3f}")
        if same:
            said.append(
                f"{', '.join(same)}: {self.first} and {self.second} are not told apart, in neither is it larger with "
                f"probability {SURE:g}"
            )
        return said


def evenly(draws: Draws, column: int) -> Float[np.ndarray, " draw"]:
    """So many draws of a parameter, each as often as its weight says (systematic resampling)."""
    ends = np.cumsum(draws.weights.ravel())
    places = (np.arange(DRAWS) + 0.5) / DRAWS * ends[-1]
    return draws.flat[np.searchsorted(ends, places), column]


def _change(name: str, a: Float[np.ndarray, " draw"], b: Float[np.ndarray, " draw"], worth: float) -> ParameterChange:
    positive = a.min() > 0 and b.min() > 0
    ratio = np.quantile(a[:, None] / b, SHARES) if positive else np.full(3, np.nan)
    ranks = np.searchsorted(np.sort(b), a, side="left") + np.searchsorted(np.sort(b), a, side="right")
    larger = float(ranks.mean() / (2 * len(b)))
    error = float(np.sqrt(max(larger * (1 - larger), 1 / worth**2) / worth))
    difference = np.quantile(a[:, None] - b, SHARES)
    return ParameterChange(name, float(np.median(a)), float(np.median(b)), difference, ratio, larger, error)
