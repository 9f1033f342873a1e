"""Growth that is broken off goes on from the last segment that was kept, to the same colony."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from yeastfit.commands import app as cli
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.simulation import kept_colonies
from yeastfit.simulation.kept_colonies import KeptColony
from yeastfit.simulation.result import Simulation
from yeastfit.simulation.segments import Segments
from yeastfit.simulation.simulate import member_keys, simulate
from yeastfit.storage import WORK

OPEN = Numerics(domain=8.0, spacing=0.4, dt=0.05)
TIMES = [1.7, 2.5, 4.2]
SEGMENTS = 7  # events after 1, 2, 3 and 4, and the samples


@pytest.fixture(autouse=True)
def in_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    """As colonies of any time grow, with room for sixteen nodes at first, kept after every segment."""
    monkeypatch.setattr("yeastfit.simulation.simulate.SHORT", 1)
    monkeypatch.setattr("yeastfit.simulation.simulate.FIRST_ROOM", 16)
    monkeypatch.setattr(kept_colonies, "EVERY", 0.0)


@pytest.fixture
def segments(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The last steps of the segments that are grown."""
    grown: list[int] = []
    before = Segments._segment

    def counted(self, colony, last, *how):
        grown.append(last)
        return before(self, colony, last, *how)

    monkeypatch.setattr(Segments, "_segment", counted)
    return grown


@pytest.fixture
def broken_off() -> Iterator[pytest.MonkeyPatch]:
    """Inside, a process ends after four segments."""
    keep, kept = KeptColony.__call__, list[int]()

    def ending(self, colony, observed):
        keep(self, colony, observed)
        kept.append(int(colony.step))
        if len(kept) == 4:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(KeptColony, "__call__", ending)
        yield patch


def grown(folder: Path | None, seed: int = 3, mobility: float = 1.0) -> Simulation:
    keys = member_keys(seed, 1)
    return simulate(Parameters(mobility=mobility), keys, times=TIMES, numerics=OPEN, keep=folder)


@pytest.mark.thorough
def test_growth_goes_on_and_comes_to_the_same(
    broken_off: pytest.MonkeyPatch, segments: list[int], tmp_path: Path
) -> None:
    whole = grown(None)
    every = segments.copy()
    assert len(every) == SEGMENTS
    with pytest.raises(KeyboardInterrupt):
        grown(tmp_path)
    broken_off.undo()
    segments.clear()
    again = grown(tmp_path)
    assert segments == every[4:]
    np.testing.assert_array_equal(again.colony.positions, whole.colony.positions)
    for name, values in whole.statistics.items():
        np.testing.assert_array_equal(again.statistics[name], values)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("change", ["parameters", "keys", "damaged"])
def test_another_colony_begins_anew(
    change: str, broken_off: pytest.MonkeyPatch, segments: list[int], tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt):
        grown(tmp_path)
    broken_off.undo()
    segments.clear()
    (file,) = tmp_path.iterdir()
    if change == "damaged":
        file.write_bytes(file.read_bytes()[:-400])
    grown(tmp_path, seed=3 + (change == "keys"), mobility=1.0 + 0.1 * (change == "parameters"))
    assert len(segments) == SEGMENTS
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("undrawn")
def test_a_repeated_command_goes_on(broken_off: pytest.MonkeyPatch, segments: list[int], tmp_path: Path) -> None:
    how = ["--members", "1", "--domain", "8", "--spacing", "0.4", "--dt", "0.05", "--time", "4.2", "--every", "1.7"]
    command = ["simulate", *how, "--relaxed", "--out", str(tmp_path / "run")]
    assert cli.run(command) == 130
    assert list((tmp_path / "run").iterdir()) == [tmp_path / "run" / WORK]
    broken_off.undo()
    before = segments.copy()
    segments.clear()
    assert cli.run(command) == 0
    assert segments[0] > before[-1]
    assert not (tmp_path / "run" / WORK).exists()
    assert cli.run([*command[:-1], str(tmp_path / "whole")]) == 0
    ours, whole = ((tmp_path / one / "curves.csv").read_text() for one in ("run", "whole"))
    assert ours == whole
