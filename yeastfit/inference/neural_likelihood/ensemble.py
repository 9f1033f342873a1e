"""The ensemble of an emulator's networks: m̄, C̄, the emulator's error, and the likelihood they make (`emulator`)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.inference.neural_likelihood.network import Network, Shape
from yeastfit.inference.polynomial import monomials

ROWS = 128  # of λ at a time, as each needs several covariances


class Ensemble(eqx.Module):
    """All networks together.

    Attributes:
        networks: With a leading axis.
        baselines: B of each.
        shape: L.
        misfit: Δ.
        fails: Whether simulations fail at all.
    """

    networks: Network
    baselines: Float[Array, "member feature statistic"]
    shape: Shape
    misfit: Float[Array, " statistic"]
    fails: bool = eqx.field(static=True)

    def moments(self, x: Float[Array, " free"]) -> tuple[Array, Array, Array, Array]:
        """m̄, C̄, the emulator's error W + GΔGᵀ, and the log probability of success."""
        features = monomials(x)

        def one(network: Network, baseline: Array) -> tuple[Array, Array, Array, Array]:
            return features @ baseline, *network.moments(x, self.shape)

        quadratics, corrections, roots, logits = eqx.filter_vmap(one)(self.networks, self.baselines)
        count = len(roots)
        scatter = jnp.einsum("mij,mkj->ik", roots, roots) / count
        root = jnp.linalg.cholesky(scatter)
        learnt = (count - 1) ** 2 * _covariance(quadratics) + _covariance(corrections)
        error = learnt / count + (root * self.misfit) @ root.T
        success = jnp.mean(jax.nn.log_sigmoid(logits)) if self.fails else jnp.zeros(())
        return (quadratics + corrections).mean(axis=0), scatter, error, success

    def mean(self, x: Float[Array, " free"]) -> Float[Array, " statistic"]:
        """m̄ alone."""
        features = monomials(x)

        def one(network: Network, baseline: Array) -> Array:
            return features @ baseline + network(x)[0]

        return eqx.filter_vmap(one)(self.networks, self.baselines).mean(axis=0)

    def slopes(self, x: Float[Array, " free"]) -> Float[Array, "statistic free"]:
        """∂m̄/∂x."""
        return jax.jacfwd(self.mean)(x)

    def log_likelihood(
        self,
        x: Float[Array, " free"],
        u: Float[Array, " statistic"],
        replicates: Array,
        noise: Float[Array, "statistic statistic"],
    ) -> Array:
        """log p(ū | x) of R replicates, none of which failed."""
        mean, scatter, error, success = self.moments(x)
        root = jnp.linalg.cholesky(scatter / replicates + error + noise)
        deviation = jax.scipy.linalg.solve_triangular(root, u - mean, lower=True)
        normal = -0.5 * jnp.sum(deviation**2 + jnp.log(2 * jnp.pi)) - jnp.sum(jnp.log(jnp.diag(root)))
        return normal + replicates * success


def _covariance(rows: Float[Array, "member statistic"]) -> Float[Array, "statistic statistic"]:
    off = rows - rows.mean(axis=0)
    return off.T @ off / (len(rows) - 1)


@eqx.filter_jit
def moments_of_rows(ensemble: Ensemble, x: Float[Array, "row free"]) -> tuple[Array, Array, Array, Array]:
    """`Ensemble.moments` of every row; each number of rows is compiled for."""
    return jax.vmap(ensemble.moments)(x)


@eqx.filter_jit
def slopes_of_rows(ensemble: Ensemble, x: Float[Array, "row free"]) -> Float[Array, "row statistic free"]:
    """`Ensemble.slopes` of every row; each number of rows is compiled for."""
    return jax.vmap(ensemble.slopes)(x)


@eqx.filter_jit
def log_likelihood_of_rows(
    ensemble: Ensemble,
    x: Float[Array | np.ndarray, "row free"],
    u: Float[Array | np.ndarray, " statistic"],
    replicates: Float[Array | np.ndarray, ""],
    noise: Float[Array | np.ndarray, "statistic statistic"],
) -> Float[Array, " row"]:
    """`Ensemble.log_likelihood` of every row, some rows at a time."""
    rest = [jnp.asarray(one) for one in (u, replicates, noise)]
    return jax.lax.map(lambda one: ensemble.log_likelihood(one, *rest), jnp.asarray(x), batch_size=ROWS)
