"""Statistics of masks of simulated colonies by name: `simulate --statistics`, for both models."""

from pathlib import Path

import jax
import numpy as np
import pytest

from yeastfit.errors import InputError
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.model_as_mask import mask_of
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.simulation import OfflatticeSimulation
from yeastfit.offlattice.statistics.li2024_statistics import li2024_statistics
from yeastfit.simulation.result import Simulation

NAMES = ("filament_area_index", "filament_radius_index", "branch_length", "angular_index", "fractal_dimension")


def test_the_algebraic_model_is_measured_as_a_photograph_is() -> None:
    """What `measure` says of the last state, drawn on the same pixels but for one or two where rounding decides."""
    model = Algebraic(time=1.5, every=1.5, domain=12.0, spacing=0.4, dt=0.025, capacity=16, hard=True, pixel_size=0.5)
    grown = model.grow({}, 1, 0, (*NAMES, "area", "cell_count"))
    assert isinstance(grown, Simulation)
    assert set(grown.statistics) == {*NAMES, "area", "cell_count"}
    points, pixel = round(12.0 * 7.5 / 0.5) + 1, 0.5 / 7.5
    colony = jax.tree.map(lambda leaf: leaf[0], grown.colony)
    mask = mask_of(colony, grown.parameters, grown.relaxation, pixel * (points - 1), points)
    expected = measure_mask(mask, pixel)
    assert grown.statistics["area"][0, -1] == pytest.approx(expected.area, abs=2.5 * pixel**2)
    for name in NAMES:
        np.testing.assert_allclose(grown.statistics[name][0, -1], expected[name], rtol=0.02, atol=0.002, err_msg=name)


def test_the_off_lattice_model_is_measured_in_what_is_named(tmp_path: Path) -> None:
    """And its file is no simulation of the other model's."""
    pytest.importorskip("numba")
    model = Offlattice(cells=3000, every=3000)
    grown = model.grow({}, 2, 0, ("li2024_branch_index", *NAMES))
    assert set(grown.statistics) == {"li2024_branch_index", *NAMES, "pseudohyphal_share"}
    assert isinstance(grown, OfflatticeSimulation)
    masks, pixel = grown.masks()
    for member, mask in enumerate(masks):
        expected = measure_mask(mask, pixel, NAMES)
        assert [grown.statistics[name][member, -1] for name in NAMES] == list(expected.values())
    theirs = li2024_statistics(BinnedOutlines.of(grown.colonies[0]).mask(grown.colonies[0].x.size))
    assert grown.statistics["li2024_branch_index"][0, -1] == theirs.branch_index
    grown.save(tmp_path / "simulation.npz")
    reader = r"yeastfit\.offlattice\.OfflatticeSimulation\.load"
    with pytest.raises(InputError, match=f"holds colonies of the off-lattice model, which {reader} reads"):
        Simulation.load(tmp_path / "simulation.npz")


@pytest.mark.parametrize(
    ("settings", "names", "said"),
    [
        ({"pixel_size": 8.0}, NAMES, "pixel-size is 8 µm, which is more than a cell's length, 7.5 µm"),
        ({"pixel_size": 0.0}, NAMES, "pixel_size"),
        ({}, ("roundness",), "roundness"),
    ],
)
def test_what_cannot_be_measured_is_refused(settings: dict[str, float], names: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Algebraic(**settings).grow({}, 1, 0, names)  # type: ignore[arg-type]
    if not settings:
        pytest.importorskip("numba")
        with pytest.raises(InputError, match=said):
            Offlattice(cells=10).grow({}, 1, 0, names)
