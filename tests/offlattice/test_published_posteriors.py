"""What Li et al. 2024 found at and around their posterior means: three sets of colonies, minutes each."""

from dataclasses import dataclass

import numpy as np
import pytest

from yeastfit.offlattice.colony import OfflatticeColony, grow
from yeastfit.offlattice.masks.area_matching import Match, MatchedMask, search_from_below
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.statistics.li2024_statistics import Li2024, li2024_statistics


@dataclass(frozen=True)
class Colonies:
    """A set of colonies, what was found of its posterior, and means and standard deviations at the posterior's mean."""

    cells: int
    area: float
    observed: tuple[float, float, float]  # I_F, I_R, I_B
    posterior_mean: tuple[float, ...]
    epsilon: float
    guess: tuple[float, ...]
    covariance: tuple[float, ...]  # upper triangle, row by row; of a proposal, 3 times as large
    accepted: tuple[float, float]  # moves per iteration, and its standard error from the scatter of chains like theirs
    statistics: dict[str, tuple[float, float, int]]  # mean, standard deviation, number of colonies
    kept: tuple[float, float]
    attempts: float
    pseudohyphal: float


AWRI_50 = Colonies(
    45_000,
    573_920,
    (0.21263675, 0.16416917, 0.38447205),
    (0.6332, 0.6145, 0.2521, 0.1321, 0.1174),
    0.03,
    (0.65, 0.5, 0.3, 0.08, 0.1),
    (
        *(0.01418355, -0.01010819, -0.00180634, 0.00068616, -0.00044570, 0.05034611, -0.01132439, -0.00108729),
        *(-0.00100368, 0.01948684, 0.00048576, 0.00234799, 0.00408673, 0.00115046, 0.00783353),
    ),
    (0.050, 0.01),
    {
        "filament_area_index": (0.1985, 0.032, 20),
        "filament_radius_index": (0.154, 0.024, 20),
        "branch_index": (0.196, 0.031, 10),
    },
    (38_700, 100),
    3.48,
    0.097,
)
AWRI_500 = Colonies(
    90_000,
    1_052_300,
    (0.17678223, 0.11176109, 0.24762542),
    (0.8054, 0.5507, 0.1631, 0.2554, 0.1674),
    0.01,
    (0.86, 0.61, 0.18, 0.24, 0.14),
    (
        *(0.00292321, 0.00300255, -0.00217587, -0.00293266, -0.00107703, 0.01139698, -0.00492631, -0.00518672),
        *(-0.00336276, 0.00574200, 0.00499988, 0.00154008, 0.00861922, 0.00204533, 0.00264273),
    ),
    (0.081, 0.01),
    {
        "filament_area_index": (0.152, 0.017, 20),
        "filament_radius_index": (0.0935, 0.012, 20),
        "branch_index": (0.279, 0.037, 10),
    },
    (81_900, 150),
    3.70,
    0.048,
)
SIMI_WHITE = Colonies(
    65_000,
    825_329,
    (0.1992, 0.1715, 0.3227),
    (0.5648, 0.6921, 0.1931, 0.1779, 0.1558),
    0.015,
    (0.56, 0.74, 0.29, 0.17, 0.14),
    (
        *(0.01475852, -0.00227938, -0.00286172, -0.00156430, 0.00101160, 0.02496554, 0.00415969, 0.00699135),
        *(-0.00717226, 0.01102563, -0.00090716, -0.00856308, 0.01150217, -0.00257093, 0.02011423),
    ),
    (0.129, 0.01),
    {
        "filament_area_index": (0.189, 0.026, 20),
        "filament_radius_index": (0.146, 0.017, 20),
        "branch_index": (0.286, 0.033, 10),
    },
    (54_700, 100),
    3.55,
    0.115,
)
SETS = pytest.mark.parametrize("colonies", [AWRI_50, AWRI_500, SIMI_WHITE], ids=["50 µM", "500 µM", "Simi White"])


