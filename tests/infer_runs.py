"""Short runs of `yeastfit infer` on known colonies, and how two of them compare."""

from pathlib import Path

import numpy as np

from yeastfit.commands import app as cli
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status

TINY = {
    "emulator": ["--simulations", "96", "--walkers", "8", "--most-steps", "500"],
    "abc-mcmc": ["--steps", "40", "--walkers", "8", "--pilot", "96", "--pilot-quantile", "0.1"],
    "abc-smc": ["--population", "64", "--simulations", "600", "--pilot", "96"],
}


def arguments(data: Path, out: Path, method: str, *more: str) -> list[str]:
    common = ["--model", "known", "--free", "mobility,aspect-ratio", "--draws", "12", "--method", method]
    return ["infer", str(data), "--out", str(out), *common, *TINY[method], *more]


def finished(arguments: list[str]) -> None:
    """Run the command to its end: exit code 1 unless the posterior has settled."""
    code = cli.run(arguments)
    posterior = Posterior.load(Path(arguments[arguments.index("--out") + 1]) / "posterior.npz")
    assert code == (0 if posterior.status is Status.SETTLED else 1)


def assert_same(found: Path, expected: Path) -> None:
    """Draws and what was made of them, to the last bit."""
    one, other = (Posterior.load(folder / "posterior.npz") for folder in (found, expected))
    for name in ("values", "weights", "log_probability", "acceptance", "statistics"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.simulations, one.settings, one.seed, one.status) == (
        *(other.simulations, other.settings, other.seed, other.status),
    )
    for name in ("posterior.csv", "predictive.csv"):
        assert (found / name).read_text() == (expected / name).read_text()
