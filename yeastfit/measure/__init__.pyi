"""Public names of what measures colonies."""

from .outlining.outline_errors import COLONY_ERRORS, OUTLINE_ERRORS
from .statistics.indicator import Indicator
from .statistics.measure_mask import measure_mask
from .statistics.model_as_mask import HardStatistics
from .statistics.pixels import Pixels
from .statistics.smooth_statistics import SmoothStatistics, node_statistics

__all__ = [
    "COLONY_ERRORS",
    "OUTLINE_ERRORS",
    "HardStatistics",
    "Indicator",
    "Pixels",
    "SmoothStatistics",
    "measure_mask",
    "node_statistics",
]
