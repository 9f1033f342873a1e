"""Posteriors of draws that a test makes up."""

from typing import Any

import numpy as np

from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.prior.prior import Prior


def flat_prior(*names: str) -> Prior:
    """Uniform, wider than whatever is drawn."""
    return Prior.of({name: {"distribution": "uniform", "low": -1e6, "high": 1e6} for name in names})


def made_posterior(values: np.ndarray, weights: np.ndarray | None = None, **more: Any) -> Posterior:
    """Draws [chain, draw, free] of one or two parameters, with one statistic; further attributes by name."""
    shape = values.shape[:2]
    made: dict[str, Any] = {
        "prior": flat_prior(*("mobility", "aspect_ratio")[: values.shape[2]]),
        "labels": ("area",),
        "observed": np.zeros(len(more.get("labels", ("area",)))),
        "values": values,
        "weights": np.full(shape, 1.0 / values[..., 0].size) if weights is None else weights,
        "log_probability": np.zeros(shape),
        "acceptance": np.full(shape[0], 0.5),
        "statistics": np.full((*shape, len(more.get("labels", ("area",)))), np.nan),
        "simulations": 100,
        "seconds": 1.5,
        "seed": 3,
        "method": "made up",
        "status": Status.SETTLED,
    }
    return Posterior(**{**made, **more})
