"""What a fit aims at: means of statistics over replicates at some times, with their scatter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from yeastfit.errors import InputError
from yeastfit.inference.imaging import SMOOTHING, SPACING, Imaging
from yeastfit.kinds import check_kind
from yeastfit.measure.measure_images import MeasuredImage
from yeastfit.measure.reading.dataset import Dataset
from yeastfit.measure.replicate_curves import replicate_curves
from yeastfit.measure.statistics.registry import STATISTICS
from yeastfit.measure.statistics.smooth_statistics import measure_mask_smoothly
from yeastfit.model.parameters import Scales
from yeastfit.numbers import array_of
from yeastfit.observable import Observable
from yeastfit.text import quoted

Table = Float[np.ndarray, "statistic time"]


@dataclass(frozen=True, eq=False)
class Targets:
    """Mean curves of some statistics at some times, over several replicates or of one.

    Attributes:
        names: Statistics, as the simulator calls them.
        times: Rising, in the simulator's unit.
        mean: Over replicates; nan where a statistic was not measured.
        scatter: Standard deviation of one replicate; nan where it is not known, and a fit takes the simulator's.
        replicates: How many are behind each mean; 0 where a statistic was not measured.
        curves: Of single replicates, where they are known; nan where one is missing. A bootstrap needs them.
        imaging: How shapes of colonies were measured. Only simulators of colonies need it; lengths are in L0 then.
        time_label: What times count where there is no imaging.
        length_unit: Of statistics that are lengths, and squared of areas.
        colonies: Names of the single replicates, where they are known.

    Raises:
        InputError: Shapes or numbers of replicates disagree, times do not rise, a name appears twice, a measured mean
            is not finite, or scatter is 0 over several replicates. With `imaging` also where the estimator does not
            have a statistic, or a size is not above 0.
    """

    names: tuple[str, ...]
    times: Float[np.ndarray, " time"]
    mean: Table
    scatter: Table
    replicates: Int[np.ndarray, "statistic time"]
    curves: Float[np.ndarray, "replicate statistic time"] | None = None
    imaging: Imaging | None = None
    time_label: str = "time"
    length_unit: str = "L0"
    colonies: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.names), len(self.times))
        for name in ("mean", "scatter", "replicates", "times", *(("curves",) if self.curves is not None else ())):
            check_kind(f"targets: {name}", getattr(self, name), np.ndarray, "an array of numpy, or use from_means(…)")
        for name in ("mean", "scatter", "replicates"):
            values = getattr(self, name)
            if values.shape != shape:
                raise InputError(f"targets: {name} has shape {values.shape}, (statistics, times) is {shape}")
        if self.curves is not None and self.curves.shape[1:] != shape:
            raise InputError(f"targets: curves have shape {self.curves.shape}, (statistics, times) is {shape}")
        if self.curves is not None and np.isinf(self.curves).any():
            raise InputError("targets: curves have infinite numbers, they must be finite, or nan where one is missing")
        if not np.issubdtype(self.replicates.dtype, np.integer) or (self.replicates < 0).any():
            raise InputError(f"targets: replicates is {quoted(self.replicates.tolist())}, need whole numbers from 0 on")
        known = 0 if self.curves is None else len(self.curves)
        if self.colonies and len(self.colonies) != known:
            raise InputError(f"targets: {len(self.colonies)} names of colonies, there are curves of {known}")
        if not self.names or len(set(self.names)) != len(self.names):
            raise InputError(f"targets: statistics are {list(self.names)}, need at least one, each once")
        times = self.times
        if not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise InputError(f"targets: times must rise, got {quoted(times)}")
        if not self.measured.any():
            raise InputError("targets: nothing is measured, replicates is 0 everywhere")
        self._refuse(~np.isfinite(self.mean), "mean", "it must be a finite number")
        self._refuse((self.scatter < 0) | np.isinf(self.scatter), "scatter", "it must be above 0, or nan: not known")
        self._refuse(
            (self.scatter == 0) & (self.replicates > 1),
            "scatter",
            "so no error could be told: are the replicates copies of each other, or has every colony this number? "
            "Leave the statistic out, or in Python give nan to take the model's",
        )
        if self.imaging is not None:
            self._check_imaged(self.imaging)

    @property
    def measured(self) -> Bool[np.ndarray, "statistic time"]:
        """Which points there are; they are the data of a fit, statistic by statistic."""
        return self.replicates > 0

    @property
    def values(self) -> Float[np.ndarray, " observable"]:
        """The measured means."""
        return self.mean[self.measured]

    @property
    def observables(self) -> tuple[Observable, ...]:
        """What each of `values` is."""
        return tuple(Observable(self.names[row], float(self.times[k])) for row, k in np.argwhere(self.measured))

    @property
    def points(self) -> tuple[str, ...]:
        """Names of `values`: the statistic, and its time on the `clock` where there are several times."""
        if len(self.times) == 1:
            return tuple(self.names[row] for row, _ in np.argwhere(self.measured))
        clock = self.clock
        return tuple(f"{self.names[row]} at {clock[k]:.4g} {self.clock_label}" for row, k in np.argwhere(self.measured))

    @property
    def clock(self) -> Float[np.ndarray, " time"]:
        """Times for plots and tables: hours where the images tell the scales, else as they are."""
        return self.times if self.imaging is None else self.imaging.scales.hours(self.times)

    @property
    def clock_label(self) -> str:
        """What `clock` counts."""
        return self.time_label if self.imaging is None else "hours"

    def measurement_errors(self, given: float | Mapping[str, float] | None = None) -> dict[str, float]:
        """Relative error of measurement of each statistic, which replicates do not average out.

        Arguments:
            given: One number for all, or by statistic. Those not given have what their imaging has, or none.

        Raises:
            InputError: One is given of a statistic that is not among these.
        """
        if isinstance(given, int | float):
            return dict.fromkeys(self.names, float(given))
        for name in given or {}:
            if name not in self.names:
                raise InputError(f"measurement_error of {name!r}, but the targets are of {', '.join(self.names)} only")
        known = {} if self.imaging is None else {name: STATISTICS[name].measurement_error for name in self.names}
        return {name: float((given or {}).get(name, known.get(name, 0.0))) for name in self.names}

    def resampled(self, rng: np.random.Generator) -> Float[np.ndarray, " observable"]:
        """Means over replicates that are drawn with replacement, all points of a replicate together.

        Where a draw leaves a point without any replicate, that point is drawn by itself.

        Raises:
            InputError: Single replicates are not known, or there is one only.
        """
        if self.curves is None or len(self.curves) < 2:
            raise InputError(
                "targets: a bootstrap needs curves of at least two single replicates, make a profile instead"
            )
        drawn = self.curves[rng.integers(len(self.curves), size=len(self.curves))][:, self.measured]
        for column in np.flatnonzero(~np.isfinite(drawn).any(axis=0)):
            own = self.curves[:, self.measured][:, column]
            own = own[np.isfinite(own)]
            drawn[: len(own), column] = rng.choice(own, len(own))
        return np.nanmean(drawn, axis=0)

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        imaging = None if self.imaging is None else self.imaging.asdict()
        return {**{name: getattr(self, name) for name in self.__dataclass_fields__}, "imaging": imaging}

    @staticmethod
    def fromdict(data: Mapping[str, Any]) -> "Targets":
        """Read what `asdict` gave, as JSON keeps it."""
        mean, scatter, times = (np.array(data[name], dtype=float) for name in ("mean", "scatter", "times"))
        curves = None if data["curves"] is None else np.array(data["curves"], dtype=float)
        imaging = None if data["imaging"] is None else Imaging.fromdict(data["imaging"])
        replicates = np.array(data["replicates"], dtype=int)
        units = data["time_label"], data["length_unit"]
        colonies = tuple(data.get("colonies", ()))  # files of earlier versions have none
        return Targets(tuple(data["names"]), times, mean, scatter, replicates, curves, imaging, *units, colonies)

    @staticmethod
    def from_means(
        means: Mapping[str, Sequence[float] | np.ndarray],
        times: Sequence[float] | np.ndarray,
        *,
        scatter: Mapping[str, Sequence[float] | np.ndarray] | None = None,
        replicates: int | Sequence[int] | np.ndarray = 1,
        imaging: Imaging | None = None,
    ) -> "Targets":
        """Targets from means.

        Arguments:
            means: By statistic, one for each time; nan where one is missing. Of imaged colonies, lengths in L0.
            times: Rising.
            scatter: Standard deviation of one replicate, likewise; the simulator's where none is given.
            replicates: Behind each mean: one number, or one for each time.
            imaging: How colonies were measured.

        Raises:
            InputError: As `Targets`; and scatter of a statistic that has no mean.
        """
        times, known = np.atleast_1d(array_of(times, "targets: times")), {} if scatter is None else scatter
        mean = _table("means", means, len(times))
        names = tuple(means)
        check_kind("targets: scatter", known, Mapping, "curves by the names of statistics")
        for name in known:
            if name not in names:
                raise InputError(f"targets: scatter of {name!r}, but there are means of {', '.join(names)} only")
        unknown = np.full(len(times), np.nan)
        spread = _table("scatter", {name: known.get(name, unknown) for name in names}, len(times))
        try:
            counts = np.broadcast_to(np.asarray(replicates, dtype=float), mean.shape)
        except (TypeError, ValueError):
            raise InputError(
                f"targets: replicates is {quoted(replicates)}, need one whole number, or one for each of "
                f"{len(times)} times"
            ) from None
        if not (np.isfinite(counts) & (counts >= 0) & (counts == np.rint(counts))).all():
            raise InputError(f"targets: replicates is {quoted(replicates)}, need whole numbers from 0 on")
        counts = counts.astype(int) * ~np.isnan(mean)  # an infinite one is refused
        return Targets(names, times, mean, spread, counts, None, _reaching(imaging, names, mean))

    @staticmethod
    def from_replicates(
        curves: Mapping[str, Sequence[Sequence[float]] | np.ndarray],
        times: Sequence[float] | np.ndarray,
        *,
        imaging: Imaging | None = None,
        colonies: Sequence[str] = (),
    ) -> "Targets":
        """Mean and scatter of replicate curves.

        Arguments:
            curves: By statistic, [replicate, time]; nan where a replicate is missing. One replicate has no scatter.
            times: Rising.
            imaging: How colonies were measured; lengths are in L0 then.
            colonies: Names of the replicates.

        Raises:
            InputError: As `Targets`.
        """
        at = np.atleast_1d(array_of(times, "targets: times"))
        stacked = np.moveaxis(_table("curves", curves, len(at), replicated=True), 0, 1)
        names = tuple(curves)
        known = np.isfinite(stacked)
        counts = known.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(counts > 0, np.where(known, stacked, 0.0).sum(axis=0) / counts, np.nan)
            squares = np.where(known, stacked - mean, 0.0) ** 2
            scatter = np.where(counts > 1, np.sqrt(squares.sum(axis=0) / (counts - 1)), np.nan)
        seen = _reaching(imaging, names, mean)
        return Targets(names, at, mean, scatter, counts, stacked, seen, colonies=tuple(colonies))

    @staticmethod
    def from_dataset(
        dataset: Dataset,
        measured: list[MeasuredImage],
        *,
        names: tuple[str, ...] = ("compactness", "radius"),
        scales: Scales | None = None,
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
    ) -> "Targets":
        """Curves of a data set's masks, measured as `SmoothStatistics` measures a simulation; lengths in L0.

        Arguments:
            dataset: The data set.
            measured: Its masks, from `measure_dataset`.
            names: Statistics.
            scales: Of the species.
            spacing: Of the grid that masks and simulations are brought to.
            smoothing: Width of the blur that both undergo.

        Raises:
            InputError: As `Targets`; or measurements are not of the data set's images, in their order.
        """
        scales = scales or Scales()
        Imaging().check(names)
        pairs = zip_longest([frame.path for frame in dataset.frames], [one.micrograph.path for one in measured])
        for number, (path, seen) in enumerate(pairs, 1):
            if path != seen:
                raise InputError(
                    f"measured: image {number} is {seen or 'missing'}, that of {dataset.manifest} is "
                    f"{path or 'missing'}: give what measure_dataset returns for this data set"
                )
        rows, extent = [], 0.0
        for one in measured:
            pixel = one.micrograph.pixel_size / scales.length
            rows.append(measure_mask_smoothly(one.segmentation.mask, pixel, spacing=spacing, smoothing=smoothing))
            extent = max(extent, one.shape.max_radius / scales.length)
        curves, hours = replicate_curves(dataset, rows, names)
        imaging = Imaging(extent, "smooth", spacing, smoothing, scales)
        at = scales.time(np.array(hours))
        return Targets.from_replicates(curves, at, imaging=imaging, colonies=dataset.replicates)

    def _check_imaged(self, imaging: Imaging) -> None:
        """Raise `InputError` where colonies cannot have been measured so."""
        imaging.check(self.names)
        if imaging.extent is None:
            raise InputError("targets: extent of the imaging is missing, in L0")
        if self.times[0] <= 0:
            raise InputError(f"targets: times must rise from above 0, got {quoted(self.times)}")
        size = np.array([not STATISTICS[name].may_vanish for name in self.names])[:, None]
        self._refuse(size & (self.mean <= 0), "mean", "it must be above 0")

    def _refuse(self, bad: np.ndarray, what: str, why: str) -> None:
        for statistic, time in np.argwhere(bad & self.measured):
            value, at = getattr(self, what)[statistic, time], self.times[time]
            hours = "" if self.imaging is None else f" ({at / self.imaging.scales.rate:.3g} hours)"
            raise InputError(f"targets: {what} of {self.names[statistic]} at time {at:.3g}{hours} is {value:g}, {why}")


def _table(what: str, curves: Any, times: int, replicated: bool = False) -> np.ndarray:
    """Curves of statistics, [statistic, …, time]. Raises `InputError` where they are none, or differ in shape."""
    check_kind(f"targets: {what}", curves, Mapping, "curves by the names of statistics")
    rows = {name: np.atleast_1d(array_of(values, f"targets: {what} of {name}")) for name, values in curves.items()}
    if not rows:
        raise InputError(f"targets: {what} are empty, need those of at least one statistic")
    for name, row in rows.items():
        if row.ndim != 1 + replicated or row.shape[-1] != times:
            need = "[replicate, time]" if replicated else "one number for each time"
            raise InputError(f"targets: {what} of {name} have the shape {row.shape}, need {need}, of {times} times")
    if len({row.shape for row in rows.values()}) > 1:
        counts = ", ".join(f"{len(row)} of {name}" for name, row in rows.items())
        raise InputError(f"targets: {what} are of different replicates, {counts}: give nan where one is missing")
    return np.stack(list(rows.values()))


def _reaching(imaging: Imaging | None, names: tuple[str, ...], mean: np.ndarray) -> Imaging | None:
    """Imaging with an extent. Raises `InputError` where it is none."""
    if imaging is not None:
        check_kind("targets: imaging", imaging, Imaging)
    return None if imaging is None else imaging.reaching(dict(zip(names, mean, strict=True)))
