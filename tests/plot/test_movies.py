"""Movies of colonies that grow: as many frames as were asked for, each further than the one before."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageSequence

from yeastfit import plot
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.panel import Panel


def test_a_movie_has_a_frame_for_each_moment(tmp_path: Path) -> None:
    def seen(width: int) -> list[Panel]:
        cells = np.zeros((40, 40), int)
        cells[20 - width : 20 + width, 20 - width : 20 + width] = 1
        nutrient = np.full((40, 40), 1 - width / 20)
        return [Panel("cells", cells, 10.0, kinds=("nothing", "cells")), Panel("nutrient", nutrient, 10.0, "c / c0")]

    written = plot.movie([seen(2), seen(6), seen(10)], tmp_path / "movie")
    assert written[0] == tmp_path / "movie.gif"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in written)
    with Image.open(written[0]) as image:
        frames = [np.asarray(frame.convert("L"), float) for frame in ImageSequence.Iterator(image)]
    assert len(frames) == 3
    dark = [(frame < 128).mean() for frame in frames]
    assert dark[0] < dark[1] < dark[2]


def test_a_colony_of_the_off_lattice_model_grows_and_eats() -> None:
    pytest.importorskip("numba")
    model = Offlattice(cells=300)  # of which not all find room
    frames = list(model.movie(model.parameters.defaults, 0, 4))
    shown = [int((panels[0].values > 0).sum()) for panels in frames]
    assert shown == sorted(shown)
    assert shown[0] < shown[-1]
    assert frames[0][1].title.endswith("100% of the nutrient left")
    count = int(frames[-1][0].title.split()[0])
    assert frames[-1][1].title.endswith(f" {1 - count / 300:.0%} of the nutrient left")
    assert np.isin(frames[-1][0].values, (0, 1, 2)).all()


@pytest.mark.slow
def test_frames_of_the_algebraic_model_go_on_to_the_colony_of_simulate() -> None:
    model = Algebraic(time=3.0, domain=20.0, spacing=0.2, capacity=64)
    frames = list(model.movie({}, 0, 3))
    end = model.grow({}, 1, 0).panels(0)
    assert frames[-1][0].title == end[0].title
    np.testing.assert_array_equal(frames[-1][1].values, end[1].values)
    assert frames[0][1].values.min() > frames[-1][1].values.min()


@pytest.mark.thorough
@pytest.mark.parametrize("until", [{"until_cells": 5}, {"until_area": 4.0}], ids=str)
def test_a_movie_ends_where_growth_did(until: dict[str, Any]) -> None:
    model = Algebraic(time=4.0, domain=12.0, spacing=0.2, dt=0.02, **until)
    grown = model.grow({}, 2, 0)
    frames = list(model.ended_as(grown).movie({}, 0, 3))
    assert frames[-1][0].title == grown.panels(0)[0].title
    assert "(t = 4)" not in frames[-1][0].title


def test_a_movie_without_an_end_of_growth_lasts_to_the_time() -> None:
    model = Algebraic(time=2.0, every=1.0, domain=12.0, spacing=0.2, dt=0.02)
    assert model.ended_as(model.grow({}, 1, 0)) == model
