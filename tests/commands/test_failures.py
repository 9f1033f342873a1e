"""Whatever is raised in a command is one line and an exit code."""

import errno
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from yeastfit.commands import app as cli
from yeastfit.commands.console import failures
from yeastfit.commands.console.failures import REPORT, UsageError
from yeastfit.errors import InputError, PixelSizeError, SimulationError

HUGE = "RESOURCE_EXHAUSTED: Out of memory allocating\n 8589934592 bytes."
TOLD = {
    "input": (InputError("hours is 1_0"), 2, "hours is 1_0"),
    "pixel size": (PixelSizeError("a.png: no pixel size"), 2, "a.png: no pixel size"),
    "control characters": (InputError("a\nb\x1b[31m"), 2, r"a\nb\x1b[31m"),
    "computation": (SimulationError("nothing came of it"), 1, "nothing came of it"),
    "usage": (UsageError("--time\n\nis unknown"), 2, "--time is unknown"),
    "missing": (FileNotFoundError(errno.ENOENT, "x", "here.csv"), 2, "here.csv: No such file or directory"),
    "permission": (PermissionError(errno.EACCES, "x", Path("here")), 2, "here: Permission denied"),
    "directory": (IsADirectoryError(errno.EISDIR, "x", "here"), 2, "here: Is a directory"),
    "long name": (OSError(errno.ENAMETOOLONG, "x", "y" * 10), 2, "yyyyyyyyyy: File name too long"),
    "full disk": (OSError(errno.ENOSPC, "x", "here.h5"), 2, "here.h5: No space left on device"),
    "full output": (OSError(errno.ENOSPC, "x"), 2, "standard output: No space left on device"),
    "hdf5": (OSError("Unable to\n open file"), 2, "Unable to open file"),
    "name of bytes": (FileNotFoundError(errno.ENOENT, "x", "caf\udce9"), 2, r"caf\xe9: No such file or directory"),
    "memory": (MemoryError("Unable to allocate 7.81 EiB"), 2, "not enough memory: Unable to allocate 7.81 EiB"),
    "no words": (MemoryError(), 2, "not enough memory: give smaller sizes"),
    "memory of XLA": (jax.errors.JaxRuntimeError(HUGE), 2, f"not enough memory: {' '.join(HUGE.split())}"),
    "memory for a library": (
        ImportError("libjax_common.so: failed to map segment from shared object"),
        2,
        "not enough memory: libjax_common.so: failed to map segment from shared object",
    ),
    "name": (UnicodeEncodeError("utf-8", "\udce9", 0, 1, "surrogates"), 2, "text that cannot be read or written: "),
}


@pytest.mark.parametrize("case", TOLD)
def test_an_exception_is_one_line_and_an_exit_code(
    case: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error, code, words = TOLD[case]
    assert raised(error, monkeypatch) == code
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    assert line == f"error: {words}" or (words.endswith(": ") and line.startswith(f"error: {words}"))
    assert not output.out


IMPORTED = """
import warnings
from yeastfit.__main__ import _in_one_line
warnings.showwarning = _in_one_line
import yeastfit.compiled
"""


def simulated(out: Path, variable: str, value: str) -> subprocess.CompletedProcess[str]:
    """`yeastfit simulate` of one small colony, with an environment variable."""
    small = ("--members", "1", "--time", "1", "--domain", "6", "--spacing", "0.2", "--capacity", "4")
    return subprocess.run(
        [sys.executable, "-m", "yeastfit", "simulate", *small, "--out", str(out)],
        env={**os.environ, variable: value},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("JAX_PLATFORMS", "cuda", "error: JAX_PLATFORMS is 'cuda': JAX has no such device here"),
        ("JAX_PLATFORMS", "cpu,none", "error: JAX_PLATFORMS is 'cpu,none': JAX has no such device here"),
        ("JAX_PLATFORMS", "none", "error: JAX_PLATFORMS is 'none': JAX has no such device here"),
        ("JAX_ENABLE_X64", "maybe", "error: invalid truth value 'maybe' for environment 'JAX_ENABLE_X64'"),
    ],
)
def test_a_variable_that_a_library_refuses_is_named(variable: str, value: str, words: str, tmp_path: Path) -> None:
    if value == "cuda" and jax.devices()[0].platform != "cpu":
        pytest.skip("there is such a device")
    ran = simulated(tmp_path / "out", variable, value)
    assert ran.returncode == 2
    (line,) = ran.stderr.splitlines()
    assert line.startswith(words)


