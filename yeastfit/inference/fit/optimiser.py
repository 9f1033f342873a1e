"""Steps of optimistix's optimisers on a problem that answers with values and Jacobians.

At each point that the optimiser asks for, an ensemble is simulated, which gives residuals r and their Jacobian J at
once. optimistix is shown the affine function r + J (z − z₀): at z₀, the only place where it evaluates it, that has the
right value and the right derivative, and nothing is traced through a simulation.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

OPTIONS = {"jac": "bwd"}  # the Jacobian as a matrix
STIFFEST = (
    100.0  # largest eigenvalue of c² JᵀJ at a cautious first point: directions of eigenvalues below 1 hardly move
)

Residuals = Float[np.ndarray, " residual"]
Jacobian = Float[np.ndarray, "residual entry"]


class Optimiser:
    """An optimiser that is asked for a point and told residuals and Jacobian there.

    It sees r times a constant c: Levenberg–Marquardt begins with the damping 1, BFGS with the Hessian 1, which must be
    something beside c² JᵀJ.

    Attributes:
        z: The best point so far.
        trial: The point to be evaluated next.
        cost: r · r at z.
        rejected: Steps in a row that were not taken.
        failure: Why it cannot go on; empty where it can.
    """

    SOLVERS: ClassVar[dict[str, Any]] = {
        "levenberg-marquardt": optx.LevenbergMarquardt,
        "dogleg": optx.Dogleg,
        "bfgs": optx.BFGS,
    }

    def __init__(self, method: str, z: Float[np.ndarray, " entry"], size: int, cautious: bool = False) -> None:
        """Begin at z.

        Arguments:
            method: A name out of `SOLVERS`.
            z: The start.
            size: Residuals.
            cautious: Whether the first steps are short.
        """
        scalar = method == "bfgs"
        self.size = size
        self.stiffest = STIFFEST if cautious else 1.0 if scalar else None
        self.scale = 1.0
        self.solver, self.function = self.SOLVERS[method](rtol=1e-6, atol=1e-6), _half_square if scalar else _affine
        self.z = jnp.asarray(z)
        self.residuals, self.jacobian = np.zeros(size), np.zeros((size, len(z)))
        self.cost, self.rejected, self.failure = np.inf, 0, ""
        shape = jax.ShapeDtypeStruct(() if scalar else (size,), self.z.dtype)
        at = self._known(self.z, self.residuals, self.jacobian)
        self.state = _init(self.solver, self.function, self.z, at, shape)

    @property
    def trial(self) -> Float[np.ndarray, " entry"]:
        """Where residuals are wanted."""
        return np.asarray(self.state.y_eval, dtype=float)

    def tell(self, residuals: Residuals, jacobian: Jacobian) -> bool:
        """Take residuals and their Jacobian at `trial`; whether the step there is taken."""
        trial = self.state.y_eval
        if self.stiffest and not np.isfinite(self.cost):
            self.scale = float(np.sqrt(self.stiffest) / max(np.linalg.norm(jacobian, 2), 1e-12))
        at = self._known(trial, self.scale * residuals, self.scale * jacobian)
        self.z, self.state, result = _step(self.solver, self.function, self.z, at, self.state)
        taken = bool(jnp.all(self.z == trial))
        if taken:
            self.residuals, self.jacobian = residuals, jacobian
            self.cost, self.rejected = float(residuals @ residuals), 0
        else:
            self.rejected += 1
        if result != optx.RESULTS.successful:
            self.failure = f"the optimiser failed: {optx.RESULTS[result]}"  # type: ignore[misc]
        elif not np.isfinite(self.trial).all():
            self.failure = "the optimiser asked for a point that is not finite"
        return taken

    @property
    def predicted_reduction(self) -> float:
        """By how much r · r would fall at the minimum of the affine function around z."""
        scale = np.abs(self.jacobian).max(axis=0)
        basis = np.linalg.qr(self.jacobian[:, scale > 1e-9 * max(1.0, scale.max())])[0]
        return float(np.sum((basis.T @ self.residuals) ** 2))

    def _known(self, place: Array, residuals: Residuals, jacobian: Jacobian) -> tuple[Array, Array, Array]:
        return place, jnp.asarray(residuals, self.z.dtype), jnp.asarray(jacobian, self.z.dtype)


@eqx.filter_jit
def _init(solver: Any, function: Any, z: Array, at: tuple[Array, Array, Array], shape: jax.ShapeDtypeStruct) -> Any:
    return solver.init(function, z, at, OPTIONS, shape, None, frozenset())


@eqx.filter_jit
def _step(solver: Any, function: Any, z: Array, at: tuple[Array, Array, Array], state: Any) -> tuple[Array, Any, Any]:
    z, state, _ = solver.step(function, z, at, OPTIONS, state, frozenset())
    return z, state, solver.terminate(function, z, at, OPTIONS, state, frozenset())[1]


def _affine(z: Array, at: tuple[Array, Array, Array]) -> tuple[Array, None]:
    centre, residuals, jacobian = at
    return residuals + jacobian @ (z - centre), None


def _half_square(z: Array, at: tuple[Array, Array, Array]) -> tuple[Array, None]:
    return 0.5 * jnp.sum(_affine(z, at)[0] ** 2), None