def simulated(
    colonies: Colonies, values: tuple[float, ...] | np.ndarray, seed: int
) -> tuple[OfflatticeColony, MatchedMask, Li2024]:
    colony = grow(values, cells=colonies.cells, seed=seed)
    matched = search_from_below(BinnedOutlines.of(colony).mask, colony.x.size, colonies.area)
    return colony, matched, li2024_statistics(matched.mask)


@pytest.mark.slow
@SETS
def test_means_at_the_posterior_mean(colonies: Colonies) -> None:
    """Within three standard errors, of both sides."""
    count = 32
    found = [simulated(colonies, colonies.posterior_mean, seed) for seed in range(count)]
    for name, (mean, spread, published) in colonies.statistics.items():
        values = np.array([getattr(statistics, name) for *_, statistics in found])
        error = np.hypot(values.std(ddof=1) / np.sqrt(count), spread / np.sqrt(published))
        assert abs(values.mean() - mean) < 3 * error, (name, values.mean(), mean, error)
    assert all(matched.match is Match.MATCHED for _, matched, _ in found)
    ratio = np.mean([matched.area / colonies.area for _, matched, _ in found])
    assert 0.972 <= round(float(ratio), 3) <= 0.978
    kept = np.array([matched.cells for _, matched, _ in found])
    mean, error = colonies.kept
    assert abs(kept.mean() - mean) < 3 * np.hypot(kept.std(ddof=1) / np.sqrt(count), error)
    attempts = np.mean([colony.attempts / colonies.cells for colony, _, _ in found])
    assert attempts == pytest.approx(colonies.attempts, abs=0.011)
    share = np.mean([colony.pseudohyphal[: matched.cells].mean() for colony, matched, _ in found])
    assert share == pytest.approx(colonies.pseudohyphal, abs=0.0015)


def chain(colonies: Colonies, steps: int, seed: int) -> float:
    """The share of accepted proposals of one of their chains, from their starting point.

    A proposal that the priors alone reject is not simulated, as nothing else could save it.
    """
    draw = np.random.default_rng(seed)
    covariance = np.zeros((5, 5))
    covariance[np.triu_indices(5)] = colonies.covariance
    covariance = covariance + covariance.T - np.diag(np.diag(covariance))
    root = np.linalg.cholesky(covariance / 3)
    values = np.array(colonies.guess) + 0.01 * draw.random()
    accepted = 0
    for step in range(steps):
        proposal = values + root @ draw.standard_normal(5)
        if not (proposal > 0).all() or not (proposal < 1).all():
            continue
        if np.log(draw.random()) >= log_prior(proposal) - log_prior(values):
            continue
        statistics = simulated(colonies, proposal, 1000 * seed + step)[2]
        row = statistics.filament_area_index, statistics.filament_radius_index, statistics.branch_index
        if distance(row, colonies.observed) <= colonies.epsilon:
            values, accepted = proposal, accepted + 1
    return accepted / steps


def log_prior(values: np.ndarray) -> float:
    """Beta(5, 2), Beta(2, 2) twice, Beta(2, 5) twice, up to a constant."""
    a, b = np.array([5, 2, 2, 2, 2]), np.array([2, 2, 2, 5, 5])
    return float(((a - 1) * np.log(values) + (b - 1) * np.log1p(-values)).sum())


def distance(found: tuple[float, ...], observed: tuple[float, ...]) -> float:
    o = np.array(observed)
    return float(np.sqrt((((o - found) / (1 + o)) ** 2).sum()) / 3)


@pytest.mark.slow
@SETS
def test_acceptance_of_their_chains(colonies: Colonies) -> None:
    """As stored, within three standard errors, from short chains that start where theirs did."""
    shares = np.array([chain(colonies, 100, seed) for seed in range(8)])
    mean, error = colonies.accepted
    assert abs(shares.mean() - mean) < 3 * np.hypot(shares.std(ddof=1) / np.sqrt(len(shares)), error), shares
