"""What calibration simulates: young colonies of the algebraic model, and small ones of the off-lattice model."""

from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from benchmarks.recovery import BOX, STATISTICS
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.imaging import Imaging
from yeastfit.inference.li2024 import LI2024
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.offlattice.simulator import OfflatticeSimulator
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED

PRIOR = Prior.of({name: {"distribution": "log-uniform", "low": low, "high": high} for name, (low, high) in BOX.items()})
MODEL = Resolution(dt=0.025, spacing=0.4)
EXTENT, PIXEL = 5.0, 0.25  # L0


class CalibratedModel(Protocol):
    """A model whose posteriors are calibrated."""

    @property
    def prior(self) -> Prior:
        """Of the truths."""

    def simulator(self) -> Simulator:
        """Of single colonies."""

    def sentence(self) -> str:
        """How data are simulated, for the page."""

    def data(self) -> str:
        """What they are taken at, for the page."""

    def about(self) -> dict[str, Any]:
        """All of it, plain data."""


@dataclass(frozen=True)
class Young:
    """Colonies of the algebraic model at some times."""

    times: tuple[float, ...]

    @property
    def prior(self) -> Prior:
        """Log-uniform."""
        return PRIOR

    def simulator(self) -> Simulator:
        """Compactness and radius at all times."""
        curves = {name: np.ones(len(self.times)) for name in STATISTICS}
        targets = Targets.from_means(curves, self.times, imaging=Imaging(EXTENT, spacing=PIXEL))
        return ColonySimulator.of(targets, PRIOR.free, resolution=MODEL)

    def sentence(self) -> str:
        """Of the resolution."""
        return (
            f"Colonies at Δt = {MODEL.dt:g}; grid of the nutrient {MODEL.spacing:g} L0, of the outlines {PIXEL:g} L0."
        )

    def data(self) -> str:
        """Times."""
        return f"t = {', '.join(f'{time:g}' for time in self.times)}"

    def about(self) -> dict[str, Any]:
        """Prior, times and resolution."""
        where = {"prior": PRIOR.asdict(), "model": asdict(MODEL), "extent": EXTENT, "pixel": PIXEL}
        return where | {"times": self.times}


@dataclass(frozen=True)
class Small:
    """Colonies of the off-lattice model, fewer cells than Li et al. grow, with their priors.

    Attributes:
        cells: N.
        area: At which they are compared, pixels.
        statistics: Of their masks.
    """

    cells: int = 5_000
    area: float = 75_000
    statistics: tuple[str, ...] = (*PUBLISHED, "branch_length", "compactness")

    @property
    def prior(self) -> Prior:
        """Beta densities."""
        return LI2024["awri796-50um"].prior

    def simulator(self) -> Simulator:
        """On one thread, as groups have processes of their own."""
        return OfflatticeSimulator.of(self.statistics, cells=self.cells, area=self.area, threads=1)

    def sentence(self) -> str:
        """Of the size."""
        names = ", ".join(name.replace("_", " ") for name in self.statistics)
        return f"Colonies of {self.cells} cells, compared at {self.area:g} pixels by {names}."

    def data(self) -> str:
        """Area."""
        return f"{self.area:g} pixels"

    def about(self) -> dict[str, Any]:
        """Prior and size."""
        return {"prior": self.prior.asdict(), "model": "off-lattice", **asdict(self)}
