"""The forward model, one law a file.

Axis names: `node` slots of a colony, `cell` its edges, `x y` the nutrient grid, `i j` its interior, `member`
an ensemble, `sample` the times at which it is observed.
"""

from yeastfit.model.cells import Cells, cells_of, level_set
from yeastfit.model.colony import Colony, start
from yeastfit.model.laws.budding import TurnedBudding
from yeastfit.model.laws.uptake import biomass
from yeastfit.model.snapshot import Snapshot

__all__ = ["Cells", "Colony", "Snapshot", "TurnedBudding", "biomass", "cells_of", "level_set", "start"]
