"""What one column of a simulator's results is."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Observable:
    """A statistic, and the time at which it is taken where there is one."""

    statistic: str
    time: float = math.nan

    def __str__(self) -> str:
        return self.statistic if math.isnan(self.time) else f"{self.statistic} at {self.time:.3g}"
