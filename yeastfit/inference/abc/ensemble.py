"""emcee's ensemble sampler without its printing."""

from collections.abc import Callable, Sequence
from typing import Any

import emcee
import numpy as np
from jaxtyping import Float

Places = Float[np.ndarray, "walker free"]
LogProbability = Float[np.ndarray, " walker"]


class Ensemble(emcee.EnsembleSampler):
    """emcee's sampler, asking for log-probabilities as they are.

    The wrapper that emcee puts around a log-probability prints all walkers and a traceback when it raises anything,
    Ctrl-C among it.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        judge: Callable[[Places], tuple[LogProbability, np.ndarray | None]],
        moves: emcee.moves.Move | Sequence[tuple[emcee.moves.Move, float]],
    ) -> None:
        """Make a sampler.

        Arguments:
            shape: Walkers, and free parameters.
            judge: Log-probability at many places at once, and what is kept beside it (blobs), or None.
            moves: How walkers are proposed new places.
        """
        super().__init__(*shape, judge, moves=moves, vectorize=True)
        self.judge = judge

    def compute_log_prob(self, coords: Any) -> tuple[LogProbability, np.ndarray | None]:
        """Log-probability and blobs."""
        return self.judge(coords)
