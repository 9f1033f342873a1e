"""Photographs of one colony over time, beside a simulated one that grows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from yeastfit.measure.measure_images import MeasuredImage, measure_file
from yeastfit.measure.reading.dataset import Dataset
from yeastfit.panel import Panel


@dataclass(frozen=True, eq=False)
class TimedPhotograph:
    """A photograph of a colony.

    Attributes:
        hours: When it was taken.
        measured: The photograph and its outline.
    """

    hours: float
    measured: MeasuredImage

    def panel(self, half_width: float) -> Panel:
        """A square of it about the colony's centroid, in grey.

        Arguments:
            half_width: From the centroid to an edge of the square, µm.

        Returns:
            A panel; what lies beyond the photograph is as bright as its background.
        """
        return Panel(f"photograph at {self.hours:g} h", self._square(half_width), half_width, grey=True)

    def _square(self, half_width: float) -> Float[np.ndarray, "x y"]:
        """Grey values from 0 to 1 [x, y], y upwards."""
        micrograph, size = self.measured.micrograph, self.measured.micrograph.pixel_size
        grey = micrograph.pixels.astype(float)
        low, high = np.percentile(grey, (0.5, 99.5))
        shown = np.clip((grey - low) / max(high - low, 1e-9), 0.0, 1.0)
        away = (np.arange(2 * max(round(half_width / size), 1)) + 0.5) * size - half_width
        x, y = self.measured.shape.centroid
        columns, rows = np.rint((x + away) / size).astype(int), np.rint((y - away) / size).astype(int)
        inside = (columns >= 0) & (columns < grey.shape[1])
        within = (rows >= 0) & (rows < grey.shape[0])
        square = np.full((len(columns), len(rows)), float(np.median(shown)))
        square[np.ix_(inside, within)] = shown[np.ix_(rows[within], columns[inside])].T
        return square


def photographs_of_first_colony(dataset: Dataset) -> list[TimedPhotograph]:
    """Outline the photographs of the first colony that a manifest names, in order of time.

    Raises:
        InputError: One of them shows no colony, or states no pixel size.
    """
    first = dataset.frames[0]
    own = [one for one in dataset.frames if (one.condition, one.replicate) == (first.condition, first.replicate)]
    return [
        TimedPhotograph(one.hours, measure_file(one.path, one.pixel_size, one.options, one.outline))
        for one in sorted(own, key=lambda one: one.hours)
    ]


def panel_at(photographs: Sequence[TimedPhotograph], hours: float, half_width: float) -> Panel:
    """Show the last photograph that had been taken by then, or nothing before the first one.

    Arguments:
        photographs: Of one colony, in order of time.
        hours: Since the colony was one cell.
        half_width: Of the panel, µm.

    Returns:
        A panel.
    """
    taken = [one for one in photographs if one.hours <= hours * (1 + 1e-6)]
    if not taken:
        return Panel("no photograph yet", np.ones((2, 2)), half_width, grey=True)
    return taken[-1].panel(half_width)
