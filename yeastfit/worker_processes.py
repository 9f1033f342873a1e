"""Processes that end with the one that started them, whatever ends it: a kill that nobody can catch, too.

On Linux the kernel kills them at once (`PR_SET_PDEATHSIG`). Elsewhere, and where the parent died before that was asked
for, a thread waits for the end of the pipe that every spawned process holds to its parent.
"""

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def begin(work: bytes) -> None:
    """What a process does first: it ends with its parent from now on, and then calls a function.

    Arguments:
        work: The function and its argument, pickled, so that what they need is imported only then.
    """
    end_with_parent()
    function, argument = pickle.loads(work)
    function(argument)


def end_with_parent() -> None:
    """Make this process, started by `multiprocessing`, end when its parent does, and at once after Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # which reaches both: the parent need not wait for what is at hand
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    be_killed_with_parent()
    threading.Thread(target=_end_after_parent, daemon=True).start()


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Hold Ctrl-C back from processes that are started inside: each would write a traceback before it has begun.

    In a terminal it goes to all processes of a command. That of the parent is answered at the end.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    resource_tracker.ensure_running()  # else `multiprocessing` would start it inside, and let Ctrl-C through there
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def be_killed_with_parent() -> None:
    """Ask the kernel for it, which kills a stopped process, too. Elsewhere than on Linux nothing happens."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _end_after_parent() -> None:
    """Wait for the parent's end."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)
