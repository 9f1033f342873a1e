"""What the command line says of an exception: one line, and an exit code.

1    a computation failed
2    what the user gave: arguments, files, permissions, room on the disk, sizes that no memory holds, own code
70   a fault of yeastfit, the traceback in a file
"""

import os
import sys
import sysconfig
import tempfile
import traceback
from pathlib import Path

import typer

from yeastfit.errors import InputError, SimulationError
from yeastfit.text import quoted, short, shown

COMPUTATION, GIVEN, FAULT = 1, 2, 70
REPORT = "yeastfit-error.txt"  # the traceback, beside the results of a run
MANIFEST, RUN = "manifest.json", "run.json"  # of `results.contents`, which imports what failed, perhaps
NO_DEVICE = "Unable to initialize backend"  # jax's words where JAX_PLATFORMS names one that is not there
NO_ROOM = (  # words of an exception of jax where XLA has no memory, and of one where a library cannot be loaded
    "RESOURCE_EXHAUSTED",
    "failed to map segment",
    "cannot allocate memory",
    "Cannot allocate memory",
)
OF_VARIABLES = {  # by words of libraries that refuse a variable's value; jax names it
    "for environment 'JAX_": "",
    "Number of threads specified must be > 0": "NUMBA_NUM_THREADS: ",
}
UsageError = typer.BadParameter.__base__ or Exception  # what typer says of options; it does not export the name


def explained(error: Exception, folder: Path | None) -> tuple[int, str]:
    """Find the exit code of an exception, and what to say of it.

    Arguments:
        error: What ended the command.
        folder: For the results, where the command has one: a fault's traceback is written there if it holds a run, and
            else to the folder for temporary files.

    Returns:
        The code, and one line without a newline.
    """
    if isinstance(error, SimulationError):
        return COMPUTATION, shown(error)
    if isinstance(error, InputError):
        return GIVEN, shown(error)
    if isinstance(error, UsageError):
        return GIVEN, shown(_in_one_line(error.format_message()))  # type: ignore[attr-defined]
    if isinstance(error, OSError):
        return GIVEN, shown(reason(error))
    if isinstance(error, MemoryError) or any(words in str(error) for words in NO_ROOM):
        return GIVEN, shown(f"not enough memory: {_in_one_line(error) or 'give smaller sizes'}")
    if isinstance(error, UnicodeError):
        return GIVEN, shown(f"text that cannot be read or written: {_in_one_line(error)}")
    for words, variable in OF_VARIABLES.items():
        if isinstance(error, ValueError) and words in str(error):
            return GIVEN, shown(variable + _in_one_line(error))
    if NO_DEVICE in str(error) or _without_device():
        named = f"JAX_PLATFORMS is {os.environ.get('JAX_PLATFORMS', '')!r}"
        return GIVEN, shown(f"{named}: JAX has no such device here; unset the variable, or set it to cpu")
    what = f"{type(error).__name__}: {_in_one_line(error)}" if str(error) else type(error).__name__
    if place := _in_own_code(error):
        return GIVEN, shown(f"{place}, in your own code: {short(what)} (more in {_reported(error, folder)})")
    return FAULT, shown(f"a fault of yeastfit, please report it with the file {_reported(error, folder)}: {what}")


def reason(error: OSError) -> str:
    """The system's words in one line, the file first; HDF5's own words are many."""
    what = os.strerror(error.errno) if error.errno else _in_one_line(error)
    if error.filename is None:
        return what
    return f"{error.filename if isinstance(error.filename, str | os.PathLike) else quoted(error.filename)}: {what}"


def _in_own_code(error: Exception) -> str:
    """File and line of a user's own code that an error came from, if by way of a library; empty for ours."""
    ours = str(Path(__file__).parents[2]) + os.sep
    libraries = (sys.prefix, sys.base_prefix, *map(sysconfig.get_path, ("stdlib", "purelib", "platlib")), "<")
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if frame.filename.startswith(ours):
            break
        if not frame.filename.startswith(libraries):
            return f"{Path(frame.filename).name}:{frame.lineno}"
    return ""


def _without_device() -> bool:
    """Whether JAX cannot begin on the devices that the user asked for; it says so by errors of many kinds."""
    if not os.environ.get("JAX_PLATFORMS") or "jax" not in sys.modules:
        return False
    try:
        return not sys.modules["jax"].devices()
    except Exception:
        return True


def _in_one_line(error: object) -> str:
    return " ".join(str(error).split())


def _reported(error: Exception, folder: Path | None) -> str:
    """Write the traceback; the file's name."""
    text = "".join(traceback.format_exception(error))
    report = f"yeastfit {' '.join(map(shown, sys.argv[1:]))}\nPython {sys.version}\n\n{text}"
    try:  # not into a folder without a run, where it would be in the way of one
        if folder is not None and any((folder / name).is_file() for name in (MANIFEST, RUN)):
            (folder / REPORT).write_text(report, encoding="utf-8", errors="backslashreplace")
            return str(folder / REPORT)
    except OSError:
        pass  # then where temporary files go
    try:
        handle, name = tempfile.mkstemp(prefix="yeastfit-error-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(report)
        return name
    except OSError as unwritten:
        return f"(which could not be written: {reason(unwritten)})"
