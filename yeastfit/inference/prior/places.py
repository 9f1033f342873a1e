"""Where the colonies of each λ are: at λ, or at several places around it, each with its share of them."""

from dataclasses import dataclass
from typing import Generic

import numpy as np
from jaxtyping import Float

from yeastfit.inference.prior.prior import Table


@dataclass(frozen=True)
class Places(Generic[Table]):
    """Places of rows of λ, by NumPy or JAX.

    Attributes:
        values: λ there.
        shares: Of the colonies of a row, which add up to 1. The same in all rows.
    """

    values: Float[Table, "row place free"]
    shares: Float[np.ndarray, " place"]

    @staticmethod
    def of(values: "Float[np.ndarray, 'row free'] | Places[np.ndarray]") -> "Places[np.ndarray]":
        """The places given, or λ itself where rows of it are."""
        return values if isinstance(values, Places) else Places(values[:, None], np.ones(1))

    def rows(self, which: slice) -> "Places[Table]":
        """Those of some rows."""
        return Places(self.values[which], self.shares)
