"""What the terminal shows of a long run: where it is, and its pace."""

import os
import subprocess
import sys
from io import StringIO

import pytest
from rich.console import Console
from rich.table import Table

from yeastfit.commands.console import terminal
from yeastfit.commands.console.terminal import Pace, TextConsole, shown_progress


def test_the_time_that_is_left_follows_from_all_the_time_that_went_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds of 80 s, an eighth of them training, in which nothing grows; then a run that was taken up again."""
    now = [1000.0]
    monkeypatch.setattr(terminal.clock, "perf_counter", lambda: now[0])
    pace = Pace(most=4096, done=0, noun="colonies")
    assert str(pace) == ""
    for number in range(1, 9):
        for _ in range(4):
            now[0] += 17.5
            pace.grown += 128
        now[0] += 10.0
        assert pace.share == pytest.approx(number / 8)
        minutes, seconds = divmod(80 * (8 - number), 60)
        assert str(pace) == f"{512 * number} colonies, 6.4 a second, at most 0:{minutes:02.0f}:{seconds:02.0f} left"
    again = Pace(most=4096, done=3072, noun="colonies")
    assert again.share == 0.75
    now[0] += 16.0
    again.grown += 64
    assert str(again) == "64 colonies, 4.0 a second, at most 0:04:00 left"
    again.grown = 1025  # more than were foreseen: how long it takes nobody knows
    assert str(again) == "1025 colonies, 64.1 a second"


def test_progress_is_shown_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    written = StringIO()
    monkeypatch.setattr(terminal, "err", Console(file=written, force_terminal=True, width=80))
    with shown_progress("measuring micrographs") as progress:
        progress("measured 3 of 12", 0.25)
    assert "measured 3 of 12" in written.getvalue()


def test_a_file_gets_a_line_of_progress_every_ten_minutes(monkeypatch: pytest.MonkeyPatch) -> None:
    written, now = StringIO(), [1000.0]
    monkeypatch.setattr(terminal, "err", TextConsole(file=written, width=80))
    monkeypatch.setattr(terminal.clock, "perf_counter", lambda: now[0])
    with shown_progress("measuring micrographs") as progress:
        for done in range(12):
            progress(f"measured {done} of 12", done / 12)
            now[0] += 200.0
    assert written.getvalue().splitlines() == [
        "after 0:10:00: measured 3 of 12, 25 %",
        "after 0:20:00: measured 6 of 12, 50 %",
        "after 0:30:00: measured 9 of 12, 75 %",
    ]


PROGRAM = """import sys
from yeastfit.__main__ import main
sys.argv = ["yeastfit", "--version"]
try:
    main()
except SystemExit:
    print("50 µM")
"""
HOSTILE = "[red]x[/blue] :smile: \x1b[31m\n\u202e\udcff [/]"
HARMLESS = r"[red]x[/blue] :smile: \x1b[31m\n\u202e\xff [/]"


def test_text_is_printed_as_it_is_and_acts_on_nothing() -> None:
    written = StringIO()
    console = TextConsole(file=written, force_terminal=True, width=120, color_system=None)
    table = Table(HOSTILE, title=HOSTILE)
    table.add_row(HOSTILE)
    console.print(table)
    console.print(HOSTILE, soft_wrap=True)
    console.print(HOSTILE, markup=True, emoji=True)
    said = written.getvalue()
    assert said.count(HARMLESS) == 5
    assert not {"\x1b", "\u202e", "\udcff"} & set(said)


def test_progress_shows_any_text(monkeypatch: pytest.MonkeyPatch) -> None:
    written = StringIO()
    monkeypatch.setattr(terminal, "err", TextConsole(file=written, force_terminal=True, width=120))
    with shown_progress(HOSTILE) as progress:
        Pace(None, 0, HOSTILE, progress)(HOSTILE, 0.25)
    assert HARMLESS in written.getvalue()
    assert "\u202e" not in written.getvalue()


def test_a_sampler_and_its_simulations_are_shown_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    now, told = [1000.0], list[tuple[str, float]]()
    monkeypatch.setattr(terminal.clock, "perf_counter", lambda: now[0])
    pace = Pace(most=400, done=100, noun="colonies", progress=lambda what, share: told.append((what, share)))
    pace("pilot", 0.0)
    now[0] += 10.0
    pace.count(100)
    pace("chains", 0.9)
    line = "100 colonies, 10.0 a second, at most 0:00:20 left"
    assert told == [("pilot", 0.25), (f"pilot: {line}", 0.5), (f"chains: {line}", 0.5)]


def test_letters_that_a_terminal_lacks_are_written_as_escapes() -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii:strict"}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, check=True)
    assert done.stdout.splitlines()[-1] == rb"50 \xb5M"
