"""Directions in log λ, in words.

Along a direction v every λ_k is multiplied by a power v_k of one number. Data that do not notice see only products of
powers whose exponents w have w · v = 0: for two parameters there is one, λ_a^{w_a} λ_b^{w_b} with w = (v_b, −v_a)
(sloppy directions: Gutenkunst et al. 2007, doi:10.1371/journal.pcbi.0030189).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import qr

LOADING = 0.1  # of a unit vector: smaller components are not named
SMALL = 0.3  # of log λ, up to which an error is told in percent


def loaded(direction: Float[np.ndarray, " free"]) -> list[int]:
    """Indices of the components that are not small."""
    return [int(k) for k in np.flatnonzero(np.abs(direction) > LOADING * np.linalg.norm(direction))]


def power_law(names: Sequence[str], exponents: Sequence[float] | np.ndarray) -> str:
    """A product of powers, such as "mobility · diffusivity^0.5 / aspect_ratio^2"; exponents to two digits."""
    above = [_power(name, x) for name, x in zip(names, exponents, strict=True) if x > 0]
    below = [_power(name, -x) for name, x in zip(names, exponents, strict=True) if x < 0]
    return " / ".join([" · ".join(above) or "1", *below])


def combination(names: Sequence[str], direction: Float[np.ndarray, " free"]) -> tuple[str, float]:
    """λ's product of powers along a direction, its largest exponent 1, and that component of the direction."""
    kept = loaded(direction)
    largest = max(kept, key=lambda k: abs(direction[k]))
    return power_law([names[k] for k in kept], direction[kept] / direction[largest]), float(abs(direction[largest]))


def percent(error: float) -> str:
    """An error of log λ: in percent, and as a factor where it is large."""
    if not np.isfinite(error):
        return "unknown"
    return f"{100 * error:.2g} %" if error <= SMALL else f"a factor of {np.exp(error):.2g}"


def blind_sentence(
    names: Sequence[str], direction: Float[np.ndarray, " free"], error: float = np.inf, hidden: float = np.inf
) -> str:
    """What data that do not see a direction leave open, and that something must be fixed.

    Arguments:
        names: Of the parameters.
        direction: In log λ.
        error: Of log λ along it; infinite where there is none.
        hidden: Where there is none, the smallest error that the noise of the derivatives could hide.
    """
    kept = loaded(direction)
    chosen, v = [names[k] for k in kept], direction[kept]
    rest = f" (the rest is known to {percent(error)} only)" if np.isfinite(error) else ""
    if np.isfinite(hidden) and not rest:
        rest = f" (as far as this many runs tell: the noise of the derivatives hides errors above {percent(hidden)})"
    if len(chosen) == 1:
        return f"the data do not see {chosen[0]}{rest}: fix it"
    if len(chosen) == 2:
        return f"{chosen[0]} and {chosen[1]} only enter as {power_law(chosen, [1.0, -v[0] / v[1]])}{rest}: fix one"
    first = int(np.argmax(np.abs(v)))
    others = [k for k in range(len(chosen)) if k != first]
    together = ", ".join(f"{chosen[k]} as {chosen[first]}^{_exponent(v[k] / v[first])}" for k in others)
    return f"the data do not notice when {chosen[first]} changes, and with it {together}{rest}: fix one"


def sparse_basis(directions: Float[np.ndarray, "direction free"]) -> Float[np.ndarray, "direction free"]:
    """Unit vectors that span the same, each with one parameter that no other has: echelon form by pivoted QR."""
    count = len(directions)
    if count < 2:
        return directions
    pivots = qr(directions, mode="economic", pivoting=True)[2][:count]
    basis = np.linalg.solve(directions[:, pivots], directions)
    return basis / np.linalg.norm(basis, axis=1, keepdims=True)


def _power(name: str, exponent: float) -> str:
    text = _exponent(exponent)
    return name if text == "1" else f"{name}^{text}"


def _exponent(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
