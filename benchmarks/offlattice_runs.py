"""Posteriors of the off-lattice model, each kept in files of its own, so that what was interrupted goes on.

A posterior leaves METHOD.h5, every simulation; METHOD.seconds, what all sittings took; and at its end METHOD.npz.
"""

import csv
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.li2024 import LI2024, Li2024Colonies
from yeastfit.inference.models.offlattice import COMPARABLE
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.posterior.limits import Limits, limits_around
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.samplers import infer
from yeastfit.inference.simulator import Simulator, labels_of
from yeastfit.inference.store.simulation_store import Store
from yeastfit.measure import OUTLINE_ERRORS
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.storage import read_json, write_json

DATA = Path(__file__).parents[1] / "data" / "real"
FIVE = (*COMPARABLE[:3], "branch_length", "compactness")
SEED = 2024
METHODS = {
    "emulator": "emulator, 5 statistics of single colonies",
    "protocol": "protocol reproduced",
    "emulator-theirs": "emulator, I_F, I_R, I_B",
    "smc": "ABC-SMC to the same ε",
}
"""Methods by the names of their files, in the order in which they run."""


@dataclass(frozen=True)
class Sizes:
    """How much is computed.

    Attributes:
        sets: What is inferred.
        emulator: Settings of both emulators.
        smc: Settings of ABC-SMC but for the tolerance.
        at_mean: Colonies that are grown at the published means.
    """

    sets: dict[str, Li2024Colonies] = field(default_factory=lambda: LI2024)
    emulator: SequentialEmulator = field(default_factory=lambda: SequentialEmulator(batch=128, most_steps=60_000))
    smc: AbcSmc = field(
        default_factory=lambda: AbcSmc(population=500, simulations=60_000, batch=64, distance="li", adjust=False)
    )
    at_mean: int = 32


