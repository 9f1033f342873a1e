"""What one column of a simulator's results is."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Observable:
    """What a column holds.

    Attributes:
        statistic: Its name.
        time: At which it is taken, in the simulator's unit; nan where there is none.
    """

    statistic: str
    time: float = math.nan

    def __str__(self) -> str:
        return self.statistic if math.isnan(self.time) else f"{self.statistic} at {self.time:.3g}"
