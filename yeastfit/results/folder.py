"""The folder of a command's results: one owner, one run at a time, whole results or none.

    OUT/manifest.json    what made the results, and the SHA-256 of each of their files
    OUT/…                the results
    OUT/.yeastfit/       while a run is in the folder: its lock, owner.json, results/, what it has made so far, and
                         unfinished/, what the same command goes on with after a kill

Results take their places when all of them are ready: the manifest of an earlier run is moved aside, then its files,
then the new files are renamed into place, the manifest last; where the system refuses one of these, all go back. Before
that owner.json lists the files of both, so that a run after a kill knows which are the package's. A folder with
owner.json, or with the run.json of `infer`, is unfinished until it has a manifest. A file that no list names, or whose
bytes are others than those listed, is never touched.
"""

import os
import shutil
import socket
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from filelock import FileLock, Timeout

from yeastfit.errors import InputError
from yeastfit.processors import device_used
from yeastfit.results.check import check_folder, listing, unwritable
from yeastfit.results.contents import (
    LOCK,
    MANIFEST,
    OWNER,
    Contents,
    Listed,
    changed_files,
    misplaced_files,
    not_as_written,
)
from yeastfit.results.exchange import exchange, remove_empty
from yeastfit.storage import WORK, can_be_hashed, check_room, read_json, sha256_of, versions, write_json

RESULTS, EARLIER, UNFINISHED = "results", "earlier", "unfinished"
KEPT = "sha256.json"  # of the files of a folder that a run keeps
GONE, CHANGED = "gone when the command ended", "changed while the command ran"
UNREAD = "no regular file, or too large to read"
PATIENCE = 0.5  # seconds: a run that is just ending lets go of its lock


