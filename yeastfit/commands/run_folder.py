"""The run.json of a run that may be killed at any moment and resumed.

It is written before anything else and says what the run is: its configuration, the SHA-256 of its inputs, seed,
versions and device. Only the same configuration and the same inputs resume it; settings that merely say how long it
goes on may rise, and what is made of the posterior at the end may be something else.
"""

import os
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from yeastfit.errors import InputError
from yeastfit.inference.workers.arithmetic import xla_threads
from yeastfit.measure.measurements_table import OF_ANYTHING, files_of, read_measurements, table_in
from yeastfit.measure.reading.batch_inputs import dataset_images
from yeastfit.measure.reading.dataset import dataset_folder, read_dataset
from yeastfit.results.contents import MANIFEST, RUN
from yeastfit.results.folder import ResultsFolder
from yeastfit.storage import as_json, from_json, read_json, reads_saved, sha256_of, versions, write_json
from yeastfit.text import quoted

PACKAGES = ("emcee", "optax", "h5py")
PARTS = {  # of run.json
    "configuration": dict,
    "inputs": dict,
    "seed": int,
    "arguments": list,
    "versions": dict,
    "device": str,
}


@dataclass(frozen=True)
class RunFolder:
    """Where a run lies and what it is.

    Attributes:
        results: The folder.
        configuration: What the run is, plain data; the sampler's settings are in `settings`.
        inputs: SHA-256 by file.
        seed: Of the run.
        notes: What a user should know about resuming it, in words.
        new: What it may have made in the folder since it began, if that is now.
        record: What run.json shall be of a run that goes on as another than it was; None where it stays.
        predicts: Whether it has a posterior, of which something else is to be made.
    """

    results: ResultsFolder
    configuration: dict[str, Any]
    inputs: dict[str, str]
    seed: int
    notes: list[str]
    new: tuple[str, ...] = ()
    record: dict[str, Any] | None = None
    predicts: bool = False

    @property
    def path(self) -> Path:
        """Of the folder."""
        return self.results.path

    @staticmethod
    def begin(
        results: ResultsFolder,
        configuration: Mapping[str, Any],
        inputs: Sequence[Path],
        seed: int,
        resume: bool,
        *,
        stored: Sequence[str],
        extents: Sequence[str] = (),
        kept: Sequence[str] = (),
        made_last: Sequence[str] = (),
        copied: Sequence[str] = (),
    ) -> "RunFolder":
        """Write run.json, or compare with the one that is there; `go_on` changes that.

        Arguments:
            results: The folder.
            configuration: What the run is.
            inputs: Files that it reads.
            seed: Of the run.
            resume: Whether a run that is there goes on.
            stored: Names of files that a run goes on with.
            extents: Settings that may rise.
            kept: Settings that nobody asked for: those of the run's first call stay.
            made_last: Entries that leave the posterior as it is, and may be others each time.
            copied: Entries that are paths of what the run holds a copy of: that of its first call stays.

        Raises:
            InputError: The run is another one, or a shorter one is asked for.
        """
        path = results.path
        plain = from_json(as_json(configuration))
        hashes = hashes_of(inputs)
        file = path / RUN
        if not resume and results.finished:
            results.clear()
        if results.finished and not file.is_file():
            raise InputError(f"--resume: {path} has lost its {RUN}, give another folder")
        if not file.is_file():
            new = tuple(name for name in stored if not os.path.lexists(path / name))
            made = {"arguments": sys.argv[1:], "versions": run_versions(), **_machine()}
            write_json(file, {"command": "infer", "seed": seed, "configuration": plain, "inputs": hashes, **made})
            return RunFolder(results, plain, hashes, seed, [], new)
        if not results.finished and os.path.lexists(path / MANIFEST):
            raise InputError(f"--resume: {path / MANIFEST} is damaged: restore it, or give another folder")
        earlier = read_run(file)
        before, now = earlier["configuration"]["settings"], plain["settings"]
        now |= {name: before[name] for name in kept if name in before}
        for name in copied:
            began = earlier["configuration"].get(name)
            if began is not None and _same_place(began, plain.get(name)):
                plain[name] = began
        different = differences(earlier["configuration"], plain, leave_out=[*extents, *made_last])
        different += [f"{name} of its settings is lost" for name in extents if not isinstance(before.get(name), int)]
        different += [f"seed was {earlier['seed']}, now it is {seed}"] if earlier["seed"] != seed else []
        changed = [f"{name} has changed" for name in hashes if earlier["inputs"].get(name) != hashes[name]]
        changed += [f"{name} is gone" for name in earlier["inputs"] if name not in hashes]
        if different or changed:
            raise InputError(
                f"--resume: {path} holds another run: {'; '.join(different + changed[:5])}; it began as "
                f"{shlex.join(['yeastfit', *map(str, earlier['arguments'])])}"
            )
        for name in extents:
            if now[name] < before[name]:
                option = f"--{name.replace('_', '-')}"
                raise InputError(
                    f"--resume: {path} holds a run of {before[name]} {name}, now it is {now[name]}: give {option} "
                    f"{before[name]} or more"
                )
        longer = any(now[name] > before[name] for name in extents)
        others = any(earlier["configuration"].get(name) != plain[name] for name in made_last)
        record = {**earlier, "configuration": plain} if longer or others else None
        predicts = results.finished and others and not longer
        other = other_versions(earlier)
        notes = [f"not to the last bit what it would have been, as {other}"] if other else []
        return RunFolder(results, plain, hashes, seed, notes, record=record, predicts=predicts)

    def go_on(self, stored: Sequence[str]) -> None:
        """Let the folder be that of a run that goes on, once nothing speaks against it.

        Arguments:
            stored: Names of files that it goes on with.
        """
        if self.record is None:
            return
        if self.results.finished:
            self.results.check_as_written()
            self.results.reopen(stored)
        write_json(self.path / RUN, self.record)

    def remembered(self, name: str, value: Any) -> Any:
        """An entry of run.json, which is written there where a run that has not finished has none."""
        there = read_json(self.path / RUN)
        if name not in there and not self.results.finished:
            write_json(self.path / RUN, {**there, name: value})
            if self.record is not None:
                self.record[name] = value
        return there.get(name, value)

    def take_back(self) -> None:
        """Leave no trace of a run that could not begin, so that the next one is not taken for it."""
        for made in (self.path / name for name in self.new):
            if made.is_dir() and not made.is_symlink():
                shutil.rmtree(made)
            else:
                made.unlink(missing_ok=True)

    def resume_hint(self) -> str:
        """How to go on."""
        return f"nothing is lost: repeat the command with --resume to go on (--out {shlex.quote(str(self.path))})"


