"""A simulator that tells a run how much it has simulated, and keeps that in the run's folder."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from yeastfit.inference.simulator import Tally, Wrapper, once, rows_in_blocks
from yeastfit.storage import read_json, reads_saved, write_json


@dataclass(frozen=True)
class Met:
    """What a run has met so far.

    Attributes:
        simulated: Simulations since it began.
        problems: How many of them ran into what.
        unlike: Workers of other arithmetic, in words.
    """

    simulated: int
    problems: dict[str, int]
    unlike: list[str]

    @staticmethod
    @reads_saved("record of problems")
    def load(path: str | Path) -> "Met":
        """Read what `Watched` keeps.

        Raises:
            InputError: The file is something else, or damaged.
        """
        met = read_json(path)
        problems = {str(what): int(count) for what, count in met["problems"].items()}
        return Met(int(met["simulated"]), problems, [str(one) for one in met.get("unlike", [])])


@dataclass(frozen=True)
class Watched(Wrapper):
    """A simulator that tells how much it has simulated: `tell(rows)` after each batch.

    Attributes:
        tally: Simulations since the run began.
        kept: File of these and of what they ran into, written before their statistics are.
        tell: Called with the simulations of each batch.
        unlike: Workers of other arithmetic so far, in words.
    """

    tally: Tally
    kept: Path
    tell: Callable[[int], None]
    unlike: Callable[[], list[str]] = list

    def __call__(self, values: Any, seeds: Any) -> Any:
        """Rows of the simulator inside."""
        rows = self.simulator(values, seeds)
        self._seen(values, seeds)
        return rows

    def blocks(self, values: Any, seeds: Any, size: int) -> Iterator[Any]:
        """Those of the simulator inside."""
        start = 0
        for rows in rows_in_blocks(self.simulator, values, seeds, size):
            end = start + len(rows)
            self._seen(values[start:end], seeds[start:end])
            start = end
            yield rows

    def _seen(self, values: Any, seeds: Any) -> None:
        simulated = len(once(values, seeds))
        self.tally.simulated += simulated
        met = {"problems": dict(sorted(self.problems.items())), "unlike": self.unlike()}
        write_json(self.kept, {"simulated": self.tally.simulated, **met})
        self.tell(simulated)
