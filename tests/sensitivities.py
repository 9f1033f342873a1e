"""Sensitivities whose J, scatter and errors are known, without a model behind them."""

from typing import Any

import numpy as np

from yeastfit import PARAMETERS, Observable, Sensitivity


def made_up(
    statistics: tuple[str, ...], times: list[float], free: tuple[str, ...], seed: int = 0, error: float = 0.0
) -> Sensitivity:
    """Random slopes of the order of 1; scatter with correlations; as if from very many runs."""
    rng = np.random.default_rng(seed)
    count = len(statistics) * len(times)
    jacobian = rng.normal(size=(count, len(free)))
    half = rng.normal(size=(count, 2 * count))
    values: dict[str, Any] = {
        "at": PARAMETERS.defaults,
        "free": free,
        "plausible": {name: PARAMETERS[name].plausible for name in free},
        "observables": tuple(Observable(name, time) for name in statistics for time in times),
        "method": "regression",
        "mean": 1.0 + rng.random(count),
        "mean_error": np.full(count, 1e-3),
        "jacobian": jacobian + error * rng.normal(size=jacobian.shape),
        "error": np.full(jacobian.shape, error),
        "pathwise_share": np.zeros(count),
        "parts": {},
        "tails": np.ones(count),
        "scatter": half @ half.T / (2 * count),
        "correlation": np.eye(count),
        "runs": {"mean": 10**7, "regression": 10**7},
        "seconds": {},
        "seed": seed,
        "spread": 0.1,
        "warnings": (),
    }
    return Sensitivity(**values)
