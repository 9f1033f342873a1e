"""How a run of a sampler ended."""

from enum import Enum


class Status(Enum):
    """How a run ended; the value is the message."""

    SETTLED = "the posterior has settled"
    STILL_MOVING = "not settled: the posterior moved in the last round, or the emulator's error is too large"
    CHAINS_TOO_SHORT = "not settled: chains are too short or disagree"
    TOLERANCE_NOT_REACHED = "not settled: the tolerance was not reached"
    STILL_THE_PRIOR = "not settled: no simulations came closer to the data than those from the prior"
    TOO_FEW_DRAWS = "not settled: all draws together are worth too few independent ones"

    def __str__(self) -> str:
        return self.value
