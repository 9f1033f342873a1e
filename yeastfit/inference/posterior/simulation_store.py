"""Every simulation of a run on disk: parameters, seed, statistics, for this method and for any other.

One HDF5 file with one dataset, `simulations`, a row each: seed, values, statistics, check. What makes it safe against
a kill at any moment:

- The dataset is contiguous and has room for more rows than it holds. Rows are written in place, which leaves the file's
  own bookkeeping, all of it in front of the rows, as it was.
- A full file is written anew with twice the room, beside the old one, and takes its name once it is whole.
- A row counts if its check, the CRC-32 of its bytes, is right. Room that was never written and rows that were torn have
  wrong ones. A file that lost its end is filled up with zeros: it loses the rows that were there and nothing else.

Simulations are found again by parameters and seed, bit by bit, so a run that is repeated or taken up again simulates
nothing twice: whatever a sampler was doing when it was killed, doing it again costs next to nothing.
"""

import zlib
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from jaxtyping import Bool, Float, Shaped

from yeastfit.errors import InputError
from yeastfit.inference.simulator import Simulator, labels_of
from yeastfit.storage import as_json, from_json, full_disks_told, hdf5_written_whole

DATASET = "simulations"
ROOM = 1024  # rows of a new file
SIGNATURE, SUPERBLOCK, END = b"\x89HDF\r\n\x1a\n", 0, slice(40, 48)  # HDF5 file format 3.0, section II.A, version 0

Values = Float[np.ndarray, "draw free"]
Seeds = Shaped[np.ndarray, " draw"]
Statistics = Float[np.ndarray, "draw statistic"]


