"""Small neural networks that learn a normal distribution as a function of coordinates.

Of statistics s = c + L u, given coordinates x of which φ(x) are the terms of a quadratic,

    u | x ~ N(m(x), C(x)),    m = Bφ(x) + f_m(x),    C⁻¹ = PᵀP,    P = (1 + A) L⁻¹ diag(exp(−f_s(x))) L.

B is a least-squares fit, corrected by the network f; L Lᵀ is the covariance of the residuals of such a fit. f_s scales
the statistics themselves, which on curves, whose neighbouring points are correlated, does better than scaling the
entries of u. A is strictly lower triangular. Of at most `FEW_STATISTICS` it depends on x, A = A_0 + f_A(x), and with it
how statistics go together; of more, such as the points of curves, it is the same for all x. Of 4096 off-lattice
colonies near a posterior the mean log density of others rises so from −0.90 to −0.65 by four statistics and from 2.94
to 3.84 by ten, of 512 from −1.61 to −1.51 and from 0.89 to 0.78; of 512 colonies by 22 points of curves it would fall
from 38.8 to 33.0. Where simulations fail, one more output corrects a quadratic for the logit of their success
(`success`).

Trained by maximum likelihood, and cross-entropy of success, with Adam, decoupled weight decay (Loshchilov & Hutter
2019, arXiv:1711.05101) and a cosine learning-rate schedule. The state with the smallest held-out loss is kept.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from yeastfit.errors import InputError
from yeastfit.inference.polynomial import monomials
from yeastfit.processors import available_processors

PLENTY = 3072  # simulations from twice as many of which training takes longer
STEPS = 1000  # of training for up to `EASY` coordinates, and for each one more
EASY = 3
FEW, MANY = (5, 64), (12, 32)  # members and width for up to `EASY` coordinates, and for more
FEW_STATISTICS = 12  # at most, of which correlations depend on x
LARGEST_LOG_SCALE = 6.0  # |f_s| at most: a scatter 400 times smaller than elsewhere is as good as none


@dataclass(frozen=True)
class TrainingSettings:
    """How an emulator is trained.

    Attributes:
        members: Networks of the ensemble, and folds of the cross-validation; by default as many as the number of
            coordinates asks for (`resolved`), like width and steps.
        width: Of hidden layers.
        depth: Number of hidden layers.
        steps: Of Adam, for fewer than 2 `PLENTY` simulations; more have more (`for_simulations`).
        batch: Simulations of each step.
        rate: Learning rate at the start.
        decay: Of weights.
        checks: How often the held-out loss is computed.
    """

    members: int | None = None
    width: int | None = None
    depth: int = 2
    steps: int | None = None
    batch: int = 128
    rate: float = 3e-3
    decay: float = 0.1
    checks: int = 50

    def __post_init__(self) -> None:
        for name, least in (("members", 2), ("width", 1), ("depth", 1), ("batch", 1), ("checks", 1)):
            if getattr(self, name) is not None and getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}, it must be at least {least}")
        if self.steps is not None and self.steps < self.checks:
            raise InputError(f"steps is {self.steps}, it must be at least checks, which is {self.checks}")
        if not self.rate > 0 or not self.decay >= 0:
            raise InputError(f"rate is {self.rate} and decay {self.decay}, they must be above 0 and at least 0")

    @property
    def count(self) -> int:
        """Members, those of few coordinates where they are left open."""
        return self.members or FEW[0]

    def resolved(self, free: int) -> "TrainingSettings":
        """With members, width and steps for so many coordinates.

        1000, and 1000 more for each coordinate beyond three. Of 4096 simulations in five coordinates networks have not
        learnt all there is after 1000: the held-out misfit makes the emulator's error four times what it is after 3000.
        What networks make of their starts and batches by chance is averaged out by more of them, of half the width and
        so of about the same cost: of 4176 colonies of the off-lattice model two trainings of 12 networks of width 32
        have log-likelihoods that differ by 0.29 over a posterior (standard deviation), of 5 of width 64 by 0.53.
        """
        members, width = FEW if free <= EASY else MANY
        steps = self.steps or STEPS * max(1, free + 1 - EASY)
        return replace(self, members=self.members or members, width=self.width or width, steps=steps)

    def for_simulations(self, count: int) -> "TrainingSettings":
        """With twice the steps for each time that so many simulations are twice `PLENTY`, of settings `resolved`.

        Of 6920 colonies of the off-lattice model near a posterior, networks had an error of 3.0 % of the variance of
        the data after 3000 steps, and of 1.1 % after 6000; of 4000 colonies 6000 steps made none smaller.
        """
        doublings = max(0, int(np.log2(count / PLENTY)))  # powers of two, as each number of steps is compiled for
        return replace(self, steps=(self.steps or STEPS) * 2**doublings)


class Network(eqx.Module):
    """One member, or all of them with a leading axis; `mixing` holds A_0's entries below the diagonal."""

    layers: eqx.nn.MLP
    mixing: Float[Array, "*member pair"]

    @staticmethod
    def start(free: int, statistics: int, settings: TrainingSettings, rng: np.random.Generator) -> "Network":
        """All members, hardly correcting yet: the last layer's weights are small, A_0 is 0."""
        pairs = statistics * (statistics - 1) // 2
        outputs = 2 * statistics + 1 + (pairs if statistics <= FEW_STATISTICS else 0)
        sizes = free, outputs, settings.width or FEW[1], settings.depth
        layers = eqx.filter_eval_shape(eqx.nn.MLP, *sizes, jax.nn.silu, key=jax.random.key(0))

        def drawn(layer: eqx.nn.Linear) -> eqx.nn.Linear:
            limit = (0.01 if layer is layers.layers[-1] else 1.0) / math.sqrt(layer.weight.shape[1])

            def uniform(leaf: jax.ShapeDtypeStruct) -> Array:
                return jnp.asarray(rng.uniform(-limit, limit, (settings.count, *leaf.shape)))

            return eqx.tree_at(lambda one: (one.weight, one.bias), layer, replace_fn=uniform)

        layers = eqx.tree_at(lambda one: one.layers, layers, tuple(drawn(one) for one in layers.layers))
        return Network(layers, jnp.zeros((settings.count, pairs)))

    def __call__(self, x: Float[Array, " free"]) -> tuple[Array, Array, Array, Array]:
        """f_m [statistic], f_s [statistic], what corrects the logit of success, and 1 + A [statistic, statistic]."""
        pairs = self.mixing.shape[-1]
        size = (1 + math.isqrt(1 + 8 * pairs)) // 2
        mean, log_scale, logit, mixing = jnp.split(self.layers(x), (size, 2 * size, 2 * size + 1))
        mixing = self.mixing + mixing if len(mixing) else self.mixing
        mixer = jnp.eye(size, dtype=mixing.dtype).at[jnp.tril_indices(size, -1)].set(mixing)
        return mean, LARGEST_LOG_SCALE * jnp.tanh(log_scale / LARGEST_LOG_SCALE), logit[0], mixer

    def residual(
        self, x: Float[Array, " free"], rest: Float[Array, " statistic"], shape: "Shape"
    ) -> tuple[Float[Array, " statistic"], Float[Array, ""], Float[Array, ""]]:
        """P(u − m) where rest is u − Bφ(x), log det P, and what corrects the logit of success."""
        mean, log_scale, logit, mixer = self(x)
        scaled = jnp.exp(-log_scale) * (shape.root @ (rest - mean))
        return mixer @ (shape.inverse @ scaled), -jnp.sum(log_scale), logit

    def moments(self, x: Float[Array, " free"], shape: "Shape") -> tuple[Array, Array, Array]:
        """f_m, P⁻¹, which is the Cholesky factor of C, and what corrects the logit of success."""
        mean, log_scale, logit, mixer = self(x)
        one = jnp.eye(len(mean), dtype=mixer.dtype)
        unmixed = jax.scipy.linalg.solve_triangular(mixer, one, lower=True, unit_diagonal=True)
        return mean, shape.inverse @ (jnp.exp(log_scale)[:, None] * (shape.root @ unmixed)), logit


