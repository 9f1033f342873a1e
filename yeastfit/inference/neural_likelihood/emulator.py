"""An emulator of a simulator: the mean and the scatter of the statistics of one simulated data set, given λ.

Statistics s are whitened to u = L⁻¹(s − c), with L Lᵀ the scatter about a quadratic in x, and x the standardised
coordinates of λ (`coordinates`). Networks (`network`) give u | x ~ N(m(x), C(x)).

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
The likelihood of data is that density times the probability of R successes. Networks as emulators of a likelihood:
Lueckmann et al. 2019, arXiv:1805.09294.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import ROUNDING, correlation_root
from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.neural_likelihood.ensemble import (
    ROWS,
    Ensemble,
    log_likelihood_of_rows,
    moments_of_rows,
    slopes_of_rows,
)
from yeastfit.inference.neural_likelihood.network import (
    Network,
    Shape,
    Simulated,
    TrainingSettings,
    deal,
    fitted,
)
from yeastfit.inference.polynomial import monomials
from yeastfit.inference.posterior.prior import Prior

ROWS_PER_TERM = 4  # simulations for each term of the quadratic, at least
ROOM = 1024  # simulations: programs are compiled for multiples of as many

Values = Float[np.ndarray, "simulation free"]
Statistics = Float[np.ndarray, "simulation statistic"]
Square = Float[np.ndarray, "statistic statistic"]


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
        settings: Of the training.
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
        return self.likelihood(observed, replicates, noise)(values)

    def likelihood(
        self, observed: Float[np.ndarray, " statistic"], replicates: int = 1, noise: Square | None = None
    ) -> Callable[[Values], Float[np.ndarray, " row"]]:
        """`log_likelihood` of these data as a function of λ; what does not depend on λ is computed once."""
        u = self.whiten(observed)
        white = np.zeros((len(u), len(u)))
        if noise is not None:
            white = np.linalg.solve(self.root, np.linalg.solve(self.root, noise).T)
        rest = [jnp.asarray(one) for one in (u, float(replicates), 0.5 * (white + white.T))]
        volume = np.log(np.diag(self.root)).sum()

        def of_rows(values: Values) -> Float[np.ndarray, " row"]:
            x = self.coordinates.of_values(values)
            return np.asarray(log_likelihood_of_rows(self.ensemble, x, *rest), dtype=float) - volume

        return of_rows

    def moments(
        self, values: Float[np.ndarray, "row free"]
    ) -> tuple[
        Float[np.ndarray, "row statistic"],
        Float[np.ndarray, "row statistic statistic"],
        Float[np.ndarray, "row statistic statistic"],
        Float[np.ndarray, " row"],
    ]:
        """Mean and covariance of one replicate, covariance of the emulator's error, probability of success."""
        x = self.coordinates.of_values(values)
        pieces = in_pieces(x, ROWS)
        every = zip(*(moments_of_rows(self.ensemble, jnp.asarray(one)) for one in pieces), strict=True)
        mean, scatter, error, success = (np.concatenate(one).astype(float)[: len(x)] for one in every)
        back = self.root.T
        return self.center + mean @ back, self.root @ scatter @ back, self.root @ error @ back, np.exp(success)

    def slopes(self, values: Float[np.ndarray, "row free"]) -> Float[np.ndarray, "row statistic free"]:
        """Derivatives of the mean of one replicate by the coordinates x."""
        x = self.coordinates.of_values(values)
        found = [slopes_of_rows(self.ensemble, jnp.asarray(one)) for one in in_pieces(x, ROWS)]
        return np.einsum("ij,rjf->rif", self.root, np.concatenate(found).astype(float)[: len(x)])

    def draw(
        self,
        values: Float[np.ndarray, "row free"],
        rng: np.random.Generator,
        replicates: int = 1,
        noise: Square | None = None,
        between: Float[np.ndarray, "row statistic statistic"] | None = None,
    ) -> Float[np.ndarray, "row statistic"]:
        """Statistics drawn at each row of λ: means over R replicates, with all errors.

        Arguments:
            values: λ.
            rng: Where randomness comes from.
            replicates: R.
            noise: N.
            between: What λ that differ between replicates add to the covariance of one.
        """
        drawn = rng.standard_normal((len(values), len(self.labels)))
        for start in range(0, len(values), ROWS):
            rows = slice(start, start + ROWS)
            mean, scatter, error, _ = self.moments(values[rows])
            scatter = scatter if between is None else scatter + between[rows]
            roots = np.linalg.cholesky(scatter / replicates + error + (0.0 if noise is None else noise))
            drawn[rows] = mean + np.einsum("rij,rj->ri", roots, drawn[rows])
        return drawn

    def whiten(self, statistics: Float[np.ndarray, "*row statistic"]) -> Float[np.ndarray, "*row statistic"]:
        """u of s."""
        return np.linalg.solve(self.root, (statistics - self.center).T).T


