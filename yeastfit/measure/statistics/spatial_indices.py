"""Where a colony's pixels lie around its centroid: radial and angular indices, pair correlation, spectrum, profile.

Rings, sectors and pairs by their angle are counted as by Binder, Sundstrom, Gardner, Jiranek & Oliver 2015,
"Quantifying two-dimensional filamentous and invasive growth spatial patterns in yeast colonies", PLoS Comput. Biol.
11:e1004070, doi:10.1371/journal.pcbi.1004070. The indices are those of Tronnolone, Gardner, Sundstrom, Jiranek, Oliver
& Binder 2017, "Quantifying the dominant growth mechanisms of dimorphic yeast using a lattice-based model", J. R. Soc.
Interface 14:20170314, doi:10.1098/rsif.2017.0314. What these leave open is as in the program of Tronnolone et al. 2018,
"TAMMiCol: Tool for analysis of the morphology of microbial colonies", PLoS Comput. Biol. 14:e1006629,
doi:10.1371/journal.pcbi.1006629.

With r the distance of a pixel from the centroid, θ its angle, r_max the largest r, A the number of pixels:

Radial index. In 50 rings of one area, f_i = 50 n_i / A is the density of ring i over that of a disc of radius r_max
filled at random. r_out is half-way through the last ring with f_i ≥ 1, and

    I_r = 1 − r_out / r_max,

at most 0.005 for a disc, towards 1 for a core with long filaments. This is TAMMiCol's rule; unlike the CSR radius of
`filaments` it is meaningful for a disc too.

Angular index. Of the pixels at r ≥ r_CSR, in 48 sectors, f_j = 48 n_j / N:

    I_θ = √(var(f) / 47),    var(f) = (1/48) Σ_j (f_j − 1)²,

0 where all directions hold the same, 1 where one sector holds all. TAMMiCol has 50 sectors that start at −π. Here there
are 48, centred on the axes, so that no pixel lies on an edge, and turning by 90° or mirroring a colony permutes them.

Angular pair correlation. Of all pairs of different pixels at r ≥ r_CSR, with 360 sectors of 1° centred on the axes,

    g(Δ_s) = 360 (Σ_j n_j n_{j+s} − N [s = 0]) / (N (N − 1)),    Δ_s = 0°, 1°, … 180°,

1 on average over the circle (s = 0 … 359). TAMMiCol draws at most 1000 pixels and sorts their differences into 50 bins.

Spectrum. p_k = |(1/N) Σ exp(−i k θ)|² of the same pixels in the same sectors, k = 0 … 180; g and p are each other's
Fourier transform. The dominant wave number is the k of the largest p_k: the number of filaments, or of bunches of them,
in a turn. It is looked for from 1 to π r_CSR / δ (and at most to 180), where a wave at r_CSR is 2δ = 8 pixels long:
finer waves are the lattice's. TAMMiCol transforms g over [0, π], so that its wave numbers count periods in half a turn.
"""

import numpy as np
from jaxtyping import Float

from yeastfit.measure.statistics.filaments import filaments
from yeastfit.measure.statistics.pixels import TIE, PerPixel
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.numbers import Range

RINGS = 50
SECTORS = 48
DIRECTIONS = 360


def radial_index(distance: PerPixel) -> float:
    """I_r from the distances of all pixels; nan for a single pixel."""
    largest = distance.max()
    if largest == 0:
        return float("nan")
    ring = np.minimum((RINGS * (distance / largest) ** 2 + TIE).astype(int), RINGS - 1)
    density = np.bincount(ring, minlength=RINGS) * RINGS / len(distance)
    last = np.flatnonzero(density >= 1)[-1]
    return float(1 - 0.5 * (np.sqrt(last / RINGS) + np.sqrt((last + 1) / RINGS)))


def angular_index(angle: PerPixel) -> float:
    """I_θ of pixels at these angles; nan for none."""
    if not len(angle):
        return float("nan")
    density = SECTORS * _counts(angle, SECTORS) / len(angle)
    return float(np.sqrt(density.var() / (SECTORS - 1)))


def angular_pair_correlation(
    angle: PerPixel,
) -> tuple[Float[np.ndarray, " separation"], Float[np.ndarray, " separation"]]:
    """Δ in radians and g(Δ) of pixels at these angles; g is nan for fewer than two."""
    separations = np.radians(np.arange(DIRECTIONS // 2 + 1))
    total = len(angle)
    if total < 2:
        return separations, np.full(len(separations), np.nan)
    pairs = np.fft.irfft(np.abs(np.fft.rfft(_counts(angle, DIRECTIONS))) ** 2)[: len(separations)]
    pairs[0] -= total
    return separations, DIRECTIONS * pairs / (total * (total - 1.0))


def angular_spectrum(angle: PerPixel) -> Float[np.ndarray, " wave"]:
    """p_k of pixels at these angles, k = 0 … 180; nan for none."""
    if not len(angle):
        return np.full(DIRECTIONS // 2 + 1, np.nan)
    return np.abs(np.fft.rfft(_counts(angle, DIRECTIONS)) / len(angle)) ** 2


def dominant_wave_number(power: Float[np.ndarray, " wave"], finest: float = np.inf) -> float:
    """The first k from 1 to `finest` of the largest power p_k, nan where there is none (or only rounding)."""
    waves = np.arange(1, len(power))
    power = power[1:][waves <= finest]
    if not power.max(initial=0.0) > TIE**2:
        return float("nan")
    return float(1 + np.argmax(power >= power.max() * (1 - TIE)))


def radial_profile(distance: PerPixel, width: float, count: int) -> Float[np.ndarray, " ring"]:
    """Share of the plane that is colony at r_j = j `width`, j = 0 … `count` − 1, weighted as in `polar`.

    c_j = Σ w(r/width − j) / ∫ w(r/width − j) 2πr dr over pixels, w(u) = max(0, 1 − |u|); distances in pixels.
    """
    place = distance / width
    below = np.floor(place).astype(int)
    above = place - below
    weight = np.bincount(below, 1 - above, count + 1)[:count] + np.bincount(below + 1, above, count + 1)[:count]
    return weight / (np.pi * width**2 * np.maximum(2 * np.arange(count), 1 / 3))


def _counts(angle: PerPixel, sectors: int) -> Float[np.ndarray, " sector"]:
    """How many pixels lie in each sector, the first centred on angle 0."""
    sector = np.rint(angle * (sectors / (2 * np.pi))).astype(int) % sectors
    return np.bincount(sector, minlength=sectors).astype(float)


ENTRIES = (
    Statistic(
        "radial_index",
        0,
        "I_r: 1 − (radius up to which pixels are dense) / max_radius",
        mask=lambda p: radial_index(p.distance),
        may_vanish=True,
        possible=Range(0.0, 1.0),
    ),
    Statistic(
        "angular_index",
        0,
        "I_θ: spread of the area beyond csr_radius over directions, 0 to 1",
        mask=lambda p: angular_index(filaments(p).angle),
        may_vanish=True,
        possible=Range(0.0, 1.0),
    ),
    Statistic(
        "wave_number",
        0,
        "dominant wave number of the angular pair correlation beyond csr_radius, periods a turn",
        mask=lambda p: dominant_wave_number(angular_spectrum(filaments(p).angle), filaments(p).finest_wave),
        may_vanish=True,
        possible=Range(1.0),
    ),
)
