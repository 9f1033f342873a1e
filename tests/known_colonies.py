"""A table of measurements, and a forward model of colonies whose curves are a known function of λ: `--model known`.

compactness = a (1 + 0.3 log mobility + 0.2 log t),   radius = 2 + t √aspect_ratio,   10 % noise of each colony
"""

import csv
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit import (
    FORWARD_MODELS,
    PARAMETERS,
    Observable,
    ParameterSet,
    Scales,
    Simulator,
    Specification,
    Targets,
)
from yeastfit.commands import app as cli
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.specification import path_of

TRUTH = {"mobility": 1.5, "aspect_ratio": 0.5}
HOURS = (4.0, 6.0, 8.0)
SCATTER = 0.1
RECIPE = """
[small]
seed = 5
hours = [3, 5, 6]
replicates = 6
extent = 75.0
parameters = { mobility = 1.0, metabolic_rate = 1.0, aspect_ratio = 0.6 }
numerics = { domain = 14.0, spacing = 0.2, dt = 0.01, capacity = 32 }
"""


def curves(mobility: np.ndarray, aspect_ratio: np.ndarray, times: np.ndarray) -> np.ndarray:
    """[row, statistic and time]."""
    t = times[None]
    compactness = 2 * (1 + 0.3 * np.log(mobility)[:, None] + 0.2 * np.log(t))
    return np.concatenate([compactness, 2 + t * np.sqrt(aspect_ratio)[:, None]], axis=1)


@dataclass(frozen=True)
class KnownColonies:
    """Such colonies as a simulator."""

    parameters: ParameterSet
    fixed: Mapping[str, float]
    observables: tuple[Observable, ...]
    problems: Counter[str] = field(default_factory=Counter)

    @property
    def specification(self) -> Specification:
        columns = [(one.statistic, one.time) for one in self.observables]
        free: dict[str, Any] = {"free": self.parameters.names, "fixed": dict(self.fixed), "observables": columns}
        return Specification(path_of(known_colonies), free)

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        before(self, values, seeds)
        each = {name: np.full(len(values), value) for name, value in self.fixed.items()}
        each |= {name: values[:, k] for k, name in enumerate(self.parameters.names)}
        times = np.array([Scales().time(hours) for hours in HOURS])
        mean = curves(each["mobility"], each["aspect_ratio"], times)
        noise = np.array([np.random.default_rng(int(seed)).normal(size=mean.shape[1]) for seed in seeds])
        return mean * (1 + SCATTER * noise)


def known_colonies(
    free: Sequence[str], fixed: Mapping[str, float], observables: Sequence[tuple[str, float]]
) -> KnownColonies:
    """The simulator of a specification."""
    return KnownColonies(PARAMETERS.subset(free), fixed, tuple(Observable(*one) for one in observables))


def before(simulator: KnownColonies, values: np.ndarray, seeds: np.ndarray) -> None:
    """Called before each batch; tests put something else here."""


@dataclass(frozen=True)
class Known(Algebraic):
    """Such colonies as a forward model; outlines are discs that grow from row to row."""

    free = ("mobility", "aspect_ratio")
    nouns = ("disc", "discs")

    def simulator(self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]) -> Simulator:
        return KnownColonies(PARAMETERS.subset(free), dict(fixed), targets.observables)

    def outlines(
        self, simulator: Simulator, values: np.ndarray, targets: Targets, seed: int
    ) -> tuple[list[np.ndarray], float]:
        x = np.arange(-80, 81)
        return [np.hypot(x[:, None], x) <= 40 + 10 * k for k in range(len(values))], 0.375

    def check(self, largest: Mapping[str, float], hours: Sequence[float]) -> None:
        """Known curves need no time step."""


FORWARD_MODELS["known"] = Known


def write_measurements(path: Path, replicates: int = 6, seed: int = 3, conditions: tuple[str, ...] = ("",)) -> Path:
    """Colonies of the truth, as `yeastfit measure` would write them, without masks."""
    rng, scales, rows = np.random.default_rng(seed), Scales(), []
    times = np.array([scales.time(hours) for hours in HOURS])
    mean = curves(np.array([TRUTH["mobility"]]), np.array([TRUTH["aspect_ratio"]]), times)[0].reshape(2, -1)
    for condition in conditions:
        for replicate in range(replicates):
            one = mean * (1 + SCATTER * rng.normal(size=mean.shape))
            for hours, compactness, radius in zip(HOURS, *one, strict=True):
                size = {"radius": radius * scales.length, "max_radius": 2 * radius * scales.length}
                named = {"file": f"{replicate}.tif", "condition": condition, "replicate": replicate, "hours": hours}
                rows.append({**named, "um_per_pixel": 0.75, "compactness": compactness, **size, "mask": "none.png"})
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def photographed(folder: Path) -> Path:
    """A small data set of grown colonies, photographs and truth."""
    recipe = folder / "recipes.toml"
    recipe.write_text(RECIPE)
    assert cli.run(["synthesize", "--recipe", str(recipe), "--out", str(folder)]) == 0
    return folder / "small"


def kill_within(seconds: float, nap: float) -> None:
    """From now on in this process: each batch after a nap, and the kill at a moment of the clock."""
    global before

    def before(simulator: KnownColonies, values: np.ndarray, seeds: np.ndarray) -> None:
        time.sleep(nap)

    killing = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGKILL))
    killing.daemon = True
    killing.start()


def kill_after(calls: int) -> None:
    """From now on in this process: the operating system's kill in one of the batches."""
    global before
    left = [calls]

    def before(simulator: KnownColonies, values: np.ndarray, seeds: np.ndarray) -> None:
        left[0] -= 1
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)
