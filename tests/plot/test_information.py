"""The figure of what to measure next, when there are few times to choose from."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from sensitivities import made_up

from yeastfit import design, plot


@pytest.mark.parametrize("times", [[np.nan], [3.0], [1.0, 2.0]])
def test_titles_lie_within_the_figure_however_few_times_there_are(times: list[float]) -> None:
    names = ("li2024_filament_radius_index", "compactness")
    found = design(made_up(names, times, ("mobility",)), replicates=4, added=7, steps=2)
    figure = plot.design(found)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (title,) = (one for one in figure.texts if "Measured next" in one.get_text())
    box = title.get_window_extent(canvas.get_renderer())
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width
    assert figure.axes[0].get_xlabel() == ("" if np.isnan(times).all() else "time")