class Shape(eqx.Module):
    """L with rows of length 1, which changes nothing in P, and its inverse."""

    root: Float[Array, "statistic statistic"]
    inverse: Float[Array, "statistic statistic"]

    @staticmethod
    def of(root: Float[np.ndarray, "statistic statistic"]) -> "Shape":
        """From L."""
        scaled = root / np.linalg.norm(root, axis=1, keepdims=True)
        return Shape(jnp.asarray(scaled), jnp.asarray(np.linalg.inv(scaled)))


class Simulated(eqx.Module):
    """Training data, padded to one length; `came` is 1 for simulations that succeeded, 0 for failures."""

    x: Float[Array, "row free"]
    u: Float[Array, "row statistic"]
    came: Float[Array, " row"]


class Folds(eqx.Module):
    """Rows that each member learns from, step by step, and that it is tested on: the first `count` of `test`."""

    learn: Int[Array, "member check step batch"]
    test: Int[Array, "member test"]
    count: Int[Array, " member"]


def deal(
    rows: int, settings: TrainingSettings, rng: np.random.Generator, room: int
) -> tuple[Folds, Int[np.ndarray, " row"]]:
    """Deal rows at random into one fold per member; also the member that each row is held out from.

    All randomness is drawn here and not in compiled code, where random numbers would be most of what is compiled.

    Arguments:
        rows: How many there are.
        settings: Members, steps and batch.
        rng: Where randomness comes from.
        room: Rows that there may be later; there is a place for them, so that more data need no further compilation.
    """
    members = settings.count
    part = rng.permutation(np.arange(rows) % members)
    steps = settings.checks, (settings.steps or STEPS) // settings.checks, settings.batch
    learn = np.stack([rng.choice(np.flatnonzero(part != member), steps) for member in range(members)])
    test, count = np.zeros((members, room // members + 1), dtype=int), np.bincount(part, minlength=members)
    for member, line in enumerate(test):
        line[: count[member]] = np.flatnonzero(part == member)
    return Folds(jnp.asarray(learn), jnp.asarray(test), jnp.asarray(count)), part


class Members(NamedTuple):
    """What is each member's own in training, with a leading axis.

    Attributes:
        starts: The networks to begin with.
        baselines: B.
        odds: Coefficients of quadratics for the logit of success; None where no simulation failed.
        folds: Rows to learn from and to be tested on.
    """

    starts: Network
    baselines: Float[Array, "member feature statistic"]
    odds: Float[Array, "member feature"] | None
    folds: Folds


def fitted(
    members: Members, shape: Shape, data: Simulated, settings: TrainingSettings
) -> tuple[Network, Float[Array, "member check"]]:
    """Trained networks, each as it was when its held-out loss was smallest, and these losses.

    On a CPU every network is trained by itself, on as many threads as there are processors: matrices this small are
    dearer together, and on one thread. What one learns does not depend on the others.
    """
    if jax.default_backend() != "cpu":
        return fitted_together(members, shape, data, settings)

    def member(k: int) -> tuple[Network, Array]:
        one = jax.tree.map(lambda leaf: leaf[k : k + 1] if eqx.is_array(leaf) else leaf, members)
        return jax.block_until_ready(fitted_together(one, shape, data, settings))

    with ThreadPoolExecutor(available_processors()) as pool:
        parts = list(pool.map(member, range(settings.count)))
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves) if eqx.is_array(leaves[0]) else leaves[0], *parts)


