"""How the shapes of colonies were imaged and measured, so that simulated ones can be measured alike."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, get_args

import numpy as np

from yeastfit.errors import InputError
from yeastfit.kinds import check_kind
from yeastfit.measure.statistics.registry import STATISTICS, Estimator, known_statistics
from yeastfit.model.parameters import Scales
from yeastfit.numbers import Range

SPACING = 0.1  # L0, the grid on which shapes are compared: 0.75 µm for yeast
SMOOTHING = 0.15  # L0, the blur both undergo, which makes them indifferent to how a pixel on the edge was called


@dataclass(frozen=True)
class Imaging:
    """How shapes of colonies were measured. Lengths are in L0.

    Attributes:
        extent: How far from the start any colony reaches, at least. None: guessed from the sizes that were measured.
        estimator: "smooth" measures as `SmoothStatistics`, on a grid of `spacing` with `smoothing`; "mask" as
            `yeastfit.measure.statistics`, on pixels of `spacing`.
        spacing: Of the grid or the pixels.
        smoothing: Width of the Gaussian blur, for "smooth".
        scales: Of the species, which give hours and µm.

    Raises:
        InputError: A length is not above 0 (smoothing may be 0), or the estimator is unknown.
    """

    extent: float | None = None
    estimator: Estimator = "smooth"
    spacing: float = SPACING
    smoothing: float = SMOOTHING
    scales: Scales = field(default_factory=Scales)

    def __post_init__(self) -> None:
        if self.estimator not in get_args(Estimator):
            raise InputError(
                f"targets: estimator is {self.estimator!r}, it must be one of {', '.join(get_args(Estimator))}"
            )
        for name in ("spacing", "smoothing", "extent"):
            if getattr(self, name) is not None:
                Range().check(getattr(self, name), f"targets: {name}")
        check_kind("targets: scales", self.scales, Scales)
        if self.spacing <= 0 or self.smoothing < 0 or not (self.extent is None or self.extent > 0):
            raise InputError(
                f"targets: spacing is {self.spacing:g}, smoothing {self.smoothing:g} and extent {self.extent}, "
                "need lengths in L0 above 0 (smoothing may be 0)"
            )

    def reaching(self, means: Mapping[str, np.ndarray]) -> "Imaging":
        """The same with an extent, guessed from mean curves by statistic where there is none."""
        return self if self.extent is not None else replace(self, extent=_extent(means))

    def check(self, names: Sequence[str]) -> None:
        """Raise `InputError` for a statistic that the estimator does not have."""
        known = known_statistics(self.estimator)
        for name in names:
            if name not in known:
                other = ' (measured on masks: estimator "mask")' if name in known_statistics("mask") else ""
                raise InputError(f"targets: statistic {name!r} is unknown{other}, expected some of {', '.join(known)}")

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @staticmethod
    def fromdict(data: Mapping[str, Any]) -> "Imaging":
        """Read what `asdict` gave."""
        return Imaging(**{**data, "scales": Scales(**data["scales"])})


def _extent(means: Mapping[str, np.ndarray]) -> float:
    """How far colonies reach, from what is known of their size; lengths tell more than areas."""
    telling = (entry for name, entry in STATISTICS.items() if name in means and entry.reach is not None)
    for entry in sorted(telling, key=lambda entry: (entry.unit_power, entry.reach)):
        values = np.maximum(means[entry.name], 0.0)
        if np.isfinite(values).any():
            radii = values if entry.unit_power == 1 else np.sqrt(values / np.pi)
            return float(np.nanmax(entry.reach * radii)) + 1.0
    raise InputError("targets: extent is missing, need how far from the start the colonies reach, in L0")
