"""A simulator that reads from a store what is there and adds what is not."""

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.simulator import Rows, Seeds, Simulator, Values, labels_of, rows_in_blocks
from yeastfit.inference.store.simulations import Simulations


class CachedSimulator:
    """A simulator whose results are kept, called with batches of one size only.

    Batches of one size compile once. A smaller one is filled up with copies of its first row. A simulator that gives
    its rows in blocks (`rows_in_blocks`) is asked for all that are missing at once; each block is kept when it comes.

    Attributes:
        batch: Rows of every call.
        store: Where results are kept.
        asked: Rows that were asked for.
        fresh: Those of them that had to be simulated.
    """

    def __init__(self, simulator: Simulator, batch: int, store: Simulations | None = None) -> None:
        """Wrap a simulator; without a store, results are kept in memory.

        Raises:
            InputError: `batch` is below 1, or the store holds other simulations.
        """
        if batch < 1:
            raise InputError(f"batch is {batch}, it must be at least 1")
        names, labels = simulator.parameters.names, labels_of(simulator)
        self.store = store if store is not None else Simulations(names, labels)
        self.store.check(simulator)
        self.simulator, self.batch = simulator, batch
        self.parameters, self.observables, self.labels = simulator.parameters, simulator.observables, labels
        self.asked = self.fresh = 0

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """As the simulator's own, for any number of rows."""
        stored, statistics = self.store.find(values, seeds)
        missing, start = np.flatnonzero(~stored), 0
        for found in rows_in_blocks(self.simulator, values[missing], seeds[missing], self.batch):
            rows = missing[start : start + len(found)]
            statistics[rows], start = found, start + len(found)
            self.store.append(values[rows], seeds[rows], found)
        self.asked += len(seeds)
        self.fresh += len(missing)
        return statistics