@dataclass
class ResultsFolder:
    """A folder that a run has for itself.

    Attributes:
        path: The folder.
        command: Which writes into it.
        finished: Whether it has a manifest.
        earlier: SHA-256 of the files of earlier runs, by name.
        overwrite: Whether earlier files may go that were changed since.
        endless: Whether the manifest lists no files.
        reads: SHA-256 of files that the run reads, when it began, by absolute path.
    """

    path: Path
    command: str
    finished: bool
    earlier: Listed
    overwrite: bool = False
    endless: bool = False
    reads: dict[str, str] = field(default_factory=dict)
    _stays: bool = field(default=False, init=False)

    @property
    def partial(self) -> Path:
        """Where results are written until all are ready."""
        return self.path / WORK / RESULTS

    @property
    def unfinished(self) -> Path:
        """A folder for what the same command goes on with after it was broken off; removed by the command."""
        return self.path / WORK / UNFINISHED

    def finish(
        self, *, inputs: Sequence[str | Path], seed: int | None = None, kept: Iterable[str] = (), **more: Any
    ) -> list[str]:
        """Put the results into their places and write manifest.json, both instead of those of an earlier run.

        Arguments:
            inputs: Files that were read.
            seed: Of the random numbers; None where the command draws none.
            kept: Files and folders of the run that lie in their places already.
            more: Anything else that belongs to the record.

        Returns:
            Warnings of inputs that are no longer what they were when the run began.

        Raises:
            InputError: A file that the package did not write is in the way.
            OSError: A file cannot be moved; earlier results are as they were.
        """
        if not (self.path / WORK / OWNER).is_file():
            raise InputError(f"--out: {self.path} was removed or emptied while the command ran: repeat it")
        new = _hashes(self.partial)
        staying = {name: one for part in kept for name, one in _hashes(self.path, part).items()}
        manifest = {
            "command": self.command,
            "arguments": sys.argv[1:],
            **({} if seed is None else {"seed": seed}),
            "versions": versions(),
            **device_used(),
            "inputs": {str(path): self._hash_of_input(path) for path in inputs},
            **more,
            "files": dict(sorted({**staying, **new}.items())),
        }
        write_json(self.partial / MANIFEST, manifest)
        replaced = {name: known for name, known in self.earlier.items() if name not in staying}
        if in_the_way := self._in_the_way(new, replaced):
            self._stays = True
            raise InputError(
                f"--out: {listing(in_the_way)} in {self.path} came or changed while the command ran, or before it: "
                f"move it away and repeat the command; until then its results are in {self.partial}"
            )
        both = {name: (*replaced.get(name, ()), *([new[name]] if name in new else [])) for name in {**replaced, **new}}
        self._own(both)
        aside = self.path / WORK / EARLIER
        exchange(self.path, [MANIFEST, *replaced], [*new, MANIFEST], made=self.partial, aside=aside)
        self.finished = True
        return [f"{path} {what}" for path, what in manifest["inputs"].items() if what in (GONE, CHANGED)]

    def keep(self, name: str) -> Path:
        """Put a folder into its place before the end, for a run that may be resumed; return its place."""
        if os.path.lexists(self.path / name):
            raise InputError(f"--out: {self.path / name} is in the way of such a file: move it away")
        write_json(self.partial / name / KEPT, _hashes(self.partial / name))
        return (self.partial / name).rename(self.path / name)

    def check_kept(self, name: str) -> None:
        """Raise `InputError` where files of a folder are others than `keep` put there; those without a list are not."""
        place = self.path / name
        listed = read_json(place / KEPT) if (place / KEPT).is_file() else {}
        for one, what in not_as_written(place, {one: (known,) for one, known in listed.items()}).items():
            raise InputError(
                f"--resume: {place / one} {what} since the run wrote it: put it back, or give another folder"
            )

    def check_as_written(self) -> None:
        """Raise `InputError` where files of a finished run are no longer those that it wrote."""
        if changed := changed_files(self.path, self.earlier):
            raise InputError(
                f"--resume: {listing(changed)} in {self.path} changed since the run wrote it: put it back, or remove "
                "it to have it made again"
            )

    def reopen(self, kept: Iterable[str]) -> None:
        """Take the manifest away, so that a finished run is unfinished and may go on.

        Arguments:
            kept: Files and folders of the run that it goes on with; the others are replaced when it finishes.

        Raises:
            InputError: The manifest lists no files.
        """
        if self.endless:
            raise InputError(f"--resume: {self.path} is of an earlier version, its run cannot go on")
        staying = {name for part in kept for name in _hashes(self.path, part)}
        self._own({name: known for name, known in self.earlier.items() if name not in staying})
        self._unfinish()

    def clear(self) -> None:
        """Remove the files of earlier runs at once."""
        self._unfinish()
        self._remove(self.earlier)
        self._own({})

    def close(self) -> None:
        """Leave nothing behind but results, and what says that they are unfinished."""
        if not self._stays:
            _clear_work(self.path / WORK)
            if self.finished or not (self.earlier or self.unfinished.exists()):
                (self.path / WORK / OWNER).unlink(missing_ok=True)

    def _hash_of_input(self, path: str | Path) -> str:
        """SHA-256, or what became of the file while the command ran."""
        if not os.path.lexists(path):
            return GONE
        if not can_be_hashed(Path(path)):
            return UNREAD
        now = sha256_of(path)
        return now if self.reads.get(os.path.abspath(path), now) == now else CHANGED

    def _own(self, files: Listed) -> None:
        self.earlier = files
        process = {"pid": os.getpid(), "host": socket.gethostname(), "arguments": sys.argv[1:]}
        write_json(self.path / WORK / OWNER, {"command": self.command, **process, "files": files})

    def _unfinish(self) -> None:
        (self.path / MANIFEST).unlink(missing_ok=True)
        self.finished = False

    def _in_the_way(self, new: Iterable[str], replaced: Listed) -> list[str]:
        """Names of files that are not the package's where new ones would go, and of earlier ones that have changed."""
        places = {place for name in new for place in (name, *map(str, PurePath(name).parents[:-1]))}
        taken = {
            place
            for place in places
            if os.path.lexists(self.path / place)
            and place not in replaced
            and (place in new or (self.path / place).is_symlink() or not (self.path / place).is_dir())
        }
        return sorted(taken.union((misplaced_files if self.overwrite else changed_files)(self.path, replaced)))

    def _remove(self, names: Iterable[str]) -> None:
        """Remove files, and the folders that are empty then."""
        gone = [name for name in names if os.path.lexists(self.path / name)]
        for name in gone:
            (self.path / name).unlink()
        remove_empty(self.path, gone)


