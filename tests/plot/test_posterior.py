"""Pictures of posteriors: what they show, of draws that are known, weighted, at an end of the prior, or all alike."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made_posteriors import made_posterior
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from yeastfit import plot
from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics, RoundDiagnostics
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.prior import Prior
from yeastfit.plot.style import TRUTH, label_log_axis

PRIOR = Prior.of(
    {
        "mobility": {"distribution": "log-uniform", "low": 0.1, "high": 10.0},
        "aspect_ratio": {"distribution": "uniform", "low": 0.0, "high": 1.0},
    }
)


def made_up(weighted: bool = False, still: bool = False) -> Posterior:
    """Three chains, or one of weighted draws."""
    rng = np.random.default_rng(2)
    values = np.stack([np.exp(0.2 * rng.normal(size=(3, 200))), rng.beta(20, 1.2, size=(3, 200))], axis=2)
    values = np.broadcast_to(values[:1, :1], values.shape) if still else values
    values = values.reshape(1, 600, 2) if weighted else values
    weights = rng.random(values.shape[:2]) if weighted else np.ones(values.shape[:2])
    return made_posterior(values, weights / weights.sum(), prior=PRIOR)


def drawn(figure: Figure) -> Figure:
    """As `plot.save` would draw it; warnings are errors."""
    FigureCanvasAgg(figure).draw()
    return figure


@pytest.mark.parametrize(("weighted", "still"), [(False, False), (True, False), (False, True)])
def test_corner(weighted: bool, still: bool) -> None:
    found = made_up(weighted, still)
    figure = drawn(plot.corner(found, {"mobility": 1.1, "aspect_ratio": 0.9}))
    first, _, pair, second = figure.axes
    assert (pair.get_xlabel(), pair.get_ylabel()) == ("mobility", "aspect ratio")
    truths = [line.get_xdata()[0] for line in first.lines if line.get_color() == TRUTH]  # type: ignore[index]
    assert truths == [1.1]
    (bars,) = first.patches
    heights, edges, _ = bars.get_data()  # type: ignore[attr-defined]
    assert heights @ np.diff(edges) == pytest.approx(1.0, abs=0.01)
    if not still:
        ends = [line.get_xdata()[0] for line in second.lines if line.get_linestyle() == "--"]  # type: ignore[index]
        assert ends == [1.0]  # the prior's upper end, which the posterior leans on


def test_the_prior_is_a_density_of_what_the_axis_shows() -> None:
    narrow = made_up()
    wide = replace(narrow, values=narrow.values ** np.array([3.0, 1.0]))
    for found, scale in ((narrow, "linear"), (wide, "log")):
        panel = plot.corner(found).axes[0]
        assert panel.get_xscale() == scale
        line = next(line for line in panel.lines if line.get_color() == "0.5")
        x, density = (np.asarray(one, dtype=float) for one in line.get_data())
        np.testing.assert_allclose(density, 1 / np.log(100) / (x if scale == "linear" else 1.0))


def test_traces_and_ranks() -> None:
    found = made_up()
    figure = drawn(plot.traces(found))
    assert [len(panel.lines) for panel in figure.axes] == [3, 3]
    drawn(plot.traces(made_up(weighted=True)))
    assert found.chains is not None
    ranks = drawn(plot.ranks(found.chains))
    assert [len(panel.patches) for panel in ranks.axes] == [4, 4]  # three chains, and what chance allows


def test_colonies_have_one_scale() -> None:
    x = np.arange(-40, 41)
    small, large = (np.hypot(x[:, None], x) <= radius for radius in (10, 30))
    grey = np.where(small, 60.0, 180.0)
    figure = drawn(plot.colonies([("a", grey, small, 2.0), ("b", None, large, 1.0)], [("c", large, 0.5)] * 3))
    assert len(figure.axes) == 6
    shown = [panel for panel in figure.axes if panel.images]
    assert len(shown) == 5
    assert {panel.get_xlim() for panel in shown} == {(-32.0, 32.0)}
    outline = np.concatenate([np.asarray(line.get_data()) for line in shown[0].lines], axis=1)
    assert np.hypot(*outline).max() == pytest.approx(21.0, abs=1.5)  # µm: ten pixels and a half of 2 µm
    alone = drawn(plot.colonies([], [("c", large, 0.5)] * 3))
    assert [len(panel.images) for panel in alone.axes] == [1, 1, 1]
    assert alone.get_suptitle().startswith("simulated at draws")


def test_held_out_residuals() -> None:
    held_out = CrossValidation(("a", "b"), np.array([0.1, -0.2]), np.diag([1.1, 0.8]), np.zeros(2), 400)
    diagnostics = EmulatorDiagnostics((RoundDiagnostics(400, 0, 0.1, 0.01, True, held_out),), 500, 0)
    upper, lower = drawn(plot.cross_validation(diagnostics)).axes
    np.testing.assert_allclose(upper.lines[-1].get_ydata(), [0.1, -0.2])  # type: ignore[arg-type]
    np.testing.assert_allclose(lower.lines[-1].get_ydata(), [1.1, 0.8])  # type: ignore[arg-type]


def test_axes_show_the_posterior_and_tell_of_what_lies_beyond() -> None:
    """Nine tenths within a factor of 1.2, one tenth on a trail that reaches ten times as far."""
    rng = np.random.default_rng(4)
    near, far = np.exp(0.04 * rng.standard_normal(1800)), np.geomspace(1.5, 9.9, 200)
    values = np.stack([np.concatenate([near, far]), np.full(2000, 0.5) + 0.01 * rng.standard_normal(2000)], axis=1)
    figure = drawn(plot.corner(made_posterior(values[None], prior=PRIOR)))
    first, _, pair, _ = figure.axes
    low, high = first.get_xlim()
    assert 0.75 < low < 0.95
    assert 1.05 < high < 1.6
    assert [text.get_text() for text in first.texts] == ["10.0% →"]
    assert pair.get_xlim() == first.get_xlim()


@pytest.mark.parametrize(("low", "high"), [(0.62, 0.68), (1.0, 7.0), (0.03, 2.5), (0.1, 900.0)])
def test_labels_of_a_logarithmic_axis_do_not_overlap(low: float, high: float) -> None:
    figure = Figure(figsize=(2.1, 2.1))
    panel = figure.subplots()
    panel.set(xscale="log", xlim=(low, high))
    panel.tick_params(labelsize=7, which="both")
    label_log_axis(panel.xaxis, low, high)
    drawn(figure)
    shown = [each for each in panel.get_xticklabels(which="both") if each.get_text()]
    boxes = [each.get_window_extent() for each in shown if low <= each.get_position()[0] <= high]
    assert len(boxes) >= 2
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