def train(
    values: Values,
    statistics: Statistics,
    *,
    prior: Prior,
    labels: Sequence[str],
    seed: int,
    settings: TrainingSettings | None = None,
    near: Bool[np.ndarray, " simulation"] | None = None,
    room: int | None = None,
) -> Emulator:
    """Train an emulator.

    Arguments:
        values: λ of the simulations.
        statistics: Of the simulations; a row of nan is one that failed.
        prior: Its coordinates are used.
        labels: Names of the statistics.
        seed: Same seed, same emulator.
        settings: Of the training.
        near: Simulations that the cross-validation, and Δ, are about; all by default, and where they are too few.
        room: Simulations that there may be in later calls, which then need no further compilation.

    Raises:
        InputError: Simulations are too few, a parameter or a statistic does not vary, or statistics repeat one another.
    """
    settings = (settings or TrainingSettings()).resolved(len(prior.free))
    came = np.isfinite(statistics).all(axis=1)
    _check(values, statistics, came, prior.free, tuple(labels), settings)
    rng = np.random.default_rng(seed)
    room = -(-max(room or 0, len(values)) // ROOM) * ROOM
    coordinates = Coordinates.of(prior, values)
    x = coordinates.of_values(values)
    features = monomials(x)
    center, root = _whitening(features[came], statistics[came], tuple(labels))
    u = np.where(came[:, None], np.linalg.solve(root, (statistics - center).T).T, 0.0)
    folds, part = deal(len(values), settings, rng, room)
    baselines = np.stack([_least_squares(features, u, came & (part != one)) for one in range(settings.members)])
    shape = Shape.of(root)
    data = Simulated(*(jnp.asarray(_padded(one, room)) for one in (x, u, came.astype(float))))
    starts = Network.start(x.shape[1], u.shape[1], settings, rng)
    networks, _ = fitted(starts, jnp.asarray(baselines), shape, data, folds, settings)
    held_out = _residuals(networks, jnp.asarray(baselines), shape, data, jnp.asarray(_padded(part, room)))
    residuals = np.asarray(held_out, dtype=float)[: len(values)]
    chosen = came & (np.ones(len(values), dtype=bool) if near is None else near)
    if chosen.sum() < ROWS_PER_TERM * features.shape[1]:
        chosen = came
    cross_validation = CrossValidation.of(residuals[chosen], features[chosen], tuple(labels))
    ensemble = Ensemble(
        networks, jnp.asarray(baselines), shape, jnp.asarray(cross_validation.misfit), fails=not came.all()
    )
    return Emulator(
        tuple(labels),
        coordinates,
        center,
        root,
        ensemble,
        cross_validation,
        len(values),
        int((~came).sum()),
        settings,
        seed,
    )


@eqx.filter_jit
def _residuals(
    networks: Network, baselines: Array, shape: Shape, data: Simulated, part: Array
) -> Float[Array, "row statistic"]:
    """e of every row, from the member that it was held out from."""

    def by(network: Network, baseline: Array) -> Array:
        rest = data.u - monomials(data.x) @ baseline
        return jax.vmap(lambda x, left: network.residual(x, left, shape)[0])(data.x, rest)

    every = eqx.filter_vmap(by)(networks, baselines)
    return jnp.take_along_axis(every, part[None, :, None], axis=0)[0]


def in_pieces(rows: Float[np.ndarray, "row free"], length: int) -> Float[np.ndarray, "piece length free"]:
    """Rows in pieces of one length; the last piece is filled up from the first row on."""
    count = max(1, -(-len(rows) // length))
    return np.resize(rows, (count, length, rows.shape[1]))


def _padded(rows: np.ndarray, room: int) -> np.ndarray:
    """With rows of 0 at the end."""
    return np.concatenate([rows, np.zeros((room - len(rows), *rows.shape[1:]), rows.dtype)])


def _least_squares(features: np.ndarray, u: np.ndarray, rows: np.ndarray) -> Float[np.ndarray, "feature statistic"]:
    return np.linalg.lstsq(features[rows], u[rows], rcond=None)[0]


def _whitening(
    features: Float[np.ndarray, "simulation feature"], statistics: Statistics, labels: tuple[str, ...]
) -> tuple[Float[np.ndarray, " statistic"], Float[np.ndarray, "statistic statistic"]]:
    """c and L."""
    still = statistics.std(axis=0) <= ROUNDING * np.abs(statistics).max(axis=0)
    if still.any():
        names = ", ".join(label for label, one in zip(labels, still, strict=True) if one)
        raise InputError(f"statistics: {names} is the same in all simulations, leave it out")
    rest = statistics - features @ np.linalg.lstsq(features, statistics, rcond=None)[0]
    covariance = np.cov(rest, rowvar=False).reshape(len(labels), len(labels))
    advice = "leave out statistics that follow from others"
    scale, root = correlation_root(covariance, argument="statistics", of=", ".join(labels), advice=advice)
    return statistics.mean(axis=0), scale[:, None] * root


def fewest(free: int, statistics: int, settings: TrainingSettings) -> int:
    """Simulations that an emulator of so many parameters and statistics needs at least."""
    terms = (free + 1) * (free + 2) // 2
    return max(ROWS_PER_TERM * terms, 2 * (statistics + 1), settings.members)


def _check(
    values: Values,
    statistics: Statistics,
    came: Bool[np.ndarray, " simulation"],
    free: tuple[str, ...],
    labels: tuple[str, ...],
    settings: TrainingSettings,
) -> None:
    """Raise `InputError` where the simulations cannot be learnt from."""
    if values.shape != (len(statistics), len(free)) or statistics.shape[1] != len(labels):
        raise InputError(
            f"values and statistics have shapes {values.shape} and {statistics.shape}, "
            f"{len(free)} parameters and {len(labels)} statistics in as many rows are expected"
        )
    least = fewest(len(free), len(labels), settings)
    if came.sum() < least:
        raise InputError(
            f"values: {came.sum()} of {len(came)} simulations came to something, an emulator of {len(free)} parameters "
            f"and {len(labels)} statistics needs at least {least}"
        )
    for name, column in zip(free, values.T, strict=True):
        if not np.isfinite(column).all() or np.ptp(column) == 0:
            raise InputError(f"values: {name} must be finite and vary from simulation to simulation")
