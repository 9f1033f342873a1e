"""What is calibrated: data sets of each method on each model, in full and for a quick look."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.calibration_models import Small, Young
from benchmarks.recovery import SEED
from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.posterior.limits import limits_around
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.samplers import infer
from yeastfit.inference.simulator import Replicates, Simulator, labels_of, seed_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulation_store import Store
from yeastfit.seeds import Stream, stream_of


@dataclass(frozen=True)
class Part:
    """Data sets of one method.

    Attributes:
        method: Its name.
        groups: How many groups there are.
        each: Data sets of a group.
        model: What is simulated.
        replicates: Colonies of a data set, which is their mean.
        limited: Whether there are limits around the single colonies of a data set (`posterior.limits`).
        draws: L, the independent draws that a truth is ranked among.
        bins: Of the histograms.
        settings: Of the sampler.
        judged: Simulations from the prior that train the emulator of the log-likelihood; also ABC's pilot.
        judge: Settings of that emulator.
        again: Another number, other truths, data and seeds.
    """

    method: str
    groups: int
    each: int
    model: Young | Small
    replicates: int
    draws: int
    bins: int
    settings: SequentialEmulator | AbcSmc
    judged: int = 512
    judge: TrainingSettings = field(default_factory=TrainingSettings)
    limited: bool = False
    again: int = 0

    @property
    def emulator(self) -> bool:
        """Whether the method is the emulator; otherwise it is ABC."""
        return isinstance(self.settings, SequentialEmulator)

    @property
    def count(self) -> int:
        """Number of data sets; they are numbered from 1."""
        return self.groups * self.each

    @property
    def seed(self) -> int:
        """Seed of truths and data, from which those of groups are derived."""
        return SEED + 2 * self.again + (0 if self.emulator else 1)

    def group(self, number: int) -> int:
        """Number of the group of a data set, from 0."""
        return (number - 1) // self.each

    @property
    def prior(self) -> Prior:
        """Of the truths."""
        return self.model.prior

    def simulator(self, spread: Callable[[Simulator], Simulator] | None = None) -> Simulator:
        """Of single colonies for the emulator, which knows of replicates; of means over them for ABC.

        Arguments:
            spread: Has workers simulate the colonies.
        """
        colonies = self.model.simulator()
        colonies = colonies if spread is None else spread(colonies)
        return colonies if self.emulator else Replicates(colonies, self.replicates)

    def data(self, simulator: Simulator, truth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """A data set at a row of parameters: single colonies where there are limits around them, else their mean."""
        if self.limited:
            seeds = rng.integers(2**32, size=self.replicates).astype(np.uint64)
            return simulator(np.repeat(truth, self.replicates, axis=0), seeds)
        whole = Replicates(simulator, self.replicates) if self.emulator else simulator
        return whole(truth, rng.integers(2**32, size=1))[0]

    def posterior(self, simulator: Simulator, data: np.ndarray, seed: int, store: Store) -> Posterior:
        """The posterior of one data set."""
        how: dict[str, Any] = {"method": self.settings, "seed": seed, "store": store}
        if self.limited:
            return infer(simulator, self.prior, data, limits=limits_around(data), **how)
        return infer(simulator, self.prior, data, replicates=self.replicates if self.emulator else 1, **how)

    def judging(self, simulator: Simulator, seed: int, store: Store) -> Emulator:
        """An emulator trained on simulations from the prior alone, which no posterior uses."""
        values = self.prior.sample(self.judged, np.random.default_rng(stream_of(seed, Stream.TRUTH, 0)))
        statistics = CachedSimulator(simulator, self.settings.batch, store)(values, seed_of(seed, range(self.judged)))
        room = self.settings.simulations if self.emulator else None
        labels = labels_of(simulator)
        return train(values, statistics, prior=self.prior, labels=labels, seed=seed, settings=self.judge, room=room)


EMULATED = SequentialEmulator(simulations=1536, first=512, batch=128)
SMC = AbcSmc(population=200, simulations=2000, pilot=512, batch=64)
FULL = (
    Part("emulator", 8, 25, model=Young((2.5, 3.5, 4.5)), replicates=10, draws=99, bins=20, settings=EMULATED),
    Part("ABC-SMC", 4, 25, model=Young((2.5, 3.5)), replicates=2, draws=19, bins=10, settings=SMC),
)
TINY = TrainingSettings(members=2, width=16, steps=100)
FEW: dict[str, Any] = {
    "groups": 1,
    "each": 4,
    "model": Young((1.5, 2.5)),
    "draws": 19,
    "bins": 5,
    "judged": 64,
    "judge": TINY,
}
QUICK = (
    replace(FULL[0], settings=SequentialEmulator(128, first=64, most_steps=500, batch=64, training=TINY), **FEW),
    replace(FULL[1], settings=AbcSmc(population=64, simulations=512, pilot=64, batch=64), **FEW),
)
CELLS = Part(
    "emulator",
    4,
    25,
    model=Small(),
    replicates=14,
    limited=True,
    draws=99,
    bins=20,
    settings=SequentialEmulator(simulations=1024, first=512, each=256, batch=64),
)
FEW_CELLS = replace(
    QUICK[0],
    model=Small(cells=600, area=9_000),
    limited=True,
    settings=SequentialEmulator(256, first=128, most_steps=500, batch=64, training=TINY),
    judged=128,
)
STUDIES = {"algebraic": (FULL, QUICK), "offlattice": ((CELLS,), (FEW_CELLS,))}
"""Parts by model, in full and for a quick look."""
