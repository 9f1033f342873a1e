"""Where a daughter is put: on the outline of its mother, its near pole touching it.

A mother at (x, y) in direction θ with semi-axes A, B, a budding angle β and a daughter with semi-axis a along its
direction:

    φ     = β + atan((A − B) tan β) / (B + A tan² β)                    parametric angle of the point on the outline
    X     = x + A cos φ cos θ − B sin φ sin θ + a cos(θ + β)
    Y     = y + A cos φ sin θ + B sin φ cos θ + a sin(θ + β)
    θ_new = θ + β

Angles by the daughter's form, each with the same chance: sated ±7π/16 and π ± 7π/16 (bipolar, nearly across the
mother), pseudohyphal ±π/16 (distal). All are multiples of π/16, and so is every θ, as the first cell lies along x: a
direction is a whole number, and there are 512 displacements (X − x, Y − y) in all.

Source: Li et al. 2024 (see `growth`). Lengths are in pixels of their photographs, 0.646 a µm, in which A and B must be:
the numerator's bracket closes one factor early in their program, so φ depends on the unit. The parametric angle whose
polar angle is β would be β + atan((A − B) tan β / (B + A tan² β)); that would move the point by 0.54 pixels at most.
"""

import numpy as np
from jaxtyping import Float

PIXELS_PER_UM = 323 / 500
SEMI_AXES = PIXELS_PER_UM * np.array([[4.2, 3.0], [6.7, 1.9]])
"""Along and across a cell's direction, in pixels: of sated cells, and of pseudohyphal ones."""

DIRECTIONS = 32
"""Directions in a turn, multiples of π/16."""

BUDDING = np.array([[7, -7, 16 + 7, 16 - 7], [1, -1, 1, -1]])
"""Budding angles in multiples of π/16, by the daughter's form; each of the four is drawn with probability 1/4."""

PLACES = np.array([[1, 2, 4, 8], [16, 32, 16, 32]], dtype=np.uint8)
"""A bit for each of a mother's six places for daughters, by the daughter's form and which of its angles."""


def displacements() -> Float[np.ndarray, "mother daughter angle direction 2"]:
    """(X − x, Y − y) by the mother's form, the daughter's form and which of its angles, and the mother's direction."""
    theta = np.pi / 16 * np.arange(DIRECTIONS)
    along, across = np.stack([np.cos(theta), np.sin(theta)]), np.stack([-np.sin(theta), np.cos(theta)])
    found = np.empty((2, 2, 4, DIRECTIONS, 2))
    for mother, (long, short) in enumerate(SEMI_AXES):
        for daughter, ((reach, _), angles) in enumerate(zip(SEMI_AXES, np.pi / 16 * BUDDING, strict=True)):
            for k, beta in enumerate(angles):
                tangent = np.tan(beta)
                phi = beta + np.arctan((long - short) * tangent) / (short + long * tangent**2)
                u = long * np.cos(phi) + reach * np.cos(beta)
                v = short * np.sin(phi) + reach * np.sin(beta)
                found[mother, daughter, k] = (u * along + v * across).T
    return found


DISPLACEMENTS = displacements()
