"""Which time and which statistic, measured next, shrinks the errors of λ most.

A design has groups of replicates, each measured in some observables: y_g = m_g(λ) + noise, covariance S_g / R_g within
one group, none between groups but for the measurement error. All groups together have J and Σ, and the information

    F = A + diag(1 / τ²),    A = JᵀΣ⁻¹J less what the noise of J adds (`fisher`).

A candidate makes F + ΔF of it, ΔF = A(with) − A(without), from which directions of negative eigenvalue are taken out:
more data never tell less, so those are noise of J. The criterion is the typical error of log λ over p parameters,

    "mean":   √(tr F⁻¹ / p)           root of the mean variance (A-optimality)
    "volume": (det F⁻¹)^{1/(2p)}      geometric mean of the errors along the directions (D-optimality)

(Atkinson, Donev & Tobias 2007, Optimum Experimental Designs, with SAS, chapter 10). A sequence takes the best
candidate, counts it as measured, and goes on. τ is the prior's; for parameters without one it is that of a uniform
distribution over the plausible range of log λ, (log high − log low) / √12: so every error is finite, and what no data
see stays visible.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from scipy.linalg import block_diag

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import Square, mean_covariance, measurement_covariance
from yeastfit.inference.information.design_result import Candidate, Criterion, Design
from yeastfit.inference.information.experiment import (
    chosen_free,
    chosen_observables,
    information_in,
    scatter_freedom,
)
from yeastfit.inference.information.fisher import checked_widths
from yeastfit.inference.information.result import Information, precision
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.kinds import check_kind
from yeastfit.numbers import Range, array_of

MOST_MEASUREMENTS = 1000  # of a sequence
MOST_REPLICATES = 1e6
By = Literal["image", "statistic"]
Groups = tuple[tuple[float, tuple[int, ...]], ...]
"""Of each group the number of replicates, and the numbers of the observables that are measured."""


def design(
    sensitivity: Sensitivity,
    *,
    free: Sequence[str] | None = None,
    measured_times: Sequence[float] | np.ndarray | None = None,
    measured_statistics: Sequence[str] | None = None,
    replicates: float = 10,
    added: float = 10,
    steps: int = 3,
    by: By = "image",
    criterion: Criterion = "mean",
    new_replicates: bool = True,
    measurement_error: float | Mapping[str, float] = 0.01,
    prior: Mapping[str, float] | None = None,
) -> Design:
    """What to measure next. Candidates are every statistic and time of a sensitivity.

    Arguments:
        sensitivity: From `yeastfit.sensitivity`.
        free: Which of its parameters are free, by default all; what is not free is known.
        measured_times: What is measured already, by default all; an empty sequence is nothing.
        measured_statistics: Likewise.
        replicates: That are measured already.
        added: Further replicates, each measured at one time.
        steps: Length of the sequence.
        by: Whether the sequence takes whole images, all statistics of a time at once, or single statistics.
        criterion: What it minimises.
        new_replicates: Whether further replicates are measured; otherwise the same, where they have not been.
        measurement_error: Relative, beside the scatter of replicates: one number, or one for each statistic.
        prior: Standard deviation of log λ, by name.

    Returns:
        Every candidate with what it would achieve, and the best sequence of them.

    Raises:
        InputError: Arguments that make no sense.
    """
    check_kind("sensitivity", sensitivity, Sensitivity, "the result of yeastfit.sensitivity(…)")
    check_arguments(replicates, added, steps, by, criterion)
    widths = checked_widths(prior)
    names = chosen_free(sensitivity, free)
    nothing = measured_times is not None and array_of(measured_times, "measured_times").size == 0
    known = () if nothing else tuple(chosen_observables(sensitivity, measured_statistics, measured_times).tolist())
    groups: Groups = ((float(replicates), known),) if known else ()
    further = added if new_replicates else None
    task = _Task(sensitivity, names, measurement_error, widths, criterion, further, replicates)
    start = task.start(groups)
    images, singles = (task.candidates(groups, start, offered) for offered in (task.images, task.singles))
    if not images:
        raise InputError("new_replicates is False and everything has been measured: nothing is left to measure")
    return Design(
        free=names,
        statistics=sensitivity.statistics,
        times=sensitivity.times,
        criterion=criterion,
        added=float(added),
        new_replicates=new_replicates,
        before=task.information(groups),
        typical_error=task.typical_error(start),
        log_standard_errors=task.errors(start),
        images=tuple(candidate for candidate, _, _ in images),
        singles=tuple(candidate for candidate, _, _ in singles),
        sequence=task.sequence(groups, start, task.images if by == "image" else task.singles, steps),
    )


@dataclass(frozen=True)
class _Task:
    """What stays the same from one candidate to the next.

    Attributes:
        sensitivity: What every observable would tell.
        free: Names of the parameters.
        measurement_error: Relative.
        prior: Standard deviation of log λ, by name.
        criterion: What is minimised.
        added: New replicates; None where the same ones are measured again.
        replicates: That are measured already.
    """

    sensitivity: Sensitivity
    free: tuple[str, ...]
    measurement_error: float | Mapping[str, float]
    prior: dict[str, float]
    criterion: Criterion
    added: float | None
    replicates: float

    @cached_property
    def images(self) -> list[tuple[int, ...]]:
        """Numbers of the observables of each time."""
        times = np.array([one.time for one in self.sensitivity.observables])
        seen = ((times == time) | (np.isnan(times) & np.isnan(time)) for time in self.sensitivity.times)
        return [tuple(np.flatnonzero(rows).tolist()) for rows in seen]

    @cached_property
    def singles(self) -> list[tuple[int, ...]]:
        """Numbers of each observable."""
        return [(number,) for number in range(len(self.sensitivity.observables))]

    @cached_property
    def error(self) -> Square:
        """Covariance of the measurement error of all observables."""
        return measurement_covariance(self.sensitivity.observables, self.sensitivity.mean, self.measurement_error)

    def information(self, groups: Groups) -> Information:
        """In groups of replicates, without the plausible range."""
        scatter, freedom = self.sensitivity.scatter, scatter_freedom(self.sensitivity)
        blocks = [
            mean_covariance(scatter[np.ix_(seen, seen)], replicates=count, freedom=freedom) for count, seen in groups
        ]
        rows = np.array([number for _, seen in groups for number in seen], dtype=int)
        sigma = block_diag(*blocks) if blocks else np.zeros((0, 0))
        return information_in(
            self.sensitivity, self.free, rows, sigma + self.error[np.ix_(rows, rows)], prior=self.prior
        )

    def start(self, groups: Groups) -> np.ndarray:
        """F of what is measured, with the plausible range."""
        widths = {name: self._plausible(name) for name in self.free if name not in self.prior}
        return self.information(groups).matrix + np.diag(precision(widths, self.free))

    def sequence(
        self, groups: Groups, total: np.ndarray, offered: Sequence[tuple[int, ...]], steps: int
    ) -> tuple[Candidate, ...]:
        """The best candidates, one after the other."""
        found = list[Candidate]()
        for _ in range(steps):
            options = self.candidates(groups, total, offered)
            if options:
                best, groups, total = max(options, key=lambda option: option[0].reduction)
                found.append(best)
        return tuple(found)

    def candidates(
        self, groups: Groups, total: np.ndarray, offered: Sequence[tuple[int, ...]]
    ) -> list[tuple[Candidate, Groups, np.ndarray]]:
        """Each candidate, the groups with it and F with it."""
        now, before, found = self.information(groups).data, self.typical_error(total), list[Any]()
        for rows in offered:
            new, larger = self.with_observables(groups, rows)
            if not new:
                continue
            values, vectors = np.linalg.eigh(self.information(larger).data - now)
            after = total + (vectors * np.maximum(values, 0.0)) @ vectors.T
            candidate = Candidate(
                statistics=tuple(self.sensitivity.observables[row].statistic for row in new),
                time=self.sensitivity.observables[new[0]].time,
                reduction=1.0 - self.typical_error(after) / before,
                typical_error=self.typical_error(after),
                log_standard_errors=self.errors(after),
            )
            found.append((candidate, larger, after))
        return found

    def with_observables(self, groups: Groups, rows: tuple[int, ...]) -> tuple[tuple[int, ...], Groups]:
        """What is new in some observables, and the groups with them."""
        if self.added is not None:
            return rows, (*groups, (self.added, rows))
        count, seen = groups[0] if groups else (self.replicates, ())
        new = tuple(number for number in rows if number not in seen)
        return new, ((count, (*seen, *new)),)

    def typical_error(self, total: np.ndarray) -> float:
        """The criterion."""
        if self.criterion == "volume":
            return float(np.exp(-0.5 * np.linalg.slogdet(total)[1] / len(total)))
        return float(np.sqrt(np.trace(np.linalg.inv(total)) / len(total)))

    def errors(self, total: np.ndarray) -> dict[str, float]:
        """Of log λ, by name."""
        return dict(zip(self.free, np.sqrt(np.diag(np.linalg.inv(total))).tolist(), strict=True))

    def _plausible(self, name: str) -> float:
        """Standard deviation of a uniform distribution of log λ over the plausible range."""
        low, high = self.sensitivity.plausible[name]
        if not (low > 0 and np.isfinite(high)):
            raise InputError(
                f"{name} is plausible from {low:g} to {high:g}, which says nothing of its logarithm: give a prior"
            )
        return float(np.log(high / low) / np.sqrt(12.0))


def most_means(measured: int, statistics: int, times: int, steps: int, by: str, same: bool) -> int:
    """Of how many means the largest covariance in a design is, which the scatter has to tell.

    Arguments:
        measured: Number of means that are measured already.
        statistics: Number of statistics.
        times: Number of times.
        steps: Length of the sequence.
        by: What it takes.
        same: Whether the same replicates are measured again, which all are then one group.
    """
    if not same:
        return max(measured, statistics)
    taken = steps * (statistics if by == "image" else 1)
    return min(statistics * times, measured + max(statistics, taken))


def check_arguments(replicates: float, added: float, steps: int, by: str, criterion: str) -> None:
    """Raise `InputError` where an argument makes no sense."""
    for name, value in (("replicates", replicates), ("added", added)):
        Range(0, MOST_REPLICATES, above=True).check(value, name)
    Range(1, MOST_MEASUREMENTS).read_whole(steps, "steps")
    for name, word, words in (("by", by, get_args(By)), ("criterion", criterion, get_args(Criterion))):
        if word not in words:
            raise InputError(f"{name} is {word!r}, it must be one of {', '.join(words)}")