@contextmanager
def results_folder(
    path: str | Path,
    command: str,
    *,
    reads: Sequence[Path] = (),
    overwrite: bool = False,
    resume: bool | None = None,
    stored: Sequence[str] = (),
) -> Iterator[ResultsFolder]:
    """Open a folder for the results of one run; nothing appears in it before `ResultsFolder.finish`.

    Arguments:
        path: The folder, made where it is missing.
        command: Which writes into it.
        reads: Files that the run reads.
        overwrite: Whether results of another command may be replaced, and results that were changed since.
        resume: Whether the run that is there goes on; None for a command that always begins anew.
        stored: Names of files and folders that such a run has in its folder before it is finished.

    Yields:
        The folder, locked.

    Raises:
        InputError: The folder cannot be made or written, holds something else, or another run is in it.
    """
    path, work = Path(path), Path(path) / WORK
    lock = FileLock(work / LOCK)
    try:
        check_folder(path, command, reads=reads, overwrite=overwrite, resume=resume, stored=stored)
    except InputError:  # what another run has made so far is in no command's way: it is in use
        if _held(lock):
            raise _in_use(path) from None
        raise
    made = [one for one in (path, *path.parents) if not os.path.lexists(one)]
    try:
        work.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=PATIENCE)
        found = check_folder(path, command, reads=reads, overwrite=overwrite, resume=resume, stored=stored)
        check_room(work / OWNER)
        _clear_work(work)
        begun = _hashes_of_inputs(reads)
        folder = ResultsFolder(path, command, found.finished, found.listed, overwrite, found.endless, begun)
        folder._own(found.listed)
        folder.partial.mkdir()
    except Timeout:
        raise _in_use(path) from None
    except OSError as error:
        _let_go(lock, made)
        raise unwritable(path, error) from error
    except BaseException:  # an interruption as well: the process may go on, as that of a notebook does
        _let_go(lock, made)
        raise
    try:
        yield folder
    finally:
        try:
            folder.close()
            _let_go(lock, made)
        except KeyboardInterrupt:  # of a signal that came meanwhile; there is only one
            folder.close()
            _let_go(lock, made)
            raise


def check_at_rest(path: Path) -> None:
    """Check that no run is in a folder, finished or not.

    Raises:
        InputError: One is.
    """
    if _held(FileLock(path / WORK / LOCK)):
        raise InputError(f"{path} is in use: {Contents.of(path).holder} writes there, wait for it")


def _held(lock: FileLock) -> bool:
    """Whether another process holds the lock."""
    file = Path(lock.lock_file)
    if file.is_symlink() or not file.is_file():
        return False
    try:
        with lock.acquire(timeout=0):
            return False
    except Timeout:
        return True
    except OSError:  # a place without locks, or none of ours to write
        return False


def _in_use(path: Path) -> InputError:
    return InputError(f"--out: {path} is in use: {Contents.of(path).holder} writes there")


def _hashes_of_inputs(reads: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of those that can be read, by absolute path."""
    hashes = {}
    for one in reads:
        with suppress(OSError):  # which the command says
            if can_be_hashed(one):
                hashes[os.path.abspath(one)] = sha256_of(one)
    return hashes


def _hashes(folder: Path, part: str = "") -> dict[str, str]:
    """SHA-256 of all files in a folder, or of one part of it, by their names below the folder."""
    inside = folder / part
    found = [inside] if inside.is_file() else [one for one in inside.rglob("*") if not one.is_dir()]
    return {one.relative_to(folder).as_posix(): sha256_of(one) for one in sorted(found)}


def _clear_work(work: Path) -> None:
    """Remove what a run has made so far: results, and temporary files, whose names begin with a dot."""
    for one in work.iterdir():
        if one.name in (RESULTS, EARLIER) and one.is_dir() and not one.is_symlink():
            shutil.rmtree(one, ignore_errors=True)  # where a process that ends still writes, the next run clears it
        elif one.name in (RESULTS, EARLIER) or (one.name.startswith(".") and one.is_file()):
            one.unlink()


def _let_go(lock: FileLock, made: Sequence[Path]) -> None:
    """Remove the lock with its folder, and the folders that were made, where they are empty."""
    file = Path(lock.lock_file)
    if lock.is_locked:
        with suppress(PermissionError):  # Windows removes no open file
            file.unlink(missing_ok=True)
    lock.release()
    for one in (file.parent, *made):
        with suppress(OSError):
            one.rmdir()