@pytest.mark.thorough
def test_a_terminal_without_columns_is_none(tmp_path: Path) -> None:
    """Nothing would be printed in it, warnings included."""
    assert "Results in" in simulated(tmp_path / "out", "COLUMNS", "0").stdout


@pytest.mark.thorough
def test_where_a_notebook_would_draw_is_of_no_account(tmp_path: Path) -> None:
    assert simulated(tmp_path / "out", "MPLBACKEND", "odd").returncode == 0
    assert (tmp_path / "out" / "index.html").is_file()


def test_a_variable_that_numba_cannot_read_is_one_line() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", IMPORTED],
        env={**os.environ, "NUMBA_NUM_THREADS": "many"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stderr == (
        "warning: Environment variable 'NUMBA_NUM_THREADS' is defined but its associated value 'many' could not be "
        "parsed.\n"
    )


def test_nobody_is_told_that_nobody_reads(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert raised(BrokenPipeError(errno.EPIPE, "x"), monkeypatch) == 141
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("run", ["", "manifest.json", "run.json"])
def test_a_fault_leaves_its_traceback(
    run: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "out").mkdir()
    if run:
        (tmp_path / "out" / run).write_text("{}")
    assert raised(KeyError("a\nb"), monkeypatch, tmp_path / "out") == 70
    (line,) = capsys.readouterr().err.splitlines()
    (report,) = tmp_path.glob(f"out/{REPORT}" if run else "yeastfit-error-*.txt")
    assert line.startswith(f"error: a fault of yeastfit, please report it with the file {report}: KeyError: ")
    text = report.read_text()
    assert "Traceback (most recent call last)" in text
    assert "in fails" in text
    assert sys.version in text


def test_an_error_in_the_users_own_code_is_told_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What it called inside a library included."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def own(*arguments: object) -> None:
        np.linalg.inv(np.ones((2, 3)))

    monkeypatch.setattr("yeastfit.commands.synthesize.read_recipes", own)
    assert cli.run(["synthesize", "--recipe", "one.toml", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    (report,) = tmp_path.glob("yeastfit-error-*.txt")
    place = f"test_failures.py:{own.__code__.co_firstlineno + 1}"
    assert line.startswith(f"error: {place}, in your own code: LinAlgError: Last 2 dimensions")
    assert line.endswith(f"(more in {report})")
    assert "Traceback (most recent call last)" in report.read_text()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize("buffered", ["", "1"])
def test_a_full_output_is_one_line(buffered: str) -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": buffered}
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "yeastfit", "--version"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (2, "error: standard output: No space left on device\n")


@pytest.mark.parametrize(
    ("closed", "command", "code", "stdout", "stderr"),
    [
        (">&-", "--version", 0, "", ""),
        ("2>&-", "--version", 0, "yeastfit", ""),
        (">&- 2>&- <&-", "--version", 0, "", ""),
        ("2>&-", "nothing", 2, "", ""),
        (">&-", "nothing", 2, "", "error: No such command 'nothing'"),
    ],
)
def test_closed_streams_take_nothing(closed: str, command: str, code: int, stdout: str, stderr: str) -> None:
    """What one stream does not take does not go to the other, nor into the next file that is opened."""
    line = f"{sys.executable} -m yeastfit {command} {closed}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert done.stdout.startswith(stdout) if stdout else done.stdout == ""
    assert done.stderr.startswith(stderr) if stderr else done.stderr == ""


def test_a_closed_pipe_is_quiet() -> None:
    command = f"{sys.executable} -m yeastfit --help | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout in ("141\n", "0\n")  # 0 where all was written before the pipe was closed


def raised(error: Exception, monkeypatch: pytest.MonkeyPatch, folder: Path = Path("nowhere")) -> int:
    """The exit code of a command that raises."""

    names: dict[str, Any] = {"error": error}
    place = str(Path(failures.__file__).with_name("synthesize.py"))  # a line of ours, not of the user's own code
    exec(compile("def fails(*arguments):\n    raise error", place, "exec"), names)
    monkeypatch.setattr("yeastfit.commands.synthesize.read_recipes", names["fails"])
    return cli.run(["synthesize", "--recipe", "one.toml", "--out", str(folder)])
