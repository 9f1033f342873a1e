"""A simulator whose means, covariance and Jacobian are known: fits are tested on it where physics is no matter."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from yeastfit import Fit, FitSettings, Imaging, Observable, Parameters, Targets, fit
from yeastfit.inference.parameter_space import ONLY, Bounds
from yeastfit.model.parameters import PARAMETERS
from yeastfit.parameter_set import ParameterSet
from yeastfit.seeds import keys_of

STATISTICS = ("perimeter", "radius", "area")
TIMES = np.array([1.0, 2.0, 3.0, 4.0])
CURVES = len(STATISTICS) * len(TIMES)
OBSERVABLES = tuple(Observable(name, float(time)) for name in STATISTICS for time in TIMES)
FREE = ("mobility", "metabolic_rate", "aspect_ratio")
SETTINGS = FitSettings(screened=32, starts=2, members=(16, 64, 256), measurement_error=0.0)
ROOT = 0.1 * np.linalg.cholesky(0.5 ** np.abs(np.subtract.outer(np.arange(CURVES), np.arange(CURVES))))
IMAGING = Imaging(extent=5.0)

QUIET = 1e-4 * ROOT  # simulations nearly without noise; Σ is then the data's, by their scatter

Mean = Callable[[np.ndarray], np.ndarray]


def logs(parameters: Parameters) -> np.ndarray:
    """log λ1 … log λ7."""
    return np.log([float(getattr(parameters, name)) for name in PARAMETERS.names])


HELD = Parameters(aspect_ratio=0.5)
CENTRE = logs(HELD)
PART = 64  # seeds that are drawn for together
SLOPES = 0.3 * np.random.default_rng(11).normal(size=(CURVES, len(PARAMETERS.names)))


def straight(away: np.ndarray) -> np.ndarray:
    """Means that are linear in log λ."""
    return 5.0 + (away - CENTRE) @ SLOPES.T


def bent(away: np.ndarray) -> np.ndarray:
    """Means that are exponentials: nonlinear, above 0, and no two λ have the same."""
    return np.exp((away - CENTRE) @ SLOPES.T)


@dataclass
class StandIn:
    """A `Simulator`: means, and noise of the covariance `root` rootᵀ at every λ.

    mean: of log λ [row, 7]. turn: a seed's noise is cos φ a + sin φ b with a and b of the seed and φ = turn · Σ log λ,
    so that it is Gaussian everywhere and changes with λ. free, held: names of the free parameters, and λ of the others.
    batches: rows of every call.
    """

    mean: Mean = bent
    root: np.ndarray = field(default_factory=lambda: ROOT)
    turn: float = 0.5
    free: Sequence[str] = FREE
    held: Parameters = HELD
    observables: tuple[Observable, ...] = OBSERVABLES
    problems: Counter[str] = field(default_factory=Counter)
    batches: list[int] = field(default_factory=list)

    @cached_property
    def parameters(self) -> ParameterSet:
        return PARAMETERS.subset(self.free)

    @property
    def names(self) -> tuple[str, ...]:
        return PARAMETERS.names

    @property
    def fixed(self) -> dict[str, float]:
        return {name: float(getattr(self.held, name)) for name in PARAMETERS.names if name not in self.free}

    @property
    def simulated(self) -> int:
        return sum(self.batches)

    def logarithms(self, values: np.ndarray) -> np.ndarray:
        """log λ1 … log λ7 of rows."""
        found = np.tile(logs(self.held), (len(values), 1))
        found[:, [PARAMETERS.names.index(name) for name in self.parameters]] = np.log(values)
        return found

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        size, away = len(seeds), self.logarithms(values)
        self.batches.append(size)
        phase = self.turn * away.sum(axis=1)[:, None]
        parts = [_normals(keys_of(part), self.root.shape[1]) for part in _parts(seeds)]
        one, other = np.concatenate(parts, dtype=float)[:size].swapaxes(0, 1)
        return self.mean(away) + (np.cos(phase) * one + np.sin(phase) * other) @ self.root.T


def _parts(seeds: np.ndarray) -> list[np.ndarray]:
    """Of one size, the last one filled up: one program draws for each seed, whatever others are with it."""
    count = -(-len(seeds) // PART)
    return np.split(seeds[np.minimum(np.arange(count * PART), len(seeds) - 1)], count)


@jax.jit(static_argnums=1)
def _normals(keys: Array, curves: int) -> Array:
    return jax.vmap(lambda key: jax.random.normal(key, (2, curves)))(keys)


def drawn(
    truth: Parameters,
    rng: np.random.Generator,
    replicates: int = 10,
    mean: Mean = bent,
    root: np.ndarray = ROOT,
) -> Targets:
    """Targets of replicates that are drawn around the truth's means."""
    one = mean(logs(truth)[None])[0]
    curves = (one + rng.normal(size=(replicates, CURVES)) @ root.T).reshape(replicates, len(STATISTICS), len(TIMES))
    return Targets.from_replicates({name: curves[:, k] for k, name in enumerate(STATISTICS)}, TIMES, imaging=IMAGING)


def exact(truth: Parameters, mean: Mean = bent, replicates: int = 10, relative: float = 0.1) -> Targets:
    """Targets that are the truth's means themselves, with a scatter of a share of them."""
    table = mean(logs(truth)[None])[0].reshape(len(STATISTICS), len(TIMES))
    means = dict(zip(STATISTICS, table, strict=True))
    scatter = {name: relative * values for name, values in means.items()}
    return Targets.from_means(means, TIMES, scatter=scatter, replicates=replicates, imaging=IMAGING)


def fitted(
    targets: Targets | Mapping[str, Targets],
    simulator: StandIn | Mapping[str, StandIn] | None = None,
    *,
    free: Sequence[str] = FREE,
    held: Mapping[str, Parameters] | None = None,
    own: Sequence[str] = (),
    bounds: Bounds | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    start: Mapping[str, float] | None = None,
    seed: int = 0,
    settings: FitSettings = SETTINGS,
    **more: Any,
) -> Fit:
    """A fit of stand-ins; by default one for each condition, with these parameters free and held, and not refined."""
    settings = settings if "fine" in more else replace(settings, refined=0)
    names = (ONLY,) if isinstance(targets, Targets) else tuple(targets)
    made = {name: StandIn(free=free, held=(held or {}).get(name, HELD)) for name in names}
    chosen: Any = made if simulator is None else simulator
    how: dict[str, Any] = {"own": own, "bounds": bounds, "prior": prior, "start": start, "seed": seed}
    return fit(targets, chosen, settings=settings, **how, **more)