def inputs_of(source: Path) -> list[Path]:
    """What a run reads: manifest, images and outlines of a data set, or a table of measurements and its masks."""
    if where := dataset_folder(source):
        dataset = read_dataset(where)
        return [dataset.manifest, *(file for image in dataset_images(dataset) for file in image.files)]
    table = table_in(source)
    return files_of(table, read_measurements(table, OF_ANYTHING))


def hashes_of(inputs: Sequence[Path]) -> dict[str, str]:
    """SHA-256 by path below the first one's folder, however that is written; of others by the whole path."""
    base = inputs[0].parent
    return {_below(path, base): sha256_of(path) for path in inputs}


def _below(path: Path, base: Path) -> str:
    whole, of = Path(os.path.abspath(path)), Path(os.path.abspath(base))
    pairs = ((path, base), (whole, of))
    return str(next((one.relative_to(other) for one, other in pairs if one.is_relative_to(other)), whole))


def run_versions() -> dict[str, str]:
    """`versions`, and those of the packages that samplers depend on."""
    return {**versions(), **{name: version(name) for name in PACKAGES}}


@reads_saved("run")
def read_run(file: str | Path) -> dict[str, Any]:
    """Read what `RunFolder.begin` wrote.

    Raises:
        InputError: The file is something else, or damaged.
    """
    found = {"arguments": [], **read_json(file)}
    for name, kind in PARTS.items():
        if not isinstance(found[name], kind):
            raise ValueError(f"{name} is {quoted(found[name])}")
    configuration = {"settings": {}, **found["configuration"]}
    if not isinstance(configuration["settings"], dict):
        raise ValueError(f"settings is {quoted(configuration['settings'])}")
    return {**found, "configuration": configuration}


def differences(
    earlier: Mapping[str, Any], now: Mapping[str, Any], within: str = "", leave_out: Sequence[str] = ()
) -> list[str]:
    """In words, down to single numbers of tables."""
    found = []
    for name in [*now, *(name for name in earlier if name not in now)]:
        if name in leave_out:
            continue
        before, after = earlier.get(name), now.get(name)
        if isinstance(before, dict) and isinstance(after, dict):
            inner = within if name == "settings" else f"{within}{name}: "
            found += differences(before, after, inner, leave_out)
        elif before != after:
            found.append(f"{within}{name} was {_written(before)}, now it is {_written(after)}")
    return found


def _written(value: Any) -> str:
    """A value of a configuration, names without quotation marks."""
    return "none" if value is None else value if isinstance(value, str) else quoted(value)


def _same_place(one: str, other: str | None) -> bool:
    """Whether two paths lead to one place, or no other is given."""
    return other is None or os.path.realpath(one) == os.path.realpath(other)


def _machine() -> dict[str, Any]:
    """The device, and threads of XLA's pool, whose number decides over the rounding of sums."""
    return {"device": jax.devices()[0].device_kind, "threads": xla_threads()}


def other_versions(earlier: Mapping[str, Any]) -> str:
    """In what versions and machine a run differs from this one, in words.

    Arguments:
        earlier: Its run.json.
    """
    now = {**run_versions(), **_machine()}
    before = {
        **earlier["versions"],
        "threads": now["threads"],
        **{name: earlier[name] for name in _machine() if name in earlier},
    }
    other = [f"{name} was {before.get(name)}, is {one}" for name, one in now.items() if before.get(name) != one]
    return "; ".join(other)
