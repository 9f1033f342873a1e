"""Colonies whose mean curves, covariance and Jacobian are known: fits are tested on them where physics is no matter."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from yeastfit import FitSettings, Parameters
from yeastfit.inference.colonies import Colonies
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.stages import Fitter
from yeastfit.inference.parameter_space import ALONE, Bounds, Space
from yeastfit.inference.targets import Targets
from yeastfit.model.parameters import NAMES

STATISTICS = ("compactness", "radius", "area")
TIMES = np.array([1.0, 2.0, 3.0, 4.0])
CURVES = len(STATISTICS) * len(TIMES)
FREE = ("mobility", "metabolic_rate", "aspect_ratio")
SETTINGS = FitSettings(screened=32, starts=2, members=(16, 64, 256), measurement_error=0.0)
ROOT = 0.1 * np.linalg.cholesky(0.5 ** np.abs(np.subtract.outer(np.arange(CURVES), np.arange(CURVES))))

QUIET = 1e-4 * ROOT  # colonies nearly without noise; Σ is then the data's, by their scatter

Mean = Callable[[np.ndarray], np.ndarray]


def logs(parameters: Parameters) -> np.ndarray:
    """log λ1 … log λ7."""
    return np.log([float(getattr(parameters, name)) for name in NAMES])


CENTRE = logs(Parameters(aspect_ratio=0.5))
SLOPES = 0.3 * np.random.default_rng(11).normal(size=(CURVES, len(NAMES)))


def straight(away: np.ndarray) -> np.ndarray:
    """Curves that are linear in log λ."""
    return 5.0 + (away - CENTRE) @ SLOPES.T


def bent(away: np.ndarray) -> np.ndarray:
    """Curves that are exponentials: nonlinear, above 0, and no two λ have the same."""
    return np.exp((away - CENTRE) @ SLOPES.T)


class StandIn(Colonies):
    """In the place of `Colonies`: mean curves, and noise of the covariance `root` rootᵀ at every λ.

    mean: of log λ [member, 7], curves [member, curve]. turn: a key's noise is cos φ a + sin φ b with a and b of the key
    and φ = turn · Σ log λ, so that it is Gaussian everywhere and changes with λ. batches: rows of every call.
    """

    def __init__(self, mean: Mean = bent, root: np.ndarray = ROOT, turn: float = 0.5) -> None:
        self.mean, self.root, self.turn = mean, root, turn
        self.grown, self.problems, self.batches = 0, Counter[str](), list[int]()

    def grow(self, log_parameters: np.ndarray, keys: Array) -> np.ndarray:
        assert log_parameters.shape == (len(keys), len(NAMES))
        size = len(keys)
        self.grown += size
        self.batches.append(size)
        phase = self.turn * log_parameters.sum(axis=1)[:, None]
        one, other = np.asarray(_normals(_padded(keys), self.root.shape[1]), dtype=float)[:size].swapaxes(0, 1)
        return self.mean(log_parameters) + (np.cos(phase) * one + np.sin(phase) * other) @ self.root.T


def _padded(keys: Array) -> Array:
    """To a power of two, so that little is compiled."""
    return keys[np.minimum(np.arange(1 << (len(keys) - 1).bit_length()), len(keys) - 1)]


@jax.jit(static_argnums=1)
def _normals(keys: Array, curves: int) -> Array:
    return jax.vmap(lambda key: jax.random.normal(key, (2, curves)))(keys)


def drawn(
    truth: Parameters,
    rng: np.random.Generator,
    replicates: int = 10,
    mean: Mean = bent,
    root: np.ndarray = ROOT,
    **more: Any,
) -> Targets:
    """Targets of replicates that are drawn around the truth's curves."""
    one = mean(logs(truth)[None])[0]
    curves = (one + rng.normal(size=(replicates, CURVES)) @ root.T).reshape(replicates, len(STATISTICS), len(TIMES))
    by_name = {name: curves[:, k] for k, name in enumerate(STATISTICS)}
    return Targets.from_replicates(by_name, TIMES, extent=5.0, **more)


def exact(truth: Parameters, mean: Mean = bent, replicates: int = 10, relative: float = 0.1) -> Targets:
    """Targets that are the truth's curves themselves, with a scatter of a share of them."""
    table = mean(logs(truth)[None])[0].reshape(len(STATISTICS), len(TIMES))
    means = dict(zip(STATISTICS, table, strict=True))
    scatter = {name: relative * values for name, values in means.items()}
    return Targets.from_means(means, TIMES, scatter=scatter, replicates=replicates, extent=5.0)


def fitted(
    targets: Targets | Mapping[str, Targets],
    colonies: StandIn | Mapping[str, StandIn] | None = None,
    *,
    free: Sequence[str] = FREE,
    own: Sequence[str] = (),
    fixed: Mapping[str, Parameters] | None = None,
    bounds: Bounds | None = None,
    pulls: Mapping[str, tuple[float, float]] | None = None,
    start: np.ndarray | None = None,
    seed: int = 0,
    settings: FitSettings = SETTINGS,
) -> Fit:
    """A fit as `fit` makes it, of stand-ins. pulls: centre and width of priors in log λ."""
    by_name = {ALONE: targets} if isinstance(targets, Targets) else dict(targets)
    given = {name: StandIn() for name in by_name} if colonies is None else colonies
    grown: dict[str, Colonies] = {ALONE: given} if isinstance(given, StandIn) else {**given}
    space = Space.of(free, fixed or {name: Parameters(aspect_ratio=0.5) for name in by_name}, own, bounds)
    ensembles = Ensembles(by_name, grown, space, seed, settings)
    return Fitter(ensembles, dict(pulls or {}), lambda what, share: None).run(start)
