"""In what steps colonies are grown: usual ones, those of wide dishes, and those that are given."""

import dataclasses

import numpy as np
import pytest

from yeastfit import ColonySimulator, Imaging, InputError, Numerics, Resolution, Targets
from yeastfit.inference.fit.simulators import colony_simulators
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.resolution import COARSE, OF_WIDE_DISHES, usual_resolution


def targets(extent: float) -> Targets:
    """Two times of one statistic, of colonies that reach so far from their start."""
    return Targets.from_means({"radius": np.ones(2)}, [1.5, 3.2], imaging=Imaging(extent))


@pytest.mark.parametrize(
    ("extent", "coarse", "fine"), [(10.0, COARSE, Resolution()), (60.0, OF_WIDE_DISHES, OF_WIDE_DISHES)]
)
def test_colonies_of_wide_dishes_move_in_substeps(extent: float, coarse: Resolution, fine: Resolution) -> None:
    data = targets(extent)
    assert (usual_resolution(data, coarse=True), usual_resolution(data)) == (coarse, fine)
    made = ColonySimulator.of(data)
    assert made.resolution == fine
    numerics = made.curves.numerics
    assert (numerics.dt, numerics.spacing, numerics.substeps) == (fine.dt, fine.spacing, fine.substeps)
    both = colony_simulators({"one": data}, ("mobility",), {}, (None, None))
    assert [each["one"].resolution for each in both] == [coarse, fine]  # type: ignore[attr-defined]
    for_fits = Algebraic().fit_simulators(data, ("mobility",), {})
    assert [each.resolution for each in for_fits] == [coarse, fine]  # type: ignore[attr-defined]


def test_what_is_given_replaces_what_is_usual() -> None:
    data = targets(60.0)
    given = Algebraic(dt=0.01, spacing=0.2)
    made = given.simulator(data, ("mobility",), {}).resolution  # type: ignore[attr-defined]
    assert made == Resolution(0.01, 0.2)  # a time step of one's own has one substep
    made = Algebraic(substeps=2).simulator(data, ("mobility",), {}).resolution  # type: ignore[attr-defined]
    assert made == dataclasses.replace(OF_WIDE_DISHES, substeps=2)
    coarse, fine = (one.resolution for one in given.fit_simulators(data, ("mobility",), {}))  # type: ignore[attr-defined]
    assert coarse == Resolution(0.01, 0.2)
    assert (fine.dt, fine.spacing, fine.substeps) == (0.01, 0.2, 1)


@pytest.mark.parametrize(
    ("side", "expected"),
    [
        (40.0, (Numerics.dt, Numerics.spacing, 1)),
        (300.0, (OF_WIDE_DISHES.dt, 0.4, OF_WIDE_DISHES.substeps)),
        (251.0, (OF_WIDE_DISHES.dt, 251.0 / 628, OF_WIDE_DISHES.substeps)),
    ],
)
def test_a_dish_says_in_what_steps_simulate_goes(side: float, expected: tuple[float, float, int]) -> None:
    said = Algebraic(domain=side).settings("simulate")
    np.testing.assert_allclose([said[name] for name in ("dt", "spacing", "substeps")], expected, rtol=1e-12)
    said = Algebraic(domain=side, dt=0.01).settings("simulate")
    assert (said["dt"], said["substeps"]) == (0.01, 1)


def test_substeps_are_checked() -> None:
    with pytest.raises(InputError, match=r"substeps is 0, it must be a whole number from 1 to 1000"):
        Resolution(substeps=0)
    with pytest.raises(InputError, match=r"substeps is 1001, it must be"):
        Algebraic(substeps=1001)


def test_targets_without_imaging_are_refused() -> None:
    with pytest.raises(InputError, match="targets have no imaging"):
        usual_resolution(dataclasses.replace(targets(3.0), imaging=None))
