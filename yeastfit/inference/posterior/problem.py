"""What a sampler solves: the posterior of a simulator's parameters given data.

    p(λ | o) ∝ π(λ) p(o | λ),    o = 1/R Σ_r s_r + e,   s_r ~ simulator(λ),   e ~ N(0, N)

π is the prior, o the observed statistics, means over R replicates, and N the covariance of errors of measurement, which
replicates do not average out.

Where colonies may differ in λ (`variation`), the single colonies are the data, o_1 … o_R instead of their mean, and τ,
the scatter of their λ, is inferred beside λ:

    p(λ, τ | o_1 … o_R) ∝ π(λ) π(τ) ∫ N(e; 0, N) Π_r p(o_r | λ, τ, e) de,    o_r = s_r + e + e_r,    e_r ~ N(0, M)

with M the covariance of errors of measurement that every colony has for itself.

Where there are `limits`, a colony beyond them is none of the data's kind: to samplers that learn the likelihood it is
one that failed (`posterior.limits`). Others compare it as if it were at the limits: rare colonies far from all others
would decide what scatter distances are measured by.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import measurement_covariance
from yeastfit.inference.polynomial import sobol_points
from yeastfit.inference.posterior.limits import Limits, check_limits, within
from yeastfit.inference.prior.places import Places
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.prior.variation import ColonyCoordinates, Variation
from yeastfit.inference.simulator import (
    Limited,
    Mismeasured,
    Replicates,
    Simulator,
    check_simulator,
    labels_of,
    root_of,
    same_observables,
)
from yeastfit.inference.targets import Targets
from yeastfit.kinds import check_kind
from yeastfit.numbers import array_of
from yeastfit.seeds import Stream, stream_of
from yeastfit.text import quoted

ROUNDING = 1e-9  # of a covariance, beside its variances

Vector = Float[np.ndarray, " statistic"]
Square = Float[np.ndarray, "statistic statistic"]


@dataclass(frozen=True)
class Problem:
    """A simulator, a prior and data, checked to belong together.

    Attributes:
        simulator: Simulates one replicate per row.
        prior: Of the simulator's parameters, in their order.
        observed: Statistics, in the order of the simulator's observables.
        replicates: How many replicates `observed` is the mean of.
        noise: Covariance of the errors of measurement of `observed`; None where there are none.
        colonies: Statistics of the single replicates, where they are known; nan where one is missing.
        colony_noise: M; None where there are no such errors.
        variation: That λ scatters between colonies; None where all are of one λ.
        limits: Least and largest value of each statistic, beyond which a colony is none of the data's kind.

    Raises:
        InputError: They do not belong together.
    """

    simulator: Simulator
    prior: Prior
    observed: Vector
    replicates: int = 1
    noise: Square | None = None
    colonies: Float[np.ndarray, "colony statistic"] | None = None
    colony_noise: Square | None = None
    variation: Variation | None = None
    limits: Limits | None = None

    def __post_init__(self) -> None:
        names, labels = self.simulator.parameters.names, self.labels
        if self.prior.free != names:
            raise InputError(f"prior is of {', '.join(self.prior.free)}, the simulator takes {', '.join(names)}")
        self.prior.check(self.simulator.parameters)
        if self.observed.shape != (len(labels),) or not np.isfinite(self.observed).all():
            raise InputError(
                f"observed is {self.observed}, the simulator gives {', '.join(labels)}: {len(labels)} finite "
                "statistics are expected"
            )
        if isinstance(self.replicates, bool) or not isinstance(self.replicates, int | np.integer):
            raise InputError(f"replicates is {quoted(self.replicates)}, it must be a whole number")
        if self.replicates < 1:
            raise InputError(f"replicates is {self.replicates}, it must be at least 1")
        for name, noise in (("noise", self.noise), ("colony_noise", self.colony_noise)):
            if noise is not None:
                _check_covariance(name, noise, len(labels))
        self._check_colonies()
        if self.limits is not None:
            check_limits(self.limits, self.observed[None] if self.colonies is None else self.colonies, labels)

    def _check_colonies(self) -> None:
        """Raise `InputError` where single colonies are of other statistics, or missing where they are needed."""
        rows, count = self.colonies, len(self.labels)
        if rows is not None and (rows.shape[1] != count or not np.isfinite(rows).any(axis=0).all()):
            raise InputError(
                f"colonies have shape {rows.shape}, {count} statistics are expected, each of one colony at least"
            )
        if self.variation is None:
            return
        if rows is None:
            raise InputError(
                "variation: the data are means, and single colonies are needed: give a row for each, or leave it out"
            )
        _ = self.colony_coordinates

    @staticmethod
    def of(
        simulator: Simulator,
        prior: Prior,
        observed: Targets | Vector | Float[np.ndarray, "colony statistic"] | Sequence[float],
        replicates: int = 1,
        noise: Square | None = None,
        *,
        colony_noise: Square | None = None,
        variation: Variation | None = None,
        limits: Limits | None = None,
    ) -> "Problem":
        """Of data as an array, of one row for each colony, or of `Targets`.

        Rows and `Targets` bring their own replicates, `Targets` also their errors of measurement. Where points are
        means of different numbers of replicates, the fewest count.

        Arguments:
            simulator: Of one replicate a row.
            prior: Of its parameters.
            observed: The data.
            replicates: How many replicates an array is the mean of.
            noise: Covariance of the errors of measurement of the mean.
            colony_noise: M, of those that every replicate has for itself.
            variation: That λ scatters between colonies.
            limits: Least and largest value of each statistic.

        Raises:
            InputError: They do not belong together.
        """
        check_simulator(simulator)
        check_kind("prior", prior, Prior, "a yeastfit.Prior, such as yeastfit.Prior.default(simulator.parameters)")
        if variation is not None:
            check_kind("variation", variation, Variation)
        if limits is not None:
            check_kind("limits", limits, np.ndarray, "an array with a row, least and largest, for each statistic")
        if not isinstance(observed, Targets):
            data = array_of(observed, "observed")
            if data.ndim != 2:
                return Problem(simulator, prior, data, replicates, noise, None, colony_noise, variation, limits)
            each = _seen(data)
            return Problem(simulator, prior, *_means(each), noise, each, colony_noise, variation, limits)
        if not same_observables(simulator.observables, observed.observables):
            gives, has = (", ".join(map(str, each.observables)) for each in (simulator, observed))
            raise InputError(f"observed: the targets are {has}, the simulator gives {gives}")
        rows = None if observed.curves is None else _seen(observed.curves[:, observed.measured])
        fewest = int(observed.replicates[observed.measured].min())
        if noise is None:
            errors = observed.measurement_errors(None)
            noise = measurement_covariance(observed.observables, observed.values, errors)
        return Problem(simulator, prior, observed.values, fewest, noise, rows, colony_noise, variation, limits)

    @property
    def colony_coordinates(self) -> ColonyCoordinates:
        """In which colonies scatter, where they do."""
        return ColonyCoordinates.of(self.simulator.parameters, self.varying)

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the parameters that scatter, where some alone do."""
        return () if self.variation is None else tuple(self.variation.varying)

    @property
    def inferred_prior(self) -> Prior:
        """Of all that is inferred: λ, and τ where colonies scatter."""
        return self.prior if self.variation is None else self.variation.joined(self.prior)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the statistics."""
        return labels_of(self.simulator)

    def data_sets(self, simulator: Simulator, count: int) -> Simulator:
        """A simulator of data sets like the data: means over `count` replicates, with errors of measurement.

        A replicate beyond the limits counts as one at them.

        Arguments:
            simulator: Of one replicate: the problem's own, or a `CachedSimulator` around it.
            count: Replicates of a data set.

        Returns:
            A simulator of the same parameters and observables.
        """
        held = simulator if self.limits is None else Limited(simulator, self.limits)
        means = Replicates(held, count) if count > 1 else held
        return means if self.noise is None or not self.noise.any() else Mismeasured(means, root_of(self.noise))

    def prior_values(self, count: int, seed: int) -> Float[np.ndarray, "draw free"]:
        """λ of the first simulations of a run, the same for every method: scrambled Sobol' points of the prior.

        Arguments:
            count: How many.
            seed: Of the run.

        Returns:
            Rows of λ.
        """
        return self.prior.quantile(sobol_points(count, len(self.prior.free), stream_of(seed, Stream.PRIOR, 0)))

    @property
    def single_noise(self) -> Square | None:
        """M where single colonies are the data; None where their mean is."""
        return None if self.variation is None else self.colony_noise

    def places(
        self, values: Float[np.ndarray, "row free"], z: Float[np.ndarray, "row varied"]
    ) -> Float[np.ndarray, "row free"] | Places[np.ndarray]:
        """Where colonies of each λ are, for an emulator's moments: at λ, or around it where they scatter.

        Arguments:
            values: λ.
            z: Of τ(z); without columns where colonies do not scatter.

        Returns:
            λ, or places around it (`ColonyCoordinates.around`).
        """
        if self.variation is None:
            return values
        return self.colony_coordinates.around(values, self.variation.tau(z[:, 0]))

    def inferred_values(
        self, x: Float[np.ndarray, "draw free"], z: Float[np.ndarray, "draw varied"]
    ) -> Float[np.ndarray, "draw inferred"]:
        """All that is inferred, of draws in the chains' coordinates.

        Arguments:
            x: The prior's coordinates.
            z: Of τ(z); without columns where colonies do not scatter.

        Returns:
            λ, and in a last column τ where colonies scatter.
        """
        values = self.prior.values(x)
        return values if self.variation is None else np.column_stack([values, self.variation.tau(z)])

    def scattered(
        self, x: Float[np.ndarray, "draw free"], tau: Float[np.ndarray, "draw varied"], rng: np.random.Generator
    ) -> Float[np.ndarray, "draw free"]:
        """One colony of each λ, in the prior's coordinates.

        Arguments:
            x: Of λ.
            tau: τ of each; without columns where colonies do not scatter.
            rng: Where randomness comes from.

        Returns:
            x of λ_r, in no parameter farther from λ than the places around it (`ColonyCoordinates.around`) are; that of
            λ where colonies do not scatter, or where λ_r is none that a colony may have.
        """
        if self.variation is None:
            return x
        coordinates = self.colony_coordinates
        farthest = np.sqrt(coordinates.pairs)
        step = tau * np.clip(rng.standard_normal(x.shape), -farthest, farthest)
        moved = coordinates.moved(self.prior.values(x), step)
        return np.where(self.admits(moved)[:, None], self.prior.coordinates(moved), x)

    def admits(self, values: Float[np.ndarray, "row free"]) -> Bool[np.ndarray, " row"]:
        """Which λ single colonies may have: those of the prior, and where colonies scatter any that is admissible.

        Shares stay within their prior, at whose ends an emulator's coordinates end, too (`Distribution.is_share`).
        """
        if self.variation is None:
            return self.prior.contains(values)
        low, high = self.prior.support.T
        shares = np.array([one.is_share for one in self.prior.distributions.values()])
        known = np.stack(
            [one.admissible(column) for one, column in zip(self.simulator.parameters.values(), values.T, strict=True)],
            axis=1,
        )
        return (known & (~shares | ((values >= low) & (values <= high)))).all(axis=1)

    def of_their_kind(self, statistics: Float[np.ndarray, "draw statistic"]) -> Float[np.ndarray, "draw statistic"]:
        """Statistics of simulated colonies, nan throughout for one beyond the limits."""
        return within(statistics, self.limits)

    def unreached(self, statistics: Float[np.ndarray, "draw statistic"]) -> list[str]:
        """Observations outside the range of all simulations from the prior, in words."""
        low, high = statistics.min(axis=0), statistics.max(axis=0)
        outside = np.flatnonzero((self.observed < low) | (self.observed > high))
        return [
            f"{self.labels[k]} was observed as {self.observed[k]:.4g}, the prior's simulations have "
            f"{low[k]:.4g}..{high[k]:.4g}"
            for k in outside
        ]


def _seen(rows: Float[np.ndarray, "colony statistic"]) -> Float[np.ndarray, "colony statistic"]:
    """The colonies of which anything is known."""
    return rows[np.isfinite(rows).any(axis=1)]


def _means(rows: Float[np.ndarray, "colony statistic"]) -> tuple[Vector, int]:
    """Means of single colonies, and the fewest behind one of them; nan and 0 where a statistic is of none."""
    known = np.isfinite(rows)
    counts = known.sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.where(known, rows, 0.0).sum(axis=0) / counts, int(counts.min(initial=len(rows)))


def _check_covariance(name: str, noise: Any, count: int) -> None:
    """Raise `InputError` where an argument is no covariance of so many statistics."""
    if not isinstance(noise, np.ndarray) or noise.shape != (count, count):
        what = f"shape {noise.shape}" if isinstance(noise, np.ndarray) else quoted(noise)
        raise InputError(f"{name} must be a covariance of {count} statistics, an array {count} × {count}, got {what}")
    variances = np.diag(noise)
    is_wrong = f"{name} must be a covariance of {count} statistics, got {quoted(noise.tolist())}"
    if not np.isfinite(noise).all() or (variances < 0).any():
        raise InputError(f"{is_wrong}: it must be finite, and variances at least 0")
    scale = np.sqrt(np.outer(variances, variances))
    share = noise / np.where(scale > 0, scale, 1.0)
    if (np.abs(noise - noise.T) > ROUNDING * scale).any():
        raise InputError(f"{is_wrong}: it must be symmetric")
    if (np.abs(noise) > (1 + ROUNDING) * scale).any() or np.linalg.eigvalsh(share).min() < -ROUNDING * count:
        raise InputError(f"{is_wrong}: some combination of statistics would vary by less than 0")
