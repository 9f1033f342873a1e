"""Whether chains can be trusted: how long they are, whether they agree, whether they move.

**Autocorrelation time** τ = 1 + 2 Σ_t ρ_t up to the first lag above 5 τ (Sokal 1997), so that n draws of a chain are
worth n / τ. What chains differ by counts as persistent (Vehtari et al. 2021, doi:10.1214/20-BA1221, equation 10):

    ρ_t = 1 − (W − A_t) / V,

W and V variances within chains and of all, A_t the mean autocovariance of a chain. Autocorrelations of single chains
about their own means, as emcee has them, give a τ that is too short where chains are short. It is too short here, too,
where chains are shorter than `LONG` τ, but by less.

**Split R̂.** Each chain is cut into two halves. With W the mean of their variances, B/n the variance of their means,

    R̂ = √((n − 1) / n + (B / n) / W),

of draws replaced by normal scores of their ranks, and of their distances from the median: the larger of the two, which
sees chains that differ in place and in spread (Vehtari et al. 2021, doi:10.1214/20-BA1221).

**Rank statistics.** The share of each chain's draws in each of `bins` bins of equal number over all draws; 1 / bins
where chains agree. Draws count as worth 1/τ_b each in their χ² and in what chance allows, τ_b the autocorrelation time
of being in bin b: a tail that chains seldom leave has a longer one than the middle.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from yeastfit.errors import InputError

LONG = 50.0  # autocorrelation times, from which their estimate is to be trusted
LARGEST_R_HAT = 1.05  # chains of LONG τ have 1.02 for their length alone
FEWEST = 400.0  # effective draws, over all chains
WINDOW = 5.0  # autocorrelation times that are summed over
ACCEPTANCE = (0.05, 0.95)

Chain = Float[np.ndarray, "chain draw free"]


@dataclass(frozen=True)
class Diagnostics:
    """Of the chains of one run.

    ranks: share of each chain's draws in each bin; chance: standard deviation of a share where chains agree; unequal:
    p-value of their χ².
    """

    free: tuple[str, ...]
    chains: int
    draws: int
    times: Float[np.ndarray, " free"]
    effective_size: Float[np.ndarray, " free"]
    r_hat: Float[np.ndarray, " free"]
    acceptance: Float[np.ndarray, " chain"]
    ranks: Float[np.ndarray, "free chain bin"]
    chance: Float[np.ndarray, "free bin"]
    unequal: Float[np.ndarray, " free"]

    @property
    def lengths(self) -> Float[np.ndarray, " free"]:
        """N/τ of one chain."""
        return self.draws / self.times

    def sentences(self) -> list[str]:
        """What is wrong; empty where all is well."""
        said = []
        for name, time, length in zip(self.free, self.times, self.lengths, strict=True):
            if not length >= LONG:
                more = f"run at least {int(np.ceil(LONG * time))} draws" if np.isfinite(time) else "it does not move"
                said.append(
                    f"chains are too short for {name}: {self.draws} draws are {length:.1f} autocorrelation times of "
                    f"{time:.1f} draws each, {LONG:g} are wanted: {more}"
                )
        for name, size in zip(self.free, self.effective_size, strict=True):
            if not size >= FEWEST:
                said.append(
                    f"{name}: all chains together are worth {size:.0f} independent draws, {FEWEST:g} are wanted"
                )
        for name, ratio in zip(self.free, self.r_hat, strict=True):
            if not ratio <= LARGEST_R_HAT:
                said.append(f"{name}: chains do not agree, split R̂ is {ratio:.3f}, at most {LARGEST_R_HAT} is wanted")
        low, high = ACCEPTANCE
        odd = (self.acceptance < low) | (self.acceptance > high)
        if odd.any():
            said.append(
                f"{odd.sum()} of {self.chains} chains accept {100 * self.acceptance[odd].min():.1f} to "
                f"{100 * self.acceptance[odd].max():.1f} % of proposals, {100 * low:g} to {100 * high:g} % are usual"
            )
        return said

    def asdict(self) -> dict[str, Any]:
        """Plain data, parameters by name."""
        named = {
            name: dict(zip(self.free, getattr(self, name).tolist(), strict=True))
            for name in ("times", "effective_size", "r_hat", "lengths", "unequal")
        }
        return {"chains": self.chains, "draws": self.draws, **named, "acceptance": self.acceptance.tolist()}


def diagnose(
    values: Chain, *, free: tuple[str, ...], acceptance: Float[np.ndarray, " chain"], bins: int = 10
) -> Diagnostics:
    """Of draws, chain by chain. Raises `InputError` where there are fewer than 4 draws, or shapes disagree."""
    chains, draws, count = values.shape
    if draws < 4 or count != len(free) or len(acceptance) != chains:
        raise InputError(
            f"values have shape {values.shape}, with {len(acceptance)} acceptances and {len(free)} names; at least 4 "
            "draws of each chain are needed, one acceptance a chain and one name a parameter"
        )
    times = autocorrelation_time(values)
    size, ratio = chains * draws / times, split_r_hat(values)
    return Diagnostics(free, chains, draws, times, size, ratio, acceptance, *rank_statistics(values, bins))


def autocorrelation_time(values: Chain, *, alike: bool = False, least: float = 0.0) -> Float[np.ndarray, " free"]:
    """τ of every parameter, at least 1; inf where no chain moves.

    alike: as if chains differed by chance alone. Autocorrelations about a chain's own mean lack τ / draws each then,
    which is put back; it can be up to lags of a quarter of the draws. least: sums go on as with a τ of so many draws.
    """
    chains, draws, count = values.shape
    times, lags = np.full(count, np.inf), np.arange(draws)
    lacking, furthest = ((2 * lags + 1) / draws, draws // 4) if alike else (0.0, draws)
    for k in range(count):
        one = values[:, :, k]
        if not (np.ptp(one, axis=1) > 0).any():
            continue
        centred = one - one.mean(axis=1, keepdims=True)
        power = np.abs(np.fft.rfft(centred, 2 * draws, axis=1)) ** 2
        covariance = np.fft.irfft(power.mean(axis=0), 2 * draws)[:draws] / draws
        within = covariance[0] * draws / max(draws - 1, 1)
        whole = covariance[0] + (np.var(one.mean(axis=1), ddof=1) if chains > 1 else 0.0)
        correlation = covariance / covariance[0] if alike else 1 - (within - covariance) / whole
        sums = (2.0 * np.cumsum(correlation) - 1.0) / np.maximum(1.0 - lacking, 0.5)
        beyond = lags >= np.minimum(WINDOW * np.maximum(sums, least), furthest)
        times[k] = max(1.0, sums[np.argmax(beyond) if beyond.any() else -1])
    return times


def split_r_hat(values: Chain) -> Float[np.ndarray, " free"]:
    """R̂ as above, nan where nothing moves."""
    half = values.shape[1] // 2
    split = np.concatenate([values[:, :half], values[:, -half:]])
    folded = np.abs(split - np.median(split, axis=(0, 1)))
    return np.maximum(_r_hat(_scores(split)), _r_hat(_scores(folded)))


def rank_statistics(
    values: Chain, bins: int = 10
) -> tuple[Float[np.ndarray, "free chain bin"], Float[np.ndarray, "free bin"], Float[np.ndarray, " free"]]:
    """Shares as above, their standard deviation by chance, and the p-value of their χ²: small where chains differ."""
    chains, draws, count = values.shape
    ranks = stats.rankdata(values.reshape(-1, count), axis=0).reshape(values.shape)
    which = np.minimum((ranks - 0.5) * bins / (chains * draws), bins - 1).astype(int)
    slowest = autocorrelation_time(values, alike=True)
    least = float(slowest[np.isfinite(slowest)].max(initial=1.0))  # what is slow shows a little in every bin
    shares, times = np.empty((count, chains, bins)), np.empty((count, bins))
    for k in range(count):
        there = (which[:, :, k, None] == np.arange(bins)).astype(float)
        shares[k], times[k] = there.mean(axis=1), autocorrelation_time(there, alike=True, least=least)
    times = np.where(np.isfinite(times), times, least)  # of bins that every chain is in always, or never
    overall = shares.mean(axis=1)
    square = np.sum((shares - overall[:, None]) ** 2 * draws / times[:, None], axis=(1, 2)) * bins
    chance = np.sqrt(overall * (1 - overall) * np.minimum(times, draws) / draws)
    return shares, chance, stats.chi2.sf(square, (bins - 1) * max(chains - 1, 1))


def _scores(values: Chain) -> Chain:
    """Normal scores of ranks over all chains (Blom's)."""
    flat = values.reshape(-1, values.shape[-1])
    ranks = stats.rankdata(flat, axis=0)
    return stats.norm.ppf((ranks - 0.375) / (len(flat) + 0.25)).reshape(values.shape)


def _r_hat(values: Chain) -> Float[np.ndarray, " free"]:
    draws = values.shape[1]
    within = values.var(axis=1, ddof=1).mean(axis=0)
    between = values.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt((draws - 1) / draws + between / within)
