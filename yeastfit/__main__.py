"""`yeastfit` and `python -m yeastfit`: signals are answered before the command line is imported."""

import gc
import io
import logging
import os
import signal
import sys
import warnings


def main() -> None:
    """Entry point of `yeastfit`."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # until it is answered, it ends the process without a traceback
    from yeastfit.commands.console import signals
    from yeastfit.processors import available_processors

    _open_closed_streams()
    if len(columns := os.environ.get("COLUMNS", "")) > 4 or columns == "0":
        del os.environ["COLUMNS"]  # no terminal is that wide, and text would be padded; nothing is printed in none
    os.environ["MPLBACKEND"] = "agg"  # figures go into files, whatever the user's notebooks draw on
    # one JAX device per processor, over which ensembles are shared out
    os.environ.setdefault("JAX_NUM_CPU_DEVICES", str(available_processors()))
    gc.set_threshold(
        50_000
    )  # imports and traced programs leave hardly a cycle: looking for some takes a tenth of a run
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as standard error does, where a terminal has no µ
    warnings.showwarning = _in_one_line
    sys.warnoptions.append("ignore:resource_tracker")  # Python's, of a run that a signal ended; processes inherit it
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns of a missing cache, which it can do without
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(logging.Formatter("warning: %(message)s"))
    with signals.answered_signals():
        try:
            from yeastfit.commands.app import run

            code = run()
        except KeyboardInterrupt:
            code = signals.current.tell()
        if signals.current.received:
            signals.current.end()  # Python's own end would wait for compiled programs, and crash among their threads
    sys.exit(code)


def _in_one_line(message: Warning | str, *where: object, **more: object) -> None:
    """Write a library's warning as the commands write theirs, without the line of code that gave it."""
    if sys.stderr is not None:
        said = " ".join(str(message).split()).split(" The parse failed with")[0]  # what follows is numba's traceback
        sys.stderr.write(f"warning: {said}\n")


def _open_closed_streams() -> None:
    """Where the shell closed standard streams (`>&-`), read and write nothing; files would get their numbers."""
    for number, (name, mode) in enumerate({"stdin": "r", "stdout": "w", "stderr": "w"}.items()):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
        if getattr(sys, name) is None:
            setattr(sys, name, io.TextIOWrapper(io.FileIO(number, mode, closefd=False), encoding="utf-8"))


if __name__ == "__main__":
    main()
