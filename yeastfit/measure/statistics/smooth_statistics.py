"""Statistics of a shape that a gradient can pass through (MODEL.md section 4).

A shape is an indicator φ in [0, 1] on a square grid: of a level set, φ = ½ + ½ tanh(−g/K) (source A.2, equation 8), or
of a micrograph, its mask. Both are blurred by one Gaussian of width `smoothing`, then

    A = ∬ φ,    P = ∬ |∇φ| (co-area formula, all boundaries),    C = P² / (4πA),    radius = ∬ φ |x − x̄| / A.

A perimeter depends on pixel size, blur and estimator; an image and a model that go through the same function at the
same spacing and smoothing can be compared. Blurring closes gaps narrower than about 2 · `smoothing` in both.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.measure.statistics.overlap import overlap_area, smooth_step
from yeastfit.measure.statistics.polar import Polar, polar_statistics
from yeastfit.model.active_window import extent_of_cells, on_window
from yeastfit.model.cells import level_set
from yeastfit.model.simulate import Snapshot


class SmoothStatistics(eqx.Module):
    """Statistics of one step of the model, differentiable where the relaxation is; lengths in L0.

    extent: side of the square around the origin that is looked at. spacing: of its grid. smoothing: width of the
    Gaussian. A boundary width of None in the relaxation takes the hard indicator, which blurring alone smooths.
    overlap: whether to add "overlap_area", of all cells wherever they are and of the relaxation's widths, which takes
    several times as long as the rest. polar: adds "max_radius", "radial_profile_0", … and "angular_spectrum_1", …
    """

    extent: float = eqx.field(static=True)
    spacing: float = eqx.field(static=True, default=0.1)
    smoothing: float = eqx.field(static=True, default=0.0)
    overlap: bool = eqx.field(static=True, default=False)
    polar: Polar | None = eqx.field(static=True, default=None)

    def __call__(self, snapshot: Snapshot) -> dict[str, Float[Array, ""]]:
        """Statistics by name (source table 3.1)."""

        def shape(points: int, snapshot: Snapshot) -> dict[str, Float[Array, ""]]:
            phi = indicator(snapshot, points, self.spacing)
            found = smooth_shape(phi, self.spacing, self.smoothing)
            return found | (smooth_polar(phi, self.spacing, self.smoothing, self.polar) if self.polar else {})

        cells, relaxation = snapshot.cells, snapshot.relaxation
        extent = extent_of_cells(cells, relaxation.reach)
        shapes = on_window(shape, extent, self.spacing, round(self.extent / self.spacing) + 1, snapshot)
        found = {**shapes, **node_statistics(snapshot)}
        if self.overlap:
            found["overlap_area"] = overlap_area(cells, relaxation.union, relaxation.boundary)
        return found

    def finish(self, observed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Nothing is left to do."""
        return observed


def node_statistics(snapshot: Snapshot) -> dict[str, Float[Array, ""]]:
    """What only nodes tell: μ, the number of cells and d̄, the mean distance of nodes from the origin."""
    weights = snapshot.colony.weights
    total = jnp.sum(weights)
    return {
        "growth_rate": snapshot.growth_rate,
        "mean_radius": jnp.sum(weights * _norm(*snapshot.colony.positions.T)) / total,
        "cell_count": total - 1.0,
    }


def indicator(snapshot: Snapshot, points: int, spacing: float) -> Float[Array, "x y"]:
    """φ of the colony's level set on a square of so many grid points a side around the origin."""
    relaxation, origin = snapshot.relaxation, -0.5 * spacing * (points - 1)
    g = level_set(snapshot.cells, relaxation.union, relaxation.reach, origin, spacing, points)
    return smooth_step(g, relaxation.boundary)


def smooth_shape(phi: Float[Array, "x y"], spacing: float, smoothing: float) -> dict[str, Float[Array, ""]]:
    """area, perimeter, compactness and radius of an indicator, blurred by `smoothing`; all in the units of `spacing`.

    |∇φ| is taken at the centres of the grid squares, with the error O(spacing² / smoothing²) of a second-order scheme.
    Outside the array φ is 0. An empty φ has area 0 and nan for compactness and radius.
    """
    phi = gaussian_blur(jnp.pad(phi, 1), smoothing / spacing)
    right = phi[1:, 1:] - phi[:-1, :-1]
    left = phi[1:, :-1] - phi[:-1, 1:]
    # the two diagonals of a grid square are perpendicular, each of length √2 h
    slope = _norm(right, left) / (jnp.sqrt(2.0) * spacing)
    area = jnp.sum(phi) * spacing**2
    perimeter = jnp.sum(slope) * spacing**2
    x = spacing * (jnp.arange(phi.shape[0]) - 0.5 * (phi.shape[0] - 1))[:, None]
    y = spacing * (jnp.arange(phi.shape[1]) - 0.5 * (phi.shape[1] - 1))[None, :]
    total = jnp.sum(phi)
    distance = _norm(x - jnp.sum(x * phi) / total, y - jnp.sum(y * phi) / total)
    return {
        "area": area,
        "perimeter": perimeter,
        "compactness": perimeter**2 / (4 * jnp.pi * area),
        "radius": jnp.sum(phi * distance) / total,
    }


def smooth_polar(
    phi: Float[Array, "x y"], spacing: float, smoothing: float, polar: Polar
) -> dict[str, Float[Array, ""]]:
    """What `smooth_shape` leaves out, of the same blurred indicator, one number a name; see `polar`.

    max_radius, radial_profile_0 … (share of the plane that is colony, ring by ring), angular_spectrum_1 … (power).
    """
    found = polar_statistics(gaussian_blur(phi, smoothing / spacing), spacing, polar)
    named = {"max_radius": found["max_radius"]}
    named |= {f"radial_profile_{j}": found["radial_profile"][j] for j in range(polar.rings)}
    return named | {f"angular_spectrum_{k + 1}": found["angular_spectrum"][k] for k in range(polar.waves)}


def gaussian_blur(phi: Float[Array, "x y"], sigma: float) -> Float[Array, "wide high"]:
    """Separable Gaussian of `sigma` pixels, cut at 4 sigma, zero outside; the array grows by the cut on each side."""
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


def _norm(x: Float[Array, "..."], y: Float[Array, "..."]) -> Float[Array, "..."]:
    """√(x² + y²), with derivative 0 at 0."""
    squared = x**2 + y**2
    zero = squared == 0  # not `> 0`: nan stays nan
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, squared)))
