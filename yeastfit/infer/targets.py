"""What a fit aims at: mean curves over replicates, with their scatter."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from yeastfit.errors import InputError
from yeastfit.measure.dataset import Dataset
from yeastfit.measure.series import Measured, replicate_curves, smooth_statistics
from yeastfit.model.parameters import Scales

SPACING = 0.1  # L0, the grid on which shapes are compared: 0.75 µm for yeast
SMOOTHING = 0.15  # L0, the blur both undergo, which makes them indifferent to how a pixel on the edge was called


@dataclass(frozen=True)
class Targets:
    """Curves of some statistics at some times, of several replicate colonies.

    names: statistics by the names of `SmoothStatistics`. times: model time. mean, scatter: over replicates, lengths in
    L0; scatter is the standard deviation. replicates: how many colonies stand behind each time. smoothing, spacing: how
    the shapes were measured, in L0; a simulation is measured the same way. extent: how far from the start any colony
    reaches, in L0. Raises `InputError` for shapes that disagree, times that do not rise and values that are not finite.
    """

    names: tuple[str, ...]
    times: Float[np.ndarray, " time"]
    mean: Float[np.ndarray, "statistic time"]
    scatter: Float[np.ndarray, "statistic time"]
    replicates: Int[np.ndarray, " time"]
    spacing: float
    smoothing: float
    extent: float

    def __post_init__(self) -> None:
        shape = (len(self.names), len(self.times))
        for name in ("mean", "scatter"):
            values = getattr(self, name)
            if values.shape != shape:
                raise InputError(f"targets: {name} has shape {values.shape}, (statistics, times) is {shape}")
            if not np.isfinite(values).all():
                raise InputError(f"targets: {name} holds {np.sum(~np.isfinite(values))} values that are not finite")
        if (np.diff(self.times) <= 0).any() or self.times[0] <= 0:
            raise InputError(f"targets: times must rise from above 0, got {self.times}")
        if (self.mean <= 0).any() or (self.scatter < 0).any():
            raise InputError("targets: means must be above 0 and scatter at least 0")
        if self.replicates.min() < 2:
            time = self.times[np.argmin(self.replicates)]
            raise InputError(
                f"targets: {self.replicates.min()} replicate at time {time:.3g}, at least 2 are needed for a scatter"
            )

    @staticmethod
    def from_replicates(
        curves: dict[str, Float[np.ndarray, "replicate time"]],
        times: Float[np.ndarray, " time"],
        *,
        spacing: float,
        smoothing: float,
        extent: float,
    ) -> "Targets":
        """Mean and scatter of replicate curves; NaN marks a replicate that is missing at a time."""
        stacked = np.stack(list(curves.values()))
        replicates = np.sum(np.isfinite(stacked).all(axis=0), axis=0)
        if replicates.min() < 2:
            raise InputError(f"{replicates.min()} replicate at one of the times, at least 2 are needed for a scatter")
        mean, scatter = np.nanmean(stacked, axis=1), np.nanstd(stacked, axis=1, ddof=1)
        return Targets(tuple(curves), np.asarray(times), mean, scatter, replicates, spacing, smoothing, extent)

    @staticmethod
    def from_dataset(
        dataset: Dataset,
        measured: list[Measured],
        *,
        names: tuple[str, ...] = ("compactness", "radius"),
        scales: Scales | None = None,
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
    ) -> "Targets":
        """Curves of a data set's masks, measured as `SmoothStatistics` measures a simulation; lengths in L0."""
        scales = scales or Scales()
        rows, extent = [], 0.0
        for one in measured:
            pixel = one.micrograph.pixel_size / scales.length
            rows.append(smooth_statistics(one.segmentation.mask, pixel, spacing=spacing, smoothing=smoothing))
            extent = max(extent, one.shape.max_radius / scales.length)
        curves, hours = replicate_curves(dataset, rows, names)
        times = np.array([scales.time(hour) for hour in hours])
        return Targets.from_replicates(curves, times, spacing=spacing, smoothing=smoothing, extent=extent)
