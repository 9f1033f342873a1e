"""Masks with known shape, and hypothesis's strategies for masks without."""

from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

OFF = (0.2, 0.3)  # off the lattice's symmetries


def polar_mask(
    radius: Callable[[np.ndarray], np.ndarray], largest: float, offset: tuple[float, float] = OFF
) -> np.ndarray:
    """{r ≤ radius(θ)} around `offset` from the middle, θ upwards positive."""
    half = int(np.ceil(largest)) + 3
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    x, y = x - offset[0], offset[1] - y
    return np.hypot(x, y) <= radius(np.arctan2(y, x))


def disc(radius: float, offset: tuple[float, float] = OFF) -> np.ndarray:
    return polar_mask(lambda angle: np.full_like(angle, radius), radius, offset)


def star(radius: float, amplitude: float, arms: int, turn: float = 0.3) -> np.ndarray:
    """r ≤ R (1 + a cos(m θ − m turn))."""
    return polar_mask(lambda angle: star_radius(angle - turn, radius, amplitude, arms), radius * (1 + amplitude))


def star_radius(angle: np.ndarray, radius: float, amplitude: float, arms: int) -> np.ndarray:
    return radius * (1 + amplitude * np.cos(arms * angle))


def wheel(core: float, spokes: int, reach: float, width: float, turn: float = 0.3) -> np.ndarray:
    """A disc with straight filaments of one width that reach out to `reach`."""
    half = int(np.ceil(reach)) + 3
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    z = (x - OFF[0]) - 1j * (y - OFF[1])
    mask = np.abs(z) <= core
    for k in range(spokes):
        along = z * np.exp(-1j * (turn + 2 * np.pi * k / spokes))
        mask |= (np.abs(along.imag) <= width / 2) & (along.real >= 0) & (along.real <= reach)
    return mask


noise = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))).filter(np.any)


@st.composite
def blobs(draw: st.DrawFn) -> np.ndarray:
    """Some discs on 48 × 64 pixels: several objects, holes, filaments of beads."""
    y, x = np.mgrid[:48, :64]
    mask = np.zeros((48, 64), dtype=bool)
    for _ in range(draw(st.integers(1, 12))):
        column, row, radius = draw(st.integers(0, 63)), draw(st.integers(0, 47)), draw(st.integers(0, 14))
        mask |= (x - column) ** 2 + (y - row) ** 2 <= radius**2
    return mask


masks = noise | blobs()


def with_bumps(mask: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A tenth of the pixels at the edge turned, on either side of it."""
    outside, inside = ndimage.binary_dilation(mask) & ~mask, mask & ~ndimage.binary_erosion(mask)
    return mask ^ ((outside | inside) & (rng.random(mask.shape) < 0.1))