@dataclass(frozen=True)
class Run:
    """One posterior.

    Attributes:
        key: Of the set.
        method: In `METHODS`.
        sizes: How much is computed.
        folder: Of all its files.
        threads: That colonies grow on.
        steps: Of the protocol's chains, where they shall stop before their end; a later run goes on from there.
    """

    key: str
    method: str
    sizes: Sizes
    folder: Path
    threads: int | None = None
    steps: int | None = None

    @property
    def colonies(self) -> Li2024Colonies:
        """The set."""
        return self.sizes.sets[self.key]

    def file(self, suffix: str, method: str = "") -> Path:
        """One of its files, or of another method's on the same set."""
        return self.folder / self.key / f"{method or self.method}.{suffix}"

    @property
    def statistics(self) -> tuple[str, ...]:
        """What is compared."""
        return FIVE if self.method == "emulator" else PUBLISHED

    @property
    def simulator(self) -> Simulator:
        """Of single colonies.

        What is compared with single real colonies is drawn without Li et al.'s frame, which cuts wide ones off.
        """
        simulator = self.colonies.simulator(self.statistics, self.threads)
        return replace(simulator, draw=BinnedOutlines.whole) if self.method == "emulator" else simulator

    @property
    def limits(self) -> Limits | None:
        """Of the statistics, far beyond those of the real colonies, for an emulator."""
        return limits_around(real_colonies(self.key, self.statistics)) if self.method.startswith("emulator") else None

    @property
    def observed(self) -> tuple[Float[np.ndarray, " statistic"], int]:
        """Means, and of how many colonies."""
        if self.method != "emulator":
            return np.array(self.colonies.observed), self.colonies.replicates
        rows = real_colonies(self.key, FIVE)
        return rows.mean(axis=0), len(rows)

    @property
    def noise(self) -> Float[np.ndarray, "statistic statistic"] | None:
        """Covariance of the means' errors, where photographs are taken to be known as well as outlines are."""
        if self.method != "emulator":
            return None
        return np.diag((np.array([OUTLINE_ERRORS[name] for name in FIVE]) * self.observed[0]) ** 2)

    @property
    def sampler(self) -> Sampler:
        """With its settings."""
        if self.method.startswith("emulator"):
            return self.sizes.emulator
        if self.method == "protocol":
            return self.colonies.protocol(seed=SEED, steps=self.steps)
        return replace(self.sizes.smc, tolerance=self.colonies.tolerance)

    @property
    def there(self) -> bool:
        """Whether there is a posterior, if of chains that were stopped."""
        return self.file("npz").is_file()

    @property
    def done(self) -> int:
        """Steps of the protocol's chains, 0 without any; 1 for another posterior that is there."""
        if not self.there:
            return 0
        return int(self.posterior().settings["steps"]) if self.method == "protocol" else 1

    @property
    def finished(self) -> bool:
        """Whether its posterior is there and whole."""
        return self.done >= (self.colonies.steps if self.method == "protocol" else 1)

    @property
    def name(self) -> str:
        """In words; of chains that were stopped, with their steps."""
        cut = self.there and not self.finished
        return METHODS[self.method] + (f", first {self.done} of {self.colonies.steps} steps" if cut else "")

    def posterior(self) -> Posterior:
        """What `infer` found."""
        return Posterior.load(self.file("npz"))

    def simulations(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and statistics of all that were simulated."""
        with self._store() as store:
            values, _, statistics = store.all()
        return values, statistics

    def seconds(self) -> dict[str, float]:
        """By the clock and of the processors, over all sittings."""
        file = self.file("seconds")
        return read_json(file) if file.is_file() else {"clock": 0.0, "processor": 0.0}

    def infer(self, said: Callable[[str], None]) -> None:
        """Compute what is missing."""
        if self.finished or (self.steps and self.done >= self.steps):
            return
        self.file("npz").parent.mkdir(parents=True, exist_ok=True)
        clock = _Clock(self, said)
        observed, replicates = self.observed
        simulator = self.simulator
        with self._store() as store:
            if self.method == "emulator-theirs":
                store.reuse(*self._of_protocol())
            found = infer(
                simulator,
                self.colonies.prior,
                observed,
                method=self.sampler,
                replicates=replicates if self.method.startswith("emulator") else 1,
                noise=self.noise,
                limits=self.limits,
                seed=SEED,
                store=store,
                progress=clock,
            )
        clock.keep()
        found.save(self.file("npz"))

    def _of_protocol(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parameters, seeds and I_F, I_R and I_B of what their protocol has simulated of the set."""
        if not self.file("h5", "protocol").is_file():
            return np.zeros((0, len(self.simulator.parameters.names))), np.zeros(0, np.uint64), np.zeros((0, 3))
        with replace(self, method="protocol")._store() as other:
            values, seeds, statistics = other.all()
        return values, seeds, statistics if self.limits is None else np.clip(statistics, *self.limits.T)

    def _store(self) -> Store:
        simulator = self.simulator
        about = f"{self.key}, {self.colonies.cells} cells, {self.colonies.area:g} pixels"
        return Store(self.file("h5"), simulator.parameters.names, labels_of(simulator), about)


class _Clock:
    """Progress that is said twice a minute at most, and with it what a run has taken so far."""

    def __init__(self, run: Run, said: Callable[[str], None]) -> None:
        self.run, self.said, self.before = run, said, run.seconds()
        self.began = self.last = time.perf_counter()
        self.worked = time.process_time()

    def __call__(self, what: str, share: float) -> None:
        """Tell and keep."""
        if time.perf_counter() - self.last >= 30:
            self.last = time.perf_counter()
            self.said(f"{self.run.key}, {self.run.method}: {what}, {100 * share:.1f} %")
            self.keep()

    def keep(self) -> None:
        """Write what all sittings took."""
        spent = {"clock": time.perf_counter() - self.began, "processor": time.process_time() - self.worked}
        write_json(self.run.file("seconds"), {name: self.before[name] + value for name, value in spent.items()})


def real_colonies(key: str, statistics: tuple[str, ...]) -> Float[np.ndarray, "colony statistic"]:
    """Statistics of single real colonies, from data/real."""
    with (DATA / key / "measurements.csv").open(newline="", encoding="utf-8") as file:
        return np.array([[float(row[name]) for name in statistics] for row in csv.DictReader(file)])
