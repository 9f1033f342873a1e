"""Measure colonies, photographed or simulated."""

from yeastfit.measure.statistics.indicator import Indicator
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.pixels import Pixels
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics, node_statistics

__all__ = ["HardStatistics", "Indicator", "Pixels", "SmoothStatistics", "measure_mask", "node_statistics"]
