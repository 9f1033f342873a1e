"""Likelihood of the mean of replicates, by an emulator (`emulator`), for programs that sample."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.densities import ROWS
from yeastfit.inference.neural_likelihood.ensemble import Ensemble


class LikelihoodOfMeans(eqx.Module):
    """Log density of ū, and of no replicate having failed.

    Attributes:
        ensemble: The networks.
        coordinates: That they see.
        u: ū.
        replicates: R.
        noise: N, of u.
        volume: log det L, which is taken off.
    """

    ensemble: Ensemble
    coordinates: Coordinates
    u: Float[Array, " statistic"]
    replicates: Float[Array, ""]
    noise: Float[Array, "statistic statistic"]
    volume: Float[np.ndarray | Array, ""]

    def __call__(self, x: Float[Array, "row free"]) -> Float[Array, " row"]:
        """Of rows of the prior's coordinates, in the networks' precision."""
        seen = self.coordinates.of_prior(x).astype(self.u.dtype)
        data = self.u, self.replicates, self.noise
        return jax.lax.map(lambda one: self.ensemble.log_likelihood(one, *data), seen, batch_size=ROWS) - self.volume
