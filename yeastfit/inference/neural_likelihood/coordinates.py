"""The coordinates that networks see: those of the prior, standardised; of shares their angular transform.

A share λ = low + (high − low) u of what lies between two bounds, which has a beta distribution, is seen as

    x = arcsin √u

(Anscombe 1948, doi:10.1093/biomet/35.3-4.246), in which the chance variation of a share observed in so many trials is
the same everywhere. What a simulator does near a share of 0 or 1 changes fast there, and less so in x: of 3496 colonies
of the off-lattice model near a posterior, held out in thirds, the log score of a colony is 9.31 instead of 9.20, and
that of whether it is of the data's kind −0.026 instead of −0.032. The logit spreads such shares still more, but it has
no ends: beyond the last simulation, at u of 10⁻³ to 10⁻⁴, there is room for what quadratics extrapolate, and rounds
went after posteriors there.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from yeastfit.inference.prior.prior import Prior, Table

Values = Float[np.ndarray, "row free"]


class Coordinates(eqx.Module):
    """x, standardised: log λ where the prior is one of log λ, arcsin √u of shares, λ of others."""

    prior: Prior = eqx.field(static=True)
    shift: Float[np.ndarray | Array, " free"]
    scale: Float[np.ndarray | Array, " free"]

    @staticmethod
    def of(prior: Prior, values: Values) -> "Coordinates":
        """Standardised over these values."""
        one = Coordinates(prior, np.zeros(len(prior.free)), np.ones(len(prior.free)))
        plain = one.of_values(values)
        return Coordinates(prior, plain.mean(axis=0), plain.std(axis=0))

    def of_values(self, values: Values) -> Values:
        """x of λ."""
        return self.of_prior(self.prior.coordinates(values))

    def of_prior(self, x: Float[Table, "*row free"]) -> Float[Table, "*row free"]:
        """x of the prior's coordinates, by NumPy or JAX, whichever they are an array of."""
        library = x.__array_namespace__()
        shares = np.array([one.is_share for one in self.prior.distributions.values()])
        low, high = np.where(shares, self.prior.support.T, [[0.0], [1.0]])
        angle = library.asin(library.sqrt(library.clip((x - low) / (high - low), 0.0, 1.0)))
        return (library.where(shares, angle, x) - self.shift) / self.scale
