"""The page on areas of colonies: of runs that are there, which predicts colonies left out better."""

from pathlib import Path

import numpy as np
import pytest
from made_posteriors import flat_prior, made_posterior

from benchmarks import colony_areas
from yeastfit.inference.comparison.left_out import SHARES, LeftOut
from yeastfit.results.contents import MANIFEST

COLONIES, LABELS = tuple("12345678"), ("area", "radius")


def left_out(log_density: float, outside: int) -> LeftOut:
    """Eight colonies, so many of which are outside the interval of 90 % in one of two statistics."""
    below = np.full((8, 2), 0.4)
    below[:outside, 1] = 0.99
    return LeftOut(
        labels=LABELS,
        colonies=COLONIES,
        observed=np.arange(16.0).reshape(8, 2),
        group=np.arange(8) % 4,
        log_density=log_density + 0.01 * np.arange(8),
        below=below,
        quantiles=np.zeros((8, len(SHARES), 2)),
    )


def run_in(work: Path, name: str, log_density: float, outside: int) -> None:
    """A finished run."""
    folder = work / "full" / "awri796-500um" / name
    folder.mkdir(parents=True)
    values = np.stack([np.full((4, 10), 0.6), np.tile([0.0, 0.3], (4, 5))], axis=2)
    made_posterior(values, prior=flat_prior("transition", "colony_variation")).save(folder / "posterior.npz")
    left_out(log_density, outside).save(folder / "left_out.npz")
    (folder / MANIFEST).write_text("{}")


def page_of(work: Path) -> tuple[int, str]:
    """Exit code, and what is written."""
    with pytest.raises(SystemExit) as ended:
        colony_areas.main(["--page", "--work", str(work), "--docs", str(work)])
    return ended.value.code, (work / "colony-areas.md").read_text(encoding="utf-8")  # type: ignore[return-value]


def test_the_page_says_what_is_better_and_what_is_missing(tmp_path: Path) -> None:
    run_in(tmp_path, "each-0", -4.0, outside=1)
    assert "- **AWRI 796, 500 µM**: of no seed are both runs there." in page_of(tmp_path)[1]
    run_in(tmp_path, "exactly-0", -5.0, outside=4)
    code, page = page_of(tmp_path)
    assert code == 0
    assert "predicted better each at its area by 8.0 ± 0.0 (seed 0)." in page
    assert "Not there yet: AWRI 796, 500 µM, each at its area, seed 1; AWRI 796, 500 µM, each" in page
    assert "| AWRI 796, 500 µM, each at its area, seed 0: left out, inside 90 % | 0.938 |  | ≥ 0.8 | yes |" in page
    row = "yes | 100 | 94 | 94 | -31.7 ± 0.1 | 0.15 ± 0.15 | 0.5 | 0.60 ± 0.00 |"
    assert f"| AWRI 796, 500 µM, each at its area, seed 0 | {row}" in page
    run_in(tmp_path, "each-1", -4.0, outside=6)
    code, page = page_of(tmp_path)
    assert code == 1  # a target is missed
    assert "each at its area, seed 1: left out, inside 90 % | 0.625 |  | ≥ 0.8 | **no** |" in page
    assert "(seed 1)" not in page
