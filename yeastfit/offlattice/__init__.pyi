"""Public names of the off-lattice model."""

from .colony import OfflatticeColony, grow, grow_many
from .masks.area_matching import match_exactly, search_from_below
from .masks.ellipse_mask import Ellipses
from .masks.li2024_mask import BinnedOutlines
from .simulation import OfflatticeSimulation, simulate_offlattice
from .simulator import OfflatticeSimulator

__all__ = [
    "BinnedOutlines",
    "Ellipses",
    "OfflatticeColony",
    "OfflatticeSimulation",
    "OfflatticeSimulator",
    "grow",
    "grow_many",
    "match_exactly",
    "search_from_below",
    "simulate_offlattice",
]
