"""Photographs beside a simulated colony: which one is shown when, where it lies, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from measured_discs import disc, photograph

from yeastfit import plot, read_dataset
from yeastfit.commands import app as cli
from yeastfit.measure.photograph_panels import panel_at, photographs_of_first_colony


def time_series(folder: Path) -> Path:
    """Two photographs of colony b, the later one first, and one of colony a; pixels of 0.5 µm."""
    photograph(folder / "late.png", disc(30, 70, 50) | disc(4, 90, 20))
    photograph(folder / "early.png", disc(20, 70, 50))
    photograph(folder / "other.png", disc(10))
    rows = ["file,replicate,hours,um_per_pixel", "late.png,b,6,0.5", "other.png,a,1,0.5", "early.png,b,4,0.5"]
    (folder / "manifest.csv").write_text("\n".join(rows))
    return folder


def test_the_last_photograph_so_far_is_shown_about_its_colony(tmp_path: Path) -> None:
    photographs = photographs_of_first_colony(read_dataset(time_series(tmp_path)))
    assert [one.hours for one in photographs] == [4, 6]
    half = 20.0
    nothing, early, late = (panel_at(photographs, hours, half) for hours in (3.9, 5.0, 8.0))
    assert nothing.title == "no photograph yet"
    assert nothing.values.min() == 1
    assert (early.title, late.title) == ("photograph at 4 h", "photograph at 6 h")
    for panel, radius in ((early, 10.0), (late, 15.0)):
        assert panel.values.shape == (80, 80)
        assert panel.half_width == half
        x, y = np.nonzero(panel.values < 0.5)
        away = (np.stack([x, y]) + 0.5) * 0.5 - half
        near = np.hypot(*away) < radius + 1
        np.testing.assert_allclose(away[:, near].mean(axis=1), 0, atol=0.5)
        assert near.sum() * 0.25 == pytest.approx(np.pi * radius**2, rel=0.03)
    x, y = np.nonzero(late.values < 0.5)
    far = np.hypot(x - 39.5, y - 39.5) > 33
    assert far.sum() > 20, "the second object is in the picture"
    assert x[far].mean() > 40, "x is to the right"
    assert y[far].mean() > 40, "y is upwards: in the photograph it lies above"


def test_beyond_a_photograph_there_is_its_background(tmp_path: Path) -> None:
    photographs = photographs_of_first_colony(read_dataset(time_series(tmp_path)))
    panel = panel_at(photographs, 5.0, 60.0)
    assert panel.values.shape == (240, 240)
    assert np.ptp(panel.values[:40]) == 0
    assert panel.values[0, 0] > 0.8


def test_a_photograph_is_drawn_in_grey(tmp_path: Path) -> None:
    photographs = photographs_of_first_colony(read_dataset(time_series(tmp_path)))
    written = plot.movie([[panel_at(photographs, hours, 20.0)] for hours in (4.0, 6.0)], tmp_path / "movie")
    assert written[0].stat().st_size > 1000


def test_photographs_need_a_movie(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = time_series(tmp_path)
    assert cli.run(["simulate", "--beside", str(data), "--out", str(tmp_path / "out")]) == 2
    assert "--beside is given without --movie" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
