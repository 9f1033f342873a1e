"""Files: tables and JSON, each written whole or not at all."""

import csv
import errno
import functools
import hashlib
import json
import math
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from yeastfit.errors import InputError
from yeastfit.text import short, shown

PACKAGES = ("yeastfit", "jax", "equinox", "optimistix", "numpy", "scipy", "scikit-image", "matplotlib", "tifffile")
NOT_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
MARK = "'"  # before a text such as NaN, the name of a condition, say
LARGEST = 10**11  # bytes of a file that is hashed: a minute or two
WORK = ".yeastfit"  # folder inside that of a run's results, for what is on its way (`results.folder`)
Options = ParamSpec("Options")
Saved = TypeVar("Saved")
BOOKKEEPING = 1 << 21  # bytes: a chunk of every dataset fits in


def versions() -> dict[str, str]:
    """Look up the versions of Python and of the packages that results depend on.

    Returns:
        Versions by name.
    """
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


@contextmanager
def full_disks_told() -> Iterator[None]:
    """Raise the system's errors as `OSError`, which HDF5 turns into RuntimeError while it closes a file.

    Raises:
        OSError: The disk is full, for instance.
    """
    try:
        yield
    except RuntimeError as error:
        number, name = (re.search(part, str(error), re.DOTALL) for part in (r"errno = (\d+)", r"filename = '(.*?)'"))
        if not number:
            raise
        where = [name[1]] if name else []  # not where HDF5 could only not make the file as long as it should be
        raise OSError(int(number[1]), os.strerror(int(number[1])), *where) from error


def check_room(path: Path, size: int = 0) -> None:
    """Check that an HDF5 file may grow. HDF5 may crash the process once a write has failed, so that it must not begin.

    Arguments:
        path: The file.
        size: Bytes to be added; room for HDF5's bookkeeping is asked for as well.

    Raises:
        OSError: The disk has less room.
    """
    if shutil.disk_usage(path.parent).free < size + BOOKKEEPING:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Write a file whole or not at all.

    Arguments:
        path: The file; folders on the way are made.

    Yields:
        A temporary path, which takes its name where all goes well and is removed otherwise. It is beside the file or,
        where a run is in the folder, in `WORK`, which the next one clears after a kill.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: this is a folder, give the name of a file in it")
    path.parent.mkdir(parents=True, exist_ok=True)
    room = path.parent / WORK
    room = room if room.is_dir() else path.parent
    handle, name = tempfile.mkstemp(dir=room, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        if error.errno is not None and error.filename in (None, name):
            error.filename = path  # a full disk names no file
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def hdf5_written_whole(path: str | Path) -> Iterator[BytesIO]:
    """Write an HDF5 file whole or not at all, by way of memory: HDF5 may not survive a full disk.

    Arguments:
        path: The file.

    Yields:
        A file in memory.
    """
    image = BytesIO()
    yield image
    with written_whole(path) as temporary:
        temporary.write_bytes(image.getvalue())


def write_table(path: str | Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write a CSV file in UTF-8 with one header and one line for each row; see `yeastfit.text.shown` for its text.

    Arguments:
        path: The file.
        rows: Values by column; all rows have the columns of the first.
    """
    with written_whole(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {key: shown(cell) if isinstance(cell, str) else cell for key, cell in row.items()} for row in rows
        )


def as_json(data: Any, indent: int | None = None) -> str:
    """Write data as JSON, with all digits.

    JSON has no numbers that are not finite. They become the strings "NaN", "Infinity" and "-Infinity", as in the JSON
    of protocol buffers, and `from_json` makes numbers of them again; None is null.

    Arguments:
        data: Dictionaries, sequences, arrays, numbers, strings and None, within each other.
        indent: Spaces to indent by; by default all is in one line.

    Returns:
        Text that any reader of JSON takes.
    """
    return json.dumps(_plain(data), indent=indent, allow_nan=False)


def from_json(text: str) -> Any:
    """Read what `as_json` wrote, numbers that are not finite included; arrays are lists."""
    return _restored(json.loads(text))


def write_json(path: str | Path, data: Any) -> None:
    """Write data as a JSON file, whole or not at all; see `as_json`."""
    with written_whole(path) as temporary:
        temporary.write_text(as_json(data, indent=2) + "\n")


def read_json(path: str | Path) -> Any:
    """Read what `write_json` wrote; see `from_json`."""
    return from_json(Path(path).read_text())


def reads_saved(
    what: str,
) -> Callable[[Callable[Concatenate[str | Path, Options], Saved]], Callable[Concatenate[str | Path, Options], Saved]]:
    """Let a function that reads a file of results refuse whatever is none: damaged, of another kind or version.

    Arguments:
        what: The file holds, as in "fit".

    Returns:
        A decorator. Whatever the function raises becomes an `InputError` that names the file, unless memory is short.
    """

    def decorated(
        load: Callable[Concatenate[str | Path, Options], Saved],
    ) -> Callable[Concatenate[str | Path, Options], Saved]:
        @functools.wraps(load)
        def checked(path: str | Path, *options: Options.args, **named: Options.kwargs) -> Saved:
            if Path(path).exists() and not Path(path).is_file():  # a pipe would be waited for
                raise InputError(f"{path}: this is no file, need one with a {what}")
            try:
                return load(path, *options, **named)
            except MemoryError:
                raise
            except InputError as error:
                if str(error).startswith(str(path)):
                    raise
                raise InputError(f"{path}: {error}") from None
            except Exception as error:  # what a damaged file comes to, nobody knows
                if not Path(path).exists():
                    raise InputError(f"{path}: there is no such file") from None
                raise InputError(f"{path}: this is no {what} that was saved whole ({_why(error)})") from error

        return checked

    return decorated


def _why(error: Exception) -> str:
    """What is wrong with the content of a file, without Python's words."""
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)
    if isinstance(error, KeyError) and error.args:
        return f"missing entry {short(error.args[0])}"
    if isinstance(error, TypeError | AttributeError | IndexError | KeyError):
        return "an entry is of another kind or size"
    if isinstance(error, RecursionError):
        return "entries within entries, too many"
    return short(error) or "damaged"


def can_be_hashed(path: Path) -> bool:
    """Whether it is a file of a size to read: a pipe would be waited for, and a device has no end."""
    return path.is_file() and path.stat().st_size <= LARGEST


def sha256_of(path: str | Path) -> str:
    """Compute the SHA-256 of a file's bytes, in hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _plain(data: Any) -> Any:
    """What the `json` module can write."""
    if isinstance(data, dict):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if hasattr(data, "__array__"):  # of NumPy or of JAX
        return _plain(np.asarray(data).tolist())
    if isinstance(data, float) and not math.isfinite(data):
        return "NaN" if math.isnan(data) else "Infinity" if data > 0 else "-Infinity"
    return MARK + data if _like_a_number(data) else data


def _restored(data: Any) -> Any:
    """Numbers in the place of the strings that `_plain` wrote for them."""
    if isinstance(data, dict):
        return {key: _restored(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_restored(value) for value in data]
    if _like_a_number(data):
        return NOT_FINITE.get(data, data[1:])
    return data


def _like_a_number(data: Any) -> bool:
    """Whether it is a text that `_plain` writes for a number, or one that is marked as none."""
    return isinstance(data, str) and data.lstrip(MARK) in NOT_FINITE
