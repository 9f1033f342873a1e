"""Training of an emulator: whitening, baselines, folds, networks, and the cross-validation of held-out simulations.

What is learnt, and why so, says `emulator`.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.special import expit

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import ROUNDING, correlation_root
from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.ensemble import Ensemble
from yeastfit.inference.neural_likelihood.network import (
    Members,
    Network,
    Shape,
    Simulated,
    TrainingSettings,
    deal,
    fitted,
)
from yeastfit.inference.neural_likelihood.success import quadratic_logit, success_misfit
from yeastfit.inference.polynomial import monomials
from yeastfit.inference.prior.prior import Prior
from yeastfit.seeds import Stream, stream_of

ROWS_PER_TERM = 4  # simulations for each term of the quadratic, at least
ROOM = 1024  # simulations: programs are compiled for multiples of as many

Values = Float[np.ndarray, "simulation free"]
Statistics = Float[np.ndarray, "simulation statistic"]


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
    settings = (settings or TrainingSettings()).resolved(len(prior.free)).for_simulations(len(values))
    came = np.isfinite(statistics).all(axis=1)
    _check(values, statistics, came, prior.free, tuple(labels), settings)
    rng = np.random.default_rng(stream_of(seed, Stream.TRAINING, 0))
    room = -(-max(room or 0, len(values)) // ROOM) * ROOM
    coordinates = Coordinates.of(prior, values)
    x = coordinates.of_values(values)
    features = monomials(x)
    center, root = _whitening(features[came], statistics[came], tuple(labels))
    u = np.where(came[:, None], np.linalg.solve(root, (statistics - center).T).T, 0.0)
    folds, part = deal(len(values), settings, rng, room)
    baselines = np.stack([_least_squares(features, u, came & (part != one)) for one in range(settings.count)])
    shape = Shape.of(root)
    data = Simulated(*(jnp.asarray(_padded(one, room)) for one in (x, u, came.astype(float))))
    starts = Network.start(x.shape[1], u.shape[1], settings, rng)
    odds = None if came.all() else _odds(features, came, part, settings.count)
    networks, _ = fitted(Members(starts, jnp.asarray(baselines), odds, folds), shape, data, settings)
    held_out = _held_out(networks, jnp.asarray(baselines), shape, data, jnp.asarray(_padded(part, room)))
    residuals, corrections = (np.asarray(one, dtype=float)[: len(values)] for one in held_out)
    chosen = np.ones(len(values), dtype=bool) if near is None else near
    if (chosen & came).sum() < ROWS_PER_TERM * features.shape[1]:
        chosen = np.ones(len(values), dtype=bool)
    cross_validation = CrossValidation.of(residuals[chosen & came], features[chosen & came], tuple(labels))
    misfit = 0.0
    if odds is not None:
        share = expit(np.einsum("rf,rf->r", features, np.asarray(odds, dtype=float)[part]) + corrections)
        misfit = success_misfit(share[chosen], came[chosen], features[chosen])
    ensemble = Ensemble(
        networks, jnp.asarray(baselines), shape, jnp.asarray(cross_validation.misfit), odds, jnp.asarray(misfit)
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


def _odds(
    features: Float[np.ndarray, "simulation feature"],
    came: Bool[np.ndarray, " simulation"],
    part: Int[np.ndarray, " simulation"],
    members: int,
) -> Float[Array, "member feature"]:
    """b of each member, from the simulations that are not held out from it."""
    return jnp.asarray(np.stack([quadratic_logit(features[part != one], came[part != one]) for one in range(members)]))


@eqx.filter_jit
def _held_out(
    networks: Network, baselines: Array, shape: Shape, data: Simulated, part: Array
) -> tuple[Float[Array, "row statistic"], Float[Array, " row"]]:
    """e of every row, and what corrects its logit of success, from the member that it was held out from."""

    def by(network: Network, baseline: Array) -> tuple[Array, Array]:
        rest = data.u - monomials(data.x) @ baseline
        residual, _, logit = jax.vmap(lambda x, left: network.residual(x, left, shape))(data.x, rest)
        return residual, logit

    residuals, logits = eqx.filter_vmap(by)(networks, baselines)
    rows = jnp.arange(len(part))
    return residuals[part, rows], logits[part, rows]


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
    return max(ROWS_PER_TERM * terms, 2 * (statistics + 1), settings.resolved(free).count)


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
            f"values: {came.sum()} of {len(came)} simulations succeeded, an emulator of {len(free)} parameters "
            f"and {len(labels)} statistics needs at least {least}"
        )
    for name, column in zip(free, values.T, strict=True):
        if not np.isfinite(column).all() or np.ptp(column) == 0:
            raise InputError(f"values: {name} must be finite and vary from simulation to simulation")
