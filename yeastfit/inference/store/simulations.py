"""Simulations that are found again by their parameters and seed, bit by bit."""

import hashlib
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Shaped

from yeastfit.errors import InputError
from yeastfit.inference.simulator import Simulator, about_of, labels_of, row_keys

ROOM = 1024  # rows to begin with

Values = Float[np.ndarray, "draw free"]
Seeds = Shaped[np.ndarray, " draw"]
Statistics = Float[np.ndarray, "draw statistic"]


class Simulations:
    """Parameters, seeds and statistics of simulations, in memory.

    Attributes:
        free: Names of the parameters.
        labels: Names of the statistics.
        notes: What had to be mended, in words.
        reused: Parameters and statistics taken over from another run (`reuse`).
    """

    def __init__(self, free: Sequence[str], labels: Sequence[str]) -> None:
        self.free, self.labels = tuple(free), tuple(labels)
        self.notes = list[str]()
        self._asked_for = ""  # what the first simulator is about
        self.reused: tuple[Values, Statistics] = np.zeros((0, len(free))), np.zeros((0, len(labels)))
        parts = [("seed", "<u8"), ("values", "<f8", (len(free),)), ("statistics", "<f8", (len(labels),))]
        self._type = np.dtype([*parts, ("check", "<u4")])
        self._count, self._rows, self._row_of = 0, np.zeros(ROOM, self._type), dict[bytes, int]()

    def check(self, simulator: Simulator) -> None:
        """Check that a simulator is of these parameters and statistics, and no other one than the first that asked.

        Raises:
            InputError: It is not, as far as simulators say what decides over a simulation (`about_of`).
        """
        names, labels, about = simulator.parameters.names, labels_of(simulator), about_of(simulator)
        if (self.free, self.labels) != (names, labels):
            raise InputError(f"store holds {self.free}, {self.labels}, the simulator {names}, {labels}")
        first = self._asked_for = self._asked_for or about
        if about and about != first:
            raise InputError(f"store holds other simulations: they are of {apart(first, about)}; take another store")

    def append(self, values: Values, seeds: Seeds, statistics: Statistics) -> None:
        """Add rows, but for those that are there already."""
        new = np.zeros(len(seeds), self._type)
        new["seed"], new["values"], new["statistics"] = seeds, values, statistics
        new["check"] = checks(new)
        first = {key: k for k, key in reversed(list(enumerate(row_keys(values, seeds))))}
        fresh = {key: k for key, k in sorted(first.items(), key=lambda pair: pair[1]) if key not in self._row_of}
        start, stop = self._count, self._count + len(fresh)
        if stop > len(self._rows):
            more = max(stop, 2 * len(self._rows)) - len(self._rows)
            self._rows = np.concatenate([self._rows, np.zeros(more, self._type)])
        self._rows[start:stop], self._count = new[list(fresh.values())], stop
        self._row_of.update({key: start + n for n, key in enumerate(fresh)})

    def reuse(self, values: Values, seeds: Seeds, statistics: Statistics) -> None:
        """Add simulations of another run of the same simulator.

        They are found like this run's own; a method that learns from simulations learns from all of them (`reused`).

        Raises:
            InputError: They are of other parameters or statistics.
        """
        shapes = values.shape, statistics.shape
        if shapes != ((len(seeds), len(self.free)), (len(seeds), len(self.labels))):
            raise InputError(
                f"reuse: values and statistics have shapes {shapes[0]} and {shapes[1]}, {len(self.free)} parameters "
                f"and {len(self.labels)} statistics in {len(seeds)} rows are expected"
            )
        self.append(values, seeds, statistics)
        self.reused = values, statistics

    def find(self, values: Values, seeds: Seeds) -> tuple[Bool[np.ndarray, " draw"], Statistics]:
        """Which of these simulations are there, and their statistics, nan for the others."""
        rows = np.array([self._row_of.get(key, -1) for key in row_keys(values, seeds)], dtype=int)
        stored = rows >= 0
        return stored, np.where(stored[:, None], self._rows["statistics"][rows], np.nan)

    def all(self) -> tuple[Values, Seeds, Statistics]:
        """Every simulation once, in the order in which they were made."""
        rows = self._rows[: self._count]
        return rows["values"].copy(), rows["seed"].copy(), rows["statistics"].copy()

    @property
    def sha256(self) -> str:
        """Of all rows, in their order."""
        return hashlib.sha256(self._rows[: self._count].tobytes()).hexdigest()

    def __len__(self) -> int:
        return self._count

    def _take(self, rows: np.ndarray, room: int) -> None:
        """Hold these rows and no others, with room for further ones."""
        self._count = len(rows)
        self._rows = np.concatenate([rows, np.zeros(room - len(rows), self._type)])
        keys = row_keys(rows["values"], rows["seed"])
        self._row_of = {key: row for row, key in enumerate(keys)}


def apart(there: Any, here: Any) -> str:
    """What is there and is not what is here: of lists in words the parts that differ."""
    if isinstance(here, list):
        return f"{', '.join(map(str, there))}, not {', '.join(here)}"
    parts = str(there).split(", "), str(here).split(", ")
    if len(parts[0]) != len(parts[1]):
        return f"{there}, not {here}"
    return ", ".join(f"{one}, not {other}" for one, other in zip(*parts, strict=True) if one != other)


def checks(rows: np.ndarray) -> np.ndarray:
    """CRC-32 of each row but for its check, which comes last."""
    width = rows.dtype.itemsize - rows.dtype["check"].itemsize
    return np.array([zlib.crc32(row.tobytes()[:width]) for row in rows], dtype=np.uint32)
