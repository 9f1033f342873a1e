"""The off-lattice model as it is compared with photographs: what is drawn of its colonies, and how well it is known."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from yeastfit import Targets
from yeastfit.errors import InputError
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.models.offlattice_drawing import TEXTURE
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.measure.outlining.outline_errors import COLONY_ERRORS, OUTLINE_ERRORS
from yeastfit.offlattice.masks import ellipse_mask
from yeastfit.offlattice.masks.ellipse_mask import PIXEL, Ellipses
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.offlattice.simulator import known_statistics


def test_outlines_are_of_colonies_that_an_image_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    targets, model = Targets.from_means({"compactness": [1.0]}, [10.0]), Offlattice(cells=300)
    simulator = model.simulator(targets, PARAMETERS.names, {})
    values = np.array([[1.0, 0.5, 0.5, 0.5, 0.5], [0.1, 0.05, 0.9, 0.05, 0.05]])
    drawn, pixel_size = model.outlines(simulator, values, targets, 0)
    assert len(drawn) == 2
    monkeypatch.setattr(ellipse_mask, "MOST_PIXELS", drawn[0].size)
    held, same = model.outlines(simulator, values, targets, 0)
    assert len(held) == 1
    np.testing.assert_array_equal(held[0], drawn[0])
    assert same == pixel_size == PIXEL
    none, _ = model.outlines(simulator, np.array([[0.5, 0.5, 0.0, 0.5, 0.0]]), targets, 0)  # no cell could bud any more
    assert none == []


def test_masks_are_drawn_as_the_statistics_ask_for() -> None:
    """As Li et al. do for their three indices, without the frame for others of theirs, else as ellipses, or as said."""
    whole = Offlattice(cells=100).statistics
    theirs = Offlattice(cells=100).statistics_named(["li2024"])
    nine = Offlattice(cells=100).statistics_named(["texture", "solidity"])
    assert (len(nine), nine) == (9, TEXTURE)

    def drawn(names: tuple[str, ...], masks: Any = None) -> Any:
        targets, model = Targets.from_means({name: [1.0] for name in names}, [10.0]), Offlattice(cells=100, masks=masks)
        draw = model.simulator(targets, PARAMETERS.names, {}).draw
        return draw.func if isinstance(draw, partial) else draw

    assert drawn(theirs) == BinnedOutlines.of
    assert drawn(whole) == drawn(theirs, "bins") == BinnedOutlines.whole
    assert drawn((*theirs, "compactness")) == drawn(theirs, "ellipses") == drawn(nine) == Ellipses.of
    assert drawn((*whole, "compactness"), "li2024") == BinnedOutlines.of


def test_ellipses_are_drawn_with_gaps_of_a_width_closed() -> None:
    """By default as outlines of photographs close them; elsewhere a width is of no use, and said."""
    targets = Targets.from_means({"compactness": [1.0]}, [10.0])

    def closed(fixed: dict[str, float]) -> Any:
        return Offlattice(cells=100).simulator(targets, PARAMETERS.names, fixed).draw.keywords  # type: ignore[attr-defined]

    assert closed({}) == {"pixel_size": PIXEL, "gap": 12.0, "margin": 0.0}
    assert closed({"gap": 0.0, "margin": 2.5}) == {"pixel_size": PIXEL, "gap": 0.0, "margin": 2.5}
    for width in (-1.0, np.nan, 101.0):
        with pytest.raises(InputError, match=r"gap \(w\) is \S+, it must be in \[0, 100\]"):
            Offlattice().parameters.check({"gap": width})
        with pytest.raises(InputError, match=r"gap \(w\) is \S+, it must be in \[0, 100\]"):
            closed({"gap": width})
    binned, not_used = (
        Offlattice(masks="bins"),
        "--gap is that of ellipses and not used, masks are drawn by --masks bins",
    )
    with pytest.raises(InputError, match=not_used):
        binned.sensitivity(("compactness",), {"gap": 6.0})
    with pytest.raises(InputError, match=not_used):
        binned.simulator(targets, PARAMETERS.names, {"gap": 6.0})
    with pytest.raises(InputError, match="--free: gap is that of ellipses, and masks are drawn by --masks bins"):
        binned.simulator(targets, (*PARAMETERS.names, "gap"), {})


def test_parameters_that_do_not_act_are_not_held() -> None:
    model, growth = Offlattice(), PARAMETERS.defaults
    binned, drawn = (model.held(one, ("fork",), {"transition": 0.4}) for one in (model.statistics, ("compactness",)))
    assert binned == {name: 0.4 if name == "transition" else growth[name] for name in growth if name != "fork"}
    assert drawn == {**binned, "gap": 12.0, "margin": 0.0}
    assert model.held(model.statistics, ("fork",), {"gap": 6.0})["gap"] == 6.0  # given, and refused elsewhere


def test_the_width_of_closed_gaps_may_be_free() -> None:
    """Colonies are the same, and have fewer holes the wider it is; its prior is log-uniform, the others Li et al.'s."""
    targets = Targets.from_means({"hole_count": [100.0], "compactness": [1.0]}, [10.0])
    model = Offlattice(cells=5000, match="none")
    free = model.simulator(targets, ("transition", "gap"), {})
    values, seeds = np.array([[0.5, 6.0], [0.5, 12.0], [0.5, 24.0]]), np.full(3, 7, dtype=np.uint64)
    found = free(values, seeds)
    assert (np.diff(found, axis=0) < 0).all()
    for row, gap in zip(found, values[:, 1].tolist(), strict=True):
        held = model.simulator(targets, ("transition",), {"gap": gap})
        np.testing.assert_array_equal(held(values[:1, :1], seeds[:1])[0], row)
        assert held.about != free.about
    (first, *_), _ = model.outlines(free, values, targets, 0)
    assert first.any()
    prior = model.prior(free.parameters)
    assert prior.distributions["transition"] == Distribution("beta", {"a": 5.0, "b": 2.0})
    assert prior.distributions["gap"] == Distribution("log-uniform", {"low": 6.0, "high": 30.0})
    moved = model.sensitivity(("compactness", "radius"), {"gap": 10.0}, runs=32, seed=0)
    assert moved.at["gap"] == 10.0
    assert moved.free == (*PARAMETERS.names, "gap")  # a margin of 0 has no relative change


