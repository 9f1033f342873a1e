"""A posterior of one set of `data/real`, as `yeastfit infer` keeps it in a folder."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from benchmarks.real_colonies import DATA
from yeastfit.commands import app
from yeastfit.errors import SimulationError
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.posterior.result import Posterior
from yeastfit.results.contents import MANIFEST

CELLS = {"awri796-50um": 56_000, "awri796-500um": 127_000, "simi-white-50um": 88_000}
"""Of the off-lattice model, which cover the largest colony of each set."""


@dataclass(frozen=True)
class RealRun:
    """One run, finished or not.

    Attributes:
        name: Of the set.
        folder: Of the run.
    """

    name: str
    folder: Path

    @property
    def there(self) -> bool:
        """Whether it is finished."""
        return (self.folder / MANIFEST).is_file()

    @cached_property
    def left_out(self) -> LeftOut:
        """Colonies left out of a finished one."""
        return LeftOut.load(self.folder / "left_out.npz")

    @cached_property
    def posterior(self) -> Posterior:
        """Of a finished one."""
        return Posterior.load(self.folder / "posterior.npz")

    def infer(self, how: str) -> None:
        """Begin it, or go on; `how` are further options."""
        where = ["infer", str(DATA / self.name), "--out", str(self.folder), "--cells", str(CELLS[self.name])]
        if (ended := app.run([*where, "--resume", *how.split()])) > 1:
            raise SimulationError(f"{self.folder}: yeastfit infer ended with exit code {ended}")
