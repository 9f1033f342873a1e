"""Polynomials in several variables: their terms, points to learn them from, and least squares.

With terms t(x) of degree ≤ d, values y at n points x follow y = Bᵀ t(x) + e. B is the least-squares solution, and

    cov e = EᵀE / (n − p),    E the n residuals, p the number of terms.

Low-discrepancy points cover a box more evenly than random ones (scrambled Sobol': Owen 1998,
doi:10.1006/jcom.1998.0487).
"""

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float


def monomials(x: Any, degree: int = 2) -> Any:
    """Monomials up to a degree, by NumPy or JAX, whichever `x` is an array of.

    Arguments:
        x: Variables [..., variable].
        degree: The highest.

    Returns:
        [..., term]: 1, the variables, their products of two, and so on.
    """
    library, size = x.__array_namespace__(), x.shape[-1]
    columns = [library.ones_like(x[..., :1])]
    for power in range(1, degree + 1):
        chosen = np.array(list(combinations_with_replacement(range(size), power)))
        columns.append(library.prod(x[..., chosen], axis=-1))
    return library.concat(columns, axis=-1)


def sobol_points(count: int, size: int, seed: int | np.random.SeedSequence) -> Float[np.ndarray, "point variable"]:
    """The first points of a scrambled Sobol' sequence in the unit cube.

    Arguments:
        count: How many, at least 1.
        size: Dimensions of the cube.
        seed: Of the scrambling.
    """
    sequence = scipy.stats.qmc.Sobol(size, rng=np.random.default_rng(seed))
    return sequence.random_base2(max(count - 1, 0).bit_length())[:count]


@dataclass(frozen=True)
class PolynomialRegression:
    """Least squares on a table of terms.

    Attributes:
        coefficients: B.
        covariance: cov e.
        freedom: n − p, at least 1.
    """

    coefficients: Float[np.ndarray, "term column"]
    covariance: Float[np.ndarray, "column column"]
    freedom: int

    @staticmethod
    def of(terms: Float[np.ndarray, "row term"], values: Float[np.ndarray, "row column"]) -> "PolynomialRegression":
        """Regress values on terms, one row a point."""
        coefficients = np.linalg.lstsq(terms, values, rcond=None)[0]
        rest = values - terms @ coefficients
        freedom = max(1, len(terms) - terms.shape[1])
        return PolynomialRegression(coefficients, rest.T @ rest / freedom, freedom)
