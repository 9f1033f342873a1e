"""Ctrl-C, SIGTERM and SIGHUP: one line that says what remains, within two seconds whatever the process is doing.

Python runs a signal's handler between two of its own instructions, and a compiled call may keep it from doing so for
minutes. So the signal also wakes a thread (`signal.set_wakeup_fd`): where the main thread has not ended the process
`GRACE` seconds later, the thread writes the line and ends it at once. That is as safe as a kill, which loses nothing:
files take their names when they are whole, the manifest comes last, and stores of simulations are only appended to.

This module is imported before anything heavy, so that Ctrl-C is answered while libraries are being imported, too.
"""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType, TracebackType
from typing import NoReturn

GRACE = 1.0  # seconds that the main thread has for an orderly end; a busy machine may add one
AGAIN = 0.05  # seconds
ANSWERED = tuple(getattr(signal, one) for one in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, one))
SHOW_CURSOR = "\x1b[?25h\n"  # a progress bar hides it


@dataclass
class Interruption:
    """What is known of the signal that ends the process, and what a user should know then.

    Attributes:
        number: Of the signal; that of Ctrl-C before one has come.
        received: Whether one has come.
        told: Whether the line has been written.
        remains: What the line says.
    """

    number: int = signal.SIGINT
    received: bool = False
    told: bool = False
    remains: str = "a folder of results is whole only with its manifest.json"

    @property
    def code(self) -> int:
        """The exit code: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP."""
        return 128 + self.number

    @property
    def line(self) -> str:
        """What is written; a progress bar has hidden the terminal's cursor."""
        return f"{SHOW_CURSOR if sys.stderr.isatty() else ''}interrupted: {self.remains}\n"

    def tell(self) -> int:
        """Write the line and return the exit code."""
        self.told = True
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.write(self.line)
            sys.stderr.flush()
        return self.code

    def end(self) -> NoReturn:
        """End the process at once. The main thread may hold the lock of `sys.stderr`, so the line goes past it."""
        if not self.told:
            with suppress(OSError):
                os.write(2, self.line.encode(errors="backslashreplace"))
        os._exit(self.code)


current = Interruption()


def forget() -> None:
    """Begin anew, as a process does that runs one command after another."""
    global current
    current = Interruption()


@contextmanager
def remaining(what: str) -> Iterator[None]:
    """Say something else of what remains where a signal ends what is inside."""
    before, current.remains = current.remains, what
    yield
    current.remains = before  # not after `KeyboardInterrupt`: the line is written further out


@contextmanager
def answered_signals() -> Iterator[None]:
    """Answer signals inside: the first one raises `KeyboardInterrupt` in the main thread, a second one ends all."""
    ours = [
        each for each in ANSWERED if signal.getsignal(each) is not signal.SIG_IGN
    ]  # as a shell's background jobs do
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()
    for each in ours:
        signal.signal(each, _interrupt)
    ignoring, sys.unraisablehook = sys.unraisablehook, _interrupt_again
    telling, sys.excepthook = sys.excepthook, _tell_others
    try:
        yield
    finally:
        sys.unraisablehook, sys.excepthook = ignoring, telling
        for each in ours:
            signal.signal(each, signal.SIG_DFL)
        signal.set_wakeup_fd(-1)
        writer.close()


def _interrupt(number: int, frame: FrameType | None) -> None:
    """The handler. An import is not broken off: compiled modules crash of an exception that comes while they begin."""
    if current.received:
        current.end()
    if _importing(frame):
        threading.Timer(AGAIN, os.kill, (os.getpid(), number)).start()
        return
    current.received, current.number = True, number
    raise KeyboardInterrupt


def _importing(frame: FrameType | None) -> bool:
    """Whether a frame, or one that called it, is a module's import."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _interrupt_again(ignored: "sys.UnraisableHookArgs") -> None:
    """Send a signal once more whose exception Python ignores, as in callbacks of its garbage collector; JAX has one."""
    if current.received and isinstance(ignored.exc_value, KeyboardInterrupt):
        current.received = False
        threading.Timer(AGAIN, os.kill, (os.getpid(), current.number)).start()  # when the callback is over
    else:
        sys.__unraisablehook__(ignored)


def _tell_others(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print a traceback, but not of a signal: Cython prints what its functions cannot raise before it ignores it."""
    if not (current.received and issubclass(kind, KeyboardInterrupt)):
        sys.__excepthook__(kind, error, trace)


def _watch(reader: socket.socket) -> None:
    """The thread: waits for a signal, then for the main thread's end."""
    number = 0
    while number not in ANSWERED:
        if not (received := reader.recv(1)):
            reader.close()
            return  # signals are answered no longer, the process is done
        (number,) = received
    time.sleep(GRACE)
    current.number = number
    current.end()
