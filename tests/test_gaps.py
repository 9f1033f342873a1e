"""Widths of gaps at which simulated colonies look like real ones."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import gaps
from benchmarks.report import Report
from yeastfit.offlattice import Ellipses, grow, match_exactly
from yeastfit.offlattice.simulator import statistics_of

AREA = 3e4  # µm²


def test_the_width_lies_where_the_logarithm_of_the_statistic_agrees() -> None:
    falling = 1000 * 10.0 ** (-np.array(gaps.WIDTHS) / 6)
    assert gaps.width_at(falling, 10.0) == pytest.approx(12.0)
    assert gaps.width_at(falling, 1000 * 10 ** (-7.0 / 6)) == pytest.approx(7.0)
    assert np.isnan(gaps.width_at(falling, 2000.0))
    assert np.isnan(gaps.width_at(falling, 0.01))


def test_colonies_drawn_with_a_width_of_their_own_are_found_at_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In place of real ones, simulated ones of other seeds with gaps of 9 µm closed; of four statistics each."""

    def drawn(key: str, names: tuple[str, ...]) -> np.ndarray:
        values, cells, of_theirs = gaps.SETS[gaps.CALLED[key]]
        rows = []
        for seed in range(100, 108):
            size = int(gaps.MORE * cells * AREA * gaps.PIXELS_PER_UM**2 / of_theirs)
            picture = Ellipses.of(grow(values, cells=size, seed=seed), gap=9.0)
            mask = match_exactly(picture.mask, size, AREA / picture.pixel_size**2).mask
            rows.append(list(statistics_of(mask, picture.pixel_size, names).values()))
        return np.array(rows)

    monkeypatch.setattr(gaps, "real_colonies", drawn)
    report = Report("gaps", docs=tmp_path)
    gaps.run(report, quick=False)
    found = {figure.name: figure.value for figure in report.figures}
    assert len(found) == 3 * 4 + 1
    assert found["median of these widths"] == pytest.approx(9.0, abs=1.0)
    assert [len(rows) for rows in report.tables.values()] == [len(gaps.WIDTHS) + 2] * 3
    assert "# How wide are the gaps" in (tmp_path / "gaps.md").read_text(encoding="utf-8")
