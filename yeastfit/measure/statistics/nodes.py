"""What only the state of a simulated colony tells: `yeastfit.model.snapshot` has the equations."""

from yeastfit.measure.statistics.statistic import Statistic

ENTRIES = (
    Statistic(
        "growth_rate", 0, "growth rate μ over μ*", "growth rate μ", nodes=lambda s: s.growth_rate, comparable=False
    ),
    Statistic(
        "mean_radius",
        1,
        "mean distance of nodes from where the colony began",
        "mean radius of nodes d̄",
        nodes=lambda s: s.mean_radius,
        reach=3.0,
    ),
    Statistic("cell_count", 0, "number of cells", "cells", nodes=lambda s: s.cell_count),
    Statistic(
        "dead_share", 0, "share of nodes that are dead and in the way", nodes=lambda s: s.dead_share, may_vanish=True
    ),
    Statistic("networks", 0, "number of networks of cells that hang together", nodes=lambda s: s.networks),
    Statistic(
        "overlap_area",
        2,
        "area in which cells overlap, summed over pairs of cells",
        nodes=lambda s: s.overlap_area,
        comparable=False,
    ),
)
