"""Li et al.'s protocol: what it asks for, and chains against a plain reading of their rules."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_posteriors import Interrupted, Killed, assert_same

from yeastfit import LI2024, InputError, Posterior, infer
from yeastfit.inference.abc.mcmc import McmcDiagnostics
from yeastfit.inference.li2024 import Li2024Colonies
from yeastfit.inference.simulator import seed_of
from yeastfit.offlattice.colony import grow
from yeastfit.offlattice.masks.area_matching import search_from_below
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED, li2024_statistics

SMALL = replace(LI2024["awri796-50um"], cells=2000, area=25_000, observed=(0.28, 0.25, 0.02), tolerance=0.06)


def run(colonies: Li2024Colonies, **more: Any) -> Posterior:
    method = colonies.protocol(seed=3, chains=3, steps=12)
    return infer(colonies.simulator(threads=2), colonies.prior, colonies.observed, method=method, seed=3, **more)


def test_what_they_ran() -> None:
    for colonies in LI2024.values():
        method = colonies.protocol()
        starts = np.array(method.start)
        offsets = starts - colonies.guess
        assert len(np.unique(starts[:, 0])) == method.walkers == colonies.chains
        assert offsets.min() > 0
        assert offsets.max() < 0.01
        np.testing.assert_allclose(np.ptp(offsets, axis=1), 0, atol=1e-15)  # one for all parameters
        covariance = np.array(colonies.covariance)
        np.testing.assert_array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > 0
        assert method.simulations_at_most == colonies.chains * colonies.steps
    assert sum(one.chains * one.steps for one in LI2024.values()) == pytest.approx(64_500, rel=0.01)
    sd = np.sqrt(np.diag(LI2024["simi-white-50um"].covariance) / np.array(3))
    np.testing.assert_allclose(sd, [0.070, 0.091, 0.061, 0.062, 0.082], atol=0.0006)
    prior = np.sqrt(12) * LI2024["awri796-50um"].prior.sample(40_000, np.random.default_rng(0)).std(axis=0)
    np.testing.assert_allclose(prior / np.sqrt(12), [0.160, 0.224, 0.224, 0.160, 0.160], atol=0.004)


@pytest.mark.thorough
def test_chains_follow_their_rules() -> None:
    """Every state is the one before or a simulated colony within ε; what was simulated is what they would measure."""
    found = run(SMALL)
    assert isinstance(found.diagnostics, McmcDiagnostics)
    assert found.diagnostics.tolerance == SMALL.tolerance
    assert 0 < found.acceptance.mean() < 1
    assert found.simulations <= 36
    start = np.array(SMALL.protocol(seed=3, chains=3).start)
    o = np.array(SMALL.observed)
    moves = 0
    for chain in range(3):
        before = start[chain]
        for step in range(12):
            now, statistics = found.values[chain, step], found.statistics[chain, step]
            if (now != before).any():
                number = 500 + 3 * step  # of the step's first simulation
                seeds = seed_of(3, range(number, number + 3))
                rows = [measured(now, int(seed)) for seed in seeds]
                assert any(np.allclose(row, statistics, rtol=1e-12) for row in rows)
                assert np.sqrt((((o - statistics) / (1 + o)) ** 2).sum()) / 3 <= SMALL.tolerance
                moves += 1
            before = now
    assert moves >= 3


def measured(values: np.ndarray, seed: int) -> list[float]:
    colony = grow(values, cells=SMALL.cells, seed=seed)
    found = li2024_statistics(search_from_below(BinnedOutlines.of(colony).mask, SMALL.cells, SMALL.area).mask)
    return [found.filament_area_index, found.filament_radius_index, found.branch_index]


def test_a_start_far_from_the_data_stays_until_something_is_close() -> None:
    found = run(replace(SMALL, tolerance=1e-9))
    start = np.array(SMALL.protocol(seed=3, chains=3).start)
    np.testing.assert_array_equal(found.values, np.repeat(start[:, None], 12, axis=1))
    assert np.isnan(found.statistics).all()
    assert np.isfinite(found.log_probability).all()


def test_killed_and_resumed_to_the_same_draws(tmp_path: Path) -> None:
    whole = run(SMALL)
    method = SMALL.protocol(seed=3, chains=3, steps=12)
    stops: Any = Interrupted(SMALL.simulator(threads=1), 5)  # type: ignore[arg-type]
    with pytest.raises(Killed):
        infer(stops, SMALL.prior, SMALL.observed, method=method, seed=3, store=tmp_path / "li.h5")
    assert_same(run(SMALL, store=tmp_path / "li.h5"), whole)


def test_starts_outside_the_prior_are_refused() -> None:
    method = SMALL.protocol(chains=3, steps=2)
    assert SMALL.simulator().observables[0].statistic == PUBLISHED[0]
    for start in (((0.5,) * 5,) * 2, ((0.5,) * 4 + (1.5,),) * 3):
        with pytest.raises(InputError, match=r"start is .* it must be 3 points inside the prior"):
            infer(SMALL.simulator(), SMALL.prior, SMALL.observed, method=replace(method, start=start))
