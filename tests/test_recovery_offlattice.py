"""The benchmark that recovers the off-lattice model's parameters from photographs: what it photographs, and counts."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

from made_posteriors import flat_prior, made_posterior

from benchmarks import recovery_offlattice as benchmark
from yeastfit import measure_file
from yeastfit.offlattice.parameters import PARAMETERS
from yeastfit.simulation.photograph import write_micrograph

SMALL = benchmark.Study(("simi-white-50um",), 2, 4000)


def test_photographs_are_outlined_where_the_colony_is(tmp_path: Path) -> None:
    """Area and compactness of the outline, as those of the mask that was photographed."""
    for member in range(SMALL.colonies):
        pixels = benchmark.micrograph(benchmark.colony_of(SMALL, SMALL.sets[0], member), np.random.default_rng(member))
        path = tmp_path / f"{member}.tif"
        write_micrograph(path, pixels, benchmark.PIXEL)
        true = benchmark.true_statistics(SMALL, SMALL.sets[0], member)
        found = measure_file(path).shape
        assert found.area == pytest.approx(true["area"], rel=0.02)
        assert found.compactness == pytest.approx(true["compactness"], rel=0.15)


def test_where_true_values_lie_in_a_posterior(tmp_path: Path) -> None:
    """Below the mean by a standard deviation, and above all draws."""
    truth = np.array(list(benchmark.truth_of("awri796-50um").values()))
    rng = np.random.default_rng(2)
    draws = truth + 0.01 * (1.0 + rng.standard_normal((4, 500, 5)))
    draws[..., -1] -= 0.1
    made_posterior(draws, prior=flat_prior(*PARAMETERS.names)).save(tmp_path / "posterior.npz")
    rows = benchmark.recovered(tmp_path, "awri796-50um", "I_B")
    assert [row["parameter"] for row in rows] == list(PARAMETERS.names)
    for row in rows[:-1]:
        assert row["inside"] == "yes"
        assert row["pull"] == pytest.approx(1.0, abs=0.1)
        assert row["rank"] == pytest.approx(0.16, abs=0.03)
    assert rows[-1]["inside"] == "no"
    assert rows[-1]["rank"] == 1.0
