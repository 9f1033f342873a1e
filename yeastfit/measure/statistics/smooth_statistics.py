"""Statistics that a gradient passes through, of a simulated colony or of a mask, by one estimator.

Both are an indicator φ in [0, 1] on a square grid (`indicator` has the equations): of a simulation ½ + ½ tanh(−g / K)
of its level set g, of a micrograph its mask. Both are blurred by one Gaussian. A perimeter depends on pixel size, blur
and estimator; an image and a model that go through the same function at the same spacing and smoothing can be compared.
Blurring closes gaps narrower than about twice its width in both.
"""

import math
from collections.abc import Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import skimage
from jaxtyping import Array, Bool, Float

from yeastfit.errors import InputError
from yeastfit.measure.statistics.indicator import Indicator, gaussian_blur
from yeastfit.measure.statistics.polar import Polar, polar_statistics
from yeastfit.measure.statistics.registry import STATISTICS, check_names, names_with, recorded
from yeastfit.model.active_window import extent_of_cells, on_window
from yeastfit.model.cell_overlap import smooth_step
from yeastfit.model.snapshot import Snapshot


class SmoothStatistics(eqx.Module):
    """Records smooth statistics of a simulation; differentiable where the relaxation is. Lengths are in L0.

    Attributes:
        extent: Side of the square around the origin that is looked at.
        spacing: Of its grid.
        smoothing: Standard deviation of the blur.
        polar: Adds "max_radius", "radial_profile_0", … and "angular_spectrum_1", … on these rings and waves.
        statistics: Names of statistics with a smooth form or a form for nodes; by default `registry.recorded`.

    A boundary width of None in the relaxation takes the hard indicator, which blurring alone smooths.

    Raises:
        InputError: A name is not such a statistic.
    """

    extent: float = eqx.field(static=True)
    spacing: float = eqx.field(static=True, default=0.1)
    smoothing: float = eqx.field(static=True, default=0.0)
    polar: Polar | None = eqx.field(static=True, default=None)
    statistics: tuple[str, ...] = eqx.field(static=True, default_factory=lambda: recorded("smooth"))

    def __check_init__(self) -> None:
        check_names(self.statistics, "smooth", "nodes")

    def __call__(self, snapshot: Snapshot) -> dict[str, Float[Array, ""]]:
        """Statistics of one step, by name."""
        names = tuple(name for name in self.statistics if STATISTICS[name].smooth)

        def shape(points: int, snapshot: Snapshot) -> dict[str, Float[Array, ""]]:
            phi = indicator(snapshot, points, self.spacing)
            found = smooth_shape(phi, self.spacing, self.smoothing, names)
            return found | (smooth_polar(phi, self.spacing, self.smoothing, self.polar) if self.polar else {})

        extent = extent_of_cells(snapshot.cells, snapshot.relaxation.reach)
        shapes = on_window(shape, extent, self.spacing, round(self.extent / self.spacing) + 1, snapshot)
        return {**shapes, **node_statistics(snapshot, self.statistics)}

    def finish(self, observed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Nothing is left to do."""
        return observed


def node_statistics(snapshot: Snapshot, names: Iterable[str] | None = None) -> dict[str, Float[Array, ""]]:
    """Statistics that only nodes tell, of one step of a simulation.

    Arguments:
        snapshot: The step.
        names: Of statistics; those that are not of nodes are left out. By default those that simulations record.

    Returns:
        Values by name, in L0.
    """
    entries = (STATISTICS[name] for name in (recorded("smooth") if names is None else names))
    return {entry.name: entry.nodes(snapshot) for entry in entries if entry.nodes}


def indicator(snapshot: Snapshot, points: int, spacing: float) -> Float[Array, "x y"]:
    """φ of the colony's level set on a square of so many grid points a side around the origin."""
    relaxation, origin = snapshot.relaxation, -0.5 * spacing * (points - 1)
    g = snapshot.level_set(relaxation.reach, origin, spacing, points)
    return smooth_step(g, relaxation.boundary)


def smooth_shape(
    phi: Float[Array, "x y"], spacing: float, smoothing: float, names: tuple[str, ...] | None = None
) -> dict[str, Float[Array, ""]]:
    """Measure an indicator, blurred.

    Arguments:
        phi: φ on a square grid; 0 outside the array.
        spacing: Of the grid, in any unit of length.
        smoothing: Standard deviation of the blur, in the same unit.
        names: Of statistics with a smooth form; all by default.

    Returns:
        The statistics by name, in the unit of `spacing`. An empty φ has area 0 and nan for compactness and radius.
    """
    blurred = Indicator.blurred(phi, spacing, smoothing)
    entries = (STATISTICS[name] for name in (names_with("smooth") if names is None else names))
    found = {entry.name: entry.smooth(blurred) for entry in entries if entry.smooth}
    for name, value in found.items():
        if not isinstance(value, float | int | np.number | Array) or jnp.ndim(value):
            what = f"an array of shape {jnp.shape(value)}" if isinstance(value, Array) else repr(value)
            raise InputError(f"statistic {name}: its smooth gives {what}, need one number")
    return found


def smooth_polar(
    phi: Float[Array, "x y"], spacing: float, smoothing: float, polar: Polar
) -> dict[str, Float[Array, ""]]:
    """Measure where the colony lies around its centroid, by the same blurred indicator; see `polar`.

    Returns:
        max_radius; radial_profile_0, …, the share of the plane that is colony, ring by ring; angular_spectrum_1, …,
        the power of each wave.
    """
    found = polar_statistics(gaussian_blur(phi, smoothing / spacing), spacing, polar)
    named = {"max_radius": found["max_radius"]}
    named |= {f"radial_profile_{j}": found["radial_profile"][j] for j in range(polar.rings)}
    return named | {f"angular_spectrum_{k + 1}": found["angular_spectrum"][k] for k in range(polar.waves)}


def measure_mask_smoothly(
    mask: Bool[np.ndarray, "row column"],
    pixel_size: float,
    statistics: Iterable[str] | None = None,
    *,
    spacing: float,
    smoothing: float,
) -> dict[str, float]:
    """Measure a mask as `SmoothStatistics` measures a simulation.

    Arguments:
        mask: True where the colony is.
        pixel_size: In any unit of length, which is the result's.
        statistics: Names of statistics with a smooth form; all by default.
        spacing: Of the grid that the mask is resampled to.
        smoothing: Standard deviation of the blur.

    Returns:
        The statistics by name.

    Raises:
        InputError: Pixels are too coarse for the grid, or a name is not such a statistic.
    """
    if pixel_size > 2.5 * spacing:
        raise InputError(
            f"pixel size is {pixel_size:.3g}, at most {2.5 * spacing:.3g} resolves a cell well enough to fit"
        )
    names = names_with("smooth") if statistics is None else check_names(statistics, "smooth")
    scale = pixel_size / spacing
    phi = np.pad(mask, math.ceil(2 / scale)).astype(np.float32)
    if abs(scale - 1) > 1e-3:
        phi = skimage.transform.rescale(phi, scale, order=1, anti_aliasing=scale < 1)
    values = _smooth_shape(jnp.asarray(phi), spacing, smoothing, names)
    return {name: float(values[name]) for name in names}


_smooth_shape = jax.jit(smooth_shape, static_argnums=(1, 2, 3))
