"""Ctrl-C and SIGTERM are answered within two seconds, with one line, whatever the process is doing."""

import os
import signal
import subprocess
import sys
import time

import pytest

from yeastfit.commands import app as cli
from yeastfit.commands.console import signals

BEGIN = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores Ctrl-C
"""
IMPORTING = """
class Slow:
    def find_spec(self, name, *others):
        if name == "yeastfit.commands.simulate":
            import time
            print("here", flush=True)
            time.sleep(60)
sys.meta_path.insert(0, Slow())
from yeastfit.__main__ import main
sys.argv = ["yeastfit", "simulate", "--out", "nowhere"]
main()
"""
QUICKLY = IMPORTING.replace("time.sleep(60)", "time.sleep(0.4); sys.stderr.write('imported, '); sys.stderr.flush()")
ANSWERING = """
import hashlib, time
from yeastfit.commands.console import signals
with signals.answered_signals():
    try:
        {}
    except KeyboardInterrupt:
        sys.exit(signals.current.tell())
"""
INTERPRETED = ANSWERING.format("print('here', flush=True); time.sleep(60)")
# as in a compiled program of XLA, the lock is released and Python's handlers do not run
COMPILED = ANSWERING.format("print('here', flush=True); hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)")
SWALLOWED = """
def deaf():
    while True:
        try:
            time.sleep(60)
        except BaseException:
            pass
""" + ANSWERING.format("print('here', flush=True); deaf()")
# an exception in a callback of the garbage collector is reported and ignored
IGNORED = """
import gc
def collected(phase, info):
    gc.callbacks.clear()
    print("here", flush=True)
    time.sleep(60)
def collect():
    gc.callbacks.append(collected)
    gc.collect()
    time.sleep(60)
""" + ANSWERING.format("collect()")
# Cython prints the exception of a function that cannot raise, and goes on
PRINTED = """
from scipy.stats import qmc
def opened(event, arguments):
    if event == "open" and "_sobol_direction" in str(arguments[0]):
        print("here", flush=True)
        time.sleep(60)
def draw():
    sys.addaudithook(opened)
    qmc.Sobol(d=2, seed=0).random(4)
    time.sleep(60)
""" + ANSWERING.format("draw()")
STUCK_AT_ITS_END = "import atexit, time; atexit.register(time.sleep, 60)\n" + INTERPRETED


def ended(program: str, *numbers: int) -> tuple[int, str, float]:
    """Exit code and errors of a program that got signals, and how many seconds after the first it ended."""
    command = [sys.executable, "-c", BEGIN + program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "here\n"
        time.sleep(0.05)
        began = time.monotonic()
        for number in numbers:
            os.kill(process.pid, number)
            time.sleep(0.1)
        _, errors = process.communicate(timeout=30)
        return process.returncode, errors, time.monotonic() - began


@pytest.mark.parametrize(
    "program", ["IMPORTING", "INTERPRETED", "COMPILED", "SWALLOWED", "IGNORED", "PRINTED", "STUCK_AT_ITS_END"]
)
@pytest.mark.parametrize("number", signals.ANSWERED)
def test_a_signal_ends_the_process_with_one_line(program: str, number: int) -> None:
    code, errors, seconds = ended(globals()[program], number)
    assert code == 128 + number
    assert errors == "interrupted: a folder of results is whole only with its manifest.json\n"
    assert seconds < 2.5  # two, and what a busy machine adds


def test_a_second_signal_ends_the_process_at_once() -> None:
    code, errors, seconds = ended(SWALLOWED, signal.SIGINT, signal.SIGINT)
    assert code == 130
    assert errors.count("\n") == 1
    assert seconds < 1.5


def test_an_import_is_not_broken_off() -> None:
    """Compiled modules crash of an exception that comes while they begin."""
    code, errors, seconds = ended(QUICKLY, signal.SIGINT)
    assert code == 130
    assert errors == "imported, interrupted: a folder of results is whole only with its manifest.json\n"
    assert seconds < 2.5


def test_a_process_that_is_done_may_take_its_time_to_end() -> None:
    program = "import atexit, sys, time; atexit.register(time.sleep, 1.5); print('here', flush=True)" + ANSWERING
    assert ended(program.format("pass"))[:2] == (0, "")


def test_ignored_signals_stay_ignored() -> None:
    program = "signal.signal(signal.SIGINT, signal.SIG_IGN)\n" + INTERPRETED.replace("sleep(60)", "sleep(0.5)")
    assert ended(program, signal.SIGINT)[:2] == (0, "")


def test_the_line_says_what_remains(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(*arguments: object, **options: object) -> None:
        with signals.remaining("nothing is lost"):
            raise KeyboardInterrupt

    monkeypatch.setattr("yeastfit.commands.synthesize.read_recipes", interrupted)
    for _ in range(2):
        assert cli.run(["synthesize", "--recipe", "one.toml", "--out", "nowhere"]) == 130
        assert capsys.readouterr().err == "interrupted: nothing is lost\n"
    with signals.remaining("this is over"):
        pass
    assert "this is over" not in signals.current.line
