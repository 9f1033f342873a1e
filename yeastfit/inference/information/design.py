"""Which time and which statistic, measured next, shrinks the errors of λ most.

A design has groups of colonies, each seen in some curves: y_g = m_g(λ) + noise, covariance S_g / R_g between the curves
of one group, none between groups but for the measurement error. All groups together have J and Σ, and the information

    F = A + diag(1 / τ²),    A = JᵀΣ⁻¹J less what the noise of J adds (`fisher`).

A candidate makes F + ΔF of it, ΔF = A(with) − A(without), from which directions of negative eigenvalue are taken out:
more data never tell less, so those are noise of J. The criterion is the typical error of log λ over p parameters,

    "mean":   √(tr F⁻¹ / p)           root of the mean variance (A-optimality)
    "volume": (det F⁻¹)^{1/(2p)}      geometric mean of the errors along the directions (D-optimality)

(Atkinson, Donev & Tobias 2007, Optimum Experimental Designs, with SAS, chapter 10). A sequence takes the best
candidate, counts it as measured, and goes on. τ is the prior's, for parameters without one that of a uniform law over
the plausible range of log λ, (log high − log low) / √12: so every error is finite, and what no data see stays visible.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from scipy.linalg import block_diag

from yeastfit.errors import InputError
from yeastfit.inference.information.design_result import Choice, Criterion, Design
from yeastfit.inference.information.experiment import (
    Curves,
    chosen_curves,
    chosen_free,
    curve_covariance,
    scatter_freedom,
    systematic,
)
from yeastfit.inference.information.result import Information, precision
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.model.parameters import PARAMETERS

By = Literal["image", "statistic"]
Groups = tuple[tuple[float, tuple[int, ...]], ...]
"""Of each group how many colonies, and the numbers of the curves they are seen in."""


def design(
    found: Sensitivity,
    *,
    free: Sequence[str] | None = None,
    measured_times: Sequence[float] | np.ndarray | None = None,
    measured_statistics: Sequence[str] | None = None,
    replicates: float = 10,
    added: float = 10,
    steps: int = 3,
    by: By = "image",
    criterion: Criterion = "mean",
    new_colonies: bool = True,
    measurement_error: float = 0.01,
    prior: Mapping[str, float] | None = None,
) -> Design:
    """What to measure next, from `yeastfit.sensitivity` (see above).

    Measured already: measured_statistics at measured_times (default: all that `found` holds; an empty sequence of times
    is nothing) of `replicates` colonies. Candidates: every statistic and time that `found` holds. new_colonies: `added`
    further colonies are seen at one time each; otherwise the same colonies, where they have not been. by: whether the
    sequence of `steps` takes whole images, all statistics at once, or single statistics. free, measurement_error and
    prior as in `information_of`. Times are model time, errors those of log λ. Raises `InputError`.
    """
    _check(replicates, added, steps, by, criterion)
    names = chosen_free(found, free)
    nothing = measured_times is not None and len(measured_times) == 0
    known = () if nothing else tuple(chosen_curves(found, measured_statistics, measured_times).tolist())
    groups: Groups = ((float(replicates), known),) if known else ()
    task = _Task(
        found, names, measurement_error, dict(prior or {}), criterion, added if new_colonies else None, replicates
    )
    every = np.arange(len(found.statistics) * len(found.times)).reshape(len(found.statistics), -1)
    images = [tuple(column) for column in every.T.tolist()]
    singles = [(number,) for number in every.ravel().tolist()]
    start = total = task.start(groups)
    first = {view: task.options(groups, start, offered) for view, offered in (("image", images), ("curve", singles))}
    sequence = list[Choice]()
    later = groups
    for _ in range(steps):
        options = task.options(later, total, images if by == "image" else singles)
        if options:
            choice, later, total = max(options, key=lambda option: option[0].reduction)
            sequence.append(choice)
    return Design(
        free=names,
        statistics=found.statistics,
        times=found.times,
        criterion=criterion,
        added=float(added),
        new_colonies=new_colonies,
        before=task.information(groups),
        typical=task.typical(start),
        errors=task.errors(start),
        images=tuple(choice for choice, _, _ in first["image"]),
        curves=tuple(choice for choice, _, _ in first["curve"]),
        sequence=tuple(sequence),
    )


@dataclass(frozen=True)
class _Task:
    """What stays the same from one candidate to the next. added: new colonies, None for the same ones."""

    found: Sensitivity
    free: tuple[str, ...]
    measurement_error: float
    prior: dict[str, float]
    criterion: Criterion
    added: float | None
    replicates: float

    @cached_property
    def everything(self) -> tuple[Curves, np.ndarray, float]:
        """J and S of all curves, their measurement error, and the degrees of freedom of S."""
        found = self.found
        return Curves.of(found, self.free), systematic(found.mean, self.measurement_error), scatter_freedom(found)

    def information(self, groups: Groups) -> Information:
        """In groups of colonies, without the plausible range."""
        curves, error, freedom = self.everything
        blocks = [
            curve_covariance(curves.scatter[np.ix_(seen, seen)], replicates=count, freedom=freedom)
            for count, seen in groups
        ]
        entries = np.array([number for _, seen in groups for number in seen], dtype=int)
        sigma = block_diag(*blocks) if blocks else np.zeros((0, 0))
        return curves.information(entries, sigma + error[np.ix_(entries, entries)], prior=self.prior)

    def start(self, groups: Groups) -> np.ndarray:
        """F of what is measured, with the plausible range."""
        widths = {name: _plausible(name) for name in self.free if name not in self.prior}
        return self.information(groups).matrix + np.diag(precision(widths, self.free))

    def options(
        self, groups: Groups, total: np.ndarray, offered: Sequence[tuple[int, ...]]
    ) -> list[tuple[Choice, Groups, np.ndarray]]:
        """Each candidate, the groups with it and F with it."""
        now, before, found = self.information(groups).data, self.typical(total), list[Any]()
        for entries in offered:
            new, larger = self.with_curves(groups, entries)
            if not new:
                continue
            values, vectors = np.linalg.eigh(self.information(larger).data - now)
            after = total + (vectors * np.maximum(values, 0.0)) @ vectors.T
            rows, column = divmod(np.array(new), len(self.found.times))
            choice = Choice(
                statistics=tuple(self.found.statistics[row] for row in rows),
                time=float(self.found.times[column[0]]),
                reduction=1.0 - self.typical(after) / before,
                typical=self.typical(after),
                errors=self.errors(after),
            )
            found.append((choice, larger, after))
        return found

    def with_curves(self, groups: Groups, entries: tuple[int, ...]) -> tuple[tuple[int, ...], Groups]:
        """What is new in some curves, and the groups that see them, too."""
        if self.added is not None:
            return entries, (*groups, (self.added, entries))
        count, seen = groups[0] if groups else (self.replicates, ())
        new = tuple(number for number in entries if number not in seen)
        return new, ((count, (*seen, *new)),)

    def typical(self, total: np.ndarray) -> float:
        """The criterion."""
        if self.criterion == "volume":
            return float(np.exp(-0.5 * np.linalg.slogdet(total)[1] / len(total)))
        return float(np.sqrt(np.trace(np.linalg.inv(total)) / len(total)))

    def errors(self, total: np.ndarray) -> dict[str, float]:
        """Of log λ, by name."""
        return dict(zip(self.free, np.sqrt(np.diag(np.linalg.inv(total))).tolist(), strict=True))


def _plausible(name: str) -> float:
    """Standard deviation of a uniform law of log λ over the plausible range."""
    low, high = PARAMETERS[name].plausible
    return float(np.log(high / low) / np.sqrt(12.0))


def _check(replicates: float, added: float, steps: int, by: str, criterion: str) -> None:
    """Raises `InputError` where an argument makes no sense."""
    for name, value in (("replicates", replicates), ("added", added), ("steps", steps)):
        if not value > 0:
            raise InputError(f"{name} is {value}, it must be above 0")
    for name, word, words in (("by", by, get_args(By)), ("criterion", criterion, get_args(Criterion))):
        if word not in words:
            raise InputError(f"{name} is {word!r}, it must be one of {', '.join(words)}")
