"""The smooth indicator of a colony and what statistics take from it; a gradient passes through all of it.

A colony is an indicator φ in [0, 1] on a square grid. Of a level set g it is φ = ½ + ½ tanh(−g / K), as in "A Novel
Algebraic Agent Based Model for Pseudohyphal Baker's Yeast Colony Morphology", appendix A.2, equation 8; of a micrograph
it is the mask. Blurred by a Gaussian, it has

    A = ∬ φ,    P = ∬ |∇φ| (co-area formula, all boundaries),    x̄ = ∬ φ x / A,    radius = ∬ φ |x − x̄| / A.
"""

from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.norm import norm


@dataclass(frozen=True, eq=False)
class Indicator:
    """A blurred indicator φ and its functionals, each computed once and only when asked for.

    Attributes:
        phi: φ [x, y] on a square grid; 0 along the edge of the array.
        spacing: Of the grid. All lengths are in its unit.
    """

    phi: Float[Array, "x y"]
    spacing: float

    @classmethod
    def blurred(cls, phi: Float[Array, "x y"], spacing: float, smoothing: float) -> "Indicator":
        """Blur an indicator by a Gaussian.

        Arguments:
            phi: φ, 0 outside the array.
            spacing: Of its grid.
            smoothing: Standard deviation of the blur, in the same unit.
        """
        return cls(gaussian_blur(_framed(phi), smoothing / spacing), spacing)

    @cached_property
    def area(self) -> Float[Array, ""]:
        """A = ∬ φ."""
        return jnp.sum(self.phi) * self.spacing**2

    @cached_property
    def slope(self) -> Float[Array, "square_x square_y"]:
        """|∇φ| at the centres of the grid squares, with the error O(spacing² / smoothing²) of second order."""
        phi = self.phi
        right = phi[1:, 1:] - phi[:-1, :-1]
        left = phi[1:, :-1] - phi[:-1, 1:]
        # the two diagonals of a grid square are perpendicular, each of length √2 spacing
        return norm(right, left) / (jnp.sqrt(2.0) * self.spacing)

    @cached_property
    def perimeter(self) -> Float[Array, ""]:
        """P = ∬ |∇φ|, the length of all boundaries."""
        return jnp.sum(self.slope) * self.spacing**2

    @cached_property
    def distance(self) -> Float[Array, "x y"]:
        """|x − x̄| [x, y] of every grid point from the centroid; nan where φ is empty."""
        phi, spacing = self.phi, self.spacing
        x = spacing * (jnp.arange(phi.shape[0]) - 0.5 * (phi.shape[0] - 1))[:, None]
        y = spacing * (jnp.arange(phi.shape[1]) - 0.5 * (phi.shape[1] - 1))[None, :]
        total = jnp.sum(phi)
        return norm(x - jnp.sum(x * phi) / total, y - jnp.sum(y * phi) / total)

    @cached_property
    def radius(self) -> Float[Array, ""]:
        """Mean distance of the colony from its centroid; nan where φ is empty."""
        return jnp.sum(self.phi * self.distance) / jnp.sum(self.phi)


def _framed(phi: Float[Array, "x y"]) -> Float[Array, "wide high"]:
    """φ in a frame of zeros, one point wide; joined, as XLA would compute a padded one point by point on a CPU."""
    row = jnp.zeros_like(phi[:1])
    longer = jnp.concatenate([row, phi, row])
    column = jnp.zeros_like(longer[:, :1])
    return jnp.hstack([column, longer, column])


def gaussian_blur(phi: Float[Array, "x y"], sigma: float) -> Float[Array, "wide high"]:
    """Convolve with a separable Gaussian.

    Arguments:
        phi: An image; 0 outside the array.
        sigma: Standard deviation in pixels. The kernel is cut at 4 of them.

    Returns:
        The blurred image, which is larger by the cut on each side.
    """
    if sigma == 0:
        return phi
    half = int(np.ceil(4 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    for _ in range(2):
        padded = jnp.pad(phi, ((2 * half, 2 * half), (0, 0)))
        rows = phi.shape[0] + 2 * half
        phi = sum(float(k) * jax.lax.slice_in_dim(padded, i, i + rows) for i, k in enumerate(kernel)).T  # type: ignore[union-attr]
    return phi
