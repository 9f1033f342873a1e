"""emcee's chains in an HDF5 file that can be taken up again bit for bit, wherever their writer was killed.

emcee writes a step in several places of its file, and a kill may come between them. So every step has a check, the
CRC-32 of its positions, log-probabilities and blobs: what counts is the steps before the first whose check is wrong,
whatever else the file says. Random numbers are not taken from the file but from the number of the step. A file that
cannot be read at all is put aside, and the chains start anew: the stored simulations are found again one by one.
"""

import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from emcee import State
from emcee.backends import HDFBackend

from yeastfit.errors import InputError
from yeastfit.storage import as_json, check_room, from_json, full_disks_told

GROUP = "mcmc"
STEP = np.dtype([("simulations", "<i8"), ("check", "<u4")])
SIGNATURE = b"\x89HDF"


class ChainFile(HDFBackend):
    """emcee's backend with a check on every step and the number of simulations up to it.

    head: what the chains are of, plain data; a file with another is refused. count: simulations so far. notes: what had
    to be mended, in words. Raises `InputError` for a file that is none of these.
    """

    def __init__(self, path: str | Path, head: Mapping[str, Any], count: Callable[[], int]) -> None:
        super().__init__(str(path), name=GROUP)
        self.path, self.head, self.count = Path(path), from_json(as_json(head)), count
        self.notes = list[str]()

    @full_disks_told()
    def reset(self, nwalkers: int, ndim: int) -> None:
        """Empties it, or makes it, with the folders above it."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        check_room(self.path)
        super().reset(nwalkers, ndim)
        with self.open("a") as file:
            file[GROUP].create_dataset("steps", (0,), maxshape=(None,), dtype=STEP)
            file[GROUP].attrs["head"] = as_json(self.head)

    @full_disks_told()
    def grow(self, ngrow: int, blobs: np.ndarray | None) -> None:
        """Makes room for further steps."""
        check_room(self.path)
        super().grow(ngrow, blobs)
        with self.open("a") as file:
            file[GROUP]["steps"].resize(len(file[GROUP]["chain"]), axis=0)

    @full_disks_told()
    def save_step(self, state: State, accepted: np.ndarray) -> None:
        """Adds a step, as emcee's backend does, but opens the file only once."""
        check_room(self.path)
        rows = {"chain": state.coords, "log_prob": state.log_prob, "blobs": state.blobs}
        with self.open("a") as file:
            group = file[GROUP]
            step = group.attrs["iteration"]
            for name, values in rows.items():
                group[name][step, :] = values
            group["steps"][step] = (self.count(), _check(*rows.values()))
            group["accepted"][:] += accepted
            for k, part in enumerate(state.random_state):
                group.attrs[f"random_state_{k}"] = part
            group.attrs["iteration"] = step + 1

    def take_up(self) -> int:
        """Steps that are whole, after which emcee is to go on; 0 where there is no file."""
        if not self.path.exists():
            return 0
        with self.path.open("rb") as start:
            if start.read(len(SIGNATURE)) != SIGNATURE:
                raise InputError(f"{self.path} exists and is no file of chains, give another path")
        try:
            steps, done = self._whole()
            _ = self.random_state  # emcee will read it
        except InputError:
            raise
        except (OSError, KeyError, RuntimeError, ValueError) as error:
            aside = self.path.with_name(self.path.name + ".damaged")
            self.path.replace(aside)
            self.notes.append(
                f"{self.path.name} was damaged ({error}), it is {aside.name} now and the chains began anew"
            )
            return 0
        if steps != done:
            self.notes.append(
                f"{self.path.name} was torn: {done} of {steps} steps are whole, the chains go on after them"
            )
        return done

    def simulations(self, step: int) -> int:
        """Up to and with this one of the steps, the first is 1."""
        with self.open() as file:
            return int(file[GROUP]["steps"][step - 1]["simulations"])

    def _whole(self) -> tuple[int, int]:
        """Steps that the file says it has, and those that are whole, at which it is set."""
        with self.open("a") as file:
            group = file[GROUP]
            self._compare(from_json(group.attrs["head"]))
            said = int(group.attrs["iteration"])
            if not said:
                return 0, 0
            chain, log_prob, blobs = (group[name][...] for name in ("chain", "log_prob", "blobs"))
            checks = np.array([_check(*step) for step in zip(chain, log_prob, blobs, strict=True)])
            right = checks == group["steps"]["check"][...]
            done = len(right) if right.all() else int(np.argmin(right))
            group.attrs["iteration"] = done
            group["accepted"][...] = np.any(np.diff(chain[:done], axis=0) != 0, axis=2).sum(axis=0)
            return max(said, done), done

    def _compare(self, head: Mapping[str, Any]) -> None:
        different = [key for key in self.head if head.get(key) != self.head[key]]
        if different:
            said = "; ".join(f"{key} was {head.get(key)}, now it is {self.head[key]}" for key in different)
            raise InputError(f"{self.path} holds other chains: {said}")


def _check(coords: np.ndarray, log_prob: np.ndarray, blobs: np.ndarray) -> int:
    return zlib.crc32(b"".join(np.ascontiguousarray(one).tobytes() for one in (coords, log_prob, blobs)))
