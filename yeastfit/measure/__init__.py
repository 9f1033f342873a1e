"""From an image or a simulated colony to numbers."""

from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics, node_statistics

__all__ = ["HardStatistics", "SmoothStatistics", "measure_mask", "node_statistics"]
