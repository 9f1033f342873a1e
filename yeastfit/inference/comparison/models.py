"""Which of several runs on the same colonies predicts colonies that it has not seen best.

ℓ_r of two runs differ by d_r on colony r, and by Σ d_r in all, with standard error √R sd(d): colonies are paired, as
some are harder to predict than others for any model. They differ by more than chance where |Σ d_r| is beyond the 97.5 %
quantile of Student's t with R − 1 degrees of freedom, in standard errors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool
from scipy.stats import t as student

from yeastfit.errors import InputError
from yeastfit.inference.comparison.left_out import LeftOut, standard_error

SURE = 0.975
SAME = 1e-3  # standard deviations between colonies, within which two tables have the same number


@dataclass(frozen=True)
class Scored:
    """A run among others on the same colonies.

    Attributes:
        name: Of the run.
        left_out: Its colonies.
        behind: Σ d, how much less it is worth than the best; 0 of the best.
        error: Of that; nan of the best.
        colonies: How many d there are.
    """

    name: str
    left_out: LeftOut
    behind: float
    error: float
    colonies: int

    @property
    def told_apart(self) -> bool:
        """Whether it is worse than the best by more than chance."""
        return self.colonies > 1 and self.behind > float(student.ppf(SURE, self.colonies - 1)) * self.error

    def row(self) -> dict[str, Any]:
        """Of a table."""
        found = self.left_out
        return {
            "run": self.name,
            "colonies": len(found.scored),
            "log_density": found.total,
            "standard_error": found.standard_error,
            "behind_best": self.behind,
            "error_of_that": self.error,
            "worse": "yes" if self.told_apart else "no",
            "inside_50_%": 100 * found.coverage(0.5),
            "inside_90_%": 100 * found.coverage(0.9),
            "fails": ", ".join(found.failures()),
        }


@dataclass(frozen=True)
class ModelComparison:
    """Which of several runs on the same colonies predicts colonies left out best.

    Attributes:
        runs: The best one first.
    """

    runs: tuple[Scored, ...]

    @staticmethod
    def of(runs: Mapping[str, LeftOut]) -> "ModelComparison":
        """Compare what runs have predicted.

        Arguments:
            runs: By name.

        Raises:
            InputError: They are of different colonies or statistics, or no colony is scored in all of them.
        """
        first, *others = runs
        for other in others:
            if why := difference_of_data(runs[first], runs[other]):
                raise InputError(f"{first} and {other}: {why}")
        common = np.isfinite(np.stack([left_out.log_density for left_out in runs.values()])).all(axis=0)
        if not common.any():
            raise InputError(f"{' and '.join(runs)}: no colony left out has a density in all of them")
        best = max(runs, key=lambda name: runs[name].log_density[common].sum())
        scored = [_scored(name, runs[name], best, runs[best], common) for name in runs]
        return ModelComparison(tuple(sorted(scored, key=lambda one: (one.name != best, one.behind))))

    def rows(self) -> list[dict[str, Any]]:
        """One per run."""
        return [one.row() for one in self.runs]

    def colony_rows(self) -> list[dict[str, Any]]:
        """Log densities of every colony, one column per run."""
        names = self.runs[0].left_out.colonies
        return [
            {"colony": name, **{one.name: float(one.left_out.log_density[r]) for one in self.runs}}
            for r, name in enumerate(names)
        ]

    def sentences(self) -> list[str]:
        """Verdicts."""
        best, *others = self.runs
        said = []
        for one in others:
            how = "better than" if one.told_apart else "no worse than"
            more = "" if one.told_apart else ": the difference is within chance"
            said.append(
                f"{best.name} predicts colonies left out {how} {one.name}, log density {one.behind:+.1f} ± "
                f"{one.error:.1f} over {one.colonies} colonies{more}"
            )
        for run in self.runs:
            said.extend(f"{run.name} does not explain {label}: {what}" for label, what in _failures(run))
        common = set.intersection(*(set(one.left_out.failures()) for one in self.runs))
        if len(self.runs) > 1:
            said.extend(f"no run explains {label}" for label in self.runs[0].left_out.labels if label in common)
        return said


def difference_of_data(first: LeftOut, second: LeftOut) -> str:
    """In words, why two runs are not of the same colonies and statistics; empty where they are."""
    if first.labels != second.labels:
        return (
            f"statistics are {', '.join(first.labels)} and {', '.join(second.labels)}, densities compare only of the "
            "same ones: give both the same --statistics"
        )
    if first.observed.shape != second.observed.shape:
        return f"they are of {len(first.colonies)} and {len(second.colonies)} colonies"
    one, other = (found.observed / found.scale for found in (first, second))
    if not np.allclose(one, other, rtol=0.0, atol=SAME, equal_nan=True):
        k = int(np.nanargmax(np.nanmax(np.abs(one - other), axis=0)))
        return f"{first.labels[k]} of the colonies is another one: other colonies, or measured in another way"
    return ""


def _failures(run: Scored) -> Sequence[tuple[str, str]]:
    return list(run.left_out.failures().items())


def _scored(name: str, found: LeftOut, best: str, of_best: LeftOut, common: Bool[np.ndarray, " colony"]) -> Scored:
    """How far a run is behind the best, over the colonies that all runs have scored."""
    both = (of_best.log_density - found.log_density)[common]
    error = float("nan") if name == best else standard_error(both)
    return Scored(name, found, float(both.sum()), error, len(both))
