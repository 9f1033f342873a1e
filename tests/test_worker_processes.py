"""Processes end with their parent, however it ends. In the child nothing heavy is imported."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from yeastfit import worker_processes
from yeastfit.commands import measure_batch

PARENT = """
import multiprocessing, os, sys, time
from concurrent.futures import ProcessPoolExecutor
from yeastfit import worker_processes
from yeastfit.worker_processes import end_with_parent

def begin(kernel):
    if not kernel:
        worker_processes.sys = type(sys)("elsewhere")
        worker_processes.sys.platform = "elsewhere"
    end_with_parent()

if __name__ == "__main__":
    kernel = sys.argv[1] == "kernel"
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), begin, (kernel,)) as pool:
        print(*{pool.submit(os.getpid).result() for _ in range(20)}, flush=True)
        pool.submit(time.sleep, 600)
        time.sleep(600)
"""


def alive(process: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has waited for does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc which processes there are")
@pytest.mark.parametrize("way", ["kernel", "pipe"])
@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGTERM])
def test_processes_end_with_their_parent(way: str, signal_number: int, tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    with subprocess.Popen([sys.executable, str(tmp_path / "parent.py"), way], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        children = [int(each) for each in parent.stdout.readline().split()]
        assert children
        assert all(map(alive, children))
        os.kill(parent.pid, signal_number)
    deadline = time.monotonic() + 20
    while any(map(alive, children)):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_process_without_parent_goes_on() -> None:
    worker_processes._end_after_parent()


def test_a_process_ends_with_its_parent_before_it_does_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[object] = []
    monkeypatch.setattr(worker_processes, "end_with_parent", lambda: done.append("asked"))
    monkeypatch.setattr(worker_processes.pickle, "loads", lambda work: (done.append, work))
    worker_processes.begin(b"work")
    assert done == ["asked", b"work"]
    assert measure_batch.begin is worker_processes.begin
