"""The width of closed gaps and the margin of outlines, inferred with parameters of growth from colonies drawn so."""

import numpy as np
import pytest

from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.samplers import infer
from yeastfit.offlattice.masks.area_matching import match_exactly
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.simulator import OfflatticeSimulator

STATISTICS = ("filament_area_index", "filament_radius_index", "compactness", "hole_count", "smoothed_branch_index")
GROWTH = {"transition": 0.65, "pseudohyphal_from_sated": 0.25, "any_mother": 0.12}
COLONIES = 8


@pytest.mark.slow
@pytest.mark.parametrize(
    "drawing", [{"gap": 8.0}, {"gap": 14.0}, {"gap": 20.0}, {"gap": 10.0, "margin": 2.0}, {"gap": 10.0, "margin": 5.0}]
)
def test_they_are_recovered(drawing: dict[str, float]) -> None:
    """Within 3 posterior deviations, as all parameters are, and more narrowly than the prior has them."""
    true = GROWTH | drawing
    statistics = STATISTICS if "margin" not in drawing else (*STATISTICS, "branch_length")
    simulator = OfflatticeSimulator.of(
        statistics, cells=8000, area=75_000.0, free=tuple(true), draw=Ellipses.of, match=match_exactly
    )
    at = np.array(list(true.values()))
    observed = simulator(np.tile(at, (COLONIES, 1)), 100 + np.arange(COLONIES)).mean(axis=0)
    prior, how = Offlattice().prior(simulator.parameters), SequentialEmulator(simulations=4096)
    posterior = infer(simulator, prior, observed, method=how, replicates=COLONIES, seed=0)
    assert posterior.settled
    assert (np.abs(posterior.mean - at) < 3 * posterior.sd).all()
    for name, value in drawing.items():
        assert posterior.sd[list(true).index(name)] < (0.15 if len(drawing) == 1 else 0.3) * value
