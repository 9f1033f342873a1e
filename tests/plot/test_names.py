"""`yeastfit.plot`: what it offers, and that matplotlib comes with it only."""

import subprocess
import sys

import pytest
from matplotlib.figure import Figure

import yeastfit
from yeastfit import plot

PROGRAM = """
import sys, yeastfit
assert "matplotlib" not in sys.modules
yeastfit.plot.fit
assert "matplotlib" in sys.modules
"""


def test_matplotlib_is_imported_with_the_first_figure_only() -> None:
    subprocess.run([sys.executable, "-c", PROGRAM], check=True)


def test_the_functions_are_named_after_what_they_draw() -> None:
    names = "bootstrap colonies colony condition_curves convergence corner cross_validation curves design ellipses fit"
    names += " left_out marginals overlay predictive profiles ranks spectrum thumbnail_sheet traces"
    for name in names.split():
        assert getattr(yeastfit.plot, name).__annotations__["return"] is Figure
    assert set(plot.__all__) == {*names.split(), "movie", "save", "thumbnail"}


def test_an_unknown_attribute_is_an_error() -> None:
    with pytest.raises(AttributeError, match="'nothing'"):
        yeastfit.nothing  # type: ignore[attr-defined] # noqa: B018
