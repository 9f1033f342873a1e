"""Box counting against known dimensions."""

import numpy as np
import pytest
from PIL import Image, ImageDraw
from shapes import disc, star

from yeastfit.measure.statistics.fractal import box_counts, fractal_dimension, outline
from yeastfit.measure.statistics.pixels import Pixels


def koch(order: int, side: float) -> np.ndarray:
    """The filled snowflake; its outline has dimension log 4 / log 3."""
    corners = np.exp(1j * np.radians([90, -30, -150, 90]))
    for _ in range(order):
        start, step = corners[:-1], np.diff(corners) / 3
        bump = start + step + step * np.exp(1j * np.pi / 3)
        corners = np.append(np.stack([start, start + step, bump, start + 2 * step], axis=1).ravel(), corners[-1])
    corners = (corners + 1.05 * (1 + 1j)) * side / 2.1
    image = Image.new("1", (int(side), int(side)))
    ImageDraw.Draw(image).polygon(list(zip(corners.real, corners.imag, strict=True)), fill=1)
    return np.asarray(image)


@pytest.mark.parametrize("mask", [disc(150), disc(40), np.ones((200, 300)), np.tri(300)], ids=str)
def test_smooth_outlines_have_dimension_one(mask):
    assert fractal_dimension(Pixels.of(mask)) == pytest.approx(1, abs=0.02)


def test_the_koch_snowflake():
    assert fractal_dimension(Pixels.of(koch(6, 1500.0))) == pytest.approx(np.log(4) / np.log(3), abs=0.03)


def test_a_set_of_points_that_fills_the_plane():
    """Every second pixel: all boxes are met; those that stick out at the sides lower D by log(1 + s / 600)."""
    mask = np.zeros((600, 600))
    mask[::2, ::2] = 1
    assert fractal_dimension(Pixels.of(mask)) == pytest.approx(2, abs=0.1)


def test_counts_are_means_over_all_positions_of_the_boxes():
    mask = star(20, 0.4, 5)
    pixels = Pixels.of(mask)
    edge = np.pad(outline(pixels.colony), 40)
    sizes, counts = box_counts(pixels)
    assert list(sizes) == [2, 4, 8]
    for size, count in zip(sizes, counts, strict=True):
        number = 0
        for i in range(size):
            for j in range(size):
                shifted = edge[i:, j:]
                rows, columns = (n // size * size for n in shifted.shape)
                boxes = shifted[:rows, :columns].reshape(rows // size, size, columns // size, size)
                number += boxes.any(axis=(1, 3)).sum()
        assert count == pytest.approx(number / size**2)


def test_filaments_raise_it():
    assert fractal_dimension(Pixels.of(star(150, 0.35, 30))) > fractal_dimension(Pixels.of(star(150, 0.35, 8))) > 1.02


@pytest.mark.parametrize(("side", "sizes"), [(1, 0), (7, 0), (8, 1), (31, 2), (32, 3), (1024, 8)])
def test_a_small_colony_has_few_sizes_and_no_dimension(side, sizes):
    pixels = Pixels.of(np.ones((1, side)))
    assert len(box_counts(pixels)[0]) == sizes
    assert np.isnan(fractal_dimension(pixels)) == (sizes < 3)