class Store:
    """Simulations in a file, which is created where there is none. A context manager; one process at a time.

    free, labels: names of parameters and statistics. about: what was simulated, in any words; a file is refused that
    holds other parameters, other statistics or is about something else. notes: what had to be mended, in words.
    Raises `InputError` for a file that is none of these, damaged, or in use.
    """

    def __init__(self, path: str | Path, free: Sequence[str], labels: Sequence[str], about: str = "") -> None:
        self.path, self.free, self.labels, self.about = Path(path), tuple(free), tuple(labels), about
        self.notes = list[str]()
        parts = [("seed", "<u8"), ("values", "<f8", (len(free),)), ("statistics", "<f8", (len(labels),))]
        self._type = np.dtype([*parts, ("check", "<u4")])
        self._count, self._rows = 0, np.zeros(ROOM, self._type)
        self._file: h5py.File | None = None
        if self.path.exists():
            self._open()
        else:
            self._write_whole()

    @full_disks_told()
    def append(self, values: Values, seeds: Seeds, statistics: Statistics) -> None:
        """Rows, of which those that are there already are left out; on disk when this returns."""
        new = np.zeros(len(seeds), self._type)
        new["seed"], new["values"], new["statistics"] = seeds, values, statistics
        new["check"] = _checks(new)
        keys = _keys(values, seeds)
        first = {key: k for k, key in reversed(list(enumerate(keys)))}
        fresh = sorted(k for key, k in first.items() if key not in self._found)
        start, stop = self._count, self._count + len(fresh)
        if stop > len(self._rows):
            self._rows = np.concatenate(
                [self._rows, np.zeros(max(stop, 2 * len(self._rows)) - len(self._rows), self._type)]
            )
            self._rows[start:stop], self._count = new[fresh], stop
            self._write_whole()
        else:
            self._rows[start:stop], self._count = new[fresh], stop
            self._found.update({keys[k]: start + n for n, k in enumerate(fresh)})
            self._opened[DATASET][start:stop] = new[fresh]
            self._opened.flush()

    def find(self, values: Values, seeds: Seeds) -> tuple[Bool[np.ndarray, " draw"], Statistics]:
        """Which of these simulations are there, and their statistics, nan for the others."""
        at = np.array([self._found.get(key, -1) for key in _keys(values, seeds)], dtype=int)
        known = at >= 0
        return known, np.where(known[:, None], self._rows["statistics"][at], np.nan)

    def all(self) -> tuple[Values, Seeds, Statistics]:
        """Every simulation once, in the order in which they were made."""
        rows = self._rows[: self._count]
        return rows["values"].copy(), rows["seed"].copy(), rows["statistics"].copy()

    def __len__(self) -> int:
        return self._count

    @full_disks_told()
    def close(self) -> None:
        """Lets others have the file."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def __enter__(self) -> "Store":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def _opened(self) -> h5py.File:
        if self._file is None:
            raise InputError(f"{self.path}: the store is closed")
        return self._file

    @property
    def _head(self) -> dict[str, Any]:
        return {"free": list(self.free), "labels": list(self.labels), "about": self.about}

    def _write_whole(self) -> None:
        """All rows into a new file, which replaces the old one."""
        self.close()
        with hdf5_written_whole(self.path) as image, h5py.File(image, "w", libver=("earliest", "v108")) as file:
            file.attrs["head"] = as_json(self._head)
            file.create_dataset(DATASET, data=self._rows)
        self._file = _opened(self.path)
        self._index()

    def _open(self) -> None:
        """Reads a file, mends it where its end is torn, and checks that it is the right one."""
        shorter = _fill_up(self.path)
        self._file = _opened(self.path)
        try:
            head = from_json(self._file.attrs["head"])
            different = [f"{key} is {head[key]}, not {one}" for key, one in self._head.items() if head[key] != one]
            if different:
                raise InputError(f"{self.path} holds other simulations: {'; '.join(different)}")
            rows = self._file[DATASET][...]
        except InputError:
            self.close()
            raise
        except (OSError, KeyError, ValueError, TypeError) as error:
            self.close()
            raise InputError(f"{self.path}: no simulations can be read, the file is damaged: {error}") from error
        whole = _checks(rows) == rows["check"]
        torn = int(np.sum(~whole & (rows != np.zeros(1, rows.dtype))))
        self._count, self._rows = int(whole.sum()), np.concatenate([rows[whole], np.zeros_like(rows[~whole])])
        if shorter or torn:
            self.notes.append(f"{self.path.name} was torn: {self._count} simulations are whole, what followed is gone")
            self._write_whole()
        self._index()

    def _index(self) -> None:
        values, seeds, _ = self.all()
        self._found = {key: row for row, key in enumerate(_keys(values, seeds))}


class Recorded:
    """A simulator whose simulations are counted and stored, called with batches of one size only.

    What a store holds already is taken from there. batch: rows of every call; smaller ones are filled up with copies of
    their first row. asked: simulations so far; fresh: those of them that were not in the store.
    """

    def __init__(self, simulator: Simulator, batch: int, store: Store | None = None) -> None:
        if batch < 1:
            raise InputError(f"batch is {batch}, it must be at least 1")
        names, labels = simulator.parameters.names, labels_of(simulator)
        if store is not None and (store.free, store.labels) != (names, labels):
            raise InputError(f"store holds {store.free}, {store.labels}, the simulator {names}, {labels}")
        self.simulator, self.batch, self.store = simulator, batch, store
        self.parameters, self.observables, self.labels = simulator.parameters, simulator.observables, labels
        self.asked = self.fresh = 0

    def __call__(self, values: Values, seeds: Seeds) -> Statistics:
        """As the simulator's own, for any number of rows."""
        known, statistics = np.zeros(len(seeds), bool), np.full((len(seeds), len(self.labels)), np.nan)
        if self.store is not None:
            known, statistics = self.store.find(values, seeds)
        missing = np.flatnonzero(~known)
        for start in range(0, len(missing), self.batch):
            rows = missing[start : start + self.batch]
            padded = np.concatenate([rows, np.full(self.batch - len(rows), rows[0])])
            found = np.asarray(self.simulator(values[padded], seeds[padded]), dtype=float)
            if found.shape != (self.batch, len(self.labels)):
                raise InputError(f"simulator gave shape {found.shape}, expected {(self.batch, len(self.labels))}")
            statistics[rows] = found[: len(rows)]
            if self.store is not None:
                self.store.append(values[rows], seeds[rows], statistics[rows])
        self.asked += len(seeds)
        self.fresh += len(missing)
        return statistics

    @property
    def about(self) -> str:
        """What is simulated, by the store's words."""
        return self.store.about if self.store is not None else ""

    @property
    def notes(self) -> list[str]:
        """The store's."""
        return self.store.notes if self.store is not None else []


def _keys(values: Values, seeds: Seeds) -> list[bytes]:
    """What a simulation is found by: the bits of its parameters and its seed."""
    return [int(seed).to_bytes(8, "little") + row.tobytes() for row, seed in zip(values, seeds, strict=True)]


def _checks(rows: np.ndarray) -> np.ndarray:
    """CRC-32 of each row but for its check, which comes last."""
    width = rows.dtype.itemsize - rows.dtype["check"].itemsize
    return np.array([zlib.crc32(row.tobytes()[:width]) for row in rows], dtype=np.uint32)


def _opened(path: Path) -> h5py.File:
    try:
        return h5py.File(path, "r+")
    except BlockingIOError:
        raise InputError(f"{path} is in use by another process") from None
    except OSError as error:
        raise InputError(f"{path}: no simulations can be read, the file is damaged: {error}") from error


def _fill_up(path: Path) -> bool:
    """Zeros where a file's end is missing; whether there was any missing."""
    size = path.stat().st_size
    with path.open("r+b") as file:
        head = file.read(END.stop)
        if len(head) < END.stop or not head.startswith(SIGNATURE) or head[8] != SUPERBLOCK:
            raise InputError(f"{path} is not a file of simulations, or it is damaged: it starts with {head[:8]!r}")
        missing = size < (end := int.from_bytes(head[END], "little"))
        if missing:
            file.truncate(end)
    return missing
