"""What a fit aims at: mean curves over replicate colonies, with their scatter, and how shapes were measured."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import Dataset
from yeastfit.measure.series import Measured, replicate_curves
from yeastfit.measure.statistics.registry import STATISTICS, Estimator, known_statistics
from yeastfit.measure.statistics.smooth_statistics import measure_mask_smoothly
from yeastfit.model.parameters import Scales
from yeastfit.observable import Observable

SPACING = 0.1  # L0, the grid on which shapes are compared: 0.75 µm for yeast
SMOOTHING = 0.15  # L0, the blur both undergo, which makes them indifferent to how a pixel on the edge was called


@dataclass(frozen=True)
class Targets:
    """Curves of some statistics at some times, of several replicate colonies, or of one.

    names: statistics. times: model time, rising. mean, scatter: over replicates, lengths in L0; scatter is one colony's
    standard deviation, nan where it is not known: then the model's is taken. replicates: colonies behind each mean, 0
    where a statistic was not measured; its mean is nan there.

    estimator: how shapes were measured, and simulated ones will be: "smooth" as `SmoothStatistics` on a grid of
    `spacing` with `smoothing`; "mask" as `measure.statistics` on pixels of `spacing`. All in L0. extent: how far from
    the start any colony reaches, in L0, at least. curves: of single colonies, where known, nan where one is missing.
    scales: of the data, for hours and µm.

    Raises `InputError` for shapes that disagree, times that do not rise, statistics that the estimator does not have,
    means that are not above 0, and scatter that is 0 over several replicates.
    """

    names: tuple[str, ...]
    times: Float[np.ndarray, " time"]
    mean: Float[np.ndarray, "statistic time"]
    scatter: Float[np.ndarray, "statistic time"]
    replicates: Int[np.ndarray, "statistic time"]
    spacing: float
    smoothing: float
    extent: float
    estimator: Estimator = "smooth"
    curves: Float[np.ndarray, "replicate statistic time"] | None = None
    scales: Scales = field(default_factory=Scales)

    def __post_init__(self) -> None:
        shape = (len(self.names), len(self.times))
        for name in ("mean", "scatter", "replicates"):
            values = getattr(self, name)
            if values.shape != shape:
                raise InputError(f"targets: {name} has shape {values.shape}, (statistics, times) is {shape}")
        _check_names(self.names, self.estimator)
        times = self.times
        if not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0).any() or times[0] <= 0:
            raise InputError(f"targets: times must rise from above 0, got {times}")
        if self.spacing <= 0 or self.smoothing < 0 or not self.extent > 0:
            raise InputError(
                f"targets: spacing is {self.spacing:g}, smoothing {self.smoothing:g} and extent {self.extent:g}, "
                "need lengths in L0 above 0 (smoothing may be 0)"
            )
        if not self.measured.any():
            raise InputError("targets: nothing is measured, replicates is 0 everywhere")
        self._refuse(~np.isfinite(self.mean), "mean", "it must be a finite number")
        solid = np.array([not STATISTICS[name].may_vanish for name in self.names])[:, None]
        self._refuse(solid & (self.mean <= 0), "mean", "it must be above 0")
        self._refuse((self.scatter < 0) | np.isinf(self.scatter), "scatter", "it must be above 0, or nan: not known")
        self._refuse(
            (self.scatter == 0) & (self.replicates > 1),
            "scatter",
            "so no error could be told: are the replicates copies of each other? Give nan to take the model's",
        )

    @property
    def measured(self) -> Bool[np.ndarray, "statistic time"]:
        """Which of the curves' points there are; they are the fit's data, statistic by statistic."""
        return self.replicates > 0

    @property
    def values(self) -> Float[np.ndarray, " curve"]:
        """The means that are measured."""
        return self.mean[self.measured]

    @property
    def hours(self) -> Float[np.ndarray, " curve"]:
        """When each of `values` was seen."""
        return np.broadcast_to(self.scales.hours(self.times), self.measured.shape)[self.measured]

    @property
    def observables(self) -> tuple[Observable, ...]:
        """What each of `values` is."""
        return tuple(Observable(self.names[row], float(self.times[k])) for row, k in np.argwhere(self.measured))

    def label(self, number: int) -> str:
        """What the number-th of `values` is."""
        statistic, time = np.argwhere(self.measured)[number]
        return f"{self.names[statistic]} at {self.times[time]:.3g}"

    def resampled(self, rng: np.random.Generator) -> Float[np.ndarray, " curve"]:
        """Means over replicates that are drawn with replacement, all points of a colony's curves together.

        Where a draw leaves a point without any colony, that point is drawn by itself. Raises `InputError` where single
        colonies are not known, or only one.
        """
        if self.curves is None or len(self.curves) < 2:
            raise InputError(
                "targets: a bootstrap needs curves of at least two single colonies, make a profile instead"
            )
        drawn = self.curves[rng.integers(len(self.curves), size=len(self.curves))][:, self.measured]
        for column in np.flatnonzero(~np.isfinite(drawn).any(axis=0)):
            own = self.curves[:, self.measured][:, column]
            own = own[np.isfinite(own)]
            drawn[: len(own), column] = rng.choice(own, len(own))
        return np.nanmean(drawn, axis=0)

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name != "scales"} | {
            "scales": {"length": self.scales.length, "rate": self.scales.rate}
        }

    @staticmethod
    def fromdict(data: Mapping[str, Any]) -> "Targets":
        """What `asdict` gave, as JSON keeps it."""
        arrays = {name: np.array(data[name], dtype=float) for name in ("times", "mean", "scatter")}
        curves = None if data["curves"] is None else np.array(data["curves"], dtype=float)
        rest = {"names": tuple(data["names"]), "replicates": np.array(data["replicates"], dtype=int), "curves": curves}
        return Targets(**{**data, **arrays, **rest, "scales": Scales(**data["scales"])})

    @staticmethod
    def from_means(
        means: Mapping[str, Sequence[float] | np.ndarray],
        times: Sequence[float] | np.ndarray,
        *,
        scatter: Mapping[str, Sequence[float] | np.ndarray] | None = None,
        replicates: int | Sequence[int] | np.ndarray = 1,
        extent: float | None = None,
        estimator: Estimator = "smooth",
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
        scales: Scales | None = None,
    ) -> "Targets":
        """From means, by statistic, with nan where one is missing; lengths in L0.

        scatter: one colony's standard deviation, likewise; without it the model's is taken. replicates: one number, or
        one for each time. extent: without it, guessed from the radius or the area.
        """
        names, times = tuple(means), np.atleast_1d(np.asarray(times, dtype=float))
        mean = np.stack([np.atleast_1d(np.asarray(means[name], dtype=float)) for name in names])
        known = scatter or {}
        for name in known:
            if name not in names:
                raise InputError(f"targets: scatter of {name!r}, but there are means of {', '.join(names)} only")
        unknown = np.full(len(times), np.nan)
        spread = np.stack([np.atleast_1d(np.asarray(known.get(name, unknown), dtype=float)) for name in names])
        counts = np.broadcast_to(np.asarray(replicates, dtype=int), mean.shape) * np.isfinite(mean)
        reach = _extent(dict(zip(names, mean, strict=True))) if extent is None else extent
        rest: dict[str, Any] = {"estimator": estimator, "scales": scales or Scales()}
        return Targets(names, times, mean, spread, counts, spacing, smoothing, reach, **rest)

    @staticmethod
    def from_replicates(
        curves: Mapping[str, Float[np.ndarray, "replicate time"]],
        times: Float[np.ndarray, " time"],
        *,
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
        extent: float | None = None,
        estimator: Estimator = "smooth",
        scales: Scales | None = None,
    ) -> "Targets":
        """Mean and scatter of replicate curves; nan marks a replicate that is missing. One replicate has no scatter."""
        stacked = np.stack([np.asarray(values, dtype=float) for values in curves.values()], axis=1)
        known = np.isfinite(stacked)
        counts = known.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(counts > 0, np.where(known, stacked, 0.0).sum(axis=0) / counts, np.nan)
            squares = np.where(known, stacked - mean, 0.0) ** 2
            scatter = np.where(counts > 1, np.sqrt(squares.sum(axis=0) / (counts - 1)), np.nan)
        reach = _extent(dict(zip(curves, mean, strict=True))) if extent is None else extent
        rest: dict[str, Any] = {"estimator": estimator, "curves": stacked, "scales": scales or Scales()}
        return Targets(tuple(curves), np.asarray(times), mean, scatter, counts, spacing, smoothing, reach, **rest)

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
        _check_names(names, "smooth")
        rows, extent = [], 0.0
        for one in measured:
            pixel = one.micrograph.pixel_size / scales.length
            rows.append(measure_mask_smoothly(one.segmentation.mask, pixel, spacing=spacing, smoothing=smoothing))
            extent = max(extent, one.shape.max_radius / scales.length)
        curves, hours = replicate_curves(dataset, rows, names)
        times = scales.time(np.array(hours))
        how: dict[str, Any] = {"spacing": spacing, "smoothing": smoothing, "extent": extent, "scales": scales}
        return Targets.from_replicates(curves, times, **how)

    def _refuse(self, bad: np.ndarray, what: str, why: str) -> None:
        for statistic, time in np.argwhere(bad & self.measured):
            value = getattr(self, what)[statistic, time]
            raise InputError(
                f"targets: {what} of {self.names[statistic]} at time {self.times[time]:.3g} is {value:g}, {why}"
            )


def _check_names(names: Sequence[str], estimator: str) -> None:
    if estimator not in get_args(Estimator):
        raise InputError(f"targets: estimator is {estimator!r}, it must be one of {', '.join(get_args(Estimator))}")
    known = known_statistics(estimator)  # type: ignore[arg-type]
    for name in names:
        if name not in known:
            other = ' (measured on masks: estimator "mask")' if name in known_statistics("mask") else ""
            raise InputError(f"targets: statistic {name!r} is unknown{other}, expected some of {', '.join(known)}")
    if not names or len(set(names)) != len(names):
        raise InputError(f"targets: statistics are {list(names)}, need at least one, each once")


def _extent(means: Mapping[str, np.ndarray]) -> float:
    """How far colonies reach, from what is known of their size; lengths tell more than areas."""
    telling = (entry for name, entry in STATISTICS.items() if name in means and entry.reach is not None)
    for entry in sorted(telling, key=lambda entry: (entry.unit_power, entry.reach)):
        values = np.maximum(means[entry.name], 0.0)
        if np.isfinite(values).any():
            radii = values if entry.unit_power == 1 else np.sqrt(values / np.pi)
            return float(np.nanmax(entry.reach * radii)) + 1.0
    raise InputError("targets: extent is missing, need how far from the start the colonies reach, in L0")
