"""Sensitivities whose J, scatter and errors are known, without a model behind them."""

from typing import Any

import numpy as np

from yeastfit import Parameters, Sensitivity
from yeastfit.model.parameters import NAMES


def made_up(
    statistics: tuple[str, ...], times: list[float], free: tuple[str, ...], seed: int = 0, error: float = 0.0
) -> Sensitivity:
    """Random slopes of the order of 1; scatter with correlations; as if from very many runs."""
    rng = np.random.default_rng(seed)
    shape, count = (len(statistics), len(times)), len(statistics) * len(times)
    jacobian = rng.normal(size=(*shape, len(free)))
    half = rng.normal(size=(count, 2 * count))
    values: dict[str, Any] = {
        "parameters": Parameters(),
        "free": free,
        "statistics": statistics,
        "times": np.array(times, dtype=float),
        "method": "regression",
        "mean": 1.0 + rng.random(shape),
        "mean_error": np.full(shape, 1e-3),
        "jacobian": jacobian + error * rng.normal(size=jacobian.shape),
        "error": np.full(jacobian.shape, error),
        "pathwise_share": np.zeros(shape),
        "parts": {},
        "tails": np.ones(shape),
        "scatter": half @ half.T / (2 * count),
        "correlation": np.eye(count),
        "runs": {"mean": 10**7, "regression": 10**7},
        "seconds": {},
        "seed": seed,
        "spread": 0.1,
        "warnings": [],
    }
    assert set(free) <= set(NAMES)
    return Sensitivity(**values)
