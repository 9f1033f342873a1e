"""How posteriors are found by an emulator: settings, and simulations given to it."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.neural_likelihood.emulator import Square, fewest
from yeastfit.inference.neural_likelihood.network import EmulatorSettings
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.simulator import Simulator, labels_of

TINY = 1e-9  # of its largest entry: below 0, an eigenvalue of a covariance, by rounding

Given = tuple[Float[np.ndarray, "given free"], Float[np.ndarray, "given statistic"]]


@dataclass(frozen=True)
class EmulatedSettings:
    """How a posterior is found by an emulator.

    first: simulations from the prior, a power of two. each: simulations of every further round. most: in all. widen: w
    in `emulated`; settle: see there. walkers: chains, at most as many as simulations; most_steps: of each. batch: rows
    of every call of the simulator.
    """

    first: int = 512
    each: int = 512
    most: int = 4096
    widen: float = 2.5
    settle: float = 0.2
    walkers: int = 128
    most_steps: int = 5000
    batch: int = 128
    emulator: EmulatorSettings = field(default_factory=EmulatorSettings)

    def __post_init__(self) -> None:
        for name, least in (("first", 2), ("each", 1), ("walkers", 4), ("most_steps", 500), ("batch", 1)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least {least}")
        if self.first & (self.first - 1):
            raise InputError(f"first is {self.first}, it must be a power of two: Sobol' points are balanced then")
        if self.most < self.first:
            raise InputError(f"most is {self.most}, it must be at least first, which is {self.first}")
        if not self.widen >= 1 or not self.settle > 0:
            raise InputError(f"widen is {self.widen} and settle {self.settle}, they must be at least 1 and above 0")

    def check(
        self,
        simulator: Simulator,
        prior: Prior,
        observed: Float[np.ndarray, " statistic"],
        replicates: int,
        noise: Square | None,
        given: int = 0,
    ) -> None:
        """Raises `InputError` where the arguments do not belong together. given: simulations there are already."""
        if simulator.parameters.names != prior.free:
            raise InputError(
                f"prior is of {', '.join(prior.free)}, the simulator's parameters are {simulator.parameters.names}"
            )
        if observed.shape != (len(labels_of(simulator)),) or not np.isfinite(observed).all():
            raise InputError(f"observed is {observed}, {len(labels_of(simulator))} finite statistics are expected")
        if replicates < 1:
            raise InputError(f"replicates is {replicates}, it must be at least 1")
        if noise is not None and (
            noise.shape != 2 * observed.shape or np.linalg.eigvalsh(noise).min() < -TINY * noise.max()
        ):
            raise InputError(
                f"noise must be a covariance of {len(observed)} statistics, got one of shape {noise.shape}"
            )
        least = fewest(len(prior.free), len(observed), self.emulator)
        if self.first + given < least:
            raise InputError(
                f"first is {self.first}, an emulator of {len(prior.free)} parameters and {len(observed)} statistics "
                f"needs at least {least} simulations: allow more of them"
            )
        if self.walkers < 2 * len(prior.free):
            raise InputError(
                f"walkers is {self.walkers}, {len(prior.free)} parameters need at least {2 * len(prior.free)}"
            )


def usable(
    given: Given | None, prior: Prior, statistics: int
) -> tuple[Float[np.ndarray, "inside free"], Float[np.ndarray, "inside statistic"]]:
    """Those inside the prior's support, none by default."""
    free = len(prior.free)
    values, found = given or (np.zeros((0, free)), np.zeros((0, statistics)))
    if values.shape != (len(found), free) or found.shape[1] != statistics:
        raise InputError(
            f"given has shapes {values.shape} and {found.shape}, {free} parameters and {statistics} statistics in as "
            "many rows are expected"
        )
    inside = np.isfinite(prior.log_density(values))
    return values[inside], found[inside]


def all_once(
    values: Float[np.ndarray, "row free"], statistics: Float[np.ndarray, "row statistic"], given: Given
) -> tuple[Float[np.ndarray, "all free"], Float[np.ndarray, "all statistic"]]:
    """These and those given, without what is among these already."""
    own = {row.tobytes() for row in np.column_stack([values, statistics])}
    new = np.array([row.tobytes() not in own for row in np.column_stack(given)], dtype=bool)
    return np.concatenate([values, given[0][new]]), np.concatenate([statistics, given[1][new]])
