"""Samples: weighted moments and quantiles, what draws are worth, and their files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from yeastfit import InputError
from yeastfit.inference.posterior.samples import Samples


def made_up(values: np.ndarray, weights: np.ndarray | None = None) -> Samples:
    shape = values.shape[:2]
    return Samples(
        free=("mobility", "aspect_ratio")[: values.shape[2]],
        values=values,
        weights=np.full(shape, 1.0 / values[..., 0].size) if weights is None else weights,
        log_probability=-0.5 * values[..., 0] ** 2,
        acceptance=np.full(shape[0], 0.5),
        labels=("area",),
        statistics=np.full((*shape, 1), np.nan),
        simulations=100,
        seconds=1.5,
        seed=3,
        method="made up",
        settings={"epsilon": 0.1, "observed": [1.0, float("inf")]},
        warnings=["none"],
        diagnostics={"list": [0.1, None]},
    )


def walk(share: float, chains: int, draws: int) -> np.ndarray:
    """x' = share · x + noise, of variance 1: τ = (1 + share) / (1 − share)."""
    rng, rows = np.random.default_rng(0), [np.random.default_rng(1).standard_normal(chains)]
    for _ in range(draws - 1):
        rows.append(share * rows[-1] + np.sqrt(1 - share**2) * rng.standard_normal(chains))
    return np.array(rows).T[..., None]


def test_weighted_draws_have_the_moments_of_what_they_stand_for() -> None:
    """Uniform draws weighted by a Gaussian density."""
    grid = np.linspace(-8, 10, 40001)
    weights = stats.norm(1.0, 2 / 3).pdf(grid)
    samples = made_up(grid[None, :, None], (weights / weights.sum())[None])
    np.testing.assert_allclose([samples.mean[0], samples.sd[0]], [1.0, 2 / 3], rtol=1e-6)
    for level in (0.5, 0.9):
        np.testing.assert_allclose(samples.interval(level)[0], stats.norm(1.0, 2 / 3).interval(level), atol=1e-4)
    np.testing.assert_allclose(samples.quantile(0.5), 1.0, atol=1e-4)
    assert samples.weighted
    np.testing.assert_allclose(samples.effective_size, 1 / np.sum(samples.weights**2))


def test_chains_are_worth_their_length_over_tau() -> None:
    samples = made_up(walk(0.8, 4, 4000))
    assert not samples.weighted
    assert samples.effective_size[0] == pytest.approx(16000 / 9, rel=0.15)
    assert made_up(walk(0.0, 4, 4000)).effective_size[0] == pytest.approx(16000, rel=0.1)


def test_chains_that_stand_still_are_worth_little() -> None:
    values = walk(0.8, 4, 4000)
    apart = np.concatenate([values[:3], np.full((1, 4000, 1), 7.0)])
    assert made_up(apart).effective_size[0] < 10
    assert made_up(apart[3:]).effective_size[0] == 1.0
    assert made_up(np.full((3, 50, 1), 7.0)).effective_size[0] == 1.0
    assert 1.0 <= made_up(np.repeat(values[:, :1], 50, axis=1)).effective_size[0] <= 4.0


def test_draws_of_equal_weight() -> None:
    weights = np.array([[0.7, 0.0, 0.3]])
    samples = made_up(np.array([[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]]), weights)
    drawn = samples.drawn(3000, np.random.default_rng(0))
    assert set(map(tuple, drawn.tolist())) == {(1.0, 2.0), (5.0, 6.0)}
    assert np.mean(drawn[:, 0] == 1.0) == pytest.approx(0.7, abs=0.04)


def test_files_keep_every_bit(tmp_path: Path) -> None:
    samples = made_up(walk(0.5, 2, 50))
    path = tmp_path / "deeper" / "samples.npz"
    samples.save(path)
    found = Samples.load(path)
    for name in Samples.__dataclass_fields__:
        np.testing.assert_equal(getattr(found, name), getattr(samples, name))
    assert replace(found, warnings=[]).warned("one", "two").warnings == ["one", "two"]


def test_files_of_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "samples.npz"
    made_up(walk(0.5, 2, 50)).save(path)
    path.write_bytes(path.read_bytes()[:-100])
    (tmp_path / "text.npz").write_text("mobility")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    for name in ("samples.npz", "text.npz", "other.npz", "nowhere.npz"):
        with pytest.raises(InputError, match=f"{name}: these are no samples that were saved whole"):
            Samples.load(tmp_path / name)


def test_what_makes_no_sense_is_refused() -> None:
    values = walk(0.5, 2, 50)
    with pytest.raises(InputError, match="weights at least 0 with sum 1, their sum is 2"):
        made_up(values, np.full((2, 50), 0.02))
    values[0, 0, 0] = np.nan
    with pytest.raises(InputError, match="values must be finite"):
        made_up(values)
    with pytest.raises(InputError, match=r"share is 1.5, it must lie in 0..1"):
        made_up(walk(0.5, 2, 50)).quantile(1.5)
