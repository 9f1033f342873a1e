"""Draws from a posterior, whichever method they come from, with all it takes to judge and to repeat them."""

import zipfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.posterior.diagnostics import autocorrelation_time
from yeastfit.storage import as_json, from_json, written_whole

ARRAYS = ("values", "weights", "log_probability", "acceptance", "statistics")


@dataclass(frozen=True)
class Samples:
    """Result of every sampler.

    free: names of the columns of `values`, λ themselves. weights: sum to 1 over all chains and draws, equal for chains.
    log_probability: as the method keeps it, up to a constant. acceptance: share of proposals, of each chain, or of each
    population where there is one chain of weighted draws. statistics: simulated with each draw, by `labels`; nan where
    none are. simulations: data sets that were simulated for it, whether now or found in a store. seconds: of the call
    that made it. settings: what it takes to repeat it. warnings: in words. diagnostics: of the method, plain data.
    """

    free: tuple[str, ...]
    values: Float[np.ndarray, "chain draw free"]
    weights: Float[np.ndarray, "chain draw"]
    log_probability: Float[np.ndarray, "chain draw"]
    acceptance: Float[np.ndarray, " part"]
    labels: tuple[str, ...]
    statistics: Float[np.ndarray, "chain draw statistic"]
    simulations: int
    seconds: float
    seed: int
    method: str
    settings: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    diagnostics: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        total = self.weights.sum()
        if not (np.isfinite(self.values).all() and (self.weights >= 0).all() and np.isclose(total, 1.0)):
            raise InputError(f"values must be finite and weights at least 0 with sum 1, their sum is {total:g}")

    @property
    def flat(self) -> Float[np.ndarray, "draw free"]:
        """All chains' draws, chain by chain, as `weights.ravel()` has them."""
        return self.values.reshape(-1, len(self.free))

    @property
    def weighted(self) -> bool:
        """Whether draws differ in weight."""
        return bool(np.ptp(self.weights) > 1e-9 * self.weights.max())

    @property
    def mean(self) -> Float[np.ndarray, " free"]:
        """Of λ."""
        return self.weights.ravel() @ self.flat

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations of λ."""
        return np.sqrt(self.weights.ravel() @ (self.flat - self.mean) ** 2)

    def quantile(self, share: float) -> Float[np.ndarray, " free"]:
        """λ below which that share of the posterior lies, parameter by parameter.

        Between draws it is linear in the share, each draw standing at the middle of its weight.
        """
        if not 0 <= share <= 1:
            raise InputError(f"share is {share}, it must lie in 0..1")
        return np.array([weighted_quantile(column, self.weights.ravel(), share) for column in self.flat.T])

    def interval(self, level: float) -> Float[np.ndarray, "free 2"]:
        """Central interval that holds `level` of the posterior."""
        return np.stack([self.quantile(0.5 - 0.5 * level), self.quantile(0.5 + 0.5 * level)], axis=1)

    @property
    def effective_size(self) -> Float[np.ndarray, " free"]:
        """Independent draws that would tell as much of the mean.

        Of weighted draws 1 / Σw² (Kish), of chains their number over `autocorrelation_time`; where draws were adjusted,
        less than that, as `adjustment.Accepted` has it.
        """
        if "effective_size" in self.diagnostics:
            return np.array(self.diagnostics["effective_size"])
        if self.weighted:
            return np.full(len(self.free), 1.0 / np.sum(self.weights**2))
        return np.clip(self.weights.size / autocorrelation_time(self.values), 1.0, self.weights.size)

    def drawn(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "draw free"]:
        """`count` of the draws, with replacement, each as likely as its weight says."""
        return self.flat[rng.choice(self.weights.size, size=count, p=self.weights.ravel() / self.weights.sum())]

    def save(self, path: str | Path) -> None:
        """All of it as one .npz file."""
        arrays = {name: getattr(self, name) for name in ARRAYS}
        rest = {name: getattr(self, name) for name in self.__dataclass_fields__ if name not in ARRAYS}
        with written_whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, rest=as_json(rest), **arrays)

    @staticmethod
    def load(path: str | Path) -> "Samples":
        """What `save` wrote. Raises `InputError` for anything else."""
        try:
            with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                arrays = {name: file[name] for name in ARRAYS}
                rest = from_json(str(file["rest"]))
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: these are no samples that were saved whole: {error}") from error
        tuples = {name: tuple(rest[name]) for name in ("free", "labels")}
        return Samples(**{**rest, **tuples, **arrays})

    def warned(self, *said: str) -> "Samples":
        """With further warnings."""
        return replace(self, warnings=[*self.warnings, *said])


def weighted_quantile(values: Float[np.ndarray, " draw"], weights: Float[np.ndarray, " draw"], share: float) -> float:
    """Of weighted draws, see `Samples.quantile`."""
    order = np.argsort(values, kind="stable")
    each = weights[order]
    middles = (np.cumsum(each) - 0.5 * each) / each.sum()
    return float(np.interp(share, middles, values[order]))
