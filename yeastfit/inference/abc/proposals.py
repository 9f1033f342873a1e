"""Proposals of ABC-MCMC, as moves of emcee."""

from typing import Literal

import emcee
import numpy as np
from jaxtyping import Float

Move = Literal["gaussian", "stretch", "de"]
MOVES: tuple[Move, ...] = ("gaussian", "stretch", "de")


def move_of(move: Move, covariance: Float[np.ndarray, "free free"]) -> emcee.moves.Move:
    """emcee's move; the Gaussian one moves every walker by a vector of its own, of covariance Σ/3.

    emcee's own `GaussianMove` is not used: with a full covariance it moves all walkers by one and the same vector.
    """
    if move != "gaussian":
        return {"stretch": emcee.moves.StretchMove, "de": emcee.moves.DEMove}[move]()
    root = np.linalg.cholesky(covariance / 3)

    def proposal(x: np.ndarray, rng: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
        return x + rng.standard_normal(x.shape) @ root.T, np.zeros(len(x))

    return emcee.moves.MHMove(proposal, ndim=len(covariance))
