"""Public names of the off-lattice model."""

from .colony import OfflatticeColony, grow, grow_many
from .masks.area_matching import match_exactly, search_from_below
from .masks.ellipse_mask import Ellipses
from .masks.li2024_mask import BinnedOutlines
from .simulator import OfflatticeSimulator

__all__ = [
    "BinnedOutlines",
    "Ellipses",
    "OfflatticeColony",
    "OfflatticeSimulator",
    "grow",
    "grow_many",
    "match_exactly",
    "search_from_below",
]