def test_the_margin_of_outlines_may_be_free() -> None:
    """Colonies are those of a margin that is held, and the same cells cover more the wider it is."""
    targets = Targets.from_means({"area": [1e5], "compactness": [1.0]}, [10.0])
    model = Offlattice(cells=2000, match="none")
    free = model.simulator(targets, ("transition", "gap", "margin"), {})
    values, seeds = np.array([[0.5, 8.0, 0.0], [0.5, 8.0, 2.0], [0.5, 8.0, 6.0]]), np.full(3, 7, dtype=np.uint64)
    found = free(values, seeds)
    assert (np.diff(found[:, 0]) > 0).all()
    for row, margin in zip(found, values[:, 2].tolist(), strict=True):
        held = model.simulator(targets, ("transition",), {"gap": 8.0, "margin": margin})
        np.testing.assert_array_equal(held(values[:1, :1], seeds[:1])[0], row)
    prior = model.prior(free.parameters)
    assert prior.distributions["margin"] == Distribution("log-uniform", {"low": 0.5, "high": 10.0})
    binned = Offlattice(masks="bins")
    with pytest.raises(InputError, match="--margin is that of ellipses and not used, masks are drawn by --masks bins"):
        binned.simulator(targets, PARAMETERS.names, {"margin": 2.0})
    with pytest.raises(InputError, match="--free: margin is that of ellipses, and masks are drawn by --masks bins"):
        binned.simulator(targets, (*PARAMETERS.names, "margin"), {})


def test_errors_of_the_off_lattice_model_are_those_of_outlines() -> None:
    """Unless one is given; a statistic that nobody has looked at has its own."""
    names = ("smoothed_branch_index", "fractal_dimension")
    model = Offlattice()
    assert model.measurement_errors(names, None) == {"smoothed_branch_index": 0.13, "fractal_dimension": 0.01}
    assert model.measurement_errors(names, 0.0) == {"smoothed_branch_index": 0.0, "fractal_dimension": 0.0}
    assert model.colony_errors(names, None) == {"smoothed_branch_index": 0.15, "fractal_dimension": 0.0052}
    assert model.colony_errors(names, 0.1) == {"smoothed_branch_index": 0.0, "fractal_dimension": 0.0}
    assert {*OUTLINE_ERRORS, *COLONY_ERRORS} <= set(known_statistics())