@eqx.filter_jit
def fitted_together(
    members: Members, shape: Shape, data: Simulated, settings: TrainingSettings
) -> tuple[Network, Float[Array, "member check"]]:
    """`fitted`, all networks in one program."""
    starts, baselines, odds, folds = members
    schedule = optax.cosine_decay_schedule(settings.rate, settings.steps or STEPS)
    optimiser = optax.adamw(schedule, weight_decay=settings.decay)
    features = monomials(data.x)
    trained, still = eqx.partition(starts, eqx.is_inexact_array)

    def loss(params: Network, baseline: Array, odd: Array | None, rows: Array) -> Array:
        network = eqx.combine(params, still)
        rest = data.u[rows] - features[rows] @ baseline
        residual, log_det, logit = jax.vmap(lambda x, left: network.residual(x, left, shape))(data.x[rows], rest)
        came = data.came[rows]
        if odd is not None:
            logit = logit + features[rows] @ odd
        surprise = came * (0.5 * jnp.sum(residual**2, axis=-1) - log_det)
        return surprise + optax.sigmoid_binary_cross_entropy(logit, came)

    def train(
        params: Network, baseline: Array, odd: Array | None, learn: Array, test: Array, count: Array
    ) -> tuple[Network, Array]:
        weight = (jnp.arange(len(test)) < count) / count

        def step(carry: tuple[Network, optax.OptState], rows: Array) -> tuple[Any, None]:
            params, state = carry
            slope = jax.grad(lambda one: jnp.mean(loss(one, baseline, odd, rows)))(params)
            updates, state = optimiser.update(slope, state, params)
            return (optax.apply_updates(params, updates), state), None

        def check(carry: tuple[Network, optax.OptState, Network, Array], rows: Array) -> tuple[Any, Array]:
            params, state, best, least = carry
            (params, state), _ = jax.lax.scan(step, (params, state), rows)
            held_out = jnp.sum(weight * loss(params, baseline, odd, test))
            best = jax.tree.map(lambda new, old: jnp.where(held_out < least, new, old), params, best)
            return (params, state, best, jnp.minimum(held_out, least)), held_out

        start = (params, optimiser.init(params), params, jnp.asarray(jnp.inf))
        (_, _, best, _), losses = jax.lax.scan(check, start, learn)
        return best, losses

    best, losses = jax.vmap(train)(trained, baselines, odds, folds.learn, folds.test, folds.count)
    return eqx.combine(best, still), losses
