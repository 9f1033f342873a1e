"""Largest radius, radial profile and angular spectrum of an indicator φ; a gradient passes through all of them.

With φ blurred (`indicator`), x̄ and A its centroid and area, r = |x − x̄| and θ the angle of x − x̄:

Largest radius. ψ = 3t² − 2t³, t = min(1, max(0, 2φ − 1)), is 0 outside the contour φ = ½; with p = 32

    r_max = (p + 3) / (p + 2) · ∬ ψ r^(p+1) / ∬ ψ r^p.

This is exact for a disc and for any shape whose far end is a sector. It is 0.1 % short for a filament of constant
width, and up to 3 % for one that tapers to a point; what ψ leaves out of a soft edge comes on top. One pixel decides
the largest radius of a mask, the last few per cent of the radius decide this one.

Radial profile. The share of the plane that is colony at r_j = j · ring, in hat functions w(u) = max(0, 1 − |u|):

    c_j = ∬ φ w(r / ring − j) / ∫ w(r / ring − j) 2πr dr,    j = 0 … rings − 1,

so that c_0 π ring² / 3 + Σ_{j ≥ 1} c_j 2π r_j ring = A where the colony ends before the last ring. `spatial_indices`
has the same for a mask; divided by ρ = A / (π r_max²) it is the f_i of `filaments`.

Angular spectrum. With v = ½ + ½ tanh((r − r_A) / ring) and r_A = √(A / π), the radius of the disc of the same area,

    p_k = |∬ φ v exp(−i k θ)|² / (∬ φ v)²,    k = 1 … waves:

the p_k of `spatial_indices`, beyond a soft circle r_A instead of the hard r_CSR, which a gradient cannot pass through.
Where less than `ring` of a disc's edge lies beyond it, only rounding is left of p.

All are smooth in φ and in what φ depends on, but for kinks of the hats' slopes at single points. They are nan for an
empty φ.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from yeastfit.errors import InputError

_POWER = 32


@dataclass(frozen=True)
class Polar:
    """Which rings and wave numbers to look at.

    Attributes:
        ring: Width of a ring, in the unit of the grid's spacing.
        rings: How many.
        waves: How many wave numbers, from 1.

    Raises:
        InputError: The width is not positive, or a count is negative.
    """

    ring: float
    rings: int
    waves: int

    def __post_init__(self) -> None:
        if not self.ring > 0:
            raise InputError(f"ring: got {self.ring!r}, need a positive width")
        for name in ("rings", "waves"):
            if getattr(self, name) < 0:
                raise InputError(f"{name}: got {getattr(self, name)!r}, need a count")


def polar_statistics(phi: Float[Array, "x y"], spacing: float, polar: Polar) -> dict[str, Float[Array, "..."]]:
    """Compute max_radius, radial_profile [ring] and angular_spectrum [wave] of a blurred indicator.

    Arguments:
        phi: The indicator.
        spacing: Of its grid, which gives the unit of length.
        polar: Rings and waves.

    Returns:
        The three, by name.
    """
    total = jnp.sum(phi)
    x, y = (spacing * (jnp.arange(n) - 0.5 * (n - 1)) for n in phi.shape)
    x = x[:, None] - jnp.sum(x[:, None] * phi) / total
    y = y[None, :] - jnp.sum(y[None, :] * phi) / total
    squared = x**2 + y**2
    centre = squared == 0
    distance = jnp.where(centre, 0.0, jnp.sqrt(jnp.where(centre, 1.0, squared)))
    angle = jnp.arctan2(y, jnp.where(centre, 1.0, x))
    inner = jnp.sqrt(jnp.where(total > 0, total, jnp.nan) / jnp.pi) * spacing
    outer = 0.5 * phi * (1 + jnp.tanh((distance - inner) / polar.ring))
    return {
        "max_radius": _max_radius(phi, distance),
        "radial_profile": _radial_profile(phi, distance, spacing, polar),
        "angular_spectrum": _angular_spectrum(outer, angle, polar.waves),
    }


def _max_radius(phi: Float[Array, "x y"], distance: Float[Array, "x y"]) -> Float[Array, ""]:
    t = jnp.clip(2 * phi - 1, 0, 1)
    inside = t**2 * (3 - 2 * t)
    unit = jax.lax.stop_gradient(jnp.max(jnp.where(t > 0, distance, 0.0)))
    unit = jnp.where(unit == 0, 1.0, unit)
    weight = inside * (distance / unit) ** _POWER
    return (_POWER + 3) / (_POWER + 2) * jnp.sum(weight * distance) / jnp.sum(weight)


def _radial_profile(
    phi: Float[Array, "x y"], distance: Float[Array, "x y"], spacing: float, polar: Polar
) -> Float[Array, " ring"]:
    place = distance / polar.ring
    below = jax.lax.stop_gradient(jnp.floor(place).astype(int))
    above = place - below
    held = jnp.zeros(polar.rings).at[below].add(phi * (1 - above), mode="drop")
    held = held.at[below + 1].add(phi * above, mode="drop")
    return held * spacing**2 / (jnp.pi * polar.ring**2 * jnp.maximum(2.0 * jnp.arange(polar.rings), 1 / 3))


def _angular_spectrum(outer: Float[Array, "x y"], angle: Float[Array, "x y"], waves: int) -> Float[Array, " wave"]:
    weight = outer / jnp.sum(outer)
    numbers = 1.0 + jnp.arange(waves)
    real, imaginary = jax.lax.map(
        lambda k: (jnp.sum(weight * jnp.cos(k * angle)), jnp.sum(weight * jnp.sin(k * angle))), numbers
    )
    return real**2 + imaginary**2
