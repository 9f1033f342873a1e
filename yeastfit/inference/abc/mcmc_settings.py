"""How chains of ABC-MCMC are run: settings and proposals."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

import emcee
import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import KERNELS, KernelName

Move = Literal["gaussian", "stretch", "de"]
MOVES: tuple[Move, ...] = ("gaussian", "stretch", "de")


@dataclass(frozen=True)
class McmcSettings:
    """How chains are run.

    steps: of each chain, in all: a run that is taken up again goes on up to there. discard: of them, at the beginning.
    walkers: chains. epsilon: ε, by default the quantile `share` of the pilot's distances. covariance: Σ in the prior's
    coordinates, by default the pilot's. pilot: simulations before the chains. batch: rows of every call of the
    simulator, by default what one step asks for at once.
    """

    steps: int = 1000
    walkers: int = 8
    epsilon: float | None = None
    share: float = 0.02
    covariance: tuple[tuple[float, ...], ...] | None = None
    pilot: int = 500
    move: Move = "gaussian"
    kernel: KernelName = "indicator"
    discard: int = 0
    batch: int | None = None

    def __post_init__(self) -> None:
        for name, least in (("steps", 1), ("walkers", 1), ("pilot", 2), ("discard", 0), ("batch", 1)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise InputError(f"{name} is {value}, it must be at least {least}")
        if self.discard >= self.steps:
            raise InputError(f"discard is {self.discard}, it must be below the number of steps, {self.steps}")
        if self.epsilon is not None and not self.epsilon > 0:
            raise InputError(f"epsilon is {self.epsilon}, it must be above 0")
        if not 0 < self.share <= 1:
            raise InputError(f"share is {self.share}, it must lie in 0..1 and above 0")
        if self.move not in MOVES or self.kernel not in KERNELS:
            raise InputError(
                f"move is {self.move!r}, of {MOVES}; kernel is {self.kernel!r}, of {KERNELS}: one is unknown"
            )

    @property
    def rows(self) -> int:
        """Rows of every call of the simulator; moves of ensembles ask for half the walkers at a time."""
        return self.batch or (self.walkers if self.move == "gaussian" else (self.walkers + 1) // 2)

    @property
    def fixed(self) -> dict[str, Any]:
        """What makes chains what they are, however long they get."""
        return {name: one for name, one in asdict(self).items() if name not in ("steps", "discard", "batch")}

    def check_walkers(self, free: int) -> None:
        """Raises `InputError` where these are too few for a move of ensembles with that many parameters."""
        least = max(4, 2 * free)
        if self.move != "gaussian" and self.walkers < least:
            raise InputError(f"walkers is {self.walkers}, {self.move} with {free} parameters needs at least {least}")


def move_of(move: Move, covariance: Float[np.ndarray, "free free"]) -> emcee.moves.Move:
    """emcee's move; the Gaussian one moves every walker by a vector of its own, of covariance Σ/3."""
    if move != "gaussian":
        return {"stretch": emcee.moves.StretchMove, "de": emcee.moves.DEMove}[move]()
    root = np.linalg.cholesky(covariance / 3)

    def proposal(x: np.ndarray, rng: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
        return x + rng.standard_normal(x.shape) @ root.T, np.zeros(len(x))

    return emcee.moves.MHMove(proposal, ndim=len(covariance))
