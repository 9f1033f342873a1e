"""What lies in a folder of results: whose they are, whether they are whole, and what else is there.

manifest.json lists the files of a finished run with their SHA-256. While a run is in the folder, or after a kill,
.yeastfit/owner.json says whose it is and lists the files that it may replace; the run.json of `infer` says whose a run
is that can be resumed. Lists are taken from files that anybody may have written: a name that leads out of the folder
makes the whole list void.
"""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from yeastfit.errors import InputError
from yeastfit.storage import WORK, read_json, sha256_of, written_whole

MANIFEST, RUN, OWNER, LOCK = "manifest.json", "run.json", "owner.json", "lock"
NO_RESULTS = (".DS_Store", "Thumbs.db", "desktop.ini", "yeastfit-error.txt")  # of desktops, and a fault's traceback

GONE, CHANGED = "is gone", "has changed"

Listed = dict[str, tuple[str, ...]]


@dataclass(frozen=True)
class Contents:
    """What lies in a folder.

    Attributes:
        command: Whose results, finished or not; empty where there are none.
        finished: Whether there is a manifest.
        listed: SHA-256 of the files that a list names, by name; two where a run was replacing another.
        others: Names of all other files and folders at the top.
        holder: The process of the last run, in words.
        endless: Whether the manifest lists no files, as those of earlier versions.
    """

    command: str = ""
    finished: bool = False
    listed: Listed = field(default_factory=dict)
    others: tuple[str, ...] = ()
    holder: str = "another process"
    endless: bool = False

    @staticmethod
    def of(path: Path) -> "Contents":
        """Look into a folder, which need not exist."""
        if not path.is_dir():
            return Contents()
        manifest, owner, run = (_record(path / name) for name in (MANIFEST, f"{WORK}/{OWNER}", RUN))
        run = run if run.get("command") == "infer" and "configuration" in run else {}
        manifest = {} if manifest.get("files") == {} else manifest  # no command finishes without results
        listed = (manifest or owner).get("files", {})
        ours = {PurePath(name).parts[0] for name in listed} | {*NO_RESULTS}
        ours |= {name for name, one in ((MANIFEST, manifest), (RUN, run), (WORK, owner)) if one}
        ours |= {WORK} if _only_begun(path / WORK) else set()
        return Contents(
            next((one["command"] for one in (manifest, owner, run) if one), ""),
            bool(manifest),
            {name: (known,) if isinstance(known, str) else tuple(known) for name, known in listed.items()},
            tuple(sorted({one.name for one in path.iterdir()} - ours)),
            f"process {owner['pid']} on {owner['host']}" if {"pid", "host"} <= set(owner) else Contents.holder,
            bool(manifest) and "files" not in manifest,
        )


def check_finished(folder: Path) -> None:
    """Check that a folder to read from does not hold half a result.

    Arguments:
        folder: With results of a command, or any other.

    Raises:
        InputError: A command that writes there has not finished, or its manifest is damaged.
    """
    found = Contents.of(folder)
    if found.command and not found.finished:
        how = " with --resume" if found.command == "infer" else ""
        if (folder / MANIFEST).is_file():
            raise InputError(
                f"{folder / MANIFEST} is damaged: restore it, or repeat yeastfit {found.command} into another folder"
            )
        raise InputError(
            f"{folder} holds an unfinished run of yeastfit {found.command}: wait for it, or repeat the command{how}"
        )


def check_unchanged(folder: Path, names: Sequence[str]) -> None:
    """Check that files of a finished run are those that it wrote, neither damaged nor another run's.

    Arguments:
        folder: Of the run.
        names: Of files in it; those that its manifest does not list are not looked at.

    Raises:
        InputError: A listed file is gone, or its SHA-256 is not the listed one.
    """
    listed = {name: known for name, known in Contents.of(folder).listed.items() if name in names}
    for name, what in not_as_written(folder, listed).items():
        since = "" if what == GONE else " since yeastfit wrote it"
        raise InputError(f"{folder / name}: {what}{since}, need the file whose SHA-256 {MANIFEST} lists")


def not_as_written(folder: Path, listed: Listed) -> dict[str, str]:
    """Find listed files that are gone or have changed.

    Arguments:
        folder: Of the files.
        listed: SHA-256 by name, any of which is right.

    Returns:
        `GONE` or `CHANGED` by name, those that are gone first.
    """
    gone = [name for name in listed if not (folder / name).exists()]
    changed = [name for name in changed_files(folder, listed) if name not in gone]
    return {**dict.fromkeys(gone, GONE), **dict.fromkeys(changed, CHANGED)}


def check_own(folder: Path, names: Sequence[str]) -> None:
    """Check that files which a run goes on writing are its own alone; a hard link gets a copy in its place.

    Arguments:
        folder: Of the run.
        names: Of files and folders in it, which need not be there.

    Raises:
        InputError: One is a link.
    """
    for place in (folder / name for name in names):
        if place.is_symlink():
            raise InputError(f"--out: {place} is a link, which yeastfit does not make: put the file itself there")
        if place.is_file() and place.stat().st_nlink > 1:
            with written_whole(place) as copy:
                shutil.copy2(place, copy)


def misplaced_files(folder: Path, listed: Listed) -> list[str]:
    """Find listed files in whose places there are folders, or which lie behind links.

    Arguments:
        folder: Of the files.
        listed: By name.

    Returns:
        Their names.
    """

    def misplaced(name: str) -> bool:
        file, parents = folder / name, PurePath(name).parents[:-1]
        return (file.is_dir() and not file.is_symlink()) or any((folder / one).is_symlink() for one in parents)

    return [name for name in listed if misplaced(name)]


def changed_files(folder: Path, listed: Listed) -> list[str]:
    """Find listed files that are there with other bytes, as links, or not in their places.

    Arguments:
        folder: Of the files.
        listed: SHA-256 by name, any of which is right.

    Returns:
        Their names.
    """
    misplaced = misplaced_files(folder, listed)

    def changed(file: Path, known: Sequence[str]) -> bool:
        return file.is_symlink() or not file.is_file() or sha256_of(file) not in known

    there = {name: known for name, known in listed.items() if os.path.lexists(folder / name)}
    return [name for name, known in there.items() if name in misplaced or changed(folder / name, known)]


def _record(file: Path) -> dict[str, Any]:
    """A manifest, owner.json or run.json; empty where the file is something else, a pipe for instance."""
    try:
        found = read_json(file) if file.is_file() else {}
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict) or not isinstance(found.get("command"), str) or not found["command"]:
        return {}
    files = found.get("files", {})
    return found if isinstance(files, dict) and all(_is_listing(*pair) for pair in files.items()) else {}


def _is_listing(name: str, known: Any) -> bool:
    """Whether this is the name of a file below the folder, with one SHA-256 or some."""
    path = PurePath(name)
    try:
        os.fsencode(path)
    except UnicodeError:
        return False
    below = path.parts and not path.anchor and "\0" not in name and not {"..", WORK} & set(path.parts)
    return bool(below) and all(isinstance(one, str) for one in (known if isinstance(known, list) else [known]))


def _only_begun(work: Path) -> bool:
    """Whether a run was killed before it wrote owner.json."""
    return work.is_dir() and all(one.name == LOCK or one.name.startswith(".owner-") for one in work.iterdir())
