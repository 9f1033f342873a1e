"""The folder of a run that may be killed at any moment and taken up again.

run.json is written before anything else and says what the run is: its configuration, the SHA-256 of its inputs, seed,
versions and device. It is taken up by the same configuration and the same inputs only; numbers that merely say how long
it goes on (`EXTENT`) may rise. manifest.json comes last: a folder that has one is finished.
"""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from yeastfit.errors import InputError
from yeastfit.inference.targets_from_table import files_of, read_measurements, table_in
from yeastfit.measure.reading.dataset import dataset_folder, read_dataset
from yeastfit.storage import as_json, from_json, read_json, sha256_of, versions, write_json

RUN, MANIFEST = "run.json", "manifest.json"
SAMPLERS = ("emcee", "optax", "h5py")
EXTENT = ("steps", "simulations")
KEPT = ("first",)  # follows from how long it was to go on at first, and stays
OPTIONS = {"share": "pilot-quantile", "epsilon": "tolerance", "fixed": "model parameters"}


@dataclass(frozen=True)
class RunFolder:
    """Where a run lies and what it is. notes: what a user is to be told about taking it up."""

    path: Path
    configuration: dict[str, Any]
    inputs: dict[str, str]
    seed: int
    notes: list[str]
    finished: bool

    @staticmethod
    def begin(
        path: Path, configuration: Mapping[str, Any], inputs: Sequence[Path], seed: int, resume: bool
    ) -> "RunFolder":
        """Writes run.json, or compares with the one that is there.

        Raises `InputError` where there is a run and `resume` is not asked for, where it is another one or a shorter one
        is asked for, and where the folder holds inputs.
        """
        if path.resolve() in {one.resolve().parent for one in inputs}:
            raise InputError(f"--out: {path} holds the data, need another folder for the results")
        plain = from_json(as_json(configuration))
        hashes = hashes_of(inputs)
        file, finished = path / RUN, (path / MANIFEST).is_file()
        if not file.is_file():
            if finished:
                raise InputError(f"--out: {path} holds results of another command, give another folder")
            made = {"arguments": sys.argv[1:], "versions": run_versions(), "device": jax.devices()[0].device_kind}
            write_json(file, {"command": "infer", "seed": seed, "configuration": plain, "inputs": hashes, **made})
            notes = ["there is nothing to resume, a new run begins"] if resume else []
            return RunFolder(path, plain, hashes, seed, notes, False)
        if not resume:
            state = "a finished run" if finished else "a run that was not finished"
            raise InputError(f"--out: {path} holds {state}: give --resume to go on with it, or another folder")
        earlier = read_run(file)
        plain |= {name: earlier["configuration"][name] for name in KEPT if name in earlier["configuration"]}
        different = _differences(earlier["configuration"], plain)
        different += [f"seed was {earlier['seed']}, now it is {seed}"] if earlier["seed"] != seed else []
        changed = [f"{name} has changed" for name in hashes if earlier["inputs"].get(name) != hashes[name]]
        changed += [f"{name} is gone" for name in earlier["inputs"] if name not in hashes]
        if different or changed:
            raise InputError(f"--resume: {path} holds another run: {'; '.join(different + changed[:5])}")
        extents = [(name, earlier["configuration"][name], plain[name]) for name in EXTENT if name in plain]
        for name, before, now in extents:
            if now < before:
                raise InputError(
                    f"--resume: {path} holds a run of {before} {name}, now it is {now}: give --{name} {before} or more"
                )
        if longer := any(now > before for _, before, now in extents):
            (path / MANIFEST).unlink(missing_ok=True)  # first: a folder that has one is finished
            write_json(file, {**earlier, "configuration": plain})
        return RunFolder(path, plain, hashes, seed, _other_versions(earlier), finished and not longer)

    def resume_hint(self) -> str:
        """How to go on."""
        return f"nothing is lost: repeat the command with --resume to go on (--out {shlex.quote(str(self.path))})"


def inputs_of(source: Path) -> list[Path]:
    """What a run reads, which is there: manifest and images of a data set, or a table of measurements and its masks."""
    if where := dataset_folder(source):
        dataset = read_dataset(where)
        return [dataset.manifest, *(frame.path for frame in dataset.frames)]
    table = table_in(source)
    return files_of(table, read_measurements(table))


def hashes_of(inputs: Sequence[Path]) -> dict[str, str]:
    """SHA-256 by path below the first one's folder."""
    base = inputs[0].parent
    return {str(path.relative_to(base)) if path.is_relative_to(base) else str(path): sha256_of(path) for path in inputs}


def run_versions() -> dict[str, str]:
    """`versions`, and those of the packages that samplers depend on."""
    return {**versions(), **{name: version(name) for name in SAMPLERS}}


def read_run(file: Path) -> dict[str, Any]:
    """What `RunFolder.begin` wrote. Raises `InputError` for anything else."""
    try:
        found = read_json(file)
        return {**found, **{name: found[name] for name in ("configuration", "inputs", "seed", "versions", "device")}}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file}: this is no run that can be taken up: {error}") from error


def _differences(earlier: Mapping[str, Any], now: Mapping[str, Any], within: str = "") -> list[str]:
    """In words, down to single numbers of tables."""
    said = []
    for name in [*now, *(name for name in earlier if name not in now)]:
        if name in (*EXTENT, *KEPT) and not within:
            continue
        before, after = earlier.get(name), now.get(name)
        label = f"{within}{OPTIONS.get(name, name)}"
        if isinstance(before, dict) and isinstance(after, dict):
            said += _differences(before, after, f"{label}: ")
        elif before != after:
            said.append(f"{label} was {before}, now it is {after}")
    return said


def _other_versions(earlier: Mapping[str, Any]) -> list[str]:
    now = {**run_versions(), "device": jax.devices()[0].device_kind}
    before = {**earlier["versions"], "device": earlier["device"]}
    other = [f"{name} was {before.get(name)}, is {one}" for name, one in now.items() if before.get(name) != one]
    return [f"not to the last bit what it would have been, as {'; '.join(other)}"] if other else []
