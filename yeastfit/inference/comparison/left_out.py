"""Colonies that were left out of a posterior and predicted by it: how well, and where not.

Of colony r with statistics y_r, and a posterior of the other groups' colonies (`cross_validation`):

    log density     ℓ_r = log p(D⁻¹ y_r | others) = log p(y_r | others) + Σ_k log D_k
    rank            u_rk = P(predicted statistic k ≤ y_rk | others)

D are the standard deviations of the observed colonies, so that ℓ is the same whatever lengths are counted in. Σ ℓ_r
estimates the expected log predictive density of as many further colonies, with standard error √R sd(ℓ_r) (Vehtari,
Gelman & Gabry 2017, doi:10.1007/s11222-016-9696-4). Where predictions are right, u is uniform in 0..1, and half of them
lie in the predicted interval of 50 %.

Errors of measurement that all colonies have in common are taken for new ones of each colony that is left out: what the
others tell of them is not used, which costs a right model about 0.1 a colony in ℓ where their variance is a seventh of
the colonies' own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import binom, norm

from yeastfit.errors import InputError
from yeastfit.inference.posterior.draws import check_level
from yeastfit.storage import as_json, from_json, reads_saved, written_whole
from yeastfit.text import natural_order

SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
RARE = 0.01  # probability below which a count of colonies inside an interval is no chance
OFF = 3.0  # standard errors from where predictions of a statistic are off on average
WORDS = ("labels", "colonies", "doubts")


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Result of `cross_validate`.

    Attributes:
        labels: Names of the statistics.
        colonies: Names of the colonies.
        observed: y.
        group: The group that each colony was left out with.
        log_density: ℓ; nan where a statistic of the colony is missing.
        below: u; nan where the statistic is missing.
        quantiles: Predicted ones, of `SHARES`.
        doubts: What is to be doubted, in words.
    """

    labels: tuple[str, ...]
    colonies: tuple[str, ...]
    observed: Float[np.ndarray, "colony statistic"]
    group: Int[np.ndarray, " colony"]
    log_density: Float[np.ndarray, " colony"]
    below: Float[np.ndarray, "colony statistic"]
    quantiles: Float[np.ndarray, "colony share statistic"]
    doubts: tuple[str, ...] = ()

    @property
    def scale(self) -> Float[np.ndarray, " statistic"]:
        """D."""
        return scale_of(self.observed)

    @property
    def groups(self) -> int:
        """How many there are."""
        return int(self.group.max()) + 1

    @property
    def scored(self) -> Float[np.ndarray, " scored"]:
        """ℓ of the colonies that have one."""
        return self.log_density[np.isfinite(self.log_density)]

    @property
    def total(self) -> float:
        """Σ ℓ_r."""
        return float(self.scored.sum())

    @property
    def standard_error(self) -> float:
        """Of the sum; nan of one colony."""
        return standard_error(self.scored)

    def inside(self, level: float) -> Int[np.ndarray, " statistic"]:
        """How many colonies lie in the central interval of each statistic.

        Raises:
            InputError: The level is not in 0..1.
        """
        check_level(level)
        return (np.abs(self.below - 0.5) <= 0.5 * level).sum(axis=0)

    @property
    def counts(self) -> Int[np.ndarray, " statistic"]:
        """How many colonies have each statistic."""
        return np.isfinite(self.below).sum(axis=0)

    def coverage(self, level: float) -> float:
        """Share of all observations in their central intervals."""
        return float(self.inside(level).sum() / self.counts.sum())

    @property
    def offset(self) -> Float[np.ndarray, " statistic"]:
        """Mean of Φ⁻¹(u): how far colonies lie above their predictions, in the predicted standard deviations."""
        scores = norm.ppf(np.clip(self.below, 1e-12, 1 - 1e-12))
        return np.nanmean(scores, axis=0)

    def failures(self) -> dict[str, str]:
        """Statistics that are not predicted as they are observed, with what is wrong, by name."""
        found = {}
        for k, label in enumerate(self.labels):
            wide, half, count = int(self.inside(0.9)[k]), int(self.inside(0.5)[k]), int(self.counts[k])
            said = []
            if abs(self.offset[k]) * np.sqrt(count) > OFF:
                side = "smaller" if self.offset[k] > 0 else "larger"
                said.append(f"predicted {side} than observed, by {abs(self.offset[k]):.1f} standard deviations")
            if binom.cdf(wide, count, 0.9) < RARE:
                said.append(f"{wide} of {count} colonies in the interval of 90 %")
            if binom.sf(half - 1, count, 0.5) < RARE:
                said.append(f"predicted wider than observed: {half} of {count} colonies in the interval of 50 %")
            if said:
                found[label] = "; ".join(said)
        return found

    def rows(self) -> list[dict[str, Any]]:
        """One row per statistic: colonies inside the intervals of 50 and 90 %, and what is wrong."""
        failures = self.failures()
        return [
            {
                "statistic": label,
                "colonies": int(self.counts[k]),
                "inside_50": int(self.inside(0.5)[k]),
                "inside_90": int(self.inside(0.9)[k]),
                "offset_sd": float(self.offset[k]),
                "fails": failures.get(label, ""),
            }
            for k, label in enumerate(self.labels)
        ]

    def colony_rows(self) -> list[dict[str, Any]]:
        """One row per colony and statistic: observed, and predicted by the others."""
        names = [f"q{100 * share:02.0f}" for share in SHARES]
        return [
            {
                "colony": colony,
                "group": int(self.group[r]) + 1,
                "log_density": float(self.log_density[r]),
                "statistic": label,
                "observed": float(self.observed[r, k]),
                **dict(zip(names, self.quantiles[r, :, k].tolist(), strict=True)),
                "share_below": float(self.below[r, k]),
            }
            for r, colony in enumerate(self.colonies)
            for k, label in enumerate(self.labels)
        ]

    def sentence(self) -> str:
        """What was found, in words."""
        count, scored = len(self.colonies), len(self.scored)
        of_them = f" of {scored} of them" if scored < count else ""
        return (
            f"{count} colonies left out in {self.groups} groups: log predictive density{of_them} {self.total:.1f} ± "
            f"{self.standard_error:.1f}; {100 * self.coverage(0.5):.0f} % of the observations in the predicted "
            f"interval of 50 %, {100 * self.coverage(0.9):.0f} % in that of 90 %"
        )

    def sentences(self) -> list[str]:
        """What is wrong; empty where all is well."""
        return [*self.doubts, *(f"colonies left out: {name}: {what}" for name, what in self.failures().items())]

    def in_order(self) -> "LeftOut":
        """The same with colonies in the order of their names, whatever that of the table was."""
        order = sorted(range(len(self.colonies)), key=lambda r: natural_order(self.colonies[r]))
        of_colonies = {one.name: getattr(self, one.name)[order] for one in fields(self) if one.name not in WORDS}
        return replace(self, colonies=tuple(self.colonies[r] for r in order), **of_colonies)

    def save(self, path: str | Path) -> None:
        """All of it as one .npz file."""
        arrays = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in WORDS}
        words = as_json({name: getattr(self, name) for name in WORDS})
        with written_whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, words=words, **arrays)

    @staticmethod
    @reads_saved("prediction of colonies left out")
    def load(path: str | Path) -> "LeftOut":
        """What `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            words = from_json(str(file["words"]))
            arrays = {one.name: file[one.name] for one in fields(LeftOut) if one.name not in WORDS}
        labels, colonies, doubts = (tuple(words[name]) for name in WORDS)
        table = (len(colonies), len(labels))
        shapes = {"observed": table, "below": table, "group": table[:1], "log_density": table[:1]}
        shapes["quantiles"] = (table[0], len(SHARES), table[1])
        for name, shape in shapes.items():
            if arrays[name].shape != shape or not np.issubdtype(arrays[name].dtype, np.number):
                raise InputError(f"{name} has shape {arrays[name].shape}, need numbers of shape {shape}")
        counts = np.isfinite(arrays["observed"]).sum(axis=0)
        if lacking := [label for label, count in zip(labels, counts, strict=True) if count < 2]:
            raise InputError(f"observed has fewer than two colonies with {lacking[0]}")
        return LeftOut(labels=labels, colonies=colonies, doubts=doubts, **arrays)


def scale_of(observed: Float[np.ndarray, "colony statistic"]) -> Float[np.ndarray, " statistic"]:
    """D, the standard deviations of the observed colonies."""
    return np.nanstd(observed, axis=0, ddof=1)


def standard_error(scores: Sequence[float] | Float[np.ndarray, " colony"]) -> float:
    """Of a sum over colonies, √R sd; nan of one colony."""
    return float(np.sqrt(len(scores)) * np.std(scores, ddof=1)) if len(scores) > 1 else float("nan")
