"""The width of closed gaps, inferred with parameters of growth from colonies drawn with a known one."""

import numpy as np
import pytest

from yeastfit.inference.models.offlattice import Offlattice
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.samplers import infer
from yeastfit.offlattice.masks.area_matching import match_exactly
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.simulator import OfflatticeSimulator

STATISTICS = ("filament_area_index", "filament_radius_index", "compactness", "hole_count", "smoothed_branch_index")
FREE = ("transition", "pseudohyphal_from_sated", "any_mother", "gap")
GROWN = (0.65, 0.25, 0.12)
COLONIES = 8


@pytest.mark.slow
@pytest.mark.parametrize("gap", [8.0, 14.0, 20.0])
def test_it_is_recovered(gap: float) -> None:
    """Within 3 posterior deviations, as all parameters are, and more narrowly than the prior, 6 to 30 µm, has it."""
    simulator = OfflatticeSimulator.of(
        STATISTICS, cells=8000, area=75_000.0, free=FREE, draw=Ellipses.of, match=match_exactly
    )
    true = np.array([*GROWN, gap])
    observed = simulator(np.tile(true, (COLONIES, 1)), 100 + np.arange(COLONIES)).mean(axis=0)
    prior, how = Offlattice().prior(simulator.parameters), SequentialEmulator(simulations=4096)
    posterior = infer(simulator, prior, observed, method=how, replicates=COLONIES, seed=0)
    assert posterior.settled
    assert (np.abs(posterior.mean - true) < 3 * posterior.sd).all()
    assert posterior.sd[FREE.index("gap")] < 0.15 * gap
