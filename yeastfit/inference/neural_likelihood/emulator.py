"""An emulator of a simulator: the mean and the scatter of the statistics of one simulated data set, given λ.

Statistics s are whitened to u = L⁻¹(s − c), with L Lᵀ the scatter about a quadratic in x, and x the standardised
coordinates of the prior. Networks (`network`) give u | x ~ N(m(x), C(x)).

**Ensemble.** The simulations are dealt into as many folds as there are networks; each network, its baseline included,
is trained without one fold. So every simulation is held out once, and its standardised residual e = P(u − m) should be
a draw of N(0, 1) (`cross_validation`).

**Error of the emulator.** It does not average out over replicates. The mean of R replicates, none of which failed, has

    ū | x ~ N(m̄(x), C̄(x) / R + W(x) + G Δ Gᵀ + N),    C̄ = G Gᵀ = mean of the members' C,

with N the covariance of errors of measurement, where there are such. m̄ is the mean of m = Bφ + f_m over the M members,
W its error, from their covariances:

    W = (M − 1)² / M · cov(Bφ) + 1 / M · cov(f_m).

Quadratics Bφ depend on the simulations alone, of which members share most: their error is the jackknife's (Efron &
Stein 1981, doi:10.1214/aos/1176345462). Corrections f_m differ mainly by their starts and batches, independently, and
average out. Δ is diagonal: the mean square of a quadratic in x fitted to the held-out residuals, less that of noise.
The likelihood of data is that density times the probability of R successes, P^R. log P has an error of variance

    (1 − P)² [(M − 1)² / M · var(bᵀφ) + 1 / M · var(f)] + (1 − P) / P · δ

to first order in the logit bᵀφ + f, with its misfit δ (`success`). Networks as emulators of a likelihood:
Lueckmann et al. 2019, arXiv:1805.09294.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.neural_likelihood.densities import ROWS, densities, in_pieces
from yeastfit.inference.neural_likelihood.ensemble import Ensemble, moments_of_rows, success_error_of_rows
from yeastfit.inference.neural_likelihood.likelihood_of_means import LikelihoodOfMeans
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.prior.places import Places

Square = Float[np.ndarray, "statistic statistic"]
Rows = Float[np.ndarray, "row free"] | Places[np.ndarray]


@dataclass(frozen=True)
class Emulator:
    """Result of `train`.

    Attributes:
        labels: Names of the statistics.
        coordinates: x of λ.
        center: c.
        root: L.
        ensemble: The networks.
        cross_validation: Of held-out simulations.
        simulations: Trained on.
        failed: How many of them were failures.
        settings: Of the training (`training`).
        seed: Of the training.
    """

    labels: tuple[str, ...]
    coordinates: Coordinates
    center: Float[np.ndarray, " statistic"]
    root: Float[np.ndarray, "statistic statistic"]
    ensemble: Ensemble
    cross_validation: CrossValidation
    simulations: int
    failed: int
    settings: TrainingSettings
    seed: int

    def log_likelihood(
        self,
        values: Float[np.ndarray, "row free"],
        observed: Float[np.ndarray, " statistic"],
        replicates: int = 1,
        noise: Square | None = None,
    ) -> Float[np.ndarray, " row"]:
        """Log density of the mean of R replicates' statistics, and of none having failed, at each row of λ.

        Arguments:
            values: λ.
            observed: Statistics.
            replicates: R.
            noise: N, in the statistics' units.
        """
        likelihood = self.likelihood(observed, replicates, noise)
        return densities(likelihood, self.coordinates.prior.coordinates(values))

    def likelihood(
        self, observed: Float[np.ndarray, " statistic"], replicates: int = 1, noise: Square | None = None
    ) -> LikelihoodOfMeans:
        """`log_likelihood` of these data, for programs that sample."""
        u = self.whiten(observed)
        white = np.zeros((len(u), len(u)))
        if noise is not None:
            white = np.linalg.solve(self.root, np.linalg.solve(self.root, noise).T)
        mean, count, covariance = (jnp.asarray(one) for one in (u, float(replicates), 0.5 * (white + white.T)))
        volume = np.asarray(np.log(np.diag(self.root)).sum())
        return LikelihoodOfMeans(self.ensemble, self.coordinates, mean, count, covariance, volume)

    def moments(
        self, values: Rows
    ) -> tuple[
        Float[np.ndarray, "row statistic"],
        Float[np.ndarray, "row statistic statistic"],
        Float[np.ndarray, "row statistic statistic"],
        Float[np.ndarray, " row"],
    ]:
        """Mean and covariance of one replicate, covariance of the emulator's error, probability of success.

        Arguments:
            values: λ, or the places where replicates of it are tried.
        """
        x, shares = self._seen(values)
        pieces = [moments_of_rows(self.ensemble, jnp.asarray(one), shares) for one in in_pieces(x, ROWS)]
        every = (np.concatenate(one).astype(float)[: len(x)] for one in zip(*pieces, strict=True))
        mean, scatter, error, success = every
        back = self.root.T
        return self.center + mean @ back, self.root @ scatter @ back, self.root @ error @ back, np.exp(success)

    def success_error(self, values: Rows) -> Float[np.ndarray, " row"]:
        """Variance of the error of the log probability of success, of λ as for `moments`."""
        x, shares = self._seen(values)
        found = [success_error_of_rows(self.ensemble, jnp.asarray(one), shares) for one in in_pieces(x, ROWS)]
        return np.concatenate(found).astype(float)[: len(x)]

    def draw(
        self,
        values: Rows,
        rng: np.random.Generator,
        replicates: int = 1,
        noise: Square | None = None,
        single: Square | None = None,
    ) -> Float[np.ndarray, "row statistic"]:
        """Statistics drawn at each row of λ: means over R replicates, with all errors.

        Arguments:
            values: λ, or places of it, as for `moments`.
            rng: Where randomness comes from.
            replicates: R.
            noise: N.
            single: Covariance of the errors that each replicate has for itself.
        """
        places = Places.of(values)
        drawn = rng.standard_normal((len(places.values), len(self.labels)))
        for start in range(0, len(drawn), ROWS):
            rows = slice(start, start + ROWS)
            mean, scatter, error, _ = self.moments(places.rows(rows))
            scatter = scatter + (0.0 if single is None else single)
            roots = np.linalg.cholesky(scatter / replicates + error + (0.0 if noise is None else noise))
            drawn[rows] = mean + np.einsum("rij,rj->ri", roots, drawn[rows])
        return drawn

    def _seen(self, values: Rows) -> tuple[Float[np.ndarray, "row place free"], Float[Array, " place"]]:
        """x of places, and their shares."""
        places = Places.of(values)
        shape = places.values.shape
        x = self.coordinates.of_values(places.values.reshape(-1, shape[-1])).reshape(shape)
        return x, jnp.asarray(places.shares)

    def whiten(self, statistics: Float[np.ndarray, "*row statistic"]) -> Float[np.ndarray, "*row statistic"]:
        """u of s."""
        return np.linalg.solve(self.root, (statistics - self.center).T).T
