"""What a sampler solves: the posterior of a simulator's parameters given data.

    p(λ | o) ∝ π(λ) p(o | λ),    o = 1/R Σ_r s_r + e,   s_r ~ simulator(λ),   e ~ N(0, N)

π is the prior, o the observed statistics, means over R replicates, and N the covariance of errors of measurement, which
replicates do not average out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import measurement_covariance
from yeastfit.inference.polynomial import sobol_points
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.simulator import Mismeasured, Replicates, Simulator, Stream, labels_of, root_of, stream_of
from yeastfit.inference.targets import Targets

ROUNDING = 1e-9  # of a covariance's largest entry: an eigenvalue may be as much below 0

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

    Raises:
        InputError: They do not belong together.
    """

    simulator: Simulator
    prior: Prior
    observed: Vector
    replicates: int = 1
    noise: Square | None = None

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
        if self.replicates < 1:
            raise InputError(f"replicates is {self.replicates}, it must be at least 1")
        if self.noise is not None and not _is_covariance(self.noise, len(labels)):
            raise InputError(
                f"noise must be a covariance of {len(labels)} statistics, got one of shape {self.noise.shape}"
            )

    @staticmethod
    def of(
        simulator: Simulator,
        prior: Prior,
        observed: Targets | Vector | Sequence[float],
        replicates: int = 1,
        noise: Square | None = None,
    ) -> "Problem":
        """Of data as an array, or of `Targets`, which bring their own replicates and errors of measurement.

        Where points of the targets are means of different numbers of replicates, the fewest count.
        """
        if not isinstance(observed, Targets):
            return Problem(simulator, prior, np.asarray(observed, dtype=float), replicates, noise)
        fewest = int(observed.replicates[observed.measured].min())
        if noise is None:
            errors = observed.measurement_errors(None)
            noise = measurement_covariance(observed.observables, observed.values, errors)
        return Problem(simulator, prior, observed.values, fewest, noise)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the statistics."""
        return labels_of(self.simulator)

    def data_sets(self, simulator: Simulator, count: int) -> Simulator:
        """A simulator of data sets like the data: means over `count` replicates, with errors of measurement.

        Arguments:
            simulator: Of one replicate: the problem's own, or a `CachedSimulator` around it.
            count: Replicates of a data set.
        """
        means = Replicates(simulator, count) if count > 1 else simulator
        return means if self.noise is None or not self.noise.any() else Mismeasured(means, root_of(self.noise))

    def prior_values(self, count: int, seed: int) -> Float[np.ndarray, "draw free"]:
        """λ of simulations 0..count−1 of a run, the same for every method: scrambled Sobol' points of the prior."""
        return self.prior.quantile(sobol_points(count, len(self.prior.free), stream_of(seed, Stream.PRIOR, 0)))

    def unreached(self, statistics: Float[np.ndarray, "draw statistic"]) -> list[str]:
        """Observations outside the range of all simulations from the prior, in words."""
        low, high = statistics.min(axis=0), statistics.max(axis=0)
        outside = np.flatnonzero((self.observed < low) | (self.observed > high))
        return [
            f"{self.labels[k]} was observed as {self.observed[k]:.4g}, the prior's simulations have "
            f"{low[k]:.4g}..{high[k]:.4g}"
            for k in outside
        ]


def _is_covariance(noise: np.ndarray, count: int) -> bool:
    return noise.shape == (count, count) and bool(np.linalg.eigvalsh(noise).min() >= -ROUNDING * noise.max())
