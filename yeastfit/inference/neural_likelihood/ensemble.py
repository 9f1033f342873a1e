"""The ensemble of an emulator's networks: m̄, C̄, the emulator's error, and the likelihood they make (`emulator`)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.inference.neural_likelihood.network import Network, Shape
from yeastfit.inference.polynomial import monomials


class Ensemble(eqx.Module):
    """All networks together.

    Attributes:
        networks: With a leading axis.
        baselines: B of each.
        shape: L.
        misfit: Δ.
        odds: Of each, coefficients of a quadratic for the logit of success; None where no simulation failed.
        success_misfit: δ.
    """

    networks: Network
    baselines: Float[Array, "member feature statistic"]
    shape: Shape
    misfit: Float[Array, " statistic"]
    odds: Float[Array, "member feature"] | None = None
    success_misfit: Float[Array, ""] | float = 0.0

    def moments(self, x: Float[Array, " free"]) -> tuple[Array, Array, Array, Array]:
        """m̄, C̄, the emulator's error W + GΔGᵀ, and the log probability of success."""
        return self.moments_around(x[None], jnp.ones(1, x.dtype))

    def moments_around(
        self, places: Float[Array, "place free"], shares: Float[Array, " place"]
    ) -> tuple[Array, Array, Array, Array]:
        """`moments` of replicates that are tried at these places.

        With m_k, C_k and P_k those at place k, where the share a_k of replicates is tried, those that succeed have

            m̄ = Σ w_k m_k,    C̄ = Σ w_k [C_k + (m_k − m̄)(m_k − m̄)ᵀ],    w_k = a_k P_k / Σ a P,

        and the probability of success is Σ a P. Errors are common to all places; G is the root of Σ w_k C_k.
        """

        def at(x: Array) -> tuple[Array, Array, Array, Array]:
            """Quadratics and corrections of every member, C̄ and log P."""
            features = monomials(x)

            def one(network: Network, baseline: Array) -> tuple[Array, Array, Array, Array]:
                return features @ baseline, *network.moments(x, self.shape)

            quadratics, corrections, roots, off = eqx.filter_vmap(one)(self.networks, self.baselines)
            scatter = jnp.einsum("mij,mkj->ik", roots, roots) / len(roots)
            return quadratics, corrections, scatter, self._log_success(features, off)

        quadratics, corrections, scatters, successes = jax.vmap(at)(places)
        joint = jnp.log(shares) + successes
        share = jax.nn.softmax(joint)
        means = (quadratics + corrections).mean(axis=1)
        mean, scatter = share @ means, jnp.einsum("k,kij->ij", share, scatters)
        quadratics, corrections = (jnp.einsum("k,kms->ms", share, one) for one in (quadratics, corrections))
        count, root = len(quadratics), jnp.linalg.cholesky(scatter)
        learnt = (count - 1) ** 2 * _covariance(quadratics) + _covariance(corrections)
        error = learnt / count + (root * self.misfit) @ root.T
        between = jnp.einsum("k,ki,kj->ij", share, means - mean, means - mean)
        return mean, scatter + between, error, jax.nn.logsumexp(joint)

    def _log_success(self, features: Float[Array, " feature"], off: Float[Array, " member"]) -> Float[Array, ""]:
        """log P where the networks correct the logit by `off`."""
        if self.odds is None:
            return jnp.zeros((), features.dtype)
        return jnp.mean(jax.nn.log_sigmoid(self.odds @ features + off))

    def success_error_around(
        self, places: Float[Array, "place free"], shares: Float[Array, " place"]
    ) -> Float[Array, ""]:
        """Variance of the error of the log probability of success, of replicates as for `moments_around`.

        Errors at these places are taken for one: (Σ w_k √v_k)².
        """
        odds = self.odds
        if odds is None:
            return jnp.zeros(())

        def at(x: Array) -> tuple[Array, Array]:
            """v, and log P."""
            features = monomials(x)
            quadratics, corrections = odds @ features, eqx.filter_vmap(lambda network: network(x)[2])(self.networks)
            count, share = len(quadratics), jax.nn.sigmoid(jnp.mean(quadratics + corrections))
            learnt = (count - 1) ** 2 * jnp.var(quadratics, ddof=1) + jnp.var(corrections, ddof=1)
            error = (1.0 - share) ** 2 * learnt / count + (1.0 - share) / share * self.success_misfit
            return error, self._log_success(features, corrections)

        errors, successes = jax.vmap(at)(places)
        return (jax.nn.softmax(jnp.log(shares) + successes) @ jnp.sqrt(errors)) ** 2

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
def moments_of_rows(
    ensemble: Ensemble, places: Float[Array, "row place free"], shares: Float[Array, " place"]
) -> tuple[Array, Array, Array, Array]:
    """`Ensemble.moments_around` the places of every row; each number of rows and of places is compiled for."""
    return jax.vmap(ensemble.moments_around, (0, None))(places, shares)


@eqx.filter_jit
def success_error_of_rows(
    ensemble: Ensemble, places: Float[Array, "row place free"], shares: Float[Array, " place"]
) -> Float[Array, " row"]:
    """`Ensemble.success_error_around` the places of every row; each number of rows and of places is compiled for."""
    return jax.vmap(ensemble.success_error_around, (0, None))(places, shares)
