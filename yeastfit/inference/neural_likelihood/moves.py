"""Steps of an ensemble of walkers, as one compiled program.

In every step walkers are dealt at random into two halves, which move one after the other. A proposal q for a walker at
s is made from the walkers c of the other half, and accepted with probability min(1, f p(q) / p(s)), p the density that
is sampled (as in emcee: Foreman-Mackey et al. 2013, doi:10.1086/670067). Proposals of a step are one of two kinds:

    from a kernel density   q = c_j + h G ξ,    f = k(s) / k(q),    G Gᵀ = cov(c),    h = n^(−1 / (d + 4)) (Scott 1992)
    differential evolution  q = s + (γ + σ ξ_1) (c_j − c_k),    f = 1,    γ = 2.38 / √(2 d), or 1 in a fifth of them

with ξ ~ N(0, 1), k the density of normal kernels h G around the n walkers c, and j ≠ k at random, in d dimensions (ter
Braak 2006, doi:10.1007/s11222-006-8769-1). All randomness is drawn by numpy and handed in.

A step of 128 walkers on an emulator's density in five dimensions takes 1.4 ms on one core; by emcee, which asks for the
densities of each half and does the rest in Python, 5 ms.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Bool, Float, Int

from yeastfit.inference.neural_likelihood.densities import LogDensity

KERNELS = 10  # walkers per parameter, at least, for a kernel density that is worth drawing from
BY_KERNELS, FAR = 0.5, 0.2  # shares: of steps, and of those by differential evolution that have γ = 1
JITTER = 1e-5  # σ

Proposals = tuple[Float[Array, "moved coordinate"], Float[Array, " moved"]]
State = tuple[Float[Array, "walker coordinate"], Float[Array, " walker"]]
Walkers = Float[np.ndarray, "walker coordinate"]


class Chance(NamedTuple):
    """What is random in a number of steps, or in one of them; arrays of NumPy or JAX.

    Attributes:
        kernels: Whether proposals are from a kernel density.
        gamma: γ of the others.
        order: Walkers; the first move first, given the others, then the last.
        pair: j and k.
        normal: ξ.
        log_uniform: Below which log f p(q) / p(s) is refused.
    """

    kernels: Bool[Any, "*step"]
    gamma: Float[Any, "*step"]
    order: Int[Any, "*step walker"]
    pair: Int[Any, "*step half moved 2"]
    normal: Float[Any, "*step half moved coordinate"]
    log_uniform: Float[Any, "*step half moved"]

    @staticmethod
    def of_steps(count: int, walkers: int, size: int, rng: np.random.Generator) -> "Chance":
        """Of so many steps of these walkers in so many dimensions.

        Where their number is odd one of them stays where it is in every step.
        """
        moved = walkers // 2
        others, shape = walkers - moved, (count, 2, moved)
        share = BY_KERNELS if walkers >= KERNELS * size else 0.0
        first = rng.integers(others, size=shape)
        second = (first + 1 + rng.integers(others - 1, size=shape)) % others
        return Chance(
            rng.random(count) < share,
            np.where(rng.random(count) < FAR, 1.0, 2.38 / np.sqrt(2 * size)),
            rng.permuted(np.tile(np.arange(walkers), (count, 1)), axis=1),
            np.stack([first, second], axis=-1),
            rng.standard_normal((*shape, size)),
            -rng.standard_exponential(shape),
        )


def stepped(
    log_density: LogDensity, x: Walkers, density: Float[np.ndarray, " walker"], chance: Chance
) -> tuple[
    Float[np.ndarray, "step walker coordinate"], Float[np.ndarray, "step walker"], Bool[np.ndarray, "step walker"]
]:
    """Where walkers are after each step, in double precision.

    Arguments:
        log_density: That is sampled, up to a constant.
        x: Where they are.
        density: Its logarithm there.
        chance: Of these steps; each number of them is compiled for.

    Returns:
        Places, log densities, and which walkers moved.
    """
    with jax.enable_x64(True):
        found = _compiled(log_density, x, density, chance)
    places, densities, moved = (np.asarray(one) for one in found)
    return places, densities, moved


def _stepped(
    log_density: LogDensity, x: Float[Array, "walker coordinate"], density: Float[Array, " walker"], chance: Chance
) -> tuple[Float[Array, "step walker coordinate"], Float[Array, "step walker"], Bool[Array, "step walker"]]:
    """`stepped`."""
    walkers, moved = len(x), len(x) // 2

    def step(state: State, now: Chance) -> tuple[State, tuple[Array, Array, Array]]:
        def half(state: State, mine: tuple[Array, ...]) -> tuple[State, Array]:
            (x, density), (own, others, pair, normal, log_uniform) = state, mine
            s, c = x[own], x[others]
            q, log_f = jax.lax.cond(
                now.kernels,
                lambda: from_kernels(s, c, pair, normal),
                lambda: by_evolution(s, c, pair, now.gamma + JITTER * normal[:, 0]),
            )
            proposed = log_density(q)
            accepted = log_uniform < log_f + proposed - density[own]  # not where one of them is nan
            x = x.at[own].set(jnp.where(accepted[:, None], q, s))
            density = density.at[own].set(jnp.where(accepted, proposed, density[own]))
            return (x, density), jnp.zeros(walkers, dtype=bool).at[own].set(accepted)

        own = jnp.stack([now.order[:moved], now.order[-moved:]])
        others = jnp.stack([now.order[moved:], now.order[: walkers - moved]])
        state, accepted = jax.lax.scan(half, state, (own, others, now.pair, now.normal, now.log_uniform))
        return state, (*state, accepted.any(axis=0))

    return jax.lax.scan(step, (x, density), chance)[1]


_compiled: Any = eqx.filter_jit(  # type: ignore[call-overload]
    _stepped, compiler_options={"xla_cpu_multi_thread_eigen": False}
)
"""On CPUs handing so small matrices to further threads takes longer than multiplying them."""


def from_kernels(
    s: Float[Array, "moved coordinate"],
    c: Float[Array, "other coordinate"],
    pair: Int[Array, "moved 2"],
    normal: Float[Array, "moved coordinate"],
) -> Proposals:
    """Proposals from a kernel density of the other walkers, and log f; nan where these lie in a plane."""
    count, size = c.shape
    off = c - c.mean(axis=0)
    root = count ** (-1.0 / (size + 4)) * jnp.linalg.cholesky(off.T @ off / (count - 1))
    q = c[pair[:, 0]] + normal @ root.T
    density = log_density_of_kernels(jnp.concatenate([s, q]), c, root)
    return q, density[: len(s)] - density[len(s) :]


def by_evolution(
    s: Float[Array, "moved coordinate"],
    c: Float[Array, "other coordinate"],
    pair: Int[Array, "moved 2"],
    gamma: Float[Array, " moved"],
) -> Proposals:
    """Proposals by differential evolution, and log f."""
    return s + gamma[:, None] * (c[pair[:, 0]] - c[pair[:, 1]]), jnp.zeros(len(s))


def log_density_of_kernels(
    x: Float[Array, "row coordinate"], c: Float[Array, "other coordinate"], root: Float[Array, "coordinate coordinate"]
) -> Float[Array, " row"]:
    """Log density of x, up to a constant, of normal kernels of covariance root rootᵀ around c."""
    off = jnp.concatenate([x, c]) - c.mean(axis=0)
    white = solve_triangular(root, off.T, lower=True).T
    x, c = white[: len(x)], white[len(x) :]
    each = x @ c.T - 0.5 * ((x**2).sum(axis=1)[:, None] + (c**2).sum(axis=1))
    return jax.nn.logsumexp(each, axis=1)
