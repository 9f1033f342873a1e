"""`yeastfit` and `python -m yeastfit`: signals are answered before the command line is imported."""

import gc
import io
import os
import sys

from yeastfit.commands import signals
from yeastfit.processors import available_processors


def main() -> None:
    """Entry point of `yeastfit`."""
    # one JAX device per processor, over which ensembles are shared out
    os.environ.setdefault("JAX_NUM_CPU_DEVICES", str(available_processors()))
    gc.set_threshold(
        50_000
    )  # imports and traced programs leave hardly a cycle: looking for some takes a tenth of a run
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as standard error does, where a terminal has no µ
    with signals.answered_signals():
        try:
            from yeastfit.commands.app import run

            code = run()
        except KeyboardInterrupt:
            code = signals.current.tell()
        if signals.current.received:
            signals.current.end()  # Python's own end would wait for compiled programs, and crash among their threads
    sys.exit(code)


if __name__ == "__main__":
    main()
