"""The inference of Li et al. 2024, as they ran it: ABC-MCMC for three sets of colonies, in many short chains.

Data are means o of I_F, I_R and I_B over the colonies of a set. From θ a chain proposes θ* ~ N(θ, Σ/3), which is
rejected outside [0, 1]⁵; else one colony of N cells grows, as many of its first cells as cover the area A* are drawn
(`area_matching`) and measured, and θ* is accepted with probability

    min(1, π(θ*)/π(θ) · 1[d ≤ ε]),    d = 1/3 √Σ_k ((o_k − s_k) / (1 + o_k))²,

π the product of their beta densities. So one colony is compared with the mean of many, and how colonies differ enters
nowhere. A chain starts at a guess + 0.01 u, one u ~ U(0, 1) for all five parameters; the start is not simulated. Chains
were 300 to 1100 steps long, and no step of theirs was left out. Numbers of chains and steps here are the typical ones.

    colonies = yeastfit.LI2024["awri796-50um"]
    posterior = yeastfit.infer(
        colonies.simulator(), colonies.prior, colonies.observed, method=colonies.protocol(seed=1), seed=1, store="li.h5"
    )

Colonies grow on all processors; a run that was stopped goes on when it is repeated with the same store.

Source: `ABC-MCMC` in github.com/kaili2019/Li2024-off-lattice (MIT licence), of "An off-lattice discrete model to
characterise filamentous yeast colony morphology", PLoS Comput. Biol. 20.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from yeastfit.inference.abc.mcmc import AbcMcmc
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.inference.prior.prior import Prior
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.parameters import PRIOR
from yeastfit.offlattice.simulator import OfflatticeSimulator
from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED
from yeastfit.seeds import Stream, stream_of

OFFSET = 0.01  # largest, of a start from the guess


@dataclass(frozen=True)
class Li2024Colonies:
    """A set of colonies of one strain on one medium, and how Li et al. inferred its parameters.

    Attributes:
        name: Strain, and ammonium sulphate in the medium.
        cells: N.
        area: A*, pixels of 1.548 µm.
        observed: o.
        replicates: Colonies that `observed` is the mean of.
        tolerance: ε.
        guess: Where chains start, but for the offset.
        upper: Upper triangle of Σ, row by row.
        chains: Their number.
        steps: Of each chain.
    """

    name: str
    cells: int
    area: float
    observed: tuple[float, float, float]
    replicates: int
    tolerance: float
    guess: tuple[float, ...]
    upper: tuple[float, ...]
    chains: int
    steps: int

    @property
    def prior(self) -> Prior:
        """Theirs, the same for all sets."""
        return Prior(
            {name: Distribution("beta", dict(zip("ab", numbers, strict=True))) for name, numbers in PRIOR.items()}
        )

    @property
    def covariance(self) -> tuple[tuple[float, ...], ...]:
        """Σ."""
        upper = np.zeros((len(self.guess), len(self.guess)))
        upper[np.triu_indices(len(self.guess))] = self.upper
        return tuple(map(tuple, (upper + np.triu(upper, 1).T).tolist()))

    def simulator(self, statistics: Sequence[str] = PUBLISHED, threads: int | None = None) -> OfflatticeSimulator:
        """Colonies of N cells drawn at the area A* in their frame, on so many threads, or on all processors."""
        return OfflatticeSimulator.of(
            statistics, cells=self.cells, area=self.area, draw=BinnedOutlines.of, threads=threads
        )

    def protocol(self, *, seed: int = 0, chains: int | None = None, steps: int | None = None) -> AbcMcmc:
        """Their ABC-MCMC.

        Arguments:
            seed: Of the chains' starts.
            chains: In the place of theirs.
            steps: Of each chain, in the place of theirs.
        """
        count = chains or self.chains
        offsets = OFFSET * np.random.default_rng(stream_of(seed, Stream.STARTS, 0)).random((count, 1))
        return AbcMcmc(
            steps=steps or self.steps,
            walkers=count,
            distance="li",
            tolerance=self.tolerance,
            covariance=self.covariance,
            start=tuple(map(tuple, (np.array(self.guess) + offsets).tolist())),
        )


LI2024 = {
    "awri796-50um": Li2024Colonies(
        name="AWRI 796, 50 µM",
        cells=45_000,
        area=573_920,
        observed=(0.21263675, 0.16416917, 0.38447205),
        replicates=14,
        tolerance=0.03,
        guess=(0.65, 0.5, 0.3, 0.08, 0.1),
        upper=(
            *(0.01418355, -0.01010819, -0.00180634, 0.00068616, -0.00044570, 0.05034611, -0.01132439, -0.00108729),
            *(-0.00100368, 0.01948684, 0.00048576, 0.00234799, 0.00408673, 0.00115046, 0.00783353),
        ),
        chains=24,
        steps=880,
    ),
    "awri796-500um": Li2024Colonies(
        name="AWRI 796, 500 µM",
        cells=90_000,
        area=1_052_300,
        observed=(0.17678223, 0.11176109, 0.24762542),
        replicates=13,
        tolerance=0.01,
        guess=(0.86, 0.61, 0.18, 0.24, 0.14),
        upper=(
            *(0.00292321, 0.00300255, -0.00217587, -0.00293266, -0.00107703, 0.01139698, -0.00492631, -0.00518672),
            *(-0.00336276, 0.00574200, 0.00499988, 0.00154008, 0.00861922, 0.00204533, 0.00264273),
        ),
        chains=43,
        steps=500,
    ),
    "simi-white-50um": Li2024Colonies(
        name="Simi White, 50 µM",
        cells=65_000,
        area=825_329,
        observed=(0.1992, 0.1715, 0.3227),
        replicates=14,
        tolerance=0.015,
        guess=(0.56, 0.74, 0.29, 0.17, 0.14),
        upper=(
            *(0.01475852, -0.00227938, -0.00286172, -0.00156430, 0.00101160, 0.02496554, 0.00415969, 0.00699135),
            *(-0.00717226, 0.01102563, -0.00090716, -0.00856308, 0.01150217, -0.00257093, 0.02011423),
        ),
        chains=29,
        steps=760,
    ),
}
"""The three sets, by the names of their folders in data/real."""
