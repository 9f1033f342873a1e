"""Outlines are drawn whole, however many there are."""

import numpy as np
from matplotlib.figure import Figure

from yeastfit.measure.outlining.segmentation import outline
from yeastfit.plot.micrographs import overlay, parted


def test_many_outlines_are_one_line_with_gaps() -> None:
    mask = np.zeros((64, 64), dtype=bool)
    mask[2:60:4, 2:60:4] = True
    contours = outline(mask)
    line = parted(contours)
    gaps = np.flatnonzero(np.isnan(line).all(axis=1))
    assert len(contours) == mask.sum() == len(gaps) - 1
    for contour, before, after in zip(contours, gaps[:-1], gaps[1:], strict=True):
        np.testing.assert_array_equal(line[before + 1 : after], contour)
    figure = overlay(mask * np.uint8(255), mask, "many")
    assert isinstance(figure, Figure)
    (axes,) = figure.axes
    (drawn,) = axes.lines
    assert len(np.asarray(drawn.get_xdata())) == len(line)


def test_figures_of_long_micrographs_are_bounded() -> None:
    for shape in ((16, 512), (512, 16)):
        mask = np.zeros(shape, dtype=bool)
        mask[4:12, 4:12] = True
        width, height = overlay(mask * np.uint8(255), mask, "long").get_size_inches()
        assert width == 7.05
        assert 0.75 < height < 21
