"""A simulator without physics that other processes can import, for tests of workers."""

import time
from collections import Counter

import numpy as np
from simulators import parameters_named

from yeastfit import Observable, Specification
from yeastfit.specification import path_of


class Wobble:
    """Three statistics, of two parameters and noise. Some rows run into problems, and some fail.

    seconds: That a row takes. fails: a seed whose rows raise an error.
    """

    def __init__(self, seconds: float = 0.0, fails: int = -1) -> None:
        self.seconds, self.fails = seconds, fails
        self.parameters = parameters_named(("a", "b"))
        self.observables = tuple(Observable("radius", time) for time in (1.0, 2.0, 3.0))
        self.problems = Counter[str]()
        self.asked = list[int]()

    @property
    def specification(self) -> Specification:
        return Specification(path_of(type(self)), {"seconds": self.seconds, "fails": self.fails})

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        if self.fails in seeds:
            raise ValueError(f"seed {self.fails} is out of order")
        time.sleep(self.seconds * len(seeds))
        different = dict.fromkeys(map(int, seeds))
        self.asked += different
        for word, count in (("odd", 7), ("even odder", 5)):
            if met := sum(seed % count == 0 for seed in different):
                self.problems[word] += met
        noise = np.array([np.random.default_rng(int(seed)).standard_normal(3) for seed in seeds]).reshape(-1, 3)
        rows = values[:, :1] * np.arange(1, 4) + values[:, 1:] ** 2 + 0.1 * noise
        return np.where((seeds % 11 == 3)[:, None], np.nan, rows)


def proposed(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rows that a sampler could propose."""
    rng = np.random.default_rng(seed)
    return np.exp(rng.normal(size=(count, 2))), rng.permutation(
        np.arange(count, dtype=np.uint64) + np.uint64(1000 * seed)
    )
