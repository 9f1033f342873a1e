"""Whether a command may write into a folder, as it is now."""

import os
from collections.abc import Sequence
from pathlib import Path

from yeastfit.errors import InputError
from yeastfit.results.contents import MANIFEST, RUN, Contents, changed_files, misplaced_files
from yeastfit.storage import WORK

NAMED = 3  # files in the way that an error names


def check_folder(
    path: Path,
    command: str,
    *,
    reads: Sequence[Path] = (),
    overwrite: bool = False,
    resume: bool | None = None,
    stored: Sequence[str] = (),
) -> Contents:
    """Check that a command may write into a folder, as it is now; for arguments and errors see `results_folder`."""
    try:
        where = os.path.realpath(path)  # unlike `Path.resolve` not raising for an input that links to itself
        inside = [one for one in reads if Path(os.path.realpath(one)).is_relative_to(where)]
        found = Contents.of(path)
        misplaced = misplaced_files(path, found.listed)
        changed = [] if overwrite or resume else changed_files(path, found.listed)
    except (OSError, RuntimeError, ValueError) as error:
        raise unwritable(path, error) from error
    if inside:
        raise InputError(f"--out: {path} holds the data, need another folder for the results")
    if (path / WORK).is_symlink():
        raise InputError(f"--out: {path / WORK} is a link, which yeastfit does not make: remove it")
    if misplaced:
        raise InputError(
            f"--out: {path} holds {listing(misplaced)} in place of a file that yeastfit wrote: move it away, or give "
            "another folder"
        )
    own = found.command == command
    first = own and not (found.finished or found.listed or MANIFEST in found.others)  # the folder was new, or empty
    strange = [name for name in found.others if name not in stored and not name.startswith(".")]
    if first and strange and resume is not False:
        raise InputError(
            f"--out: {path} holds an unfinished run of yeastfit {command} and {listing(strange)}, which yeastfit did "
            "not write: move it away, or give another folder"
        )
    if (own and resume) or not (found.command or found.others):
        return found
    if own and resume is not None and not (overwrite and found.finished):
        state = "a finished run" if found.finished else "a run that was not finished"
        raise InputError(f"--out: {path} holds {state}: give --resume to go on with it, or another folder")
    if not found.command:
        damaged = f"a damaged {RUN}" if resume and RUN in found.others else ""
        what, way = damaged or f"{listing(found.others)}, which yeastfit did not write", ""
    elif found.endless:
        what, way = "results of an earlier version of yeastfit, whose manifest.json lists no files", ""
    elif not own and not found.finished:
        what, way = f"an unfinished run of yeastfit {found.command}", ", or repeat that command"
    elif not own and not overwrite:
        what = f"results of yeastfit {found.command}"
        way = f", or --overwrite to replace its {len(found.listed)} files"
    elif changed:
        what, way = f"{listing(changed)}, changed since yeastfit wrote it", ", or --overwrite to replace it"
    else:
        return found
    raise InputError(f"--out: {path} holds {what}: give another folder{way}")


def unwritable(path: Path, error: Exception) -> InputError:
    """The error of a folder that cannot be made, read or written."""
    return InputError(f"--out: cannot write to {path}: {getattr(error, 'strerror', None) or error}")


def listing(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
