"""Every smoothing width of the model in one object, and the hard limit (docs/model.md, section 5).

| hard rule                   | relaxed rule                                   | width      |
|-----------------------------|------------------------------------------------|------------|
| union of cells, min_k f_k   | -s log Σ_k w_k exp(-f_k / s)                   | `union`    |
| contact, H(λ4 - r)          | ramp: 0 for r ≥ λ4, rising to 1 at r = λ4 - w; | `contact`, |
|                             | or with the share o of its width beyond λ4     | `overhang` |
| indicator of {g ≤ 0}        | ½ + ½ tanh(-g / K)                             | `boundary` |
| ⌈·⌉ births                  | fractional births that last                    | `births`   |
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.numbers import Range

WIDTHS = Range(1e-6, 1e6)


def _as_width(name: str, value: float | Array | None) -> Array | None:
    """None and 0 are the hard rule, anything else a width."""
    if value is None or (isinstance(value, int | float) and value == 0):
        return None
    if isinstance(value, int | float) and 0 < value < np.inf:
        WIDTHS.read(value, f"relaxation width {name}")
    return jax.device_put(np.asarray(value, jnp.result_type(float))) if isinstance(value, int | float) else value


class Relaxation(eqx.Module):
    """Smoothing widths. A width of None (or 0) selects the hard rule for that law.

    The default widths keep the bias small (docs/convergence.md); derivatives need wider ones.

    Attributes:
        union: s of smoothmin, in units of the dimensionless f, at least 0.0125.
        contact: w of the contact ramp, in L0. Contacts do not chatter while Δt λ3 / w is at most 1.
        boundary: K of the smoothed indicator, in units of f.
        births: "fractional" or "whole".
        turning: Share of the derivative of a contact's direction that derivatives include, in [0, 1]; no value depends
            on it. None and 1 are exact. A compressed contact is unstable across its direction, so exact derivatives of
            one colony grow without bound; a smaller share gives an ensemble's mean derivative with far less scatter, at
            some bias.
        overhang: o in [0, 1]. A ramp inside λ4 makes colonies tighter, the wider the more; a quarter of it outside
            compensates: at w = 0.2 and 250 cells (λ = 0.1, 5, 5, 0.5, 1, 1, 0.7) d̄ and A are 1 and 2 % below the hard
            model's instead of 3 and 7 %.

    Raises:
        InputError: A width is not positive, a share not in [0, 1], or `births` neither of the two.
    """

    union: Float[Array, ""] | None
    contact: Float[Array, ""] | None
    boundary: Float[Array, ""] | None
    births: Literal["fractional", "whole"] = eqx.field(static=True)
    turning: Float[Array, ""] | None
    overhang: Float[Array, ""] | None

    def __init__(
        self,
        union: float | Array | None = 0.025,
        contact: float | Array | None = 0.05,
        boundary: float | Array | None = 0.2,
        births: Literal["fractional", "whole"] = "fractional",
        turning: float | Array | None = None,
        overhang: float | Array | None = None,
    ) -> None:
        self.union, self.contact = _as_width("union", union), _as_width("contact", contact)
        self.boundary = _as_width("boundary", boundary)
        self.births = births
        self.turning, self.overhang = (
            None if share is None else jnp.asarray(share, jnp.result_type(float)) for share in (turning, overhang)
        )

    def __check_init__(self) -> None:
        for name in ("union", "contact", "boundary"):
            value = getattr(self, name)
            if value is None or isinstance(value, jax.core.Tracer):
                continue
            if not (np.isfinite(value) & (np.asarray(value) > 0)).all():
                raise InputError(f"relaxation width {name} is {value}, it must be above 0, or None for the hard rule")
        for name in ("turning", "overhang"):
            value = getattr(self, name)
            if not (value is None or isinstance(value, jax.core.Tracer) or 0 <= float(value) <= 1):
                raise InputError(f"{name} is {value}, it must lie between 0 and 1, or be None")
        union = self.union
        if isinstance(union, jax.Array) and not isinstance(union, jax.core.Tracer) and np.asarray(union) < 0.0125:
            raise InputError(
                f"relaxation width union is {float(union):.4g}, it must be at least 0.0125, where exp(1 / union) "
                "still fits single precision, or None for the hard rule"
            )
        if self.births not in ("fractional", "whole"):
            raise InputError(f"births is {self.births!r}, it must be 'fractional' or 'whole'")

    def contact_reach(self, radius: Float[Array, ""]) -> Float[Array, ""]:
        """Distance beyond which nodes do not push each other: λ4 + o w."""
        if self.contact is None or self.overhang is None:
            return radius
        return radius + self.overhang * self.contact

    @property
    def union_reach(self) -> Float[Array, ""] | float:
        """r² = f + 1 beyond which a cell leaves no trace in {g < 0}: e⁻¹² of the union's boundary value."""
        return 1.0 if self.union is None else 1.0 + 12.0 * self.union

    @property
    def reach(self) -> Float[Array, ""] | float:
        """r² beyond which it leaves none in the smoothed indicator either: tanh is saturated to e⁻⁹."""
        return self.union_reach if self.boundary is None else jnp.maximum(self.union_reach, 1.0 + 4.5 * self.boundary)


HARD = Relaxation(union=None, contact=None, boundary=None, births="whole")
"""No smoothing widths, the hard model."""
